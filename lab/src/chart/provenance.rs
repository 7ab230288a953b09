//! Where the numbers of a chart or a bench are from: processor, program and commit.

use std::process::Command;

/// The machine and the program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provenance {
    /// Model and number of the processors.
    pub cpu: String,
    /// Vector instructions that decide on kernels.
    pub vectors: String,
    /// Kernel of the system.
    pub system: String,
    /// Profile, target and instructions that the compiler could use.
    pub build: String,
    /// Commit, followed by `+` if files have changed since.
    pub commit: String,
    /// Version of the program.
    pub version: &'static str,
    /// When it was measured, UTC.
    pub date: String,
    /// First seed.
    pub seed: u64,
    /// Whether only a little was measured.
    pub is_quick: bool,
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
        Self {
            cpu: cpu(),
            vectors: vectors(),
            system: output("uname", &["-sr"]).unwrap_or_else(|| "unknown".to_owned()),
            build,
            commit: commit(),
            version: env!("CARGO_PKG_VERSION"),
            date: output("date", &["-u", "+%Y-%m-%d"]).unwrap_or_else(|| "unknown".to_owned()),
            seed,
            is_quick,
        }
    }
}

impl Provenance {
    /// Each of them with a name for people.
    pub(crate) fn rows(&self) -> Vec<(&'static str, String)> {
        let effort = if self.is_quick { "quick: a little of everything" } else { "full" };
        vec![
            ("processors", self.cpu.clone()),
            ("vector instructions", self.vectors.clone()),
            ("system", self.system.clone()),
            ("build", self.build.clone()),
            ("commit", self.commit.clone()),
            ("version", self.version.to_owned()),
            ("date", self.date.clone()),
            ("first seed", self.seed.to_string()),
            ("effort", effort.to_owned()),
        ]
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
