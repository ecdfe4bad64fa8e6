//! The command line, as it is typed.

mod evaluate;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use echogrid_live::config::DEFAULT_PORT;
use echogrid_replay::config::LogUnit;
use echogrid_service::logging::{FORMAT_VARIABLE, is_told};
pub use evaluate::Evaluate;
use serde::Serialize;
use tracing::Level;

use crate::commands::align::Align;
use crate::config::{Interval, LoadRequest};

const DEMO_FIX_HELP: &str = "Who says where the robot really is, when the odometry asks: none, operator (`echogrid fix`), truth (the \
     simulator);\nor a file: surveyed landmarks (.toml), or a reference path with lines `t x y theta` [default: truth]";

/// Maps that show how far they can be trusted, from cheap range sensors and drifting odometry.
#[derive(Debug, Parser)]
#[command(name = "echogrid", version, max_term_width = 100)]
pub struct Cli {
    /// What to do; nothing: the demo.
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// A simulated Pioneer 3-AT maps an office floor, localizes itself whenever its map would degrade, and scores the map.
    #[command(mut_arg("fix", |fix| fix.help(DEMO_FIX_HELP)))]
    Demo {
        /// Another drive: other slips, bumps and echoes.
        #[arg(long)]
        seed: Option<u64>,
        /// What is set for the run.
        #[command(flatten)]
        settings: Settings,
        /// What is shown of it.
        #[command(flatten)]
        view: View,
    },
    /// A log in, a map out: replays a recorded drive through the whole graph.
    Map {
        /// ROS 1 bag or MCAP; CARMEN, Wean Hall or GMapping (.gfs) log or CSV with a header, plain or .gz, .bz2, .zst; or the
        /// measurement file of a Udacity sonar pair.
        log: PathBuf,
        /// Of a recording: this topic, in place of others of its type; may be repeated [default: those that are the only ones].
        #[arg(long = "topic", value_name = "NAME")]
        topics: Vec<String>,
        /// Settings of the run: a graph file, or as much of one as `echogrid calibrate --out` writes.
        #[arg(long, value_name = "FILE")]
        config: Option<PathBuf>,
        /// What is set for the run.
        #[command(flatten)]
        settings: Settings,
        /// What is shown of it.
        #[command(flatten)]
        view: View,
    },
    /// Tells what a file is and what is in it: log, recording, map, world, landmarks, robot, graph.
    Info {
        /// Any file that echogrid reads, or knows.
        file: PathBuf,
        /// Prints it as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Runs the graph of a graph file.
    Up {
        /// Graph file (TOML); see `echogrid check` for every key.
        graph: PathBuf,
        /// The sensor: `replay`, `simulator`, `pioneer`, or an executable of your own.
        #[arg(long, value_name = "NAME|FILE")]
        sensor: Option<String>,
        /// Of a recording that is played (`--set replay.log=FILE`): this topic, in place of others of its type; may be repeated.
        #[arg(long = "topic", value_name = "NAME")]
        topics: Vec<String>,
        /// What is set for the run.
        #[command(flatten)]
        settings: Settings,
        /// What is shown of it.
        #[command(flatten)]
        view: View,
    },
    /// Reads and validates a graph file and prints the effective configuration, every default included.
    Check {
        /// Graph file (TOML); none: the built-in graph.
        graph: Option<PathBuf>,
        /// The sensor: `replay`, `simulator`, `pioneer`, or an executable of your own.
        #[arg(long, value_name = "NAME|FILE")]
        sensor: Option<String>,
        /// Prints who reads what of whom, and in which order the services end, instead.
        #[arg(long = "graph")]
        map: bool,
        /// Prints the JSON Schema of graph files, or of robot files, instead: editors complete and check files by it.
        #[arg(long, value_name = "FILES", num_args = 0..=1, default_missing_value = "graph", conflicts_with_all = ["graph", "map"])]
        schema: Option<Files>,
        /// What is set for the run.
        #[command(flatten)]
        settings: Settings,
    },
    /// Tells whether this machine is fit to run a graph: memory, limits, permissions, leftovers; and what mends what is not.
    Doctor {
        /// Graph file (TOML); none: the demo's graph.
        graph: Option<PathBuf>,
        /// The sensor: `replay`, `simulator`, `pioneer`, or an executable of your own.
        #[arg(long, value_name = "NAME|FILE")]
        sensor: Option<String>,
        /// Removes what dead graphs of this user left in shared memory.
        #[arg(long)]
        clean: bool,
        /// Prints the findings as JSON.
        #[arg(long)]
        json: bool,
        /// What would be set for the run.
        #[command(flatten)]
        settings: Settings,
    },
    /// Saves the map of a running graph now.
    Save {
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
    },
    /// Pauses mapping in a running graph; the robot's way is followed on.
    Pause {
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
    },
    /// Goes on mapping in a running graph.
    Resume {
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
    },
    /// Pretends to be a robot, for whoever has none: a simulated one behind the door of a Pioneer.
    Emulate(Emulate),
    /// Tells a running graph where the robot is now: an absolute localization by hand.
    #[command(allow_negative_numbers = true)]
    Fix {
        /// Metres, map frame.
        x: f64,
        /// Metres, map frame.
        y: f64,
        /// Heading, radians counter-clockwise from x; or degrees, as in 90deg.
        #[arg(value_parser = angle, allow_hyphen_values = true)]
        theta: f64,
        /// How well the position is known: standard deviation along each axis, metres.
        #[arg(long, value_name = "METRES", default_value_t = 0.0, value_parser = deviation)]
        sigma: f64,
        /// How well the heading is known: standard deviation, radians, or degrees, as in 2deg.
        #[arg(long, value_name = "ANGLE", default_value = "0", value_parser = angle)]
        heading_sigma: f64,
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
    },
    /// Shows a running graph in a browser, on a page whose address is printed: the map as it grows, the robot, its readings, every
    /// process; saves, pauses, corrects, and asks why.
    Live {
        /// Where the page is served: address and port, or either; 0.0.0.0 for other machines, too.
        #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1", value_parser = listen)]
        listen: SocketAddr,
        /// A name of this machine by which browsers call it, besides its addresses and localhost; may be repeated.
        #[arg(long = "host", value_name = "NAME")]
        hosts: Vec<String>,
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
    },
    /// Records a running graph in an MCAP file from now on, until it ends or Ctrl-C; nobody waits for it, and what it missed is said.
    /// (`--record` of `up`, `map` and `demo` records from the beginning, and misses nothing.)
    Record {
        /// The recording; must not be there yet.
        file: PathBuf,
        /// Records echogrid's own messages alone, without Foxglove's beside them.
        #[arg(long)]
        native_only: bool,
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
    },
    /// Drives the robot of a running graph, a simulated one or a Pioneer; what it was about before is forgotten. A real robot
    /// stops soon when it is not told to go on.
    #[command(allow_negative_numbers = true)]
    Drive {
        /// Forward speed, m/s.
        v: f64,
        /// Turn rate, rad/s, counter-clockwise; or degrees per second, as in 20deg.
        #[arg(value_parser = angle, default_value = "0", allow_hyphen_values = true)]
        w: f64,
        /// Goes on for so many seconds, then stops the robot.
        #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
        seconds: Option<f64>,
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
    },
    /// Tells which graphs run, and how their services are doing.
    Status {
        /// Which graph; none: all that run.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// Prints it as JSON.
        #[arg(long)]
        json: bool,
        /// Looks once a second, until the graph ends; with --json each look is a line.
        #[arg(long, short)]
        watch: bool,
    },
    /// Prints what completes this command line in a shell: `echogrid completions bash > ~/.local/share/bash-completion/completions/echogrid`.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Prints the manual page, or writes those of all commands into a folder.
    Man {
        /// The folder; `man -l FOLDER/echogrid-map.1` shows a page.
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Converts between log formats, or from a map to other map formats.
    Convert {
        /// Log or map.
        input: PathBuf,
        /// The format is that of its ending: .log .log.gz .png .pgm .yaml .npy .echogrid
        output: PathBuf,
        /// The unit of a log's ranges: auto, m, cm or mm.
        #[arg(long, value_name = "UNIT", default_value = "auto", value_parser = range_unit)]
        range_unit: LogUnit,
    },
    /// Tells how good a map is, against the world that it shows.
    Score {
        /// Native map, map.echogrid.
        map: PathBuf,
        /// The world: office, room, a floor drawn by lot (floor-1, floor-2 ...), or a file: .toml, .map (MobileSim) or .yaml
        /// (map_server).
        #[arg(long, value_name = "NAME|FILE")]
        world: PathBuf,
        /// A log that knows where the robot really was (TRUEPOS, or see --truth) [default: the path in the map].
        #[arg(long, value_name = "LOG")]
        path: Option<PathBuf>,
        /// Who says it in a recording: tf (map to odom), or a topic of poses.
        #[arg(long, value_name = "tf|TOPIC", requires = "path")]
        truth: Option<String>,
        /// Of that recording: this topic, in place of others of its type; may be repeated.
        #[arg(long = "topic", value_name = "NAME", requires = "path")]
        topics: Vec<String>,
        /// Lays the map on the world: by the first pose of its path, on where the robot really was then; by all of its path, as
        /// well as it goes; or not at all [default: start; none where fixes or --start told where the map lies].
        #[arg(long, value_enum)]
        align: Option<Align>,
        /// Takes the points of a MobileSim world for walls, too.
        #[arg(long)]
        points: bool,
        /// Prints the figures as JSON.
        #[arg(long)]
        json: bool,
        /// Saves a picture of where the map is right (green), wrong (red, orange) and undecided (grey).
        #[arg(long, value_name = "FILE.png")]
        picture: Option<PathBuf>,
    },
    /// Finds the two walls of a map's longest corridor, and tells how much of what is occupied lies along them; needs no world.
    Walls {
        /// Native map, map.echogrid.
        map: PathBuf,
        /// Cells that are nearer to a wall belong to it, metres.
        #[arg(long, value_name = "METRES", default_value_t = echogrid_judge::walls::WITHIN_M, value_parser = reach)]
        within: f64,
        /// Prints the figures as JSON.
        #[arg(long)]
        json: bool,
        /// Saves a picture of the map with the walls drawn over it.
        #[arg(long, value_name = "FILE.png")]
        picture: Option<PathBuf>,
    },
    /// Lists the places that SLAM (`map --slam`) recognised, each with its evidence and what became of it.
    Closures {
        /// The folder of the map, or closures.json.
        #[arg(default_value = "maps")]
        map: PathBuf,
        /// Prints them as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Tells how far a path is off, by relations between its poses, as the public benchmark of SLAM has them (Kümmerle et al. 2009).
    Relations {
        /// Lines `t1 t2 x y z roll pitch yaw`.
        relations: PathBuf,
        /// The path: what `map --slam` writes, or lines `t x y theta`.
        #[arg(default_value = "maps/path.tum")]
        path: PathBuf,
        /// Prints the figures as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Tells why a cell is occupied, free or unknown: the readings that made it so (of a map with mapper.keep_readings).
    #[command(allow_negative_numbers = true)]
    Why {
        /// Metres, map frame.
        x: f64,
        /// Metres, map frame.
        y: f64,
        /// Native map; readings.echogrid lies beside it.
        #[arg(default_value = "maps/map.echogrid")]
        map: PathBuf,
        /// The map of this running graph, which is saved for it.
        #[arg(long, value_name = "NAME", conflicts_with = "map")]
        domain: Option<String>,
        /// The strongest so many readings [default: all].
        #[arg(long, value_name = "N")]
        limit: Option<usize>,
        /// Prints the answer as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Makes the odometry error model of a robot, of trials or of a drive, and tells how far it can be trusted.
    #[command(after_help = CALIBRATE_HELP)]
    Calibrate(Calibrate),
    /// Repeats an experiment: one simulated drive, mapped in several ways; pictures, scores and a table.
    Experiment {
        /// Which one.
        name: Experiment,
        /// Where its files are saved; docs/experiment.md tells what they are.
        #[arg(long, value_name = "DIR", default_value = "experiment")]
        out: PathBuf,
        /// The world: office, room, floor-1 ..., or a file [default: columbia.map of MobileSim where $ECHOGRID_DATA has it, else office].
        #[arg(long, value_name = "NAME|FILE")]
        world: Option<PathBuf>,
        /// Seed of all that the drive draws.
        #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
        seed: u64,
        /// Prints the figures as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Scores every way of mapping against known worlds, with a simulated robot and with logs that know the truth, on all
    /// processors; a table.
    Evaluate(Evaluate),
    /// Shows what goes through the topics of a running graph; it disturbs nobody.
    #[command(subcommand)]
    Topic(TopicCommand),
    /// Writes what one's own work can begin with.
    #[command(subcommand)]
    New(NewCommand),
    /// Cleans up after the dead of a domain (the launcher's helper).
    #[command(hide = true)]
    Janitor,
    /// Runs one service in a running graph, as the launcher starts it.
    Service {
        /// replay, simulator, pioneer, odometry, slam, localizer, mapper, publisher, recorder or live.
        name: String,
        /// The domain of the running graph.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// What only some services take.
        #[arg(last = true, hide = true)]
        arguments: Vec<std::ffi::OsString>,
    },
}

/// What can be begun.
#[derive(Debug, Subcommand)]
pub enum NewCommand {
    /// A working sensor, with its graph file and a test that makes a map with it.
    Sensor {
        /// A new or empty folder.
        folder: PathBuf,
        /// In which language; lines: any program that prints lines.
        #[arg(long, value_name = "LANGUAGE")]
        lang: SensorLanguage,
        /// Where echogrid's own sources lie: Rust and C need them, Python its module.
        #[arg(long, value_name = "DIR")]
        source: Option<PathBuf>,
    },
}

/// A language that a sensor can be begun in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum SensorLanguage {
    /// The trait of echogrid's own sensors.
    Rust,
    /// The module `echogrid`.
    Python,
    /// libechogrid_c.so.
    C,
    /// A script that prints lines, without any library.
    Lines,
}

/// A language that layouts are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum LayoutLanguage {
    /// A plain list.
    Text,
    /// A module of ctypes structures.
    Python,
    /// A header.
    C,
}

/// What is shown of the topics.
#[derive(Debug, Subcommand)]
pub enum TopicCommand {
    /// The layouts of all messages, for programs in other languages.
    Layout {
        /// In which language.
        #[arg(long, value_name = "LANGUAGE", default_value = "text")]
        lang: LayoutLanguage,
    },
    /// The topics, what each promises, who writes it and who reads it.
    List {
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// Prints them as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Prints messages as they come, those first that are kept for whoever comes late.
    Echo {
        /// The topic, as in map/info.
        name: String,
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// Ends after so many [default: with the graph].
        #[arg(long, value_name = "N")]
        count: Option<u64>,
        /// Prints each as JSON, all of it, in a line of its own.
        #[arg(long)]
        json: bool,
    },
    /// Prints how many messages come in a second.
    Hz {
        /// The topic, as in odometry/raw.
        name: String,
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// Ends after so many lines [default: with the graph].
        #[arg(long, value_name = "N")]
        count: Option<u64>,
        /// Seconds that a line is about.
        #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = window)]
        window: f64,
        /// Prints each line as JSON.
        #[arg(long)]
        json: bool,
    },
}

const CALIBRATE_HELP: &str = "\
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
pub struct Calibrate {
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
    #[arg(long, value_name = "FILE.png")]
    pub picture: Option<PathBuf>,
    /// Writes the model as the section `[odometry]`; see `echogrid map --config`.
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Replaces the file of --out if it is there.
    #[arg(long, requires = "out")]
    pub force: bool,
}

/// What is emulated, and how it is reached.
#[derive(Debug, Args)]
pub struct Emulate {
    /// What it pretends to be.
    #[arg(value_enum)]
    pub what: Emulated,
    /// The world that it drives through: office, room, a floor drawn by lot (floor-1 …), or a file.
    #[arg(long, value_name = "WORLD", default_value = "office")]
    pub world: String,
    /// The robot: pioneer3at, pioneer3dx or a robot file.
    #[arg(long, value_name = "NAME|FILE", default_value = "pioneer3at")]
    pub robot: String,
    /// The model that it says it is: p3at-sh, p3dx-sh, p3at or p3dx; others are not known.
    #[arg(long, value_name = "MODEL", default_value = "p3at-sh")]
    pub model: String,
    /// Listens here for one client, instead of behind a pseudo-terminal.
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "link")]
    pub listen: Option<std::net::SocketAddr>,
    /// A link that leads to the pseudo-terminal.
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,
    /// Another drive: other slips, bumps and echoes.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Sets any key of the simulation, as in `--set simulator.route=commands`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
}

/// What can be emulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Emulated {
    /// A Pioneer, over ARCOS.
    Pioneer,
}

/// The files that settings are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Files {
    /// Graph files.
    Graph,
    /// Robot files.
    Robot,
}

/// The experiments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Experiment {
    /// The paper's: odometry error ignored, carried into the map, rectified and corrected; side sonars and all.
    Paper,
}

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
    /// Corrects the poses by what a lidar sees again (SLAM); the map is made when the drive is over.
    #[arg(long, conflicts_with_all = ["fix", "fix_every"])]
    pub slam: bool,
    /// Who says where the robot really is, when the odometry asks: none, operator (`echogrid fix`), truth (a simulator, or
    /// a log that knows), tf (a recording's map to odom), topic:NAME (its poses); or a file: surveyed landmarks (.toml), or a
    /// reference path with lines `t x y theta` [default: none].
    #[arg(long, value_name = "SOURCE|FILE")]
    pub fix: Option<String>,
    /// Asks by schedule, as in 5m or 10s, instead of when the map would degrade.
    #[arg(long, value_name = "WAY|TIME")]
    pub fix_every: Option<Interval>,
    /// Where in the map the drive begins: metres, and radians or degrees, as in `--start 1.5 -2 90deg` [default: where the
    /// first fix says; without --fix where the odometry says].
    #[arg(long, num_args = 3, value_names = ["X", "Y", "THETA"], value_parser = angle, allow_hyphen_values = true)]
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

