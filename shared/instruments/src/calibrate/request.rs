//! `echogrid calibrate`, as it is typed.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use echogrid_config::Interval;

/// What the help of `echogrid calibrate` says besides its arguments.
pub const CALIBRATE_HELP: &str = "\
A table of trials is CSV; its first row names the columns:
  phase                                  translation or rotation
  measured_dl_m, measured_dtheta_rad     what the odometry said of the trial: metres along the way, negative
                                         backwards; radians counter-clockwise, not wrapped
  true_dl_m, true_dtheta_rad             what it really was
  series                                 may be left out; --series picks one

A drive is cut into trials: pieces of 0.3 m to 2 m with less than 0.1 rad turned, and of 0.3 rad to 1 rad within 0.1 m.
docs/calibration.md tells how to drive them, and what the coefficients mean.";

/// What a calibration is made of.
#[derive(Debug, Default, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Calibrate {
    /// What is calibrated in place of the odometry.
    #[command(subcommand)]
    pub what: Option<CalibrateWhat>,
    /// Tables of trials (.csv), or logs with odometry that know where the robot was (TRUEPOS), or see --reference, --landmarks.
    #[arg(value_name = "TRIALS.csv|LOG", required_unless_present = "simulate", conflicts_with = "simulate")]
    pub inputs: Vec<PathBuf>,
    /// Where the robot was: a reference path with lines `t x y theta`.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["simulate", "landmarks"])]
    pub reference: Option<PathBuf>,
    /// Surveyed landmarks (.toml), of which --sightings tells where the robot was.
    #[arg(long, value_name = "FILE", requires = "sightings", conflicts_with = "simulate")]
    pub landmarks: Option<PathBuf>,
    /// What the robot measured of the landmarks: lines `t landmark range_m bearing_rad`.
    #[arg(long, value_name = "FILE", requires = "landmarks")]
    pub sightings: Option<PathBuf>,
    /// The trials of this series of a table only [default: all].
    #[arg(long, value_name = "NAME", conflicts_with = "simulate")]
    pub series: Option<String>,
    /// A simulated robot makes the trials, and what comes out is compared with the error model that it was given.
    #[arg(long)]
    pub simulate: bool,
    /// The robot that is simulated: pioneer3at, pioneer3dx, laser or a robot file [default: pioneer3at].
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<String>,
    /// So many simulated trials of each phase.
    #[arg(long, requires = "simulate", value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(8..=10_000))]
    pub trials: u32,
    /// Seed of what is simulated, and of the trials that are drawn for the intervals.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: u64,
    /// Sets any key, as in `--set localizer.range_sigma_m=0.05` or `--set simulator.left_scale=0.02`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Prints the figures as JSON.
    #[arg(long)]
    pub json: bool,
    /// Saves a picture of the errors, and of what the model makes of them.
    #[arg(long, value_name = "FILE.png", value_parser = png)]
    pub picture: Option<PathBuf>,
    /// Writes the model as the section `[odometry]`; see `echogrid map --config`.
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Replaces the file of --out if it is there.
    #[arg(long, requires = "out")]
    pub force: bool,
}

/// What besides the odometry can be calibrated.
#[derive(Debug, Subcommand)]
pub enum CalibrateWhat {
    /// Learns what the sonars are like from a drive of their own, without any truth: how well they are heard from which side, how often
    /// an echo is nobody's, how exact a range is.
    #[command(after_help = SENSOR_HELP)]
    Sensor(CalibrateSensor),
}

const SENSOR_HELP: &str = "\
Each echo is asked of the map before the map takes it; the parameters under which all echoes were most probable are those of the sonars.
A new map is begun every 30 m, so that a drift does not matter much; with --fix or --poses exact it matters less. A drive that looks at
the same walls from several sides tells most. docs/calibration.md says what the parameters mean.";

/// What a sensor model is learnt from.
#[derive(Debug, Clone, Args)]
pub struct CalibrateSensor {
    /// A log with odometry and sonars.
    #[arg(value_name = "LOG")]
    pub log: PathBuf,
    /// Robot: pioneer3at, pioneer3dx, a robot file, or `auto`: as the log says [default: auto].
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<String>,
    /// Who says where the robot really is: see `echogrid map --fix` [default: none].
    #[arg(long, value_name = "SOURCE|FILE")]
    pub fix: Option<String>,
    /// Asks by schedule, as in 5m or 10s.
    #[arg(long, value_name = "WAY|TIME", requires = "fix")]
    pub fix_every: Option<Interval>,
    /// Whose poses the odometry is: of a drive, which drifts; or exact ones [default: drive].
    #[arg(long, value_name = "drive|exact")]
    pub poses: Option<String>,
    /// Seed of the blocks that are drawn for the intervals.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: u64,
    /// Sets any key, as in `--set mapper.resolution_m=0.1`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Prints the figures as JSON.
    #[arg(long)]
    pub json: bool,
    /// Writes what was learnt as the section `[mapper]`; see `echogrid map --config`.
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Replaces the file of --out if it is there.
    #[arg(long, requires = "out")]
    pub force: bool,
}

/// The file of a picture, as it is typed.
///
/// # Errors
/// Its name does not end in `.png`.
pub fn png(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(ending) if ending.eq_ignore_ascii_case("png") => Ok(path),
        _ => Err("pictures are written as PNG: expected a name that ends in .png".into()),
    }
}
