//! Where the server is, and what a connection to it needs.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, Result, bail, ensure};
use async_nats::{ConnectOptions, ServerAddr};
use tapline_host::connection::{User, is_this_machine, read_credentials};

/// How long it may take to connect.
const CONNECT_WITHIN: Duration = Duration::from_secs(5);

/// How long the server may take to answer or to acknowledge.
pub(crate) const ANSWER_WITHIN: Duration = Duration::from_secs(10);

/// How a credentials file of NATS begins.
const NATS_CREDENTIALS: &str = "-----BEGIN NATS";

/// Where the server is, and with what a connection is made.
#[derive(Debug, Clone, Default)]
pub struct Access {
    /// `nats://HOST:PORT` or `tls://HOST:PORT`; servers of a cluster are separated by commas.
    pub servers: String,
    /// Certificates (PEM) of the server's authority; with it the connection is encrypted.
    pub ca_file: Option<PathBuf>,
    /// A `.creds` file of NATS, or a file with a user's name and password, a line each.
    pub credentials_file: Option<PathBuf>,
    /// Whether the connection may leave this machine without encryption.
    pub allows_plain: bool,
}

/// A server to which a connection can be made, with everything that it needs from files.
#[derive(Clone)]
pub struct Server {
    servers: Vec<ServerAddr>,
    ca_file: Option<PathBuf>,
    credentials: Option<Credentials>,
    is_encrypted: bool,
}

#[derive(Clone)]
enum Credentials {
    /// The text of a `.creds` file.
    Nats(String),
    User(User),
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("servers", &self.servers).finish_non_exhaustive()
    }
}

impl Server {
    /// Reads what `access` names, and checks it.
    ///
    /// # Errors
    /// An invalid address, files that cannot be read or that others can read, and a connection that would leave this
    /// machine without encryption.
    pub fn new(access: &Access) -> Result<Self> {
        let servers: Vec<ServerAddr> = access.servers.split(',').map(address).collect::<Result<_>>()?;
        let tls_count = servers.iter().filter(|server| server.tls_required()).count();
        ensure!(tls_count == 0 || tls_count == servers.len(), "{}: some are tls:// and some are not", access.servers);
        let is_encrypted = access.ca_file.is_some() || tls_count > 0;
        if let Some(open) = servers.iter().find(|server| !is_this_machine(server.host()))
            && !is_encrypted
            && !access.allows_plain
        {
            bail!(
                "{}: what is sent leaves this machine, unencrypted: give tls://{} or --ca-file FILE for TLS, or --allow-plain",
                shown(open),
                host_and_port(open)
            );
        }
        if let Some(file) = &access.ca_file {
            fs::File::open(file).with_context(|| format!("cannot read the certificates in {}", file.display()))?;
        }
        let credentials = access.credentials_file.as_deref().map(Credentials::read).transpose()?;
        Ok(Self { servers, ca_file: access.ca_file.clone(), credentials, is_encrypted })
    }

    /// The server's addresses, without what is secret in them.
    pub(crate) fn shown(&self) -> String {
        self.servers.iter().map(shown).collect::<Vec<_>>().join(",")
    }

    /// Connects as `name`.
    pub(crate) async fn connect(&self, name: &str) -> Result<async_nats::Client> {
        let mut options = ConnectOptions::new()
            .name(name)
            .connection_timeout(CONNECT_WITHIN)
            .request_timeout(Some(ANSWER_WITHIN))
            .require_tls(self.is_encrypted);
        if let Some(file) = &self.ca_file {
            options = options.add_root_certificates(file.clone());
        }
        options = match &self.credentials {
            Some(Credentials::Nats(text)) => options.credentials(text).context("the credentials cannot be used")?,
            Some(Credentials::User(User { name, password })) => {
                options.user_and_password(name.clone(), password.clone())
            }
            None => options,
        };
        options.connect(&self.servers).await.with_context(|| format!("no connection to {}", self.shown()))
    }
}

impl Credentials {
    fn read(file: &Path) -> Result<Self> {
        let text = read_credentials(file)?;
        if text.contains(NATS_CREDENTIALS) {
            return Ok(Self::Nats(text));
        }
        Ok(Self::User(User::in_text(&text, file).context("not a .creds file of NATS")?))
    }
}

fn address(text: &str) -> Result<ServerAddr> {
    let expected = || format!("{text:?} is not an address of a server: must be nats://HOST:PORT or tls://HOST:PORT");
    let server: ServerAddr = text.trim().parse().ok().with_context(expected)?;
    ensure!(["nats", "tls"].contains(&server.scheme()) && !server.host().is_empty(), expected());
    ensure!(
        server.username().is_none() && server.password().is_none(),
        "{}: a password in an address can be seen by others: give --credentials-file FILE",
        shown(&server)
    );
    Ok(server)
}

fn shown(server: &ServerAddr) -> String {
    format!("{}://{}", server.scheme(), host_and_port(server))
}

/// An IPv6 address is put in brackets.
fn host_and_port(server: &ServerAddr) -> String {
    let (host, port) = (server.host(), server.port());
    if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn outcome(access: &Access) -> String {
        Server::new(access).map_or_else(|error| format!("{error:#}"), |server| server.shown())
    }

    /// Catches an unencrypted connection that nobody asked for, and an address that hides a password.
    #[test]
    fn a_connection_that_leaves_the_machine_is_encrypted() {
        let at = |servers: &str| Access { servers: servers.to_owned(), ..Access::default() };
        for (servers, expected) in [
            ("127.0.0.1:4222", "nats://127.0.0.1:4222"),
            ("nats://localhost:1,nats://[::1]:2", "nats://localhost:1,nats://[::1]:2"),
            ("tls://centre:4222", "tls://centre:4222"),
            ("nats://centre:4222", "nats://centre:4222: what is sent leaves this machine, unencrypted"),
            ("nats://127.0.0.1:1,nats://10.0.0.1:2", "nats://10.0.0.1:2: what is sent leaves"),
            ("tls://a:1,nats://127.0.0.1:2", "some are tls:// and some are not"),
            ("http://centre", "not an address of a server"),
            ("", "not an address of a server"),
            ("nats://me:secret@127.0.0.1:1", "a password in an address"),
        ] {
            let outcome = outcome(&at(servers));
            assert!(outcome.contains(expected) && !outcome.contains("secret"), "{servers}: {outcome}");
        }
        let plain = Access { allows_plain: true, ..at("nats://centre:4222") };
        assert_eq!(outcome(&plain), "nats://centre:4222");
        let no_file = Access { ca_file: Some("/nowhere/ca.pem".into()), ..at("nats://centre:4222") };
        assert!(outcome(&no_file).contains("/nowhere/ca.pem"));
    }

    /// Catches credentials of NATS that are taken for a user's, and the reverse.
    #[test]
    fn both_kinds_of_credentials_are_known() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("user");
        let read = |text: &str| {
            fs::write(&file, text).unwrap();
            fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
            let credentials_file = Some(file.clone());
            outcome(&Access { servers: "127.0.0.1:1".into(), credentials_file, ..Access::default() })
        };
        assert_eq!(read("line\nsecret\n"), "nats://127.0.0.1:1");
        assert_eq!(read("-----BEGIN NATS USER JWT-----\nx\n"), "nats://127.0.0.1:1");
        let said = read("line\n");
        assert!(said.contains(".creds") && said.contains("1 lines"), "{said}");
    }
}
