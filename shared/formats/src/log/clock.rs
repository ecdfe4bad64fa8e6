//! The clock of a log: what each stamp is worth, and what happened to the clock on the way.
//!
//! Lines come in the file's order and leave in it, each with a stamp of one clock that no one set. Told apart:
//!
//! - a line *without a usable stamp* (none, or 0 within a log that has others) takes that of the line before it;
//! - a line *out of place* by up to [`WINDOW_NS`] keeps its stamp, and is put in order later;
//! - a *stray*, farther off than that while the lines after it go on as before, counts as one without a stamp;
//! - a *block* of lines of one source, as loggers write that buffer each source on its own, keeps its stamps, if no source runs
//!   back on itself; it is put in order within [`SORT_NS`];
//! - a *step*: the lines after it go on from the new stamp. Steps back and leaps of more than a day are the clock being set:
//!   the file's order is kept, and later stamps are moved by as much. A shorter leap ahead is a pause, and kept.

use std::collections::{BTreeMap, VecDeque};

use super::clock_report::{ClockReport, ClockStep, StepKind};
use super::fault::CountedBy;
use super::timeline::{Source, TimedLine};
use super::track::Track;

/// How late a line may come and still be put where its stamp says.
pub(crate) const WINDOW_NS: u64 = 2_000_000_000;
/// How late a block of lines of one source may come and still be put where its stamps say.
pub(crate) const SORT_NS: u64 = 20_000_000_000;
/// A jump ahead beyond this is told.
pub(crate) const LEAP_NS: u64 = 60_000_000_000;
/// A leap ahead beyond this is no pause: the clock was set.
const DAY_NS: u64 = 86_400_000_000_000;
/// Made-up time between two lines of one source where the log shows no other.
pub(crate) const DEFAULT_PERIOD_NS: u64 = 100_000_000;
/// Lines, and readings, that may wait for what the lines after them say.
const TRIAL_LINES: usize = 1024;
const TRIAL_WEIGHT: usize = 1 << 18;
/// Offsets of the clock that it may return to.
const OFFSETS_KEPT: usize = 4;

/// A stamped line of the log's one clock; the flag says whether the stamp is its own.
pub(crate) struct Stamped<T> {
    pub(crate) stamp_ns: u64,
    pub(crate) line: TimedLine<T>,
}

/// Why a line waits for those after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Suspicion {
    /// Earlier than another of its source, but near.
    Late,
    /// Earlier than that.
    Back,
    /// Ahead of all before it, by more than a line may be late.
    Ahead,
}

/// What a suspect turned out to be.
enum Verdict {
    OutOfPlace,
    Stray,
    Step,
}

/// Gives lines the stamps of one clock.
pub(crate) struct Clock<T> {
    tracks: BTreeMap<Source, Track>,
    /// What is added to the log's stamps, nanoseconds; earlier ones, too.
    offset_ns: i128,
    earlier_offsets: VecDeque<i128>,
    newest_ns: Option<u64>,
    /// Stamp of the line given out last.
    previous_ns: u64,
    /// Lines before the first that has a stamp.
    head: Vec<TimedLine<T>>,
    head_weight: usize,
    /// The suspect, and what came after it.
    trial: VecDeque<TimedLine<T>>,
    suspicion: Suspicion,
    trial_weight: usize,
    ready: VecDeque<Stamped<T>>,
    report: ClockReport,
}

impl<T> Default for Clock<T> {
    fn default() -> Self {
        Self {
            tracks: BTreeMap::new(),
            offset_ns: 0,
            earlier_offsets: VecDeque::new(),
            newest_ns: None,
            previous_ns: 0,
            head: Vec::new(),
            head_weight: 0,
            trial: VecDeque::new(),
            suspicion: Suspicion::Late,
            trial_weight: 0,
            ready: VecDeque::new(),
            report: ClockReport::default(),
        }
    }
}

impl<T> Clock<T> {
    /// A line, in the file's order.
    pub(crate) fn push(&mut self, line: TimedLine<T>) {
        self.report.lines += 1;
        self.feed(line);
    }

