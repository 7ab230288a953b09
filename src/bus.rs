//! What is said when memory that stands for a file is gone: the system ends whoever reads it, and says nothing.
#![expect(unsafe_code, reason = "what a signal interrupts may be half done")]

use anyhow::{Context as _, Result};
use signal_hook::consts::SIGBUS;
use signal_hook::low_level;

const SAID: &[u8] =
    b"tapline: a file was cut short or its disk failed while it was read, or shared memory has no room left\n";

/// Has this said, and the program ended as by any other error.
///
/// # Errors
/// What the system says.
pub(crate) fn say_what_is_gone() -> Result<()> {
    let say = || {
        // Who cannot be told is not told.
        let _is_told = rustix::io::write(rustix::stdio::stderr(), SAID);
        low_level::exit(1);
    };
    // SAFETY: it writes what is constant and ends the program at once, both of which a signal may do anywhere.
    unsafe { low_level::register(SIGBUS, say) }.context("cannot listen to signals")?;
    Ok(())
}
