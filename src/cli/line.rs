//! Options of `tapline run`, `line` and `status`, and of the stages that they start.

#[cfg(feature = "serve")]
use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

#[derive(Debug, Default, Args)]
pub(crate) struct SourceArgs {
    /// Configuration file (TOML); defaults hold for what it leaves out.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Folder of recorded taps (a tap set) to scan instead of simulated tyres.
    #[arg(long)]
    pub taps: Option<PathBuf>,
    /// Folder for the results, one file per casing; if left out, `simulated` or the name of the tap set, in this folder.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// What shoulders are compared with; needed here or in the configuration: a reference file (`tapline reference` makes one),
    /// TYRE/SHOULDER of the casing itself, or `self`: each casing with itself, where damage all round does not show.
    #[arg(long, value_name = "FILE.json|TYRE/SHOULDER|self")]
    pub reference: Option<String>,
    /// Number of stations: simulated ones, or those that share the shoulders of a tap set.
    #[arg(long)]
    pub stations: Option<u16>,
}

#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub source: SourceArgs,
    /// Print verdicts, and the summary at the end, as lines of JSON.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct LineArgs {
    /// Configuration file (TOML) with the stations.
    #[arg(long)]
    pub config: PathBuf,
    /// Folder for the results: one folder per day, one file per casing; created if it does not exist.
    #[arg(long)]
    pub out: PathBuf,
    /// What shoulders are compared with; needed here or in the configuration: a reference file (`tapline reference` makes one), or
    /// `self`: each casing with itself, where damage all round does not show.
    #[arg(long, value_name = "FILE.json|self")]
    pub reference: Option<String>,
    /// Print verdicts as lines of JSON.
    #[arg(long)]
    pub json: bool,
    /// End after this many casings.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub casings: Option<u32>,
    /// Serve a page of the running line, /metrics and /healthz over HTTP at this address.
    #[cfg(feature = "serve")]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    pub serve: Option<SocketAddr>,
    /// File with the token that viewers of the page must have; needed for an address that other machines can reach.
    #[cfg(feature = "serve")]
    #[arg(long, value_name = "FILE", requires = "serve")]
    pub serve_token_file: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// Folder that the line writes its results to.
    #[arg(long)]
    pub out: PathBuf,
    /// Keep showing it until the line ends.
    #[arg(long)]
    pub follow: bool,
    /// Print it as a line of JSON.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StageArgs {
    /// Which: store, fuse, process, or acquire-NUMBER.
    pub stage: String,
    /// Private folder of the line.
    #[arg(long)]
    pub line: PathBuf,
    /// Number of the process that started this one, with which it ends.
    #[arg(long)]
    pub child: i32,
}

#[cfg(feature = "serve")]
fn address(text: &str) -> Result<SocketAddr, &'static str> {
    text.parse().ok().ok_or("must be an IP address with a port, as 127.0.0.1:8088, not the name of a host")
}
