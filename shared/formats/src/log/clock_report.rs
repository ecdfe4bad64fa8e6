//! What happened to a log's clock.

use serde::Serialize;

use super::carried::Tally;
use super::fault::CountedBy;

/// Steps of a clock that are told one by one.
const STEPS_KEPT: usize = 8;

/// What a log's stamps are, and what was made of them.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ClockReport {
    /// Whether the stamps are of no use at all: events keep the order of their lines, and stamps are made up, 0.1 s from one
    /// odometry line to the next, a scan at the stamp of the odometry line before it.
    pub order_only: bool,
    /// By how much the way in the order of stamps was longer than in that of the file, where that made them useless; metres.
    pub detour_m: f64,
    /// Messages in all.
    pub lines: u64,
    /// Messages without a usable stamp, which stay beside their neighbours in the file.
    pub unstamped: u64,
    /// Messages earlier than one of their kind before them, by less than 2 s, which were put in order.
    pub reordered: u64,
    /// Messages whose stamp is far from those around them, which stay beside their neighbours in the file.
    pub strays: u64,
    /// Line of the first of these.
    pub first_stray: Option<u64>,
    /// How often the clock was set or paused.
    pub step_count: u64,
    /// How often of these it was set.
    pub set_count: u64,
    /// The first of these.
    pub steps: Vec<ClockStep>,
    /// Scans whose stamps are not those of the poses that they carry, of another clock than the odometry's: they count where they
    /// stand in the file.
    pub displaced: u64,
    /// Line of the first of these.
    pub first_displaced: Option<u64>,
    /// How late their stamps were on average, seconds; negative: early.
    pub displaced_by_s: f64,
    /// Poses that a scan before them carries, too, and that have no stamp: they count at the stamp of that scan.
    pub restated: u64,
    /// Messages of one kind at one stamp, which were spread over the time to the next.
    pub spread: u64,
    /// The line in which the first of these is.
    pub first_spread: Option<u64>,
    /// The longest time that messages were spread over, seconds.
    pub longest_spread_s: f64,
    /// Time that the stamps do not show, made up because the clock stood still, seconds.
    pub stood_still_s: f64,
    /// What is counted where a line is named.
    pub place: CountedBy,
}

/// How a clock goes on from another stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StepKind {
    /// It was set back: later stamps are moved on by as much.
    SetBack,
    /// It was set ahead, by more than a day: later stamps are moved back by as much.
    SetAhead,
    /// Nothing came for more than a minute: stamps are as they stand.
    Pause,
}

/// A step of a clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ClockStep {
    /// The first line after it.
    pub line: u64,
    /// Which way the clock stepped.
    pub kind: StepKind,
    /// The size of the step, seconds, never negative.
    pub by_s: f64,
    /// What is counted.
    pub place: CountedBy,
}

impl ClockReport {
    /// Says what is counted.
    pub(crate) fn count_in(&mut self, place: CountedBy) {
        self.place = place;
        self.steps.iter_mut().for_each(|step| step.place = place);
    }

    pub(crate) fn step(&mut self, step: ClockStep) {
        self.step_count += 1;
        self.set_count += u64::from(step.kind != StepKind::Pause);
        if self.steps.len() < STEPS_KEPT {
            self.steps.push(step);
        }
    }

    /// With what was made of equal stamps.
    pub(crate) fn with_spread(self, spread: Self) -> Self {
        let Self { spread, first_spread, longest_spread_s, stood_still_s, .. } = spread;
        Self { spread, first_spread, longest_spread_s, stood_still_s, ..self }
    }

    /// With what was made of the poses that scans carry.
    pub(crate) fn with_carried(self, tally: Tally) -> Self {
        let Tally { restated, displaced, first_displaced, off_s } = tally;
        Self { restated, displaced, first_displaced, displaced_by_s: off_s / displaced.max(1) as f64, ..self }
    }

    pub(crate) fn stray(&mut self, line: u64) {
        self.first_stray.get_or_insert(line);
    }

