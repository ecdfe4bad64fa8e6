//! Which of a recording's messages are used, and as what.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use echogrid_core::Pose2;

use super::frames::{Frames, Transform};
use super::inventory::Inventory;
use super::message::Type;
use crate::log::{LogError, SurveyOptions};

/// Clocks of two topics that are farther apart are two clocks, nanoseconds.
const CLOCKS_APART_NS: i128 = 2_000_000_000;
/// A laser whose plane is farther off the floor's is told; beyond the other it is refused: cosines of 3° and of 45°.
const LEVEL: f64 = 0.9986;
const TILTED: f64 = core::f64::consts::FRAC_1_SQRT_2;
/// A sonar that looks farther up or down than this sees no wall: sine of 45°.
const STEEP: f64 = core::f64::consts::FRAC_1_SQRT_2;
/// Sensors that can be told apart.
const STREAMS_MAX: usize = 4096;
/// Names of the frame in which the robot really is.
const MAPS: [&str; 2] = ["map", "world"];

/// One sensor: the messages of a topic in one frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stream {
    pub(crate) number: u16,
    pub(crate) base_from_sensor: Pose2,
    /// It hangs upside down.
    pub(crate) is_mirrored: bool,
}

/// Where the odometry comes from.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum OdometryFrom {
    /// A topic of `nav_msgs/Odometry`.
    Topic(String),
    /// How `base` stands in `odom`.
    Transforms { odom: String, base: String },
}

/// Where the truth comes from.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum TruthFrom {
    Topic(String),
    /// How `odom`, or the base itself, stands in `map`.
    Transforms {
        map: String,
        child: String,
        is_of_odom: bool,
    },
}

/// How the messages of a recording become those of a log.
#[derive(Debug, Clone)]
pub(crate) struct RecordingPlan {
    /// By topic and frame.
    pub(crate) streams: BTreeMap<(String, String), Stream>,
    /// By number.
    pub(crate) names: Vec<String>,
    pub(crate) odometry: OdometryFrom,
    pub(crate) truth: Option<TruthFrom>,
    /// The stamps are those of when messages were recorded.
    pub(crate) by_arrival: bool,
    /// Messages that are not used, by topic and type.
    pub(crate) skipped: BTreeMap<String, u64>,
    pub(crate) remarks: Vec<String>,
}

impl RecordingPlan {
    /// Chooses what is used.
    pub(crate) fn new(path: &Path, inventory: &Inventory, options: &SurveyOptions) -> Result<Self, LogError> {
        let choice = Choice { path, inventory, options };
        choice.check_names()?;
        choice.check_truth()?;
        let (odometry, odom, base) = choice.odometry()?;
        let truth = choice.truth(&odom, base.as_deref())?;
        let sensors = choice.sensors()?;
        let mut plan = Self {
            streams: BTreeMap::new(),
            names: Vec::new(),
            odometry,
            truth,
            by_arrival: false,
            skipped: BTreeMap::new(),
            remarks: Vec::new(),
        };
        plan.mount(&choice, &sensors, &odom, base)?;
        plan.choose_clock(inventory, &sensors);
        plan.list_skipped(inventory, &sensors);
        Ok(plan)
    }

    /// Finds where each sensor sits.
    fn mount(
        &mut self,
        choice: &Choice<'_>,
        sensors: &BTreeSet<&str>,
        odom: &str,
        base: Option<String>,
    ) -> Result<(), LogError> {
        let frames = &choice.inventory.frames;
        let never: BTreeSet<String> = MAPS.iter().map(|name| (*name).to_owned()).chain([odom.to_owned()]).collect();
        let mut tilted = Vec::new();
        for topic in sensors {
            let Some(record) = choice.inventory.topics.get(*topic) else { continue };
            for (frame, _) in record.frames.keys() {
                let name = if record.frames.len() > 1 { format!("{topic} ({frame})") } else { (*topic).to_owned() };
                let (base, mount) = find_mount(frames, base.as_deref(), frame, &never);
                if mount.is_none() {
                    let why = if frames.knows(frame) { "nothing joins it to the robot's" } else { "no tf tells of it" };
                    self.remarks.push(format!(
                        "{name}: its frame is \"{frame}\", and {why} ({base}): it is taken to sit there and to look ahead"
                    ));
                }
                let (transform, moves) = mount.unwrap_or((Transform::IDENTITY, false));
                if moves {
                    self.remarks.push(format!("{name}: it moves on the robot ({base}); where it sat first counts"));
                }
                let is_laser = record.kind == Some(Type::LaserScan);
                if is_laser && transform.up().abs() < TILTED || !is_laser && transform.rise().abs() > STEEP {
                    tilted.push(name);
                    continue;
                }
                if is_laser && transform.up().abs() < LEVEL {
                    let degrees = libm::acos(transform.up().abs().min(1.0)).to_degrees();
                    self.remarks
                        .push(format!("{name}: its plane is {degrees:.0}° off the floor's: used as if it were level"));
                }
                let is_mirrored = is_laser && transform.up() < 0.0;
                if is_mirrored {
                    self.remarks.push(format!("{name}: it hangs upside down: its beams are mirrored"));
                }
                if self.names.len() >= STREAMS_MAX {
                    return Err(choice.refuse(format!("more than {STREAMS_MAX} range sensors")));
                }
                let number = self.names.len() as u16;
                let stream = Stream { number, base_from_sensor: transform.planar(), is_mirrored };
                self.streams.insert(((*topic).to_owned(), frame.clone()), stream);
                self.names.push(name);
            }
        }
        if self.streams.is_empty() && !tilted.is_empty() {
            let tilted = tilted.join(", ");
            return Err(
                choice.refuse(format!("no sensor of it looks along the floor: {tilted}; name another by --topic"))
            );
        }
        self.remarks
            .extend(tilted.into_iter().map(|name| format!("{name}: it does not look along the floor: not used")));
        Ok(())
    }

