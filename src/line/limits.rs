//! Checks, before anything starts, that the machine has what a line needs. If it did not, libraries would retry
//! for ever, and the line would stop without an error.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tapline_host::memory;
use tapline_host::messages::counted;
use tapline_wire::shm;

/// What a line will need.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Needs {
    /// Stations of the line.
    pub stations: usize,
    /// Processes that serve them.
    pub acquire_processes: usize,
    /// Shared memory that the line reserves, in bytes.
    pub shared_bytes: u64,
}

/// Descriptors of the busiest process in any line: `tests/faults/limits.rs` compares these three with a running line.
const DESCRIPTORS_FIXED: u64 = 90;
/// Descriptors that it needs in addition for each process that serves stations.
const DESCRIPTORS_PER_PROCESS: u64 = 12;
/// Descriptors that it needs in addition for each station: the file under way.
const DESCRIPTORS_PER_STATION: u64 = 4;

/// Memory that is private to a process, in bytes.
const MEMORY_PER_PROCESS: u64 = 24 << 20;

/// Processes other than those that serve stations: `store`, `fuse`, `process` and the one that supervises them.
const OTHER_PROCESSES: u64 = 4;

/// What the machine has; `None` means no limit.
#[derive(Debug, Clone, Copy)]
struct Limits {
    descriptors: Option<u64>,
    shared_free: u64,
    memory_free: Option<u64>,
}

/// Raises the limits that may be raised, and checks that the machine has what the line needs. To be called before any
/// process starts, since processes inherit limits.
///
/// # Errors
/// Everything that is too little, in one error: what there is, and what is needed.
pub(crate) fn check(needs: &Needs) -> Result<()> {
    raise_descriptors();
    judge(needs, &Limits::of_system()?)
}

/// Raises the soft limit of open files to the hard one.
fn raise_descriptors() {
    let limit = getrlimit(Resource::Nofile);
    if limit.current != limit.maximum
        && let Err(error) = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, maximum: limit.maximum })
    {
        tracing::debug!(%error, "the limit of open files cannot be raised");
    }
}

impl Limits {
    fn of_system() -> Result<Self> {
        Ok(Self {
            descriptors: getrlimit(Resource::Nofile).current,
            shared_free: shm::free_bytes()?,
            memory_free: memory_available().into_iter().chain(memory_of_group()).min(),
        })
    }
}

/// Memory that the system can still give, in bytes, where it reports it.
fn memory_available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    // Shared memory can be swapped out.
    Some(memory::bytes(&text, "MemAvailable")? + memory::bytes(&text, "SwapFree").unwrap_or(0))
}

/// Memory that the control groups of this process (a container, a service) still allow, in bytes, if one is limited.
fn memory_of_group() -> Option<u64> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let own = groups.lines().find_map(|line| line.strip_prefix("0::/"))?;
    let root = Path::new("/sys/fs/cgroup");
    let own: PathBuf = root.join(own);
    let read = |folder: &Path, name: &str| -> Option<u64> {
        std::fs::read_to_string(folder.join(name)).ok()?.trim().parse().ok() // "max" is no number and no limit
    };
    let free = |folder: &Path| Some(read(folder, "memory.max")?.saturating_sub(read(folder, "memory.current")?));
    own.ancestors().take_while(|folder| folder.starts_with(root)).filter_map(free).min()
}

/// A resource, and how much of it a line needs.
struct Item {
    what: &'static str,
    have: u64,
    need: u64,
    /// Whether the numbers are bytes.
    is_bytes: bool,
    cure: &'static str,
}

/// Least free shared memory with which a stage is restarted: its connections take this before it can wait for more.
pub(crate) const RESTART_BYTES: u64 = 4_000_000;

fn judge(needs: &Needs, limits: &Limits) -> Result<()> {
    let items = [
        limits.descriptors.map(|have| Item {
            what: "open files of a process",
            have,
            need: descriptors(needs),
            is_bytes: false,
            cure: "raise it with ulimit -n, LimitNOFILE= of a service, or --ulimit nofile= of a container",
        }),
        Some(Item {
            what: "room in /dev/shm",
            have: limits.shared_free,
            need: needs.shared_bytes + RESTART_BYTES,
            is_bytes: true,
            cure: "enlarge it with mount -o remount,size=... /dev/shm, or --shm-size= of a container",
        }),
        limits.memory_free.map(|have| Item {
            what: "memory",
            have,
            need: memory(needs),
            is_bytes: true,
            cure: "end other programs that use it, or raise the limit of the container or service",
        }),
    ];
    let short: Vec<Item> = items.into_iter().flatten().filter(|item| item.have < item.need).collect();
    if short.is_empty() {
        return Ok(());
    }
    let line = counted(needs.stations, "station", "stations");
    let mut text = format!("a line of {line} has too few resources here");
    for Item { what, have, need, is_bytes, cure } in short {
        let written = match is_bytes {
            true => write!(text, "; {what}: {:.1} MB of {:.1} MB needed", have as f64 / 1e6, need as f64 / 1e6),
            false => write!(text, "; {what}: {have} of {need} needed"),
        };
        written.and_then(|()| write!(text, " ({cure})"))?;
    }
    bail!("{text}; docs/operating.md says how many stations a host supports")
}

fn descriptors(needs: &Needs) -> u64 {
    DESCRIPTORS_FIXED
        + DESCRIPTORS_PER_PROCESS * needs.acquire_processes as u64
        + DESCRIPTORS_PER_STATION * needs.stations as u64
}

fn memory(needs: &Needs) -> u64 {
    needs.shared_bytes + MEMORY_PER_PROCESS * (needs.acquire_processes as u64 + OTHER_PROCESSES)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEEDS: Needs = Needs { stations: 32, acquire_processes: 32, shared_bytes: 400_000_000 };
    const PLENTY: Limits = Limits { descriptors: None, shared_free: u64::MAX, memory_free: None };

    fn refusal(limits: &Limits) -> String {
        judge(&NEEDS, limits).unwrap_err().to_string()
    }

    #[test]
    fn what_suffices_passes_to_the_last_of_it() {
        judge(&NEEDS, &PLENTY).unwrap();
        let just = Limits {
            descriptors: Some(descriptors(&NEEDS)),
            shared_free: NEEDS.shared_bytes + RESTART_BYTES,
            memory_free: Some(memory(&NEEDS)),
        };
        judge(&NEEDS, &just).unwrap();
        let text = refusal(&Limits { descriptors: Some(descriptors(&NEEDS) - 1), ..just });
        assert!(
            text.starts_with("a line of 32 stations has too few resources here; open files of a process: "),
            "{text}"
        );
    }

    #[test]
    fn everything_that_is_too_little_is_reported_at_once() {
        let text = refusal(&Limits { descriptors: Some(300), shared_free: 104_000_000, ..PLENTY });
        assert!(text.contains("open files of a process: 300 of ") && text.contains("ulimit -n"), "{text}");
        assert!(text.contains("/dev/shm: 104.0 MB of 404.0 MB needed"), "{text}");
        let text = refusal(&Limits { memory_free: Some(MEMORY_PER_PROCESS), ..PLENTY });
        assert!(text.contains("; memory: 25.2 MB of ") && !text.contains("/dev/shm"), "{text}");
    }

    #[test]
    fn the_limit_of_open_files_is_raised_as_far_as_it_goes() {
        check(&Needs { stations: 1, acquire_processes: 1, shared_bytes: 1 }).unwrap();
        let limit = getrlimit(Resource::Nofile);
        assert_eq!(limit.current, limit.maximum);
        assert!(memory_available().is_none_or(|bytes| bytes > 0));
    }
}
