//! What the graph says, into the scene.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use echogrid_core::{Echo, Tile, Verdict};
use echogrid_formats::map::native;
use echogrid_service::Plan;
use echogrid_service::onlooker::Onlooker;
use echogrid_service::placed::{Placed, Placer};
use echogrid_service::signals::Signals;
use echogrid_topics::{Domain, Health, Layer, MapInfo, Message, PoseEstimate, ServiceState, TileUpdate, Topic};
use serde_json::{Value, json};

use crate::hub::{Hub, Scene};
use crate::orders::Orders;
use crate::protocol::Beam;
use crate::trail::TrailPoint;

/// What is looked at.
pub(crate) const TOPICS: [Topic; 8] = [
    Topic::RobotDescription,
    Topic::OdometryEstimate,
    Topic::RangeScan,
    Topic::RangeVerdict,
    Topic::MapTiles,
    Topic::MapInfo,
    Topic::LocalizationFix,
    Topic::Health,
];
/// What this process calls itself.
const NAME: &str = "echogrid live";

/// A graph that is looked at.
pub(crate) struct Feed {
    onlooker: Onlooker,
    scenery: Scenery,
}

/// What is kept of what was said, to make sense of what comes.
struct Scenery {
    services: Vec<String>,
    health: BTreeMap<String, (Health, u64)>,
    placer: Placer,
}

/// Why a feed ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Over {
    /// The graph is gone, or was made anew.
    Graph,
    /// This process is to leave.
    Us,
}

impl Feed {
    /// Enters a running graph.
    pub(crate) fn enter(domain: &Domain, hub: &Hub) -> Result<Self> {
        let onlooker = Onlooker::enter(domain, NAME, &TOPICS)?;
        let services = onlooker.plan().config.get("services").and_then(toml::Value::as_table);
        let services = services.map(|services| services.keys().cloned().collect()).unwrap_or_default();
        hub.scene().begin(facts(onlooker.plan()));
        let scenery = Scenery { services, health: BTreeMap::new(), placer: Placer::default() };
        Ok(Self { onlooker, scenery })
    }

    /// Takes in what comes, until there is no graph any more or `is_over` says so.
    pub(crate) fn follow(
        &mut self,
        hub: &Hub,
        orders: &Orders,
        signals: &Signals,
        is_over: impl Fn() -> bool,
    ) -> Result<Over> {
        let Self { onlooker, scenery } = self;
        loop {
            // Once more after that: what was said last is in the ports.
            let us = is_over() || signals.next()?.is_some();
            // A lock for each: viewers get their turn between.
            let was_there = onlooker.take_in(|stamp_ns, message| scenery.take(stamp_ns, message, &mut hub.scene()))?;
            if us || !was_there {
                if onlooker.lacks_tiles() {
                    fill_in(&mut hub.scene(), onlooker.plan());
                }
                return Ok(if us { Over::Us } else { Over::Graph });
            }
            if onlooker.misses_tiles() {
                orders.ask_for_the_whole_map();
            }
            onlooker.wait(signals)?;
        }
    }
}

impl Scenery {
    fn take(&mut self, stamp_ns: u64, message: Message, scene: &mut Scene) {
        match message {
            Message::Robot(robot) => scene.take_robot(robot),
            Message::Estimate(estimate) => self.take_estimate(stamp_ns, &estimate, scene),
            Message::Scan(readings) => self.placer.take_scan(stamp_ns, readings),
            Message::Verdicts(verdicts) => self.judge(stamp_ns, &verdicts, scene),
            Message::Tile(tile) => scene.take_tile(tile),
            Message::Info(info) => scene.take_map(map_value(&info)),
            Message::Fix(fix) => {
                if let Some(fix) = fix.fix {
                    scene.say("localizer", "info", &format!("robot at ({:.2}, {:.2})", fix.pose.x, fix.pose.y));
                }
            }
            Message::Health(health) => self.take_health(health, scene),
            _ => {}
        }
    }

    fn take_estimate(&mut self, stamp_ns: u64, estimate: &PoseEstimate, scene: &mut Scene) {
        let pose = estimate.estimate.pose;
        if !estimate.unplaced {
            self.placer.take_pose(stamp_ns, pose);
        }
        let point = TrailPoint { stamp_ns, pose, trust: estimate.trust };
        scene.take_pose(Some(point).filter(|_| !estimate.unplaced), pose_value(stamp_ns, estimate));
    }

    /// A scan is drawn when it is known what became of its readings.
    fn judge(&mut self, stamp_ns: u64, verdicts: &[(u16, Verdict)], scene: &mut Scene) {
        let Some(robot) = &scene.robot else { return };
        if let Some(placed) = self.placer.judge(robot, stamp_ns, verdicts) {
            scene.take_beams(stamp_ns, placed.iter().map(beam).collect());
        }
    }

    fn take_health(&mut self, health: Health, scene: &mut Scene) {
        // Tools look on, too.
        if !self.services.contains(&health.service) {
            return;
        }
        let name = health.service.clone();
        let before = self.health.get(&name);
        let mut lives = before.map_or(1, |(_, lives)| *lives);
        match before {
            Some((before, _)) if before.pid != health.pid && health.state != ServiceState::Gone => {
                lives += 1;
                scene.say(&name, "warn", &format!("was started again: process {} after {}", health.pid, before.pid));
            }
            Some((before, _)) if before.state == health.state => {}
            _ => scene.say(&name, "info", &format!("{:?}, process {}", health.state, health.pid).to_lowercase()),
        }
        if before.is_none_or(|(before, _)| before.last_error != health.last_error) && !health.last_error.is_empty() {
            scene.say(&name, "error", &health.last_error);
        }
        self.health.insert(name, (health, lives));
        scene.take_health(self.health_value());
    }

