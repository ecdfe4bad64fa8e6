//! The tables of a graph file.

use std::collections::BTreeMap;

use echogrid_core::config::{MapperConfig, OdometryConfig};
use echogrid_core::localization::LocalizationConfig;
use echogrid_localizer::config::LocalizerConfig;
use echogrid_pioneer::PioneerConfig;
use echogrid_publisher::config::PublisherConfig;
use echogrid_recorder::config::RecorderConfig;
use echogrid_replay::config::ReplayConfig;
use echogrid_simulator::SimulatorConfig;
use echogrid_slam::SlamConfig;
use echogrid_topics::DeclaredTopic;
use serde::{Deserialize, Serialize};

use super::super::robot::FILE_ENDING;
use super::super::run::RunConfig;
use super::super::service::{Care, ServiceKind, Speech};
use super::super::supervision::SupervisionConfig;
use super::super::wiring::Wiring;
use super::{Section, Text, defaults, key, number, probe, text, words};

/// All tables of a graph file but `[services]`.
pub(crate) static GRAPH: &[&Section] = &[
    &RUN,
    &REPLAY,
    &SIMULATOR,
    &PIONEER,
    &ODOMETRY,
    &SLAM,
    &LOCALIZATION,
    &LOCALIZER,
    &MAPPER,
    &PUBLISHER,
    &RECORDER,
    &SUPERVISION,
];

static RUN: Section = Section {
    name: "run",
    about: "how fast, where to, and on which robot",
    keys: &[
        words(
            "rate",
            &["max"],
            "\"max\" or a number above 0 (times real time)",
            "times real time, or \"max\": as fast as the slowest process takes it",
        ),
        text("out", Text::Path, "a path", "the folder that maps are saved to"),
        text(
            "domain",
            Text::Plain,
            "\"auto\" or a name: 1 to 20 of a-z, 0-9 and -",
            "keeps two running graphs apart, or \"auto\": one that is free",
        ),
        text(
            "robot",
            Text::MaybePath(&[FILE_ENDING]),
            "\"auto\", the name of a built-in robot or a robot file",
            "a built-in robot, a robot file, or \"auto\": what the log says; pioneer3at if simulated",
        ),
        number(
            "alive_within_s",
            "a number of seconds, 1 to 3600",
            1.0..=3600.0,
            "seconds without a sign of life after which a service that does not work is killed",
        ),
        text(
            "spool",
            Text::Path,
            "a path",
            "a folder on disk: what is stored there outlives the whole graph, and --resume goes on with it; empty: none",
        ),
    ],
    probe: probe::<RunConfig>,
    defaults: defaults::<RunConfig>,
};

static REPLAY: Section = Section {
    name: "replay",
    about: "the log that builtin:replay plays",
    keys: &[
        text("log", Text::Path, "a path", "the log; empty: not named yet"),
        words(
            "range_unit",
            &["auto", "m", "cm", "mm"],
            "one of auto, m, cm, mm",
            "the unit of its ranges: m (metres), cm or mm; auto: told by how they change as the robot moves",
        ),
        key(
            "topics",
            "an array of topics, as in [\"/scan\", \"/odom\"]",
            "of a recording: topics that are used in place of others of their type; empty: those that are the only ones",
        ),
        text(
            "truth",
            Text::Plain,
            "a topic, or tf",
            "who says in a recording where the robot really was: tf (map to odom), or a topic of poses; empty: nobody. The localizer \
             alone is told, and score",
        ),
    ],
    probe: probe::<ReplayConfig>,
    defaults: defaults::<ReplayConfig>,
};

