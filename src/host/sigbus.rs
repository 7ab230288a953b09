//! A message before SIGBUS ends the process: the system sends it for memory whose file is gone, without a word.
#![expect(unsafe_code, reason = "what a signal interrupts may be half done")]

use std::ffi::c_int;

use anyhow::{Result, ensure};
use libc::{SIG_DFL, SIG_ERR, SIGBUS, sighandler_t, signal};

const MESSAGE: &[u8] =
    b"tapline: a file was cut short or its disk failed while it was read, or shared memory has no room left\n";

/// Has the message written before the signal ends the program, as it would anyway: its exit status shows the signal.
///
/// # Errors
/// An error of the system.
pub(crate) fn explain_sigbus() -> Result<()> {
    // SAFETY: the handler does no more than may be done anywhere.
    let before = unsafe { signal(SIGBUS, write_message as *const () as sighandler_t) };
    ensure!(before != SIG_ERR, "cannot listen to signals: {}", std::io::Error::last_os_error());
    Ok(())
}

/// Writes a constant. The read that failed is tried again afterwards and fails again, now with the default action.
extern "C" fn write_message(_signal: c_int) {
    // If standard error is closed, nothing can be done about it.
    let _is_written = rustix::io::write(rustix::stdio::stderr(), MESSAGE);
    // SAFETY: it keeps no pointer and may be called in a handler.
    unsafe { signal(SIGBUS, SIG_DFL) };
}
