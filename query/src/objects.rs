//! Objects under the keys of a bucket, by the crate `object_store`, in the way of S3.
//!
//! Servers, keys and regions come from the variables `AWS_...`, as other programs have them.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use anyhow::{Context as _, Result, bail};
use futures_util::TryStreamExt as _;
use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey, Checksum};
use object_store::path::Path as ObjectPath;
use object_store::{
    ClientConfigKey, Error, GetOptions, GetRange, ObjectStore as _, ObjectStoreExt as _, PutMode, PutOptions,
    PutPayload, RetryConfig,
};
use tokio::io::AsyncWriteExt as _;

use crate::place::Key;

/// Bytes that are asked for at a time.
const PART_BYTES: u64 = 8 << 20;

/// Longest time for a request, with what is sent or received.
const REQUEST_MAX: &str = "120 seconds";

/// Attempts after the first, over some 13 seconds.
const RETRIES: usize = 7;

/// Most bytes of an object that is put: S3 takes no more in one request, and only one request can refuse to overwrite.
const BYTES_MAX: u64 = 5 << 30;

/// Buckets that were used, with their connections.
static BUCKETS: Mutex<BTreeMap<String, Arc<AmazonS3>>> = Mutex::new(BTreeMap::new());

/// An object of a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Object {
    pub(crate) key: String,
    pub(crate) modified: SystemTime,
}

/// Whether an object was put, or one was there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Put {
    Done,
    WasThere,
}

fn bucket(name: &str) -> Result<Arc<AmazonS3>> {
    let mut buckets = BUCKETS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(there) = buckets.get(name) {
        return Ok(Arc::clone(there));
    }
    let retry = RetryConfig { max_retries: RETRIES, ..RetryConfig::default() };
    let builder = AmazonS3Builder::from_env();
    let endpoint = builder.get_config_value(&AmazonS3ConfigKey::Endpoint).unwrap_or_default();
    let may_be_plain = builder.get_config_value(&AmazonS3ConfigKey::Client(ClientConfigKey::AllowHttp));
    if endpoint.starts_with("http://") && may_be_plain.as_deref() != Some("true") {
        bail!("the connection to {endpoint} is not encrypted: use https://, or set AWS_ALLOW_HTTP=true");
    }
    let made = builder
        .with_bucket_name(name)
        .with_checksum_algorithm(Checksum::SHA256)
        .with_config(AmazonS3ConfigKey::Client(ClientConfigKey::Timeout), REQUEST_MAX)
        .with_retry(retry)
        .build()
        .with_context(|| format!("cannot use the bucket {name}: set AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION or AWS_ENDPOINT_URL"))?;
    let made = Arc::new(made);
    buckets.insert(name.to_owned(), Arc::clone(&made));
    Ok(made)
}

fn path(key: &Key) -> Result<ObjectPath> {
    ObjectPath::parse(&key.key).with_context(|| format!("{key} cannot be a key"))
}

/// All objects below `keys`, in the order of their keys.
///
/// # Errors
/// A bucket that cannot be used or read.
pub(crate) async fn list(keys: &Key) -> Result<Vec<Object>> {
    let (bucket, path) = (bucket(&keys.bucket)?, path(keys)?);
    let objects = bucket
        .list(Some(&path))
        .map_ok(|object| Object { key: object.location.to_string(), modified: object.last_modified.into() });
    let mut objects: Vec<_> = objects.try_collect().await.with_context(|| format!("cannot read {keys}"))?;
    objects.sort_by(|a, b| a.key.cmp(&b.key));
    Ok(objects)
}

/// Length of an object, and its last `bytes`; `None` if it is not there.
///
/// # Errors
/// It cannot be read.
pub(crate) async fn end_of(key: &Key, bytes: u64) -> Result<Option<(u64, Vec<u8>)>> {
    let options = GetOptions { range: Some(GetRange::Suffix(bytes)), ..GetOptions::default() };
    let read = async {
        let got = bucket(&key.bucket)?.get_opts(&path(key)?, options).await?;
        let length = got.meta.size;
        anyhow::Ok((length, got.bytes().await?.to_vec()))
    };
    there(key, read.await)
}

/// Turns an object that is not there into `None`.
fn there<T>(key: &Key, read: Result<T>) -> Result<Option<T>> {
    match read {
        Err(error) if matches!(error.downcast_ref(), Some(Error::NotFound { .. })) => Ok(None),
        read => read.map(Some).with_context(|| format!("cannot read {key}")),
    }
}

/// All of a small object; `None` if it is not there.
///
/// # Errors
/// It cannot be read.
pub(crate) async fn read(key: &Key) -> Result<Option<Vec<u8>>> {
    let read = async { anyhow::Ok(bucket(&key.bucket)?.get(&path(key)?).await?.bytes().await?.to_vec()) };
    there(key, read.await)
}

/// Writes an object into the new file `to`; `false` if the object is not there.
///
/// # Errors
/// It cannot be read, or is replaced meanwhile, or the file cannot be written.
pub(crate) async fn fetch(key: &Key, to: &Path) -> Result<bool> {
    let (bucket, path) = (bucket(&key.bucket)?, path(key)?);
    let Some(meta) = there(key, bucket.head(&path).await.map_err(Into::into))? else { return Ok(false) };
    let cannot_write = || format!("cannot write {}", to.display());
    let mut file = tokio::fs::File::create_new(to).await.with_context(cannot_write)?;
    let mut at = 0;
    while at < meta.size {
        let range = GetRange::Bounded(at..meta.size.min(at + PART_BYTES));
        // Another object under this key ends it: no file is of two.
        let options = GetOptions { range: Some(range), if_match: meta.e_tag.clone(), ..GetOptions::default() };
        let part = async { bucket.get_opts(&path, options).await?.bytes().await };
        let part = part.await.with_context(|| format!("cannot read {key}"))?;
        if part.is_empty() {
            bail!("{key} ends at byte {at} of {}", meta.size);
        }
        file.write_all(&part).await.with_context(cannot_write)?;
        at += part.len() as u64;
    }
    file.flush().await.with_context(cannot_write)?;
    Ok(true)
}

/// Puts the file `from` under `key`, in place of another or, with `is_new`, only if none is there. The server checks its SHA-256.
///
/// # Errors
/// The file cannot be read or has too many bytes, or the server refuses it.
pub(crate) async fn put(from: &Path, key: &Key, is_new: bool) -> Result<Put> {
    let context = || format!("cannot read {}", from.display());
    let bytes = tokio::fs::metadata(from).await.with_context(context)?.len();
    if bytes > BYTES_MAX {
        bail!("{} has {bytes} bytes; an object may have {BYTES_MAX}", from.display());
    }
    put_bytes(tokio::fs::read(from).await.with_context(context)?, key, is_new).await
}

/// Puts `bytes` under `key`, as [`put`] does.
///
/// # Errors
/// The server refuses them.
pub(crate) async fn put_bytes(bytes: Vec<u8>, key: &Key, is_new: bool) -> Result<Put> {
    let mode = if is_new { PutMode::Create } else { PutMode::Overwrite };
    let options = PutOptions { mode, ..PutOptions::default() };
    match bucket(&key.bucket)?.put_opts(&path(key)?, PutPayload::from(bytes), options).await {
        Ok(_) => Ok(Put::Done),
        Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) if is_new => Ok(Put::WasThere),
        Err(error) => Err(error).with_context(|| format!("cannot write {key}")),
    }
}
