//! A world that is known: walls to look at, and places to be. What a map is judged by, and what a simulated robot hears.
//!
//! A world has no time and no robot: it answers where a ray ends ([`World::cast`]) and whether one point sees another
//! ([`World::sees`]). The answer is that of testing every surface, found by testing the few on the way.

mod buckets;
mod fan;
mod person;
mod solid;
mod surface;

pub use buckets::columns_of_rows;
use buckets::{Buckets, Walk};
pub use fan::{Cone, Fan, Vicinity};
pub use person::Person;
pub use solid::Solid;
pub use surface::Segment;
use surface::Surface;

use crate::pose::Pose2;

/// Coordinates lie within ± this, metres: no building is longer.
pub const COORDINATE_MAX_M: f64 = 1e5;
/// A world has at most so many walls and points.
pub const SURFACES_MAX: usize = 1 << 22;

/// What a world is made of. Coordinates are metres in the map frame.
#[derive(Debug, Clone, Default)]
pub struct WorldParts {
    /// Walls, seen from both sides.
    pub walls: Vec<Segment>,
    /// Things too small for a wall; each is a disc of `point_radius_m`.
    pub points: Vec<[f64; 2]>,
    /// Radius of a point, metres.
    pub point_radius_m: f64,
    /// What is solid all through.
    pub solid: Option<Solid>,
    /// Places with a name.
    pub places: Places,
    /// The people who walk about in it. They are no surface: [`World::cast`] does not meet them.
    pub people: Vec<Person>,
}

/// Places of a world that have a meaning for a robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Places {
    /// The pose at which a robot starts.
    pub home: Option<Pose2>,
    /// The places to which a robot may be sent.
    pub goals: Vec<Goal>,
    /// Lines that it must not cross, though nothing is there to see.
    pub forbidden: Vec<Segment>,
}

/// A place to go to.
#[derive(Debug, Clone, PartialEq)]
pub struct Goal {
    /// The name of the place.
    pub name: String,
    /// The pose at the place.
    pub pose: Pose2,
    /// Whether the heading of `pose` is part of it.
    pub has_heading: bool,
}

/// Why parts make no world.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WorldError {
    /// There is nothing to see.
    #[error("there is no wall in it; expected at least one wall, point or occupied pixel")]
    Empty,
    /// A number that no place in a building has.
    #[error("{what} is {value}; expected {expected}")]
    Value {
        /// Which part, counted from 1.
        what: String,
        /// What was given.
        value: f64,
        /// What would have been right.
        expected: &'static str,
    },
    /// More surfaces than a world may have.
    #[error("{count} walls and points; expected at most {SURFACES_MAX}")]
    TooMany {
        /// How many there are, at least.
        count: usize,
    },
}

/// Where a ray ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// From the origin, metres.
    pub distance_m: f64,
    /// The angle between ray and surface normal, radians: 0 head-on, π/2 grazing. A point answers head-on to all sides.
    pub incidence_rad: f64,
}

/// Where a ray meets a surface, as one needs it to follow the ray on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Meeting {
    /// From the origin, metres.
    pub distance_m: f64,
    /// The normal, of length 1, on the side of the surface that the ray comes from. A point is round.
    pub normal: [f64; 2],
}

/// A known world.
#[derive(Debug, Clone)]
pub struct World {
    parts: WorldParts,
    /// Walls, outlines of what is solid, points.
    surfaces: Vec<Surface>,
    buckets: Buckets,
}

impl World {
    /// A world of these parts. (A wall of no length is kept as a point.)
    ///
    /// # Errors
    /// When there is nothing to see, too much of it, or a coordinate that no building has.
    pub fn new(parts: WorldParts) -> Result<Self, WorldError> {
        validate(&parts)?;
        let outlines = parts.solid.as_ref().map(|solid| solid.outline(SURFACES_MAX)).unwrap_or_default();
        let count = parts.walls.len() + parts.points.len() + outlines.len();
        if count > SURFACES_MAX {
            return Err(WorldError::TooMany { count });
        }
        let radius_m = parts.point_radius_m;
        let wall = |segment: &Segment| match segment {
            Segment { from, to } if from == to => Surface::Point { centre: *from, radius_m },
            segment => Surface::Wall(*segment),
        };
        let point = |centre: &[f64; 2]| Surface::Point { centre: *centre, radius_m };
        let surfaces: Vec<Surface> =
            parts.walls.iter().chain(&outlines).map(wall).chain(parts.points.iter().map(point)).collect();
        if surfaces.is_empty() {
            return Err(WorldError::Empty);
        }
        let buckets = Buckets::of(&surfaces);
        Ok(Self { parts, surfaces, buckets })
    }

