//! What a run came to, for people and as JSON.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use echogrid_core::{Incidents, Verdict};
use echogrid_slam::report::Report;
use serde::Serialize;

use crate::sonars::{Sonar, conspicuous};
use crate::supervisor::Outcome;

/// What a run came to.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// What was mapped: the log's name, or the sensor's.
    pub source: String,
    /// Whether the user stopped it before its end: some of it was not mapped.
    pub stopped: bool,
    /// Scans in the map.
    pub scans: u64,
    /// Odometry poses used.
    pub odometry: u64,
    /// Readings in all.
    pub readings: u64,
    /// Readings in the map.
    pub accepted: u64,
    /// Readings refused, by reason.
    pub refused: Vec<Refused>,
    /// How often a reading was fused again after a fix.
    pub remapped: u64,
    /// Readings that a fix came too late for, or too far off.
    pub remap_left: u64,
    /// What became of the readings of each sonar, by its number.
    pub sonars: Vec<Sonar>,
    /// The sonars that seem to be broken, in words.
    pub conspicuous: Vec<String>,
    /// Travelled by odometry, metres.
    pub distance_m: f64,
    /// Trust in a nominal reading at the end.
    pub trust: f64,
    /// The number of absolute localizations.
    pub fixes: u32,
    /// Absolute localizations that were too far off to be believed.
    pub fixes_refused: u32,
    /// The map of an earlier drive that this one goes on with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub goes_on_with: Option<PathBuf>,
    /// What SLAM did, if it was asked to.
    pub slam: Option<Report>,
    /// Steps of the odometry that no drive makes.
    pub leaps: Option<Incident>,
    /// Fixes that the odometry contradicts, beyond anything that it may be off by.
    pub contradictions: Option<Incident>,
    /// Width and height of the world, metres; none where the sensor knows no world.
    pub world_m: Option<[f64; 2]>,
    /// Cells by what is known of them.
    pub cells: Cells,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Width and height of what is known, metres.
    pub extent_m: [f64; 2],
    /// How long the drive was by the sensor's clock, seconds; none if no stream had a message.
    pub recorded_s: Option<f64>,
    /// How long it took from all services ready to all gone, seconds.
    pub elapsed_s: f64,
    /// How long it took from the first process to all services ready, seconds.
    pub startup_s: f64,
    /// Messages that broke their contract, over all services.
    pub faulty_messages: u64,
    /// Messages that never arrived, over all services.
    pub lost_messages: u64,
    /// How often each service was started again, of those that were.
    pub restarts: BTreeMap<String, u32>,
    /// Services that were given up while the others went on, and why.
    pub given_up: Vec<String>,
    /// What was wrong with the log, counted.
    pub log_faults: Vec<String>,
    /// The files that were written.
    pub files: Vec<PathBuf>,
    /// What the files lack of the map, as who wrote them says.
    pub files_lack: Vec<String>,
    /// The recording of the run, if one was asked for.
    pub recording: Option<Recording>,
}

/// The recording of a run.
#[derive(Debug, Serialize)]
pub struct Recording {
    /// Where it is.
    pub file: PathBuf,
    /// Whether it goes on to the end of the run.
    pub is_whole: bool,
}

/// What went wrong so often.
#[derive(Debug, Serialize)]
pub struct Incident {
    /// The number of times that it went wrong.
    pub count: u32,
    /// The first, seconds since the start; since 1970 or whatever the sensor's clock counts from where that is not known.
    pub first_s: f64,
    /// Stamp of the first, nanoseconds.
    pub first_ns: u64,
    /// The greatest distance, metres.
    pub largest_m: f64,
    /// The greatest angle, radians.
    pub largest_rad: f64,
}

impl Incident {
    fn of(incidents: Incidents, start_ns: Option<u64>) -> Option<Self> {
        let Incidents { count, first_ns, largest_m, largest_rad } = incidents;
        let first_s = first_ns.saturating_sub(start_ns.unwrap_or(0)) as f64 * 1e-9;
        (count > 0).then_some(Self { count, first_s, first_ns, largest_m, largest_rad })
    }

    /// The size and the time of it, in words.
    pub(crate) fn words(&self) -> String {
        let Self { first_s, first_ns, largest_m, largest_rad, .. } = self;
        let degrees = largest_rad.to_degrees();
        format!(
            "by up to {largest_m:.2} m and {degrees:.0}°, first after {first_s:.1} s (stamp {:.3})",
            *first_ns as f64 * 1e-9
        )
    }
}

/// Readings refused for one reason.
#[derive(Debug, Serialize)]
pub struct Refused {
    /// The reason, as a key.
    pub reason: &'static str,
    /// The number of readings refused.
    pub readings: u64,
}

/// Cells by what is known of them.
#[derive(Debug, Default, Serialize)]
pub struct Cells {
    /// Touched by some reading.
    pub known: u64,
    /// The number of cells with p > 0.65.
    pub occupied: u64,
    /// The number of cells with p < 0.35.
    pub free: u64,
}

