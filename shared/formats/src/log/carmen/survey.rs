//! The first pass over a CARMEN log.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use echogrid_core::Pose2;
use echogrid_core::robot::SENSORS_MAX;

use super::kinds::{CarmenPlan, KindRecord, Sensors, Unusable, kinds_in_use, robot_and_plan};
use super::message::{Message, ScanKind, ScanLine};
use super::origin::Origin;
use super::repeats::Repeats;
use super::speeds::Speeds;
use crate::log::dialect::Dialect;
use crate::log::fault::{Fault, FaultCounter, FaultKind, Refusal, first_fault};
use crate::log::lines::{Line, Lines};
use crate::log::recording::{Container, Messages, RecordingPlan};
use crate::log::source::hex;
use crate::log::tally::{EventTally, Summary};
use crate::log::timeline::{Rank, Source, TimedLine};
use crate::log::{LogError, LogFormat, LogSurvey, SurveyOptions};

/// Parameters that are kept, and their longest value in bytes.
const PARAMS_MAX: usize = 4096;
const PARAM_BYTES: usize = 1024;
/// As much of a line as is shown.
const SAMPLE_BYTES: usize = 300;
/// Names of unknown messages that are told apart.
const NAMES_MAX: usize = 64;

/// Surveys a CARMEN log. `path` is for errors only.
///
/// # Errors
/// When reading fails, or the log holds no odometry or no readings.
pub fn survey(stored: impl Read, path: &Path) -> Result<LogSurvey, LogError> {
    survey_with(stored, path, SurveyOptions::default())
}

/// Surveys a CARMEN log as [`survey`] does, where the user says what the log does not.
///
/// # Errors
/// As [`survey`].
pub fn survey_with(stored: impl Read, path: &Path, options: SurveyOptions) -> Result<LogSurvey, LogError> {
    survey_of(stored, path, Dialect::Carmen, options)
}

/// Surveys a text log of any dialect.
pub(in crate::log) fn survey_of(
    stored: impl Read,
    path: &Path,
    dialect: Dialect,
    options: SurveyOptions,
) -> Result<LogSurvey, LogError> {
    let mut lines = Lines::new(stored).map_err(|source| LogError::open(path, source))?;
    let mut surveyor = Surveyor::new(options, Origin::Text(dialect.clone()));
    while let Some(line) = lines.next().map_err(|source| LogError::open(path, source))? {
        surveyor.line(&dialect, line);
    }
    let stored = lines.finish().map_err(|source| LogError::open(path, source))?;
    let mut survey = surveyor.conclude(path)?;
    survey.sha256 = hex(stored.hasher);
    survey.byte_counts = vec![stored.bytes];
    Ok(survey)
}

/// Surveys a recording, of which it has been chosen what is used.
pub(in crate::log) fn survey_recording(
    container: Box<dyn Container>,
    path: &Path,
    format: LogFormat,
    plan: Arc<RecordingPlan>,
    options: SurveyOptions,
) -> Result<LogSurvey, LogError> {
    let mut surveyor = Surveyor::new(options, Origin::Recording(format, Arc::clone(&plan)));
    let mut messages = Messages::new(container, Arc::clone(&plan));
    let mut take = |number, message: Result<Message<'_>, Refusal>| match message {
        Ok(message) => surveyor.message(number, message),
        Err(refusal) => surveyor.faults.count(number, refusal),
    };
    while messages.advance(&mut take).map_err(|source| LogError::open(path, source))? {}
    let stored = messages.into_container().finish().map_err(|source| LogError::open(path, source))?;
    let unstamped = surveyor.unstamped;
    if unstamped > 0 {
        surveyor.faults.count_many(0, Refusal::new(FaultKind::BadStamp, "no stamp"), unstamped);
    }
    surveyor.skipped.extend(plan.skipped.clone());
    let mut survey = surveyor.conclude(path)?;
    survey.remarks.splice(0..0, plan.remarks.iter().cloned());
    survey.sha256 = hex(stored.hasher);
    survey.byte_counts = vec![stored.bytes];
    Ok(survey)
}

/// What a line is to the order of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    Odometry,
    TruePose,
    Scan(ScanKind),
}

pub(super) struct Surveyor {
    faults: FaultCounter,
    skipped: BTreeMap<String, u64>,
    params: BTreeMap<String, String>,
    kinds: BTreeMap<ScanKind, KindRecord>,
    events: EventTally<Class>,
    /// Of the last odometry line.
    odom_from_base: Option<Pose2>,
    speeds: Speeds,
    /// Messages without a stamp so far.
    unstamped: u64,
    repeats: Repeats,
    /// The first line that names more sonars than a robot can have, and how many.
    most_sonars: Option<(u64, usize)>,
    options: SurveyOptions,
    origin: Origin,
}

