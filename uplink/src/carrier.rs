//! What the sender needs of a server.

use std::path::Path;

use anyhow::Result;

use crate::file::CasingFile;
use crate::receipt::Receipt;

/// Carries files to a centre. Any server that keeps what it has acknowledged can be one.
#[expect(async_fn_in_trait, reason = "one thread runs it, and no one outside asks for more")]
pub trait Carrier {
    /// Publishes the bytes of the file at `path` as `file`; its digest, when all of it is kept.
    ///
    /// # Errors
    /// A server that does not keep it, and a file that cannot be read.
    async fn publish(&self, file: &CasingFile, path: &Path) -> Result<String>;

    /// Has collectors told again that `file` waits; its size, and `None` if the server does not have it.
    ///
    /// # Errors
    /// A server that does not answer.
    async fn remind(&self, file: &CasingFile) -> Result<Option<u64>>;

    /// The receipt of `file`; `None` if no centre has said anything of it yet.
    ///
    /// # Errors
    /// A server that does not answer.
    async fn receipt(&self, file: &CasingFile) -> Result<Option<Receipt>>;

    /// Removes the receipt of `file`, so that a centre takes it again.
    ///
    /// # Errors
    /// A server that does not answer.
    async fn forget(&self, file: &CasingFile) -> Result<()>;
}