static PIONEER: Section = Section {
    name: "pioneer",
    about: "the robot that builtin:pioneer speaks with",
    keys: &[
        text(
            "port",
            Text::Plain,
            "a serial device, or tcp:HOST:PORT",
            "where the robot is: a serial device, or tcp:HOST:PORT",
        ),
        key("baud", "9600, 19200, 38400, 57600 or 115200", "bits per second with which the serial line begins"),
        key(
            "switch_baud",
            "0, 9600, 19200, 38400, 57600 or 115200",
            "bits per second with which it goes on; 0: as the robot's parameters say",
        ),
        text(
            "parameters",
            Text::Path,
            "a path",
            "ARIA's parameter file of the robot (.p); empty: what is known of its model",
        ),
        key("motors", "true or false", "whether its motors are turned on, so that it can be driven (echogrid drive)"),
        number(
            "dead_man_s",
            "a number of seconds from 0.1 to 10",
            0.1..=10.0,
            "seconds that a command to drive counts for",
        ),
        number(
            "sonar_cycle_s",
            "a number of seconds from 0 to 1",
            0.0..=1.0,
            "seconds from one firing of an array of sonars to the next; 0: as the robot says",
        ),
        number(
            "silence_s",
            "a number of seconds from 0.3 to 60",
            0.3..=60.0,
            "seconds without a word after which the robot is called again",
        ),
    ],
    probe: probe::<PioneerConfig>,
    defaults: defaults::<PioneerConfig>,
};

pub(crate) static SIMULATOR: Section = Section {
    name: "simulator",
    about: "the robot that builtin:simulator drives, and its world",
    keys: &[
        text(
            "world",
            Text::MaybePath(&[".toml", ".map", ".yaml", ".yml"]),
            "office, room, floor-1 ..., or a file *.toml, *.map or *.yaml",
            "office, room, a floor drawn by lot (floor-1, floor-2 ...), or a file: .toml, .map (MobileSim) or .yaml (map_server)",
        ),
        key(
            "start",
            "[], [x, y] or [x, y, heading_deg]",
            "where the drive starts: [x, y] or [x, y, heading_deg], metres and degrees; [] is the world's home",
        ),
        words(
            "route",
            &["tour", "commands"],
            "\"tour\", \"commands\" or a list of goals and [x, y] places",
            "tour: every goal of the world; commands: as it is told; or a list of goals and [x, y] places",
        ),
        key("duration_s", "a number of seconds", "seconds after which the drive ends; 0: when the route is done"),
        key("seed", "a whole number from 0 to 9223372036854775807", "seed of all that is drawn"),
        text("record", Text::Path, "a path", "the drive is written to this CARMEN log; empty: it is not"),
        key("speed_mps", "a number of m/s", "m/s, speed on a straight way"),
        key("turn_radps", "a number of rad/s", "rad/s, speed of a turn on the spot"),
        key("accel_mps2", "a number of m/s²", "m/s², how fast it gets faster"),
        key("decel_mps2", "a number of m/s²", "m/s², how fast it gets slower"),
        key("turn_accel_radps2", "a number of rad/s²", "rad/s², the same of turning"),
        key("margin_m", "a number of metres", "metres that a planned way keeps from walls beyond the robot's radius"),
        key("patience_s", "a number of seconds", "seconds after which a robot that is blocked gives up a place"),
        key("odometry_period_s", "a number of seconds", "seconds from one odometry pose to the next"),
        key("axle_m", "a number of metres", "metres between the wheels of both sides, as the odometry believes"),
        key("ticks_per_m", "a number of ticks per metre", "resolution of the encoders: ticks per metre"),
        key("left_scale", "a share, 0.01 for 1 %", "share by which odometry takes the left wheels' way for longer"),
        key("right_scale", "a share, 0.01 for 1 %", "the same of the right wheels"),
        key("axle_scale", "a share, 0.01 for 1 %", "share by which the axle is longer than odometry believes"),
        key("slip_m2_per_m", "a number (m²/m)", "m²/m, slip: variance of the way that each side measures"),
        key("scrub_rad2_per_rad", "a number (rad²/rad)", "rad²/rad, scrub: variance of the measured turn"),
        key("scrub_m2_per_rad", "a number (m²/rad)", "m²/rad, scrub: variance of the way measured in a turn"),
        key("bumps_per_m", "a number of bumps per metre", "bumps per metre in the mean"),
        key("bump_rad", "a number of radians", "radians that a bump turns the robot by, standard deviation"),
        key(
            "firing_order",
            "a list of lists of sonar numbers",
            "the sonars that fire together, in turn; []: one after the other",
        ),
        key("firing_period_s", "a number of seconds", "seconds from one firing to the next"),
        key("rays", "a whole number from 1 to 1001", "rays that stand for the cone of a sonar"),
        key(
            "critical_incidence_deg",
            "a number of degrees",
            "degrees from a wall's normal beyond which it mirrors sound away",
        ),
        key("bounces", "a whole number from 0 to 8", "mirrors that sound is followed over"),
        key("crosstalk", "true or false", "whether sonars hear each other"),
        key(
            "faults",
            "a list of { sonar = 5, kind = \"stuck\", \"short\" or \"silent\", range_m = 0.5, from_s = 0 }",
            "sonars that break: { sonar = 5, kind = \"stuck\", range_m = 0.5, from_s = 30 }; short: blocked there; silent",
        ),
        key("lidar_period_s", "a number of seconds", "seconds from one scan of a lidar to the next"),
        key("lidar_dropout_ratio", "a share from 0 to 1", "share of a lidar's beams that never come back"),
    ],
    probe: probe::<SimulatorConfig>,
    defaults: defaults::<SimulatorConfig>,
};