    /// The world as it is in another frame.
    ///
    /// # Errors
    /// A coordinate would be one that no building has.
    pub fn moved(&self, map_from_world: Pose2) -> Result<Self, WorldError> {
        let at = |point: &[f64; 2]| map_from_world.transform(*point);
        let line = |Segment { from, to }: &Segment| Segment { from: at(from), to: at(to) };
        let WorldParts { walls, points, point_radius_m, solid, places, people } = &self.parts;
        let goal = |goal: &Goal| Goal { pose: map_from_world * goal.pose, ..goal.clone() };
        Self::new(WorldParts {
            walls: walls.iter().map(line).collect(),
            points: points.iter().map(at).collect(),
            point_radius_m: *point_radius_m,
            solid: solid.as_ref().map(|solid| solid.moved(map_from_world)),
            places: Places {
                home: places.home.map(|home| map_from_world * home),
                goals: places.goals.iter().map(goal).collect(),
                forbidden: places.forbidden.iter().map(line).collect(),
            },
            people: people
                .iter()
                .map(|who| Person { path: who.path.iter().map(at).collect(), ..who.clone() })
                .collect(),
        })
    }

    /// What it is made of.
    #[must_use]
    pub fn parts(&self) -> &WorldParts {
        &self.parts
    }

    /// Every surface that is a line: walls, and the outlines of what is solid.
    pub fn lines(&self) -> impl Iterator<Item = Segment> {
        self.surfaces.iter().filter_map(|surface| match surface {
            Surface::Wall(segment) => Some(*segment),
            Surface::Point { .. } => None,
        })
    }

    /// Every surface that is a point.
    pub fn points(&self) -> impl Iterator<Item = [f64; 2]> {
        self.surfaces.iter().filter_map(|surface| match surface {
            Surface::Wall(_) => None,
            Surface::Point { centre, .. } => Some(*centre),
        })
    }

    /// Lowest and highest x and y of all there is to see, metres.
    #[must_use]
    pub fn bounds_m(&self) -> [[f64; 2]; 2] {
        self.buckets.bounds_m()
    }

    /// Where a ray from `origin` first meets a surface, if it does within `max_m`. Nothing is met from an origin that is
    /// not finite.
    ///
    /// Neighbouring walls are tight: no ray leaks through the corner that they share.
    #[must_use]
    pub fn cast(&self, origin: [f64; 2], direction_rad: f64, max_m: f64) -> Option<RayHit> {
        let (sin, cos) = libm::sincos(direction_rad);
        self.cast_along(origin, [cos, sin], max_m)
    }

    /// Whether nothing stands on the straight line between two points.
    #[must_use]
    pub fn sees(&self, from: [f64; 2], to: [f64; 2]) -> bool {
        let along = [to[0] - from[0], to[1] - from[1]];
        let length = libm::hypot(along[0], along[1]);
        length == 0.0 || self.cast_along(from, [along[0] / length, along[1] / length], length).is_none()
    }

    /// Follows a ray as [`World::cast`] does, along a direction of length 1, with the normal of what is met instead of an angle.
    #[must_use]
    pub fn meet(&self, origin: [f64; 2], direction: [f64; 2], max_m: f64) -> Option<Meeting> {
        self.meeting(origin, direction, self.nearest(origin, direction, max_m)?)
    }

    fn meeting(&self, origin: [f64; 2], direction: [f64; 2], (distance_m, index): (f64, u32)) -> Option<Meeting> {
        let at = [origin[0] + distance_m * direction[0], origin[1] + distance_m * direction[1]];
        let normal = self.surfaces.get(index as usize)?.normal(at, direction);
        Some(Meeting { distance_m, normal })
    }

    /// How far the nearest surface is from a point, metres; `max_m` if none is nearer. 0 within what is solid.
    #[must_use]
    pub fn clearance_m(&self, point: [f64; 2], max_m: f64) -> f64 {
        if self.parts.solid.as_ref().is_some_and(|solid| solid.contains(point)) {
            return 0.0;
        }
        let near = self.buckets.around(point, max_m).flat_map(|bucket| self.buckets.surfaces(bucket));
        let surfaces = near.filter_map(|index| self.surfaces.get(*index as usize));
        surfaces.map(|surface| surface.off_point_m(point)).fold(max_m, f64::min)
    }

    /// Every line that comes as near to a point as `reach_m`.
    #[must_use]
    pub fn lines_near(&self, point: [f64; 2], reach_m: f64) -> Vec<Segment> {
        let surfaces =
            self.listed_near(point, reach_m).into_iter().filter_map(|index| self.surfaces.get(index as usize));
        surfaces
            .filter(|surface| surface.off_point_m(point) <= reach_m)
            .filter_map(|surface| match surface {
                Surface::Wall(segment) => Some(*segment),
                Surface::Point { .. } => None,
            })
            .collect()
    }

