//! Verdicts to OPC UA clients, in the shape of OPC 40001-101 (Machinery Result Transfer).
//!
//! - here: the server, and its life
//! - `methods`: what clients call: results, and acknowledging them
//! - `nodes`, `names`: the address space
//! - `result`: a verdict as a result, and as an event

mod methods;
mod names;
mod nodes;
mod result;

use std::fs::{self, DirBuilder};
use std::net::SocketAddr;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use anyhow::{Context as _, Result, anyhow, ensure};
use jiff::Timestamp;
use jiff::tz::TimeZone;
use opcua::crypto::CertificateStore;
use opcua::nodes::Event;
use opcua::server::diagnostics::NamespaceMetadata;
use opcua::server::node_manager::memory::{SimpleNodeManager, simple_node_manager};
use opcua::server::{ANONYMOUS_USER_TOKEN_ID, Server, ServerBuilder, ServerEndpoint, ServerHandle, ServerUserToken};
use opcua::types::{DataValue, StatusCode, Variant};
use tapline_host::connection::{User, listen};
use tapline_wire::now_ns;

use crate::config::wires::OpcUaConfig;
use crate::shown::verdict::CasingVerdict;
use crate::wires::now::StationState;
use crate::wires::opcua::names::{LINE_NAMESPACE, Namespaces, RESULT_NAMESPACE};
use crate::wires::opcua::result::{ResultReady, evaluation, result};
use crate::wires::outbox::Receiver;
use crate::wires::wire::{News, Plant, Wire};

/// Most clients at once.
const SESSIONS_MAX: usize = 16;

/// How long a client may take to send its first message, in seconds.
const HELLO_WITHIN_S: u32 = 5;

/// The line's certificate and its key, in the folder of certificates.
const CERTIFICATE: &str = "own/cert.der";
const KEY: &str = "private/private.pem";

/// Where the server keeps certificates of refused clients, in the folder of certificates, and most of them: anyone who reaches the port
/// can send one.
const REJECTED: &str = "rejected";
const REJECTED_MAX: usize = 50;

/// How long before its end the line warns of it, in seconds. Clients are still served, so it is no trouble.
const ENDS_SOON_S: i64 = 30 * 86_400;

/// Names of the node managers.
const TYPES: &str = "types";
const LINE: &str = "line";

/// The user of the configuration, among the server's tokens.
const USER: &str = "user";

/// A server that is set up but not yet running.
struct Prepared {
    server: Server,
    handle: ServerHandle,
    namespaces: Namespaces,
}

/// The name and password that clients must have, where `config` names a file of them.
pub(super) fn user(config: &OpcUaConfig) -> Result<Option<User>> {
    config.credentials_file.as_deref().map(User::read).transpose().context("line.opcua.credentials_file")
}

/// Starts to serve the verdicts of `plant`; also returns where.
pub(super) fn start(config: &OpcUaConfig, plant: &Plant) -> Result<(Wire, String)> {
    let context = || format!("line.opcua.listen = \"{}\": cannot listen there", config.listen);
    let listener = listen(config.listen).with_context(context)?;
    let address = listener.local_addr().with_context(context)?;
    let user = user(config)?;
    // The server makes a folder for certificates even without any.
    let scratch = tempfile::tempdir().context("cannot make a folder for the OPC UA server")?;
    let builder = builder(address, config.pki_folder.as_deref(), user, scratch.path())?;
    let wire = Wire::start(Receiver::OpcUa, plant, || {
        let (prepared, plant) = (prepare(builder, plant)?, plant.clone());
        let pki = config.pki_folder.as_ref().map(|pki| anyhow::Ok((pki.clone(), certificate_end_s(pki)?)));
        let pki = pki.transpose()?;
        Ok(move |news| async move {
            let _until_the_end = scratch;
            serve(listener, prepared, pki, plant, news).await
        })
    })?;
    Ok((wire, format!("opc.tcp://{address}")))
}

