//! The MQTT client: the crate `rumqttc-v5-next`, which speaks MQTT 5.

use std::time::Duration;

use anyhow::{Context as _, Error, Result, anyhow, bail};
use rumqttc::mqttbytes::v5::{ConnectReturnCode, Packet, PubAckReason, PublishProperties};
use rumqttc::{
    AsyncClient, Event, EventLoop, LastWill, MqttOptions, Outgoing, PublishNoticeError, PublishOptions, PublishResult,
    QoS, TlsConfiguration, Transport,
};
use tapline_host::connection::User;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tokio::time::timeout;

/// A broker that has not heard from a client for 1.5 times this long publishes its last will, in seconds.
const KEEP_ALIVE_S: u16 = 4;

/// How long it may take to connect.
const CONNECT_WITHIN: Duration = Duration::from_secs(5);

/// How long a broker may take to acknowledge.
const ACKNOWLEDGE_WITHIN: Duration = Duration::from_secs(10);

/// How long a connection may take to be closed.
const CLOSE_WITHIN: Duration = Duration::from_millis(500);

/// Requests that wait for the connection at once: one is published at a time.
const REQUESTS_MAX: usize = 4;

/// What is published.
#[derive(Debug, Clone)]
pub(super) struct Message {
    pub topic: String,
    pub payload: String,
    /// Whether the broker keeps it for those who subscribe later.
    pub is_retained: bool,
    /// After how many seconds the broker forgets it; never, if `None`.
    pub expires_after_s: Option<u32>,
}

/// What has become of a message that the broker has acknowledged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Receipt {
    Taken,
    /// Nobody subscribes to its topic: it is gone.
    NoSubscriber,
}

/// Makes connections to a broker.
pub(super) struct Client {
    pub host: String,
    pub port: u16,
    /// Certificates (PEM) for checking the broker.
    pub ca: Option<Vec<u8>>,
    pub user: Option<User>,
}

/// A connection to a broker, which keeps no state of earlier ones. A task of its own keeps it alive.
pub(super) struct Connection {
    client: AsyncClient,
    task: JoinHandle<()>,
    lost: oneshot::Receiver<Error>,
}

impl Client {
    /// Connects under `name`. When the connection is lost, the broker publishes `will`.
    pub(super) async fn connect(&self, name: &str, will: &Message) -> Result<Connection> {
        let mut options = MqttOptions::new(name, (self.host.as_str(), self.port));
        options.set_keep_alive(KEEP_ALIVE_S).set_clean_start(true).set_connect_timeout(CONNECT_WITHIN);
        options.set_last_will(LastWill::new(
            &will.topic,
            will.payload.clone(),
            QoS::AtLeastOnce,
            will.is_retained,
            None,
        ));
        if let Some(ca) = &self.ca {
            let tls = TlsConfiguration::Simple { ca: ca.clone(), alpn: None, client_auth: None };
            options.set_transport(Transport::tls_with_config(tls));
        }
        if let Some(User { name, password }) = &self.user {
            options.set_credentials(name, password.clone());
        }
        let (client, mut events) = AsyncClient::builder(options).capacity(REQUESTS_MAX).try_build()?;
        timeout(CONNECT_WITHIN, connected(&mut events)).await.context("it does not answer")??;
        let (lose, lost) = oneshot::channel();
        let task = tokio::task::spawn_local(async move {
            let why = keep(&mut events).await;
            // Nobody may wait for it any more.
            drop(lose.send(why));
        });
        Ok(Connection { client, task, lost })
    }
}

/// Waits for the broker to accept the connection.
async fn connected(events: &mut EventLoop) -> Result<()> {
    loop {
        if let Event::Incoming(Packet::ConnAck(answer)) = events.poll().await? {
            return match answer.code {
                ConnectReturnCode::Success => Ok(()),
                code => Err(anyhow!("it refuses the connection: {code:?}")),
            };
        }
    }
}

/// Keeps a connection alive until it is lost, and returns the reason.
async fn keep(events: &mut EventLoop) -> Error {
    loop {
        match events.poll().await {
            Ok(Event::Outgoing(Outgoing::Disconnect)) => return anyhow!("it was closed"),
            Ok(_) => {}
            Err(error) => return error.into(),
        }
    }
}

impl Connection {
    /// Publishes `message`, and waits until the broker has acknowledged it.
    pub(super) async fn publish(&mut self, message: &Message) -> Result<Receipt> {
        let properties =
            PublishProperties { message_expiry_interval: message.expires_after_s, ..PublishProperties::default() };
        let options = PublishOptions::at_least_once().retain(message.is_retained).properties(properties);
        let publish = async {
            let sent = self.client.publish_tracked(message.topic.clone(), message.payload.clone(), options).await?;
            Ok::<_, Error>(sent.wait_async().await)
        };
        let answer = tokio::select! {
            answer = timeout(ACKNOWLEDGE_WITHIN, publish) => answer,
            why = &mut self.lost => return Err(why.unwrap_or_else(|_| anyhow!("the connection was lost"))),
        };
        let seconds = ACKNOWLEDGE_WITHIN.as_secs();
        let reason = match answer.with_context(|| format!("it has acknowledged nothing for {seconds} s"))?? {
            Ok(PublishResult::Qos1(answer)) => answer.reason,
            Err(PublishNoticeError::V5PubAck(reason)) => reason,
            Ok(other) => bail!("it acknowledges with {other:?}"),
            Err(error) => return Err(error.into()),
        };
        match reason {
            PubAckReason::Success => Ok(Receipt::Taken),
            PubAckReason::NoMatchingSubscribers => Ok(Receipt::NoSubscriber),
            reason => bail!("it refuses what is published to {}: {reason:?}", message.topic),
        }
    }

    /// Waits until the connection is lost; why.
    pub(super) async fn lost(&mut self) -> Error {
        (&mut self.lost).await.unwrap_or_else(|_| anyhow!("the connection was lost"))
    }

    /// Ends the connection, without the will.
    pub(super) async fn close(mut self) {
        if self.client.disconnect().await.is_ok() {
            drop(timeout(CLOSE_WITHIN, self.lost()).await);
        }
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.task.abort();
    }
}
