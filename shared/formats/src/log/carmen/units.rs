//! In which unit the ranges of a log are written.
//!
//! CARMEN writes metres; logs that people made themselves hold millimetres and centimetres, too. What tells them apart:
//!
//! 1. Ranges are looked at only if half of the echoes are beyond what is usual in metres.
//! 2. A lidar's are compared with the odometry: what it saw is led on by the way that the robot went, in each unit, and the unit in
//!    which that meets what it sees next is the right one.
//! 3. Else the maximum that the log states decides, if ranges fit it in one unit only. A sonar hears no farther than 15 m.
//! 4. What is neither usual nor told by any of these is refused, with how to say it.

use std::collections::BTreeMap;

use echogrid_core::Pose2;

/// What one unit of a log's ranges is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum RangeUnit {
    /// Metres, as CARMEN writes them.
    #[default]
    Metres,
    /// Centimetres.
    Centimetres,
    /// Millimetres.
    Millimetres,
}

impl RangeUnit {
    const ALL: [Self; 3] = [Self::Metres, Self::Centimetres, Self::Millimetres];

    /// The length of one unit, metres.
    #[must_use]
    pub fn metres(self) -> f64 {
        match self {
            Self::Metres => 1.0,
            Self::Centimetres => 0.01,
            Self::Millimetres => 0.001,
        }
    }

    /// The name of the unit, in words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Metres => "metres",
            Self::Centimetres => "centimetres",
            Self::Millimetres => "millimetres",
        }
    }
}

/// If half of the echoes of a lidar are farther, the odometry is asked.
const LIDAR_USUAL: f64 = 20.0;
/// If half of them are farther, they are no metres unless the odometry, or the user, says so.
const LIDAR_METRES: f64 = 100.0;
/// If half of the echoes of a sonar are farther they are no metres.
const SONAR_METRES: f64 = 20.0;
/// No sonar hears farther, metres.
const SONAR_MAX_M: f64 = 15.0;
/// The robot must have gone so far between two scans that are compared, metres …
const WAY_M: f64 = 0.1;
/// … and not have turned by more, radians: where the lidar sits is not known yet.
const TURN_RAD: f64 = 0.5;
/// Scans that are compared, at most and at least.
const COMPARED_MAX: u32 = 100;
const COMPARED_MIN: u32 = 1;
/// Beams that must meet in two scans.
const BEAMS_MIN: usize = 8;
/// The best unit must be this much better than the next.
const CLEARLY: f64 = 0.5;

/// The ranges of one kind of message, as far as their unit goes.
#[derive(Debug, Default)]
pub(super) struct UnitTally {
    /// Ranges by size, within a sixteenth.
    sizes: BTreeMap<u64, u64>,
    before: Option<Seen>,
    compared: u32,
    /// How far off what was seen was, by unit, in units of the log.
    off: [f64; 3],
}

/// A lidar's scan and where it was taken.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    pub(super) odom_from_base: Pose2,
    pub(super) first_bearing_rad: f64,
    pub(super) bearing_step_rad: f64,
    pub(super) ranges: Vec<f64>,
}

fn size_of(range: f64) -> u64 {
    range.to_bits() >> 48
}

impl UnitTally {
    /// Takes note of a range, finite and positive.
    pub(super) fn add(&mut self, range: f64) {
        *self.sizes.entry(size_of(range)).or_insert(0) += 1;
    }

    /// Compares a scan with one before it, where its ranges are not usual.
    pub(super) fn compare(&mut self, scan: impl FnOnce() -> Seen, ranges: &[f64], odom_from_base: Pose2) {
        let far = ranges.iter().filter(|range| **range > LIDAR_USUAL).count();
        if 2 * far < ranges.len() || ranges.len() < BEAMS_MIN || self.compared >= COMPARED_MAX {
            return;
        }
        let Some(before) = &self.before else {
            self.before = Some(scan());
            return;
        };
        let moved = before.odom_from_base.inverse() * odom_from_base;
        if moved.distance_m(Pose2::IDENTITY) < WAY_M && moved.theta.abs() < TURN_RAD {
            return;
        }
        let now = scan();
        if moved.theta.abs() < TURN_RAD {
            let off = RangeUnit::ALL.map(|unit| off(before, &now, moved, unit.metres()));
            if off.iter().any(Option::is_some) {
                self.compared += 1;
                // What is nowhere in sight is off by as much as is in sight.
                let mean = ranges.iter().filter(|range| super::is_sane(**range)).sum::<f64>() / ranges.len() as f64;
                for (sum, off) in self.off.iter_mut().zip(off) {
                    *sum += off.unwrap_or(mean);
                }
            }
        }
        self.before = Some(now);
    }

