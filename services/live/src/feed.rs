//! What the graph says, into the scene. The feed only looks on: it acknowledges nothing, so nobody waits for it, and where it does
//! not keep up it misses messages, never another process.

use std::collections::{BTreeMap, VecDeque};
use std::os::fd::BorrowedFd;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_core::{Echo, Pose2, Reading, Robot, Verdict};
use echogrid_service::Plan;
use echogrid_service::signals::Signals;
use echogrid_topics::{
    Domain, Health, Input, MapInfo, Message, Output, Participant, PoseEstimate, Received, ServiceState, Topic,
};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use serde_json::{Value, json};

use crate::hub::{Hub, Scene};
use crate::orders::Orders;
use crate::protocol::Beam;
use crate::trail::TrailPoint;

/// What is looked at.
const TOPICS: [Topic; 8] = [
    Topic::RobotDescription,
    Topic::OdometryEstimate,
    Topic::RangeScan,
    Topic::RangeVerdict,
    Topic::MapTiles,
    Topic::MapInfo,
    Topic::LocalizationFix,
    Topic::Health,
];
/// How often it is looked whether the graph is still there.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Messages are taken in bunches: a processor that wakes for each would be missed by the mapper.
const BUNCH: Duration = Duration::from_millis(15);
/// The whole map is asked for again after this, where tiles are missing.
const ASK_AGAIN_AFTER: Duration = Duration::from_secs(2);
/// Scans whose verdicts may still come, and poses at which they may have been heard.
const SCANS_KEPT: usize = 64;
const POSES_KEPT: usize = 512;
/// What this process calls itself.
const NAME: &str = "echogrid live";

