//! The transport of lines: a TCP connection or a serial port.

use std::fmt;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream, ToSocketAddrs as _};
use std::time::Duration;

use serialport::{ClearBuffer, SerialPort};

/// How long it may take to connect, and to write a line.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// Prefix of the address of a serial port.
pub(crate) const SERIAL: &str = "serial:";

/// Speed of a serial port whose address names none.
const BAUD_RATE: u32 = 115_200;

/// What lines go over.
pub(super) enum Stream {
    Tcp(TcpStream),
    Serial(Box<dyn SerialPort>),
}

impl fmt::Debug for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(stream) => stream.fmt(f),
            Self::Serial(port) => write!(f, "serial port {:?}", port.name()),
        }
    }
}

impl Stream {
    /// Connects to `HOST:PORT`, or opens `serial:PATH` or `serial:PATH@BAUD`.
    pub(super) fn open(address: &str) -> Result<Self, String> {
        match address.strip_prefix(SERIAL) {
            Some(port) => {
                let (path, baud_rate) = serial_port(port)?;
                let port = serialport::new(path, baud_rate).timeout(CONNECT_TIMEOUT).open();
                let port = port.map_err(|error| error.to_string())?;
                // Earlier input does not concern this station.
                port.clear(ClearBuffer::Input).map_err(|error| error.to_string())?;
                Ok(Self::Serial(port))
            }
            None => connect(address).map(Self::Tcp),
        }
    }

    /// A second handle; its reads wait for `read_timeout`.
    pub(super) fn split(&mut self, read_timeout: Duration) -> io::Result<Self> {
        match self {
            Self::Tcp(stream) => {
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(read_timeout))?;
                stream.set_write_timeout(Some(CONNECT_TIMEOUT))?;
                stream.try_clone().map(Self::Tcp)
            }
            Self::Serial(port) => {
                port.set_timeout(read_timeout)?;
                Ok(Self::Serial(port.try_clone()?))
            }
        }
    }

    /// Whether the other side must be asked for its name: it does not notice a listener.
    pub(super) fn has_no_connection(&self) -> bool {
        matches!(self, Self::Serial(_))
    }

    /// Ends a connection; its reads return.
    pub(super) fn close(&self) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.shutdown(Shutdown::Both),
            Self::Serial(_) => Ok(()),
        }
    }
}

impl Read for Stream {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(to),
            Self::Serial(port) => port.read(to),
        }
    }
}

impl Write for Stream {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.write(from),
            Self::Serial(port) => port.write(from),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.flush(),
            Self::Serial(port) => port.flush(),
        }
    }
}

/// Path and speed of a serial port.
fn serial_port(text: &str) -> Result<(&str, u32), String> {
    let (path, baud_rate) = match text.split_once('@') {
        Some((path, baud_rate)) => (path, baud_rate.parse().map_err(|_error| format!("{baud_rate:?} is not a speed"))?),
        None => (text, BAUD_RATE),
    };
    if path.is_empty() || baud_rate == 0 {
        return Err(format!("{text:?} is not PATH or PATH@BAUD"));
    }
    Ok((path, baud_rate))
}

/// What is wrong with the `address` of a rig, if anything is.
pub(crate) fn fault_of(address: &str) -> Option<String> {
    if let Some(port) = address.strip_prefix(SERIAL) {
        return serial_port(port).err();
    }
    let is_port = |port: &str| port.parse::<u16>().is_ok_and(|port| port > 0);
    let is_address = address.rsplit_once(':').is_some_and(|(host, port)| !host.is_empty() && is_port(port));
    (!is_address).then(|| format!("{address:?} is not HOST:PORT"))
}

fn connect(address: &str) -> Result<TcpStream, String> {
    let addresses = address.to_socket_addrs().map_err(|error| error.to_string())?;
    let mut reason = "the name has no address".to_owned();
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(stream) => return Ok(stream),
            Err(error) => reason = error.to_string(),
        }
    }
    Err(reason)
}
