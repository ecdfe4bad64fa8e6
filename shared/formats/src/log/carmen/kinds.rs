//! Which of a log's scan messages are used, and the sensors they stand for.

use std::collections::BTreeMap;

use echogrid_core::robot::SENSORS_MAX;
use echogrid_core::{Footprint, Pose2, Robot, Sensor, SensorKind};

use super::ceiling::RangeTally;
use super::fans::{self, FanNumbers, Fans};
use super::laser_view;
use super::message::{Carried, Described, ScanKind, ScanLine, Shape};
use super::mount::{self, Mount};
use super::origin::Origin;
use super::rings::Rings;
use super::units::{RangeUnit, Seen, UnitTally};
use crate::log::SurveyOptions;
use crate::log::dialect::Dialect;

/// Readings nearer than this are the robot itself or a fault, metres.
const LIDAR_MIN_M: f64 = 0.02;
/// Nearest range of an ultrasonic ranger, metres.
const SONAR_MIN_M: f64 = 0.1;
const LIDAR_ERROR_RATIO: f64 = 0.002;
const SONAR_ERROR_RATIO: f64 = 0.01;
/// No range sensor of a robot sees farther: a larger maximum says nothing, metres.
const STATED_MAX_M: f64 = 1000.0;

/// How the readings of all lines of a kind lie.
#[derive(Debug)]
enum Layout {
    Fans(Fans),
    Rings(Rings),
}

/// One kind of scan message, as the survey comes to know it.
#[derive(Debug)]
pub(crate) struct KindRecord {
    layout: Layout,
    pub(crate) lines: u64,
    /// CountedBy among the lines of the file.
    first_line: u64,
    /// The maximum that the first line states.
    stated_max: Option<f64>,
    /// What the first line says, where it says all of its sensor.
    described: Option<Described>,
    tally: RangeTally,
    units: UnitTally,
    mount: Mount,
}

impl KindRecord {
    pub(crate) fn new(scan: &ScanLine, line: u64) -> Self {
        let (layout, stated_max) = match &scan.shape {
            Shape::Fan { range_max_m, .. } => (Layout::Fans(Fans::default()), *range_max_m),
            Shape::Ring { .. } => (Layout::Rings(Rings::default()), None),
        };
        Self {
            layout,
            lines: 0,
            first_line: line,
            stated_max: stated_max.or(scan.described.map(|sensor| sensor.range_max_m)),
            described: scan.described,
            tally: RangeTally::default(),
            units: UnitTally::default(),
            mount: Mount::Unsaid,
        }
    }

    /// Takes note of a line of this kind, unless its sonars are too many. `odom_from_base`: where the robot was, if that is known.
    pub(crate) fn add(&mut self, scan: &ScanLine, odom_from_base: Option<Pose2>) -> bool {
        match (&mut self.layout, &scan.shape) {
            (Layout::Fans(fans), Shape::Fan { first_bearing_rad, bearing_step_rad, .. }) => {
                fans.add(*first_bearing_rad, *bearing_step_rad, scan.ranges.len());
                if let (Some(odom_from_base), None) = (odom_from_base, scan.described) {
                    let seen = || Seen {
                        odom_from_base,
                        first_bearing_rad: *first_bearing_rad,
                        bearing_step_rad: *bearing_step_rad,
                        ranges: scan.ranges.clone(),
                    };
                    self.units.compare(seen, &scan.ranges, odom_from_base);
                }
            }
            (Layout::Rings(rings), Shape::Ring { aperture_rad, base_from_sonar }) => {
                if !rings.add(*aperture_rad, base_from_sonar) {
                    return false;
                }
            }
            _ => return false,
        }
        self.lines += 1;
        for range in scan.ranges.iter().filter(|range| super::is_sane(**range) && **range > 0.0) {
            self.tally.add(*range);
            if self.described.is_none() {
                self.units.add(*range);
            }
        }
        if let Some(Carried { odom_from_base, odom_from_sensor: Some(odom_from_sensor), .. }) = scan.carried {
            self.mount.add(odom_from_base.inverse() * odom_from_sensor);
        }
        true
    }