pub(crate) static ODOMETRY: Section = Section {
    name: "odometry",
    about: "where the odometry begins, and its error model (eqs 1 to 4)",
    keys: &[
        words(
            "start",
            &["auto", "odometry"],
            "\"auto\", \"odometry\" or [x, y, theta] in metres and radians",
            "where in the map it begins: [x, y, theta]; odometry: its frame is the map's; auto: as the first fix says, else odometry",
        ),
        words(
            "poses",
            &["drive", "exact"],
            "one of drive, exact",
            "exact: poses that do not drift (a SLAM's, motion capture): no error, whatever the keys below say",
        ),
        words(
            "systematic",
            &["carry", "correct", "off"],
            "one of carry, correct, off",
            "carry: as doubt into the sensor model; correct: taken out of every increment; off",
        ),
        key("lin_scale", "a number (metres of error per metre)", "a_l, metres of error per metre travelled"),
        key("lin_offset_m", "a number of metres", "sigma, metres, mean linear error that a rotation causes"),
        key("lin_offset_from_turn_rad", "a number of radians", "radians turned from which sigma counts"),
        key("ang_scale", "a number (radians of error per radian)", "a_theta, radians of error per radian turned"),
        key("ang_offset_rad", "a number of radians", "alpha, radians, mean angular error that a translation causes"),
        key("ang_offset_from_travel_m", "a number of metres", "metres travelled from which alpha counts"),
        key("k_ll", "a number (m²/m)", "m²/m, variance of the linear error per metre travelled"),
        key("k_lt", "a number (m²/rad)", "m²/rad, variance of the linear error per radian turned"),
        key("k_tt", "a number (rad²/rad)", "rad²/rad, variance of the angular error per radian turned"),
        key("k_tl", "a number (rad²/m)", "rad²/m, variance of the angular error per metre travelled"),
        words(
            "noise",
            &["sampled", "one_sigma"],
            "one of sampled, one_sigma",
            "sampled: drawn per reading; one_sigma: one standard deviation, no draw",
        ),
        key("seed", "a whole number from 0 to 9223372036854775807", "seed of the draws"),
    ],
    probe: probe::<OdometryConfig>,
    defaults: defaults::<OdometryConfig>,
};

static SLAM: Section = Section {
    name: "slam",
    about: "what builtin:slam does (--slam): poses corrected where a lidar sees the same again",
    keys: &[
        words(
            "odometry",
            &["use", "ignore"],
            "one of use, ignore",
            "use: the odometry says where the next scan lies, as exactly as [odometry] says; ignore: the lidar alone tells the way",
        ),
        key("node_every_m", "a number of metres", "metres of way from scan to scan that is laid on those before it"),
        key("node_every_rad", "a number of radians", "radians of turn, likewise"),
        key("closure_after_m", "a number of metres", "metres of way after which a place counts as visited again"),
        key(
            "closure_every_m",
            "a number of metres",
            "metres of way from search to search for places that were visited before",
        ),
        key(
            "closure_score_min",
            "a number from 0.3 to 1",
            "share of the points that must lie on walls where a place is recognised; three that agree need three quarters of it",
        ),
        key(
            "closure_margin",
            "a number from 0 to 0.5",
            "by how much the next best place must score less; else the place is not told apart, and not taken",
        ),
        key(
            "refine_rounds",
            "a whole number from 0 to 10",
            "rounds in which all scans of one place are laid on each other at the end",
        ),
    ],
    probe: probe::<SlamConfig>,
    defaults: defaults::<SlamConfig>,
};

