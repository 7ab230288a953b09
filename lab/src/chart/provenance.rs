//! Where the numbers of a chart or a bench are from: processor, program and commit.

use std::process::Command;

/// The machine and the program, and when and how it measured.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provenance {
    pub(crate) facts: Vec<Fact>,
}

/// What is known of an origin.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Fact {
    /// Its column in the table of points; empty if that does not have it.
    pub column: &'static str,
    /// Its name for people.
    pub name: &'static str,
    pub value: String,
}

impl Provenance {
    /// Of this machine and this program.
    pub fn here(seed: u64, is_quick: bool) -> Self {
        let build = format!(
            "{}, {}-{}, compiled for {}",
            if cfg!(debug_assertions) { "debug" } else { "release" },
            std::env::consts::ARCH,
            std::env::consts::OS,
            if cfg!(target_feature = "avx512f") {
                "AVX-512"
            } else if cfg!(target_feature = "avx2") {
                "AVX2"
            } else {
                "the baseline of the architecture"
            },
        );
        let unknown = || "unknown".to_owned();
        let facts = [
            ("cpu", "processors", cpu()),
            // Those that decide on kernels.
            ("vectors", "vector instructions", vectors()),
            ("system", "system", output("uname", &["-sr"]).unwrap_or_else(unknown)),
            ("build", "build", build),
            // Followed by `+` if files have changed since.
            ("commit", "commit", commit()),
            ("version", "version", env!("CARGO_PKG_VERSION").to_owned()),
            // UTC.
            ("date", "date", output("date", &["-u", "+%Y-%m-%d"]).unwrap_or_else(unknown)),
            ("", "first seed", seed.to_string()),
            ("", "effort", if is_quick { "quick: a little of everything" } else { "full" }.to_owned()),
        ];
        Self { facts: facts.map(|(column, name, value)| Fact { column, name, value }).into() }
    }

    /// What the table of points has in `column`: cpu, vectors, system, build, commit, version or date.
    pub fn get(&self, column: &str) -> &str {
        self.facts.iter().find(|fact| fact.column == column).map_or("unknown", |fact| &fact.value)
    }
}

/// Model and number of processors.
fn cpu() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let value = |name: &str| {
        let line = text.lines().find(|line| line.starts_with(name))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    let count = std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get);
    format!("{count} x {}", value("model name").unwrap_or_else(|| "unknown processor".to_owned()))
}

/// The instructions, among those that decide on kernels at run time.
fn vectors() -> String {
    #[cfg(target_arch = "x86_64")]
    let known = [
        ("AVX2", std::arch::is_x86_feature_detected!("avx2")),
        ("FMA", std::arch::is_x86_feature_detected!("fma")),
        ("AVX-512F", std::arch::is_x86_feature_detected!("avx512f")),
        ("AVX-512BW", std::arch::is_x86_feature_detected!("avx512bw")),
        ("AVX-512 VNNI", std::arch::is_x86_feature_detected!("avx512vnni")),
        ("GFNI", std::arch::is_x86_feature_detected!("gfni")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let known = [("none that is asked for", true)];
    let has: Vec<&str> = known.into_iter().filter(|(_, has)| *has).map(|(name, _)| name).collect();
    has.join(", ")
}

/// The commit of the working tree, or that there is none.
fn commit() -> String {
    let Some(commit) = output("git", &["rev-parse", "--short=12", "HEAD"]) else { return "unknown".to_owned() };
    // Files that the chart itself writes are no change of the program.
    let changed = output("git", &["status", "--porcelain", "--untracked-files=no", "--", ".", ":(exclude,top)docs"]);
    if changed.is_some_and(|changed| !changed.is_empty()) { format!("{commit}+") } else { commit }
}

/// What a program prints, without white space at its ends; `None` where it cannot run or fails.
pub fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let out = Command::new(program).args(arguments).output().ok().filter(|out| out.status.success())?;
    Some(String::from_utf8_lossy(&out.stdout).trim().to_owned())
}