    /// Readings in all lines.
    pub(crate) fn readings(&self) -> u64 {
        match &self.layout {
            Layout::Fans(fans) => fans.readings(),
            Layout::Rings(rings) => rings.readings,
        }
    }

    /// Readings in the largest line.
    pub(crate) fn most_readings(&self) -> usize {
        match &self.layout {
            Layout::Fans(fans) => fans.most_beams(),
            Layout::Rings(rings) => rings.most,
        }
    }

    /// Sensors and transducers of the robot that it needs.
    fn needs(&self) -> (usize, usize) {
        match &self.layout {
            Layout::Fans(fans) => fans.needs(),
            Layout::Rings(rings) => (rings.sonars.len(), rings.sonars.len()),
        }
    }
}

/// A kind of scan message that is used.
#[derive(Debug, Clone)]
pub(crate) struct UsedKind {
    numbers: Numbers,
    /// One unit of the log's ranges, metres.
    pub(crate) unit_m: f64,
    pub(crate) range_min_m: f64,
    /// Readings from here on are no echo.
    pub(crate) ceiling_m: f64,
    /// When each reading was taken, nanoseconds after the stamp; shorter than the readings: with it.
    pub(crate) offsets_ns: Vec<i32>,
    /// Infinity is no echo.
    pub(crate) is_described: bool,
    /// Whether the log says how far the sensor can see; else that is told by all of its readings.
    pub(crate) states_max: bool,
}

/// Which transducers the readings of a line are.
#[derive(Debug, Clone)]
enum Numbers {
    Fans(FanNumbers),
    /// With the first transducer.
    Rings(Rings, u16),
}

impl UsedKind {
    /// The transducer of each reading; none for a line that the survey refused.
    pub(crate) fn transducers(&self, scan: &ScanLine) -> Option<Vec<u16>> {
        match (&self.numbers, &scan.shape) {
            (Numbers::Fans(fans), Shape::Fan { first_bearing_rad, bearing_step_rad, .. }) => {
                fans.of(*first_bearing_rad, *bearing_step_rad, scan.ranges.len())
            }
            (Numbers::Rings(rings, first), Shape::Ring { aperture_rad, base_from_sonar }) => {
                let numbers = rings.numbers(*aperture_rad, base_from_sonar)?;
                Some(numbers.into_iter().map(|number| first + number).collect())
            }
            _ => None,
        }
    }
}

/// How the lines of a log become events.
#[derive(Debug, Clone, Default)]
pub(crate) struct CarmenPlan {
    pub(crate) origin: Origin,
    pub(crate) used: BTreeMap<ScanKind, UsedKind>,
    /// The scan messages whose pose is the odometry; none if there are `ODOM` lines.
    pub(crate) odometry_from: Option<ScanKind>,
}

impl CarmenPlan {
    /// Whether it is for lines of that dialect.
    pub(crate) fn is_text_of(&self, dialect: &Dialect) -> bool {
        matches!(&self.origin, Origin::Text(planned) if planned == dialect)
    }
}

/// The robot, how its readings are numbered, and what is odd about its sensors.
pub(crate) struct Sensors {
    pub(crate) robot: Robot,
    pub(crate) used: BTreeMap<ScanKind, UsedKind>,
    pub(crate) remarks: Vec<String>,
}

/// Why the sensors of a log can't be used.
pub(crate) enum Unusable {
    /// So many transducers.
    Transducers(u64),
    /// So many sensors.
    Sensors(u64),
    /// Ranges of this message, from this line on, whose unit can't be told: what was found.
    Unit(ScanKind, u64, String),
}

