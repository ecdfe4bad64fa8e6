//! The command line, as it is typed.

mod emulate;
mod new;
mod run;
mod topic;
mod values;

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Parser, Subcommand, ValueEnum};
use echogrid_instruments::Align;
use echogrid_instruments::calibrate::{CALIBRATE_HELP, Calibrate, png};
use echogrid_instruments::evaluate::Evaluate;
use echogrid_replay::config::LogUnit;
pub use emulate::{Emulate, Emulated};
pub use new::{NewCommand, SensorLanguage};
pub use run::{Settings, View};
pub use topic::{LayoutLanguage, TopicCommand};
use values::{angle, deviation, listen, place, range_unit, reach, seconds};

const DEMO_FIX_HELP: &str = "Who says where the robot really is, when the odometry asks: none, operator (`echogrid fix`), truth (the \
     simulator);\nor a file: a map to find the robot in (.echogrid), surveyed landmarks (.toml), or a reference path with lines\n`t x y theta` [default: truth]";

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
        /// The topic of a recording to read, in place of others of its type; may be repeated [default: those that are the only ones].
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
        /// The sensor: `replay`, `simulator`, `pioneer`, `lidar`, or an executable of your own.
        #[arg(long, value_name = "NAME|FILE")]
        sensor: Option<String>,
        /// The topic to play of a recording (`--set replay.log=FILE`), in place of others of its type; may be repeated.
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
        /// The sensor: `replay`, `simulator`, `pioneer`, `lidar`, or an executable of your own.
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
        /// The sensor: `replay`, `simulator`, `pioneer`, `lidar`, or an executable of your own.
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
        /// The layer of a native map to write, as .png or .npy: the doubt of each cell, or which way walls face.
        #[arg(long, value_name = "LAYER")]
        layer: Option<MapLayerName>,
    },
    /// Tells how good a map is, against the world that it shows.
    Score {
        /// Native map, map.echogrid, or its folder.
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
        /// The topic of that recording to read, in place of others of its type; may be repeated.
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
        #[arg(long, value_name = "FILE.png", value_parser = png)]
        picture: Option<PathBuf>,
    },
    /// Finds the two walls of a map's longest corridor, and tells how much of what is occupied lies along them; needs no world.
    Walls {
        /// Native map, map.echogrid, or its folder.
        map: PathBuf,
        /// Cells that are nearer to a wall belong to it, metres.
        #[arg(long, value_name = "METRES", default_value_t = echogrid_judge::walls::WITHIN_M, value_parser = reach)]
        within: f64,
        /// Prints the figures as JSON.
        #[arg(long)]
        json: bool,
        /// Saves a picture of the map with the walls drawn over it.
        #[arg(long, value_name = "FILE.png", value_parser = png)]
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
        /// Where on the robot the sensor sits whose poses the relations are of: metres, and radians or degrees [default: they are the robot's].
        #[arg(long, num_args = 3, value_names = ["X", "Y", "THETA"], value_parser = place, allow_hyphen_values = true)]
        mount: Option<Vec<f64>>,
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
        /// Native map, or its folder; readings.echogrid lies beside it.
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
    /// Makes the odometry error model of a robot, of trials or of a drive, or learns what its sonars are like, and tells how far that can
    /// be trusted.
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
        /// replay, simulator, pioneer, lidar, odometry, slam, localizer, mapper, publisher, recorder or live.
        name: String,
        /// The domain of the running graph.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// What only some services take.
        #[arg(last = true, hide = true)]
        arguments: Vec<std::ffi::OsString>,
    },
}

/// The layers that a map may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MapLayerName {
    /// How much odometry error is in the evidence of each cell.
    Doubt,
    /// Which way each wall faces.
    Facing,
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
