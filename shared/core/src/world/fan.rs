//! Many rays from one place in about one direction: what they may meet is looked up once.

use super::surface::{Seen, Surface, dot};
use super::{Meeting, World, nearer};

/// With more surfaces near than this, a ray finds its way through the buckets faster.
const CROWD: usize = 256;
/// A cone is looked through by so much more than it is wide, radians: half of it for rays at its rim.
const WIDER_RAD: f64 = 1e-3;
/// What is culled is farther off than this: more than rounding can move a ray's end, metres.
const ROUNDING_M: f64 = 1e-6;

/// The surfaces of a world that come near a place.
#[derive(Debug, Clone)]
pub struct Vicinity {
    centre: [f64; 2],
    reach_m: f64,
    /// None if they are a crowd.
    near: Option<Vec<(u32, Surface)>>,
}

/// A cone of directions about an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Cosine and sine of half of what is looked through.
    edge: [f64; 2],
    /// Cosine of the angle off the axis up to which a ray lies within.
    rim: f64,
}

impl Cone {
    /// A cone that reaches so far to both sides of its axis, radians.
    #[must_use]
    pub fn new(half_rad: f64) -> Self {
        let (sin, cos) = libm::sincos(half_rad + WIDER_RAD);
        // The two edges of a cone wider than this bound nothing.
        let narrow = (0.0..core::f64::consts::FRAC_PI_2 - 2.0 * WIDER_RAD).contains(&half_rad);
        let rim = if narrow { libm::cos(half_rad + 0.5 * WIDER_RAD) } else { f64::INFINITY };
        Self { edge: [cos, sin], rim }
    }
}

/// Rays from one place within a cone; they meet what [`World::meet`] meets, to the last bit, but sooner.
#[derive(Debug, Clone)]
pub struct Fan<'a> {
    world: &'a World,
    origin: [f64; 2],
    axis: [f64; 2],
    rim: f64,
    max_m: f64,
    /// The nearest first.
    near: Vec<Near>,
}

#[derive(Debug, Clone, Copy)]
struct Near {
    /// No ray meets it nearer.
    off_m: f64,
    index: u32,
    seen: Seen,
}

impl Vicinity {
    /// The vicinity of a place: what is within `reach_m` of it.
    #[must_use]
    pub fn of(world: &World, centre: [f64; 2], reach_m: f64) -> Self {
        let listed = world.listed_near(centre, reach_m + ROUNDING_M);
        let surfaces = listed.into_iter().filter_map(|index| Some((index, *world.surfaces.get(index as usize)?)));
        // Nothing is left out whose distance is not a number.
        let is_far = |surface: &Surface| surface.off_point_m(centre) > reach_m + ROUNDING_M;
        let near: Vec<(u32, Surface)> = surfaces.filter(|(_, surface)| !is_far(surface)).take(CROWD + 1).collect();
        Self { centre, reach_m, near: (near.len() <= CROWD).then_some(near) }
    }

    /// Whether rays of this length from there end within it.
    #[must_use]
    pub fn covers(&self, origin: [f64; 2], max_m: f64) -> bool {
        libm::hypot(origin[0] - self.centre[0], origin[1] - self.centre[1]) + max_m <= self.reach_m
    }
}

impl<'a> Fan<'a> {
    /// Rays of up to `max_m` from `origin`, about an axis of length 1. The vicinity is one of this world, as it is.
    #[must_use]
    pub fn new(
        world: &'a World,
        vicinity: &Vicinity,
        origin: [f64; 2],
        axis: [f64; 2],
        cone: &Cone,
        max_m: f64,
    ) -> Self {
        let mut fan = Self { world, origin, axis, rim: f64::INFINITY, max_m, near: Vec::new() };
        let Some(listed) = vicinity.near.as_ref().filter(|_| vicinity.covers(origin, max_m)) else { return fan };
        fan.rim = cone.rim;
        if cone.rim > 1.0 {
            return fan;
        }
        let [cos, sin] = cone.edge;
        let (left_from, right) = (
            // The left edge backwards: what is beyond it is on the right, as for the others.
            [-axis[0] * cos + axis[1] * sin, -axis[1] * cos - axis[0] * sin],
            [axis[0] * cos + axis[1] * sin, axis[1] * cos - axis[0] * sin],
        );
        // What is behind the origin is on the right of this.
        let across = [axis[1], -axis[0]];
        for (index, surface) in listed {
            let seen = surface.seen_from(origin);
            if [left_from, right, across].into_iter().any(|line| seen.is_right_of(line, ROUNDING_M)) {
                continue;
            }
            let off_m = seen.off_origin_m() - ROUNDING_M;
            if off_m <= max_m {
                // Few are left: put each in its place.
                let place = fan.near.iter().rposition(|near| near.off_m <= off_m).map_or(0, |before| before + 1);
                fan.near.insert(place, Near { off_m, index: *index, seen });
            }
        }
        fan
    }

    /// What [`World::meet`] says for a ray from the origin: sooner if it lies within the cone and is no longer than the
    /// others.
    #[must_use]
    pub fn meet(&self, direction: [f64; 2], max_m: f64) -> Option<Meeting> {
        if !(dot(direction, self.axis) >= self.rim && max_m <= self.max_m) {
            return self.world.meet(self.origin, direction, max_m);
        }
        let mut nearest: Option<(f64, u32)> = None;
        for near in &self.near {
            if near.off_m > nearest.map_or(max_m, |(distance_m, _)| distance_m) {
                break;
            }
            nearest = nearer(nearest, near.seen.distance_m(direction), near.index);
        }
        self.world.meeting(self.origin, direction, nearest.filter(|(distance_m, _)| *distance_m <= max_m)?)
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_4, PI};

