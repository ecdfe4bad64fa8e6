//! `echogrid why`: the readings that made a cell what it is.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use echogrid_core::log_odds::{FREE_BELOW, OCCUPIED_ABOVE, probability_of};
use echogrid_core::why::{Said, why};
use echogrid_core::{CellIndex, Echo, Grid, Pose2, Verdict};
use echogrid_formats::map::native;
use echogrid_formats::map::readings::{self, READINGS_FILE, ReadingsDocument};
use serde::Serialize;

/// What is asked.
pub(super) struct Request {
    /// Metres, map frame.
    pub(super) at: [f64; 2],
    pub(super) map: PathBuf,
    pub(super) json: bool,
    /// The strongest so many readings.
    pub(super) limit: Option<usize>,
}

/// The answer.
#[derive(Debug, Serialize)]
struct Answer<'a> {
    map: &'a Path,
    /// Centre of the cell, metres.
    cell_m: [f64; 2],
    /// What the map says: occupied, free, undecided, unknown or outside.
    state: &'static str,
    /// None: unknown.
    log_odds: Option<f32>,
    probability: Option<f64>,
    /// Log-odds that the kept readings come to.
    replayed_log_odds: Option<f32>,
    /// Whether that is what the map says.
    exact: bool,
    /// Older readings that there was no room for.
    given_up: u64,
    /// Log-odds that what is known along walls added.
    along_walls_added: f64,
    /// How often the robot drove over it, and the log-odds that this added.
    driven_over: usize,
    driven_added: f64,
    /// Readings that moved the cell.
    readings_used: usize,
    /// Readings that would have, and were refused.
    readings_refused: usize,
    /// By sonar; all beams of lidars as one.
    sensors: Vec<OfSensor>,
    /// In order of time; no more than were asked for.
    readings: Vec<Line>,
}

#[derive(Debug, Serialize)]
struct OfSensor {
    /// `sonar 3` or `lidar`.
    sensor: String,
    added: f64,
    readings: usize,
    refused: usize,
}

/// One reading.
#[derive(Debug, Serialize)]
struct Line {
    /// On the clock of the log, nanoseconds.
    stamp_ns: Option<u64>,
    /// Since the map's first, seconds.
    time_s: Option<f64>,
    scan: u64,
    transducer: u16,
    sonar: Option<u16>,
    /// None: nothing came back.
    range_m: Option<f64>,
    x_m: f64,
    y_m: f64,
    heading_rad: f64,
    /// w of eq 21, in (0, 1].
    trust: f64,
    /// How much of it was new.
    news: f64,
    log_odds_before: Option<f32>,
    log_odds_after: Option<f32>,
    added: f64,
    verdict: &'static str,
}

/// Answers.
pub(super) fn run(request: &Request) -> Result<()> {
    let [x, y] = request.at;
    ensure!(x.is_finite() && y.is_finite(), "({x}, {y}) is no place: expected metres");
    let document = native::read(&request.map)?;
    let file = request.map.with_file_name(READINGS_FILE);
    if !file.exists() {
        bail!(
            "{}: no readings were kept of this map; map again with --set mapper.keep_readings=true, and ask then",
            file.display()
        );
    }
    let kept = readings::read(&file)?;
    let grid = &document.grid;
    ensure!(
        kept.mapper.resolution_m == grid.resolution_m(),
        "{}: of a map with cells of {} m, but {} has cells of {} m: it is of another map",
        file.display(),
        kept.mapper.resolution_m,
        request.map.display(),
        grid.resolution_m()
    );
    let cell = grid.cell_at(x, y);
    // A graph that runs on may have taken in more since the map was saved.
    let revision = grid.tile(cell.tile()).map_or(u64::MAX, |tile| tile.revision);
    let in_map = kept.readings.iter().filter(|reading| reading.sequence <= revision);
    let answered = why(&kept.mapper, &kept.robot, in_map, request.at).with_context(|| file.display().to_string())?;
    let first_ns = document.path.first().map(|point| point.stamp_ns).into_iter();
    let first_ns = first_ns.chain(kept.scans.first().map(|scan| scan.1)).min().unwrap_or(0);
    let log_odds = grid.log_odds(cell);
    let mut sensors: BTreeMap<Option<u16>, OfSensor> = BTreeMap::new();
    for said in &answered.said {
        let none = || OfSensor { sensor: name(said.sonar), added: 0.0, readings: 0, refused: 0 };
        let of = sensors.entry(said.sonar).or_insert_with(none);
        of.added += said.added;
        *(if said.kept.verdict == Verdict::Accepted { &mut of.readings } else { &mut of.refused }) += 1;
    }
    let sensors: Vec<OfSensor> = sensors.into_values().collect();
    let sum = |of: fn(&OfSensor) -> usize| sensors.iter().map(of).sum();
    let answer = Answer {
        map: &request.map,
        cell_m: grid.centre(cell),
        state: state(grid, cell, log_odds),
        log_odds,
        probability: log_odds.map(|log_odds| probability_of(f64::from(log_odds))),
        replayed_log_odds: answered.log_odds,
        exact: answered.log_odds.map(f32::to_bits) == log_odds.map(f32::to_bits),
        given_up: kept.given_up,
        along_walls_added: answered.along_walls_added,
        driven_over: answered.driven_over,
        driven_added: answered.driven_added,
        readings_used: sum(|of| of.readings),
        readings_refused: sum(|of| of.refused),
        readings: strongest(answered.said, request.limit).iter().map(|said| line(said, &kept, first_ns)).collect(),
        sensors,
    };
    super::print_found(&answer, request.json)
}

