//! Options of `tapline uplink` and `tapline collect`.

use std::path::PathBuf;

use clap::Args;
use tapline_uplink::{Access, Site};

/// How a connection to the server is made.
#[derive(Debug, Args)]
pub(crate) struct ServerArgs {
    /// Certificates (PEM) for checking the server; with them the connection is encrypted.
    #[arg(long, value_name = "FILE")]
    pub ca_file: Option<PathBuf>,
    /// A `.creds` file of NATS, or a file with a user's name and password, a line each.
    #[arg(long, value_name = "FILE")]
    pub credentials_file: Option<PathBuf>,
    /// Let the connection leave this machine without encryption.
    #[arg(long)]
    pub allow_plain: bool,
    /// Name of the bucket at the server.
    #[arg(long, default_value = "tapline")]
    pub bucket: String,
}

impl ServerArgs {
    /// What a connection to `servers` needs.
    pub(crate) fn access(&self, servers: &str) -> Access {
        Access {
            servers: servers.to_owned(),
            ca_file: self.ca_file.clone(),
            credentials_file: self.credentials_file.clone(),
            allows_plain: self.allow_plain,
        }
    }
}

#[derive(Debug, Args)]
pub(crate) struct UplinkArgs {
    /// Folder of a line, or of a run.
    pub folder: PathBuf,
    /// The server: nats://HOST:PORT or tls://HOST:PORT, servers of a cluster separated by commas.
    #[arg(long, value_name = "SERVER")]
    pub to: String,
    /// Name of this host at the centre: the folder that its files come into.
    #[arg(long)]
    pub site: Site,
    #[command(flatten)]
    pub server: ServerArgs,
    /// End once a centre has answered for every file now present; code 3 if it refused one or one cannot be read, 1 if there were only
    /// errors for a minute.
    #[arg(long)]
    pub once: bool,
    /// Also send files again that a centre has refused, but none that it has received.
    #[arg(long)]
    pub again: bool,
    /// Print what becomes of each file as a line of JSON.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct CollectArgs {
    /// Folder for the files: a folder for each site; created if it does not exist.
    pub folder: PathBuf,
    /// The server: nats://HOST:PORT or tls://HOST:PORT, servers of a cluster separated by commas.
    #[arg(long, value_name = "SERVER")]
    pub from: String,
    #[command(flatten)]
    pub server: ServerArgs,
    /// End when no file waits; code 3 if one was refused or has no place, 1 if there were only errors for a minute.
    #[arg(long)]
    pub once: bool,
    /// Print what becomes of each file as a line of JSON.
    #[arg(long)]
    pub json: bool,
}
