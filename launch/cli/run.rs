//! What every run takes: its settings, and what is shown of it.

use std::net::SocketAddr;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;
use echogrid_service::logging::{FORMAT_VARIABLE, is_told};
use tracing::Level;

use super::values::{listen, pair, place};
use crate::config::{Interval, LoadRequest};

/// What can be set for a run.
#[derive(Debug, Args)]
pub struct Settings {
    /// Where the map is saved [default: maps].
    #[arg(long, value_name = "DIR")]
    pub out: Option<String>,
    /// Speed: `max`, or times real time [default: max].
    #[arg(long)]
    pub rate: Option<String>,
    /// Robot: pioneer3at, pioneer3dx, laser, a robot file, or `auto`: as the log says, pioneer3at if simulated [default: auto].
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<String>,
    /// Keeps this graph apart from others on the machine [default: one of its own].
    #[arg(long, value_name = "NAME")]
    pub domain: Option<String>,
    /// Stores on disk, in this folder, what the run can be resumed from when all of it died.
    #[arg(long, value_name = "DIR")]
    pub spool: Option<String>,
    /// Goes on with the run that is spooled (--spool).
    #[arg(long)]
    pub resume: bool,
    /// Corrects the poses by what a lidar sees, or sonars hear, again (SLAM); the map is made when the drive is over.
    #[arg(long, conflicts_with_all = ["fix", "fix_every"])]
    pub slam: bool,
    /// With --slam: this closure is none, as `echogrid closures` names it, nor are those next to it; may be repeated.
    #[arg(long, value_name = "A,B", value_parser = pair, requires = "slam")]
    pub forbid: Vec<[u32; 2]>,
    /// With --slam: this closure is right, as `echogrid closures` names it, whether others agree or not; may be repeated.
    #[arg(long, value_name = "A,B", value_parser = pair, requires = "slam")]
    pub require: Vec<[u32; 2]>,
    /// Who says where the robot really is, when the odometry asks: none, operator (`echogrid fix`), truth (a simulator, or
    /// a log that knows), tf (a recording's map to odom), topic:NAME (its poses); or a file: a map to find the robot in
    /// (.echogrid), surveyed landmarks (.toml), or a reference path with lines `t x y theta` [default: none].
    #[arg(long, value_name = "SOURCE|FILE")]
    pub fix: Option<String>,
    /// Goes on with the map of an earlier drive (.echogrid, or its folder): the robot is found in it, and what is new is added; --out
    /// names another folder for the map of both.
    #[arg(long = "continue", value_name = "MAP", conflicts_with_all = ["slam", "forbid", "require", "fix", "start"],
        value_parser = NonEmptyStringValueParser::new())]
    pub go_on_with: Option<String>,
    /// Asks by schedule, as in 5m or 10s, instead of when the map would degrade.
    #[arg(long, value_name = "WAY|TIME")]
    pub fix_every: Option<Interval>,
    /// Where in the map the drive begins: metres, and radians or degrees, as in `--start 1.5 -2 90deg` [default: where the
    /// first fix says; without --fix where the odometry says].
    #[arg(long, num_args = 3, value_names = ["X", "Y", "THETA"], value_parser = place, allow_hyphen_values = true)]
    pub start: Option<Vec<f64>>,
    /// Whose poses the odometry is: of a drive, which drifts; or exact ones, of a SLAM or motion capture: without error
    /// [default: drive].
    #[arg(long, value_name = "drive|exact")]
    pub poses: Option<String>,
    /// Records the run in an MCAP file, for maps to come and for Foxglove; the map of the recording is that of the run
    /// [default file: recording.mcap beside the maps].
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    pub record: Option<String>,
    /// Sets any key, as in `--set mapper.resolution_m=0.1`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
}

impl Settings {
    /// The settings as a request to the configuration.
    #[must_use]
    pub fn request(self) -> LoadRequest {
        LoadRequest {
            out: self.out,
            rate: self.rate,
            robot: self.robot,
            domain: self.domain,
            spool: self.spool,
            resume: self.resume,
            slam: self.slam,
            forbid: self.forbid,
            require: self.require,
            fix: self.fix,
            go_on_with: self.go_on_with,
            fix_every: self.fix_every,
            start: self.start.as_deref().and_then(|start| start.try_into().ok()),
            poses: self.poses,
            sets: self.sets,
            recording: self.record,
            ..LoadRequest::default()
        }
    }
}

/// What is shown of a run.
#[derive(Debug, Default, Args)]
pub struct View {
    /// Prints the summary as JSON.
    #[arg(long)]
    pub json: bool,
    /// Shows no progress.
    #[arg(long, short)]
    pub quiet: bool,
    /// Tells of every process that starts and ends.
    #[arg(long, short)]
    pub verbose: bool,
    /// What the services log: error, warn, info (the life of each), debug, or as in ECHOGRID_LOG [default: warn].
    #[arg(long, value_name = "FILTER")]
    pub log_level: Option<String>,
    /// Shows the run in a browser while it lasts, on a page whose address is printed; `--watch=0.0.0.0` shows it to other machines,
    /// too.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1", value_parser = listen)]
    pub watch: Option<SocketAddr>,
    /// How they log it; as JSON, the launcher's own lines and the progress are JSON, too.
    #[arg(long, value_name = "FORMAT", value_parser = ["text", "json"], default_value = "text")]
    pub log_format: String,
}

impl View {
    /// Whether all that is logged is JSON.
    #[must_use]
    pub fn logs_json(&self) -> bool {
        self.log_format == "json" || std::env::var(FORMAT_VARIABLE).as_deref() == Ok("json")
    }

    /// Whether the life of the processes is told, too.
    #[must_use]
    pub fn tells_lives(&self) -> bool {
        self.verbose || is_told(Level::INFO, self.log_level.as_deref())
    }
}
