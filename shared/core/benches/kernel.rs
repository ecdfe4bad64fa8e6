//! How many rings of 16 sonars are mapped per second (`items` of the table), with the paper's full model, with
//! `first_echo`, and with `first_echo` behind the filters that come by default.
//!
//! `synthetic_*`: a robot with the sonars of a Pioneer 3-AT on a drive through a hall, 85 % of the readings echoes, of
//! 2.78 m in the mean. `recorded_*`: the rings of `workload_s.bin` (little-endian f32: x, y, theta, 16 ranges, 5 m = no
//! echo), if there is `$ECHOGRID_DATA/workload_s.bin`, or the file beside the workspace.

#![allow(clippy::expect_used, clippy::print_stdout, reason = "a benchmark")]

mod drive;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use drive::{Ring, SONARS, pioneer, recorded, synthetic};
use echogrid_core::config::{Fusion, Limit, NoEcho, Noise};
use echogrid_core::{Estimate, GridMapper, MapperConfig, OdometryErrors, Reading};

fn main() {
    divan::main();
}

/// A robot that knows where it is.
fn certain() -> OdometryErrors {
    OdometryErrors::default()
}

/// A robot 10 m and half a turn after its last fix.
fn doubtful() -> OdometryErrors {
    OdometryErrors { eps_lin_m2: 4e-3, eps_ang_rad2: 3e-3, ..OdometryErrors::default() }
}

/// What is measured.
#[derive(Clone, Copy)]
struct Work {
    fusion: Fusion,
    errors: OdometryErrors,
    /// Whether all filters judge each ring.
    filtered: bool,
    /// What no echo says.
    no_echo: NoEcho,
}

fn paper(errors: OdometryErrors) -> Work {
    Work { fusion: Fusion::Paper, errors, filtered: false, no_echo: NoEcho::Ignore }
}

fn first_echo(filtered: bool) -> Work {
    Work { fusion: Fusion::FirstEcho, errors: certain(), filtered, no_echo: NoEcho::Ignore }
}

fn map(bencher: Bencher<'_, '_>, rings: Option<&[Ring]>, work: Work) {
    let Some(rings) = rings else {
        println!("no workload_s.bin");
        return;
    };
    let Work { fusion, errors, filtered, no_echo } = work;
    // The peers map up to the 5 m that the sonars see.
    let config =
        MapperConfig { fusion, no_echo, max_range_m: Limit::Metres(4.999), min_trust: 0.0, ..MapperConfig::default() };
    let mut mapper = GridMapper::new(&config, Noise::Sampled, 1, pioneer()).expect("valid");
    let mut sequence = 0;
    bencher.counter(ItemsCount::new(rings.len())).bench_local(|| {
        for ring in rings {
            let estimate = Estimate { errors, ..Estimate::certain(ring.pose) };
            sequence += 1;
            let scan: [(Reading, Option<Estimate>); SONARS] = ring.readings().map(|reading| (reading, Some(estimate)));
            if filtered {
                black_box(mapper.integrate_scan(sequence, &scan));
            } else {
                for (reading, estimate) in &scan {
                    black_box(mapper.integrate(sequence, reading, estimate.as_ref()));
                }
            }
        }
        mapper.take_changed()
    });
}

#[divan::bench(sample_count = 20)]
fn synthetic_certain(bencher: Bencher<'_, '_>) {
    map(bencher, Some(&synthetic()), paper(certain()));
}

#[divan::bench(sample_count = 20)]
fn synthetic_doubtful(bencher: Bencher<'_, '_>) {
    map(bencher, Some(&synthetic()), paper(doubtful()));
}

#[divan::bench(sample_count = 5)]
fn recorded_certain(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), paper(certain()));
}

/// All 1,209 cells of the mean cone: what no echo says counts too.
#[divan::bench(sample_count = 5)]
fn recorded_all_cells(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), Work { no_echo: NoEcho::Clear, ..paper(certain()) });
}

#[divan::bench(sample_count = 5)]
fn recorded_doubtful(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), paper(doubtful()));
}

#[divan::bench(sample_count = 5)]
fn recorded_first_echo(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), first_echo(false));
}

#[divan::bench(sample_count = 5)]
fn recorded_oriented(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), Work { fusion: Fusion::Oriented, ..first_echo(false) });
}

/// Of a robot that does not know where it is; what no echo says counts too.
#[divan::bench(sample_count = 5)]
fn recorded_oriented_all_cells_doubtful(bencher: Bencher<'_, '_>) {
    let work = Work { fusion: Fusion::Oriented, errors: doubtful(), no_echo: NoEcho::Auto, ..first_echo(false) };
    map(bencher, recorded().as_deref(), work);
}

#[divan::bench(sample_count = 5)]
fn recorded_first_echo_filtered(bencher: Bencher<'_, '_>) {
    map(bencher, recorded().as_deref(), first_echo(true));
}