/// The server's options.
fn builder(address: SocketAddr, pki: Option<&Path>, user: Option<User>, scratch: &Path) -> Result<ServerBuilder> {
    let mut builder = ServerBuilder::new()
        .application_name("tapline")
        .application_uri("urn:tapline:line:server")
        .product_uri("urn:tapline")
        .host(address.ip().to_string())
        .port(address.port())
        .discovery_urls(vec!["/".to_owned()])
        .hello_timeout(HELLO_WITHIN_S)
        .max_sessions(SESSIONS_MAX)
        .trust_client_certs(false)
        .diagnostics_enabled(false)
        .with_node_manager(simple_node_manager(namespace(RESULT_NAMESPACE), TYPES))
        .with_node_manager(simple_node_manager(namespace(LINE_NAMESPACE), LINE));
    let token = match user {
        Some(User { name, password }) => {
            builder = builder.add_user_token(USER, ServerUserToken::user_pass(name, password));
            USER.to_owned()
        }
        None => ANONYMOUS_USER_TOKEN_ID.to_owned(),
    };
    let endpoint = match pki {
        Some(folder) => {
            // Only its user may read the key.
            let private = folder.join("private");
            let made = DirBuilder::new().recursive(true).mode(0o700).create(&private);
            if private.metadata().is_ok_and(|there| there.mode() & 0o077 != 0) {
                tracing::warn!("{}: others than its user may look into it; chmod 700 it", private.display());
            }
            made.with_context(|| format!("line.opcua.pki_folder = \"{}\": cannot make it", folder.display()))?;
            builder = builder.pki_dir(folder).create_sample_keypair(true);
            builder = builder.certificate_path(CERTIFICATE).private_key_path(KEY);
            ServerEndpoint::new_basic256sha256_sign_encrypt("/", &[token])
        }
        None => {
            builder = builder.pki_dir(scratch);
            ServerEndpoint::new_none("/", &[token])
        }
    };
    Ok(builder.add_endpoint("line", endpoint))
}

/// When the line's certificate in `folder` ends, in seconds since the Unix epoch. Without its key it would serve nobody.
fn certificate_end_s(folder: &Path) -> Result<i64> {
    let (path, key) = (folder.join(CERTIFICATE), folder.join(KEY));
    let context = || format!("line.opcua.pki_folder: {} is no certificate", path.display());
    let certificate = CertificateStore::read_cert(&path).map_err(|error| anyhow!(error)).with_context(context)?;
    ensure!(
        key.is_file(),
        "line.opcua.pki_folder: {} has no key, {}: put the key back, or remove the certificate, and the next start makes others",
        path.display(),
        key.display()
    );
    Ok(certificate.not_after().with_context(context)?.timestamp())
}

/// Removes all but the last [`REJECTED_MAX`] certificates of refused clients in `folder`.
fn forget_rejected(folder: &Path) {
    let there = fs::read_dir(folder.join(REJECTED)).into_iter().flatten().flatten();
    let mut all: Vec<(SystemTime, PathBuf)> =
        there.filter_map(|entry| Some((entry.metadata().ok()?.modified().ok()?, entry.path()))).collect();
    all.sort_unstable();
    let old = all.len().saturating_sub(REJECTED_MAX);
    for (_, path) in &all[..old] {
        if let Err(error) = fs::remove_file(path) {
            tracing::warn!("cannot remove the certificate of a refused client, {}: {error}", path.display());
        }
    }
}

/// The warning, at `now_s`, of a certificate that ends at `end_s`; `None` if that is far off.
fn certificate_warning(end_s: i64, now_s: i64) -> Option<String> {
    let end = Timestamp::from_second(end_s).ok().filter(|_| end_s - now_s < ENDS_SOON_S)?;
    let day = end.to_zoned(TimeZone::system()).date();
    Some(format!(
        "opcua: the line's certificate ends on {day}, and clients may refuse it then: remove {CERTIFICATE} and {KEY}, and the next start \
         of the line makes others"
    ))
}

fn namespace(uri: &str) -> NamespaceMetadata {
    NamespaceMetadata { namespace_uri: uri.to_owned(), ..NamespaceMetadata::default() }
}

/// Sets the server up.
fn prepare(builder: ServerBuilder, plant: &Plant) -> Result<Prepared> {
    let (server, handle) = builder.build().map_err(|error| anyhow!("the server cannot be set up: {error}"))?;
    let index = |uri: &str| handle.get_namespace_index(uri).context("a namespace is missing");
    let namespaces = Namespaces { result: index(RESULT_NAMESPACE)?, line: index(LINE_NAMESPACE)? };
    let manager =
        |name| handle.node_managers().get_by_name::<SimpleNodeManager>(name).context("a node manager is missing");
    let (types, line) = (manager(TYPES)?, manager(LINE)?);
    nodes::add_types(&mut *types.address_space().write(), namespaces);
    nodes::add_line(&mut *line.address_space().write(), namespaces, &plant.stations);
    for &station in plant.stations.iter() {
        show(&line, namespaces, plant, station);
    }
    methods::add(&line, namespaces, plant);
    Ok(Prepared { server, handle, namespaces })
}

