//! The configuration packet: how the robot is set up.

use crate::reader::Reader;
use crate::{Malformed, Packet};

/// What a robot says of its set-up; what it does not say is 0 or empty.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Configuration {
    /// Class, such as `Pioneer`.
    pub class: String,
    /// Model, such as `p3at-sh`.
    pub subclass: String,
    /// The serial number of the robot.
    pub serial_number: String,
    /// The robot's name.
    pub name: String,
    /// The time from one information packet to the next, milliseconds.
    pub sip_cycle_ms: u8,
    /// Whether it has sonars at the front.
    pub front_sonar: bool,
    /// Whether it has sonars at the rear.
    pub rear_sonar: bool,
    /// Below it the robot complains, tenths of a volt.
    pub low_battery: u16,
    /// Without a word from its client for so long it stops its motors, milliseconds; 0: it never does.
    pub watchdog_ms: u16,
    /// The fastest that it may turn, degrees per second.
    pub turn_rate_max: u16,
    /// The fastest that it may drive, mm/s.
    pub speed_max: u16,
    /// Bumpers at the front.
    pub front_bumpers: u8,
    /// Bumpers at the rear.
    pub rear_bumpers: u8,
    /// The time from one sonar's firing to that of the next of its array, milliseconds; 0: not told.
    pub sonar_cycle_ms: u8,
    /// Version of the firmware.
    pub firmware: String,
}

impl Configuration {
    /// The id of its packets.
    pub const ID: u8 = 0x20;

    /// Reads one. Old firmware may end after the watchdog.
    ///
    /// # Errors
    /// It ends before, or within a field.
    pub fn read(packet: &Packet) -> Result<Self, Malformed> {
        let mut reader = Reader::new(packet);
        let r = &mut reader;
        let (class, subclass, serial_number) = (r.text("class")?, r.text("subclass")?, r.text("serial number")?);
        r.u8("motor type")?;
        for top in ["turn rate", "speed", "turn acceleration", "acceleration", "pulse width"] {
            r.u16(top)?;
        }
        let name = r.text("name")?;
        let sip_cycle_ms = r.u8("cycle")?;
        r.u16("line speeds")?;
        r.u16("gripper")?;
        let (front_sonar, rear_sonar) = (r.u16("front sonars")? != 0, r.u8("rear sonars")? != 0);
        let low_battery = r.u16("low battery")?;
        r.u16("counts of a turn")?;
        let mut told = Self {
            class,
            subclass,
            serial_number,
            name,
            sip_cycle_ms,
            front_sonar,
            rear_sonar,
            low_battery,
            watchdog_ms: r.u16("watchdog")?,
            ..Self::default()
        };
        // What follows only helps: a shorter packet has none of it.
        let _ = told.read_later(r);
        Ok(told)
    }

    fn read_later(&mut self, r: &mut Reader<'_>) -> Result<(), Malformed> {
        r.u8("packets")?;
        for setting in ["stall value", "stall count", "joystick speed", "joystick turn rate"] {
            r.u16(setting)?;
        }
        self.turn_rate_max = r.u16("turn rate")?;
        self.speed_max = r.u16("speed")?;
        for _ in 0..10 {
            r.u16("accelerations and gains")?;
        }
        self.front_bumpers = r.u8("front bumpers")?;
        self.rear_bumpers = r.u8("rear bumpers")?;
        r.u8("charger")?;
        self.sonar_cycle_ms = r.u8("sonar cycle")?;
        r.u16("line speed and gyroscope")?;
        for _ in 0..4 {
            r.u16("drift, ports, ticks and voltage")?;
        }
        self.firmware = r.text("firmware")?;
        Ok(())
    }

    /// The packet by which a robot sends it; none if the texts are too long for one.
    #[must_use]
    pub fn packet(&self) -> Option<Packet> {
        let mut bytes = Vec::with_capacity(120);
        let text = |bytes: &mut Vec<u8>, text: &str| bytes.extend(text.bytes().chain([0]));
        let words = |bytes: &mut Vec<u8>, words: &[u16]| words.iter().for_each(|word| bytes.extend(word.to_le_bytes()));
        text(&mut bytes, &self.class);
        text(&mut bytes, &self.subclass);
        text(&mut bytes, &self.serial_number);
        bytes.push(0);
        words(&mut bytes, &[360, 2200, 600, 4000, 500]);
        text(&mut bytes, &self.name);
        bytes.extend([self.sip_cycle_ms, 0, 0]);
        words(&mut bytes, &[0, self.front_sonar.into()]);
        bytes.push(self.rear_sonar.into());
        words(&mut bytes, &[self.low_battery, 0, self.watchdog_ms]);
        bytes.push(0);
        words(&mut bytes, &[0, 0, 0, 0, self.turn_rate_max, self.speed_max]);
        words(&mut bytes, &[0; 10]);
        bytes.extend([self.front_bumpers, self.rear_bumpers, 0, self.sonar_cycle_ms, 0, 0]);
        words(&mut bytes, &[0; 4]);
        text(&mut bytes, &self.firmware);
        Packet::new(Self::ID, &bytes)
    }
}
