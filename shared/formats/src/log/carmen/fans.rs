//! How the beams of a lidar lie, scan by scan.
//!
//! Many lidars tell another number of beams in each scan, or begin elsewhere. The readings of a scan are named by transducers of
//! the robot, so each way in which beams lie is a sensor of its own, all at one mount, as long as these are few; scans whose beams
//! lie on one lattice share one. Where they are many, the bearings are those of a fine circle, and each is rounded to the nearest.

use std::collections::BTreeMap;

use core::f64::consts::{PI, TAU};

/// More ways than these are rounded to a circle of bearings.
const FANS_MAX: usize = 64;
/// Bearings that differ by less are the same: 2 cm at 100 m.
const SAME_RAD: f64 = 2e-4;
/// The widest that a beam is taken to be, full aperture: no lidar's light opens wider, however far apart its beams are.
pub(super) const BEAM_MAX_RAD: f64 = PI / 180.0;
/// The narrowest.
const BEAM_MIN_RAD: f64 = 1e-4;
/// Bearings of a circle: at most, and at least.
const CIRCLE_MAX: usize = 16_384;
const CIRCLE_MIN: usize = 2_048;

/// The full aperture of beams so far apart.
pub(super) fn aperture_rad(step_rad: f64) -> f64 {
    if step_rad == 0.0 { BEAM_MAX_RAD } else { step_rad.abs().clamp(BEAM_MIN_RAD, BEAM_MAX_RAD) }
}

/// Beams on a lattice of bearings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fan {
    /// Beam 0 of the lattice.
    origin_rad: f64,
    step_rad: f64,
    /// The lowest and highest beam seen.
    low: i64,
    high: i64,
}

impl Fan {
    /// The beam of the lattice that a scan begins with, if its beams are of this one.
    fn beam_of(&self, first_rad: f64, step_rad: f64, count: usize) -> Option<i64> {
        let off_rad = first_rad - self.origin_rad;
        if self.step_rad == 0.0 || (count > 1 && (step_rad - self.step_rad).abs() * count as f64 >= SAME_RAD) {
            return (self.step_rad == 0.0 && count == 1 && off_rad.abs() < SAME_RAD).then_some(0);
        }
        let beam = (off_rad / self.step_rad).round();
        let fits = (off_rad - beam * self.step_rad).abs() < SAME_RAD && beam.abs() <= f64::from(u16::MAX);
        fits.then_some(beam as i64)
    }

    fn beams(&self) -> usize {
        usize::try_from(self.high - self.low + 1).unwrap_or(0)
    }

    fn first_bearing_rad(&self) -> f64 {
        self.origin_rad + self.low as f64 * self.step_rad
    }
}

/// Beams by how wide they are: within a quarter.
fn class_of(aperture_rad: f64) -> u64 {
    aperture_rad.to_bits() >> 50
}

/// All ways in which the beams of a lidar lie.
#[derive(Debug, Clone, Default)]
pub(super) struct Fans {
    /// At most one more than [`FANS_MAX`].
    fans: Vec<Fan>,
    /// Scans by how wide their beams are: how many, and the sum of their apertures.
    classes: BTreeMap<u64, (u64, f64)>,
    /// Scans by their number of beams.
    counts: BTreeMap<usize, u64>,
    widest_step_rad: f64,
}

impl Fans {
    pub(super) fn add(&mut self, first_rad: f64, step_rad: f64, count: usize) {
        *self.counts.entry(count).or_insert(0) += 1;
        if count > 1 {
            self.widest_step_rad = self.widest_step_rad.max(step_rad.abs());
        }
        let aperture_rad = aperture_rad(step_rad);
        let class = self.classes.entry(class_of(aperture_rad)).or_insert((0, 0.0));
        (class.0, class.1) = (class.0 + 1, class.1 + aperture_rad);
        let last = count.saturating_sub(1) as i64;
        for fan in &mut self.fans {
            let Some(beam) = fan.beam_of(first_rad, step_rad, count) else { continue };
            let (low, high) = (fan.low.min(beam), fan.high.max(beam + last));
            if high - low < i64::from(u16::MAX) {
                (fan.low, fan.high) = (low, high);
                return;
            }
        }
        if self.fans.len() <= FANS_MAX {
            self.fans.push(Fan { origin_rad: first_rad, step_rad, low: 0, high: last });
        }
    }

    pub(super) fn most_beams(&self) -> usize {
        self.counts.keys().next_back().copied().unwrap_or(0)
    }

