//! `[replay]`, `[pioneer]`, `[lidar]`, `[simulator]`: where readings come from.

use super::{NOTHING, Section, Text, defaults, key, number, probe, refused, text, words};
use echogrid_lidar::LidarConfig;
use echogrid_pioneer::PioneerConfig;
use echogrid_replay::config::ReplayConfig;
use echogrid_simulator::SimulatorConfig;

pub(crate) static REPLAY: Section = Section {
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
            "laser_view_deg",
            "a whole number from 0 to 360",
            "over how many degrees the beams of a laser lie whose format does not say it (FLASER, tables); 0: as the format has it, 180",
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
        key(
            "use_settings",
            "true or false",
            "whether a recording of a run is mapped with the settings of that run, where nothing else is said",
        ),
    ],
    probe: probe::<ReplayConfig>,
    defaults: defaults::<ReplayConfig>,
    refuses: NOTHING,
};

pub(crate) static PIONEER: Section = Section {
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
    refuses: |table| refused(table, PioneerConfig::validate),
};

pub(crate) static LIDAR: Section = Section {
    name: "lidar",
    about: "the lidar that builtin:lidar reads",
    keys: &[
        words("model", &["ld19", "ld06", "rplidar_a1"], "one of ld19, ld06, rplidar_a1", "which protocol it speaks"),
        text(
            "port",
            Text::Plain,
            "a serial device, or tcp:HOST:PORT",
            "where it is: a serial device, or tcp:HOST:PORT",
        ),
        key("baud", "a whole number from 0 to 4000000", "bits per second of the serial line; 0: as the model has it"),
        number(
            "silence_s",
            "a number of seconds from 0.3 to 60",
            0.3..=60.0,
            "seconds without a beam after which its line is opened anew",
        ),
    ],
    probe: probe::<LidarConfig>,
    defaults: defaults::<LidarConfig>,
    refuses: |table| refused(table, LidarConfig::validate),
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
    refuses: |table| refused(table, SimulatorConfig::validate),
};
