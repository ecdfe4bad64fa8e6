use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use proptest::prelude::*;

use super::*;

fn wall(x1: f64, y1: f64, x2: f64, y2: f64) -> Segment {
    Segment { from: [x1, y1], to: [x2, y2] }
}

fn room() -> World {
    let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]];
    let walls = (0..4).map(|i| Segment { from: corners[i], to: corners[(i + 1) % 4] }).collect();
    World::new(WorldParts { walls, ..WorldParts::default() }).unwrap()
}

/// Every surface tested.
fn brute_force(world: &World, origin: [f64; 2], direction_rad: f64, max_m: f64) -> Option<RayHit> {
    let (sin, cos) = libm::sincos(direction_rad);
    let mut nearest = None;
    for (index, surface) in world.surfaces.iter().enumerate() {
        nearest = nearer(nearest, surface.distance_m(origin, [cos, sin]), index as u32);
    }
    world.hit(nearest.filter(|(distance, _)| *distance <= max_m)?, [cos, sin])
}

#[test]
fn known_rays() {
    let check = |direction: f64, max_m: f64, expected: Option<(f64, f64)>| {
        let hit = room().cast([1.0, 1.0], direction, max_m);
        assert_eq!(hit.is_some(), expected.is_some(), "{direction}: {hit:?}");
        if let (Some(hit), Some((distance, incidence))) = (hit, expected) {
            assert!((hit.distance_m - distance).abs() < 1e-12, "{direction}: {hit:?}");
            assert!((hit.incidence_rad - incidence).abs() < 1e-12, "{direction}: {hit:?}");
        }
    };
    check(0.0, 10.0, Some((3.0, 0.0)));
    check(PI, 10.0, Some((1.0, 0.0)));
    check(FRAC_PI_2, 10.0, Some((2.0, 0.0)));
    check(-FRAC_PI_4, 10.0, Some((f64::sqrt(2.0), FRAC_PI_4)));
    check(0.0, 2.999, None);
    check(0.0, f64::INFINITY, Some((3.0, 0.0)));
    check(0.0, f64::NAN, None);
    check(f64::NAN, 10.0, None);
}

#[test]
fn from_outside_and_past_it() {
    let world = room();
    assert!((world.cast([-50.0, 1.0], 0.0, 100.0).unwrap().distance_m - 50.0).abs() < 1e-12);
    assert_eq!(world.cast([-50.0, 5.0], 0.0, 100.0), None);
    assert_eq!(world.cast([-50.0, 1.0], PI, 100.0), None);
    assert_eq!(world.cast([f64::NAN, 1.0], PI, 100.0), None);
    assert!(world.sees([0.5, 0.5], [3.5, 2.5]) && !world.sees([0.5, 0.5], [4.5, 2.5]));
    assert_eq!(world.bounds_m(), [[0.0, 0.0], [4.0, 3.0]]);
}

#[test]
fn how_far_the_nearest_wall_is() {
    let world = room();
    let check = |point: [f64; 2], expected: f64| {
        assert!((world.clearance_m(point, 2.0) - expected).abs() < 1e-12, "{point:?}");
    };
    check([1.0, 0.5], 0.5);
    check([3.9, 1.0], 0.1);
    check([-1.0, -1.0], f64::sqrt(2.0));
    check([-30.0, 0.0], 2.0);
    check([0.0, 2.0], 0.0);
    assert_eq!(world.lines_near([0.001, 0.001], 0.01).len(), 2);
    assert_eq!(world.lines_near([2.0, 0.0], 0.01), [wall(0.0, 0.0, 4.0, 0.0)]);
    let solid = Solid::new(Pose2::IDENTITY, 1.0, 3, vec![true; 9]).unwrap();
    let block = World::new(WorldParts { solid: Some(solid), ..WorldParts::default() }).unwrap();
    assert_eq!(block.clearance_m([1.5, 1.5], 9.0), 0.0, "within what is solid");
}

#[test]
fn normals_face_the_ray() {
    let meeting = room().meet([1.0, 1.0], [0.6, -0.8], 9.0).unwrap();
    assert!((meeting.distance_m - 1.25).abs() < 1e-12 && meeting.normal == [0.0, 1.0], "{meeting:?}");
    let from_below = room().meet([1.0, -1.0], [0.0, 1.0], 9.0).unwrap();
    assert_eq!((from_below.distance_m, from_below.normal), (1.0, [0.0, -1.0]));
    let parts = WorldParts { points: vec![[2.0, 0.0]], point_radius_m: 0.5, ..WorldParts::default() };
    let round = World::new(parts).unwrap().meet([0.0, 0.3], [1.0, 0.0], 9.0).unwrap();
    assert!((round.normal[0] + 0.8).abs() < 1e-12 && (round.normal[1] - 0.6).abs() < 1e-12, "{round:?}");
}

#[test]
fn points_count_only_where_there_is_nothing_else() {
    let points = WorldParts { points: vec![[2.0, 0.0]], point_radius_m: 0.5, ..WorldParts::default() };
    assert_eq!(World::new(points.clone()).unwrap().walls_only().unwrap().0.points().count(), 1);
    let both = WorldParts { walls: vec![wall(0.0, 0.0, 1.0, 0.0)], ..points };
    let (walls, left_out) = World::new(both).unwrap().walls_only().unwrap();
    assert_eq!((walls.points().count(), walls.lines().count(), left_out), (0, 1, 1));
}