impl Command {
    /// What is shown of the run, if it is one.
    #[must_use]
    pub fn view(&self) -> Option<&View> {
        match self {
            Self::Demo { view, .. } | Self::Map { view, .. } | Self::Up { view, .. } => Some(view),
            _ => None,
        }
    }
}

impl Settings {
    /// As a request to the configuration.
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
            fix: self.fix,
            fix_every: self.fix_every,
            start: self.start.as_deref().and_then(|start| start.try_into().ok()),
            poses: self.poses,
            sets: self.sets,
            recording: self.record,
            ..LoadRequest::default()
        }
    }
}

/// An angle in radians, or in degrees where it says so.
fn angle(text: &str) -> Result<f64, String> {
    let (number, scale) = match text.strip_suffix("deg") {
        Some(degrees) => (degrees.trim(), core::f64::consts::PI / 180.0),
        None => (text.trim(), 1.0),
    };
    let angle = number.parse::<f64>().ok().map(|number| number * scale).filter(|angle| angle.abs() <= 1e6);
    angle.ok_or_else(|| "expected radians, or degrees as in 90deg".to_owned())
}

/// An address and a port, or either.
fn listen(text: &str) -> Result<SocketAddr, String> {
    let address = text.parse().or_else(|_| text.parse::<IpAddr>().map(|ip| SocketAddr::from((ip, DEFAULT_PORT))));
    address
        .or_else(|_| text.parse::<u16>().map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port))))
        .map_err(|_| "expected an address and a port, or either, as in 127.0.0.1:8750, 0.0.0.0 or 8750".to_owned())
}

