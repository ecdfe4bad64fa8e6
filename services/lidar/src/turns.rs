//! From beams to scans: a turn of the lidar is one.

use core::f64::consts::TAU;

use echogrid_core::{Echo, Reading, Sensor};

use crate::codec::Beam;

/// A turn that takes longer has a hole: the lidar stood still, or its line did, nanoseconds.
const TURN_MAX_NS: u64 = 1_000_000_000;

/// Makes scans of beams: each beam is a reading of the bearing that it is nearest to.
#[derive(Debug, Clone)]
pub struct Turns {
    sensor: Sensor,
    /// When the turn began; none: it is not known yet, or has a hole.
    began_ns: Option<u64>,
    /// When the last beam came.
    last_ns: u64,
    /// By bearing: how far off it the beam was, radians, what it saw, and which part of the turn had passed.
    beams: Vec<Option<(f64, Echo, f64)>>,
    given_up: u64,
}

impl Turns {
    /// The turns of a lidar as the robot has it: bearings, and how far it sees.
    #[must_use]
    pub fn new(sensor: Sensor) -> Self {
        let beams = vec![None; usize::from(sensor.transducers)];
        Self { sensor, began_ns: None, last_ns: 0, beams, given_up: 0 }
    }

    /// Turns that were left out, as they had a hole.
    #[must_use]
    pub fn given_up(&self) -> u64 {
        self.given_up
    }

    /// What is half a turn is none: the line was cut.
    pub fn clear(&mut self) {
        self.given_up += u64::from(self.began_ns.take().is_some());
        self.beams.fill(None);
    }

    /// Takes a beam that came at this time, nanoseconds; with the first of a turn the one before it is whole: its beginning, and its
    /// readings.
    pub fn take(&mut self, beam: &Beam, came_ns: u64) -> Option<(u64, Vec<Reading>)> {
        let has_hole = came_ns < self.last_ns || came_ns - self.last_ns > TURN_MAX_NS;
        if self.began_ns.is_some() && has_hole {
            self.clear();
        }
        self.last_ns = came_ns;
        let mut whole = None;
        if beam.begins_turn {
            whole = self.scan(came_ns);
            self.began_ns = Some(came_ns);
            self.beams.fill(None);
        }
        if self.began_ns.is_some() {
            self.put(beam);
        }
        whole
    }

    fn put(&mut self, beam: &Beam) {
        let Sensor { first_bearing_rad, bearing_step_rad, range_min_m, range_max_m, .. } = self.sensor;
        let step = bearing_step_rad.abs();
        if step <= 0.0 {
            return;
        }
        // Counter-clockwise, as bearings are.
        let bearing_rad = -beam.clockwise_rad;
        let from_first = (bearing_rad - first_bearing_rad) * bearing_step_rad.signum();
        // Half a step before the first belongs to it.
        let along = (from_first + 0.5 * step).rem_euclid(TAU) / step;
        let Some(place) = self.beams.get_mut(along as usize) else { return };
        let off_rad = (along.fract() - 0.5).abs() * step;
        if place.is_some_and(|(nearest_rad, ..)| nearest_rad <= off_rad) {
            return;
        }
        let echo = match beam.range_m {
            range_m if range_m >= range_max_m => Echo::NoEcho,
            range_m if range_m > 0.0 && range_m >= range_min_m => Echo::Hit { range_m },
            // It does not tell what it could not see from what is not there.
            _ => Echo::Invalid,
        };
        *place = Some((off_rad, echo, beam.clockwise_rad / TAU));
    }