/// Lets clients read the current state of `station`.
fn show(line: &SimpleNodeManager, namespaces: Namespaces, plant: &Plant, station: u16) {
    let read = |name: &str, value: fn(&StationState, u64) -> Result<Variant, StatusCode>| {
        let now = Arc::clone(&plant.now);
        line.inner().add_read_callback(namespaces.of_station(station, name), move |_, _, _| {
            let (station_state, judged_count) = now.at(station);
            if station_state == StationState::NoSignal {
                return Err(StatusCode::BadNoCommunication);
            }
            value(&station_state, judged_count).map(DataValue::new_now)
        });
    };
    read("State", |station_state, _| Ok(station_state.name().into()));
    read("ResultEvaluation", |station_state, _| {
        Ok(match station_state {
            StationState::Judged(verdict) => evaluation(verdict.verdict),
            _ => 0,
        }
        .into())
    });
    read("JudgedCount", |_, judged_count| Ok(judged_count.into()));
    read("Result", |station_state, _| match station_state {
        StationState::Judged(verdict) => Ok(result(verdict)),
        _ => Err(StatusCode::BadNoData),
    });
}

/// Serves clients until the wire ends.
async fn serve(
    listener: std::net::TcpListener,
    prepared: Prepared,
    pki: Option<(PathBuf, i64)>,
    plant: Plant,
    mut news: News,
) -> Result<()> {
    let Prepared { server, handle, namespaces } = prepared;
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let mut ended = news.clone();
    let run = server.run_with(listener);
    tokio::pin!(run);
    let publish = async {
        let (mut count, mut has_warned) = (plant.outbox.count(), false);
        while news.next().await {
            if let Some((folder, end_s)) = &pki {
                forget_rejected(folder);
                let warning = certificate_warning(*end_s, now_ns() / 1_000_000_000);
                if let Some(warning) = warning.filter(|_| !has_warned) {
                    has_warned = true;
                    tracing::warn!("{warning}");
                    plant.outbox.alarm(warning);
                }
            }
            for (number, note) in plant.outbox.newer(Receiver::OpcUa, count) {
                count = number;
                if let Some(verdict) = plant.outbox.read(&note) {
                    notify(&handle, namespaces, &verdict);
                }
            }
        }
    };
    tokio::select! {
        ran = &mut run => return ran.map_err(|error| anyhow!("the server has ended: {error}")),
        () = publish => {}
        () = ended.ended() => {}
    }
    handle.cancel();
    drop(tokio::time::timeout(super::wire::END_WITHIN, run).await);
    Ok(())
}

/// Sends clients that have subscribed to it the event that a verdict is ready.
fn notify(handle: &ServerHandle, namespaces: Namespaces, verdict: &CasingVerdict) {
    let source = nodes::management(namespaces);
    let event = ResultReady::new(verdict, namespaces.of_line("casing-judged"), &source, namespaces.result);
    // Clients that have subscribed to the events of the whole server get it too.
    handle.subscriptions().notify_events(std::iter::once((&event as &dyn Event, &source)));
}

#[cfg(test)]
mod tests {
    use opcua::crypto::X509Data;

    use super::*;

    /// Catches a certificate that ends without a warning: clients then refuse the line.
    #[test]
    fn the_end_of_a_certificate_is_announced_a_month_before() {
        let folder = tempfile::tempdir().unwrap();
        let (certificate, key) = (folder.path().join(CERTIFICATE), folder.path().join(KEY));
        CertificateStore::create_certificate_and_key(&X509Data::sample_cert(), false, &certificate, &key).unwrap();
        let end_s = certificate_end_s(folder.path()).unwrap();
        assert_eq!(certificate_warning(end_s, now_ns() / 1_000_000_000), None, "it has just been made");
        assert_eq!(certificate_warning(end_s, end_s - ENDS_SOON_S), None);
        let warning = certificate_warning(end_s, end_s - ENDS_SOON_S + 1).unwrap();
        assert!(warning.contains("the line's certificate ends on 20"), "{warning}");
        assert!(certificate_warning(end_s, end_s + 1).is_some());
        fs::remove_file(&key).unwrap();
        let refused = certificate_end_s(folder.path()).unwrap_err().to_string();
        assert!(refused.contains("own/cert.der has no key, ") && refused.contains("private/private.pem"), "{refused}");
        let refused = certificate_end_s(Path::new("nowhere")).unwrap_err().to_string();
        assert!(refused.contains("nowhere/own/cert.der is no certificate"), "{refused}");
    }

    /// Catches refused clients that fill the disk, and the certificate of the newest, which may be the plant's own, that goes first.
    #[test]
    fn certificates_of_refused_clients_do_not_pile_up() {
        let folder = tempfile::tempdir().unwrap();
        let rejected = folder.path().join(REJECTED);
        fs::create_dir(&rejected).unwrap();
        for number in 0..REJECTED_MAX + 5 {
            let file = fs::File::create(rejected.join(format!("{}.der", 99 - number))).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(number as u64)).unwrap();
        }
        forget_rejected(folder.path());
        let there = fs::read_dir(&rejected).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let there: std::collections::BTreeSet<String> = there.collect();
        assert_eq!(there.len(), REJECTED_MAX);
        assert!(!there.contains("99.der") && there.contains("45.der"), "{there:?}");
    }
}