/// The unit of a log's ranges.
fn range_unit(text: &str) -> Result<LogUnit, String> {
    match text {
        "auto" => Ok(LogUnit::Auto),
        "m" => Ok(LogUnit::M),
        "cm" => Ok(LogUnit::Cm),
        "mm" => Ok(LogUnit::Mm),
        _ => Err("expected auto, m, cm or mm".to_owned()),
    }
}

/// Metres, as far as a wall may reach.
fn reach(text: &str) -> Result<f64, String> {
    let metres = text.trim().parse::<f64>().ok().filter(|metres| (0.001..=10.0).contains(metres));
    metres.ok_or_else(|| "expected metres, from 0.001 to 10".to_owned())
}

fn window(text: &str) -> Result<f64, String> {
    let good = text.parse().ok().filter(|seconds: &f64| (0.1..=3600.0).contains(seconds));
    good.ok_or_else(|| "expected seconds, 0.1 to 3600".to_owned())
}

/// Seconds, above 0.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.trim().parse::<f64>().ok().filter(|seconds| *seconds > 0.0 && *seconds <= 86_400.0);
    seconds.ok_or_else(|| "expected seconds, above 0 and at most a day".to_owned())
}

/// Metres, 0 or more.
fn deviation(text: &str) -> Result<f64, String> {
    let metres = text.trim().parse::<f64>().ok().filter(|metres| metres.is_finite() && *metres >= 0.0);
    metres.ok_or_else(|| "expected metres, 0 or more".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_have_units() {
        assert_eq!(angle("1.5"), Ok(1.5));
        assert!((angle("-90deg").unwrap() + core::f64::consts::FRAC_PI_2).abs() < 1e-12);
        for wrong in ["", "deg", "nan", "inf", "1e9", "90°", "north"] {
            assert!(angle(wrong).is_err(), "{wrong}");
        }
        assert!(deviation("0.1").is_ok() && deviation("-0.1").is_err() && deviation("nan").is_err());
    }
}

/// What learning is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Goal {
    /// The fewest bits.
    Bits,
    /// The most walls found, with at most 5 % of the free cells called occupied.
    Walls,
}
