//! Verdicts to an MQTT broker.
//!
//! Each station has its own connection, because a connection has one last will, which must clear the topic with the
//! station's retained current verdict. Only the outbox is kept from one connection to the next.
//!
//! - here: what is published when
//! - `client`: the MQTT client

mod client;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Error, Result, ensure};
use tapline_host::connection::User;
use tapline_host::messages::with_causes;
use tokio::task::LocalSet;
use tokio::time::timeout;

use crate::config::wires::MqttConfig;
use crate::wires::mqtt::client::{Client, Connection, Message, Receipt};
use crate::wires::now::StationState;
use crate::wires::outbox::Receiver;
use crate::wires::wire::{News, Plant, Wire};

/// How often the state of a station is published, if it does not change.
const SHOW_EVERY: Duration = Duration::from_secs(5);

/// After how many seconds a broker forgets the state of a station.
const STANDS_FOR_S: u32 = 15;

/// After how long a verdict to which nobody has subscribed is published again.
const PUBLISH_AGAIN_AFTER: Duration = Duration::from_secs(1);

/// Time until the next attempt to connect: at first, and at most.
const CONNECT_AGAIN_AFTER: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(5));

/// What can be wrong with a station's connection.
const NO_CONNECTION: &str = "no connection";
const NO_SUBSCRIBER: &str = "no subscriber";

/// How long remaining verdicts may take when the line ends.
const END_WITHIN: Duration = Duration::from_secs(2);

/// Checks that the files which `config` names can be read.
pub(super) fn check(config: &MqttConfig) -> Result<()> {
    client(config).map(drop)
}

/// The beginning of a certificate.
const PEM: &[u8] = b"-----BEGIN CERTIFICATE-----";

/// What is needed to connect.
fn client(config: &MqttConfig) -> Result<Client> {
    let (host, port) = config.host_and_port()?;
    let read = |path: &std::path::PathBuf| {
        let key = || format!("line.mqtt.ca_file = \"{}\"", path.display());
        let text = fs::read(path).with_context(|| format!("{}: cannot read it", key()))?;
        let is_certificate = text.windows(PEM.len()).any(|part| part == PEM);
        ensure!(is_certificate, "{}: it has no certificate in PEM: a line {}", key(), String::from_utf8_lossy(PEM));
        Ok(text)
    };
    let user = config.credentials_file.as_deref().map(User::read).transpose();
    Ok(Client {
        host: host.trim_start_matches('[').trim_end_matches(']').to_owned(),
        port,
        ca: config.ca_file.as_ref().map(read).transpose()?,
        user: user.context("line.mqtt.credentials_file")?,
    })
}

/// Starts to publish the verdicts of `plant`.
pub(super) fn start(config: &MqttConfig, plant: &Plant) -> Result<Wire> {
    let (client, config, plant_of_wire) = (client(config)?, config.clone(), plant.clone());
    Wire::start(Receiver::Mqtt, plant, || Ok(move |news| publish(client, config, plant_of_wire, news)))
}

/// Publishes until the wire ends, each station over its own connections.
async fn publish(client: Client, config: MqttConfig, plant: Plant, news: News) -> Result<()> {
    let (client, troubles) = (Rc::new(client), Rc::<RefCell<_>>::default());
    let all = LocalSet::new();
    for &station in plant.stations.iter() {
        let mut lane = Lane {
            station,
            topic: format!("{}/station/{station}", config.topic),
            name: format!("{}-{station}", config.client),
            broker: config.broker.clone(),
            needs_subscriber: config.needs_subscriber,
            client: Rc::clone(&client),
            plant: plant.clone(),
            news: news.clone(),
            troubles: Rc::clone(&troubles),
            shown: None,
            publish_at: Instant::now(),
            patience: CONNECT_AGAIN_AFTER.0,
        };
        all.spawn_local(async move { lane.run().await });
    }
    all.await;
    Ok(())
}

