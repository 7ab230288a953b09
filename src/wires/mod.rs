//! Verdicts on their way out: to the command of the plant, and over its wires.
//!
//! Each wire carries two things. *Verdicts*: every one, until it is acknowledged, also after the line was killed. *What stands* at a
//! station now: a casing's verdict until the next one comes, and "no verdict" whenever that is in doubt. Each wire has a thread
//! of its own; whatever hangs at its other end, the line does not wait.
//!
//! - here: all of them are started, shown what the line does, and ended
//! - `outbox`: who has still to be reported which verdict
//! - `now`: what stands at each station
//! - `on_verdict`: the command
//! - `mqtt`, `opcua`, `modbus`: the wires
//! - `wire`: a wire's thread

#[cfg(feature = "plant")]
mod modbus;
#[cfg(feature = "plant")]
mod mqtt;
#[cfg_attr(not(feature = "plant"), expect(dead_code, reason = "no wire looks"))]
mod now;
mod on_verdict;
#[cfg(feature = "plant")]
mod opcua;
mod outbox;
#[cfg(feature = "plant")]
mod wire;

use std::sync::Arc;

use anyhow::Result;
use tapline_store::{Places, Unreported};

use crate::cli::built_without;
use crate::config::LineConfig;
use crate::shown::status::{ReceiverStatus, StationStatus};
use crate::shown::verdict::CasingVerdict;
use crate::wires::now::Now;
use crate::wires::on_verdict::VerdictCommand;
use crate::wires::outbox::{Outbox, Receiver};

/// Whoever receives verdicts. When it is dropped, what waits is reported first, for a while; the rest is after the next start.
pub(crate) struct Wires {
    outbox: Arc<Outbox>,
    now: Arc<Now>,
    // Only held: both end when they are dropped.
    _command: Option<VerdictCommand>,
    #[cfg(feature = "plant")]
    _wires: Vec<wire::Wire>,
}

impl Wires {
    /// Starts what `config` names, for a line with these stations and files; and says where what is served is found.
    pub(crate) fn start(config: &LineConfig, stations: &[u16], places: &Places) -> Result<(Self, Vec<String>)> {
        let is_there = [
            (Receiver::Print, true),
            (Receiver::Command, config.on_verdict.is_some()),
            (Receiver::Mqtt, config.mqtt.is_some()),
            (Receiver::OpcUa, config.opcua.is_some()),
            (Receiver::Modbus, config.modbus.is_some()),
        ];
        let outbox =
            Outbox::open(places, is_there.iter().filter(|(_, is_so)| *is_so).map(|&(receiver, _)| receiver).collect())?;
        let command =
            config.on_verdict.as_deref().map(|command| VerdictCommand::start(command, &outbox)).transpose()?;
        let now = Arc::new(Now::new(stations));
        #[cfg(feature = "plant")]
        let (wires, said) = {
            let (outbox, now) = (Arc::clone(&outbox), Arc::clone(&now));
            start_plant(config, &wire::Plant { outbox, now, stations: stations.into() })?
        };
        #[cfg(not(feature = "plant"))]
        let said = Vec::new();
        let started = Self {
            outbox,
            now,
            _command: command,
            #[cfg(feature = "plant")]
            _wires: wires,
        };
        Ok((started, said))
    }

    /// Takes up the casing `number`, whose file has its name now. `None` if its verdict was reported before.
    pub(crate) fn take_up(&self, number: u64) -> Result<Option<Unreported>> {
        self.outbox.take_up(number)
    }

    /// The oldest verdict that an earlier line has not printed.
    pub(crate) fn next_unprinted(&self) -> Option<Unreported> {
        self.outbox.next(Receiver::Print, None)
    }

    /// Notes that a verdict was printed.
    pub(crate) fn printed(&self, number: u64) {
        self.outbox.acknowledge(Receiver::Print, number);
    }

    /// The alarms since this was last called.
    pub(crate) fn take_alarms(&self) -> Vec<String> {
        self.outbox.take_alarms()
    }

    /// Ends all of them, whose last verdicts are reported first, for a while; how it stands with each then.
    pub(crate) fn close(self) -> Vec<ReceiverStatus> {
        let outbox = Arc::clone(&self.outbox);
        drop(self);
        outbox.statuses()
    }

    /// How it stands with each of them.
    pub(crate) fn statuses(&self) -> Vec<ReceiverStatus> {
        self.outbox.statuses()
    }

    /// What cannot be reported to anyone.
    pub(crate) fn trouble(&self) -> Option<String> {
        self.outbox.trouble()
    }

    /// A casing has come to `station`.
    pub(crate) fn opened(&self, station: u16) {
        self.now.opened(station);
    }

    /// A casing is judged; `is_busy` says whether its station has another one already.
    pub(crate) fn judged(&self, verdict: &CasingVerdict, is_busy: bool) {
        self.now.judged(&Arc::new(verdict.clone()), is_busy);
    }

    /// The line shows itself.
    pub(crate) fn show(&self, stations: &[StationStatus]) {
        self.now.show(stations);
    }

    /// The line ends.
    pub(crate) fn end(&self) {
        self.now.end();
    }
}

/// Starts the wires that `config` names, and says where what is served is found.
#[cfg(feature = "plant")]
fn start_plant(config: &LineConfig, plant: &wire::Plant) -> Result<(Vec<wire::Wire>, Vec<String>)> {
    let (mut wires, mut said) = (Vec::new(), Vec::new());
    if let Some(config) = &config.mqtt {
        wires.push(mqtt::start(config, plant)?);
    }
    if let Some(config) = &config.opcua {
        let (wire, address) = opcua::start(config, plant)?;
        said.push(format!("verdicts are served over OPC UA at {address}"));
        wires.push(wire);
    }
    if let Some(config) = &config.modbus {
        let (wire, address) = modbus::start(config, plant)?;
        said.push(format!("verdicts are served over Modbus TCP at {address}"));
        wires.push(wire);
    }
    Ok((wires, said))
}

/// Refuses wires that this build does not have, and files of theirs that cannot be read.
pub(crate) fn check(config: &LineConfig) -> Result<()> {
    let named =
        [("mqtt", config.mqtt.is_some()), ("opcua", config.opcua.is_some()), ("modbus", config.modbus.is_some())];
    if let Some((name, _)) = named.into_iter().find(|(_, is_named)| *is_named && !cfg!(feature = "plant")) {
        return built_without(&format!("[line.{name}]"), "plant");
    }
    #[cfg(feature = "plant")]
    {
        config.mqtt.as_ref().map(mqtt::check).transpose()?;
        config.opcua.as_ref().map(opcua::user).transpose()?;
    }
    Ok(())
}
