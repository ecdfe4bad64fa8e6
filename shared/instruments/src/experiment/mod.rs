//! `echogrid experiment paper`: the experiment of the paper's section 4, with a simulated robot. One drive, mapped in several
//! ways, each against the truth.

mod report;
mod variant;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use echogrid_core::{CellIndex, Grid, Pose2, TILE_SIDE, World, log_odds};
use echogrid_formats::map::sheet::{self, Row, Sheet};
use echogrid_formats::{probe_file, write_whole};
use echogrid_judge::Quality;
use echogrid_judge::quality::{QualityError, SIGHT_M, TrueCell, Truth};
use echogrid_publisher::PublisherService;
use echogrid_simulator::world_of;

use self::report::{Moment, Report, Score};
use self::variant::{Drive, Variant};
use crate::observer::{Observer, Seen};
use crate::{in_process, json};
use echogrid_config::Config;

/// A cell is behind a wall where it is this far from every wall, and no place of the way has sight of it.
const BEHIND_M: f64 = 0.3;
/// The frame goes so far beyond the world.
const MARGIN_M: f64 = 1.0;

/// What is run, and where it is saved.
#[derive(Debug, Clone)]
pub struct Request {
    /// The folder of the maps, the sheet and the scores.
    pub out: PathBuf,
    /// The file of the world; none: the office.
    pub world: Option<PathBuf>,
    /// What the odometry's errors and the echoes are drawn from.
    pub seed: u64,
    /// The scores are told as JSON.
    pub json: bool,
}

/// Carries out the experiment; its scores, as text or JSON.
///
/// # Errors
/// The world can't be read, the drive can't be made in it, or a file can't be written.
pub fn run(request: &Request) -> Result<String> {
    let drive = Drive::of(request.world.as_deref(), request.seed);
    // Whatever is wrong is said before anything is made.
    let world = world_of(&Variant::ignored().config(&drive, &request.out)?.simulator)?;
    std::fs::create_dir_all(&request.out).with_context(|| format!("making the folder {}", request.out.display()))?;
    ["experiment.png", "scores.json"].iter().try_for_each(|name| probe_file(&request.out.join(name)))?;
    // The moments are those of the map that asks where the robot is: the drive doesn't depend on who maps.
    let scout = play(&Variant::localized().config(&drive, &request.out)?, None, Vec::new())?;
    let moments = moments(&scout);
    let stamps: Vec<u64> = moments.iter().map(|moment| moment.stamp_ns).collect();
    let variants = variant::all(scout.fixes_ns.len(), way_m(&scout.true_path));
    let seen = std::thread::scope(|scope| {
        let map = |variant: &Variant| map(variant, &drive, &request.out, stamps.clone());
        let threads: Vec<_> = variants.iter().map(|variant| scope.spawn(move || map(variant))).collect();
        let joined =
            threads.into_iter().map(|thread| thread.join().map_err(|_| anyhow!("a mapping thread panicked"))?);
        joined.collect::<Result<Vec<Seen>>>()
    })?;
    let scores = judge(&variants, &seen, &world, &scout.true_path)
        .with_context(|| format!("the maps of {}", drive.world.display()))?;
    let sheet = request.out.join("experiment.png");
    write_sheet(&sheet, &world, &scout.true_path, &moments, &variants, seen)?;
    let report = Report {
        world: drive.world,
        seed: drive.seed,
        way_m: way_m(&scout.true_path),
        duration_s: (scout.last_ns - scout.first_ns) as f64 * 1e-9,
        moments,
        variants: scores,
        sheet,
    };
    let json = json(&report)?;
    write_whole(&request.out.join("scores.json"), json.as_bytes())?;
    Ok(if request.json { json } else { report.to_string() })
}

/// The drive, mapped as `config` says, and looked at in its `moments`.
fn play(config: &Config, publisher: Option<PublisherService>, moments: Vec<u64>) -> Result<Seen> {
    let mut observer = Observer::new(config.mapper.resolution_m, publisher, moments);
    in_process::run(config, &mut observer)?;
    observer.into_seen()
}

/// Maps the drive in one way, and saves the map.
fn map(variant: &Variant, drive: &Drive, out: &Path, moments: Vec<u64>) -> Result<Seen> {
    let folder = out.join(variant.name);
    let config = variant.config(drive, &folder)?;
    let provenance = config.provenance(None)?;
    let publisher = PublisherService::new(config.publisher.clone(), folder, provenance)?;
    play(&config, Some(publisher), moments).with_context(|| format!("mapping in the way {:?}", variant.name))
}

/// All maps against one truth, as `echogrid score` judges each.
fn judge(variants: &[Variant], seen: &[Seen], world: &World, path: &[Pose2]) -> Result<Vec<Score>, QualityError> {
    let resolution_m = seen.first().map_or(1.0, |seen| seen.grid.resolution_m());
    // As large as all of them together.
    let mut extent = Grid::new(resolution_m);
    for cell in seen.iter().filter_map(|seen| seen.grid.bounds()).flat_map(|(low, high)| [low, high]) {
        extent.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 0.0;
    }
    let truth = Truth::of(world, path, &extent)?;
    let scores = variants.iter().zip(seen).map(|(variant, seen)| {
        let quality = Quality::against(&seen.grid, &truth)?;
        Ok(score(variant, seen, world, &truth, quality))
    });
    scores.collect()
}