    /// Whether the stamps are in order as they stand.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        *self == Self { lines: self.lines, place: self.place, ..Self::default() }
    }

    /// Why the stamps of events are not the log's own time, which other files may share; none if they are.
    #[must_use]
    pub fn invented(&self) -> Option<String> {
        if self.order_only {
            return Some("its stamps are of no use, and time is made up from the order of its lines".to_owned());
        }
        if let Some(step) = self.steps.iter().find(|step| step.kind != StepKind::Pause) {
            return Some(format!("{step}, so later stamps are not its own"));
        }
        (self.stood_still_s > 0.0)
            .then(|| format!("its clock stood still for {}, so later stamps are not its own", span(self.stood_still_s)))
    }

    /// What is odd in words, a sentence for each.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        if self.order_only {
            let why = match self.detour_m {
                0.0 => String::new(),
                detour_m => format!(" (in their order the way would be {detour_m:.1} m longer)"),
            };
            return vec![format!("its stamps are of no use{why}: only the order counts, 0.1 s from pose to pose")];
        }
        let mut remarks = Vec::new();
        let place = self.place;
        let mut say = |count: u64, remark: &dyn Fn() -> String| {
            if count > 0 {
                remarks.push(remark());
            }
        };
        for step in &self.steps {
            say(1, &|| match step.kind {
                StepKind::Pause => format!("nothing comes for {} before {place} {}", span(step.by_s), step.line),
                _ => format!("{step}: the file's order is kept, later stamps are moved"),
            });
        }
        let untold = self.step_count - self.steps.len() as u64;
        say(untold, &|| format!("its clock was set or paused {untold} more times"));
        let restated = if self.restated > 0 {
            format!(", {} of them repeat the pose of a scan and count at its stamp", self.restated)
        } else {
            String::new()
        };
        let unstamped = self.unstamped + self.restated;
        say(unstamped, &|| {
            format!("{unstamped} messages have no usable stamp and stay beside their neighbours{restated}")
        });
        say(self.displaced, &|| {
            format!(
                "{} scans have stamps of another clock than the odometry's, {:.2} s {} on average, first in {place} {}: they are where the \
                 poses that they carry say",
                self.displaced,
                self.displaced_by_s.abs(),
                if self.displaced_by_s < 0.0 { "early" } else { "late" },
                self.first_displaced.unwrap_or(0)
            )
        });
        say(self.strays, &|| {
            let line = self.first_stray.unwrap_or(0);
            format!("{} stamps are far from those around them, first in {place} {line}, and do not count", self.strays)
        });
        say(self.reordered, &|| format!("{} stamps ran backwards and were put in order", self.reordered));
        say(self.spread, &|| {
            format!(
                "{} messages have the stamp of one of their kind before them, first in {place} {}, and were spread, over up to {}",
                self.spread,
                self.first_spread.unwrap_or(0),
                span(self.longest_spread_s)
            )
        });
        say(u64::from(self.stood_still_s > 0.0), &|| {
            format!("its clock stood still for {}: later stamps are moved on", span(self.stood_still_s))
        });
        remarks
    }
}

impl core::fmt::Display for ClockStep {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let what = match self.kind {
            StepKind::SetBack => "its clock was set back by",
            StepKind::SetAhead => "its clock was set ahead by",
            StepKind::Pause => "nothing comes for",
        };
        write!(f, "{what} {} at {} {}", span(self.by_s), self.place, self.line)
    }
}

/// A span of time for people.
fn span(seconds: f64) -> String {
    const UNITS: [(f64, &str); 4] = [(31_557_600.0, "years"), (86_400.0, "days"), (3600.0, "h"), (60.0, "min")];
    match UNITS.iter().find(|(unit, _)| seconds >= 2.0 * unit) {
        Some((unit, name)) => format!("{:.1} {name}", seconds / unit),
        None => format!("{seconds:.1} s"),
    }
}
