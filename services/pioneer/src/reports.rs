//! What the robot tells, as odometry and rings of readings.

use echogrid_arcos::{Counter, Parameters, Sip};
use echogrid_core::{Echo, Pose2, Reading, Robot};
use echogrid_topics::{Message, RawOdometry};

/// Sonars of one array fire in turn: those of the front, and those of the rear.
const ARRAY: u8 = 8;
/// A ring is given out before its first reading is so old, nanoseconds.
const RING_NS: u64 = 900_000_000;
/// No robot drives faster: a packet that says so is damaged in a way that its checksum does not show, m/s and rad/s.
const FASTEST: f64 = 10.0;

/// Turns information packets into messages.
#[derive(Debug, Clone)]
pub struct Reports {
    parameters: Parameters,
    robot: Robot,
    /// The transducer of each sonar number.
    transducers: Vec<Option<u16>>,
    sonar_cycle_ns: u64,
    x: Counter,
    y: Counter,
    /// What the robot's own frame lies at in the odometry frame: it moves when the robot begins to count anew.
    odom_from_counts: Pose2,
    odom_from_base: Pose2,
    begins_anew: bool,
    first_ns: Option<u64>,
    last_ns: u64,
    /// Readings of the ring so far, with their times.
    ring: Vec<(u64, u16, Echo)>,
}

impl Reports {
    /// The reports of a robot whose counts mean what the parameters say.
    ///
    /// The robot's sonars are the transducers of `robot`, in the order of the parameters' sonars, or of their numbers.
    #[must_use]
    pub fn new(parameters: Parameters, robot: Robot) -> Self {
        let sonars = parameters.sonars.iter().enumerate();
        let mut transducers = vec![None; 256];
        for (index, sonar) in sonars {
            transducers[usize::from(sonar.number)] = u16::try_from(index).ok();
        }
        if parameters.sonars.is_empty() {
            transducers = (0..256_u16).map(Some).collect();
        }
        for transducer in &mut transducers {
            *transducer = transducer.filter(|number| robot.transducer(*number).is_some());
        }
        Self {
            parameters,
            robot,
            transducers,
            sonar_cycle_ns: 40_000_000,
            x: Counter::default(),
            y: Counter::default(),
            odom_from_counts: Pose2::IDENTITY,
            odom_from_base: Pose2::IDENTITY,
            begins_anew: false,
            first_ns: None,
            last_ns: 0,
            ring: Vec::new(),
        }
    }

    /// Sets the time from one firing of an array to the next, nanoseconds.
    pub fn set_sonar_cycle_ns(&mut self, sonar_cycle_ns: u64) {
        self.sonar_cycle_ns = sonar_cycle_ns;
    }

    /// The robot counts from another place from now on; it has not moved meanwhile, as far as anybody knows.
    pub fn begin_anew(&mut self) {
        self.begins_anew = self.first_ns.is_some();
        self.x.restart();
        self.y.restart();
    }