impl Surveyor {
    pub(super) fn new(options: SurveyOptions, origin: Origin) -> Self {
        Self {
            faults: FaultCounter::new(origin.place()),
            skipped: BTreeMap::new(),
            params: BTreeMap::new(),
            kinds: BTreeMap::new(),
            events: EventTally::new(),
            odom_from_base: None,
            speeds: Speeds::default(),
            unstamped: 0,
            repeats: Repeats::default(),
            most_sonars: None,
            options,
            origin,
        }
    }

    /// Damage so far, by kind.
    pub(super) fn faults(&self) -> impl Iterator<Item = &Fault> {
        self.faults.iter()
    }

    /// Kinds of scans so far.
    pub(super) fn kinds(&self) -> impl Iterator<Item = ScanKind> {
        self.kinds.keys().copied()
    }

    /// Whether poses and readings have come.
    pub(super) fn can_map(&self) -> bool {
        let has_poses = |kind: &ScanKind| self.events.poses(Class::Scan(*kind)) > 0;
        !self.kinds.is_empty() && (self.events.lines(Class::Odometry) > 0 || self.kinds.keys().any(has_poses))
    }

    pub(super) fn line(&mut self, dialect: &Dialect, line: Line<'_>) {
        match line {
            Line::Bytes(number, bytes) => {
                let unstamped = self.unstamped;
                let stands_twice = self.repeats.stands_twice(bytes);
                let outcome = dialect.parse(bytes, &mut |message| {
                    if self.repeats.is_copy(stands_twice, &message) {
                        let line = String::from_utf8_lossy(&bytes[..bytes.len().min(SAMPLE_BYTES)]);
                        self.faults.count(number, Refusal::new(FaultKind::Repeated, line));
                    } else {
                        self.message(number, message);
                    }
                });
                if self.unstamped > unstamped {
                    let refusal = Refusal::new(FaultKind::BadStamp, dialect.stamp_of(bytes));
                    self.faults.count_many(number, refusal, self.unstamped - unstamped);
                }
                if let Err(refusal) = outcome {
                    self.faults.count(number, refusal);
                }
            }
            Line::TooLong(number) => self.faults.count(number, Refusal::new(FaultKind::LineTooLong, "")),
            Line::Damaged(number, what) => self.faults.count(number, Refusal::new(FaultKind::GzipDamaged, what)),
        }
    }

    fn message(&mut self, line: u64, message: Message<'_>) {
        match message {
            Message::Odometry { odom_from_base, v_mps, w_radps, stamp_ns } => {
                self.odom_from_base = Some(odom_from_base);
                self.speeds.add(odom_from_base, v_mps, w_radps, stamp_ns);
                self.event(line, Class::Odometry, Some(odom_from_base), stamp_ns, 0);
            }
            Message::TruePose { stamp_ns, .. } => self.event(line, Class::TruePose, None, stamp_ns, 0),
            Message::Scan(scan) => self.scan(line, &scan),
            Message::Param { name, value } => self.param(name, value),
            Message::Other { name } => {
                let known = self.skipped.len() < NAMES_MAX || self.skipped.contains_key(name);
                *self.skipped.entry(if known { name } else { "(others)" }.to_owned()).or_insert(0) += 1;
            }
            Message::Nothing => {}
        }
    }

    fn scan(&mut self, line: u64, scan: &ScanLine) {
        let carried = scan.carried.map(|carried| carried.odom_from_base);
        let record = self.kinds.entry(scan.kind).or_insert_with(|| KindRecord::new(scan, line));
        if !record.add(scan, carried.or(self.odom_from_base)) {
            let sonars = scan.ranges.len();
            if sonars > SENSORS_MAX {
                self.most_sonars.get_or_insert((line, sonars));
            }
            self.faults.count(line, Refusal::new(FaultKind::TooManyMounts, format!("SONAR of {sonars} readings")));
            return;
        }
        scan.oddities.iter().for_each(|odd| self.faults.count(line, odd.clone()));
        // A blank of a table is no reading, and no fault.
        let is_table = matches!(self.origin, Origin::Text(Dialect::Csv(_)));
        let may_be_infinite = is_table || scan.described.is_some();
        for (kind, is_faulty) in [
            (FaultKind::RangeNotFinite, (|range| !range.is_finite()) as fn(f64) -> bool),
            (FaultKind::AbsurdRange, |range| range.is_finite() && !super::is_sane(range)),
        ] {
            let is_faulty = |range: &&f64| is_faulty(**range) && (range.is_finite() || !may_be_infinite);
            let mut faulty = scan.ranges.iter().filter(is_faulty);
            if let Some(first) = faulty.next() {
                let count = 1 + faulty.count() as u64;
                self.faults.count_many(line, Refusal::new(kind, first.to_string()), count);
            }
        }
        self.event(line, Class::Scan(scan.kind), carried, scan.stamp_ns, scan.ranges.len());
    }

