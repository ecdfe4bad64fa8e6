//! What the graph says, into the channels.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use echogrid_core::{Echo, Grid, Pose2, Robot, SensorKind, Tile, TileIndex, Verdict};
use echogrid_service::placed::{Placed, Placer};
use echogrid_topics::{Health, Layer, MapInfo, Message, PoseEstimate, ServiceState, TileUpdate};
use foxglove::messages::line_primitive::Type as LineType;
use foxglove::messages::{FrameTransform, LaserScan, Log, PoseInFrame, SceneEntity, SceneUpdate, log};
use serde_json::json;

use crate::channel::{Channel, Out, Sink};
use crate::convert::{BASE, MAP, colour, colour_of, grid, line, outline, point, pose, timestamp};

/// A point of the path joins it when the robot has moved this far.
const STEP_M: f64 = 0.05;
/// Points of a piece of the path: only the last piece is sent again.
const PIECE: usize = 512;
/// Points of the ellipse of 95 %.
const ELLIPSE: usize = 48;
/// χ² of two degrees of freedom at 95 %.
const CHI_SQUARE: f64 = 5.991;

/// What is shown.
#[derive(Debug)]
pub struct Show {
    /// The whole map goes out at most this often.
    map_every: Duration,
    robot: Option<Robot>,
    map: Option<Grid>,
    changed: BTreeSet<TileIndex>,
    told: Instant,
    placer: Placer,
    path: Vec<[f64; 2]>,
    /// Stamp of its first point: pieces of a path that began later are others.
    path_begun_ns: u64,
    /// Points of the path that were sent.
    path_sent: usize,
    states: Vec<(String, u32, ServiceState)>,
    stamp_ns: u64,
}

impl Show {
    /// A show of nothing yet; the whole map will go out at most this often.
    #[must_use]
    pub fn new(map_every: Duration) -> Self {
        Self {
            map_every,
            robot: None,
            map: None,
            changed: BTreeSet::new(),
            told: Instant::now(),
            placer: Placer::default(),
            path: Vec::new(),
            path_begun_ns: 0,
            path_sent: 0,
            states: Vec::new(),
            stamp_ns: 0,
        }
    }

    /// Takes what a topic says.
    pub fn take(&mut self, stamp_ns: u64, message: Message, sink: &mut dyn Sink) {
        let out = &mut Out(sink);
        match message {
            Message::Robot(robot) => self.robot = Some(robot),
            Message::Estimate(estimate) => self.take_estimate(stamp_ns, &estimate, out),
            Message::Scan(readings) => self.placer.take_scan(stamp_ns, readings),
            Message::Verdicts(verdicts) => self.judge(stamp_ns, &verdicts, out),
            Message::Tile(TileUpdate { layer: Layer::Map, index, revision, resolution_m, log_odds }) => {
                let map = self.map.get_or_insert_with(|| Grid::new(resolution_m));
                *map.tile_mut(index) = Tile::new(revision, log_odds);
                self.changed.insert(index);
            }
            Message::Info(info) => out.json(Channel::Info, self.stamp_ns, &info_value(&info)),
            Message::Health(health) => self.take_health(&health, out),
            _ => {}
        }
    }

    /// Sends what may wait: the path since last, the tiles that changed, the map where that is due.
    pub fn tell_what_is_due(&mut self, is_last: bool, sink: &mut dyn Sink) {
        let out = &mut Out(sink);
        self.tell_path(self.path_sent / PIECE * PIECE, out);
        if self.changed.is_empty() || (!is_last && self.told.elapsed() < self.map_every) {
            return;
        }
        self.told = Instant::now();
        for index in std::mem::take(&mut self.changed) {
            self.tell_tile(index, out);
        }
        self.tell_map(out);
    }

    /// Somebody came who has heard nothing yet.
    pub fn tell_all(&mut self, sink: &mut dyn Sink) {
        let out = &mut Out(sink);
        self.path_sent = 0;
        for piece in (0..self.path.len()).step_by(PIECE) {
            self.tell_path(piece, out);
        }
        let all: Vec<TileIndex> = self.map.iter().flat_map(Grid::tiles).map(|(index, _)| index).collect();
        all.into_iter().for_each(|index| self.tell_tile(index, out));
        self.tell_map(out);
    }

    fn tell_tile(&self, index: TileIndex, out: &mut Out<'_>) {
        let Some((map, tile)) = self.map.as_ref().and_then(|map| Some((map, map.tile(index)?))) else { return };
        if out.wants(Channel::Tiles) {
            let cells = |column, row| tile.log_odds[(row * 64 + column) as usize];
            let grid = grid(self.stamp_ns, map.resolution_m(), index.first_cell(), [64, 64], cells);
            out.message(Channel::Tiles, self.stamp_ns, &grid);
        }
    }

