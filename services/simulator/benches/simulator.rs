//! How many rings of a Pioneer 3-AT are simulated per second (`items` of the table): 16 sonars of 31 rays each, 25 rings per
//! simulated second, driving and people included. Times real time is that divided by 25.
//!
//! `columbia`: the world of that name, if there is `$ECHOGRID_DATA/worlds/columbia.map`, or the file beside the workspace.

#![allow(clippy::expect_used, clippy::print_stdout, reason = "a benchmark")]

use std::path::PathBuf;

use divan::Bencher;
use divan::counter::ItemsCount;
use echogrid_core::World;
use echogrid_service::Sensor as _;
use echogrid_simulator::{Simulator, SimulatorConfig, world_of};
use echogrid_topics::Message;

#[path = "../tests/it/support.rs"]
#[allow(dead_code, clippy::unwrap_used)]
mod support;

fn main() {
    divan::main();
}

const RINGS: usize = 500;

/// 25 rings per second: 8 slots of 5 ms.
fn config(world: &str) -> SimulatorConfig {
    SimulatorConfig { firing_period_s: 0.005, ..support::pioneer_config(world) }
}

fn rings(bencher: Bencher<'_, '_>, config: &SimulatorConfig, world: &World) {
    bencher
        .counter(ItemsCount::new(RINGS))
        .with_inputs(|| Simulator::new(config, world.clone(), support::pioneer()).expect("a drive"))
        .bench_local_values(|mut simulator| {
            let mut left = RINGS;
            while left > 0 {
                let (_, message) = simulator.next().expect("a message").expect("a long drive");
                left -= usize::from(matches!(message, Message::Scan(_)));
            }
            simulator
        });
}

#[divan::bench]
fn office(bencher: Bencher<'_, '_>) {
    rings(bencher, &config("office"), &support::named("office"));
}

#[divan::bench]
fn office_with_mirrors_unfollowed(bencher: Bencher<'_, '_>) {
    let config = SimulatorConfig { bounces: 0, crosstalk: false, ..config("office") };
    rings(bencher, &config, &support::named("office"));
}

#[divan::bench]
fn room_with_somebody_in_it(bencher: Bencher<'_, '_>) {
    rings(bencher, &config("room"), &support::named("room"));
}

#[divan::bench]
fn columbia(bencher: Bencher<'_, '_>) {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("ECHOGRID_DATA").map_or_else(beside, PathBuf::from);
    let path = folder.join("worlds/columbia.map");
    if !path.exists() {
        println!("skipped: no {}", path.display());
        return;
    }
    let config = config(path.to_str().expect("a plain path"));
    let world = world_of(&config).expect("the world");
    rings(bencher, &config, &world);
}