    /// Stamps count, unless topics have clocks of their own: then it counts when messages were recorded.
    fn choose_clock(&mut self, inventory: &Inventory, sensors: &BTreeSet<&str>) {
        let topic = |name: &str| inventory.topics.get(name).and_then(|topic| topic.least_delay_ns);
        let mut delays: Vec<(&str, Option<i128>)> = sensors.iter().map(|name| (*name, topic(name))).collect();
        match &self.odometry {
            OdometryFrom::Topic(name) => delays.push((name, topic(name))),
            OdometryFrom::Transforms { odom, base } => {
                let mut edges = inventory.frames.parents(base).filter(|(parent, _)| parent == odom);
                delays.push(("tf", edges.next().and_then(|(_, edge)| edge.least_delay_ns)));
            }
        }
        if let Some((name, _)) = delays.iter().find(|(_, delay)| delay.is_none()) {
            self.by_arrival = true;
            self.remarks.push(format!("{name}: its messages have no stamps: it counts when messages were recorded"));
            return;
        }
        let stamped = || delays.iter().filter_map(|(name, delay)| Some((*name, (*delay)?)));
        let (least, most) = (stamped().min_by_key(|(_, ns)| *ns), stamped().max_by_key(|(_, ns)| *ns));
        if let (Some((early, least_ns)), Some((late, most_ns))) = (least, most)
            && most_ns - least_ns > CLOCKS_APART_NS
        {
            self.by_arrival = true;
            let apart_s = (most_ns - least_ns) as f64 * 1e-9;
            self.remarks.push(format!(
                "the stamps of {late} are {apart_s:.1} s behind those of {early}: it counts when messages were recorded"
            ));
        }
    }

    fn list_skipped(&mut self, inventory: &Inventory, sensors: &BTreeSet<&str>) {
        let is_odometry = |name: &str, kind| match &self.odometry {
            OdometryFrom::Topic(topic) => topic == name,
            OdometryFrom::Transforms { .. } => kind == Some(Type::Transforms),
        };
        let is_truth = |name: &str| matches!(&self.truth, Some(TruthFrom::Topic(topic)) if topic == name);
        for (name, topic) in &inventory.topics {
            let is_used = sensors.contains(name.as_str())
                || is_odometry(name, topic.kind)
                || is_truth(name)
                || topic.kind == Some(Type::Transforms);
            if !is_used {
                self.skipped.insert(format!("{name} ({})", topic.datatype), topic.count);
            }
        }
    }
}

/// The frame of the robot, and how a sensor stands in it, and whether that changes; none where nothing tells it.
fn find_mount(
    frames: &Frames,
    base: Option<&str>,
    sensor: &str,
    never: &BTreeSet<String>,
) -> (String, Option<(Transform, bool)>) {
    let usual = ["base_footprint", "base_link", "base"];
    let mount = |base: &str| {
        if base == sensor { Some((Transform::IDENTITY, false)) } else { frames.between(base, sensor, never) }
    };
    let bases = base.into_iter().chain(usual);
    let found = bases.clone().find_map(|base| Some((base, mount(base)?)));
    match found {
        Some((base, mount)) => (base.to_owned(), Some(mount)),
        None => (base.unwrap_or("base_link").to_owned(), None),
    }
}

/// What is there, and what the user said of it.
struct Choice<'a> {
    path: &'a Path,
    inventory: &'a Inventory,
    options: &'a SurveyOptions,
}