    fn tell_map(&self, out: &mut Out<'_>) {
        let Some((map, (low, high))) = self.map.as_ref().and_then(|map| Some((map, map.bounds()?))) else { return };
        let sides = [high.i.abs_diff(low.i), high.j.abs_diff(low.j)].map(|side| side.saturating_add(1));
        // Parts that lie too far apart are in the tiles.
        if out.wants(Channel::Map) && u64::from(sides[0]) * u64::from(sides[1]) < 1 << 26 {
            let cells = |column: u32, row: u32| {
                let cell = echogrid_core::CellIndex { i: low.i + column as i32, j: low.j + row as i32 };
                map.log_odds(cell).unwrap_or(f32::NAN)
            };
            out.message(Channel::Map, self.stamp_ns, &grid(self.stamp_ns, map.resolution_m(), low, sides, cells));
        }
    }

    /// The piece of the path that begins at `from`.
    fn tell_path(&mut self, from: usize, out: &mut Out<'_>) {
        if self.path_sent >= self.path.len() {
            return;
        }
        let to = (from + PIECE + 1).min(self.path.len());
        self.path_sent = to;
        let points = self.path[from..to].iter().map(|at| point(*at, 0.02)).collect();
        let shape = line(LineType::LineStrip, 0.04, points, colour([44, 110, 220], 1.0));
        let update = scene(self.stamp_ns, format!("path {} {from}", self.path_begun_ns), vec![shape]);
        out.message(Channel::Path, self.stamp_ns, &update);
    }

    fn take_estimate(&mut self, stamp_ns: u64, estimate: &PoseEstimate, out: &mut Out<'_>) {
        self.stamp_ns = stamp_ns;
        let PoseEstimate { estimate: at, trust, distance_m, degraded, hold, unplaced, .. } = estimate;
        let covariance = |row, column| at.covariance[(row, column)];
        let block: Vec<f64> = (0..9).map(|number| covariance(number / 3, number % 3)).collect();
        out.json(
            Channel::Estimate,
            stamp_ns,
            &json!({
                "x": at.pose.x, "y": at.pose.y, "theta": at.pose.theta, "covariance": block, "trust": trust,
                "distance_m": distance_m, "travel_m": at.travel_m, "fixes": at.fixes, "refused": at.refused,
                "is_degraded": degraded, "is_held": hold, "is_unplaced": unplaced,
            }),
        );
        if *unplaced {
            return;
        }
        self.placer.take_pose(stamp_ns, at.pose);
        let here = pose(at.pose);
        let transform = FrameTransform {
            timestamp: timestamp(stamp_ns),
            parent_frame_id: MAP.to_owned(),
            child_frame_id: BASE.to_owned(),
            translation: here.position,
            rotation: here.orientation,
        };
        out.message(Channel::Tf, stamp_ns, &transform);
        let in_frame = PoseInFrame { timestamp: timestamp(stamp_ns), frame_id: MAP.to_owned(), pose: Some(here) };
        out.message(Channel::Pose, stamp_ns, &in_frame);
        if out.wants(Channel::Uncertainty) {
            let points = ellipse(at.pose, [covariance(0, 0), covariance(0, 1), covariance(1, 1)]);
            let points = points.into_iter().map(|at| point(at, 0.03)).collect();
            let shape = line(LineType::LineLoop, 0.02, points, colour([31, 99, 224], 0.9));
            out.message(Channel::Uncertainty, stamp_ns, &scene(stamp_ns, "uncertainty".to_owned(), vec![shape]));
        }
        let here = [at.pose.x, at.pose.y];
        if self.path.last().is_none_or(|last| (last[0] - here[0]).hypot(last[1] - here[1]) >= STEP_M) {
            if self.path.is_empty() {
                self.path_begun_ns = stamp_ns;
            }
            self.path.push(here);
        }
    }

