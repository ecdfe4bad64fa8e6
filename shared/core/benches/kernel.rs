//! How many rings of 16 sonars and scans of 360 laser beams are mapped per second of processor time, by one thread.
//!
//! `cargo bench -p echogrid-core --bench kernel -- [WORK…]` prints a line per work: its name, and the scans per second of each of
//! `REPEATS` (5) runs. `workload_s.bin` (little-endian f32: x, y, theta, 16 ranges, 5 m = no echo) and `workload_l.bin` (likewise, 360
//! beams of a lidar, 20 m = no echo) lie in `$ECHOGRID_WORKLOAD`, in `$ECHOGRID_DATA/workload` or in the data beside the workspace;
//! without them it fails. `benches/compare` sets the rates beside those of other programs.

#![allow(clippy::expect_used, clippy::print_stdout, clippy::print_stderr, reason = "a benchmark")]

#[allow(dead_code, reason = "the other benchmarks take the rest")]
mod drive;

use std::process::ExitCode;

use drive::{lidar, pioneer, records};
use echogrid_core::config::{Filter, Fusion, Limit, NoEcho, Noise};
use echogrid_core::{Echo, Estimate, GridMapper, MapperConfig, OdometryErrors, Pose2, Reading};

const BEAMS: u16 = 360;

/// Something to measure.
struct Work {
    name: &'static str,
    fusion: Fusion,
    /// What no echo says.
    no_echo: NoEcho,
    is_laser: bool,
    /// Whether the tiles that a scan changed are looked at after it, as they are told.
    is_shown: bool,
}

const WORKS: [Work; 7] = [
    Work { name: "paper", fusion: Fusion::Paper, no_echo: NoEcho::Ignore, is_laser: false, is_shown: false },
    Work { name: "paper_all_cells", fusion: Fusion::Paper, no_echo: NoEcho::Clear, is_laser: false, is_shown: false },
    Work { name: "first_echo", fusion: Fusion::FirstEcho, no_echo: NoEcho::Ignore, is_laser: false, is_shown: false },
    Work { name: "oriented", fusion: Fusion::Oriented, no_echo: NoEcho::Ignore, is_laser: false, is_shown: false },
    Work { name: "oriented_shown", fusion: Fusion::Oriented, no_echo: NoEcho::Ignore, is_laser: false, is_shown: true },
    Work { name: "laser", fusion: Fusion::Paper, no_echo: NoEcho::Ignore, is_laser: true, is_shown: false },
    Work {
        name: "laser_covariance",
        fusion: Fusion::Covariance,
        no_echo: NoEcho::Ignore,
        is_laser: true,
        is_shown: false,
    },
];

type Scan = Vec<(Reading, Option<Estimate>)>;

/// What a workload holds of each scan, one after the other: a pose, and a range for each of so many beams, metres.
struct Records {
    numbers: Vec<f64>,
    beams: u16,
    /// What stands for no echo.
    none_m: f64,
}

impl Records {
    fn of(is_laser: bool) -> Result<Self, String> {
        let (file, beams, none_m) =
            if is_laser { ("workload_l.bin", BEAMS, 20.0) } else { ("workload_s.bin", 16, 5.0) };
        let most = std::env::var("SCANS").ok().and_then(|n| n.parse().ok()).unwrap_or(usize::MAX);
        let mut numbers = records(file)?;
        numbers.truncate(most.saturating_mul(3 + usize::from(beams)));
        Ok(Self { numbers, beams, none_m })
    }

    fn scans(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.numbers.chunks_exact(3 + usize::from(self.beams))
    }

    /// A scan, as an exact robot heard it.
    fn read(&self, record: &[f64], scan: &mut Scan) {
        let pose = Pose2::new(record[0], record[1], record[2]);
        let estimate = Some(Estimate { errors: OdometryErrors::default(), ..Estimate::certain(pose) });
        scan.clear();
        scan.extend((0..self.beams).zip(&record[3..]).map(|(transducer, range_m)| {
            let echo = if *range_m < self.none_m { Echo::Hit { range_m: *range_m } } else { Echo::NoEcho };
            (Reading { transducer, echo, offset_ns: 0 }, estimate)
        }));
    }
}

/// Processor time of this thread, seconds.
fn processor_s() -> Result<f64, String> {
    const FILE: &str = "/proc/thread-self/schedstat";
    let text = std::fs::read_to_string(FILE).map_err(|error| format!("{FILE}: {error}"))?;
    let ns: Option<f64> = text.split_whitespace().next().and_then(|ns| ns.parse().ok());
    ns.map(|ns| ns * 1e-9).ok_or_else(|| format!("{FILE} is {text:?}; expected numbers"))
}

/// Scans per second of one run.
fn rate(work: &Work, records: &Records) -> Result<f64, String> {
    let (robot, none_m) = if work.is_laser { (lidar(BEAMS, core::f64::consts::TAU), 20.0) } else { (pioneer(), 5.0) };
    let config = MapperConfig {
        fusion: work.fusion,
        no_echo: work.no_echo,
        filters: vec![Filter::Range],
        footprint_m: Limit::Metres(0.0),
        // The peers map up to what the sensor sees.
        max_range_m: Limit::Metres(none_m - 0.001),
        min_trust: 0.0,
        remap: false,
        ..MapperConfig::default()
    };
    let mut mapper = GridMapper::new(&config, Noise::Sampled, 1, robot).expect("valid");
    let begun = processor_s()?;
    let mut scan = Scan::new();
    for (sequence, record) in (1..).zip(records.scans()) {
        records.read(record, &mut scan);
        std::hint::black_box(mapper.integrate_scan(sequence, &scan));
        if work.is_shown {
            for index in mapper.take_changed() {
                std::hint::black_box(mapper.shown_tile(index));
            }
        }
    }
    Ok(records.scans().len() as f64 / (processor_s()? - begun))
}

fn run(names: &[String]) -> Result<(), String> {
    let repeats = std::env::var("REPEATS").ok().and_then(|n| n.parse().ok()).unwrap_or(5);
    if let Some(unknown) = names.iter().find(|name| WORKS.iter().all(|work| work.name != **name)) {
        return Err(format!("no work is called {unknown}; there are {:?}", WORKS.map(|work| work.name)));
    }
    for work in WORKS.iter().filter(|work| names.is_empty() || names.iter().any(|name| name == work.name)) {
        let records = Records::of(work.is_laser)?;
        print!("{}", work.name);
        for _ in 0..repeats {
            print!(" {:.0}", rate(work, &records)?);
        }
        println!();
    }
    Ok(())
}

fn main() -> ExitCode {
    let names: Vec<String> = std::env::args().skip(1).filter(|name| !name.starts_with("--")).collect();
    match run(&names) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