/// What is published of one station.
struct Lane {
    station: u16,
    /// How its topics begin.
    topic: String,
    /// Name of its connection.
    name: String,
    broker: String,
    needs_subscriber: bool,
    client: Rc<Client>,
    plant: Plant,
    news: News,
    /// What is wrong with each station's connection.
    troubles: Rc<RefCell<BTreeMap<(&'static str, u16), String>>>,
    /// The state of the station that was last published, and when.
    shown: Option<(String, Instant)>,
    /// When verdicts may be published again.
    publish_at: Instant,
    /// Time until the next attempt to connect.
    patience: Duration,
}

impl Lane {
    /// Publishes until the wire ends, over as many connections as it takes.
    async fn run(&mut self) {
        loop {
            let will = self.station_state(&StationState::NoSignal);
            let why = match Rc::clone(&self.client).connect(&self.name, &will).await {
                Ok(mut connection) => {
                    self.shown = None;
                    match self.serve(&mut connection).await {
                        Ok(()) => return connection.close().await,
                        Err(error) => error,
                    }
                }
                Err(error) => error,
            };
            let why: &Error = &why;
            self.set_trouble(
                NO_CONNECTION,
                Some(format!("mqtt: no connection to {}: {}", self.broker, with_causes(why.as_ref()))),
            );
            if timeout(self.patience, self.news.ended()).await.is_ok() {
                return;
            }
            self.patience = (self.patience * 2).min(CONNECT_AGAIN_AFTER.1);
        }
    }

    /// Publishes over `connection` until the wire ends.
    async fn serve(&mut self, connection: &mut Connection) -> Result<()> {
        loop {
            self.show(connection).await?;
            self.publish_verdicts(connection).await?;
            tokio::select! {
                biased;
                why = connection.lost() => return Err(why),
                goes_on = self.news.next() => if !goes_on { break },
            }
        }
        self.publish_at = Instant::now();
        // What is not reported by then is reported after the next start.
        drop(timeout(END_WITHIN, self.publish_verdicts(connection)).await);
        self.shown = None;
        self.show(connection).await
    }

    /// Publishes the state of the station, if it has changed or was not published recently.
    async fn show(&mut self, connection: &mut Connection) -> Result<()> {
        let message = self.station_state(&self.plant.now.at(self.station).0);
        let is_known = |(shown, at): &(String, Instant)| *shown == message.payload && at.elapsed() < SHOW_EVERY;
        if !self.shown.as_ref().is_some_and(is_known) {
            connection.publish(&message).await?;
            self.shown = Some((message.payload, Instant::now()));
        }
        Ok(())
    }

    /// Publishes the verdicts that are still to be reported.
    async fn publish_verdicts(&mut self, connection: &mut Connection) -> Result<()> {
        if Instant::now() < self.publish_at {
            return Ok(());
        }
        let outbox = Arc::clone(&self.plant.outbox);
        let mut trouble = None;
        while let Some(note) = outbox.next(Receiver::Mqtt, Some(self.station)) {
            let Some(verdict) = outbox.read(&note) else { continue };
            let topic = format!("{}/verdict", self.topic);
            let message = Message { topic, payload: verdict.json(), is_retained: false, expires_after_s: None };
            let receipt = connection.publish(&message).await?;
            if receipt == Receipt::NoSubscriber && self.needs_subscriber {
                trouble = Some(format!("mqtt: nobody subscribes to {}, so verdicts wait", message.topic));
                self.publish_at = Instant::now() + PUBLISH_AGAIN_AFTER;
                break;
            }
            outbox.acknowledge(Receiver::Mqtt, note.number);
            // However many wait, the station shows its current state.
            self.show(connection).await?;
        }
        // Only now: a broker that refuses what is published lets everyone connect.
        self.set_trouble(NO_CONNECTION, None);
        self.patience = CONNECT_AGAIN_AFTER.0;
        self.set_trouble(NO_SUBSCRIBER, trouble);
        Ok(())
    }

    fn station_state(&self, station_state: &StationState) -> Message {
        // The last message of a line that has ended stays.
        let expires_after_s = (*station_state != StationState::NoSignal).then_some(STANDS_FOR_S);
        let verdict =
            if let StationState::Judged(verdict) = station_state { verdict.json() } else { "null".to_owned() };
        let (station, state) = (self.station, station_state.name());
        let payload = format!(r#"{{"kind":"station","station":{station},"state":"{state}","verdict":{verdict}}}"#);
        Message { topic: format!("{}/now", self.topic), payload, is_retained: true, expires_after_s }
    }

    fn set_trouble(&self, kind: &'static str, trouble: Option<String>) {
        let mut troubles = self.troubles.borrow_mut();
        match trouble {
            Some(text) => drop(troubles.insert((kind, self.station), text)),
            None => drop(troubles.remove(&(kind, self.station))),
        }
        let first = troubles.iter().find(|((of, _), _)| *of == kind).map(|(_, text)| text.clone());
        self.plant.outbox.set_trouble(Receiver::Mqtt, kind, first);
    }
}
