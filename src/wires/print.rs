//! Verdicts on standard output. A reader that pauses, or has gone, holds up only the thread that prints.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;

use crate::shown::verdict::Form;
use crate::wires::outbox::{Outbox, Receiver};
use crate::wires::reporter::{Reported, Reporter};

/// How long the last verdicts may take when the line ends.
const END_WITHIN: Duration = Duration::from_secs(2);

/// Prints each verdict of `outbox` in this `form`.
pub(super) fn start(form: Form, outbox: &Arc<Outbox>) -> Result<Reporter> {
    Reporter::start(Receiver::Print, outbox, END_WITHIN, move |_, verdict, _| match verdict.print(form) {
        Ok(()) => Reported::Done,
        Err(error) => {
            let file = verdict.file.display();
            Reported::Later(format!("the verdict could not be printed: {error:#}; it is in {file}"))
        }
    })
}
