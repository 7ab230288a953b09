//! NATS JetStream: files are objects of an object store, receipts are entries of a key-value bucket, and a stream is the queue that
//! collectors share.
//!
//! The queue has one message for each file that waits: a second is refused until the first was acknowledged. So a file can be
//! announced again at any time, and nothing relies on the server's memory of what it has seen (`Nats-Msg-Id` within a window).

use std::fmt;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::context::{PublishError, PublishErrorKind};
use async_nats::jetstream::kv::{self, CreateErrorKind};
use async_nats::jetstream::object_store::{self, InfoErrorKind, Object, ObjectInfo, ObjectStore};
use async_nats::jetstream::stream::{self, DiscardPolicy, RetentionPolicy, Stream};
use async_nats::jetstream::{self, Context};

use crate::file::CasingFile;
use crate::receipt::Receipt;
use crate::server::{ANSWER_WITHIN, Server};

/// How long the server keeps what nobody takes: a file that it has forgotten is sent again. What is left of files
/// whose sending was cut off is removed then too.
const KEPT_FOR: Duration = Duration::from_secs(14 * 86_400);

/// A collector that has said nothing for so long has lost the file, and another gets it.
pub(crate) const TAKEN_WITHIN: Duration = Duration::from_secs(30);

/// Name of the consumer that collectors share.
const COLLECTORS: &str = "collectors";

/// A connection to JetStream, with all that is kept there.
pub(crate) struct JetStream {
    context: Context,
    objects: ObjectStore,
    receipts: kv::Store,
    waiting: Stream,
    bucket: String,
}

impl JetStream {
    /// Connects as `name`, and creates what is missing.
    pub(crate) async fn connect(server: &Server, name: &str, bucket: &str) -> Result<Self> {
        let client = server.connect(name).await?;
        let mut context = jetstream::new(client);
        context.set_timeout(ANSWER_WITHIN);
        Self::open(context, bucket)
            .await
            .with_context(|| format!("cannot use the bucket {bucket} of {}", server.shown()))
    }

    async fn open(context: Context, bucket: &str) -> Result<Self> {
        let objects = match context.get_object_store(bucket).await {
            Ok(there) => there,
            Err(_) => {
                let config = object_store::Config {
                    bucket: bucket.to_owned(),
                    description: Some("casing files on their way to a centre".to_owned()),
                    max_age: KEPT_FOR,
                    ..Default::default()
                };
                context.create_object_store(config).await?
            }
        };
        let receipts_bucket = format!("{bucket}-receipts");
        // The client's own call first asks for the account's limits, which it cannot read as server 2.9 writes them.
        let receipts = stream::Config {
            name: format!("KV_{receipts_bucket}"),
            description: Some("what centres say of casing files".to_owned()),
            subjects: vec![format!("$KV.{receipts_bucket}.>")],
            max_messages_per_subject: 1,
            discard: DiscardPolicy::New,
            allow_rollup: true,
            deny_delete: true,
            allow_direct: true,
            ..Default::default()
        };
        context.get_or_create_stream(receipts).await?;
        let waiting = stream::Config {
            name: format!("{bucket}-waiting"),
            description: Some("casing files that no centre has taken".to_owned()),
            subjects: vec![format!("{bucket}-waiting.>")],
            retention: RetentionPolicy::WorkQueue,
            max_messages_per_subject: 1,
            discard: DiscardPolicy::New,
            discard_new_per_subject: true,
            max_age: KEPT_FOR,
            ..Default::default()
        };
        let waiting = context.get_or_create_stream(waiting).await?;
        let receipts = context.get_key_value(receipts_bucket).await?;
        Ok(Self { context, objects, receipts, waiting, bucket: bucket.to_owned() })
    }

    /// The queue of files that wait, which all collectors share.
    pub(crate) async fn queue(&self) -> Result<PullConsumer> {
        let config = pull::Config {
            durable_name: Some(COLLECTORS.to_owned()),
            ack_policy: AckPolicy::Explicit,
            ack_wait: TAKEN_WITHIN,
            ..Default::default()
        };
        self.waiting.get_or_create_consumer(COLLECTORS, config).await.context("cannot share the queue")
    }

