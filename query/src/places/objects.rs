//! Objects under the keys of a bucket, through the crate `object_store`, as in S3.
//!
//! Server, keys and region come from the variables `AWS_...`.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, Result, bail, ensure};
use futures_util::TryStreamExt as _;
use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey, Checksum};
use object_store::path::Path as ObjectPath;
use object_store::{
    BackoffConfig, ClientConfigKey, Error, GetOptions, GetRange, ObjectStore as _, ObjectStoreExt as _, PutMode,
    PutOptions, PutPayload, RetryConfig,
};
use tokio::io::AsyncWriteExt as _;

use super::place::Key;

/// Bytes that are asked for at a time.
const PART_BYTES: u64 = 8 << 20;

/// Longest time for a request that reads, with what is received; and for one that writes, with all of the object.
const READ_MAX: &str = "30 seconds";
const WRITE_MAX: &str = "600 seconds";

/// Attempts after the first, and the pauses between them: some ten seconds in all, where a server refuses at once.
const RETRIES: usize = 7;
const PAUSES: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(5)];

/// Most bytes of an object that is put: S3 takes no more in one request, and only one request can refuse to overwrite.
const BYTES_MAX: u64 = 5 << 30;

/// Buckets that were used, with their connections.
static BUCKETS: Mutex<BTreeMap<String, Arc<Bucket>>> = Mutex::new(BTreeMap::new());

#[derive(Debug)]
struct Bucket {
    read: AmazonS3,
    write: AmazonS3,
}

/// An object of a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Object {
    pub key: String,
    pub modified: SystemTime,
    /// Identifies the object: another one under the same key has another tag.
    pub e_tag: Option<String>,
}

/// Whether an object was put, or one was there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Put {
    Done,
    WasThere,
}

fn bucket(name: &str) -> Result<Arc<Bucket>> {
    let mut buckets = BUCKETS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(there) = buckets.get(name) {
        return Ok(Arc::clone(there));
    }
    let made = Arc::new(Bucket { read: connect(name, READ_MAX)?, write: connect(name, WRITE_MAX)? });
    buckets.insert(name.to_owned(), Arc::clone(&made));
    Ok(made)
}

fn connect(name: &str, timeout: &str) -> Result<AmazonS3> {
    let builder = AmazonS3Builder::from_env();
    let endpoint = builder.get_config_value(&AmazonS3ConfigKey::Endpoint).unwrap_or_default();
    let may_be_plain = builder.get_config_value(&AmazonS3ConfigKey::Client(ClientConfigKey::AllowHttp));
    if endpoint.starts_with("http://") && may_be_plain.as_deref() != Some("true") {
        bail!("the connection to {endpoint} is not encrypted: use https://, or set AWS_ALLOW_HTTP=true");
    }
    ensure!(
        endpoint.is_empty() || endpoint.starts_with("http://") || endpoint.starts_with("https://"),
        "AWS_ENDPOINT_URL is {endpoint:?}; it must begin with https://"
    );
    let [first, last] = PAUSES;
    let backoff = BackoffConfig { init_backoff: first, max_backoff: last, ..BackoffConfig::default() };
    let made = builder
        .with_bucket_name(name)
        .with_checksum_algorithm(Checksum::SHA256)
        .with_config(AmazonS3ConfigKey::Client(ClientConfigKey::Timeout), timeout)
        .with_retry(RetryConfig { max_retries: RETRIES, backoff, ..RetryConfig::default() })
        .build();
    made.map_err(said).with_context(|| format!("cannot use the bucket {name}"))
}

/// What the server or the system says, in one line, with what may be missing.
fn said(error: Error) -> anyhow::Error {
    let text = error.to_string();
    let tagged =
        |tag: &str| text.split_once(&format!("<{tag}>"))?.1.split_once('<').map(|(inside, _)| inside.to_owned());
    let why = match (tagged("Code"), tagged("Message")) {
        (Some(code), Some(message)) => format!("{code}: {message}"),
        (Some(code), None) => code,
        _ => {
            let mut cause: &dyn std::error::Error = &error;
            while let Some(next) = cause.source() {
                cause = next;
            }
            cause.to_string()
        }
    };
    match std::env::var_os("AWS_ACCESS_KEY_ID") {
        Some(_) => anyhow::Error::msg(why),
        None => anyhow::Error::msg(format!("{why} (AWS_ACCESS_KEY_ID is not set)")),
    }
}

fn path(key: &Key) -> Result<ObjectPath> {
    ObjectPath::parse(&key.key).with_context(|| format!("{key} is not a valid key"))
}

