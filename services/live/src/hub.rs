//! What there is to be seen now. The feed writes it, every viewer's thread reads it: whoever comes late finds all of it here.
//!
//! Everything has the version at which it changed last, so that a viewer gets what changed since it was last written to, and of
//! that the newest only, however slow it is.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use echogrid_core::{Grid, Robot, Tile, TileIndex};
use echogrid_formats::map::picture;
use echogrid_topics::{Layer as TileLayer, TileUpdate};
use serde_json::{Value, json};

use crate::protocol::{Beam, Layer, Levels, LogLine};
use crate::trail::{Trail, TrailPoint};

/// Lines of the log that are kept.
const LOG_MAX: usize = 500;
/// A line is cut at so many bytes.
const LINE_MAX: usize = 2000;
/// Points of the trail: 1.5 MB for a viewer that comes late.
const TRAIL_MAX: usize = 1 << 16;
/// What a level of the doubt layer stands for, metres.
const DOUBT_LEVEL_M: f32 = 0.01;

/// Something that changes as a whole.
#[derive(Debug)]
pub(crate) struct Versioned<T> {
    pub(crate) version: u64,
    pub(crate) value: T,
}

/// A tile as it is drawn.
#[derive(Debug)]
pub(crate) struct DrawnTile {
    pub(crate) version: u64,
    pub(crate) levels: Box<Levels>,
}

/// All that there is to be seen.
#[derive(Debug)]
pub(crate) struct Scene {
    /// Counts changes.
    version: u64,
    /// Another one: the graph was made anew, and nothing of before counts.
    pub(crate) epoch: u64,
    pub(crate) facts: Value,
    pub(crate) robot: Option<Robot>,
    /// The map itself, for who asks why.
    pub(crate) grid: Option<Grid>,
    pub(crate) layers: BTreeMap<Layer, BTreeMap<TileIndex, DrawnTile>>,
    /// Version at which a layer was added last.
    pub(crate) layers_version: u64,
    pub(crate) trail: Trail,
    /// When the robot was seen last.
    last_ns: u64,
    pub(crate) beams: Versioned<(u64, Vec<Beam>)>,
    pub(crate) pose: Versioned<Value>,
    pub(crate) map: Versioned<Value>,
    pub(crate) health: Versioned<Value>,
    pub(crate) log: VecDeque<LogLine>,
    lines: u64,
    pub(crate) ended: bool,
}

impl Default for Scene {
    fn default() -> Self {
        let nothing = || Versioned { version: 0, value: Value::Null };
        Self {
            version: 0,
            epoch: 0,
            facts: Value::Null,
            robot: None,
            grid: None,
            layers: BTreeMap::new(),
            layers_version: 0,
            trail: Trail::new(TRAIL_MAX),
            last_ns: 0,
            beams: Versioned { version: 0, value: (0, Vec::new()) },
            pose: nothing(),
            map: nothing(),
            health: nothing(),
            log: VecDeque::new(),
            lines: 0,
            ended: false,
        }
    }
}

impl Scene {
    fn next(&mut self) -> u64 {
        self.version += 1;
        self.version
    }

    /// A graph begins, or was made anew; the log goes on.
    pub(crate) fn begin(&mut self, facts: Value) {
        let (log, lines, version, epoch) = (std::mem::take(&mut self.log), self.lines, self.version, self.epoch);
        *self = Self { version: version + 1, epoch: epoch + 1, facts, log, lines, ..Self::default() };
    }

    pub(crate) fn take_robot(&mut self, robot: Robot) {
        let shape = json!({
            "name": robot.name,
            "length_m": robot.footprint.length_m,
            "width_m": robot.footprint.width_m,
            "sensors": robot.sensors.len(),
        });
        if self.facts["robot"] != shape {
            self.facts["robot"] = shape;
            // The facts travel with the greeting alone.
            self.epoch += 1;
        }
        self.robot = Some(robot);
    }

    pub(crate) fn take_tile(&mut self, update: TileUpdate) {
        let TileUpdate { layer, index, revision, resolution_m, log_odds } = update;
        let version = self.next();
        let (layer, levels) = match layer {
            TileLayer::Map => (Layer::Occupancy, Levels::of(|cell| picture::level(log_odds[cell]))),
            TileLayer::Sonar(sonar) => (Layer::Sonar(sonar), Levels::of(|cell| picture::level(log_odds[cell]))),
            TileLayer::Doubt => (Layer::Doubt, Levels::of(|cell| doubt_level(log_odds[cell]))),
            // The page does not show it.
            TileLayer::Facing | TileLayer::State(_) => return,
        };
        if layer == Layer::Occupancy {
            let grid = self.grid.get_or_insert_with(|| Grid::new(resolution_m));
            *grid.tile_mut(index) = Tile::new(revision, log_odds);
        }
        let layers = self.layers.len();
        self.layers.entry(layer).or_default().insert(index, DrawnTile { version, levels: Box::new(levels) });
        if self.layers.len() > layers {
            self.layers_version = version;
        }
    }

    pub(crate) fn take_pose(&mut self, point: Option<TrailPoint>, pose: Value) {
        if let Some(point) = point {
            self.last_ns = point.stamp_ns;
            self.trail.follow(point);
        }
        self.pose = Versioned { version: self.next(), value: pose };
    }

    pub(crate) fn take_beams(&mut self, stamp_ns: u64, beams: Vec<Beam>) {
        self.beams = Versioned { version: self.next(), value: (stamp_ns, beams) };
    }

    pub(crate) fn take_map(&mut self, map: Value) {
        self.map = Versioned { version: self.next(), value: map };
    }

    pub(crate) fn take_health(&mut self, health: Value) {
        if self.health.value != health {
            self.health = Versioned { version: self.next(), value: health };
        }
    }

    /// Something worth reading.
    pub(crate) fn say(&mut self, service: &str, level: &'static str, text: &str) {
        self.lines += 1;
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        let cut = (0..=text.len().min(LINE_MAX)).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
        self.log.push_back(LogLine {
            id: self.lines,
            time_s: since.as_secs_f64(),
            service: service.to_owned(),
            level,
            text: text[..cut].to_owned(),
        });
        if self.log.len() > LOG_MAX {
            self.log.pop_front();
        }
    }

    /// Whether the robot was seen last at this stamp.
    pub(crate) fn is_at(&self, stamp_ns: u64) -> bool {
        self.last_ns == stamp_ns
    }

    pub(crate) fn sonars(&self) -> Vec<u16> {
        let number = |layer: &Layer| if let Layer::Sonar(sonar) = layer { Some(*sonar) } else { None };
        self.layers.keys().filter_map(number).collect()
    }
}

/// What is drawn of a doubt in metres, NaN: none.
fn doubt_level(metres: f32) -> Option<u8> {
    // More than the scale holds is drawn as its end.
    (!metres.is_nan()).then(|| (metres / DOUBT_LEVEL_M).round() as u8)
}

/// The scene, shared.
#[derive(Debug, Default)]
pub(crate) struct Hub(Mutex<Scene>);

impl Hub {
    /// The scene; whoever has it is quick.
    pub(crate) fn scene(&self) -> MutexGuard<'_, Scene> {
        // A viewer's thread that panicked has only read.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
