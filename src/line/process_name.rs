//! Names of processes, as `ps` and `top` show them.

use std::ffi::CString;

/// Longest name that the system keeps of a thread, in bytes.
const NAME_BYTES_MAX: usize = 15;

/// What the stage of `verb` is called: the zeroth argument it is started with, which `ps -f` shows.
pub(crate) fn stage_name(verb: &str) -> String {
    format!("tapline-{verb}")
}

/// Calls this process `name`, as far as the system keeps it: `ps` and `top` show it, and `pgrep` finds it. To be called by
/// the main thread, before it starts others, which have the name from it.
pub(crate) fn name_process(name: &str) {
    let bytes = name.bytes().filter(u8::is_ascii_graphic).take(NAME_BYTES_MAX).collect::<Vec<_>>();
    if let Ok(name) = CString::new(bytes)
        && let Err(error) = rustix::thread::set_name(&name)
    {
        tracing::debug!(%error, "the process cannot be named");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_shows_the_name() {
        let named = std::thread::Builder::new().spawn(|| {
            name_process(&stage_name("acquire-12"));
            std::fs::read_to_string("/proc/thread-self/comm").unwrap()
        });
        let named = named.unwrap();
        assert_eq!(named.join().unwrap(), "tapline-acquire\n");
    }
}
