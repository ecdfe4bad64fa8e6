//! Frames of a recording, and how one stands in another: the tree that `tf` and `tf_static` tell of.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use echogrid_core::{POSITION_MAX_M, Pose2};

/// Transforms that differ by less are one, metres and parts of a unit quaternion.
const SAME_M: f64 = 2e-3;
const SAME_TURN: f64 = 1e-3;
/// Edges that are told apart.
const EDGES_MAX: usize = 4096;

/// The name of a frame, without the slash that early ROS put before it.
pub(crate) fn plain_frame(name: &str) -> String {
    name.trim_start_matches('/').to_owned()
}

/// How a frame stands in another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Transform {
    translation: [f64; 3],
    /// Unit quaternion x, y, z, w.
    rotation: [f64; 4],
}

impl Transform {
    pub(crate) const IDENTITY: Self = Self { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] };

    /// None where the numbers are no place, or no rotation.
    pub(crate) fn new(translation: [f64; 3], rotation: [f64; 4]) -> Option<Self> {
        let is_place = translation.iter().all(|value| value.is_finite() && value.abs() <= POSITION_MAX_M);
        let norm = rotation.iter().map(|value| value * value).sum::<f64>().sqrt();
        // Quaternions of 0 are those that nobody filled in; others are rounded by who wrote them.
        let is_rotation = norm.is_finite() && (0.5..2.0).contains(&norm);
        (is_place && is_rotation).then(|| Self { translation, rotation: rotation.map(|value| value / norm) })
    }

    fn rotate(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [qx, qy, qz, qw] = self.rotation;
        // v + 2 q × (q × v + w v)
        let (cx, cy, cz) = (qy * z - qz * y + qw * x, qz * x - qx * z + qw * y, qx * y - qy * x + qw * z);
        [x + 2.0 * (qy * cz - qz * cy), y + 2.0 * (qz * cx - qx * cz), z + 2.0 * (qx * cy - qy * cx)]
    }

    pub(crate) fn then(&self, next: &Self) -> Self {
        let [ax, ay, az, aw] = self.rotation;
        let [bx, by, bz, bw] = next.rotation;
        let [x, y, z] = self.rotate(next.translation);
        let [tx, ty, tz] = self.translation;
        Self {
            translation: [tx + x, ty + y, tz + z],
            rotation: [
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
                aw * bw - ax * bx - ay * by - az * bz,
            ],
        }
    }

    pub(crate) fn inverse(&self) -> Self {
        let [x, y, z, w] = self.rotation;
        let back = Self { translation: [0.0; 3], rotation: [-x, -y, -z, w] };
        let translation = back.rotate(self.translation).map(|value| -value);
        Self { translation, ..back }
    }

    /// On the floor: the heading is that of the x axis.
    pub(crate) fn planar(&self) -> Pose2 {
        let [x, y, _] = self.translation;
        let [ahead, left, _] = self.rotate([1.0, 0.0, 0.0]);
        Pose2 { x, y, theta: libm::atan2(left, ahead) }
    }

    /// How far up its z axis points: 1 stands upright, -1 hangs upside down.
    pub(crate) fn up(&self) -> f64 {
        self.rotate([0.0, 0.0, 1.0])[2]
    }

    /// How far up its x axis points.
    pub(crate) fn rise(&self) -> f64 {
        self.rotate([1.0, 0.0, 0.0])[2]
    }

    fn is(&self, other: &Self) -> bool {
        let near = |a: &[f64], b: &[f64], by: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= by);
        let opposite = other.rotation.map(|value| -value);
        near(&self.translation, &other.translation, SAME_M)
            && (near(&self.rotation, &other.rotation, SAME_TURN) || near(&self.rotation, &opposite, SAME_TURN))
    }
}

/// What was said of one frame in another.
#[derive(Debug, Clone)]
pub(crate) struct Edge {
    /// The earliest, and when it was.
    pub(crate) first: (u64, Transform),
    pub(crate) moves: bool,
    /// The least time from a stamp until it was recorded, nanoseconds; none: they have no stamps.
    pub(crate) least_delay_ns: Option<i128>,
}

/// All frames; by frame, and the frame that it stands in.
#[derive(Debug, Clone, Default)]
pub(crate) struct Frames {
    edges: BTreeMap<(String, String), Edge>,
}

impl Frames {
    pub(crate) fn add(&mut self, parent: &str, child: &str, stamp_ns: Option<u64>, log_ns: u64, transform: Transform) {
        let key = (child.to_owned(), parent.to_owned());
        if self.edges.len() >= EDGES_MAX && !self.edges.contains_key(&key) {
            return;
        }
        let first = (stamp_ns.unwrap_or(0), transform);
        let edge = self.edges.entry(key).or_insert(Edge { first, moves: false, least_delay_ns: None });
        edge.moves |= !edge.first.1.is(&transform);
        if first.0 < edge.first.0 {
            edge.first = first;
        }
        if let Some(stamp_ns) = stamp_ns {
            let delay_ns = i128::from(log_ns) - i128::from(stamp_ns);
            edge.least_delay_ns = Some(edge.least_delay_ns.map_or(delay_ns, |least| least.min(delay_ns)));
        }
    }