/// The kinds that are used. Loggers write one scan under several names (`FLASER`, `ROBOTLASER1`
/// and `RAWLASER1` are the front laser, `RLASER`, `ROBOTLASER2` and `RAWLASER2` the rear one): of
/// each group the name with most lines is used, the others repeat it.
pub(crate) fn kinds_in_use(records: &BTreeMap<ScanKind, KindRecord>) -> Vec<ScanKind> {
    let mut best: BTreeMap<(u8, u16), (u64, ScanKind)> = BTreeMap::new();
    for (kind, record) in records {
        let group = match kind {
            ScanKind::Front => (0, 1),
            ScanKind::Rear => (0, 2),
            ScanKind::Robot(number) | ScanKind::Raw(number) => (0, u16::from(*number)),
            ScanKind::Sonar => (1, 0),
            ScanKind::Stream(number) => (2, *number),
        };
        let entry = best.entry(group).or_insert((0, *kind));
        // At equal numbers the first in the order of `ScanKind` stays.
        if record.lines > entry.0 {
            *entry = (record.lines, *kind);
        }
    }
    let mut kinds: Vec<_> = best.into_values().map(|(_, kind)| kind).collect();
    kinds.sort_by_key(|kind| match kind {
        // Who writes a recording again may change the order of its messages.
        ScanKind::Stream(number) => Some(u64::from(*number)),
        _ => records.get(kind).map(|record| record.first_line),
    });
    kinds
}

/// The robot, and how its readings are numbered. `unit`: of the ranges, where the user says it.
pub(crate) fn robot_and_plan(
    records: &BTreeMap<ScanKind, KindRecord>,
    kinds: &[ScanKind],
    params: &BTreeMap<String, String>,
    options: &SurveyOptions,
    origin: &Origin,
) -> Result<Sensors, Unusable> {
    let number = |name: &str| -> Option<f64> { params.get(name)?.split_ascii_whitespace().next()?.parse().ok() };
    let length = |name: &str| number(name).filter(|metres| (0.0..100.0).contains(metres)).unwrap_or(0.0);
    let robot = Robot {
        name: origin.robot_name().into(),
        footprint: Footprint { length_m: length("robot_length"), width_m: length("robot_width") },
        sensors: Vec::new(),
    };
    let circles = circles(records, kinds)?;
    let mut sensors = Sensors { robot, used: BTreeMap::new(), remarks: Vec::new() };
    let mut next = 0_usize;
    for kind in kinds {
        let Some(record) = records.get(kind) else { continue };
        let name = origin.name_of(*kind);
        let limits = limits(*kind, &name, record, options.range_unit, &number, &mut sensors.remarks)?;
        let (numbers, mut of_kind) = numbered(*kind, record, circles.get(kind).copied(), &mut next, &number)
            .ok_or(Unusable::Transducers(next as u64))?;
        let (min_m, error_ratio) = match &record.layout {
            Layout::Rings(_) => (SONAR_MIN_M, SONAR_ERROR_RATIO),
            Layout::Fans(_) => (LIDAR_MIN_M, LIDAR_ERROR_RATIO),
        };
        let stated_m =
            record.described.map(|sensor| sensor.range_min_m).filter(|min_m| min_m.is_finite() && *min_m > 0.0);
        let range_min_m = stated_m.unwrap_or(min_m).min(limits.range_max_m / 2.0);
        for sensor in &mut of_kind {
            (sensor.range_min_m, sensor.range_max_m) = (range_min_m, limits.range_max_m);
            sensor.range_error_ratio = error_ratio;
        }
        let remarks = match &record.layout {
            Layout::Fans(fans) => fans.remarks(circles.get(kind).copied()),
            Layout::Rings(rings) => rings.remarks(),
        };
        sensors.remarks.extend(remarks.into_iter().map(|remark| format!("{name}: {remark}")));
        sensors.remarks.extend(mount::remarks(*kind, record.mount, of_kind.first(), &number));
        if matches!(record.layout, Layout::Fans(_)) {
            let is_stated = !matches!(kind, ScanKind::Front | ScanKind::Rear) || record.described.is_some();
            sensors.remarks.extend(laser_view::lay(&name, &mut of_kind, options.laser_view_rad(), is_stated));
        }
        sensors.robot.sensors.append(&mut of_kind);
        let offsets = params.get(super::SONAR_OFFSETS_PARAM).filter(|_| *kind == ScanKind::Sonar);
        let offsets_ns = offsets.and_then(|all| all.split(',').map(|one| one.trim().parse().ok()).collect());
        let offsets_ns = offsets_ns.unwrap_or_default();
        let Limits { unit_m, ceiling_m, states_max, .. } = limits;
        let is_described = record.described.is_some();
        let used = UsedKind { numbers, unit_m, range_min_m, ceiling_m, offsets_ns, is_described, states_max };
        sensors.used.insert(*kind, used);
    }
    Ok(sensors)
}

