//! Verdicts on standard output. A reader that pauses, or has gone, holds up only the thread that prints.

use std::io::Write as _;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Error, Result};
use tapline_host::stdout::Stdout;

use crate::shown::verdict::Form;
use crate::wires::outbox::{Outbox, Receiver};
use crate::wires::reporter::{Reported, Reporter};

/// How long the last verdicts may take when the line ends.
const END_WITHIN: Duration = Duration::from_secs(2);

/// Prints each verdict of `outbox` in this `form`.
pub(super) fn start(form: Form, outbox: &Arc<Outbox>) -> Result<Reporter> {
    let mut has_failed = false;
    Reporter::start(Receiver::Print, outbox, END_WITHIN, move |_, verdict, _| {
        // What failed may have left half a line.
        let ended = if has_failed { Stdout.write_all(b"\n").map_err(Error::from) } else { Ok(()) };
        let printed = ended.and_then(|()| verdict.print(form));
        has_failed = printed.is_err();
        match printed {
            Ok(()) => Reported::Done,
            Err(error) => {
                let file = verdict.file.display();
                Reported::Later(format!("the verdict could not be printed: {error:#}; it is in {file}"))
            }
        }
    })
}