    /// Readings in all scans.
    pub(super) fn readings(&self) -> u64 {
        self.counts.iter().map(|(count, scans)| *count as u64 * scans).sum()
    }

    /// Sensors and transducers that it needs, if each way has its own.
    pub(super) fn needs(&self) -> (usize, usize) {
        (self.fans.len(), self.fans.iter().map(Fan::beams).sum())
    }

    pub(super) fn must_be_rounded(&self) -> bool {
        self.fans.len() > FANS_MAX
    }

    /// Sensors that it needs, if bearings are rounded.
    pub(super) fn classes(&self) -> usize {
        self.classes.len()
    }

    /// What is odd about them, in words that follow the name of the message.
    pub(super) fn remarks(&self, rounded_to: Option<usize>) -> Vec<String> {
        let mut remarks = Vec::new();
        let most = self.counts.iter().max_by_key(|(count, scans)| (**scans, **count));
        let ends = (self.counts.keys().next(), self.counts.keys().next_back());
        let scans: u64 = self.counts.values().sum();
        let mut beams = String::new();
        if let (Some((most, of_most)), (Some(least), Some(largest)), true) = (most, ends, self.counts.len() > 1) {
            beams = format!("{most} beams in {of_most} of {scans} scans, {least} to {largest} in the others");
        }
        if let Some(bearings) = rounded_to {
            let degrees = 180.0 / bearings as f64;
            let lead = if beams.is_empty() { String::new() } else { format!("{beams}; ") };
            beams = format!(
                "{lead}beams lie in more ways than can be told apart: bearings are rounded by up to {degrees:.3}°"
            );
        } else if self.fans.len() > 1 {
            let lead = if beams.is_empty() { String::new() } else { format!("{beams}; ") };
            beams = format!("{lead}beams lie in {} ways, each scan is used with its own bearings", self.fans.len());
        }
        if !beams.is_empty() {
            remarks.push(beams);
        }
        if self.widest_step_rad > BEAM_MAX_RAD * 1.001 {
            remarks.push(format!(
                "beams are {:.1}° apart, each is taken to be 1° wide",
                self.widest_step_rad.to_degrees()
            ));
        }
        remarks
    }
}

/// A lidar's beams as a sensor has them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SensorBeams {
    pub(super) first_transducer: u16,
    pub(super) transducers: u16,
    pub(super) first_bearing_rad: f64,
    pub(super) bearing_step_rad: f64,
    pub(super) aperture_rad: f64,
}

/// Which transducers the beams of a scan are.
#[derive(Debug, Clone)]
pub(super) enum FanNumbers {
    /// Each fan with its first transducer.
    Own(Vec<(Fan, u16)>),
    /// So many bearings around, and the first transducer of each class of apertures.
    Rounded { bearings: usize, classes: BTreeMap<u64, u16> },
}

impl FanNumbers {
    /// Numbers from `next` on, which is moved; none where they don't suffice. `rounded_to`: bearings around, if they are rounded.
    pub(super) fn new(fans: &Fans, rounded_to: Option<usize>, next: &mut usize) -> Option<(Self, Vec<SensorBeams>)> {
        let mut take = |count: usize| -> Option<(u16, u16)> {
            let first = u16::try_from(*next).ok()?;
            *next += count;
            u16::try_from(*next).ok()?;
            Some((first, u16::try_from(count).ok()?))
        };
        let mut sensors = Vec::new();
        if let Some(bearings) = rounded_to {
            let mut classes = BTreeMap::new();
            for (class, (scans, apertures_rad)) in &fans.classes {
                let (first_transducer, transducers) = take(bearings)?;
                classes.insert(*class, first_transducer);
                sensors.push(SensorBeams {
                    first_transducer,
                    transducers,
                    first_bearing_rad: 0.0,
                    bearing_step_rad: TAU / bearings as f64,
                    aperture_rad: apertures_rad / *scans as f64,
                });
            }
            return Some((Self::Rounded { bearings, classes }, sensors));
        }
        let mut own = Vec::new();
        for fan in &fans.fans {
            let (first_transducer, transducers) = take(fan.beams())?;
            own.push((fan.clone(), first_transducer));
            sensors.push(SensorBeams {
                first_transducer,
                transducers,
                first_bearing_rad: fan.first_bearing_rad(),
                bearing_step_rad: fan.step_rad,
                aperture_rad: aperture_rad(fan.step_rad),
            });
        }
        Some((Self::Own(own), sensors))
    }