/// A graph that is looked at.
pub(crate) struct Feed {
    ports: Vec<Input>,
    plan_file: PathBuf,
    /// Another one: the graph was made anew, and this memory is nobody's any more.
    inode: u64,
    services: Vec<String>,
    health: BTreeMap<String, (Health, u64)>,
    scans: VecDeque<(u64, Vec<Reading>)>,
    poses: VecDeque<(u64, Pose2)>,
    /// Tiles known to be missing when the whole map was asked for last.
    tiles_lost: Option<u64>,
    asked: Instant,
    fixes: Vec<[f64; 3]>,
    // What it said would go with it.
    _greeting: Output,
    // Last: ports go before the process leaves the domain.
    _participant: Participant,
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
        let participant = Participant::join(domain, NAME)?;
        let plan_file = domain.dir().join("plan.toml");
        let inode = std::fs::metadata(&plan_file).context("looking for the graph")?.ino();
        let plan = Plan::read(domain)?;
        // Listening before anything is said of it.
        let ports = TOPICS.iter().map(|topic| Input::open(&participant, *topic)).collect::<Result<Vec<_>, _>>()?;
        let greeting = greet(&participant, &plan)?;
        let services = plan.config.get("services").and_then(toml::Value::as_table);
        let services = services.map(|services| services.keys().cloned().collect()).unwrap_or_default();
        hub.scene().begin(facts(&plan));
        Ok(Self {
            ports,
            plan_file,
            inode,
            services,
            health: BTreeMap::new(),
            scans: VecDeque::new(),
            poses: VecDeque::new(),
            tiles_lost: None,
            asked: Instant::now(),
            fixes: Vec::new(),
            _greeting: greeting,
            _participant: participant,
        })
    }

    /// Takes in what comes, until there is no graph any more or `is_over` says so.
    pub(crate) fn follow(
        &mut self,
        hub: &Hub,
        orders: &Orders,
        signals: &Signals,
        is_over: impl Fn() -> bool,
    ) -> Result<Over> {
        loop {
            let us = is_over() || signals.next()?.is_some();
            // Once more after that: what was said last is in the ports.
            let graph = std::fs::metadata(&self.plan_file).map(|plan| plan.ino()).ok() != Some(self.inode);
            self.take_in(hub)?;
            if us {
                return Ok(Over::Us);
            }
            if graph {
                return Ok(Over::Graph);
            }
            self.ask_for_what_is_missing(orders);
            self.wait(signals)?;
        }
    }

    /// Who came late, or fell behind, has only part of the map.
    fn ask_for_what_is_missing(&mut self, orders: &Orders) {
        let tiles = self.ports.iter().find(|port| port.topic() == Topic::MapTiles);
        let lost = tiles.map_or(0, Input::lost);
        if self.tiles_lost != Some(lost) && (self.tiles_lost.is_none() || self.asked.elapsed() > ASK_AGAIN_AFTER) {
            // Only a mapper that runs can answer.
            let is_mapping = self.health.values().any(|(health, _)| {
                health.state == ServiceState::Running && health.acks.iter().any(|ack| ack.topic == Topic::RangeScan)
            });
            if is_mapping {
                (self.tiles_lost, self.asked) = (Some(lost), Instant::now());
                orders.ask_for_the_whole_map();
            }
        }
    }

    fn take_in(&mut self, hub: &Hub) -> Result<()> {
        for index in 0..self.ports.len() {
            self.ports[index].hush()?;
            while let Some(received) = self.ports[index].receive()? {
                let Received::Message(header, message) = received else { continue };
                // A lock for each: viewers get their turn between.
                self.take(header.stamp_ns, message, &mut hub.scene());
            }
        }
        Ok(())
    }

    fn take(&mut self, stamp_ns: u64, message: Message, scene: &mut Scene) {
        match message {
            Message::Robot(robot) => scene.take_robot(robot),
            Message::Estimate(estimate) => self.take_estimate(stamp_ns, &estimate, scene),
            Message::Scan(readings) => {
                self.scans.push_back((stamp_ns, readings));
                if self.scans.len() > SCANS_KEPT {
                    self.scans.pop_front();
                }
            }
            Message::Verdicts(verdicts) => self.judge(stamp_ns, &verdicts, scene),
            Message::Tile(tile) => scene.take_tile(tile),
            Message::Info(info) => scene.take_map(map_value(&info)),
            Message::Fix(fix) => {
                if let Some(fix) = fix.fix {
                    self.fixes.push([fix.pose.x, fix.pose.y, fix.pose.theta]);
                    scene.say("localizer", "info", &format!("the robot was at ({:.2}, {:.2})", fix.pose.x, fix.pose.y));
                }
            }
            Message::Health(health) => self.take_health(health, scene),
            Message::Odometry(_) | Message::TruePose(_) | Message::TrueWorld(_) | Message::Request(_) => {}
        }
    }

    fn take_estimate(&mut self, stamp_ns: u64, estimate: &PoseEstimate, scene: &mut Scene) {
        let pose = estimate.estimate.pose;
        if !estimate.unplaced {
            self.poses.push_back((stamp_ns, pose));
            if self.poses.len() > POSES_KEPT {
                self.poses.pop_front();
            }
        }
        let point = TrailPoint { stamp_ns, pose, trust: estimate.trust };
        scene.take_pose(Some(point).filter(|_| !estimate.unplaced), pose_value(stamp_ns, estimate));
    }

    /// A scan is drawn when it is known what became of its readings.
    fn judge(&mut self, stamp_ns: u64, verdicts: &[(u16, Verdict)], scene: &mut Scene) {
        while self.scans.front().is_some_and(|(stamp, _)| *stamp < stamp_ns) {
            self.scans.pop_front();
        }
        let (Some(robot), Some((_, readings))) =
            (&scene.robot, self.scans.front().filter(|(stamp, _)| *stamp == stamp_ns))
        else {
            return;
        };
        let beams = readings
            .iter()
            .zip(verdicts)
            .filter_map(|(reading, (_, verdict))| self.beam(robot, stamp_ns, reading, *verdict))
            .collect();
        scene.take_beams(stamp_ns, beams);
    }

    fn beam(&self, robot: &Robot, stamp_ns: u64, reading: &Reading, verdict: Verdict) -> Option<Beam> {
        let transducer = robot.transducer(reading.transducer)?;
        let at_ns = stamp_ns.saturating_add_signed(reading.offset_ns.into());
        let from = self.pose_at(at_ns)? * transducer.base_from_transducer;
        let (range_m, echo) = match reading.echo {
            Echo::Hit { range_m } => (range_m, 0),
            Echo::NoEcho => (transducer.range_max_m, 1),
            Echo::Invalid => (0.0, 2),
        };
        Some(Beam {
            x: from.x as f32,
            y: from.y as f32,
            angle_rad: from.theta as f32,
            range_m: range_m as f32,
            aperture_rad: transducer.aperture_rad as f32,
            transducer: reading.transducer,
            verdict: verdict.code(),
            echo,
        })
    }

    /// Where the robot was believed to be; of the poses before and after the nearer in time, if there is but one.
    fn pose_at(&self, at_ns: u64) -> Option<Pose2> {
        let after = self.poses.partition_point(|(stamp_ns, _)| *stamp_ns < at_ns);
        let before = after.checked_sub(1).and_then(|before| self.poses.get(before));
        match (before, self.poses.get(after)) {
            (Some((from_ns, from)), Some((to_ns, to))) => {
                let fraction = (at_ns - from_ns) as f64 / (to_ns - from_ns).max(1) as f64;
                Some(from.interpolate(*to, fraction))
            }
            (one, other) => one.or(other).map(|(_, pose)| *pose),
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

    fn wait(&self, signals: &Signals) -> Result<()> {
        let mut fds: Vec<BorrowedFd<'_>> = vec![signals.fd()];
        // Less than to be told of every message, who is told of the first waits a moment for the others.
        sleep_until_readable(&fds, BUNCH)?;
        fds.extend(self.ports.iter().filter_map(Input::fd));
        sleep_until_readable(&fds, LOOK_EVERY)
    }
}

fn sleep_until_readable(fds: &[BorrowedFd<'_>], patience: Duration) -> Result<()> {
    let mut fds: Vec<PollFd<'_>> = fds.iter().map(|fd| PollFd::new(*fd, PollFlags::POLLIN)).collect();
    match poll(&mut fds, PollTimeout::from(patience.as_millis() as u16)) {
        Ok(_) | Err(Errno::EINTR) => Ok(()),
        Err(errno) => Err(errno).context("waiting for messages"),
    }
}

/// Says that somebody came: producers then hand over what they keep for that.
fn greet(participant: &Participant, plan: &Plan) -> Result<Output> {
    let mut greeting = Output::open(participant, Topic::Health, plan.max_readings, plan.epoch, &[])?;
    greeting.send(0, &Message::Health(Health::new(NAME, std::process::id(), ServiceState::Running)))?;
    greeting.ring()?;
    Ok(greeting)
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