    fn health_value(&self) -> Value {
        let one = |name: &String| {
            let (health, lives) = self.health.get(name)?;
            Some(json!({
                "name": name,
                "pid": health.pid,
                "state": format!("{:?}", health.state).to_lowercase(),
                "progress": health.progress,
                "total": health.total,
                "faults": health.faults,
                "lost": health.lost,
                "waits_for": health.waits_for.map(Topic::name),
                "restarts": lives - 1,
                "last_error": health.last_error,
            }))
        };
        json!({ "services": self.services.iter().filter_map(one).collect::<Vec<Value>>() })
    }
}

fn beam(placed: &Placed) -> Beam {
    let Placed { map_from_transducer: from, aperture_rad, range_m, reading, verdict } = placed;
    Beam {
        x: from.x as f32,
        y: from.y as f32,
        angle_rad: from.theta as f32,
        range_m: *range_m as f32,
        aperture_rad: *aperture_rad as f32,
        transducer: reading.transducer,
        verdict: verdict.code(),
        echo: match reading.echo {
            Echo::Hit { .. } => 0,
            Echo::NoEcho => 1,
            Echo::Invalid => 2,
        },
    }
}

/// What was missed at the very end, when no mapper answers any more, stands in the map that was saved last.
fn fill_in(scene: &mut Scene, plan: &Plan) {
    let out = plan.config.get("run").and_then(|run| run.get("out")).and_then(toml::Value::as_str).unwrap_or_default();
    let Ok(document) = native::read(&Path::new(out).join("map.echogrid")) else { return };
    let newer: Vec<TileUpdate> = {
        // Another run's, if it is no continuation of what was seen.
        let Some(grid) = scene.grid.as_ref().filter(|grid| grid.resolution_m() == document.grid.resolution_m()) else {
            return;
        };
        let is_of_this_run = document.path.last().is_some_and(|last| scene.is_at(last.stamp_ns));
        let seen = |index| grid.tile(index).map_or(0, |tile| tile.revision);
        let tiles = document.grid.tiles().filter(|(index, tile)| is_of_this_run && tile.revision > seen(*index));
        let update = |(index, tile): (_, &Tile)| TileUpdate {
            layer: Layer::Map,
            index,
            revision: tile.revision,
            resolution_m: grid.resolution_m(),
            log_odds: tile.log_odds.clone(),
        };
        tiles.map(update).collect()
    };
    tracing::debug!(tiles = newer.len(), "filled in from the saved map");
    newer.into_iter().for_each(|tile| scene.take_tile(tile));
}

/// What a run is about, by its plan.
fn facts(plan: &Plan) -> Value {
    let config = |section: &str, key: &str| plan.config.get(section).and_then(|section| section.get(key)).cloned();
    let text =
        |section, key| config(section, key).and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default();
    let flag = |key| config("mapper", key).and_then(|value| value.as_bool()).unwrap_or(false);
    let services = plan.config.get("services").and_then(toml::Value::as_table);
    let runs = |exec: &str| {
        services.is_some_and(|all| all.values().any(|one| one.get("exec").and_then(toml::Value::as_str) == Some(exec)))
    };
    let source = match (runs("builtin:simulator"), runs("builtin:replay")) {
        (true, _) => format!("simulator, {}", file_name(&text("simulator", "world"))),
        (_, true) => file_name(&text("replay", "log")),
        _ => "robot".to_owned(),
    };
    let resolution_m = config("mapper", "resolution_m").and_then(|value| value.as_float()).unwrap_or(0.0);
    json!({
        "run": plan.epoch.to_string(),
        "source": source,
        "rate": plan.rate,
        "resolution_m": resolution_m,
        "out": text("run", "out"),
        "keeps_readings": flag("keep_readings"),
        "keeps_doubt": flag("doubt"),
        "keeps_sonar_maps": flag("sonar_maps"),
        "verdicts": Verdict::ALL.map(|verdict| json!({ "code": verdict.code(), "name": verdict.name(), "text": verdict.describe() })),
    })
}

fn file_name(path: &str) -> String {
    path.rsplit('/').next().unwrap_or(path).to_owned()
}

fn pose_value(stamp_ns: u64, estimate: &PoseEstimate) -> Value {
    let PoseEstimate { estimate: at, trust, distance_m, degraded, hold, unplaced, .. } = estimate;
    let covariance = |row, column| at.covariance[(row, column)];
    json!({
        "stamp_s": stamp_ns as f64 * 1e-9,
        "x": at.pose.x,
        "y": at.pose.y,
        "theta": at.pose.theta,
        // Of x and y, and of the heading.
        "covariance": [covariance(0, 0), covariance(0, 1), covariance(1, 1), covariance(2, 2)],
        "trust": trust,
        "distance_m": distance_m,
        "travel_m": at.travel_m,
        "fixes": at.fixes,
        "refused": at.refused,
        "is_degraded": degraded,
        "is_held": hold,
        "is_unplaced": unplaced,
    })
}

fn map_value(info: &MapInfo) -> Value {
    let verdicts: Vec<Value> = info
        .verdicts
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(verdict, count)| json!([verdict.code(), count]))
        .collect();
    json!({
        "scans": info.scans,
        "cells_known": info.cells_known,
        "cells_occupied": info.cells_occupied,
        "cells_free": info.cells_free,
        "entropy_bits": info.entropy_bits,
        "trust": info.trust,
        "distance_m": info.distance_m,
        "verdicts": verdicts,
        "fixes": info.fixes,
        "fixes_refused": info.fixes_refused,
        "is_finished": info.finished,
        "is_degraded": info.degraded,
        "is_held": info.held,
        "is_unplaced": info.unplaced,
    })
}