static LOCALIZATION: Section = Section {
    name: "localization",
    about: "when an absolute localization is asked for, and what happens until it comes",
    keys: &[
        words(
            "ask",
            &["degraded", "schedule", "both", "never"],
            "one of degraded, schedule, both, never",
            "degraded: when readings can hardly decide a cell any more; schedule: every_m, every_s; both; never",
        ),
        key("every_m", "a number of metres", "metres by odometry from fix to fix; 0: not by way"),
        key("every_s", "a number of seconds", "seconds by the sensor's clock from fix to fix; 0: not by time"),
        key("retry_s", "a number of seconds", "seconds until it is asked again after an answer without a fix"),
        key(
            "gate_sigmas",
            "a number of standard deviations",
            "standard deviations from where the robot should be beyond which a fix is refused; 0: none is",
        ),
        key(
            "degraded_trust",
            "a number from 0 to 1",
            "degraded while a reading of 2 m is trusted less; 0.43: where one reading can't make a cell occupied",
        ),
        words(
            "hold",
            &["auto", "always", "never"],
            "one of auto, always, never",
            "whether mapping holds while degraded; auto: if somebody is asked then where the robot is",
        ),
        words(
            "wait",
            &["auto", "always", "never"],
            "one of auto, always, never",
            "whether odometry waits for the answer; auto: behind a log or a simulator, not behind a robot",
        ),
    ],
    probe: probe::<LocalizationConfig>,
    defaults: defaults::<LocalizationConfig>,
};

static LOCALIZER: Section = Section {
    name: "localizer",
    about: "who says where the robot is, and how well",
    keys: &[
        words(
            "source",
            &["none", "operator", "truth", "reference", "landmarks"],
            "one of none, operator, truth, reference, landmarks",
            "none; operator: `echogrid fix`; truth: the sensor, if it is a simulator or a log with true poses; reference and \
             landmarks: the files of these keys",
        ),
        key(
            "position_sigma_m",
            "a number of metres",
            "metres along each axis, standard deviation of the position that truth (drawn) or reference tell",
        ),
        key("heading_sigma_rad", "a number of radians", "radians, standard deviation of the heading that these tell"),
        key("seed", "a whole number from 0 to 9223372036854775807", "seed of all that is drawn"),
        text(
            "reference",
            Text::Path,
            "a path",
            "where the robot was: a file with lines `t x y theta`; empty: not named",
        ),
        key(
            "reference_gap_s",
            "a number of seconds",
            "seconds from pose to pose of the reference beyond which it is a gap",
        ),
        text("landmarks", Text::Path, "a path", "surveyed landmarks: a file with [[landmark]]; empty: not named"),
        text(
            "sightings",
            Text::Path,
            "a path",
            "what was measured of them: a file with lines `t landmark range bearing`; empty: measured from the true pose",
        ),
        key("sightings_within_s", "a number of seconds", "seconds before or after a request in which sightings count"),
        key("sight_m", "a number of metres", "metres to which landmarks are measured from the true pose"),
        words(
            "measure",
            &["both", "range", "bearing"],
            "one of both, range, bearing",
            "what is measured of a landmark: both; range: tells no heading; bearing",
        ),
        key("range_sigma_m", "a number of metres", "metres, standard deviation of a range to a landmark"),
        key("bearing_sigma_rad", "a number of radians", "radians, standard deviation of a bearing of a landmark"),
    ],
    probe: probe::<LocalizerConfig>,
    defaults: defaults::<LocalizerConfig>,
};

