//! Memory as the files of `/proc` state it.

/// The bytes that the line `name` of `text` states, a file such as `/proc/meminfo`; `None` where there is no such line.
pub fn bytes(text: &str, name: &str) -> Option<u64> {
    let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    Some(value.trim().trim_end_matches(" kB").parse::<u64>().ok()? * 1024)
}
