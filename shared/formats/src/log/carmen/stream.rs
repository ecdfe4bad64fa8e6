//! CARMEN lines as a program prints them: judged as those of a log, and given out as they come.
//!
//! A log is read twice, a program prints once. So the robot is what its first lines show: those of two seconds by their
//! stamps, or the first 400, and more until there are poses and readings among them. How far a sensor can see must be said
//! (by a parameter, its own message, or a robot that the user names), as the readings of two seconds can't tell. Ranges are metres
//! unless the user says otherwise.

use std::collections::{BTreeSet, VecDeque};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use echogrid_core::{Echo, Robot};

use super::kinds::CarmenPlan;
use super::message::{self, Message, ScanKind};
use super::origin::Origin;
use super::read::timed_line;
use super::survey::Surveyor;
use super::units::RangeUnit;
use crate::log::dialect::Dialect;
use crate::log::fault::{CountedBy, Fault, FaultCounter, FaultKind, Refusal};
use crate::log::lines::{Line, Lines};
use crate::log::{LogError, LogEvent, SurveyOptions};

/// Time by the stamps in which the robot is learnt, nanoseconds.
const LEARNT_IN_NS: u64 = 2_000_000_000;
/// Lines in which it is learnt, if the time is not over before.
const LEARNT_IN_LINES: usize = 400;
/// Lines without which it must have been.
const LEARNT_AT_LAST: usize = 100_000;

/// A line as it was printed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PrintedLine {
    /// The number of the line, from 1 on.
    pub number: u64,
    /// The bytes of the line without its end; none where it was too long.
    pub bytes: Option<Vec<u8>>,
    /// When it came, nanoseconds, if its program measures what is now: its stamps then only tell how far apart lines are, and where
    /// all of them are 0 each line has this one.
    pub arrived_ns: Option<u64>,
}

/// The lines of a program's output.
pub struct PrintedLines<R: Read>(Lines<R>);

impl<R: Read> PrintedLines<R> {
    /// The lines of what is read from `output`; waits for its first bytes.
    ///
    /// # Errors
    /// Reading fails.
    pub fn new(output: R) -> io::Result<Self> {
        Ok(Self(Lines::new(output)?))
    }

    /// The next line, without the time of its arrival; none at the end.
    ///
    /// # Errors
    /// Reading fails.
    pub fn next_line(&mut self) -> io::Result<Option<PrintedLine>> {
        Ok(self.0.next()?.map(|line| match line {
            Line::Bytes(number, bytes) => PrintedLine { number, bytes: Some(bytes.to_vec()), arrived_ns: None },
            Line::TooLong(number) | Line::Damaged(number, _) => PrintedLine { number, bytes: None, arrived_ns: None },
        }))
    }
}

impl<R: Read> core::fmt::Debug for PrintedLines<R> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("PrintedLines")
    }
}

/// Makes events of printed lines.
pub struct LineStream {
    /// Who prints, for errors.
    name: PathBuf,
    /// Believed over what the lines say of the sensors.
    told: Option<Robot>,
    /// Judges all lines, whatever becomes of them.
    judge: Surveyor,
    late: FaultCounter,
    told_kinds: BTreeSet<FaultKind>,
    /// Until the robot is known.
    learning: Option<Learning>,
    plan: CarmenPlan,
    learnt: BTreeSet<ScanKind>,
    robot: Option<Robot>,
    /// Of the last line that had one, nanoseconds.
    stamp_ns: u64,
    /// How much less than the time of arrival stamps are, at the least that was seen, nanoseconds; none where the program has no
    /// clock.
    lag_ns: Option<i128>,
    events: VecDeque<LogEvent>,
}

struct Learning {
    surveyor: Surveyor,
    lines: Vec<PrintedLine>,
    first_ns: Option<u64>,
    last_ns: u64,
}

impl core::fmt::Debug for LineStream {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("LineStream").field("name", &self.name).field("robot", &self.robot).finish_non_exhaustive()
    }
}

impl LineStream {
    /// Lines that `name` prints. `unit` is that of its ranges; `robot`, if given, is believed over what the lines say.
    #[must_use]
    pub fn new(name: impl AsRef<Path>, unit: RangeUnit, robot: Option<Robot>) -> Self {
        let options = SurveyOptions { range_unit: Some(unit), ..SurveyOptions::default() };
        let surveyor = || Surveyor::new(options.clone(), Origin::Text(Dialect::Carmen));
        Self {
            name: name.as_ref().to_path_buf(),
            told: robot,
            judge: surveyor(),
            late: FaultCounter::new(CountedBy::Line),
            told_kinds: BTreeSet::new(),
            learning: Some(Learning { surveyor: surveyor(), lines: Vec::new(), first_ns: None, last_ns: 0 }),
            plan: CarmenPlan::default(),
            learnt: BTreeSet::new(),
            robot: None,
            stamp_ns: 0,
            lag_ns: None,
            events: VecDeque::new(),
        }
    }

    /// Lines that say where a robot drives, which is known; who hears what, another says.
    #[must_use]
    pub fn of_odometry(name: impl AsRef<Path>, robot: Robot) -> Self {
        let known = Some(robot);
        Self { learning: None, robot: known.clone(), ..Self::new(name, RangeUnit::Metres, known) }
    }

    /// The robot, once it is known.
    #[must_use]
    pub fn robot(&self) -> Option<&Robot> {
        self.robot.as_ref()
    }

