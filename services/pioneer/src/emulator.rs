//! The other side of the line: any sensor of the graph behind the door of a Pioneer.
//!
//! The robot's time begins when its first session is opened. What its sonars hear is listed as a real robot does it: those that fired
//! since the packet before, in the order in which they did.

mod door;

use core::time::Duration;
use std::collections::VecDeque;

use anyhow::Result;
use echogrid_arcos::{Argument, Command, Configuration, Decoder, Identity, Packet, Parameters, Sip, SonarRange};
use echogrid_core::{Echo, Pose2, Reading, wrap_angle};
use echogrid_service::Sensor;
use echogrid_topics::{Command as Order, Message, RawOdometry};

pub use door::{Door, serve};

/// From one information packet to the next.
const CYCLE: Duration = Duration::from_millis(100);
/// A ring of sonars is known when its last one has fired: so far ahead the world is asked.
const AHEAD: Duration = Duration::from_millis(700);
const WATCHDOG: Duration = Duration::from_secs(2);
/// What a sonar tells that heard nothing, mm.
const NO_ECHO_MM: f64 = 5000.0;
const BATTERY_DV: u8 = 129;

/// What the emulated robot says of itself.
#[derive(Debug, Clone)]
pub struct Who {
    /// Name and model of the robot.
    pub identity: Identity,
    /// What its counts mean.
    pub parameters: Parameters,
    /// The time from one firing of an array to the next, milliseconds.
    pub sonar_cycle_ms: u8,
}

impl Who {
    /// A robot of a model whose counts are known; none if they are not.
    #[must_use]
    pub fn of(subclass: &str, sonar_cycle_ms: u8) -> Option<Self> {
        let parameters = crate::models::parameters_of(subclass)?;
        let identity = Identity { name: "emulated".into(), class: "Pioneer".into(), subclass: subclass.into() };
        Some(Self { identity, parameters, sonar_cycle_ms })
    }
}

/// An emulated robot: packets in, packets out.
#[derive(Debug)]
pub struct Emulator<S> {
    who: Who,
    world: S,
    decoder: Decoder,
    /// Steps of synchronisation that were taken.
    steps: u8,
    is_open: bool,
    sonar: bool,
    motors: bool,
    v_mps: f64,
    w_radps: f64,
    /// When the first session was opened, and when the client was heard last.
    began: Option<Duration>,
    heard: Duration,
    /// The next packet is due, in the world's time.
    due: Duration,
    told: Duration,
    asked_ns: u64,
    is_over: bool,
    odometry: VecDeque<(u64, RawOdometry)>,
    now: Option<RawOdometry>,
    origin: Pose2,
    fired: VecDeque<(u64, Reading)>,
    sips: u64,
}

impl<S: Sensor> Emulator<S> {
    /// A robot that waits for somebody to open a session.
    pub fn new(who: Who, world: S) -> Self {
        Self {
            who,
            world,
            decoder: Decoder::default(),
            steps: 0,
            is_open: false,
            sonar: false,
            motors: false,
            v_mps: 0.0,
            w_radps: 0.0,
            began: None,
            heard: Duration::ZERO,
            due: CYCLE,
            told: Duration::ZERO,
            asked_ns: 0,
            is_over: false,
            odometry: VecDeque::new(),
            now: None,
            origin: Pose2::IDENTITY,
            fired: VecDeque::new(),
            sips: 0,
        }
    }

