//! Where walls meet or end: what sound comes back from whatever the angle.
//!
//! Two walls that meet in a right angle send sound back to where it came from (a concave corner, a strong retroreflector);
//! an edge (a convex corner, the end of a wall) scatters a little of it in all directions.

use core::f64::consts::{FRAC_PI_2, PI, TAU};
use std::collections::BTreeMap;

use echogrid_core::{Segment, World};

/// Ends of walls nearer to each other than this meet, metres.
const MEET_M: f64 = 0.01;
/// A piece of wall shorter than this makes no corner: a few wavelengths, and more than a pixel of most map images, metres.
const FACE_MIN_M: f64 = 0.08;
/// Angles between walls up to this far from a right one reflect like one, radians.
const NEARLY_RIGHT_RAD: f64 = 0.26;
/// Corners between these angles answer at all.
const CORNER_RAD: core::ops::RangeInclusive<f64> = 0.35..=2.1;
/// From here on it is an edge.
const EDGE_RAD: f64 = PI + 0.35;
/// What comes back of the sound, against a wall that is met head-on.
const RIGHT_CORNER_STRENGTH: f64 = 0.9;
const CORNER_STRENGTH: f64 = 0.3;
const EDGE_STRENGTH: f64 = 0.15;
/// Those within reach are looked up anew when the robot has left a square of this side, metres.
const PLACE_M: f64 = 1.0;

/// A corner or an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corner {
    pub(crate) at: [f64; 2],
    /// Unit vectors along the walls on its two sides; what can hear it lies between them, counter-clockwise.
    sides: [[f64; 2]; 2],
    pub(crate) is_edge: bool,
    pub(crate) strength: f64,
}

impl Corner {
    /// Whether a place lies between its walls, on the side from which it is a corner.
    pub(crate) fn faces(&self, from: [f64; 2]) -> bool {
        let there = [from[0] - self.at[0], from[1] - self.at[1]];
        let [a, b] = self.sides;
        let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
        if self.is_edge {
            // Not within the wedge of the wall itself.
            !(cross(b, there) > 0.0 && cross(there, a) > 0.0)
        } else {
            cross(a, there) > 0.0 && cross(there, b) > 0.0
        }
    }
}

/// All corners of a world, and those near the robot.
#[derive(Debug, Clone)]
pub(crate) struct Corners {
    /// By square of `reach_m`.
    squares: BTreeMap<(i64, i64), Vec<Corner>>,
    /// From no farther they are heard.
    reach_m: f64,
    place: Option<(i64, i64)>,
    near: Vec<Corner>,
}

impl Corners {
    pub(crate) fn of(world: &World, reach_m: f64) -> Self {
        // One node per centimetre: walls that meet have the same one, or neighbours that tell the same.
        let rounded = |place: [f64; 2]| place.map(|value| (value / MEET_M).round() as i64);
        let mut nodes: BTreeMap<[i64; 2], [f64; 2]> = BTreeMap::new();
        for line in world.lines() {
            for end in [line.from, line.to] {
                nodes.entry(rounded(end)).or_insert(end);
            }
        }
        let mut squares: BTreeMap<(i64, i64), Vec<Corner>> = BTreeMap::new();
        for at in nodes.into_values() {
            for corner in corners_at(at, &world.lines_near(at, MEET_M)) {
                squares.entry(square(at, reach_m)).or_default().push(corner);
            }
        }
        Self { squares, reach_m, place: None, near: Vec::new() }
    }

    /// Those that can be heard from a place, and some more.
    pub(crate) fn near(&mut self, from: [f64; 2]) -> &[Corner] {
        let place = square(from, PLACE_M);
        if self.place != Some(place) {
            self.place = Some(place);
            let centre = [(place.0 as f64 + 0.5) * PLACE_M, (place.1 as f64 + 0.5) * PLACE_M];
            let (column, row) = square(from, self.reach_m);
            let around = (-2..=2_i64).flat_map(|dy| (-2..=2_i64).map(move |dx| (column + dx, row + dy)));
            let listed = around.filter_map(|square| self.squares.get(&square)).flatten();
            let reach_m = self.reach_m + PLACE_M;
            let is_near = |corner: &&Corner| libm::hypot(corner.at[0] - centre[0], corner.at[1] - centre[1]) <= reach_m;
            self.near = listed.filter(is_near).copied().collect();
        }
        &self.near
    }
}

fn square([x, y]: [f64; 2], side_m: f64) -> (i64, i64) {
    ((x / side_m).floor() as i64, (y / side_m).floor() as i64)
}