    /// What a packet says that came at this time. None: what it says can't be.
    pub fn sip(&mut self, stamp_ns: u64, sip: &Sip) -> Option<Vec<(u64, Message)>> {
        // A clock that goes on while the machine sleeps may stand still, but never runs back.
        let stamp_ns = stamp_ns.max(self.last_ns);
        let p = &self.parameters;
        let speed = |counts: i16| f64::from(counts) * p.speed_mmps_per_count * 1e-3;
        let (left_mps, right_mps) = (speed(sip.left_speed), speed(sip.right_speed));
        let v_mps = 0.5 * (left_mps + right_mps);
        let w_radps = 0.5 * (right_mps - left_mps) * 1e3 * p.turn_per_difference;
        if v_mps.abs() > FASTEST || w_radps.abs() > FASTEST {
            return None;
        }
        let (mut x, mut y) = (self.x, self.y);
        let metres = |counts: i64| counts as f64 * p.distance_mm_per_count * 1e-3;
        let told = Pose2::new(
            metres(x.follow(sip.x)),
            metres(y.follow(sip.y)),
            f64::from(sip.heading) * p.angle_rad_per_count,
        );
        if self.begins_anew {
            self.odom_from_counts = self.odom_from_base * told.inverse();
        } else if self.first_ns.is_some() {
            let way_m = self.odom_from_base.distance_m(self.odom_from_counts * told);
            let seconds = (stamp_ns - self.last_ns) as f64 * 1e-9;
            // In a second, and a little more, as its packets may come late and in one go.
            if way_m > FASTEST * (seconds + 1.0) {
                return None;
            }
        }
        (self.x, self.y, self.begins_anew) = (x, y, false);
        self.odom_from_base = self.odom_from_counts * told;
        // What sonars heard before the first pose has none.
        let before_ns = self.first_ns.map(|_| self.last_ns);
        self.first_ns.get_or_insert(stamp_ns);
        self.last_ns = stamp_ns;
        let odometry = RawOdometry { odom_from_base: self.odom_from_base, v_mps, w_radps };
        let mut messages = vec![(stamp_ns, Message::Odometry(odometry))];
        if let Some(before_ns) = before_ns {
            self.hear(before_ns, stamp_ns, sip, &mut messages);
        }
        Some(messages)
    }

    /// The sonars of a packet join the ring; what is whole goes out.
    fn hear(&mut self, before_ns: u64, stamp_ns: u64, sip: &Sip, messages: &mut Vec<(u64, Message)>) {
        let count = |array: u8| sip.sonars.iter().filter(|sonar| sonar.number / ARRAY == array).count() as u64;
        let mut heard = [0_u64; 256 / ARRAY as usize];
        for sonar in &sip.sonars {
            let array = sonar.number / ARRAY;
            let before = &mut heard[usize::from(array)];
            // Those of an array one after the other, the last of them half a cycle ago; none before the last packet.
            let of = count(array);
            let cycle_ns = self.sonar_cycle_ns.min((stamp_ns - before_ns) / of.max(1));
            let at_ns = stamp_ns - (of - 1 - *before) * cycle_ns - cycle_ns / 2;
            *before += 1;
            let Some(Some(transducer)) = self.transducers.get(usize::from(sonar.number)).copied() else { continue };
            if self.ring.iter().any(|(_, other, _)| *other == transducer) {
                self.give(stamp_ns, messages);
            }
            self.ring.push((at_ns, transducer, self.echo(transducer, sonar.range)));
            if self.ring.len() == self.transducers.iter().flatten().count() {
                self.give(stamp_ns, messages);
            }
        }
        // A ring that is never whole, as a sonar is broken.
        if self.ring.first().is_some_and(|(first_ns, ..)| first_ns + RING_NS / 2 < stamp_ns) {
            self.give(stamp_ns, messages);
        }
    }

    fn echo(&self, transducer: u16, counts: u16) -> Echo {
        let range_m = f64::from(counts) * self.parameters.range_mm_per_count * 1e-3;
        match self.robot.transducer(transducer) {
            Some(sonar) if range_m > 0.0 && range_m < sonar.range_max_m => Echo::Hit { range_m },
            Some(_) if range_m > 0.0 => Echo::NoEcho,
            _ => Echo::Invalid,
        }
    }

    fn give(&mut self, stamp_ns: u64, messages: &mut Vec<(u64, Message)>) {
        // What is older was heard before the line was cut.
        self.ring.retain(|(at_ns, ..)| at_ns + RING_NS > stamp_ns);
        let mut readings: Vec<Reading> = Vec::with_capacity(self.ring.len());
        for (at_ns, transducer, echo) in self.ring.drain(..) {
            let offset_ns = i32::try_from(stamp_ns - at_ns).unwrap_or(i32::MAX);
            readings.push(Reading { transducer, echo, offset_ns: -offset_ns });
        }
        readings.sort_by_key(|reading| reading.transducer);
        if !readings.is_empty() {
            messages.push((stamp_ns, Message::Scan(readings)));
        }
    }
}
