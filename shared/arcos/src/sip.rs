//! The server information packet: how the robot is, ten times a second.

use crate::reader::Reader;
use crate::{Malformed, Packet};

/// What a sonar heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SonarRange {
    /// The number of the sonar, from 0.
    pub number: u8,
    /// Range in counts: see [`crate::Parameters::range_mm_per_count`].
    pub range: u16,
}

/// How the robot is, in its own counts.
///
/// Fields that are options were added over the years: older firmware ends earlier.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Sip {
    /// Whether it says that it moves. Not all do: believe the speeds.
    pub is_moving: bool,
    /// Position along its own x axis, in 15 bits: see [`crate::Counter`].
    pub x: u16,
    /// Position along its own y axis, in 15 bits: see [`crate::Counter`].
    pub y: u16,
    /// Heading, counter-clockwise, in the robot's counts.
    pub heading: i16,
    /// Speed of the left wheels.
    pub left_speed: i16,
    /// Speed of the right wheels.
    pub right_speed: i16,
    /// Battery, tenths of a volt.
    pub battery: u8,
    /// Bit 0: the left wheels stall; bit 8: the right ones; all others: bumpers.
    pub stalls_and_bumpers: u16,
    /// Set point of the heading's servo.
    pub control: i16,
    /// Bit 0: motors are on; bits 1 to 4: arrays of sonars are on.
    pub flags: u16,
    /// Compass, two degrees.
    pub compass: u8,
    /// What the sonars heard since the packet before. Robots list those that fired, simulators all of them.
    pub sonars: Vec<SonarRange>,
    /// State of the gripper.
    pub gripper: Option<u8>,
    /// Number of the analog port.
    pub analog_port: Option<u8>,
    /// Value of the analog port.
    pub analog: Option<u8>,
    /// State of the digital inputs, a bit each.
    pub digital_in: Option<u8>,
    /// State of the digital outputs, a bit each.
    pub digital_out: Option<u8>,
    /// Battery, tenths of a volt, for those of more than 25.5 V.
    pub wide_battery: Option<u16>,
    /// State of the charger.
    pub charge: Option<u8>,
    /// Turn rate, tenths of a degree per second.
    pub turn_rate: Option<i16>,
    /// The faults of the robot, a bit each.
    pub faults: Option<u16>,
    /// Speed to the side, in the robot's counts.
    pub lateral_speed: Option<i16>,
    /// Temperature, °C; −127: not known.
    pub temperature: Option<i8>,
    /// Charge left, percent.
    pub state_of_charge: Option<u8>,
}

impl Sip {
    /// Ids of those of a robot that stands.
    pub const STOPPED: u8 = 0x32;
    /// … and of one that moves.
    pub const MOVING: u8 = 0x33;

    /// Whether a packet is one.
    #[must_use]
    pub fn is_one(packet: &Packet) -> bool {
        matches!(packet.id(), Self::STOPPED | Self::MOVING)
    }

    /// Reads one, as far as it goes; what follows the last known field is left alone.
    ///
    /// # Errors
    /// It ends before the speeds of the wheels, or within a field.
    pub fn read(packet: &Packet) -> Result<Self, Malformed> {
        let mut reader = Reader::new(packet);
        let r = &mut reader;
        let mut sip = Self {
            is_moving: packet.id() == Self::MOVING,
            x: r.u16("x position")?,
            y: r.u16("y position")?,
            heading: r.i16("heading")?,
            left_speed: r.i16("left wheel's speed")?,
            right_speed: r.i16("right wheel's speed")?,
            battery: r.later("battery", Reader::u8)?.unwrap_or_default(),
            stalls_and_bumpers: r.later("stalls and bumpers", Reader::u16)?.unwrap_or_default(),
            control: r.later("control", Reader::i16)?.unwrap_or_default(),
            flags: r.later("flags", Reader::u16)?.unwrap_or_default(),
            compass: r.later("compass", Reader::u8)?.unwrap_or_default(),
            ..Self::default()
        };
        let count = r.later("number of sonars", Reader::u8)?.unwrap_or_default();
        for _ in 0..count {
            sip.sonars.push(SonarRange { number: r.u8("sonars")?, range: r.u16("sonars")? });
        }
        sip.gripper = r.later("gripper", Reader::u8)?;
        sip.analog_port = r.later("analog port", Reader::u8)?;
        sip.analog = r.later("analog value", Reader::u8)?;
        sip.digital_in = r.later("digital inputs", Reader::u8)?;
        sip.digital_out = r.later("digital outputs", Reader::u8)?;
        sip.wide_battery = r.later("battery", Reader::u16)?;
        sip.charge = r.later("charge", Reader::u8)?;
        sip.turn_rate = r.later("turn rate", Reader::i16)?;
        sip.faults = r.later("faults", Reader::u16)?;
        sip.lateral_speed = r.later("sideways speed", Reader::i16)?;
        sip.temperature = r.later("temperature", Reader::u8)?.map(u8::cast_signed);
        sip.state_of_charge = r.later("state of charge", Reader::u8)?;
        Ok(sip)
    }

    /// The packet by which a robot sends it, up to the first field that is missing; none if it has too many sonars for one.
    #[must_use]
    pub fn packet(&self) -> Option<Packet> {
        let mut bytes = Vec::with_capacity(90);
        bytes.extend([self.x & 0x7FFF, self.y & 0x7FFF].map(u16::to_le_bytes).as_flattened());
        bytes.extend([self.heading, self.left_speed, self.right_speed].map(i16::to_le_bytes).as_flattened());
        bytes.push(self.battery);
        bytes.extend(self.stalls_and_bumpers.to_le_bytes());
        bytes.extend(self.control.to_le_bytes());
        bytes.extend(self.flags.to_le_bytes());
        bytes.extend([self.compass, u8::try_from(self.sonars.len()).ok()?]);
        for SonarRange { number, range } in &self.sonars {
            bytes.push(*number);
            bytes.extend(range.to_le_bytes());
        }
        self.add_later(&mut bytes);
        Packet::new(if self.is_moving { Self::MOVING } else { Self::STOPPED }, &bytes)
    }

    /// The fields that came later, up to the first that is missing.
    fn add_later(&self, bytes: &mut Vec<u8>) -> Option<()> {
        bytes.push(self.gripper?);
        bytes.push(self.analog_port?);
        bytes.push(self.analog?);
        bytes.push(self.digital_in?);
        bytes.push(self.digital_out?);
        bytes.extend(self.wide_battery?.to_le_bytes());
        bytes.push(self.charge?);
        bytes.extend(self.turn_rate?.to_le_bytes());
        bytes.extend(self.faults?.to_le_bytes());
        bytes.extend(self.lateral_speed?.to_le_bytes());
        bytes.push(self.temperature?.cast_unsigned());
        bytes.push(self.state_of_charge?);
        Some(())
    }

    /// Volts of the battery.
    #[must_use]
    pub fn battery_v(&self) -> f64 {
        f64::from(self.wide_battery.filter(|tenths| *tenths > 0).unwrap_or_else(|| u16::from(self.battery))) * 0.1
    }

    /// Whether the left and the right wheels stall.
    #[must_use]
    pub fn stalls(&self) -> [bool; 2] {
        [self.stalls_and_bumpers & 1 != 0, self.stalls_and_bumpers & 0x100 != 0]
    }

    /// Bumpers that are pressed, front ones in the higher byte.
    #[must_use]
    pub fn bumpers(&self) -> u16 {
        self.stalls_and_bumpers & !0x101
    }

    /// Whether its motors are on.
    #[must_use]
    pub fn motors_on(&self) -> bool {
        self.flags & 1 != 0
    }
}