    /// Whether the world has come to its end; the robot then stands where it is.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.is_over && self.odometry.is_empty()
    }

    /// Whether a session is open.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Information packets sent so far.
    #[must_use]
    pub fn sips(&self) -> u64 {
        self.sips
    }

    /// What the client sent, and what is due by now: what goes back.
    ///
    /// # Errors
    /// The world's.
    pub fn step(&mut self, bytes: &[u8], now: Duration) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        self.decoder.push(bytes);
        while let Some(found) = self.decoder.next_packet() {
            self.heard = now;
            self.packet(&found.packet, now, &mut out)?;
        }
        if self.motors && now > self.heard + WATCHDOG {
            self.drive(0.0, 0.0);
            self.motors = false;
        }
        let Some(began) = self.began else { return Ok(out) };
        let world_now = now.saturating_sub(began);
        while self.due <= world_now {
            let due = self.due;
            self.due += CYCLE;
            let sip = self.sip(due)?;
            if self.is_open {
                self.sips += 1;
                out.extend(sip.packet().iter().flat_map(|packet| packet.bytes().to_vec()));
            }
        }
        Ok(out)
    }

    fn packet(&mut self, packet: &Packet, now: Duration, out: &mut Vec<u8>) -> Result<()> {
        if !self.is_open {
            match (packet.id(), self.steps) {
                (0, _) => self.steps = 1,
                (1, 1 | 2) => self.steps = 2,
                (2, 2 | 3) => {
                    self.steps = 3;
                    out.extend(self.who.identity.packet().iter().flat_map(|packet| packet.bytes().to_vec()));
                    return Ok(());
                }
                (1, 3) => return self.open(now),
                _ => return Ok(()),
            }
            out.extend(Command::sync(packet.id()).bytes());
            return Ok(());
        }
        let value = match Argument::of(packet) {
            Some(Argument::Integer(value)) => value,
            _ => 0,
        };
        match Command::of(packet) {
            Some(Command::Close) => {
                self.drive(0.0, 0.0);
                (self.is_open, self.steps, self.sonar, self.motors) = (false, 0, false, false);
            }
            Some(Command::Sonar) => self.sonar = value != 0,
            Some(Command::Enable) => {
                if value == 0 {
                    self.drive(0.0, 0.0);
                }
                self.motors = value != 0;
            }
            Some(Command::Velocity) => self.drive(f64::from(value) * 1e-3, self.w_radps),
            Some(Command::TurnRate) => self.drive(self.v_mps, f64::from(value).to_radians()),
            Some(Command::Stop | Command::EmergencyStop) => self.drive(0.0, 0.0),
            Some(Command::SetOrigin) => self.origin = self.now.map_or(self.origin, |now| now.odom_from_base),
            Some(Command::Config) => {
                let Identity { name, class, subclass } = self.who.identity.clone();
                let told = Configuration {
                    name,
                    class,
                    subclass,
                    serial_number: "0".into(),
                    sip_cycle_ms: 100,
                    front_sonar: true,
                    rear_sonar: true,
                    low_battery: 115,
                    watchdog_ms: 2000,
                    turn_rate_max: 100,
                    speed_max: 750,
                    sonar_cycle_ms: self.who.sonar_cycle_ms,
                    firmware: "1.0".into(),
                    ..Configuration::default()
                };
                out.extend(told.packet().iter().flat_map(|packet| packet.bytes().to_vec()));
            }
            _ => {}
        }
        Ok(())
    }

    /// A session begins; the robot counts from where it is.
    fn open(&mut self, now: Duration) -> Result<()> {
        self.is_open = true;
        if self.began.is_none() {
            self.began = Some(now);
            self.ask(Duration::ZERO)?;
            self.go_to(0);
        }
        self.origin = self.now.map_or(self.origin, |now| now.odom_from_base);
        Ok(())
    }

    /// As it drives on its own where nobody may drive it.
    fn drive(&mut self, v_mps: f64, w_radps: f64) {
        (self.v_mps, self.w_radps) = (v_mps, w_radps);
        if self.motors {
            // A world that can't be driven goes its own way.
            let _ = self.world.command(Order::Drive { v_mps, w_radps });
        }
    }

    /// Has the world go on until after this time of it.
    fn ask(&mut self, until: Duration) -> Result<()> {
        let until_ns = nanoseconds(until + AHEAD);
        while !self.is_over && self.asked_ns <= until_ns {
            let Some((stamp_ns, message)) = self.world.next()? else {
                self.is_over = true;
                break;
            };
            self.asked_ns = self.asked_ns.max(stamp_ns);
            match message {
                Message::Odometry(odometry) => self.odometry.push_back((stamp_ns, odometry)),
                Message::Scan(readings) => {
                    let timed = readings
                        .into_iter()
                        .map(|reading| (stamp_ns.saturating_add_signed(i64::from(reading.offset_ns)), reading));
                    self.fired.extend(timed);
                    self.fired.make_contiguous().sort_by_key(|(at_ns, reading)| (*at_ns, reading.transducer));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn go_to(&mut self, now_ns: u64) {
        while let Some((stamp_ns, odometry)) = self.odometry.front().copied()
            && stamp_ns <= now_ns
        {
            self.now = Some(odometry);
            self.odometry.pop_front();
        }
    }

    /// The information packet of this time of the world.
    fn sip(&mut self, at: Duration) -> Result<Sip> {
        self.ask(at)?;
        let at_ns = nanoseconds(at);
        self.go_to(at_ns);
        self.told = at;
        let p = &self.who.parameters;
        let mut sonars = Vec::new();
        while let Some((fired_ns, reading)) = self.fired.front()
            && *fired_ns <= at_ns
        {
            let range_mm = match reading.echo {
                Echo::Hit { range_m } => range_m * 1e3,
                Echo::NoEcho => NO_ECHO_MM,
                Echo::Invalid => 0.0,
            };
            let range = (range_mm / p.range_mm_per_count).round().clamp(0.0, f64::from(u16::MAX)) as u16;
            if let (true, Ok(number)) = (self.sonar, u8::try_from(reading.transducer)) {
                sonars.push(SonarRange { number, range });
            }
            self.fired.pop_front();
        }
        let standing = RawOdometry { odom_from_base: self.origin, v_mps: 0.0, w_radps: 0.0 };
        let RawOdometry { odom_from_base, v_mps, w_radps } = self.now.unwrap_or(standing);
        let (v_mps, w_radps) = if self.is_over() { (0.0, 0.0) } else { (v_mps, w_radps) };
        let here = self.origin.inverse() * odom_from_base;
        // In whole counts, and 15 bits of them.
        let counts = |metres: f64| ((metres * 1e3 / p.distance_mm_per_count).round() as i64 & 0x7FFF) as u16;
        let half_difference = w_radps / p.turn_per_difference;
        let speed = |mmps: f64| (mmps / p.speed_mmps_per_count).round() as i16;
        Ok(Sip {
            is_moving: v_mps != 0.0 || w_radps != 0.0,
            x: counts(here.x),
            y: counts(here.y),
            heading: (wrap_angle(here.theta) / p.angle_rad_per_count).round() as i16,
            left_speed: speed(v_mps * 1e3 - half_difference),
            right_speed: speed(v_mps * 1e3 + half_difference),
            battery: BATTERY_DV,
            flags: u16::from(self.motors) | (u16::from(self.sonar) << 1),
            sonars,
            gripper: Some(0),
            analog_port: Some(0),
            analog: Some(0),
            digital_in: Some(0),
            digital_out: Some(0),
            wide_battery: Some(BATTERY_DV.into()),
            charge: Some(0),
            turn_rate: Some((w_radps.to_degrees() * 10.0).round() as i16),
            ..Sip::default()
        })
    }
}

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}
