//! Verdicts on their way out: to standard output, to the plant's command, and over its wires.
//!
//! Each *verdict* goes to each receiver, until it is acknowledged, even after the line was killed. Each wire also carries the
//! *current verdict* of a station, until the next casing comes; while it is in doubt there is none. Each receiver has a
//! thread of its own: the line never waits for its other end.
//!
//! - here: starts all of them, passes them the line's state, and ends them
//! - `outbox`: which verdicts are still to be reported to whom
//! - `now`: the current state of each station
//! - `print`, `on_verdict`: standard output, and the command
//! - `reporter`: their thread
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
mod print;
mod reporter;
#[cfg(feature = "plant")]
mod wire;

use std::sync::Arc;

use anyhow::Result;
use tapline_store::Places;

use crate::cli::built_without;
use crate::config::LineConfig;
use crate::shown::status::ReceiverStatus;
use crate::shown::verdict::Form;
use crate::wires::now::Now;
use crate::wires::outbox::Outbox;
pub(crate) use crate::wires::outbox::Receiver;
use crate::wires::reporter::Reporter;

/// All receivers of verdicts. When dropped, first reports waiting verdicts, for a while; the rest after the next start.
pub(crate) struct Wires {
    pub outbox: Arc<Outbox>,
    pub now: Arc<Now>,
    // Only held: they end when they are dropped.
    _reporters: Vec<Reporter>,
    #[cfg(feature = "plant")]
    _wires: Vec<wire::Wire>,
}

impl Wires {
    /// Starts what `config` names, for a line with these stations and files, which prints verdicts in this `form`; also returns the
    /// addresses, for people.
    pub(crate) fn start(
        config: &LineConfig,
        stations: &[u16],
        places: &Places,
        form: Form,
    ) -> Result<(Self, Vec<String>)> {
        let outbox = Outbox::open(places, receivers(config))?;
        let command = config.on_verdict.as_deref().map(|command| on_verdict::start(command, &outbox)).transpose()?;
        let reporters = command.into_iter().chain([print::start(form, &outbox)?]).collect();
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
            _reporters: reporters,
            #[cfg(feature = "plant")]
            _wires: wires,
        };
        Ok((started, said))
    }

    /// Ends all of them, after reporting the last verdicts, for a while; returns the state of each.
    pub(crate) fn close(self) -> Vec<ReceiverStatus> {
        let outbox = Arc::clone(&self.outbox);
        drop(self);
        outbox.statuses()
    }
}

/// Who gets the verdicts of a line with this `config`.
fn receivers(config: &LineConfig) -> Vec<Receiver> {
    let is_there = [
        (Receiver::Command, config.on_verdict.is_some()),
        (Receiver::Mqtt, config.mqtt.is_some()),
        (Receiver::OpcUa, config.opcua.is_some()),
        (Receiver::Modbus, config.modbus.is_some()),
        (Receiver::Print, true),
    ];
    is_there.into_iter().filter(|(_, is_there)| *is_there).map(|(receiver, _)| receiver).collect()
}

/// Starts the wires that `config` names; also returns their addresses, for people.
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

/// Refuses wires that this build does not have, and unreadable files for them.
pub(crate) fn check(config: &LineConfig) -> Result<()> {
    let is_wire = |receiver: &Receiver| !matches!(receiver, Receiver::Print | Receiver::Command);
    if let Some(wire) = receivers(config).into_iter().find(is_wire).filter(|_| !cfg!(feature = "plant")) {
        return built_without(&format!("[line.{}]", wire.name()), "plant");
    }
    config.on_verdict.as_deref().map(on_verdict::check).transpose()?;
    #[cfg(feature = "plant")]
    {
        config.mqtt.as_ref().map(mqtt::check).transpose()?;
        config.opcua.as_ref().map(opcua::user).transpose()?;
    }
    Ok(())
}
