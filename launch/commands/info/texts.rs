//! Worlds, settings and tables: what people write.

use std::path::Path;

use anyhow::{Context, Result, bail};
use echogrid_arcos::Parameters;
use echogrid_core::SensorKind;
use echogrid_formats::localization::{Landmarks, ReferencePath};
use echogrid_formats::trials::{Phase, Trials};
use echogrid_formats::{read_at_most, world};
use serde_json::json;

use super::{Facts, span};
use crate::config;

/// The top of tables that only one kind of TOML has.
const GRAPH_TABLES: [&str; 11] = [
    "run",
    "replay",
    "odometry",
    "localization",
    "localizer",
    "mapper",
    "publisher",
    "supervision",
    "services",
    "simulator",
    "recorder",
];

/// Keys that only ARIA's parameter files have; two of them tell one.
const ARIA_KEYS: [&str; 6] =
    ["AngleConvFactor", "DistConvFactor", "VelConvFactor", "RangeConvFactor", "SonarUnit", "Subclass"];
/// More is no parameter file, bytes.
const ARIA_BYTES_MAX: u64 = 1 << 20;

pub(super) fn world(file: &Path, what: &str, kind: &str) -> Result<Facts> {
    let world = world::read(file)?;
    let mut facts = Facts::new(what, kind);
    let [[x_low, y_low], [x_high, y_high]] = world.bounds_m();
    let parts = world.parts();
    facts.line("world", format!("{:.1} × {:.1} m from ({x_low:.2}, {y_low:.2})", x_high - x_low, y_high - y_low));
    facts.line(
        "parts",
        format!("{} walls, {} points, {} people", parts.walls.len(), parts.points.len(), parts.people.len()),
    );
    let goals: Vec<&str> = parts.places.goals.iter().map(|goal| goal.name.as_str()).collect();
    facts.line("places", format!("{} goals{}", goals.len(), if parts.places.home.is_some() { ", a home" } else { "" }));
    facts.value("bounds_m", json!(world.bounds_m()));
    facts.value("walls", parts.walls.len());
    facts.value("points", parts.points.len());
    facts.value("goals", json!(goals));
    Ok(facts)
}

/// TOML is told by its keys; what is wrong with it is said by who reads such files.
pub(super) fn toml(file: &Path) -> Result<Facts> {
    let bytes = read_at_most(file, world::PLAN_BYTES_MAX).with_context(|| file.display().to_string())?;
    let text = String::from_utf8_lossy(&bytes);
    let table: toml::Table = match text.parse() {
        Ok(table) => table,
        Err(error) => bail!("{}: no TOML: {}", file.display(), error.message()),
    };
    let has = |keys: &[&str]| keys.iter().any(|key| table.contains_key(*key));
    if has(&["landmark"]) {
        let landmarks = Landmarks::read(file)?;
        let mut facts = Facts::new("surveyed landmarks", "landmarks");
        facts.line("landmarks", landmarks.all().len().to_string());
        facts.value("landmarks", landmarks.all().len());
        return Ok(facts);
    }
    if has(&["wall", "box", "floor", "home"]) {
        return world(file, "world of echogrid's own", "world");
    }
    if has(&["sonar", "sonars", "lidar", "footprint"]) {
        let robot = config::parse_robot(&text)?;
        let mut facts = Facts::new("robot", "robot");
        let count = |kind| robot.sensors.iter().filter(|sensor| sensor.kind == kind).count();
        facts.line("robot", robot.name.clone());
        facts.line("sensors", format!("{} sonars, {} lidars", count(SensorKind::Sonar), count(SensorKind::Lidar)));
        facts.value("robot", json!(robot));
        return Ok(facts);
    }
    if has(&GRAPH_TABLES) {
        let mut facts = Facts::new("graph, or settings of one", "graph");
        let services = table.get("services").and_then(toml::Value::as_table);
        let names: Vec<&str> = services.into_iter().flat_map(|services| services.keys().map(String::as_str)).collect();
        let tables: Vec<&str> = table.keys().map(String::as_str).collect();
        facts.line("tables", tables.join(", "));
        facts.line(
            "services",
            if names.is_empty() { "those of the built-in graph".to_owned() } else { names.join(", ") },
        );
        facts.line("validity", "echogrid check tells it, and all it comes to");
        facts.value("tables", json!(tables));
        facts.value("services", json!(names));
        return Ok(facts);
    }
    bail!("{}: TOML of no known kind; expected landmarks, a world, a robot or a graph", file.display())
}

/// ARIA's parameters of a robot, which `[pioneer]` takes.
fn aria(file: &Path) -> Option<Facts> {
    let bytes = read_at_most(file, ARIA_BYTES_MAX).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let first = |line: &str| line.split_whitespace().next().is_some_and(|word| ARIA_KEYS.contains(&word));
    if text.lines().filter(|line| first(line)).count() < 2 {
        return None;
    }
    let mut facts = Facts::new("ARIA's parameters of a robot", "aria-parameters");
    match Parameters::read(&text) {
        Ok(Parameters { class, subclass, length_mm, width_mm, sonars, .. }) => {
            facts.line("robot", format!("{class} {subclass}, {:.2} × {:.2} m", length_mm * 1e-3, width_mm * 1e-3));
            facts.line("sensors", format!("{} sonars", sonars.len()));
            facts.line("to use it", "echogrid up --sensor pioneer --set pioneer.parameters=FILE");
            facts.value("class", class);
            facts.value("subclass", subclass);
            facts.value("sonars", sonars.len());
        }
        Err(error) => {
            facts.line("wrong", error.to_string());
            facts.value("wrong", error.to_string());
        }
    }
    Some(facts)
}

/// A text that is no log: a robot's parameters, a reference path, or trials.
pub(super) fn other(file: &Path) -> Option<Facts> {
    if let Some(facts) = aria(file) {
        return Some(facts);
    }
    if let Ok(path) = ReferencePath::read(file) {
        let mut facts = Facts::new("reference path", "reference-path");
        let poses = path.poses();
        let seconds = match (poses.first(), poses.last()) {
            (Some((first_ns, _)), Some((last_ns, _))) => last_ns.saturating_sub(*first_ns) as f64 * 1e-9,
            _ => 0.0,
        };
        facts.line("path", format!("{} poses in {}", poses.len(), span(seconds)));
        facts.value("poses", poses.len());
        return Some(facts);
    }
    let trials = Trials::read(file).ok()?;
    let count = |phase| trials.of(phase, None).len();
    let mut facts = Facts::new("table of trials", "trials");
    facts.line("trials", format!("{} translations, {} rotations", count(Phase::Translation), count(Phase::Rotation)));
    facts.value("translations", count(Phase::Translation));
    facts.value("rotations", count(Phase::Rotation));
    Some(facts)
}