/// Bearings around for the lidars whose bearings must be rounded: those whose beams lie in too many ways, and, where the robot
/// would have too many sensors, those that need most of them.
fn circles(
    records: &BTreeMap<ScanKind, KindRecord>,
    kinds: &[ScanKind],
) -> Result<BTreeMap<ScanKind, usize>, Unusable> {
    let mut own: BTreeMap<ScanKind, (usize, usize)> = BTreeMap::new();
    let mut rounded: BTreeMap<ScanKind, usize> = BTreeMap::new();
    for kind in kinds {
        let Some(record) = records.get(kind) else { continue };
        match &record.layout {
            Layout::Fans(fans) if fans.must_be_rounded() => rounded.insert(*kind, fans.classes()),
            _ => {
                own.insert(*kind, record.needs());
                None
            }
        };
    }
    loop {
        let (sensors, transducers) = own.values().fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        let circles: usize = rounded.values().sum();
        let left = usize::from(u16::MAX).saturating_sub(transducers);
        let bearings = fans::circle(left, circles);
        let fits = sensors + circles <= SENSORS_MAX && transducers <= usize::from(u16::MAX);
        if let (true, Some(bearings)) = (fits, bearings.or((circles == 0).then_some(0))) {
            return Ok(rounded.into_keys().map(|kind| (kind, bearings)).collect());
        }
        let is_lidar =
            |kind: &ScanKind| records.get(kind).is_some_and(|record| matches!(record.layout, Layout::Fans(_)));
        let most = own.iter().filter(|(kind, needs)| is_lidar(kind) && needs.0 > 1).max_by_key(|(_, needs)| **needs);
        let Some(kind) = most.map(|(kind, _)| *kind) else {
            return Err(match fits || sensors + circles <= SENSORS_MAX {
                true => Unusable::Transducers((transducers + circles) as u64),
                false => Unusable::Sensors((sensors + circles) as u64),
            });
        };
        own.remove(&kind);
        if let Some(Layout::Fans(fans)) = records.get(&kind).map(|record| &record.layout) {
            rounded.insert(kind, fans.classes());
        }
    }
}

/// Unit and limits of the ranges of a kind.
struct Limits {
    unit_m: f64,
    range_max_m: f64,
    ceiling_m: f64,
    states_max: bool,
}

