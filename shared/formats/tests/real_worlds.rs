//! Worlds that others made, read where they lie: `$ECHOGRID_DATA`, or `../shared/data` beside the workspace.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::{Path, PathBuf};

use echogrid_core::{Pose2, World};
use echogrid_formats::world;

fn read(name: &str) -> Option<World> {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = root.join(name);
    if path.exists() {
        Some(world::read(&path).unwrap())
    } else {
        println!("skipped: {name} is not there");
        None
    }
}

fn check(name: &str, walls: usize, points: usize, home: Option<Pose2>) {
    let Some(world) = read(name) else { return };
    assert_eq!((world.parts().walls.len(), world.parts().points.len()), (walls, points), "{name}");
    assert_eq!(world.parts().places.home, home, "{name}");
}

#[test]
fn columbia_has_its_walls_points_and_places() {
    check("worlds/columbia.map", 470, 63_311, Some(Pose2::new(-0.182, 0.176, 0.0)));
    let Some(world) = read("worlds/columbia.map") else { return };
    let length: f64 = world.parts().walls.iter().map(|w| f64::hypot(w.to[0] - w.from[0], w.to[1] - w.from[1])).sum();
    assert!((length - 552.6).abs() < 0.1, "{length}");
    let places = &world.parts().places;
    // Eight lines and two areas of four sides.
    assert_eq!((places.goals.len(), places.forbidden.len()), (10, 12 + 8));
    // A robot that stands in the corridor where the recorded drive begins sees its walls.
    let across =
        [0.0, core::f64::consts::PI].map(|direction| world.cast([1.75, 18.0], direction, 5.0).unwrap().distance_m);
    assert!(across.iter().all(|distance| (0.3..2.0).contains(distance)), "{across:?}");
}

#[test]
fn the_small_ones() {
    let degrees = core::f64::consts::PI / 180.0;
    check("worlds/office.map", 101, 0, Some(Pose2::new(1.0, 1.498, 0.0)));
    check("worlds/triangle.map", 9, 0, Some(Pose2::new(5.09, 3.58, 54.0 * degrees)));
}

#[test]
fn a_map_of_ros_is_solid_where_it_is_occupied() {
    for name in ["map_server/depot.yaml", "map_server/meeting.yaml", "map_server/ac109_1.yaml"] {
        let Some(world) = read(name) else { return };
        assert!(world.parts().walls.is_empty() && world.lines().count() > 100, "{name}");
        println!("{name}: {} lines, {:?}", world.lines().count(), world.bounds_m());
    }
}

#[test]
fn our_own_office() {
    let world = world::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../worlds/office.toml")).unwrap();
    assert_eq!(world.bounds_m(), [[0.0, 0.0], [22.0, 12.0]]);
    assert_eq!(world.parts().walls.len(), 24);
    let home = world.parts().places.home.unwrap();
    assert!((world.cast([home.x, home.y], home.theta, 50.0).unwrap().distance_m - 21.0).abs() < 1e-12);
}
