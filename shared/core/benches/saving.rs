//! What it costs to save a mapper every 300 rings of 16 sonars, as often as a fix comes, and to restore it: time against `mapping`, which is those 300 rings, and
//! bytes, which are printed first. On the rings of the `kernel` benchmark.
//!
//! `plain` is what comes by default; `everything` has the doubt, the sonars' maps, the kept readings and what a fix may change besides.

#![allow(clippy::expect_used, clippy::print_stdout, reason = "a benchmark")]

#[allow(dead_code, reason = "the other benchmarks take the rest")]
mod drive;

use std::cell::RefCell;

use divan::{Bencher, black_box};
use drive::{Ring, pioneer, recorded};
use echogrid_core::config::Noise;
use echogrid_core::{Fix, Gate, GridMapper, MapperConfig, Odometry, OdometryConfig, Parts, Saved};

const RINGS: usize = 300;

fn main() {
    for (name, config) in [("plain", plain()), ("everything", everything())] {
        let mut drive = Drive::new(&config);
        let mut saved = Saved::default();
        saved.apply(drive.save().into_changes());
        let (mut saves, mut bytes, mut parts) = (0, 0, 0);
        while drive.at + RINGS <= drive.rings.len() {
            drive.go_on();
            let changes = drive.save().into_changes();
            saves += 1;
            bytes += changes.values().flatten().map(Vec::len).sum::<usize>();
            parts += changes.len();
            saved.apply(changes);
        }
        let whole: usize = saved.under("").map(|(_, bytes)| bytes.len()).sum();
        println!("{name}: {saves} saves of {} bytes in {} parts; {whole} bytes in all", bytes / saves, parts / saves);
    }
    divan::main();
}

fn plain() -> MapperConfig {
    MapperConfig::default()
}

fn everything() -> MapperConfig {
    MapperConfig { remap: true, doubt: true, sonar_maps: true, keep_readings: true, ..plain() }
}

struct Drive {
    rings: Vec<Ring>,
    odometry: Odometry,
    mapper: GridMapper,
    at: usize,
}

impl Drive {
    fn new(config: &MapperConfig) -> Self {
        Self {
            rings: recorded().expect("the workload"),
            odometry: Odometry::new(&OdometryConfig::default()),
            mapper: GridMapper::new(config, Noise::Sampled, 1, pioneer()).expect("valid"),
            at: 0,
        }
    }

    /// To the next fix.
    fn go_on(&mut self) {
        let here = self.rings[self.at % self.rings.len()].pose;
        let before = self.odometry.step(here);
        let after = self.odometry.apply(&Fix::certain(here), Gate::open()).expect("a fix");
        self.mapper.rectify(self.at as u64 + 1, &before, &after);
        for _ in 0..RINGS {
            let ring = &self.rings[self.at % self.rings.len()];
            self.at += 1;
            let estimate = self.odometry.step(ring.pose);
            let scan = ring.readings().map(|reading| (reading, Some(estimate)));
            black_box(self.mapper.integrate_scan(self.at as u64, &scan));
        }
        self.mapper.take_changed();
        self.mapper.take_changed_of_sonars();
    }

    fn save(&mut self) -> Parts {
        let mut parts = Parts::default();
        self.mapper.save(&mut parts);
        parts
    }
}

#[divan::bench(sample_count = 40, args = ["plain", "everything"])]
fn mapping(bencher: Bencher<'_, '_>, kind: &str) {
    let mut drive = Drive::new(&config(kind));
    bencher.bench_local(|| drive.go_on());
}

#[divan::bench(sample_count = 40, sample_size = 1, args = ["plain", "everything"])]
fn saving(bencher: Bencher<'_, '_>, kind: &str) {
    let drive = RefCell::new(Drive::new(&config(kind)));
    bencher.with_inputs(|| drive.borrow_mut().go_on()).bench_local_values(|()| drive.borrow_mut().save());
}

#[divan::bench(sample_count = 10, args = ["plain", "everything"])]
fn restoring(bencher: Bencher<'_, '_>, kind: &str) {
    let config = config(kind);
    let mut drive = Drive::new(&config);
    (0..drive.rings.len() / RINGS).for_each(|_| drive.go_on());
    let mut saved = Saved::default();
    saved.apply(drive.save().into_changes());
    bencher.bench_local(|| GridMapper::restore(&config, Noise::Sampled, 1, pioneer(), &saved).expect("sound"));
}

fn config(kind: &str) -> MapperConfig {
    if kind == "plain" { plain() } else { everything() }
}