    /// Every surface that comes as near to a point as `reach_m`, and some more, in order.
    fn listed_near(&self, point: [f64; 2], reach_m: f64) -> Vec<u32> {
        let near = self.buckets.around(point, reach_m).flat_map(|bucket| self.buckets.surfaces(bucket));
        let mut near: Vec<u32> = near.copied().collect();
        near.sort_unstable();
        near.dedup();
        near
    }

    /// The world without its points, if it has walls, and how many were left out: the points of a MobileSim world are
    /// what a laser once measured of its walls, off by centimetres, with people and furniture among them.
    ///
    /// # Errors
    /// As [`World::new`].
    pub fn walls_only(self) -> Result<(Self, usize), WorldError> {
        if self.parts.points.is_empty() || (self.parts.walls.is_empty() && self.parts.solid.is_none()) {
            return Ok((self, 0));
        }
        let mut parts = self.parts;
        let left_out = core::mem::take(&mut parts.points).len();
        Ok((Self::new(parts)?, left_out))
    }

    fn cast_along(&self, origin: [f64; 2], direction: [f64; 2], max_m: f64) -> Option<RayHit> {
        self.hit(self.nearest(origin, direction, max_m)?, direction)
    }

    /// The nearest surface on a ray and how far it is.
    fn nearest(&self, origin: [f64; 2], direction: [f64; 2], max_m: f64) -> Option<(f64, u32)> {
        let mut walk = Walk::new(&self.buckets, origin, direction, max_m)?;
        let mut nearest: Option<(f64, u32)> = None;
        while let Some((bucket, leaves_at_m)) = walk.next() {
            for index in self.buckets.surfaces(bucket) {
                let Some(surface) = self.surfaces.get(*index as usize) else { continue };
                nearest = nearer(nearest, surface.distance_m(origin, direction), *index);
            }
            // What lies in later buckets is farther away.
            if nearest.is_some_and(|(distance, _)| distance <= leaves_at_m) {
                break;
            }
        }
        nearest.filter(|(distance, _)| *distance <= max_m)
    }

    fn hit(&self, (distance_m, index): (f64, u32), direction: [f64; 2]) -> Option<RayHit> {
        let incidence_rad = self.surfaces.get(index as usize)?.incidence_rad(direction);
        Some(RayHit { distance_m, incidence_rad })
    }
}

/// The nearer of two hits; of equals the surface that comes first.
fn nearer(nearest: Option<(f64, u32)>, distance_m: Option<f64>, index: u32) -> Option<(f64, u32)> {
    match (nearest, distance_m) {
        (Some(old), Some(distance)) if (distance, index) < old => Some((distance, index)),
        (None, Some(distance)) => Some((distance, index)),
        _ => nearest,
    }
}

fn validate(parts: &WorldParts) -> Result<(), WorldError> {
    const COORDINATE: &str = "metres within ± 100000";
    let coordinate = |value: f64, what: &dyn Fn() -> String| {
        if value.abs() <= COORDINATE_MAX_M {
            return Ok(());
        }
        Err(WorldError::Value { what: what(), value, expected: COORDINATE })
    };
    let segment = |segment: &Segment, what: &dyn Fn() -> String| {
        segment.from.into_iter().chain(segment.to).try_for_each(|value| coordinate(value, what))
    };
    for (index, wall) in parts.walls.iter().enumerate() {
        segment(wall, &|| format!("a coordinate of wall {}", index + 1))?;
    }
    for (index, point) in parts.points.iter().enumerate() {
        point.iter().try_for_each(|value| coordinate(*value, &|| format!("a coordinate of point {}", index + 1)))?;
    }
    for (index, line) in parts.places.forbidden.iter().enumerate() {
        segment(line, &|| format!("a coordinate of forbidden line {}", index + 1))?;
    }
    let goals = parts.places.goals.iter().map(|goal| (goal.pose, goal.name.as_str()));
    for (pose, name) in parts.places.home.iter().map(|home| (*home, "home")).chain(goals) {
        [pose.x, pose.y].into_iter().try_for_each(|value| coordinate(value, &|| format!("a coordinate of {name}")))?;
        if !pose.theta.is_finite() {
            let what = format!("the heading of {name}");
            return Err(WorldError::Value { what, value: pose.theta, expected: "a finite number" });
        }
    }
    if !(0.0..=1.0).contains(&parts.point_radius_m) {
        let what = "the radius of the points".to_owned();
        return Err(WorldError::Value { what, value: parts.point_radius_m, expected: "metres from 0 to 1" });
    }
    for (index, person) in parts.people.iter().enumerate() {
        person.validate(|what| format!("{what} of person {}", index + 1))?;
    }
    if let Some(solid) = &parts.solid {
        for corner in solid.corners() {
            corner.into_iter().try_for_each(|value| coordinate(value, &|| "a corner of the bitmap".to_owned()))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