impl Summary {
    /// The summary of a run over a recording that begins at `first_ns` (none: as the services say), with cells of `resolution_m`.
    #[must_use]
    pub fn of(outcome: &Outcome, source: String, first_ns: Option<u64>, resolution_m: f64) -> Self {
        let last_ns = outcome.health.values().map(|health| health.stamp_ns).max().unwrap_or(0);
        let map = outcome.map.clone().unwrap_or_default();
        let extent_m = map.bounds.map_or([0.0; 2], |(low, high)| {
            let side_m = |low: i32, high: i32| (f64::from(high) - f64::from(low) + 1.0) * resolution_m;
            [side_m(low.i, high.i), side_m(low.j, high.j)]
        });
        let refused = map
            .verdicts
            .iter()
            .filter(|(verdict, count)| *verdict != Verdict::Accepted && *count > 0)
            .map(|(verdict, readings)| Refused { reason: verdict.name(), readings })
            .collect();
        let acknowledged = |topic| {
            let acks = outcome.health.values().flat_map(|health| &health.acks);
            acks.filter(|ack| ack.topic == topic).map(|ack| ack.sequence).max().unwrap_or(0)
        };
        Self {
            source,
            stopped: outcome.stopped,
            scans: map.scans,
            // The end of the stream has a number too.
            odometry: acknowledged(echogrid_topics::Topic::OdometryRaw).saturating_sub(1),
            readings: map.verdicts.total(),
            accepted: map.verdicts.get(Verdict::Accepted),
            refused,
            remapped: map.remapped,
            remap_left: map.remap_left,
            conspicuous: conspicuous(&map.sonars),
            sonars: map.sonars.iter().map(Sonar::of).collect(),
            distance_m: map.distance_m,
            trust: map.trust,
            fixes: map.fixes,
            fixes_refused: map.fixes_refused,
            goes_on_with: None,
            slam: None,
            leaps: Incident::of(map.leaps, first_ns),
            contradictions: Incident::of(map.contradictions, first_ns),
            world_m: outcome.world.as_ref().map(|world| {
                let [[x_low, y_low], [x_high, y_high]] = world.bounds_m;
                [x_high - x_low, y_high - y_low]
            }),
            cells: Cells { known: map.cells_known, occupied: map.cells_occupied, free: map.cells_free },
            resolution_m,
            extent_m,
            recorded_s: first_ns.or(outcome.first_ns).map(|first_ns| last_ns.saturating_sub(first_ns) as f64 * 1e-9),
            elapsed_s: outcome.elapsed.as_secs_f64(),
            startup_s: outcome.startup.as_secs_f64(),
            faulty_messages: sum(outcome.health.values().map(|health| health.faults)),
            lost_messages: sum(outcome.health.values().map(|health| health.lost)),
            restarts: outcome.restarts.clone(),
            given_up: outcome.given_up.clone(),
            log_faults: Vec::new(),
            files: Vec::new(),
            files_lack: Vec::new(),
            recording: None,
        }
    }
}

/// What to think of leaps.
const AFTER_A_LEAP: &str =
    "the map goes on from where the robot was, with the doubt of how far it may have driven meanwhile";
/// What to think of fixes that contradict.
const AFTER_CONTRADICTION: &str = "are they of this drive, in metres and radians, x and y in order?";

/// How often the robot was localized, as the end of a line.
pub(crate) fn localized(fixes: u32) -> String {
    match fixes {
        0 => String::new(),
        1 => ", localized once".to_owned(),
        fixes => format!(", localized {fixes} times"),
    }
}

/// What services say of themselves may be anything.
fn sum(counts: impl Iterator<Item = u64>) -> u64 {
    counts.fold(0, u64::saturating_add)
}

fn percent(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { 100.0 * part as f64 / whole as f64 }
}

