//! In the publisher's place: what a map was at given moments.

use anyhow::{Context, Result};
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{Grid, Pose2, Tile, Verdict};
use echogrid_formats::map::sheet::Panel;
use echogrid_publisher::PublisherService;
use echogrid_service::{Input, Outbox, Service};
use echogrid_topics::{Layer, Message, TileUpdate, Topic};

/// A map at a moment.
pub(super) struct Snapshot {
    pub(super) panel: Panel,
    /// In a nominal reading.
    pub(super) trust: f64,
}

impl Snapshot {
    /// How far the robot was from where it believed to be, metres.
    pub(super) fn off_m(&self) -> Option<f64> {
        Some(self.panel.robot?.distance_m(self.panel.true_robot?))
    }
}

/// All that was seen of a run.
pub(super) struct Seen {
    pub(super) grid: Grid,
    pub(super) moments: Vec<Snapshot>,
    pub(super) true_path: Vec<Pose2>,
    /// Where the robot was believed to be at first.
    pub(super) first: Pose2,
    /// Where it was believed to be, and where it really was, wherever both are known.
    pub(super) pairs: Vec<(Pose2, Pose2)>,
    /// When the absolute localizations were true.
    pub(super) fixes_ns: Vec<u64>,
    pub(super) readings_used: u64,
    pub(super) first_ns: u64,
    pub(super) last_ns: u64,
}

/// Looks on.
pub(super) struct Observer {
    /// Saves the map, too.
    publisher: Option<PublisherService>,
    /// Moments that are to come, the next one last; each as it was when nothing later had been seen.
    to_come: Vec<u64>,
    moments: Vec<Snapshot>,
    grid: Grid,
    robot: Option<Pose2>,
    true_robot: Option<Pose2>,
    trust: f64,
    true_path: Vec<Pose2>,
    first: Option<Pose2>,
    pairs: Vec<(Pose2, Pose2)>,
    fixes_ns: Vec<u64>,
    readings_used: u64,
    span_ns: Option<(u64, u64)>,
}

impl Observer {
    /// Looks at the `moments`, which must be in order, of a map with cells of `resolution_m`.
    pub(super) fn new(resolution_m: f64, publisher: Option<PublisherService>, mut moments: Vec<u64>) -> Self {
        moments.reverse();
        Self {
            publisher,
            to_come: moments,
            moments: Vec::new(),
            grid: Grid::new(resolution_m),
            robot: None,
            true_robot: None,
            trust: 1.0,
            true_path: Vec::new(),
            first: None,
            pairs: Vec::new(),
            fixes_ns: Vec::new(),
            readings_used: 0,
            span_ns: None,
        }
    }

    /// What it saw.
    pub(super) fn into_seen(self) -> Result<Seen> {
        let (first_ns, last_ns) = self.span_ns.context("the drive has no pose")?;
        Ok(Seen {
            grid: self.grid,
            moments: self.moments,
            true_path: self.true_path,
            first: self.first.unwrap_or_default(),
            pairs: self.pairs,
            fixes_ns: self.fixes_ns,
            readings_used: self.readings_used,
            first_ns,
            last_ns,
        })
    }

    fn look(&mut self) {
        let label = String::new();
        let panel = Panel { grid: self.grid.clone(), robot: self.robot, true_robot: self.true_robot, label };
        self.moments.push(Snapshot { panel, trust: self.trust });
    }

    fn see(&mut self, stamp_ns: u64, message: &Message) {
        while self.to_come.pop_if(|moment| stamp_ns > *moment).is_some() {
            self.look();
        }
        match message {
            Message::Tile(TileUpdate { layer: Layer::Map, index, revision, log_odds, .. }) => {
                *self.grid.tile_mut(*index) = Tile::new(*revision, log_odds.clone());
            }
            Message::Estimate(estimate) => {
                let pose = estimate.estimate.pose;
                (self.robot, self.trust) = (Some(pose), estimate.trust);
                self.first.get_or_insert(pose);
                self.pairs.extend(self.true_robot.map(|true_pose| (pose, true_pose)));
                let (first_ns, _) = self.span_ns.unwrap_or((stamp_ns, stamp_ns));
                self.span_ns = Some((first_ns, stamp_ns));
            }
            Message::TruePose(pose) => {
                self.true_robot = pose.map_from_base;
                self.true_path.extend(pose.map_from_base);
            }
            Message::Fix(fix) if fix.fix.is_some() => self.fixes_ns.push(stamp_ns),
            Message::Info(info) => self.readings_used = info.verdicts.get(Verdict::Accepted),
            _ => {}
        }
    }
}

impl Service for Observer {
    fn inputs(&self) -> &'static [Topic] {
        &[Topic::TruePose, Topic::OdometryEstimate, Topic::LocalizationFix, Topic::MapTiles, Topic::MapInfo]
    }

    fn outputs(&self) -> &'static [Topic] {
        &[]
    }

    // It lives in one process with the others.
    fn save(&mut self, _parts: &mut Parts) {}

    fn restore(&mut self, _saved: &Saved) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()> {
        match &input {
            Input::Message { stamp_ns, message, .. } => self.see(*stamp_ns, message),
            Input::Finish => {
                while self.to_come.pop().is_some() {
                    self.look();
                }
            }
        }
        self.publisher.as_mut().map_or(Ok(()), |publisher| publisher.step(input, out))
    }
}