    /// No line follows.
    pub(crate) fn finish(&mut self) {
        if self.newest_ns.is_none() {
            self.behead(0);
        }
        while !self.trial.is_empty() {
            let verdict = self.verdict(true).unwrap_or(Verdict::Stray);
            self.carry_out(&verdict);
        }
    }

    /// The next line.
    pub(crate) fn pop(&mut self) -> Option<Stamped<T>> {
        self.ready.pop_front()
    }

    /// Strays of sources that also have stamps which fit; who never does has a clock of its own.
    pub(crate) fn contradictions(&self) -> u64 {
        self.tracks.values().filter(|track| track.strays <= track.count).map(|track| track.strays).sum()
    }

    /// What happened to the clock so far.
    pub(crate) fn report(&self) -> &ClockReport {
        &self.report
    }

    fn feed(&mut self, line: TimedLine<T>) {
        if self.trial.is_empty() {
            self.consider(line);
        } else {
            self.trial_weight += line.weight;
            self.trial.push_back(line);
        }
        while !self.trial.is_empty() {
            let full = self.trial.len() >= TRIAL_LINES || self.trial_weight >= TRIAL_WEIGHT;
            let Some(verdict) = self.verdict(full) else { break };
            self.carry_out(&verdict);
        }
    }

    /// A line that no suspect stands before.
    fn consider(&mut self, line: TimedLine<T>) {
        let Some(newest_ns) = self.newest_ns else { return self.first(line) };
        // 0 is a stamp where the clock begins, and none later.
        let is_usable = |raw: &u64| *raw != 0 || newest_ns <= WINDOW_NS;
        let Some(raw_ns) = line.stamp_ns.filter(is_usable) else { return self.unstamped(line) };
        // Before the clock's beginning is long ago.
        let stamp_ns = self.at(raw_ns).unwrap_or(0);
        let last_ns = self.tracks.get(&line.source).map_or(0, |track| track.last_ns);
        self.suspicion = if stamp_ns.saturating_add(WINDOW_NS) < newest_ns {
            Suspicion::Back
        } else if stamp_ns > newest_ns.saturating_add(WINDOW_NS) {
            Suspicion::Ahead
        } else if stamp_ns < last_ns {
            Suspicion::Late
        } else {
            return self.accept(stamp_ns, line);
        };
        self.trial_weight = line.weight;
        self.trial.push_back(line);
    }

    /// A line before which none had a stamp. Stamps of 0 are those of a clock that begins there, if it goes on from there.
    fn first(&mut self, line: TimedLine<T>) {
        match line.stamp_ns.filter(|raw| *raw != 0) {
            Some(raw) => {
                self.behead(raw);
                self.accept(raw, line);
            }
            None if self.head_weight >= TRIAL_WEIGHT => {
                self.behead(0);
                self.unstamped(line);
            }
            None => {
                self.head_weight += line.weight + 1;
                self.head.push(line);
            }
        }
    }

    /// The lines before the first that has a stamp stay before it.
    fn behead(&mut self, first_ns: u64) {
        let begins_at_0 = first_ns <= LEAP_NS;
        for line in core::mem::take(&mut self.head) {
            if line.stamp_ns.is_some() && begins_at_0 {
                self.accept(0, line);
            } else {
                self.previous_ns = self.newest_ns.unwrap_or(first_ns);
                self.unstamped(line);
            }
        }
        self.newest_ns.get_or_insert(first_ns);
    }

    /// A stamp of the log as one of the clock; none before the clock's beginning.
    fn at(&self, raw_ns: u64) -> Option<u64> {
        u64::try_from(i128::from(raw_ns) + self.offset_ns).ok()
    }

    fn accept(&mut self, stamp_ns: u64, line: TimedLine<T>) {
        self.newest_ns = Some(self.newest_ns.unwrap_or(0).max(stamp_ns));
        self.tracks.entry(line.source).or_default().add(stamp_ns);
        self.give(stamp_ns, line);
    }

    fn unstamped(&mut self, line: TimedLine<T>) {
        self.report.unstamped += 1;
        let stamp_ns = self.previous_ns;
        self.give(stamp_ns, line);
    }

    fn give(&mut self, stamp_ns: u64, line: TimedLine<T>) {
        self.previous_ns = stamp_ns;
        self.ready.push_back(Stamped { stamp_ns, line });
    }