fn clock(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    if whole >= 60 { format!("{} min {:02} s", whole / 60, whole % 60) } else { format!("{seconds:.1} s") }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stopped = if self.stopped { " (stopped before its end)" } else { "" };
        let Self { source, scans, odometry, distance_m, .. } = self;
        let within = clock(self.recorded_s.unwrap_or(self.elapsed_s));
        writeln!(f, "{source}: {scans} scans, {odometry} poses, {distance_m:.1} m in {within}{stopped}")?;
        write!(
            f,
            "readings  {} used of {} ({:.0} %)",
            self.accepted,
            self.readings,
            percent(self.accepted, self.readings)
        )?;
        for (i, refused) in self.refused.iter().enumerate() {
            let lead = if i == 0 { "; refused: " } else { ", " };
            write!(f, "{lead}{} {}", refused.readings, refused.reason.replace('_', " "))?;
        }
        if self.remapped > 0 {
            write!(f, "; {} fused again after a fix", self.remapped)?;
        }
        if self.remap_left > 0 {
            write!(f, "; {} not, though a fix came", self.remap_left)?;
        }
        writeln!(f)?;
        for sonar in &self.conspicuous {
            writeln!(f, "sonars    {sonar}")?;
        }
        if let Some([width_m, height_m]) = self.world_m {
            writeln!(f, "world     {width_m:.1} × {height_m:.1} m")?;
        }
        let Cells { known, occupied, free } = self.cells;
        writeln!(
            f,
            "map       {:.1} × {:.1} m, {known} cells of {} m known: {:.0} % free, {:.0} % occupied, {:.0} % undecided",
            self.extent_m[0],
            self.extent_m[1],
            self.resolution_m,
            percent(free, known),
            percent(occupied, known),
            percent(known.saturating_sub(free).saturating_sub(occupied), known),
        )?;
        write!(f, "trust     {:.3} at the end (weight of a reading; 1: no odometry error)", self.trust)?;
        let refused = match self.fixes_refused {
            0 => String::new(),
            refused => format!(", refused as too far off {refused}"),
        };
        writeln!(f, "{}{refused}", localized(self.fixes))?;
        if let Some(slam) = &self.slam {
            writeln!(f, "slam      {}", crate::commands::closures::summary(slam))?;
        }
        if let Some(leaps) = &self.leaps {
            let times = if leaps.count == 1 { "once".to_owned() } else { format!("{} times", leaps.count) };
            writeln!(f, "odometry  leapt {times} {}: no drive does; {AFTER_A_LEAP}", leaps.words())?;
        }
        if let Some(contradicted) = &self.contradictions {
            let (count, of) = (contradicted.count, u64::from(self.fixes) + u64::from(self.fixes_refused));
            writeln!(
                f,
                "fixes     {count} of {of} contradict the odometry {}; {AFTER_CONTRADICTION}",
                contradicted.words()
            )?;
        }
        let speed = self.recorded_s.filter(|_| self.elapsed_s > 0.0).map(|recorded_s| recorded_s / self.elapsed_s);
        let speed = speed.map_or(String::new(), |speed| format!(" ({speed:.0} × real time)"));
        writeln!(f, "time      {:.2} s{speed}, start-up {:.2} s", self.elapsed_s, self.startup_s)?;
        if self.lost_messages > 0 || self.faulty_messages > 0 {
            writeln!(f, "messages  {} lost, {} refused as faulty", self.lost_messages, self.faulty_messages)?;
        }
        if !self.restarts.is_empty() {
            let restarts: Vec<String> = self.restarts.iter().map(|(name, count)| format!("{name} {count} ×")).collect();
            writeln!(f, "restarts  {}", restarts.join(", "))?;
        }
        for given_up in &self.given_up {
            writeln!(f, "given up  {given_up}")?;
        }
        for fault in &self.log_faults {
            writeln!(f, "log       {fault}")?;
        }
        for (i, file) in self.files.iter().enumerate() {
            writeln!(f, "{}{}", if i == 0 { "files     " } else { "          " }, file.display())?;
        }
        for lack in &self.files_lack {
            writeln!(f, "          {lack}")?;
        }
        if let Some(Recording { file, is_whole }) = &self.recording {
            let early = if *is_whole { "" } else { ": ended before the run did" };
            writeln!(f, "recording {}{early}", file.display())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::{CellIndex, VerdictCounts};
    use echogrid_topics::{Health, MapInfo, ServiceState};

    use super::*;

    /// What a faulty process says must not take the launcher down with it.
    #[test]
    fn any_numbers_make_a_summary() {
        let mut verdicts = VerdictCounts::default();
        Verdict::ALL.into_iter().for_each(|verdict| verdicts.add_many(verdict, u64::MAX));
        let map = MapInfo {
            cells_known: u64::MAX,
            cells_occupied: u64::MAX,
            cells_free: u64::MAX,
            bounds: Some((CellIndex { i: i32::MIN, j: i32::MAX }, CellIndex { i: i32::MAX, j: i32::MIN })),
            verdicts,
            ..MapInfo::default()
        };
        let health = |name: &str| Health {
            service: name.into(),
            pid: 0,
            state: ServiceState::Running,
            progress: u64::MAX,
            total: 0,
            stamp_ns: u64::MAX,
            first_stamp_ns: u64::MAX,
            faults: u64::MAX,
            lost: u64::MAX,
            acks: Vec::new(),
            waits_for: None,
            last_error: String::new(),
            note: String::new(),
        };
        let health = ["a", "b"].map(|name| (name.to_owned(), health(name))).into();
        let outcome = Outcome { map: Some(map), health, ..Outcome::default() };
        let summary = Summary::of(&outcome, "sensor".into(), Some(u64::MAX), 0.05);
        assert_eq!((summary.readings, summary.faulty_messages), (u64::MAX, u64::MAX));
        assert!(summary.to_string().contains("100 % occupied"), "{summary}");
    }
}