fn score(variant: &Variant, seen: &Seen, world: &World, truth: &Truth, quality: Quality) -> Score {
    let (mut occupied, mut walls_behind, mut free_behind) = (0_u64, 0_u64, 0_u64);
    let (occupied_above, free_below) =
        (log_odds::log_odds_of(log_odds::OCCUPIED_ABOVE), log_odds::log_odds_of(log_odds::FREE_BELOW));
    for (cell, log_odds) in known_cells(&seen.grid) {
        let (is_occupied, is_free) = (log_odds > occupied_above, log_odds < free_below);
        if !(is_occupied || is_free) {
            continue;
        }
        let behind =
            truth.at(cell) == TrueCell::Open && world.clearance_m(seen.grid.centre(cell), 2.0 * BEHIND_M) > BEHIND_M;
        occupied += u64::from(is_occupied);
        walls_behind += u64::from(is_occupied && behind);
        free_behind += u64::from(is_free && behind);
    }
    let cell_m2 = seen.grid.resolution_m() * seen.grid.resolution_m();
    Score {
        name: variant.name,
        about: variant.about.clone(),
        sonars: if variant.all_sonars { 16 } else { variant::SIDE_SONARS.len() },
        fixes: seen.fixes_ns.len(),
        readings_used: seen.readings_used,
        quality,
        false_walls: if occupied == 0 { 0.0 } else { walls_behind as f64 / occupied as f64 },
        walls_behind_m2: walls_behind as f64 * cell_m2,
        free_behind_m2: free_behind as f64 * cell_m2,
        trust: seen.moments.iter().map(|moment| moment.trust).collect(),
        off_m: seen.moments.iter().map(|moment| moment.off_m()).collect(),
    }
}

/// Every cell that a reading touched, and its log-odds.
fn known_cells(grid: &Grid) -> impl Iterator<Item = (CellIndex, f64)> {
    grid.tiles().flat_map(|(index, tile)| {
        let first = index.first_cell();
        let cells = tile.log_odds.iter().enumerate().filter(|(_, log_odds)| !log_odds.is_nan());
        cells.map(move |(offset, log_odds)| {
            let (column, row) = ((offset % TILE_SIDE) as i32, (offset / TILE_SIDE) as i32);
            let cell = CellIndex { i: first.i.saturating_add(column), j: first.j.saturating_add(row) };
            (cell, f64::from(*log_odds))
        })
    })
}

/// The moments that the sheet shows, by the fixes of the map that asks for them (Figs 9, 13 to 15).
fn moments(scout: &Seen) -> Vec<Moment> {
    let at = |share: f64| scout.first_ns + ((scout.last_ns - scout.first_ns) as f64 * share) as u64;
    let moment = |what: &str, stamp_ns: u64| {
        let stamp_s = stamp_ns.saturating_sub(scout.first_ns) as f64 * 1e-9;
        Moment { what: what.to_owned(), stamp_ns, stamp_s }
    };
    let (first, second) = match scout.fixes_ns.as_slice() {
        [first, second, ..] => (
            moment("before the 1st fix", first.saturating_sub(1)),
            moment("before the 2nd fix", second.saturating_sub(1)),
        ),
        _ => (moment("a quarter", at(0.25)), moment("a third", at(1.0 / 3.0))),
    };
    vec![first, second, moment("half the time", at(0.5)), moment("the end", scout.last_ns)]
}

/// How long a way is, metres.
fn way_m(path: &[Pose2]) -> f64 {
    path.windows(2).map(|pair| pair[0].distance_m(pair[1])).sum()
}

fn write_sheet(
    file: &Path,
    world: &World,
    path: &[Pose2],
    moments: &[Moment],
    variants: &[Variant],
    seen: Vec<Seen>,
) -> Result<()> {
    let rows = variants.iter().zip(seen).map(|(variant, seen)| Row {
        label: format!("{}: {}", variant.name, variant.about),
        panels: seen.moments.into_iter().map(|moment| moment.panel).collect(),
    });
    let columns = moments.iter().map(|moment| format!("{}, {:.0} s", moment.what, moment.stamp_s)).collect();
    let sheet = Sheet { world: Some(world), frame_m: frame_m(world, path), columns, rows: rows.collect() };
    Ok(sheet::write(file, &sheet)?)
}

/// What of the world can be seen from the way, and a little around.
fn frame_m(world: &World, path: &[Pose2]) -> [[f64; 2]; 2] {
    let [low, high] = world.bounds_m();
    let of = |axis: usize| {
        let along = path.iter().map(|pose| if axis == 0 { pose.x } else { pose.y });
        let (least, most) =
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), at| (least.min(at), most.max(at)));
        ((least - SIGHT_M).max(low[axis] - MARGIN_M), (most + SIGHT_M).min(high[axis] + MARGIN_M))
    };
    let ((x0, x1), (y0, y1)) = (of(0), of(1));
    [[x0, y0], [x1, y1]]
}
