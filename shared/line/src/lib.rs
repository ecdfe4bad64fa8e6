//! A line to what measures: a serial device or TCP. What is said over it is up to others.

use std::collections::BTreeSet;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serial2::SerialPort;

/// Where the other side is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// A serial device.
    Device(PathBuf),
    /// A host and a port.
    Tcp(String),
}

/// A look at the line takes no longer than this.
const PATIENCE: Duration = Duration::from_millis(20);
/// Who takes nothing for so long does not listen.
const WRITTEN_WITHIN: Duration = Duration::from_millis(500);
const CONNECTED_WITHIN: Duration = Duration::from_millis(500);

impl Address {
    /// `tcp:HOST:PORT`, or the path of a device; none if it is neither.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        match text.strip_prefix("tcp:") {
            Some(address) => {
                let (host, port) = address.rsplit_once(':')?;
                let is_address = !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0);
                is_address.then(|| Self::Tcp(address.to_owned()))
            }
            None => (!text.is_empty() && !text.contains('\0')).then(|| Self::Device(text.into())),
        }
    }

    /// Devices that the same adapter would get for want of this one: those of its kind.
    #[must_use]
    pub fn relatives(&self) -> BTreeSet<PathBuf> {
        let Self::Device(path) = self else { return BTreeSet::new() };
        let (Some(folder), Some(name)) = (path.parent(), path.file_name().and_then(|name| name.to_str())) else {
            return BTreeSet::new();
        };
        let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
        let is_relative = |other: &Path| {
            let number = other.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_prefix(stem));
            number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
        };
        if stem.len() == name.len() {
            return BTreeSet::new();
        }
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).filter(|other| is_relative(other)).collect()
    }
}

impl core::fmt::Display for Address {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Device(path) => path.display().fmt(f),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
        }
    }
}

/// An open line.
#[derive(Debug)]
pub enum Link {
    /// Serial.
    Serial(SerialPort),
    /// TCP.
    Tcp(TcpStream),
}

impl Link {
    /// Opens it, with 8 data bits, no parity, one stop bit.
    ///
    /// # Errors
    /// It is not there, or not ours to open.
    pub fn open(address: &Address, bits_per_s: u32) -> io::Result<Self> {
        match address {
            Address::Device(path) => {
                let mut port = SerialPort::open(path, bits_per_s)?;
                port.set_read_timeout(PATIENCE)?;
                port.set_write_timeout(WRITTEN_WITHIN)?;
                Ok(Self::Serial(port))
            }
            Address::Tcp(address) => {
                let mut last = io::Error::new(ErrorKind::NotFound, "no such host");
                for place in address.to_socket_addrs()? {
                    match TcpStream::connect_timeout(&place, CONNECTED_WITHIN) {
                        Ok(stream) => {
                            stream.set_nodelay(true)?;
                            stream.set_read_timeout(Some(PATIENCE))?;
                            stream.set_write_timeout(Some(WRITTEN_WITHIN))?;
                            return Ok(Self::Tcp(stream));
                        }
                        Err(error) => last = error,
                    }
                }
                Err(last)
            }
        }
    }

    /// What has come, after a short wait; nothing if there is nothing.
    ///
    /// # Errors
    /// The line is gone.
    pub fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = match self {
            Self::Serial(port) => port.read(into),
            Self::Tcp(stream) => stream.read(into),
        };
        match read {
            Ok(0) => Err(io::Error::new(ErrorKind::UnexpectedEof, "the line was closed")),
            Err(error)
                if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
            {
                Ok(0)
            }
            other => other,
        }
    }

    /// Sends all of it.
    ///
    /// # Errors
    /// The line is gone, or nobody takes it.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Serial(port) => port.write_all(bytes),
            Self::Tcp(stream) => stream.write_all(bytes),
        }
    }

    /// Goes on with another speed, once all was sent. TCP has none.
    ///
    /// # Errors
    /// The device has no such speed.
    pub fn set_baud(&mut self, bits_per_s: u32) -> io::Result<()> {
        let Self::Serial(port) = self else { return Ok(()) };
        port.flush()?;
        let mut settings = port.get_configuration()?;
        settings.set_baud_rate(bits_per_s)?;
        port.set_configuration(&settings)
    }

    /// Sets the wire "data terminal ready", which adapters of some lidars stop the motor by; where there is none, nothing happens.
    pub fn set_terminal_ready(&mut self, is_ready: bool) {
        if let Self::Serial(port) = self {
            // A pseudo-terminal has no wires.
            let _ = port.set_dtr(is_ready);
        }
    }

    /// Whether it has a speed.
    #[must_use]
    pub fn is_serial(&self) -> bool {
        matches!(self, Self::Serial(_))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_devices_or_hosts() {
        assert_eq!(Address::parse("/dev/ttyUSB0"), Some(Address::Device("/dev/ttyUSB0".into())));
        assert_eq!(Address::parse("tcp:robot:8101"), Some(Address::Tcp("robot:8101".into())));
        for wrong in ["", "tcp:", "tcp:8101", "tcp:robot", "tcp:robot:0", "tcp:robot:99999", "tcp::1"] {
            assert_eq!(Address::parse(wrong), None, "{wrong}");
        }
    }
}
