//! How many rays are cast per second (`items` of the table): all round from places on a grid, up to 5 m.
//!
//! `columbia`: the world of that name, if there is `$ECHOGRID_DATA/worlds/columbia.map`, or the file beside the
//! workspace; only its lines. `generated`: a floor of rooms.

#![allow(clippy::print_stdout, clippy::expect_used, reason = "a benchmark")]

use std::path::PathBuf;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use echogrid_core::{Segment, World, WorldParts};

fn main() {
    divan::main();
}

/// 10 × 10 rooms of 4 m with a door in each wall.
fn generated() -> World {
    let mut walls = Vec::new();
    for line in 0..=10 {
        for room in 0..10 {
            let (across, from) = (4.0 * f64::from(line), 4.0 * f64::from(room));
            for [start, end] in [[from, from + 1.5], [from + 2.5, from + 4.0]] {
                walls.push(Segment { from: [start, across], to: [end, across] });
                walls.push(Segment { from: [across, start], to: [across, end] });
            }
        }
    }
    World::new(WorldParts { walls, ..WorldParts::default() }).expect("walls")
}

/// The lines of a MobileSim map: four whole numbers each, millimetres.
fn columbia() -> Option<World> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("ECHOGRID_DATA").map_or_else(beside, PathBuf::from);
    let text = std::fs::read_to_string(folder.join("worlds/columbia.map")).ok()?;
    let lines = text.lines().skip_while(|line| *line != "LINES").skip(1).take_while(|line| *line != "DATA");
    let wall = |line: &str| {
        let numbers: Vec<f64> = line.split_whitespace().map_while(|word| word.parse().ok()).collect();
        let [x1, y1, x2, y2] = numbers.try_into().ok()?;
        Some(Segment { from: [x1 / 1e3, y1 / 1e3], to: [x2 / 1e3, y2 / 1e3] })
    };
    World::new(WorldParts { walls: lines.filter_map(wall).collect(), ..WorldParts::default() }).ok()
}

fn cast(bencher: Bencher<'_, '_>, world: Option<World>) {
    let Some(world) = world else {
        println!("no columbia.map");
        return;
    };
    let [[x0, y0], [x1, y1]] = world.bounds_m();
    let places: Vec<[f64; 2]> = (0..400)
        .map(|k| {
            [x0 + (x1 - x0) * (f64::from(k % 20) + 0.47) / 20.0, y0 + (y1 - y0) * (f64::from(k / 20) + 0.47) / 20.0]
        })
        .collect();
    bencher.counter(ItemsCount::new(places.len() * 180)).bench_local(|| {
        let mut sum = 0.0;
        for place in &places {
            for degrees in 0..180 {
                let hit = world.cast(*place, f64::from(2 * degrees) * core::f64::consts::PI / 180.0, 5.0);
                sum += hit.map_or(5.0, |hit| hit.distance_m);
            }
        }
        black_box(sum)
    });
}

#[divan::bench(sample_count = 20)]
fn columbia_lines(bencher: Bencher<'_, '_>) {
    cast(bencher, columbia());
}

#[divan::bench(sample_count = 20)]
fn generated_floor(bencher: Bencher<'_, '_>) {
    cast(bencher, Some(generated()));
}