    use proptest::prelude::*;

    use super::*;
    use crate::pose::Pose2;
    use crate::world::{Segment, Solid, WorldParts};

    fn place(reach_m: i32) -> impl Strategy<Value = [f64; 2]> {
        // Whole numbers: corners, rays along walls, origins on them, walls as far as each other.
        let coordinate = move || {
            let far = f64::from(reach_m);
            prop_oneof![-far..far, (-reach_m..reach_m).prop_map(f64::from)]
        };
        (coordinate(), coordinate()).prop_map(|(x, y)| [x, y])
    }

    fn any_world() -> impl Strategy<Value = World> {
        let walls = prop::collection::vec((place(12), place(12)), 0..40);
        let points = prop::collection::vec(place(12), 1..20);
        let solid = prop::option::of((place(12), -3.0..3.0f64, prop::collection::vec(any::<bool>(), 16)));
        (walls, points, prop_oneof![Just(0.0), Just(0.01), 0.0..1.0f64], solid).prop_map(
            |(walls, points, point_radius_m, solid)| {
                let walls = walls.into_iter().map(|(from, to)| Segment { from, to }).collect();
                let solid =
                    solid.map(|([x, y], turn, cells)| Solid::new(Pose2::new(x, y, turn), 0.5, 4, cells).unwrap());
                World::new(WorldParts { walls, points, point_radius_m, solid, ..WorldParts::default() }).unwrap()
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn what_each_ray_meets_alone(
            world in any_world(), origin in place(14), aside in place(1),
            axis_rad in prop_oneof![-7.0..7.0f64, (-4..=4i32).prop_map(|k| f64::from(k) * FRAC_PI_4)],
            half_rad in prop_oneof![0.0..1.6f64, Just(FRAC_PI_4), Just(PI / 12.0), Just(3.0)],
            max_m in 0.0..15.0f64, reach_m in 0.0..20.0f64,
            rays in prop::collection::vec((-1.0..=1.0f64, 0.0..=1.0f64), 0..20),
        ) {
            let vicinity = Vicinity::of(&world, [origin[0] + aside[0], origin[1] + aside[1]], reach_m);
            let (sin, cos) = libm::sincos(axis_rad);
            let fan = Fan::new(&world, &vicinity, origin, [cos, sin], &Cone::new(half_rad), max_m);
            let at_rims = [(-1.0, 1.0), (0.0, 1.0), (1.0, 1.0), (1.5, 1.0), (0.0, 1.1)];
            for (part, of_max) in rays.into_iter().chain(at_rims) {
                let (sin, cos) = libm::sincos(axis_rad + part * half_rad);
                let bits = |meeting: Option<Meeting>| {
                    meeting.map(|m| (m.distance_m.to_bits(), m.normal.map(f64::to_bits)))
                };
                let limit_m = of_max * max_m;
                prop_assert_eq!(
                    bits(fan.meet([cos, sin], limit_m)),
                    bits(world.meet(origin, [cos, sin], limit_m))
                );
            }
        }
    }

    fn fence(count: i32) -> World {
        let wall = |k: i32| {
            let x = 1.0 + f64::from(k) * 0.01;
            Segment { from: [x, -1.0], to: [x, 1.0] }
        };
        World::new(WorldParts { walls: (0..count).map(wall).collect(), ..WorldParts::default() }).unwrap()
    }

    #[test]
    fn only_what_is_in_the_cone_is_looked_at() {
        let mut walls: Vec<Segment> = fence(1).lines().collect();
        walls.push(Segment { from: [-1.0, -1.0], to: [-1.0, 1.0] });
        walls.push(Segment { from: [-4.0, 1.0], to: [0.9, 1.0] });
        walls.push(Segment { from: [5.0, -1.0], to: [5.0, 1.0] });
        let world = World::new(WorldParts { walls, ..WorldParts::default() }).unwrap();
        let vicinity = Vicinity::of(&world, [0.0, 0.0], 5.0);
        let fan = Fan::new(&world, &vicinity, [0.0, 0.0], [1.0, 0.0], &Cone::new(0.3), 4.0);
        assert_eq!(fan.near.iter().map(|near| near.index).collect::<Vec<_>>(), [0], "not behind, aside, beyond");
        assert_eq!(fan.meet([0.0, 1.0], 4.0).map(|meeting| meeting.distance_m), Some(1.0), "beyond its rim");
    }

    #[test]
    fn from_nowhere_and_in_a_crowd() {
        let few = fence(2);
        let vicinity = Vicinity::of(&few, [0.0, 0.0], 5.0);
        assert!(vicinity.covers([1.0, 0.0], 4.0) && !vicinity.covers([1.1, 0.0], 4.0));
        assert!(!vicinity.covers([f64::NAN, 0.0], 1.0) && !vicinity.covers([0.0, 0.0], f64::NAN));
        let nowhere = Fan::new(&few, &vicinity, [f64::NAN, 0.0], [1.0, 0.0], &Cone::new(0.2), 4.0);
        assert_eq!(nowhere.meet([1.0, 0.0], 4.0), None);
        let crowd = fence(CROWD as i32 + 1);
        let vicinity = Vicinity::of(&crowd, [0.0, 0.0], 9.0);
        assert!(vicinity.near.is_none());
        let fan = Fan::new(&crowd, &vicinity, [0.0, 0.0], [1.0, 0.0], &Cone::new(0.2), 4.0);
        assert_eq!(fan.meet([1.0, 0.0], 4.0), crowd.meet([0.0, 0.0], [1.0, 0.0], 4.0));
    }
}