    /// What the lines after it say of the suspect; none as long as they say too little and may say more.
    fn verdict(&self, is_last_word: bool) -> Option<Verdict> {
        let suspect = self.trial.front()?;
        let raw_ns = suspect.stamp_ns?;
        match self.suspicion {
            Suspicion::Late => self.verdict_of_late(suspect.source, raw_ns, is_last_word),
            Suspicion::Back if self.is_new_to(suspect, raw_ns) => {
                self.verdict_of_block(suspect.source, raw_ns, is_last_word)
            }
            Suspicion::Back | Suspicion::Ahead => self.verdict_of_far(raw_ns, is_last_word),
        }
    }

    /// Whether the source of a line has told of nothing after it.
    fn is_new_to(&self, line: &TimedLine<T>, raw_ns: u64) -> bool {
        let last_ns = self.tracks.get(&line.source).map_or(0, |track| track.last_ns);
        let at_ns = self.at(raw_ns).unwrap_or(0);
        at_ns >= last_ns && at_ns.saturating_add(SORT_NS) >= self.newest_ns.unwrap_or(0)
    }

    /// Whether a line from long before the others, but of a source that does not run back on itself, begins a block that was
    /// buffered, is a stray, or comes from a clock that was set back: then a source will run back on itself.
    fn verdict_of_block(&self, source: Source, suspect_ns: u64, is_last_word: bool) -> Option<Verdict> {
        let (mut block, mut last_ns) = (0_u64, 0);
        for line in &self.trial {
            let Some(raw_ns) = line.stamp_ns.filter(|raw| *raw != 0) else { continue };
            let stamp_ns = self.at(raw_ns).unwrap_or(0);
            if line.source == source {
                if stamp_ns < last_ns {
                    return Some(Verdict::Step);
                }
                last_ns = stamp_ns;
                block += 1;
                continue;
            }
            if raw_ns == suspect_ns {
                // It shares the fault, if it is one.
                continue;
            }
            let goes_on = self.tracks.get(&line.source).is_none_or(|track| stamp_ns >= track.last_ns);
            return Some(match goes_on {
                true if block > 1 => Verdict::OutOfPlace,
                true => Verdict::Stray,
                false => Verdict::Step,
            });
        }
        // The rest of the log: only what was buffered would end so.
        is_last_word.then_some(if block > 1 { Verdict::OutOfPlace } else { Verdict::Stray })
    }

    /// Whether the lines after one that is far off follow it.
    fn verdict_of_far(&self, raw_ns: u64, is_last_word: bool) -> Option<Verdict> {
        // Lines of the very same stamp share its fault.
        let mut after = self.trial.iter().skip(1).filter_map(|line| line.stamp_ns);
        let newest_ns = self.newest_ns.unwrap_or(0);
        let Some(next_ns) = after.find(|next| *next != 0 && *next != raw_ns) else {
            let same = self.trial.iter().filter(|line| line.stamp_ns == Some(raw_ns)).count();
            let is_near = self.at(raw_ns).is_some_and(|at_ns| at_ns.abs_diff(newest_ns) <= LEAP_NS);
            let follows = same > TRIAL_LINES / 2 || (is_near && self.suspicion == Suspicion::Ahead);
            return is_last_word.then_some(if follows { Verdict::Step } else { Verdict::Stray });
        };
        let from_old = self.at(next_ns).map_or(u64::MAX, |next| next.abs_diff(newest_ns));
        Some(if next_ns.abs_diff(raw_ns) <= from_old { Verdict::Step } else { Verdict::Stray })
    }