    /// Of the beams of a scan that the survey saw.
    pub(super) fn of(&self, first_rad: f64, step_rad: f64, count: usize) -> Option<Vec<u16>> {
        match self {
            Self::Own(fans) => fans.iter().find_map(|(fan, first_transducer)| {
                let beam = fan.beam_of(first_rad, step_rad, count)? - fan.low;
                let first = u16::try_from(beam).ok().filter(|beam| usize::from(*beam) + count <= fan.beams())?;
                Some((first + first_transducer..).take(count).collect())
            }),
            Self::Rounded { bearings, classes } => {
                let first_transducer = *classes.get(&class_of(aperture_rad(step_rad)))?;
                let number = |beam: usize| {
                    let turns = (first_rad + beam as f64 * step_rad) / TAU;
                    let nearest = ((turns - turns.floor()) * *bearings as f64).round() as usize % bearings;
                    first_transducer + nearest as u16
                };
                Some((0..count).map(number).collect())
            }
        }
    }
}

/// How many bearings a circle can have where `left` transducers are left for so many of them; none: too few.
pub(super) fn circle(left: usize, circles: usize) -> Option<usize> {
    Some((left / circles.max(1)).min(CIRCLE_MAX)).filter(|bearings| *bearings >= CIRCLE_MIN)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bearing_of(sensors: &[SensorBeams], transducer: u16) -> f64 {
        let holds = |s: &&SensorBeams| (s.first_transducer..s.first_transducer + s.transducers).contains(&transducer);
        let sensor = sensors.iter().find(holds).unwrap();
        sensor.first_bearing_rad + f64::from(transducer - sensor.first_transducer) * sensor.bearing_step_rad
    }

    proptest! {
        /// Whatever the beams of a scan are, each is named by a transducer of its bearing.
        #[test]
        fn every_beam_keeps_its_bearing(
            scans in prop::collection::vec((-3.2..3.2f64, prop_oneof![Just(0.0175), 0.001..0.5f64, -0.5..-0.001f64], 1..200_usize), 1..90),
            lattice in prop::collection::vec((0..40_i32, 1..90_usize), 0..9),
        ) {
            let on_lattice = lattice.iter().map(|(from, count)| (-1.5 + 0.03 * f64::from(*from), 0.03, *count));
            let all: Vec<(f64, f64, usize)> = scans.into_iter().chain(on_lattice).collect();
            let mut fans = Fans::default();
            all.iter().for_each(|(first, step, count)| fans.add(*first, *step, *count));
            let rounded_to = if fans.must_be_rounded() { Some(circle(65_535, fans.classes()).unwrap()) } else { None };
            let mut next = 0;
            let (numbers, sensors) = FanNumbers::new(&fans, rounded_to, &mut next).unwrap();
            prop_assert!(sensors.len() <= FANS_MAX.max(fans.classes()));
            let tolerance = rounded_to.map_or(SAME_RAD, |bearings| 1.01 * PI / bearings as f64);
            for (first, step, count) in &all {
                let named = numbers.of(*first, *step, *count).unwrap();
                prop_assert_eq!(named.len(), *count);
                for (beam, transducer) in named.into_iter().enumerate() {
                    let bearing = first + beam as f64 * step;
                    let off = echogrid_core::wrap_angle(bearing - bearing_of(&sensors, transducer)).abs();
                    prop_assert!(off < tolerance + 1e-9, "{off}");
                }
            }
        }
    }

    #[test]
    fn beams_of_one_lattice_share_a_sensor() {
        let mut fans = Fans::default();
        fans.add(-1.0, 0.01, 200);
        fans.add(-1.0, 0.01, 190);
        fans.add(-0.9, 0.01, 230);
        fans.add(-1.1, 0.01, 3);
        assert_eq!(fans.needs(), (1, 250));
        let (numbers, sensors) = FanNumbers::new(&fans, None, &mut 0).unwrap();
        assert!((sensors[0].first_bearing_rad + 1.1).abs() < 1e-12);
        assert_eq!(numbers.of(-1.0, 0.01, 190).unwrap()[0], 10);
    }

    #[test]
    fn a_beam_is_never_as_wide_as_the_gap_to_the_next() {
        assert_eq!(aperture_rad(PI / 180.0), PI / 180.0);
        assert_eq!(aperture_rad(-PI / 360.0), PI / 360.0);
        assert_eq!(aperture_rad(PI / 2.0), PI / 180.0);
        assert_eq!(aperture_rad(0.0), PI / 180.0);
    }
}