    /// Takes the next line.
    ///
    /// # Errors
    /// The lines show no robot that could map.
    pub fn push(&mut self, line: PrintedLine) -> Result<(), LogError> {
        self.judge.line(&Dialect::Carmen, as_line(&line));
        let Some(learning) = &mut self.learning else {
            self.take(&line);
            return Ok(());
        };
        learning.surveyor.line(&Dialect::Carmen, as_line(&line));
        if let Some(stamp_ns) = line.bytes.as_deref().and_then(stamp_of) {
            learning.first_ns.get_or_insert(stamp_ns);
            learning.last_ns = learning.last_ns.max(stamp_ns);
        }
        learning.lines.push(line);
        let time_ns = learning.last_ns.saturating_sub(learning.first_ns.unwrap_or(0));
        let has_seen = time_ns >= LEARNT_IN_NS || learning.lines.len() >= LEARNT_IN_LINES;
        let must_know = learning.lines.len() >= LEARNT_AT_LAST;
        if must_know || (has_seen && learning.surveyor.can_map()) {
            return self.learn();
        }
        Ok(())
    }

    /// Ends the log: no line follows.
    ///
    /// # Errors
    /// The lines show no robot that could map.
    pub fn finish(&mut self) -> Result<(), LogError> {
        self.learn()
    }

    /// The next event; its stamp is that of its line, or of the line before where it has none.
    pub fn pop(&mut self) -> Option<LogEvent> {
        self.events.pop_front()
    }

    /// Damage so far, by kind.
    #[must_use]
    pub fn faults(&self) -> Vec<Fault> {
        self.judge.faults().chain(self.late.iter()).cloned().collect()
    }

    /// Damage of kinds that were not there when this was asked before.
    pub fn new_faults(&mut self) -> Vec<Fault> {
        let new = self.faults().into_iter().filter(|fault| !self.told_kinds.contains(&fault.kind));
        let new: Vec<Fault> = new.collect();
        self.told_kinds.extend(new.iter().map(|fault| fault.kind));
        new
    }

    fn learn(&mut self) -> Result<(), LogError> {
        let Some(Learning { surveyor, lines, .. }) = self.learning.take() else { return Ok(()) };
        self.learnt = surveyor.kinds().collect();
        let survey = surveyor.conclude(&self.name)?;
        self.plan = survey.plan;
        for (kind, used) in &mut self.plan.used {
            if self.told.is_some() {
                // Its sensors see as far as the robot says.
                used.ceiling_m = if used.states_max { used.ceiling_m } else { f64::INFINITY };
            } else if !used.states_max {
                let path = self.name.clone();
                return Err(LogError::NoMaximum { path, message: kind.name(), param: max_param(*kind) });
            }
        }
        self.robot = Some(self.told.clone().unwrap_or(survey.robot));
        let stamps =
            || lines.iter().filter_map(|line| Some((line.arrived_ns?, line.bytes.as_deref().and_then(stamp_of)?)));
        let lags = || stamps().map(|(arrived_ns, stamp_ns)| i128::from(arrived_ns) - i128::from(stamp_ns));
        self.lag_ns = lags().min().filter(|_| stamps().any(|(_, stamp_ns)| stamp_ns > 0));
        lines.iter().for_each(|line| self.take(line));
        Ok(())
    }

    /// The stamp of a line that says this one.
    fn stamp(&mut self, said_ns: Option<u64>, arrived_ns: Option<u64>) -> u64 {
        self.stamp_ns = match (arrived_ns, said_ns, self.lag_ns) {
            (None, said_ns, _) => said_ns.unwrap_or(self.stamp_ns),
            (Some(arrived_ns), Some(said_ns), Some(lag_ns)) => {
                u64::try_from(i128::from(said_ns) + lag_ns).unwrap_or(arrived_ns)
            }
            (Some(arrived_ns), ..) => arrived_ns,
        };
        self.stamp_ns
    }

    /// The events of a line.
    fn take(&mut self, line: &PrintedLine) {
        // What is refused has been counted by the judge.
        let Some(Ok(message)) = line.bytes.as_deref().map(message::parse) else { return };
        if let Message::Scan(scan) = &message {
            let used = self.plan.used.get(&scan.kind);
            let is_known = used.map_or(self.learnt.contains(&scan.kind), |used| used.transducers(scan).is_some());
            if !is_known {
                self.late.count(line.number, Refusal::new(FaultKind::SensorCameLate, scan.kind.name()));
                return;
            }
        }
        let Some(timed) = timed_line(line.number, message, &self.plan) else { return };
        let stamp_ns = self.stamp(timed.stamp_ns, line.arrived_ns);
        for mut event in timed.payload {
            event.set_stamp_ns(stamp_ns);
            if let (LogEvent::Scan { readings, .. }, Some(told)) = (&mut event, &self.told) {
                for reading in readings {
                    let max_m = told.transducer(reading.transducer).map_or(f64::INFINITY, |of| of.range_max_m);
                    if matches!(reading.echo, Echo::Hit { range_m } if range_m > max_m) {
                        reading.echo = Echo::NoEcho;
                    }
                }
            }
            self.events.push_back(event);
        }
    }
}

fn as_line(line: &PrintedLine) -> Line<'_> {
    match &line.bytes {
        Some(bytes) => Line::Bytes(line.number, bytes),
        None => Line::TooLong(line.number),
    }
}

fn stamp_of(bytes: &[u8]) -> Option<u64> {
    match message::parse(bytes).ok()? {
        Message::Odometry { stamp_ns, .. } | Message::TruePose { stamp_ns, .. } => stamp_ns,
        Message::Scan(scan) => scan.stamp_ns,
        Message::Param { .. } | Message::Other { .. } | Message::Nothing => None,
    }
}

/// The parameter that says how far a sensor can see.
fn max_param(kind: ScanKind) -> &'static str {
    match kind {
        ScanKind::Sonar => super::SONAR_MAX_PARAM,
        ScanKind::Rear => "robot_rear_laser_max",
        _ => "robot_front_laser_max",
    }
}

#[cfg(test)]
#[path = "stream/tests.rs"]
mod tests;