fn limits(
    kind: ScanKind,
    name: &str,
    record: &KindRecord,
    forced: Option<RangeUnit>,
    number: &dyn Fn(&str) -> Option<f64>,
    remarks: &mut Vec<String>,
) -> Result<Limits, Unusable> {
    let stated = record.stated_max.or_else(|| {
        number(match kind {
            ScanKind::Front => "robot_front_laser_max",
            ScanKind::Rear => "robot_rear_laser_max",
            _ => super::SONAR_MAX_PARAM,
        })
    });
    let stated = stated.filter(|max| max.is_finite() && *max > 0.0);
    // A log written by echogrid: its sonars hear up to the maximum, and that too.
    if let (ScanKind::Sonar, Some(max)) = (kind, stated) {
        return Ok(Limits { unit_m: 1.0, range_max_m: max, ceiling_m: max.next_up(), states_max: true });
    }
    if record.described.is_some() {
        let stated = stated.filter(|max| *max <= STATED_MAX_M);
        let ceiling_m = record.tally.ceiling_m(stated);
        return Ok(Limits { unit_m: 1.0, range_max_m: ceiling_m, ceiling_m, states_max: stated.is_some() });
    }
    let usual = stated.filter(|max| *max <= STATED_MAX_M);
    let told = record.units.unit(kind == ScanKind::Sonar, record.tally.no_echo_from(), usual);
    let unit = match (forced, told) {
        (Some(unit), _) => unit,
        (None, Ok((unit, why))) => {
            remarks.extend(why.map(|why| {
                let set = "replay.range_unit says otherwise";
                format!("{name}: ranges are read as {}: {why} ({set})", unit.name())
            }));
            unit
        }
        (None, Err(found)) => return Err(Unusable::Unit(kind, record.first_line, found)),
    };
    let unit_m = unit.metres();
    // A maximum that is none in metres may be one in the unit of the ranges.
    let in_unit = stated.map(|max| if max <= STATED_MAX_M { max } else { max * unit_m });
    let stated_m = in_unit.filter(|max| *max <= STATED_MAX_M);
    if let (Some(stated), None) = (stated, stated_m) {
        let line = record.stated_max.map_or(String::new(), |_| format!(" (line {})", record.first_line));
        remarks.push(format!("{name}: a maximum range of {stated} m{line} is no sensor's and taken for none"));
    }
    let ceiling_m = record.tally.scaled(unit_m).ceiling_m(stated_m);
    Ok(Limits { unit_m, range_max_m: ceiling_m, ceiling_m, states_max: stated_m.is_some() })
}

/// The sensors of one kind of message (their ranges are still to be told), and how its readings are numbered from `next` on; none
/// where there are no more numbers.
fn numbered(
    kind: ScanKind,
    record: &KindRecord,
    circle: Option<usize>,
    next: &mut usize,
    number: &dyn Fn(&str) -> Option<f64>,
) -> Option<(Numbers, Vec<Sensor>)> {
    let sensor = |sensor_kind, base_from_sensor, first_transducer, aperture_rad| Sensor {
        kind: sensor_kind,
        base_from_sensor,
        first_transducer,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad,
        range_min_m: 0.0,
        range_max_m: 0.0,
        range_error_ratio: 0.0,
    };
    match &record.layout {
        Layout::Fans(fans) => {
            let mount = record.described.map(|sensor| sensor.base_from_sensor);
            let mount = mount.unwrap_or_else(|| mount::of_laser(kind, record.mount, number));
            let (numbers, beams) = FanNumbers::new(fans, circle, next)?;
            let lidar = |beams: fans::SensorBeams| Sensor {
                transducers: beams.transducers,
                first_bearing_rad: beams.first_bearing_rad,
                bearing_step_rad: beams.bearing_step_rad,
                ..sensor(SensorKind::Lidar, mount, beams.first_transducer, beams.aperture_rad)
            };
            Some((Numbers::Fans(numbers), beams.into_iter().map(lidar).collect()))
        }
        Layout::Rings(rings) => {
            let first = u16::try_from(*next).ok()?;
            *next += rings.sonars.len();
            u16::try_from(*next).ok()?;
            let sonar = |(at, sonar): (u16, &super::rings::Sonar)| {
                sensor(SensorKind::Sonar, sonar.base_from_sonar, at, sonar.aperture_rad)
            };
            Some((Numbers::Rings(rings.clone(), first), (first..).zip(&rings.sonars).map(sonar).collect()))
        }
    }
}