    /// The range that a share of those below `ceiling` are not above.
    fn quantile(&self, share: f64, ceiling: Option<f64>) -> f64 {
        let size = ceiling.map(size_of).filter(|size| self.sizes.range(..size).next().is_some());
        let below = || self.sizes.range(..size.unwrap_or(u64::MAX));
        let total: u64 = below().map(|(_, count)| count).sum();
        let mut passed = 0;
        for (size, count) in below() {
            passed += count;
            if passed as f64 >= share * total as f64 {
                return f64::from_bits(size << 48);
            }
        }
        0.0
    }

    /// The unit that the odometry says.
    fn of_odometry(&self) -> Option<RangeUnit> {
        if self.compared < COMPARED_MIN {
            return None;
        }
        let mut order: Vec<(f64, RangeUnit)> = self.off.into_iter().zip(RangeUnit::ALL).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        match order.as_slice() {
            [(best, unit), (next, _), ..] if *best <= CLEARLY * next => Some(*unit),
            _ => None,
        }
    }

    /// The unit, and how it is known; an error is what was found. `ceiling`: from which range on there is no echo, if that
    /// stands out, in units of the log; `stated_max_m`: what the log says of it.
    pub(super) fn unit(
        &self,
        is_sonar: bool,
        ceiling: Option<f64>,
        stated_max_m: Option<f64>,
    ) -> Result<(RangeUnit, Option<String>), String> {
        let (median, far) = (self.quantile(0.5, ceiling), self.quantile(0.95, ceiling));
        let found = format!("half of them are above {median:.0}, a twentieth above {far:.0}");
        let fitting = |max_m: f64| {
            let fits = |unit: &&RangeUnit| far * unit.metres() <= 1.1 * max_m;
            RangeUnit::ALL.iter().find(fits).copied()
        };
        if is_sonar {
            return match fitting(SONAR_MAX_M) {
                _ if median <= SONAR_METRES => Ok((RangeUnit::Metres, None)),
                Some(unit) => Ok((unit, Some(format!("{found}, and no sonar hears beyond {SONAR_MAX_M} m")))),
                None => Err(found),
            };
        }
        if median <= LIDAR_USUAL {
            return Ok((RangeUnit::Metres, None));
        }
        match self.of_odometry() {
            Some(RangeUnit::Metres) if median > LIDAR_METRES => {
                return Err(format!("{found}, and they change as if the odometry were in the same unit"));
            }
            Some(RangeUnit::Metres) => return Ok((RangeUnit::Metres, None)),
            Some(unit) => return Ok((unit, Some(format!("{found}, and they change so as the robot moves")))),
            None if median <= LIDAR_METRES => return Ok((RangeUnit::Metres, None)),
            None => {}
        }
        match stated_max_m.and_then(|max_m| Some((max_m, fitting(max_m)?))) {
            // In centimetres they might be farther than in millimetres and yet within the maximum.
            Some((max_m, RangeUnit::Millimetres)) => {
                Ok((RangeUnit::Millimetres, Some(format!("{found}, and the log states a maximum of {max_m} m"))))
            }
            _ => Err(found),
        }
    }
}

/// How far the ranges of a scan are from what one before it lets expect, if one unit is so many metres: the median, in units.
fn off(before: &Seen, now: &Seen, moved: Pose2, metres: f64) -> Option<f64> {
    if now.bearing_step_rad == 0.0 {
        return None;
    }
    let now_from_before = moved.inverse();
    let is_usable = |range: f64| super::is_sane(range) && range > 0.0;
    let mut off: Vec<f64> = Vec::new();
    for (beam, range) in before.ranges.iter().enumerate().filter(|(_, range)| is_usable(**range)) {
        let (sin, cos) = libm::sincos(before.first_bearing_rad + beam as f64 * before.bearing_step_rad);
        let range_m = range * metres;
        let [x, y] = now_from_before.transform([range_m * cos, range_m * sin]);
        let bearing = echogrid_core::wrap_angle(libm::atan2(y, x) - now.first_bearing_rad);
        // The same bearing a turn on may be the one that the beams are counted to.
        let beam = [0.0, core::f64::consts::TAU, -core::f64::consts::TAU]
            .map(|turn| ((bearing + turn) / now.bearing_step_rad).round())
            .into_iter()
            .find(|beam| (0.0..now.ranges.len() as f64).contains(beam));
        let seen = beam.and_then(|beam| now.ranges.get(beam as usize)).filter(|range| is_usable(**range));
        if let Some(seen) = seen {
            off.push((libm::hypot(x, y) / metres - seen).abs());
        }
    }
    if off.len() < BEAMS_MIN {
        return None;
    }
    off.sort_by(f64::total_cmp);
    off.get(off.len() / 2).copied()
}