    fn judge(&mut self, stamp_ns: u64, verdicts: &[(u16, Verdict)], out: &mut Out<'_>) {
        let Some(robot) = &self.robot else { return };
        let Some(placed) = self.placer.judge(robot, stamp_ns, verdicts) else { return };
        let named: Vec<_> = verdicts
            .iter()
            .map(|(transducer, verdict)| json!({ "transducer": transducer, "verdict": verdict.name() }))
            .collect();
        out.json(Channel::Verdicts, stamp_ns, &json!({ "readings": named }));
        if out.wants(Channel::Readings) {
            let is_shown = |placed: &&Placed| !matches!(placed.verdict, Verdict::NotSelected | Verdict::Invalid);
            let shape = |placed: &Placed| {
                let points = outline(placed).into_iter().map(|at| point(at, 0.01)).collect();
                line(LineType::LineStrip, 0.01, points, colour(colour_of(placed.verdict), 0.7))
            };
            let shapes = placed.iter().filter(is_shown).map(shape).collect();
            out.message(Channel::Readings, stamp_ns, &scene(stamp_ns, "readings".to_owned(), shapes));
        }
        for sensor in robot.sensors.iter().filter(|sensor| sensor.kind == SensorKind::Lidar) {
            let of_sensor = sensor.first_transducer..sensor.first_transducer.saturating_add(sensor.transducers);
            let mut ranges = vec![f64::NAN; usize::from(sensor.transducers)];
            for one in placed.iter().filter(|one| of_sensor.contains(&one.reading.transducer)) {
                if let Echo::Hit { range_m } = one.reading.echo {
                    ranges[usize::from(one.reading.transducer - sensor.first_transducer)] = range_m;
                }
            }
            let last = f64::from(sensor.transducers.saturating_sub(1));
            let scan = LaserScan {
                timestamp: timestamp(stamp_ns),
                frame_id: BASE.to_owned(),
                pose: Some(pose(sensor.base_from_sensor)),
                start_angle: sensor.first_bearing_rad,
                end_angle: sensor.first_bearing_rad + last * sensor.bearing_step_rad,
                ranges,
                intensities: Vec::new(),
            };
            out.message(Channel::Scan, stamp_ns, &scan);
        }
    }

    fn take_health(&mut self, health: &Health, out: &mut Out<'_>) {
        out.json(
            Channel::Health,
            self.stamp_ns,
            &json!({
                "service": health.service, "pid": health.pid, "state": format!("{:?}", health.state).to_lowercase(),
                "progress": health.progress, "total": health.total, "faults": health.faults, "lost": health.lost,
                "waits_for": health.waits_for.map(echogrid_topics::Topic::name), "last_error": health.last_error,
            }),
        );
        let now = (health.service.clone(), health.pid, health.state);
        let before = self.states.iter_mut().find(|(service, ..)| *service == health.service);
        if before.as_ref().is_some_and(|before| **before == now) {
            return;
        }
        let (level, text) = match health.state {
            ServiceState::Failed => (log::Level::Error, health.last_error.clone()),
            state => (log::Level::Info, format!("{state:?}, process {}", health.pid).to_lowercase()),
        };
        match before {
            Some(before) => *before = now,
            None => self.states.push(now),
        }
        let line = Log {
            timestamp: timestamp(self.stamp_ns),
            level: level as i32,
            message: text,
            name: health.service.clone(),
            file: String::new(),
            line: 0,
        };
        out.message(Channel::Log, self.stamp_ns, &line);
    }
}

fn scene(stamp_ns: u64, id: String, lines: Vec<foxglove::messages::LinePrimitive>) -> SceneUpdate {
    let entity =
        SceneEntity { timestamp: timestamp(stamp_ns), frame_id: MAP.to_owned(), id, lines, ..SceneEntity::default() };
    SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
}

/// Where the robot is with 95 %, by the covariance (xx, xy, yy) of its position.
fn ellipse(at: Pose2, [xx, xy, yy]: [f64; 3]) -> Vec<[f64; 2]> {
    let (mean, off) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    let tilt = 0.5 * (2.0 * xy).atan2(xx - yy);
    let [major, minor] = [mean + off, mean - off].map(|variance| (CHI_SQUARE * variance.max(0.0)).sqrt());
    (0..ELLIPSE)
        .map(|step| {
            let turn = core::f64::consts::TAU * step as f64 / ELLIPSE as f64;
            let (along, across) = (major * turn.cos(), minor * turn.sin());
            [at.x + along * tilt.cos() - across * tilt.sin(), at.y + along * tilt.sin() + across * tilt.cos()]
        })
        .collect()
}

fn info_value(info: &MapInfo) -> serde_json::Value {
    let verdicts: serde_json::Map<_, _> =
        info.verdicts.iter().map(|(verdict, count)| (verdict.name().to_owned(), json!(count))).collect();
    json!({
        "scans": info.scans, "cells_known": info.cells_known, "cells_occupied": info.cells_occupied, "cells_free": info.cells_free,
        "entropy_bits": info.entropy_bits, "trust": info.trust, "distance_m": info.distance_m, "verdicts": verdicts,
        "is_finished": info.finished, "is_degraded": info.degraded, "is_held": info.held, "is_unplaced": info.unplaced,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ellipse_lies_along_the_covariance() {
        // One metre along 45°, none across.
        let points = ellipse(Pose2::new(2.0, 3.0, 0.0), [0.5, 0.5, 0.5]);
        let along = points.iter().map(|[x, y]| ((x - 2.0) + (y - 3.0)) / 2.0_f64.sqrt());
        let across = points.iter().map(|[x, y]| ((x - 2.0) - (y - 3.0)).abs());
        assert!((along.fold(0.0, f64::max) - CHI_SQUARE.sqrt()).abs() < 1e-9);
        assert!(across.fold(0.0, f64::max) < 1e-7);
    }
}