static MAPPER: Section = Section {
    name: "mapper",
    about: "the grid and the sensor model (eqs 13 to 23)",
    keys: &[
        key("resolution_m", "a number of metres", "metres, side of a cell"),
        words(
            "fusion",
            &["auto", "paper", "covariance", "first_echo", "oriented"],
            "one of auto, paper, covariance, first_echo, oriented",
            "auto: oriented for sonars, paper for lidars; paper: eqs 21 to 23, log-odds added; covariance: the same, with doubt by direction, from the pose's covariance; \
             first_echo: Bayes' rule over the cone given the map so far, likewise with doubt by direction; oriented: the same, \
             where smooth walls answer near their normal and mirror the sound away else",
        ),
        key("log_odds_max", "a number", "log-odds are kept within plus and minus this"),
        key("log_odds_prior", "a number", "l0, log-odds of a cell before any reading"),
        key("p_occupied", "a probability", "probability at the peak of region II without odometry error"),
        key("p_free", "a probability", "probability at the sensor in region I without odometry error"),
        words(
            "min_range_m",
            &["auto"],
            "a number of metres or \"auto\"",
            "metres, readings below are refused, or \"auto\": by the kind of sensor",
        ),
        words(
            "max_range_m",
            &["auto"],
            "a number of metres or \"auto\"",
            "metres, readings above are refused, or \"auto\": by the kind of sensor",
        ),
        key("min_trust", "a number from 0 to 1", "readings that are trusted less are refused"),
        words(
            "sonars",
            &["all", "corridor"],
            "\"all\", \"corridor\" or a list of sonar numbers",
            "sonars that are used: \"all\"; \"corridor\": those at right angles to its walls, and those nearest to the robot's \
             axis; or their numbers",
        ),
        key(
            "novelty_m",
            "a number of metres",
            "metres after which what a transducer says is all new; from one place it says as much as ten readings; 0: off",
        ),
        words(
            "no_echo",
            &["auto", "ignore", "clear"],
            "one of auto, ignore, clear",
            "what a reading without an echo says: ignore: nothing; clear: that its cone is rather empty (see echo_lost, oriented_lost); \
             auto: clear to oriented, which knows that walls mirror, and nothing to other rules",
        ),
        key(
            "echo_prior",
            "a probability",
            "of first_echo and oriented: how probably a cell is occupied before any reading",
        ),
        key("echo_detection", "a probability", "of first_echo: how probably an occupied cell on the axis answers"),
        key("echo_clutter", "a probability", "of first_echo: how probably an echo is nobody's (multipath, crosstalk)"),
        key("echo_lost", "a probability", "how probably an echo is lost, for no_echo = \"clear\""),
        key(
            "oriented_detection",
            "a probability from 0.001 to 0.999",
            "of oriented: how probably what is there and does not mirror answers",
        ),
        key(
            "oriented_diffuse",
            "a probability from 0.001 to 0.999",
            "of oriented: the share of what is occupied that is no smooth wall, and answers from everywhere",
        ),
        key(
            "oriented_incidence_deg",
            "degrees from 5 to 90",
            "of oriented: degrees from its normal to which a wall answers",
        ),
        key("oriented_clutter", "a probability from 0.001 to 0.999", "of oriented: how probably an echo is nobody's"),
        key("oriented_lost", "a probability from 0.001 to 0.999", "of oriented: how probably an echo is lost"),
        key(
            "oriented_clear_m",
            "metres from 0.1 to 1000",
            "of oriented: metres to which a reading without an echo clears",
        ),
        key(
            "oriented_doubt_floor",
            "a number from 0.01 to 1",
            "of oriented: what is left of oriented_detection, at least, where the pose is in doubt",
        ),
        key(
            "tempering",
            "a number from 0 to 10",
            "of first_echo and oriented: gains are multiplied by (σ of the range without odometry error / with it) to this power",
        ),
        words(
            "footprint_m",
            &["auto"],
            "a number of metres from 0 to 2, or \"auto\"",
            "metres around the robot within which nothing is, as it stands there; auto: what its footprint covers; 0: it clears nothing",
        ),
        key(
            "remap",
            "true or false",
            "whether a fix has the readings since the last one fused again, where the robot was in hindsight",
        ),
        key(
            "remap_readings_max",
            "a whole number from 4 to 10000000",
            "the most readings that are kept for that; what is older stays as it is",
        ),
        words(
            "filters",
            &["range", "selection", "stuck", "lone", "bubble"],
            "a list of range, selection, stuck, lone, bubble",
            "what readings pass, in this order. range: limits; selection: sonars; stuck: sonars that others contradict for long; \
             lone: no other sonar hears it; bubble: multiple reflections",
        ),
        key("filter_rings", "a whole number from 0 to 100", "rings that stuck and lone look back on"),
        key("bubble_rings", "a whole number from 0 to 100", "rings that bubble looks back on"),
        key("stuck_after_m", "a number of metres", "metres over which a stuck sonar repeats its value"),
        key("lone_tolerance_m", "a number of metres", "metres within which echoes support each other"),
        key("bubble_tolerance_m", "a number of metres", "metres by which a point may be inside of a bubble"),
        key("sonar_maps", "true or false", "whether a map of each sonar is kept besides, and saved as sonars.png"),
        key(
            "doubt",
            "true or false",
            "whether it is kept, and saved as doubt.png, how much odometry error the evidence of each cell carried",
        ),
        key(
            "keep_readings",
            "true or false",
            "whether readings are kept as they were fused, and saved as readings.echogrid: `echogrid why` asks them",
        ),
        key(
            "keep_readings_max",
            "a whole number from 1 to 10000000",
            "the most readings that are kept for that, 80 bytes each; the oldest are given up",
        ),
    ],
    probe: probe::<MapperConfig>,
    defaults: defaults::<MapperConfig>,
};

