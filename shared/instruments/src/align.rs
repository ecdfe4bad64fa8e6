//! Laying a map on the world that it shows: the frame of the odometry need not be the world's.

use std::fmt;

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use echogrid_core::{Pose2, wrap_angle};
use echogrid_formats::map::MapDocument;
use serde::Serialize;

/// What of the map is laid on the world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Align {
    /// The first pose of its path, on where the robot really was then.
    Start,
    /// All of its path, as well as it goes.
    Best,
    /// Nothing: its frame is the world's.
    None,
}

impl Align {
    /// The way of aligning in words, for people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Start => "aligned by the start",
            Self::Best => "aligned by all of the path",
            Self::None => "not aligned",
        }
    }
}

/// How a map was laid on the world.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Alignment {
    /// The way in which it was laid there.
    pub by: Align,
    /// How far the world's origin lies from the map's, metres.
    pub moved_m: f64,
    /// How far the world is turned against the map, radians.
    pub turned_rad: f64,
    #[serde(skip)]
    /// The transform from the world into the map.
    pub map_from_world: Pose2,
}

/// Moves that are rounding (a log has six digits), metres and radians.
const ROUNDING: (f64, f64) = (1e-4, 1e-5);

impl Alignment {
    fn new(by: Align, map_from_world: Pose2) -> Self {
        let (moved_m, turned_rad) = (map_from_world.distance_m(Pose2::IDENTITY), wrap_angle(map_from_world.theta));
        Self { by, moved_m, turned_rad, map_from_world }
    }

    /// No alignment: the map's frame is taken for the world's.
    pub fn none() -> Self {
        Self::new(Align::None, Pose2::IDENTITY)
    }

    /// Whether anything moves.
    pub fn moves(&self) -> bool {
        self.moved_m > ROUNDING.0 || self.turned_rad.abs() > ROUNDING.1
    }

    /// Lays `document` on the world by the true path, in order of time. Where nothing is `wanted`: by its start, unless fixes
    /// told where the map lies, or the start was given.
    pub fn of(document: &MapDocument, truth: &[(u64, Pose2)], wanted: Option<Align>) -> Result<Self> {
        let by = wanted.unwrap_or_else(|| if is_placed(document) { Align::None } else { Align::Start });
        let pairs = document.last_drive().iter().filter_map(|point| Some((point.pose, at(truth, point.stamp_ns)?)));
        match by {
            Align::None => Ok(Self::none()),
            Align::Start => {
                let mut pairs = pairs;
                let (pose, true_pose) = pairs.next().context(NEVER)?;
                Ok(Self::new(by, pose * true_pose.inverse()))
            }
            Align::Best => {
                let pairs: Vec<_> = pairs.collect();
                ensure!(!pairs.is_empty(), NEVER);
                Ok(Self::new(by, best(&pairs)))
            }
        }
    }
}

const NEVER: &str =
    "the log knows at no time of the map's path where the robot was, so nothing can be aligned (--align none)";

impl fmt::Display for Alignment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = match self.by {
            Align::None => {
                return f.write_str("none: the map's frame is taken for the world's (--align start or best lays it)");
            }
            Align::Start => "the start of its path",
            Align::Best => "all of its path",
        };
        write!(f, "by {by}: moved {:.2} m, turned {:.1}°", self.moved_m, self.turned_rad.to_degrees())
    }
}

/// Whether the map's frame was told from outside.
fn is_placed(document: &MapDocument) -> bool {
    let Ok(config) = document.provenance.config_toml.parse::<toml::Table>() else { return false };
    let key = |section: &str, key: &str| config.get(section).and_then(|section| section.get(key)).cloned();
    let is_served =
        key("localizer", "source").is_some_and(|source| !matches!(source.as_str(), Some("none" | "operator")));
    is_served || key("odometry", "start").is_some_and(|start| start.is_array())
}

/// Where the robot was; between two poses interpolated, none outside of the path.
pub fn at(truth: &[(u64, Pose2)], stamp_ns: u64) -> Option<Pose2> {
    let after = truth.partition_point(|(pose_ns, _)| *pose_ns < stamp_ns);
    let (after_ns, later) = *truth.get(after)?;
    if after_ns == stamp_ns {
        return Some(later);
    }
    let (before_ns, earlier) = *truth.get(after.checked_sub(1)?)?;
    Some(earlier.interpolate(later, (stamp_ns - before_ns) as f64 / (after_ns - before_ns) as f64))
}

/// The rigid move that takes the second of each pair to the first, least squares of the positions; the heading of the first
/// pair counts where they do not move.
pub(crate) fn best(pairs: &[(Pose2, Pose2)]) -> Pose2 {
    let count = pairs.len() as f64;
    let mean = |of: fn(&(Pose2, Pose2)) -> f64| pairs.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|(map, _)| map.x), mean(|(map, _)| map.y));
    let (u, v) = (mean(|(_, world)| world.x), mean(|(_, world)| world.y));
    let (mut along, mut across) = (0.0, 0.0);
    for (map, world) in pairs {
        let (x, y, u, v) = (map.x - x, map.y - y, world.x - u, world.y - v);
        along += u * x + v * y;
        across += u * y - v * x;
    }
    let turned = match pairs.first() {
        Some((map, world)) if f64::hypot(along, across) < 1e-6 => wrap_angle(map.theta - world.theta),
        _ => f64::atan2(across, along),
    };
    let (s, c) = turned.sin_cos();
    Pose2::new(x - (c * u - s * v), y - (s * u + c * v), turned)
}

#[cfg(test)]
mod tests {
    use echogrid_core::Grid;
    use echogrid_formats::map::{PathPoint, Provenance};

    use super::*;

    fn laid(wanted: Option<Align>, config: &str) -> Alignment {
        let map_from_world = Pose2::new(3.0, -4.0, 1.2);
        let truth: Vec<(u64, Pose2)> =
            (0..10_u64).map(|t| (10 * t, Pose2::new(t as f64, 0.3 * (t * t) as f64, 0.1 * t as f64))).collect();
        let point = |t: u64| PathPoint { stamp_ns: 10 * t, pose: map_from_world * truth[t as usize].1, trust: 1.0 };
        let provenance = Provenance { config_toml: config.to_owned(), ..Provenance::default() };
        let document = MapDocument {
            grid: Grid::new(0.05),
            doubt: None,
            facing: None,
            path: (0..10).map(point).collect(),
            provenance,
        };
        Alignment::of(&document, &truth, wanted).unwrap()
    }

    #[test]
    fn a_move_is_found_by_its_start_and_by_all_of_it() {
        for by in [Align::Start, Align::Best] {
            let found = laid(Some(by), "");
            assert!(found.moves() && found.map_from_world.distance_m(Pose2::new(3.0, -4.0, 0.0)) < 1e-9, "{found:?}");
            assert!((found.turned_rad - 1.2).abs() < 1e-9 && found.to_string().contains("moved 5.00 m, turned 68.8°"));
        }
        assert!(!laid(Some(Align::None), "").moves());
    }

    #[test]
    fn a_map_that_was_localized_lies_where_it_lies() {
        assert_eq!(laid(None, "").by, Align::Start);
        assert_eq!(laid(None, "[localizer]\nsource = \"none\"\n[odometry]\nstart = \"auto\"\n").by, Align::Start);
        assert_eq!(laid(None, "[localizer]\nsource = \"truth\"\n").by, Align::None);
        assert_eq!(laid(None, "[odometry]\nstart = [1.0, 2.0, 3.0]\n").by, Align::None);
    }
}
