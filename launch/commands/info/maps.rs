//! Maps, and the readings that they are made of.

use std::path::Path;

use anyhow::Result;
use echogrid_core::GridSummary;
use echogrid_formats::map::{map_server, native, readings};
use serde_json::json;

use super::{Facts, span};

pub(super) fn native(file: &Path) -> Result<Facts> {
    let document = native::read(file)?;
    let (summary, resolution_m) = (GridSummary::of(&document.grid), document.grid.resolution_m());
    let mut facts = Facts::new("native map of echogrid", "native-map");
    let corner = |i: i64| i as f64 * resolution_m;
    let bounds_m = summary.bounds.map(|(low, high)| {
        let (low, high) = ([i64::from(low.i), i64::from(low.j)], [i64::from(high.i) + 1, i64::from(high.j) + 1]);
        [low.map(corner), high.map(corner)]
    });
    match bounds_m {
        Some([[x_low, y_low], [x_high, y_high]]) => facts.line(
            "map",
            format!(
                "{:.1} × {:.1} m from ({x_low:.2}, {y_low:.2}), cells of {resolution_m} m",
                x_high - x_low,
                y_high - y_low
            ),
        ),
        None => facts.line("map", format!("nothing is known, cells of {resolution_m} m")),
    }
    let GridSummary { known, occupied, free, undecided, .. } = summary;
    facts.line("cells", format!("{known} known: {free} free, {occupied} occupied, {undecided} undecided"));
    let length_m: f64 =
        document.drives().flat_map(|drive| drive.windows(2)).map(|pair| pair[0].pose.distance_m(pair[1].pose)).sum();
    let time_ns: u64 = document.drives().map(|drive| drive[drive.len() - 1].stamp_ns - drive[0].stamp_ns).sum();
    match document.path.last() {
        Some(last) => facts.line(
            "path",
            format!(
                "{} poses, {length_m:.1} m in {}, trust {:.3} at the end",
                document.path.len(),
                span(time_ns as f64 * 1e-9),
                last.trust
            ),
        ),
        None => facts.line("path", "none"),
    }
    facts.line("doubt", if document.doubt.is_some() { "kept, of each cell" } else { "not kept" });
    facts.line("facing", if document.facing.is_some() { "told, of each wall" } else { "not told" });
    facts.line("made by", document.provenance.software.clone());
    let log = document.provenance.log_sha256.as_deref();
    let of = log.map_or("live readings".to_owned(), |sha256| format!("a log with SHA-256 {sha256}"));
    let earlier = match document.provenance.earlier.len() {
        0 => String::new(),
        1 => ", going on with the map of an earlier drive".to_owned(),
        drives => format!(", going on with the map of {drives} earlier drives"),
    };
    facts.line("of", format!("{of}{earlier}"));
    facts.value("resolution_m", resolution_m);
    facts.value("bounds_m", json!(bounds_m));
    facts.value("cells", json!({"known": known, "occupied": occupied, "free": free, "undecided": undecided}));
    facts.value("path_poses", document.path.len());
    facts.value("path_m", length_m);
    facts.value("has_doubt", document.doubt.is_some());
    facts.value("has_facing", document.facing.is_some());
    facts.value("provenance", json!(document.provenance));
    Ok(facts)
}

pub(super) fn readings(file: &Path) -> Result<Facts> {
    let document = readings::read(file)?;
    let mut facts = Facts::new("readings that a map is made of", "kept-readings");
    facts.line("readings", format!("{} of {} scans", document.readings.len(), document.scans.len()));
    if document.given_up > 0 {
        facts.line("readings", format!("{} older ones were given up for want of room", document.given_up));
    }
    facts.line("sensors", document.robot.sensors.len().to_string());
    facts.value("readings", document.readings.len());
    facts.value("scans", document.scans.len());
    facts.value("given_up", document.given_up);
    Ok(facts)
}

pub(super) fn map_server(file: &Path) -> Result<Facts> {
    let (yaml, map) = map_server::read(file)?;
    let mut facts = Facts::new("map_server map", "map-server");
    let (width, height, side_m) = (map.width, map.height, yaml.resolution_m);
    let [x, y, yaw] = yaml.origin;
    facts.line(
        "map",
        format!(
            "{:.1} × {:.1} m from ({x:.2}, {y:.2}), yaw {yaw:.3}, pixels of {side_m} m",
            width as f64 * side_m,
            height as f64 * side_m
        ),
    );
    let known = map.probability.iter().filter(|p| !p.is_nan()).count();
    let above = map.probability.iter().filter(|p| f64::from(**p) > yaml.occupied_thresh).count();
    facts.line("pixels", format!("{width} × {height}, {known} known, {above} occupied"));
    facts.line("image", format!("{}, read as {}", yaml.image, yaml.mode.name()));
    facts.value("resolution_m", side_m);
    facts.value("origin", json!(yaml.origin));
    facts.value("pixels", json!({"width": width, "height": height, "known": known, "occupied": above}));
    facts.value("image", yaml.image);
    Ok(facts)
}