#[test]
fn a_point_is_a_disc_and_a_bitmap_has_an_outline() {
    let parts = WorldParts { points: vec![[2.0, 0.0]], point_radius_m: 0.01, ..WorldParts::default() };
    let hit = World::new(parts).unwrap().cast([0.0, 0.0], 0.0, 5.0).unwrap();
    assert!((hit.distance_m - 1.99).abs() < 1e-12 && hit.incidence_rad == 0.0);
    let solid = Solid::new(Pose2::new(1.0, -0.5, 0.0), 0.5, 2, vec![true; 4]).unwrap();
    let world = World::new(WorldParts { solid: Some(solid), ..WorldParts::default() }).unwrap();
    assert_eq!(world.lines().count(), 4, "one line a side, not one a pixel");
    assert!((world.cast([0.0, 0.0], 0.0, 5.0).unwrap().distance_m - 1.0).abs() < 1e-12);
}

#[test]
fn what_makes_no_world() {
    let check = |parts: WorldParts, expected: &str| {
        let error = World::new(parts).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    let walls =
        |x: f64| WorldParts { walls: vec![wall(0.0, 0.0, 1.0, 0.0), wall(x, 0.0, 1.0, 1.0)], ..WorldParts::default() };
    let at = |x: f64, theta: f64| Some(Pose2 { x, y: 0.0, theta });
    let home = |home| WorldParts { places: Places { home, ..Places::default() }, ..walls(0.0) };
    check(WorldParts::default(), "no wall");
    check(walls(f64::NAN), "a coordinate of wall 2 is NaN; expected metres within ± 100000");
    check(walls(1.1e5), "wall 2 is 110000");
    check(WorldParts { points: vec![[0.0, f64::INFINITY]], ..walls(0.0) }, "point 1 is inf");
    check(WorldParts { point_radius_m: -1.0, ..walls(0.0) }, "radius of the points is -1");
    check(home(at(1e9, 0.0)), "a coordinate of home is 1000000000");
    check(home(at(0.0, f64::NAN)), "the heading of home is NaN");
    let solid = Solid::new(Pose2::new(1e6, 0.0, 0.0), 0.5, 1, vec![true]);
    check(WorldParts { solid, ..walls(0.0) }, "a corner of the bitmap is 1000000");
    let nothing_solid = Solid::new(Pose2::IDENTITY, 0.5, 2, vec![false; 4]);
    check(WorldParts { solid: nothing_solid, ..WorldParts::default() }, "no wall");
}

fn any_world() -> impl Strategy<Value = World> {
    let coordinate = || prop_oneof![-20.0..20.0f64, (-20..20i32).prop_map(f64::from)];
    let walls = prop::collection::vec((coordinate(), coordinate(), coordinate(), coordinate()), 1..40);
    let points = prop::collection::vec((coordinate(), coordinate()), 0..20);
    (walls, points, -2e4..2e4f64).prop_map(|(walls, points, shift)| {
        let walls = walls.into_iter().map(|(a, b, c, d)| wall(a + shift, b, c + shift, d)).collect();
        let points = points.into_iter().map(|(x, y)| [x + shift, y]).collect();
        World::new(WorldParts { walls, points, point_radius_m: 0.01, ..WorldParts::default() }).unwrap()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn the_same_as_testing_every_surface(
        world in any_world(), x in -30.0..30.0f64, y in -30.0..30.0f64,
        direction in prop_oneof![-7.0..7.0f64, (-4..=4i32).prop_map(|k| f64::from(k) * FRAC_PI_4)],
        max_m in 0.0..80.0f64, round: bool,
    ) {
        let middle = world.bounds_m()[0][0].round();
        let origin = if round { [middle + x.round(), y.round()] } else { [middle + x, y] };
        prop_assert_eq!(world.cast(origin, direction, max_m), brute_force(&world, origin, direction, max_m));
    }

    #[test]
    fn no_ray_leaks_out_of_a_room(x in 0.01..3.99f64, y in 0.01..2.99f64, direction in 0.0..TAU, corner in 0..4usize) {
        let world = room();
        prop_assert!(world.cast([x, y], direction, 6.0).is_some());
        let [cx, cy] = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]][corner];
        prop_assert!(world.cast([x, y], libm::atan2(cy - y, cx - x), 6.0).is_some());
    }

    #[test]
    fn turned_worlds_give_turned_rays(turn in -3.0..3.0f64, direction in 0.0..TAU, x in 0.1..3.9f64, y in 0.1..2.9f64) {
        let pose = Pose2::new(3.0, -8.0, turn);
        let walls = room().lines().map(|s| Segment { from: pose.transform(s.from), to: pose.transform(s.to) }).collect();
        let turned = World::new(WorldParts { walls, ..WorldParts::default() }).unwrap();
        let (hit, expected) = (turned.cast(pose.transform([x, y]), direction + turn, 9.0).unwrap(), room().cast([x, y], direction, 9.0).unwrap());
        prop_assert!((hit.distance_m - expected.distance_m).abs() < 1e-9);
    }
}