fn name(sonar: Option<u16>) -> String {
    sonar.map_or_else(|| "lidar".to_owned(), |number| format!("sonar {number}"))
}

fn state(grid: &Grid, cell: CellIndex, log_odds: Option<f32>) -> &'static str {
    let within = |low: i32, at: i32, high: i32| (low..=high).contains(&at);
    let is_inside =
        grid.bounds().is_some_and(|(low, high)| within(low.i, cell.i, high.i) && within(low.j, cell.j, high.j));
    match log_odds.map(|log_odds| probability_of(f64::from(log_odds))) {
        None if is_inside => "unknown",
        None => "outside",
        Some(p) if p > OCCUPIED_ABOVE => "occupied",
        Some(p) if p < FREE_BELOW => "free",
        Some(_) => "undecided",
    }
}

/// Those that added the most, still in order of time.
fn strongest(said: Vec<Said>, limit: Option<usize>) -> Vec<Said> {
    let mut numbered: Vec<(usize, Said)> = said.into_iter().enumerate().collect();
    numbered.sort_by(|(_, a), (_, b)| b.added.abs().total_cmp(&a.added.abs()));
    numbered.truncate(limit.unwrap_or(usize::MAX));
    numbered.sort_by_key(|(number, _)| *number);
    numbered.into_iter().map(|(_, said)| said).collect()
}

fn line(said: &Said, document: &ReadingsDocument, first_ns: u64) -> Line {
    let Said { kept, sonar, before, after, added } = said;
    let Pose2 { x, y, theta } = kept.pose;
    let stamp_ns = document.stamp_ns(kept);
    Line {
        stamp_ns,
        time_s: stamp_ns.map(|stamp_ns| stamp_ns.saturating_sub(first_ns) as f64 * 1e-9),
        scan: kept.sequence,
        transducer: kept.reading.transducer,
        sonar: *sonar,
        range_m: if let Echo::Hit { range_m } = kept.reading.echo { Some(range_m) } else { None },
        x_m: x,
        y_m: y,
        heading_rad: theta,
        trust: kept.deviations.trust,
        news: kept.news,
        log_odds_before: *before,
        log_odds_after: *after,
        added: *added,
        verdict: kept.verdict.name(),
    }
}

impl fmt::Display for Answer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y] = self.cell_m;
        write!(f, "cell at ({x:.3}, {y:.3}) of {}: ", self.map.display())?;
        match (self.state, self.log_odds.zip(self.probability)) {
            ("outside", _) => writeln!(f, "outside of what the map knows")?,
            (_, None) => writeln!(f, "unknown: no reading touched it")?,
            (state, Some((log_odds, p))) => writeln!(f, "{state}, probability {p:.3}, log-odds {log_odds:+.3}")?,
        }
        writeln!(
            f,
            "{} readings moved it; {} that would have were refused",
            self.readings_used, self.readings_refused
        )?;
        if !self.readings.is_empty() {
            writeln!(
                f,
                "{:>10} {:>7} {:>9} {:>8}  {:<24} {:>6}  log-odds",
                "time", "scan", "sensor", "range", "robot", "weight"
            )?;
        }
        self.readings.iter().try_for_each(|line| writeln!(f, "{line}"))?;
        let left_out = self.readings_used + self.readings_refused - self.readings.len();
        if left_out > 0 {
            writeln!(f, "… and {left_out} others (--limit)")?;
        }
        for OfSensor { sensor, added, readings, refused } in &self.sensors {
            match (readings, refused) {
                (0, _) => writeln!(f, "{sensor}: {refused} refused")?,
                (_, 0) => writeln!(f, "{sensor}: {added:+.2} in {readings} readings")?,
                _ => writeln!(f, "{sensor}: {added:+.2} in {readings} readings, {refused} refused")?,
            }
        }
        if self.driven_over > 0 {
            writeln!(
                f,
                "the robot itself: {:+.2}, it drove over the cell ({} times)",
                self.driven_added, self.driven_over
            )?;
        }
        if self.along_walls_added != 0.0 {
            writeln!(f, "what is known along walls: {:+.2}", self.along_walls_added)?;
        }
        if self.given_up > 0 {
            writeln!(f, "note: {} older readings are not among them (mapper.keep_readings_max)", self.given_up)?;
        }
        if !self.exact {
            let come_to = self.replayed_log_odds.map_or("unknown".to_owned(), |log_odds| format!("{log_odds:+.3}"));
            writeln!(
                f,
                "note: these readings come to {come_to}, which is not what the map says: not all of its own are among them"
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let time = self.time_s.map_or("?".to_owned(), |time_s| format!("{time_s:.2} s"));
        let sensor = self.sonar.map_or_else(|| format!("beam {}", self.transducer), |number| format!("sonar {number}"));
        let range = self.range_m.map_or("no echo".to_owned(), |range_m| format!("{range_m:.3} m"));
        let robot = format!("({:.2}, {:.2}, {:.1}deg)", self.x_m, self.y_m, self.heading_rad.to_degrees());
        write!(f, "{time:>10} {:>7} {sensor:>9} {range:>8}  {robot:<24} ", self.scan)?;
        if self.verdict != Verdict::Accepted.name() {
            return write!(f, "{:>6}  refused: {}", "-", self.verdict);
        }
        let of = |log_odds: Option<f32>| log_odds.map_or("unknown".to_owned(), |log_odds| format!("{log_odds:+.3}"));
        let Self { trust, news, added, .. } = self;
        write!(f, "{:>6.3}  {} -> {} ({added:+.3})", trust * news, of(self.log_odds_before), of(self.log_odds_after))
    }
}