    /// Whether a line that is a little late is out of place, or the clock was set back: then the lines after it tell once more
    /// of times that its source has told of before.
    fn verdict_of_late(&self, source: Source, raw_ns: u64, is_last_word: bool) -> Option<Verdict> {
        let track = self.tracks.get(&source)?;
        let from_ns = self.at(raw_ns)?;
        let (mut to_ns, mut again, mut passed) = (from_ns, 0_u64, false);
        for line in self.trial.iter().filter(|line| line.source == source) {
            let Some(stamp_ns) = line.stamp_ns.filter(|raw| *raw != 0).and_then(|raw| self.at(raw)) else { continue };
            if stamp_ns > track.last_ns {
                passed = true;
                break;
            }
            if stamp_ns >= from_ns {
                again += 1;
                to_ns = to_ns.max(stamp_ns);
            }
        }
        if !passed && !is_last_word {
            return None;
        }
        let before = track.recent.iter().filter(|stamp| (from_ns..=to_ns).contains(stamp)).count() as u64;
        // So many messages does the source send in that time.
        let period_ns = track.period_ns();
        let usual = (to_ns - from_ns + period_ns / 2) / period_ns + 1;
        let is_step = again >= 2 && 2 * (before + again) > 3 * usual;
        Some(if is_step { Verdict::Step } else { Verdict::OutOfPlace })
    }

    /// Deals with the suspect, and looks at those after it once more.
    fn carry_out(&mut self, verdict: &Verdict) {
        let mut rest = core::mem::take(&mut self.trial);
        let Some(line) = rest.pop_front() else { return };
        match (verdict, line.stamp_ns) {
            (Verdict::Step, Some(raw_ns)) => self.step(raw_ns, line),
            (Verdict::OutOfPlace, Some(raw_ns)) => {
                self.report.reordered += 1;
                let stamp_ns = self.at(raw_ns).unwrap_or(self.previous_ns);
                self.accept(stamp_ns, line);
            }
            (Verdict::Stray, _) | (_, None) => {
                self.report.strays += 1;
                self.tracks.entry(line.source).or_default().strays += 1;
                self.report.stray(line.number);
                let stamp_ns = self.previous_ns;
                self.give(stamp_ns, line);
            }
        }
        while let Some(line) = rest.pop_front() {
            if self.trial.is_empty() {
                self.consider(line);
                continue;
            }
            self.trial_weight += line.weight;
            self.trial.push_back(line);
            self.trial.append(&mut rest);
            self.trial_weight = self.trial.iter().map(|line| line.weight).sum();
        }
    }

    /// The clock goes on from another stamp.
    fn step(&mut self, raw_ns: u64, line: TimedLine<T>) {
        let newest_ns = self.newest_ns.unwrap_or(0);
        let track = self.tracks.get(&line.source);
        let period_ns = track.map_or(DEFAULT_PERIOD_NS, Track::period_ns);
        let next_ns = newest_ns.max(track.map_or(0, |track| track.last_ns).saturating_add(period_ns));
        let old = i128::from(raw_ns) + self.offset_ns;
        let ahead_ns = old - i128::from(newest_ns);
        let kind = match self.suspicion {
            Suspicion::Ahead if ahead_ns <= i128::from(DAY_NS) => StepKind::Pause,
            Suspicion::Ahead => StepKind::SetAhead,
            Suspicion::Back | Suspicion::Late => StepKind::SetBack,
        };
        if kind == StepKind::Pause && ahead_ns <= i128::from(LEAP_NS) {
            return self.accept(u64::try_from(old).unwrap_or(newest_ns), line);
        }
        let by_ns = if kind == StepKind::SetBack { i128::from(next_ns) - old } else { ahead_ns };
        self.report.step(ClockStep { line: line.number, kind, by_s: by_ns as f64 * 1e-9, place: CountedBy::Line });
        if kind == StepKind::Pause {
            return self.accept(u64::try_from(old).unwrap_or(newest_ns), line);
        }
        let goes_on = |offset: &i128| {
            let after = i128::from(raw_ns) + *offset - i128::from(newest_ns);
            (0..=i128::from(LEAP_NS)).contains(&after)
        };
        let returned = self.earlier_offsets.iter().rev().copied().find(goes_on);
        self.earlier_offsets.push_back(self.offset_ns);
        if self.earlier_offsets.len() > OFFSETS_KEPT {
            self.earlier_offsets.pop_front();
        }
        self.offset_ns = returned.unwrap_or(i128::from(next_ns) - i128::from(raw_ns));
        let stamp_ns = self.at(raw_ns).unwrap_or(next_ns);
        // What is told of from here on has not been told of before.
        self.tracks.values_mut().for_each(|track| track.recent.clear());
        self.accept(stamp_ns, line);
    }
}

#[cfg(test)]
mod tests;