    /// Announces `file` to collectors, unless it is announced.
    async fn announce(&self, file: &CasingFile) -> Result<()> {
        let subject = format!("{}-waiting.{}", self.bucket, file.key());
        let sent = self.context.publish(subject, file.as_str().to_owned().into()).await?;
        match sent.await {
            Ok(_) => Ok(()),
            Err(error) if error.kind() == PublishErrorKind::Other && is_announced(&error) => Ok(()),
            Err(error) => Err(error).with_context(|| format!("the server does not store the announcement of {file}")),
        }
    }

    /// The bytes of `file`, to be read.
    pub(crate) async fn object(&self, file: &CasingFile) -> Result<Object> {
        Ok(self.objects.get(file.as_str()).await?)
    }

    /// What waits as `file`, if something does.
    pub(crate) async fn info(&self, file: &CasingFile) -> Result<Option<ObjectInfo>> {
        match self.objects.info(file.as_str()).await {
            Ok(info) => Ok(Some(info).filter(|info| !info.deleted)),
            Err(error) if error.kind() == InfoErrorKind::NotFound => Ok(None),
            Err(error) => Err(error).with_context(|| format!("the server does not say whether it has {file}")),
        }
    }

    /// Removes what waits as `file`: it was taken, or is to be sent again.
    pub(crate) async fn remove(&self, file: &CasingFile) -> Result<()> {
        if self.info(file).await?.is_some() {
            self.objects.delete(file.as_str()).await.with_context(|| format!("the server does not remove {file}"))?;
        }
        Ok(())
    }

    /// Gives the receipt of `file`; returns whether it counts: only the first does. If its acknowledgement is lost, the
    /// client finds it there when it gives it again, and reads it back.
    pub(crate) async fn give(&self, file: &CasingFile, receipt: &Receipt) -> Result<bool> {
        let text = serde_json::to_vec(receipt)?;
        match self.receipts.create(file.key(), text.into()).await {
            Ok(_) => Ok(true),
            Err(error) if error.kind() == CreateErrorKind::AlreadyExists => {
                Ok(self.receipt(file).await?.as_ref() == Some(receipt))
            }
            Err(error) => Err(error).with_context(|| format!("the server does not store the receipt of {file}")),
        }
    }

    /// Publishes the bytes of the file at `path` as `file`; returns its digest when all of it is stored.
    pub(crate) async fn publish(&self, file: &CasingFile, path: &Path) -> Result<String> {
        let mut bytes = tokio::fs::File::open(path).await.with_context(|| format!("cannot read {}", path.display()))?;
        let put = self.objects.put(file.as_str(), &mut bytes).await;
        let info = put.with_context(|| format!("the server does not store {file}"))?;
        let Some(digest) = info.digest else { bail!("the server returns no digest of {file}") };
        self.announce(file).await?;
        Ok(digest)
    }

    /// Announces again that `file` waits; returns its size, or `None` if the server does not have it.
    pub(crate) async fn remind(&self, file: &CasingFile) -> Result<Option<u64>> {
        let Some(info) = self.info(file).await? else { return Ok(None) };
        self.announce(file).await?;
        Ok(Some(info.size as u64))
    }

    /// The receipt of `file`; `None` if no centre has said anything of it yet. The error is an [`Unreadable`] if it concerns this file
    /// alone.
    pub(crate) async fn receipt(&self, file: &CasingFile) -> Result<Option<Receipt>> {
        let entry = self.receipts.get(file.key()).await;
        let entry = entry.with_context(|| format!("the server does not say what became of {file}"))?;
        let read = |bytes: &[u8]| serde_json::from_slice(bytes).context(Unreadable { file: file.to_string() });
        entry.as_deref().map(read).transpose()
    }

    /// Removes the receipt of `file`, so that a centre takes it again.
    pub(crate) async fn forget(&self, file: &CasingFile) -> Result<()> {
        self.receipts.purge(file.key()).await.with_context(|| format!("cannot remove the receipt of {file}"))
    }
}

/// A receipt that this program cannot read: a newer one has given it, or a stranger.
#[derive(Debug)]
pub(crate) struct Unreadable {
    file: String,
}

impl fmt::Display for Unreadable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the receipt of {} cannot be read", self.file)
    }
}

/// Whether a message was refused because the queue has one of its subject.
fn is_announced(error: &PublishError) -> bool {
    let mut source = std::error::Error::source(error);
    while let Some(cause) = source {
        if cause.to_string().contains("maximum messages per subject exceeded") {
            return true;
        }
        source = cause.source();
    }
    false
}