impl Choice<'_> {
    fn refuse(&self, why: String) -> LogError {
        LogError::Topics { path: self.path.to_path_buf(), why, list: self.inventory.list() }
    }

    /// Topics of a type: those that the user named, if any.
    fn of(&self, kind: Type) -> Vec<&str> {
        let all: Vec<&str> = self.inventory.of(kind).map(|(name, _)| name).collect();
        let named: Vec<&str> = all.iter().copied().filter(|name| self.is_named(name)).collect();
        if named.is_empty() { all } else { named }
    }

    fn is_named(&self, topic: &str) -> bool {
        self.options.topics.iter().any(|named| same_topic(named, topic))
    }

    fn is_truth(&self, topic: &str) -> bool {
        self.options.truth.as_deref().is_some_and(|truth| same_topic(truth, topic))
    }

    /// Topics that the user names must be there, and be of use.
    fn check_names(&self) -> Result<(), LogError> {
        for named in &self.options.topics {
            let topic = self.inventory.topics.iter().find(|(name, _)| same_topic(named, name));
            let Some((name, topic)) = topic else {
                let near = crate::near::near_word(named, self.inventory.topics.keys().map(String::as_str));
                let near = near.map_or(String::new(), |near| format!("; did you mean {near}?"));
                return Err(self.refuse(format!("no topic {named} in it{near}")));
            };
            let is_of_use =
                matches!(topic.kind, Some(Type::LaserScan | Type::Range | Type::Odometry | Type::Transforms));
            if !is_of_use {
                return Err(self.refuse(format!(
                    "{name} is of {}; expected sensor_msgs/LaserScan, sensor_msgs/Range, nav_msgs/Odometry or tf2_msgs/TFMessage",
                    topic.datatype
                )));
            }
        }
        Ok(())
    }

    /// So must who says where the robot was.
    fn check_truth(&self) -> Result<(), LogError> {
        let Some(truth) = self.options.truth.as_deref().filter(|truth| *truth != "tf") else { return Ok(()) };
        match self.inventory.topics.iter().find(|(name, _)| same_topic(truth, name)) {
            Some((_, topic)) if topic.kind.is_some_and(Type::tells_a_pose) => Ok(()),
            Some((name, topic)) => Err(self.refuse(format!(
                "{name} is of {} and can't say where the robot was; expected nav_msgs/Odometry or geometry_msgs/PoseStamped, \
                 PoseWithCovarianceStamped or TransformStamped",
                topic.datatype
            ))),
            None => Err(self.refuse(format!("no topic {truth} in it, which should say where the robot was"))),
        }
    }

    /// The odometry, its frame, and the frame of the robot where it is said.
    fn odometry(&self) -> Result<(OdometryFrom, String, Option<String>), LogError> {
        let is_tf_named = self.inventory.of(Type::Transforms).any(|(name, _)| self.is_named(name));
        let topics: Vec<&str> = self.of(Type::Odometry).into_iter().filter(|name| !self.is_truth(name)).collect();
        let is_topic_named = topics.iter().any(|name| self.is_named(name));
        match topics.as_slice() {
            [name] if is_topic_named || !is_tf_named => {
                let frames = self.inventory.topics.get(*name).and_then(|topic| most(&topic.frames));
                let (odom, base) = frames.cloned().unwrap_or_default();
                let base = Some(base).filter(|base| !base.is_empty());
                return Ok((OdometryFrom::Topic((*name).to_owned()), odom, base));
            }
            [_, _, ..] if is_topic_named || !is_tf_named => {
                return Err(
                    self.refuse(format!("{} topics of nav_msgs/Odometry in it; name one by --topic", topics.len()))
                );
            }
            _ => {}
        }
        let (odom, base) = self.odometry_edge()?;
        let from = OdometryFrom::Transforms { odom: odom.clone(), base: base.clone() };
        Ok((from, odom, Some(base)))
    }

    /// The frames between which the odometry moves, where no topic says it.
    fn odometry_edge(&self) -> Result<(String, String), LogError> {
        let frames = &self.inventory.frames;
        let is_odom = |name: &str| name.rsplit('/').next().is_some_and(|name| name.contains("odom"));
        let found = |named: bool| -> BTreeSet<(String, String)> {
            let edges = frames.edges().filter(|(child, parent, edge)| {
                if named { is_odom(parent) && !is_odom(child) } else { edge.moves && !MAPS.contains(parent) }
            });
            let above = self.above_sensors();
            edges
                .filter(|(child, ..)| above.contains(*child))
                .map(|(child, parent, _)| (parent.to_owned(), child.to_owned()))
                .collect()
        };
        let named = found(true);
        let edges = if named.is_empty() { found(false) } else { named };
        let mut edges = edges.into_iter();
        match (edges.next(), edges.next()) {
            (Some(edge), None) => Ok(edge),
            (None, _) => Err(self.refuse(
                "no odometry in it: expected a topic of nav_msgs/Odometry, or tf from odom to the robot's base".to_owned(),
            )),
            (Some((odom, base)), Some((other_odom, other_base))) => Err(self.refuse(format!(
                "tf tells of several odometries: {odom} to {base}, and {other_odom} to {other_base}; expected one, or a topic of \
                 nav_msgs/Odometry"
            ))),
        }
    }

    /// The frames of range sensors, and all that these stand in.
    fn above_sensors(&self) -> BTreeSet<String> {
        let frames = &self.inventory.frames;
        let sensors = self.inventory.of(Type::LaserScan).chain(self.inventory.of(Type::Range));
        let mut open: Vec<String> =
            sensors.flat_map(|(_, topic)| topic.frames.keys().map(|(frame, _)| frame.clone())).collect();
        if !open.iter().any(|frame| frames.knows(frame)) {
            // Nothing joins them to the robot: any frame will do.
            return frames.edges().map(|(child, ..)| child.to_owned()).collect();
        }
        let mut above = BTreeSet::new();
        while let Some(frame) = open.pop() {
            open.extend(frames.parents(&frame).map(|(parent, _)| parent.to_owned()));
            if !above.insert(frame) {
                // Frames in a circle, or reached twice.
                open.retain(|frame| !above.contains(frame));
            }
        }
        above
    }

    /// The topics of range sensors: the one lidar, or those that are named, and every sonar.
    fn sensors(&self) -> Result<BTreeSet<&str>, LogError> {
        let (lidars, sonars) = (self.of(Type::LaserScan), self.of(Type::Range));
        let is_named = |topics: &[&str]| topics.iter().any(|name| self.is_named(name));
        match (is_named(&lidars), is_named(&sonars)) {
            (true, false) => Ok(lidars.into_iter().collect()),
            (false, true) => Ok(sonars.into_iter().collect()),
            (true, true) => Ok(lidars.into_iter().chain(sonars).collect()),
            (false, false) if lidars.len() > 1 => Err(self.refuse(format!(
                "{} topics of sensor_msgs/LaserScan in it; name one or more by --topic",
                lidars.len()
            ))),
            (false, false) if lidars.is_empty() && sonars.is_empty() => Err(self.refuse(format!(
                "no range readings in it: expected a topic of sensor_msgs/LaserScan or sensor_msgs/Range{}",
                if self.inventory.has_clouds() { " (pointcloud_to_laserscan of ROS makes one of a cloud)" } else { "" }
            ))),
            (false, false) => Ok(lidars.into_iter().chain(sonars).collect()),
        }
    }

    /// Where the truth comes from, if it was asked for.
    fn truth(&self, odom: &str, base: Option<&str>) -> Result<Option<TruthFrom>, LogError> {
        let Some(truth) = self.options.truth.as_deref() else { return Ok(None) };
        if truth != "tf" {
            let topic = self.inventory.topics.keys().find(|name| same_topic(truth, name));
            return Ok(topic.cloned().map(TruthFrom::Topic));
        }
        let frames = &self.inventory.frames;
        let stands = |child: &str| {
            frames.parents(child).map(|(parent, _)| parent.to_owned()).find(|p| MAPS.contains(&p.as_str()))
        };
        let of_odom = stands(odom).map(|map| TruthFrom::Transforms { map, child: odom.to_owned(), is_of_odom: true });
        let of_base = base.and_then(|base| {
            stands(base).map(|map| TruthFrom::Transforms { map, child: base.to_owned(), is_of_odom: false })
        });
        of_odom.or(of_base).map(Some).ok_or_else(|| {
            self.refuse(format!(
                "tf does not say where the robot was: expected map to {odom}{}",
                base.map_or(String::new(), |base| format!(", or map to {base}"))
            ))
        })
    }
}

/// The frames of most messages.
fn most(frames: &BTreeMap<(String, String), u64>) -> Option<&(String, String)> {
    frames.iter().rev().max_by_key(|(_, count)| **count).map(|(names, _)| names)
}

/// A topic may be named without its slash.
fn same_topic(a: &str, b: &str) -> bool {
    a.trim_start_matches('/') == b.trim_start_matches('/')
}

impl RecordingPlan {
    /// Whether a topic is a range sensor that is used.
    pub(crate) fn has(&self, topic: &str) -> bool {
        self.streams.range((topic.to_owned(), String::new())..).next().is_some_and(|((name, _), _)| name == topic)
    }

    pub(crate) fn stream(&self, topic: &str, frame: &str) -> Option<&Stream> {
        self.streams.get(&(topic.to_owned(), frame.to_owned()))
    }
}
