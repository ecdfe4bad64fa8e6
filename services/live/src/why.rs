//! Why a cell is what it is, for who clicks on it: the readings that the mapper kept are fused once more.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use echogrid_core::log_odds::probability_of;
use echogrid_core::why::{Said, why};
use echogrid_core::{Echo, Verdict};
use echogrid_formats::map::readings::{self, READINGS_FILE, ReadingsDocument};
use serde_json::{Value, json};

use crate::hub::Hub;

/// Readings that are shown, the strongest.
const SHOWN_MAX: usize = 24;

/// What is known of the cell at (x, y), metres in the map frame, by the readings that lie in the folder `out`.
pub(crate) fn answer(hub: &Hub, out: &Path, at: [f64; 2]) -> Result<Value> {
    let file = out.join(READINGS_FILE);
    let kept = readings::read(&file)?;
    let [x, y] = at;
    let (log_odds, revision, centre, resolution_m) = {
        let scene = hub.scene();
        let grid = scene.grid.as_ref().context("there is no map yet")?;
        let cell = grid.cell_at(x, y);
        let revision = grid.tile(cell.tile()).map_or(u64::MAX, |tile| tile.revision);
        (grid.log_odds(cell), revision, grid.centre(cell), grid.resolution_m())
    };
    ensure!(kept.mapper.resolution_m == resolution_m, "{}: of another map", file.display());
    // The mapper may have taken in more since the tile was seen.
    let in_map = kept.readings.iter().filter(|reading| reading.sequence <= revision);
    let answered = why(&kept.mapper, &kept.robot, in_map, at).with_context(|| file.display().to_string())?;
    let is_exact = answered.log_odds.map(f32::to_bits) == log_odds.map(f32::to_bits);
    let mut sensors: BTreeMap<String, (f64, u64, u64)> = BTreeMap::new();
    for said in &answered.said {
        let of = sensors.entry(sensor(said)).or_default();
        of.0 += said.added;
        *(if said.kept.verdict == Verdict::Accepted { &mut of.1 } else { &mut of.2 }) += 1;
    }
    let sensors: Vec<Value> = sensors
        .into_iter()
        .map(|(sensor, (added, readings, refused))| json!({ "sensor": sensor, "added": added, "readings": readings, "refused": refused }))
        .collect();
    let total = answered.said.len();
    let mut strongest = answered.said;
    strongest.sort_by(|a, b| b.added.abs().total_cmp(&a.added.abs()).then(a.kept.sequence.cmp(&b.kept.sequence)));
    strongest.truncate(SHOWN_MAX);
    strongest.sort_by_key(|said| Reverse(said.kept.sequence));
    Ok(json!({
        "cell_m": centre,
        "log_odds": log_odds,
        "probability": log_odds.map(|log_odds| probability_of(f64::from(log_odds))),
        "is_exact": is_exact,
        "given_up": kept.given_up,
        "total": total,
        "sensors": sensors,
        "readings": strongest.iter().map(|said| reading(said, &kept)).collect::<Vec<Value>>(),
    }))
}

fn sensor(said: &Said) -> String {
    said.sonar.map_or_else(|| "lidar".to_owned(), |number| format!("sonar {number}"))
}

fn reading(said: &Said, document: &ReadingsDocument) -> Value {
    let kept = &said.kept;
    let transducer = document.robot.transducer(kept.reading.transducer);
    let from = transducer.map_or(kept.pose, |transducer| kept.pose * transducer.base_from_transducer);
    let range_m = if let Echo::Hit { range_m } = kept.reading.echo { Some(range_m) } else { None };
    json!({
        "time_s": document.stamp_ns(kept).map(|stamp_ns| stamp_ns as f64 * 1e-9),
        "scan": kept.sequence,
        "sensor": sensor(said),
        "transducer": kept.reading.transducer,
        "range_m": range_m,
        "reach_m": range_m.or(transducer.map(|transducer| transducer.range_max_m)),
        "x": from.x,
        "y": from.y,
        "angle_rad": from.theta,
        "aperture_rad": transducer.map(|transducer| transducer.aperture_rad),
        "weight": kept.deviations.trust * kept.news,
        "before": said.before,
        "after": said.after,
        "added": said.added,
        "verdict": kept.verdict.name(),
        "is_used": kept.verdict == Verdict::Accepted,
    })
}