/// All objects below `keys`, in the order of their keys.
pub(crate) async fn list(keys: &Key) -> Result<Vec<Object>> {
    let (bucket, path) = (bucket(&keys.bucket)?, path(keys)?);
    let objects = bucket.read.list(Some(&path)).map_ok(|object| Object {
        key: object.location.to_string(),
        modified: object.last_modified.into(),
        e_tag: object.e_tag,
    });
    let objects = objects.try_collect().await.map_err(said);
    let mut objects: Vec<_> = objects.with_context(|| format!("cannot read {keys}"))?;
    objects.sort_by(|a, b| a.key.cmp(&b.key));
    Ok(objects)
}

/// Length of an object, and its last `bytes`; `None` if it is not there.
pub(crate) async fn end_of(key: &Key, bytes: u64) -> Result<Option<(u64, Vec<u8>)>> {
    let (bucket, path) = (bucket(&key.bucket)?, path(key)?);
    let Some(meta) = there(key, bucket.read.head(&path).await)? else { return Ok(None) };
    if meta.size == 0 {
        return Ok(Some((0, Vec::new())));
    }
    let range = meta.size.saturating_sub(bytes)..meta.size;
    Ok(there(key, bucket.read.get_range(&path, range).await)?.map(|last| (meta.size, last.to_vec())))
}

/// Turns an object that is not there into `None`.
fn there<T>(key: &Key, read: Result<T, Error>) -> Result<Option<T>> {
    match read {
        Err(Error::NotFound { .. }) => Ok(None),
        read => read.map(Some).map_err(said).with_context(|| format!("cannot read {key}")),
    }
}

/// All of a small object; `None` if it is not there.
pub(crate) async fn read(key: &Key) -> Result<Option<Vec<u8>>> {
    let (bucket, path) = (bucket(&key.bucket)?, path(key)?);
    let Some(got) = there(key, bucket.read.get(&path).await)? else { return Ok(None) };
    Ok(there(key, got.bytes().await)?.map(|bytes| bytes.to_vec()))
}

/// Writes an object into the new file `to`, if it is still the one with `e_tag`; else `Err` with the reason.
///
/// # Errors
/// It cannot be read now, or the file cannot be written.
pub(crate) async fn fetch(key: &Key, e_tag: Option<&str>, to: &Path) -> Result<Result<(), String>> {
    let (bucket, path) = (bucket(&key.bucket)?, path(key)?);
    let Some(meta) = there(key, bucket.read.head(&path).await)? else { return Ok(Err(format!("{key} is gone"))) };
    let cannot_write = || format!("cannot write {}", to.display());
    let mut file = tokio::fs::File::create_new(to).await.with_context(cannot_write)?;
    let e_tag = e_tag.map(str::to_owned).or(meta.e_tag);
    let mut at = 0;
    while at < meta.size {
        let range = GetRange::Bounded(at..meta.size.min(at + PART_BYTES));
        let options = GetOptions { range: Some(range), if_match: e_tag.clone(), ..GetOptions::default() };
        let part = async { bucket.read.get_opts(&path, options).await?.bytes().await };
        let part = match part.await {
            Err(Error::Precondition { .. }) => return Ok(Err(format!("{key} was replaced by another object"))),
            Err(Error::NotFound { .. }) => return Ok(Err(format!("{key} is gone"))),
            part => part.map_err(said).with_context(|| format!("cannot read {key}"))?,
        };
        if part.is_empty() {
            bail!("{key} ends at byte {at} of {}", meta.size);
        }
        file.write_all(&part).await.with_context(cannot_write)?;
        at += part.len() as u64;
    }
    file.flush().await.with_context(cannot_write)?;
    Ok(Ok(()))
}

/// Puts the file `from` under `key`, in place of another or, with `is_new`, only if none is there. The server checks its SHA-256.
///
/// # Errors
/// The file cannot be read or has too many bytes, or the server refuses it.
pub(crate) async fn put(from: &Path, key: &Key, is_new: bool) -> Result<Put> {
    let context = || format!("cannot read {}", from.display());
    let bytes = tokio::fs::metadata(from).await.with_context(context)?.len();
    if bytes > BYTES_MAX {
        bail!("{} has {bytes} bytes; an object may have at most {BYTES_MAX}", from.display());
    }
    put_bytes(tokio::fs::read(from).await.with_context(context)?, key, is_new).await
}

/// Puts `bytes` under `key`, as [`put`] does.
pub(crate) async fn put_bytes(bytes: Vec<u8>, key: &Key, is_new: bool) -> Result<Put> {
    let mode = if is_new { PutMode::Create } else { PutMode::Overwrite };
    let options = PutOptions { mode, ..PutOptions::default() };
    match bucket(&key.bucket)?.write.put_opts(&path(key)?, PutPayload::from(bytes), options).await {
        Ok(_) => Ok(Put::Done),
        Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) if is_new => Ok(Put::WasThere),
        Err(error) => Err(said(error)).with_context(|| format!("cannot write {key}")),
    }
}