    /// Each frame, the one that it stands in, and what was said of that.
    pub(crate) fn edges(&self) -> impl Iterator<Item = (&str, &str, &Edge)> {
        self.edges.iter().map(|((child, parent), edge)| (child.as_str(), parent.as_str(), edge))
    }

    pub(crate) fn parents(&self, child: &str) -> impl Iterator<Item = (&str, &Edge)> {
        let from = (child.to_owned(), String::new());
        let of_child = move |(name, _): &(&(String, String), &Edge)| name.0 == from.0;
        let edges = self.edges.range((child.to_owned(), String::new())..).take_while(of_child);
        edges.map(|((_, parent), edge)| (parent.as_str(), edge))
    }

    pub(crate) fn knows(&self, frame: &str) -> bool {
        self.edges.keys().any(|(child, parent)| child == frame || parent == frame)
    }

    /// How `sensor` stands in `base`, and whether something between them moves; none where nothing joins them. Edges out of frames
    /// in `never` do not count: they say where the robot is.
    pub(crate) fn between(&self, base: &str, sensor: &str, never: &BTreeSet<String>) -> Option<(Transform, bool)> {
        [false, true].into_iter().find_map(|may_move| {
            let from_base = self.ancestors(base, may_move, never);
            let from_sensor = self.ancestors(sensor, may_move, never);
            let common = from_sensor.iter().find_map(|(name, sensor)| Some((from_base.get(name)?, sensor)));
            common.map(|(base, sensor)| (base.inverse().then(sensor), may_move))
        })
    }

    /// The frame itself and those that it stands in, and how it stands there.
    fn ancestors(&self, frame: &str, may_move: bool, never: &BTreeSet<String>) -> BTreeMap<String, Transform> {
        let mut found = BTreeMap::from([(frame.to_owned(), Transform::IDENTITY)]);
        let mut open = VecDeque::from([frame.to_owned()]);
        while let Some(name) = open.pop_front() {
            let Some(here) = found.get(&name).copied() else { continue };
            for (parent, edge) in self.parents(&name) {
                if (edge.moves && !may_move) || never.contains(parent) || found.contains_key(parent) {
                    continue;
                }
                found.insert(parent.to_owned(), edge.first.1.then(&here));
                open.push_back(parent.to_owned());
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};

    use super::*;

    fn turned_left(x: f64) -> Transform {
        Transform::new([x, 0.0, 0.0], [0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2]).unwrap()
    }

    #[test]
    fn transforms_follow_each_other() {
        let pose = turned_left(1.0).then(&turned_left(2.0)).planar();
        assert!((pose.x - 1.0).abs() < 1e-12 && (pose.y - 2.0).abs() < 1e-12, "{pose:?}");
        assert!((pose.theta.abs() - 2.0 * FRAC_PI_2).abs() < 1e-12);
        let none = turned_left(3.0).inverse().then(&turned_left(3.0)).planar();
        assert!(none.distance_m(Pose2::IDENTITY) < 1e-12 && none.theta.abs() < 1e-12);
        let over = Transform::new([0.0; 3], [1.0, 0.0, 0.0, 0.0]).unwrap();
        assert!((over.up() + 1.0).abs() < 1e-12);
        assert!(
            Transform::new([0.0; 3], [0.0; 4]).is_none()
                && Transform::new([f64::NAN; 3], [0.0, 0.0, 0.0, 1.0]).is_none()
        );
    }

    #[test]
    fn a_mount_is_found_through_the_tree() {
        let mut frames = Frames::default();
        frames.add("odom", "footprint", Some(0), 0, turned_left(5.0));
        frames.add("odom", "footprint", Some(1), 0, turned_left(6.0));
        frames.add("footprint", "base", Some(0), 0, Transform::new([0.0, 0.0, 0.1], [0.0, 0.0, 0.0, 1.0]).unwrap());
        frames.add("base", "laser", Some(0), 0, turned_left(0.2));
        frames.add("base", "arm", Some(0), 0, turned_left(0.2));
        frames.add("base", "arm", Some(1), 0, turned_left(0.4));
        let never = BTreeSet::from(["odom".to_owned()]);
        let (mount, moves) = frames.between("footprint", "laser", &never).unwrap();
        assert!((mount.planar().x - 0.2).abs() < 1e-12 && !moves);
        let (mount, _) = frames.between("laser", "footprint", &never).unwrap();
        assert!((mount.planar().y - 0.2).abs() < 1e-12);
        assert!(frames.between("footprint", "arm", &never).unwrap().1, "it moves");
        assert!(frames.between("odom", "laser", &BTreeSet::new()).unwrap().1);
        assert!(frames.between("footprint", "nowhere", &never).is_none());
    }
}
