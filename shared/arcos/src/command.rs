//! What a client tells the robot.

use crate::Packet;

/// Argument types, as they go before the value.
const INTEGER: u8 = 0x3B;
const NEGATIVE: u8 = 0x1B;
const TEXT: u8 = 0x2B;

/// What a client can ask for; the number is the packet's id.
///
/// While a session is being opened 0, 1 and 2 mean synchronisation ([`Command::sync`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Command {
    /// Nothing, but the client is alive: keeps the robot's watchdog quiet.
    Pulse = 0,
    /// Opens the session.
    Open = 1,
    /// Closes it; motors and sonars go off.
    Close = 2,
    /// In which order the sonars fire (text of sonar numbers, from 1).
    Polling = 3,
    /// Motors on (1) or off (0).
    Enable = 4,
    /// Translational acceleration, mm/s²; negative: deceleration.
    SetAcceleration = 5,
    /// The greatest speed, mm/s.
    SetSpeed = 6,
    /// The robot's own position becomes 0, 0, 0.
    SetOrigin = 7,
    /// Speed, mm/s; negative: backwards.
    Velocity = 11,
    /// Asks for a configuration packet (1).
    Config = 18,
    /// Turn rate, degrees per second; counter-clockwise positive.
    TurnRate = 21,
    /// Sonars on (1) or off (0).
    Sonar = 28,
    /// Stops, and holds still.
    Stop = 29,
    /// Changes the speed of the serial line: a [`Baud`].
    HostBaud = 50,
    /// Stops as hard as the robot can.
    EmergencyStop = 55,
}

impl Command {
    /// Every command.
    pub const ALL: [Self; 15] = [
        Self::Pulse,
        Self::Open,
        Self::Close,
        Self::Polling,
        Self::Enable,
        Self::SetAcceleration,
        Self::SetSpeed,
        Self::SetOrigin,
        Self::Velocity,
        Self::Config,
        Self::TurnRate,
        Self::Sonar,
        Self::Stop,
        Self::HostBaud,
        Self::EmergencyStop,
    ];

    /// The command of this id, if it is known here.
    #[must_use]
    pub fn of(packet: &Packet) -> Option<Self> {
        Self::ALL.into_iter().find(|command| *command as u8 == packet.id())
    }

    /// Step `n` (0, 1, 2) of opening a session; the robot answers with the same.
    #[must_use]
    pub fn sync(n: u8) -> Packet {
        short(n, &[])
    }

    /// The packet of the command without an argument.
    #[must_use]
    pub fn plain(self) -> Packet {
        short(self as u8, &[])
    }

    /// The packet of the command with a whole number; what does not fit is cut at ±65535.
    #[must_use]
    pub fn with(self, value: i32) -> Packet {
        let kind = if value < 0 { NEGATIVE } else { INTEGER };
        let [low, high] = u16::try_from(value.unsigned_abs()).unwrap_or(u16::MAX).to_le_bytes();
        short(self as u8, &[kind, low, high])
    }
}

/// A packet of so few arguments that it always fits.
fn short(id: u8, arguments: &[u8]) -> Packet {
    Packet::new(id, arguments).unwrap_or_else(|| unreachable!("a few bytes fit into a packet"))
}

/// What a command is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Argument<'a> {
    /// Nothing.
    None,
    /// A whole number.
    Integer(i32),
    /// Bytes.
    Text(&'a [u8]),
}

impl<'a> Argument<'a> {
    /// The argument of a client's packet; none if it is cut short or of no known type.
    #[must_use]
    pub fn of(packet: &'a Packet) -> Option<Self> {
        let (kind, value) = match packet.arguments() {
            [] => return Some(Self::None),
            [kind, value @ ..] => (*kind, value),
        };
        let magnitude = value.first_chunk().map(|low_high| i32::from(u16::from_le_bytes(*low_high)));
        match kind {
            INTEGER => magnitude.map(Self::Integer),
            NEGATIVE => magnitude.map(|magnitude| Self::Integer(-magnitude)),
            TEXT => {
                let (length, text) = value.split_first()?;
                text.get(..usize::from(*length)).map(Self::Text)
            }
            _ => None,
        }
    }
}

/// A speed of the serial line, as [`Command::HostBaud`] names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Baud {
    /// 9600 bit/s: what robots start with.
    B9600 = 0,
    /// 19200 bit/s.
    B19200 = 1,
    /// 38400 bit/s.
    B38400 = 2,
    /// 57600 bit/s.
    B57600 = 3,
    /// 115200 bit/s.
    B115200 = 4,
}

impl Baud {
    /// All of them, slowest first.
    pub const ALL: [Self; 5] = [Self::B9600, Self::B19200, Self::B38400, Self::B57600, Self::B115200];

    /// Bits per second.
    #[must_use]
    pub fn bits_per_s(self) -> u32 {
        match self {
            Self::B9600 => 9_600,
            Self::B19200 => 19_200,
            Self::B38400 => 38_400,
            Self::B57600 => 57_600,
            Self::B115200 => 115_200,
        }
    }

    /// The speed of so many bits per second.
    #[must_use]
    pub fn of_bits_per_s(bits_per_s: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|baud| baud.bits_per_s() == bits_per_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes as ARIA sends them.
    #[test]
    fn commands_are_those_of_the_robots() {
        let check = |packet: Packet, bytes: &str| {
            let words: Vec<String> = packet.bytes().iter().map(|byte| format!("{byte:02X}")).collect();
            assert_eq!(words.join(" "), bytes);
        };
        check(Command::sync(0), "FA FB 03 00 00 00");
        check(Command::sync(1), "FA FB 03 01 00 01");
        check(Command::sync(2), "FA FB 03 02 00 02");
        check(Command::Open.with(1), "FA FB 06 01 3B 01 00 02 3B");
        check(Command::Sonar.with(1), "FA FB 06 1C 3B 01 00 1D 3B");
        check(Command::Enable.with(1), "FA FB 06 04 3B 01 00 05 3B");
        check(Command::Velocity.with(200), "FA FB 06 0B 3B C8 00 D3 3B");
        check(Command::Velocity.with(-200), "FA FB 06 0B 1B C8 00 D3 1B");
        check(Command::TurnRate.with(-30), "FA FB 06 15 1B 1E 00 33 1B");
        check(Command::SetOrigin.plain(), "FA FB 03 07 00 07");
        check(Command::Close.with(1), "FA FB 06 02 3B 01 00 03 3B");
        check(Command::HostBaud.with(Baud::B38400 as i32), "FA FB 06 32 3B 02 00 34 3B");
    }

    #[test]
    fn what_is_told_is_understood() {
        for value in [0, 1, -1, 200, -200, 65_535, -65_535] {
            let packet = Command::Velocity.with(value);
            assert_eq!(
                (Command::of(&packet), Argument::of(&packet)),
                (Some(Command::Velocity), Some(Argument::Integer(value)))
            );
        }
        assert_eq!(Argument::of(&Command::Velocity.with(i32::MIN)), Some(Argument::Integer(-65_535)));
        assert_eq!(Argument::of(&Command::Pulse.plain()), Some(Argument::None));
        let order = Packet::new(3, b"\x2b\x02\x01\x05").unwrap();
        assert_eq!(Argument::of(&order), Some(Argument::Text(&[1, 5])));
        for cut in [&b"\x3b\x01"[..], b"\x2b\x02\x01", b"\x2b", b"\x00\x01\x02"] {
            assert_eq!(Argument::of(&Packet::new(3, cut).unwrap()), None);
        }
    }
}