/// The corners that these walls make at a place.
fn corners_at(at: [f64; 2], walls: &[Segment]) -> Vec<Corner> {
    let mut directions: Vec<f64> = Vec::new();
    for wall in walls {
        for end in [wall.from, wall.to] {
            let (dx, dy) = (end[0] - at[0], end[1] - at[1]);
            if libm::hypot(dx, dy) > FACE_MIN_M {
                directions.push(libm::atan2(dy, dx));
            }
        }
    }
    directions.sort_by(f64::total_cmp);
    directions.dedup_by(|a, b| (*a - *b).abs() < 0.02);
    let next = directions.iter().skip(1).copied().chain(directions.first().map(|first| first + TAU));
    let unit = |angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        [cos, sin]
    };
    let gaps = directions.iter().copied().zip(next);
    gaps.filter_map(|(from, to)| {
        let gap = to - from;
        let is_edge = gap >= EDGE_RAD;
        let strength = if is_edge {
            EDGE_STRENGTH
        } else if (gap - FRAC_PI_2).abs() <= NEARLY_RIGHT_RAD {
            RIGHT_CORNER_STRENGTH
        } else if CORNER_RAD.contains(&gap) {
            CORNER_STRENGTH
        } else {
            return None;
        };
        Some(Corner { at, sides: [unit(from), unit(to)], is_edge, strength })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use echogrid_core::WorldParts;

    use super::*;

    fn line(x1: f64, y1: f64, x2: f64, y2: f64) -> Segment {
        Segment { from: [x1, y1], to: [x2, y2] }
    }

    fn corners(walls: &[Segment]) -> Vec<Corner> {
        let world = World::new(WorldParts { walls: walls.to_vec(), ..WorldParts::default() }).unwrap();
        Corners::of(&world, 5.0).squares.into_values().flatten().collect()
    }

    #[test]
    fn an_l_is_a_corner_inside_and_an_edge_outside() {
        let found = corners(&[line(0.0, 0.0, 2.0, 0.0), line(0.0, 0.0, 0.0, 2.0)]);
        let at_origin: Vec<&Corner> = found.iter().filter(|corner| corner.at == [0.0, 0.0]).collect();
        assert_eq!(at_origin.len(), 2, "{found:?}");
        let corner = at_origin.iter().find(|corner| !corner.is_edge).unwrap();
        assert_eq!(corner.strength, RIGHT_CORNER_STRENGTH);
        assert!(corner.faces([1.0, 1.0]) && !corner.faces([-1.0, 1.0]) && !corner.faces([-1.0, -1.0]));
        let edge = at_origin.iter().find(|corner| corner.is_edge).unwrap();
        assert!(!edge.faces([1.0, 1.0]) && edge.faces([-1.0, 1.0]) && edge.faces([-1.0, -1.0]));
        // The other two ends of the walls.
        assert_eq!(found.iter().filter(|corner| corner.is_edge).count(), 3);
    }

    #[test]
    fn a_wall_that_ends_on_another_makes_two_corners() {
        let found = corners(&[line(0.0, 0.0, 4.0, 0.0), line(2.0, 0.0, 2.0, 3.0)]);
        let at_foot = found.iter().filter(|corner| corner.at == [2.0, 0.0]);
        assert_eq!(at_foot.filter(|corner| !corner.is_edge).count(), 2, "{found:?}");
    }

    #[test]
    fn a_straight_wall_in_two_pieces_makes_none() {
        let found = corners(&[line(0.0, 0.0, 2.0, 0.0), line(2.0, 0.0, 4.0, 0.0)]);
        assert!(found.iter().all(|corner| corner.at != [2.0, 0.0]), "{found:?}");
    }

    #[test]
    fn an_obtuse_corner_answers_weakly_and_a_flat_one_not() {
        let strength = |x: f64, y: f64| {
            let found = corners(&[line(0.0, 0.0, 2.0, 0.0), line(0.0, 0.0, x, y)]);
            found.iter().find(|corner| corner.at == [0.0, 0.0] && !corner.is_edge).map(|corner| corner.strength)
        };
        assert_eq!(strength(-0.7, 2.0), Some(CORNER_STRENGTH));
        assert_eq!(strength(-2.0, 0.5), None);
    }

    #[test]
    fn those_near_are_found_from_anywhere() {
        let walls: Vec<Segment> = (0..30).map(|i| line(f64::from(i), 0.0, f64::from(i), 1.0)).collect();
        let world = World::new(WorldParts { walls: walls.clone(), ..WorldParts::default() }).unwrap();
        let mut found = Corners::of(&world, 5.0);
        for x in [0.3, 12.9, 13.1, 29.5] {
            let heard = found.near([x, 0.5]);
            for wall in &walls {
                let distance = libm::hypot(wall.from[0] - x, 0.5);
                let listed = heard.iter().any(|corner| corner.at == wall.from);
                assert!(listed || distance > 5.0, "({}, 0) from {x}", wall.from[0]);
                assert!(!listed || distance < 7.0, "({}, 0) from {x}", wall.from[0]);
            }
        }
    }
}