static PUBLISHER: Section = Section {
    name: "publisher",
    about: "the files that a map is saved to",
    keys: &[
        words(
            "formats",
            &["png", "pgm", "npy", "echogrid"],
            "a list of png, pgm, npy, echogrid",
            "png: for people; pgm: with YAML, for map_server; npy: for NumPy; echogrid: the native map",
        ),
        words(
            "pgm_mode",
            &["trinary", "scale", "raw"],
            "one of trinary, scale, raw",
            "what the grey levels of the PGM mean: trinary, scale or raw",
        ),
        key("occupied_thresh", "a probability", "a cell of map.pgm is occupied above this probability"),
        key(
            "free_thresh",
            "a probability",
            "a cell of map.pgm is free below this probability; between the two it is unknown",
        ),
        key("draw_path", "true or false", "whether the picture shows where the robot went"),
        key("draw_legend", "true or false", "whether heading, scale bar, axes and a legend go with the picture"),
        key(
            "save_every_s",
            "0, or seconds from 1 to 86400",
            "the map is saved each time that so much of the sensor's time has passed; 0: at the end, and when told to",
        ),
        key(
            "path_points_max",
            "a whole number from 16 to 10000000",
            "most points of the path; a longer way has them farther apart",
        ),
    ],
    probe: probe::<PublisherConfig>,
    defaults: defaults::<PublisherConfig>,
};

static RECORDER: Section = Section {
    name: "recorder",
    about: "what builtin:recorder records, and where",
    keys: &[
        text("file", Text::Path, "a path", "the recording (MCAP); empty: recording.mcap in run.out"),
        key("foxglove", "true or false", "whether Foxglove's well-known messages are recorded beside echogrid's own"),
    ],
    probe: probe::<RecorderConfig>,
    defaults: defaults::<RecorderConfig>,
};