    fn event(&mut self, line: u64, class: Class, pose: Option<Pose2>, stamp_ns: Option<u64>, weight: usize) {
        self.unstamped += u64::from(stamp_ns.is_none());
        let (rank, source) = match class {
            Class::Odometry => (Rank::Odometry, Source::ODOMETRY),
            Class::TruePose => (Rank::TruePose, Source::TRUE_POSE),
            Class::Scan(kind) => (Rank::Scan, kind.source()),
        };
        self.events.add(TimedLine {
            number: line,
            source,
            rank,
            stamp_ns,
            pose,
            weight,
            restates: false,
            payload: class,
        });
    }

    /// The last value before the first scan counts; later ones only where there was none.
    fn param(&mut self, name: &str, value: &str) {
        let is_new = !self.params.contains_key(name);
        if name.len() > PARAM_BYTES || value.len() > PARAM_BYTES || (is_new && self.params.len() >= PARAMS_MAX) {
            return;
        }
        if is_new || self.kinds.is_empty() {
            self.params.insert(name.to_owned(), value.to_owned());
        }
    }

    pub(super) fn conclude(mut self, path: &Path) -> Result<LogSurvey, LogError> {
        self.events.finish();
        let faults = self.faults.into_faults();
        let kinds = kinds_in_use(&self.kinds);
        let mut skipped = self.skipped;
        for (kind, record) in self.kinds.iter().filter(|(kind, _)| !kinds.contains(kind)) {
            *skipped.entry(self.origin.name_of(*kind)).or_insert(0) += record.lines;
        }
        if let Some((line, count)) = self.most_sonars {
            return Err(LogError::TooManySonars { path: path.to_path_buf(), line, count });
        }
        if kinds.is_empty() {
            return Err(no_readings(path, &self.origin, &faults));
        }
        // The most poses; at equal numbers the kind that comes first.
        let poses = |kind: &ScanKind| self.events.poses(Class::Scan(*kind));
        let most = kinds.iter().rev().max_by_key(|kind| poses(kind)).filter(|kind| poses(kind) > 0).copied();
        let apart = kinds.iter().all(|kind| self.events.are_apart(Class::Odometry, Class::Scan(*kind)));
        let odometry_from = match (self.events.lines(Class::Odometry) > 0, most) {
            (true, _) if !apart => None,
            (true, None) => return Err(LogError::Apart { path: path.to_path_buf() }),
            (false, None) => return Err(no_odometry(path, &self.origin, &faults)),
            (_, most) => most,
        };
        let Sensors { robot, used, mut remarks } =
            robot_and_plan(&self.kinds, &kinds, &self.params, &self.options, &self.origin)
                .map_err(|unusable| unusable_sensors(path, unusable))?;
        let place = self.origin.place();
        let odometry = odometry_from.map_or(Class::Odometry, Class::Scan);
        let Summary { mut clock, first_stamp_ns, last_stamp_ns, distance_m } =
            self.events.summary(odometry, |class| match class {
                Class::Odometry => odometry_from.is_none(),
                Class::TruePose => true,
                Class::Scan(kind) => used.contains_key(&kind),
            });
        clock.count_in(place);
        remarks.extend(self.speeds.remarks());
        if let Some(kind) = odometry_from.filter(|_| apart) {
            let lines = self.events.lines(Class::Odometry);
            remarks.push(format!(
                "its {lines} ODOM lines stand apart from all scans and are not used: the poses that {} carries are the odometry",
                kind.name()
            ));
        }
        let used_records = || used.keys().filter_map(|kind| self.kinds.get(kind));
        Ok(LogSurvey {
            format: self.origin.format(),
            robot,
            odometry_count: self.events.poses(odometry),
            scan_count: used_records().map(|record| record.lines).sum(),
            reading_count: used_records().map(KindRecord::readings).sum(),
            true_pose_count: self.events.lines(Class::TruePose),
            max_readings_per_scan: used_records().map(KindRecord::most_readings).max().unwrap_or(0),
            first_stamp_ns,
            last_stamp_ns,
            distance_m,
            sideways: self.events.sideways(odometry),
            clock,
            skipped,
            faults,
            remarks,
            sha256: String::new(),
            params: self.params,
            byte_counts: Vec::new(),
            plan: CarmenPlan { origin: self.origin, used, odometry_from },
        })
    }
}

fn unusable_sensors(path: &Path, unusable: Unusable) -> LogError {
    let path = path.to_path_buf();
    match unusable {
        Unusable::Transducers(count) => LogError::TooManyTransducers { path, count },
        Unusable::Sensors(count) => LogError::TooManySensors { path, count },
        Unusable::Unit(kind, line, found) => LogError::UnknownUnit { path, line, message: kind.name(), found },
    }
}

fn no_odometry(path: &Path, origin: &Origin, faults: &[Fault]) -> LogError {
    LogError::NoOdometry {
        path: path.to_path_buf(),
        expected: origin.odometry_lines(),
        first_fault: first_fault(faults),
    }
}

fn no_readings(path: &Path, origin: &Origin, faults: &[Fault]) -> LogError {
    LogError::NoReadings {
        path: path.to_path_buf(),
        expected: origin.reading_lines(),
        first_fault: first_fault(faults),
    }
}
