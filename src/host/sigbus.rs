//! What is said when memory that stands for a file is gone: the system ends whoever reads it, and says nothing.
#![expect(unsafe_code, reason = "what a signal interrupts may be half done")]

use std::ffi::c_int;

use anyhow::{Result, ensure};
use libc::{SIG_DFL, SIG_ERR, SIGBUS, sighandler_t, signal};

const SAID: &[u8] =
    b"tapline: a file was cut short or its disk failed while it was read, or shared memory has no room left\n";

/// Has this said before the program is ended by the signal, as it would be anyway: whoever started it sees that it was.
///
/// # Errors
/// What the system says.
pub(crate) fn explain_sigbus() -> Result<()> {
    // SAFETY: the handler does no more than may be done anywhere.
    let before = unsafe { signal(SIGBUS, say as *const () as sighandler_t) };
    ensure!(before != SIG_ERR, "cannot listen to signals: {}", std::io::Error::last_os_error());
    Ok(())
}

/// Writes what is constant. What was to be read is not there when it is tried again either, and then nothing is in the way.
extern "C" fn say(_signal: c_int) {
    // Who cannot be told is not told.
    let _is_told = rustix::io::write(rustix::stdio::stderr(), SAID);
    // SAFETY: it keeps no pointer and may be called in a handler.
    unsafe { signal(SIGBUS, SIG_DFL) };
}