static SUPERVISION: Section = Section {
    name: "supervision",
    about: "what happens when a service dies or hangs",
    keys: &[
        words(
            "strategy",
            &["one_for_one", "rest_for_one"],
            "one_for_one or rest_for_one",
            "one_for_one: only who died is started again; rest_for_one: those downstream, too",
        ),
        key("restarts_max", "a whole number", "restarts of one service within window_s, then it is given up"),
        key("window_s", "a number of seconds, 1 to 86400", "seconds after which a restart is forgotten"),
        key(
            "backoff_s",
            "a number of seconds, 0 to 3600",
            "seconds before a restart; each further one within window_s waits twice as long",
        ),
        key("backoff_max_s", "a number of seconds, 0 to 3600", "the longest of these waits, seconds"),
        key(
            "ready_within_s",
            "a number of seconds, 1 to 3600",
            "seconds from the start of a service to its readiness; one that takes longer hangs",
        ),
        key(
            "first_output_within_s",
            "a number of seconds, 1 to 86400",
            "seconds to the sensor's first message, and from there to the first of those who read it",
        ),
    ],
    probe: probe::<SupervisionConfig>,
    defaults: defaults::<SupervisionConfig>,
};

/// `[services.<name>]`.
pub(crate) static SERVICE: Section = Section {
    name: "services",
    about: "the processes: exactly one sensor, odometry and mapper, a localizer or none, one publisher or more",
    keys: &[
        words(
            "kind",
            &["sensor", "odometry", "localizer", "mapper", "publisher", "other"],
            "one of sensor, odometry, localizer, mapper, publisher, other",
            "its role: sensor, odometry, localizer, mapper or publisher; other: an executable that the keys below describe",
        ),
        text("exec", Text::MaybePath(&["/"]), "a path or builtin:NAME", "builtin:NAME, a path, or a program on PATH"),
        key("args", "a list of strings", "arguments that it gets besides"),
        key("env", "a table of strings", "environment variables that it gets besides"),
        words(
            "speaks",
            &["carmen"],
            "carmen",
            "carmen: an executable that knows no topics and prints the lines of a CARMEN log is a sensor (docs/lines.md)",
        ),
        key(
            "replays",
            "true or false",
            "whether it prints the same whenever it is started; else it measures what is now",
        ),
        key(
            "reads",
            "a list of topics",
            "what an executable reads, so that producers wait for it; unsaid: as its role does",
        ),
        key("looks_on", "a list of topics", "what it takes without anybody waiting for it"),
        key("writes", "a list of topics", "what it writes; unsaid: as its role does"),
        key(
            "source",
            "true or false",
            "whether streams begin with it: it is asked first to end; unsaid: true of a sensor",
        ),
        words(
            "restart",
            &["on_failure", "never"],
            "on_failure or never",
            "on_failure: it is started again when it dies; never: the graph ends with it",
        ),
        key("required", "true or false", "whether the graph ends when it is given up; else the others go on"),
        number("nice", "a whole number from -20 to 19", -20.0..=19.0, "its niceness; below 0 takes a privilege"),
        key("memory_max_mib", "a whole number of MiB", "the most address space that it may have; 0: no limit"),
        key("open_files_max", "a whole number", "the most files that it may have open; 0: as the launcher"),
    ],
    probe: probe::<AsWritten>,
    defaults: defaults::<AsWritten>,
};

/// `[topics.<name>]`.
pub(crate) static TOPIC: Section = Section {
    name: "topics",
    about: "topics of your own, which services read and write besides echogrid's",
    keys: &[
        text(
            "type",
            Text::Plain,
            "1 to 64 printable characters without a space, as in \"acme/Goal/1\"",
            "the name of the payload's type, version included: who opens the topic must name the same",
        ),
        number("bytes", "a whole number from 1 to 1048576", 1.0..=1_048_576.0, "the size of the payload, bytes"),
        words(
            "delivery",
            &["latest", "droppable"],
            "latest or droppable",
            "latest: the newest message counts, and a late joiner gets it; droppable: who does not keep up misses some",
        ),
    ],
    probe: probe::<DeclaredTopic>,
    defaults: defaults::<DeclaredTopic>,
};

/// A service before what it leaves out is filled in.
#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct AsWritten {
    kind: Option<ServiceKind>,
    exec: Option<String>,
    args: Vec<String>,
    env: BTreeMap<String, String>,
    speaks: Option<Speech>,
    replays: bool,
    #[serde(flatten)]
    wiring: Wiring,
    #[serde(flatten)]
    care: Care,
}
