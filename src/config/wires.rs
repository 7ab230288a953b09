//! Where verdicts go over the plant's network: the tables `[line.mqtt]`, `[line.opcua]` and `[line.modbus]`.

use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};
use tapline_host::connection::is_this_machine;

/// Longest topic prefix and client name, in bytes.
const TEXT_BYTES_MAX: usize = 128;

/// Verdicts to an MQTT broker: the table `[line.mqtt]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MqttConfig {
    /// Where the broker is: `HOST:PORT`.
    pub broker: String,
    /// How topics begin.
    #[serde(default = "tapline")]
    pub topic: String,
    /// Name of this line at the broker; each station adds its number.
    #[serde(default = "tapline")]
    pub client: String,
    /// Certificates (PEM) for checking the broker; with them the connection is encrypted.
    pub ca_file: Option<PathBuf>,
    /// File with a user's name and password, a line each.
    pub credentials_file: Option<PathBuf>,
    /// Whether the connection may leave this machine without encryption.
    #[serde(default)]
    pub allows_plain: bool,
    /// Whether a verdict counts as reported only if somebody subscribes to its topic.
    #[serde(default = "yes")]
    pub needs_subscriber: bool,
}

/// Verdicts to OPC UA clients: the table `[line.opcua]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OpcUaConfig {
    /// Address to listen at.
    pub listen: SocketAddr,
    /// Folder of certificates: the server's own, and those of clients that it trusts. With it connections are encrypted.
    pub pki_folder: Option<PathBuf>,
    /// File with the name and password that clients must have, a line each.
    pub credentials_file: Option<PathBuf>,
    /// Whether other machines may connect without encryption, or without a password.
    #[serde(default)]
    pub allows_plain: bool,
}

/// Verdicts to controllers, over Modbus TCP: the table `[line.modbus]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ModbusConfig {
    /// Address to listen at.
    pub listen: SocketAddr,
    /// Whether other machines may connect: Modbus TCP has neither encryption nor passwords.
    #[serde(default)]
    pub allows_plain: bool,
}

fn tapline() -> String {
    "tapline".to_owned()
}

fn yes() -> bool {
    true
}

impl MqttConfig {
    pub(super) fn validate(&self) -> Result<()> {
        let Self { broker, topic, client, .. } = self;
        let (host, _) = self.host_and_port()?;
        for (key, value) in [("topic", topic), ("client", client)] {
            ensure!(
                (1..=TEXT_BYTES_MAX).contains(&value.len()),
                "line.mqtt.{key} has {} bytes: must be from 1 to {TEXT_BYTES_MAX}",
                value.len()
            );
        }
        let is_plain_name =
            |part: &str| !part.is_empty() && !part.contains(['+', '#']) && !part.contains(char::is_control);
        ensure!(
            topic.split('/').all(is_plain_name) && !topic.starts_with('$'),
            "line.mqtt.topic = \"{topic}\": each level must have a name, without + and #, and the first may not begin with $"
        );
        ensure!(!client.contains(char::is_control), "line.mqtt.client = \"{client}\": it holds a control character");
        ensure!(
            self.ca_file.is_some() || self.allows_plain || is_this_machine(host),
            "line.mqtt.broker = \"{broker}\": what is sent leaves this machine, unencrypted: give ca_file = \"FILE\" for TLS, or \
             allows_plain = true"
        );
        Ok(())
    }

    /// The broker's host and port.
    pub(crate) fn host_and_port(&self) -> Result<(&str, u16)> {
        let parts = self.broker.rsplit_once(':');
        let parts = parts.and_then(|(host, port)| Some((host, port.parse().ok().filter(|&port: &u16| port > 0)?)));
        let host_and_port = parts.filter(|(host, _)| !host.is_empty() && !host.contains(['/', '@', ' ']));
        host_and_port.with_context(|| {
            format!("line.mqtt.broker = \"{}\": must be HOST:PORT, with a port from 1 to 65535", self.broker)
        })
    }
}

impl OpcUaConfig {
    pub(super) fn validate(&self) -> Result<()> {
        let is_safe = self.pki_folder.is_some() && self.credentials_file.is_some();
        ensure!(
            is_safe || self.allows_plain || self.listen.ip().is_loopback(),
            "line.opcua.listen = \"{}\": other machines can reach this address: give pki_folder and credentials_file, or \
             allows_plain = true",
            self.listen
        );
        Ok(())
    }
}

impl ModbusConfig {
    pub(super) fn validate(&self) -> Result<()> {
        ensure!(
            self.allows_plain || self.listen.ip().is_loopback(),
            "line.modbus.listen = \"{}\": other machines can reach this address, and Modbus TCP has no encryption and no \
             passwords: give allows_plain = true if only the plant's controllers are on that network",
            self.listen
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    fn refused(table: &str) -> String {
        let config = crate::config::Config::parse(table);
        let checked = config.and_then(|config| config.line.validate());
        checked.map_or_else(|error| format!("{error:#}"), |()| String::new())
    }

    /// Catches connections that others can read or reach though nobody allowed it, and errors that do not name the key.
    #[test]
    fn what_leaves_the_machine_unprotected_must_be_asked_for() {
        for fine in [
            "[line.mqtt]\nbroker = \"127.0.0.1:1883\"",
            "[line.mqtt]\nbroker = \"[::1]:1883\"\ntopic = \"plant/line 1\"",
            "[line.mqtt]\nbroker = \"broker:8883\"\nca_file = \"ca.pem\"",
            "[line.mqtt]\nbroker = \"broker:1883\"\nallows_plain = true",
            "[line.opcua]\nlisten = \"127.0.0.1:4840\"",
            "[line.opcua]\nlisten = \"0.0.0.0:4840\"\npki_folder = \"pki\"\ncredentials_file = \"user\"",
            "[line.modbus]\nlisten = \"10.0.0.1:502\"\nallows_plain = true",
        ] {
            assert_eq!(refused(fine), "", "{fine}");
        }
        for (wrong, words) in [
            ("[line.mqtt]\nbroker = \"broker:1883\"", ["line.mqtt.broker", "ca_file"]),
            ("[line.mqtt]\nbroker = \"localhost.plant:1883\"", ["line.mqtt.broker", "allows_plain"]),
            ("[line.mqtt]\nbroker = \"127.0.0.1\"", ["HOST:PORT", "65535"]),
            ("[line.mqtt]\nbroker = \"127.0.0.1:70000\"", ["HOST:PORT", "70000"]),
            ("[line.mqtt]\nbroker = \"127.0.0.1:1\"\ntopic = \"a/#\"", ["line.mqtt.topic", "a/#"]),
            ("[line.mqtt]\nbroker = \"127.0.0.1:1\"\nclient = \"\"", ["line.mqtt.client", "0 bytes"]),
            ("[line.mqtt]\nbroker = \"127.0.0.1:1\"\nretain = true", ["retain", "unknown"]),
            (
                "[line.opcua]\nlisten = \"0.0.0.0:4840\"\npki_folder = \"pki\"",
                ["line.opcua.listen", "credentials_file"],
            ),
            ("[line.modbus]\nlisten = \"0.0.0.0:502\"", ["line.modbus.listen", "0.0.0.0:502"]),
            ("[line.modbus]\nlisten = \"here\"", ["listen", "address"]),
            (
                "[line.opcua]\nlisten = \"127.0.0.1:4840\"\n[line.modbus]\nlisten = \"127.0.0.1:4840\"",
                ["line.modbus.listen", "line.opcua.listen"],
            ),
        ] {
            let said = refused(wrong);
            assert!(words.iter().all(|word| said.contains(word)), "{wrong}: {said}");
        }
    }
}
