//! Names of processes, as `ps` and `top` show them.

use std::ffi::CString;

/// What the stage of `verb` is called: the zeroth argument it is started with, which `ps -f` shows.
pub(crate) fn stage_name(verb: &str) -> String {
    format!("tapline-{verb}")
}

/// Names this process `name`, as far as the system keeps it: `ps` and `top` show it, `pgrep` finds it. To be called by
/// the main thread, before it starts others, which inherit the name.
pub(crate) fn name_process(name: &str) {
    if let Ok(name) = CString::new(name)
        && let Err(error) = rustix::thread::set_name(&name)
    {
        tracing::debug!(%error, "the process cannot be named");
    }
}