    /// The turn that ends now.
    fn scan(&self, ended_ns: u64) -> Option<(u64, Vec<Reading>)> {
        let began_ns = self.began_ns?;
        let took_ns = ended_ns.checked_sub(began_ns).filter(|took_ns| *took_ns <= TURN_MAX_NS)?;
        let readings: Vec<Reading> = (self.sensor.first_transducer..)
            .zip(&self.beams)
            .filter_map(|(transducer, beam)| {
                let (_, echo, passed) = (*beam)?;
                Some(Reading { transducer, echo, offset_ns: (passed * took_ns as f64) as i32 })
            })
            .collect();
        (!readings.is_empty()).then_some((began_ns, readings))
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::{Pose2, SensorKind};

    use super::*;

    fn lidar(first_bearing_rad: f64, bearing_step_rad: f64, transducers: u16) -> Sensor {
        Sensor {
            kind: SensorKind::Lidar,
            base_from_sensor: Pose2::IDENTITY,
            first_transducer: 3,
            transducers,
            first_bearing_rad,
            bearing_step_rad,
            aperture_rad: 0.01,
            range_min_m: 0.1,
            range_max_m: 8.0,
            range_error_ratio: 0.01,
        }
    }

    /// Turns of 100 ms in steps of two degrees; a beam sees as many centimetres as it has degrees, clockwise, and a metre more.
    fn turns(of: &mut Turns, count: u64) -> Vec<(u64, Vec<Reading>)> {
        let beam = |n: u64| {
            let clockwise_rad = ((n % 180) as f64 * 2.0).to_radians();
            let beam = Beam {
                clockwise_rad,
                range_m: 1.0 + (n % 180) as f64 * 0.02,
                begins_turn: n.is_multiple_of(180),
                at: n,
            };
            (beam, 5_000_000_000 + n * 100_000_000 / 180)
        };
        (90..90 + count * 180).map(beam).filter_map(|(beam, came_ns)| of.take(&beam, came_ns)).collect()
    }

    #[test]
    fn a_turn_is_a_scan_with_the_bearings_of_the_robot() {
        let mut all = Turns::new(lidar(-core::f64::consts::PI, 2.0_f64.to_radians(), 180));
        let scans = turns(&mut all, 4);
        assert_eq!(scans.len(), 3, "the first half turn is none, and the last is not whole");
        assert_eq!(scans[0].0, 5_100_000_000);
        let of = |transducer: u16| scans[0].1.iter().find(|reading| reading.transducer == transducer).copied().unwrap();
        assert_eq!(scans[0].1.len(), 180);
        // Ahead; a quarter to the left, which is three quarters clockwise.
        assert_eq!((of(3 + 90).echo, of(3 + 90).offset_ns), (Echo::Hit { range_m: 1.0 }, 0));
        let Echo::Hit { range_m } = of(3 + 135).echo else { panic!("{:?}", of(3 + 135)) };
        assert!((range_m - 3.7).abs() < 1e-9 && (of(3 + 135).offset_ns - 75_000_000).abs() < 1000, "{range_m}");
    }

    #[test]
    fn a_narrow_view_takes_what_lies_in_it() {
        // From 20° to -20°, to the right.
        let mut narrow = Turns::new(lidar(20.0_f64.to_radians(), -4.0_f64.to_radians(), 11));
        let scans = turns(&mut narrow, 3);
        let readings = &scans[0].1;
        assert_eq!(readings.iter().map(|reading| reading.transducer).collect::<Vec<_>>(), (3..14).collect::<Vec<_>>());
        assert_eq!(readings[5].echo, Echo::Hit { range_m: 1.0 }, "of several beams the nearest counts");
    }

    #[test]
    fn too_near_too_far_and_nothing_are_told_apart() {
        let mut turns = Turns::new(lidar(0.0, 1.0, 6));
        let beam = |clockwise_rad: f64, range_m: f64| Beam {
            clockwise_rad,
            range_m,
            begins_turn: clockwise_rad == 0.0,
            at: 0,
        };
        turns.take(&beam(0.0, 2.0), 0);
        turns.take(&beam(TAU - 1.0, 0.0), 10);
        turns.take(&beam(TAU - 2.0, 0.05), 20);
        turns.take(&beam(TAU - 3.0, 9.0), 30);
        let (_, readings) = turns.take(&beam(0.0, 2.0), 100).unwrap();
        let echoes: Vec<Echo> = readings.iter().map(|reading| reading.echo).collect();
        assert_eq!(echoes, [Echo::Hit { range_m: 2.0 }, Echo::Invalid, Echo::Invalid, Echo::NoEcho]);
    }

    #[test]
    fn a_turn_with_a_hole_is_left_out() {
        let mut turns = Turns::new(lidar(0.0, 1.0, 6));
        let begin = Beam { clockwise_rad: 0.0, range_m: 2.0, begins_turn: true, at: 0 };
        assert_eq!(turns.take(&begin, 0), None);
        assert_eq!(turns.take(&begin, 5_000_000_000), None);
        assert_eq!(turns.given_up(), 1);
        assert!(turns.take(&begin, 5_100_000_000).is_some());
    }
}
