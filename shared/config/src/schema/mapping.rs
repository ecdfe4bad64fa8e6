//! `[mapper]`, `[publisher]`, `[recorder]`: what becomes of readings.

use super::{NOTHING, Section, Text, defaults, key, probe, refused, text, words};
use echogrid_core::config::MapperConfig;
use echogrid_publisher::config::PublisherConfig;
use echogrid_recorder::config::RecorderConfig;

pub(crate) static MAPPER: Section = Section {
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
        key("echo_prior", "a probability", "of first_echo: how probably a cell is occupied before any reading"),
        key("echo_detection", "a probability", "of first_echo: how probably an occupied cell on the axis answers"),
        key("echo_clutter", "a probability", "of first_echo: how probably an echo is nobody's (multipath, crosstalk)"),
        key("echo_lost", "a probability", "how probably an echo is lost, for no_echo = \"clear\""),
        key("oriented_prior", "a probability", "of oriented: how probably a cell is occupied before any reading"),
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
            "oriented_tempering",
            "a number from 0 to 10",
            "of oriented: gains are multiplied by (σ of the range without odometry error / with it) to this power",
        ),
        key(
            "oriented_looks",
            "a number, 0 or from 1 to 1000000",
            "of oriented: looks along which a wall answers with r leave 1 - (n r)^2 of it, however many they are, with this n; 0: they may take all",
        ),
        key(
            "oriented_place_m",
            "a number of metres, 0 or from 0.01 to 1000",
            "of oriented: metres, the side of a place: from the third visit on, what is heard there in the same direction says little that is new; 0: off",
        ),
        key(
            "oriented_wall_m",
            "a number of metres, 0 or from 0.01 to 1000",
            "of oriented: metres, how far walls go on in the mean: the map shows a wall the less the surer none is along it; 0: cells are shown as they are",
        ),
        key(
            "tempering",
            "a number from 0 to 10",
            "of first_echo: gains are multiplied by (σ of the range without odometry error / with it) to this power",
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
        key(
            "tiles_every_s",
            "a number of seconds from 0 to 3600",
            "seconds of real time after which tiles that changed are told at the earliest; 0: after each scan",
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
            "facing",
            "true or false",
            "whether it is told, and saved as facing.png, which way each wall faces, where the rule of fusion knows it (oriented)",
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
    refuses: |table| refused(table, MapperConfig::validate),
};

pub(crate) static PUBLISHER: Section = Section {
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
    refuses: |table| refused(table, PublisherConfig::validate),
};

pub(crate) static RECORDER: Section = Section {
    name: "recorder",
    about: "what builtin:recorder records, and where",
    keys: &[
        text("file", Text::Path, "a path", "the recording (MCAP); empty: recording.mcap in run.out"),
        key("foxglove", "true or false", "whether Foxglove's well-known messages are recorded beside echogrid's own"),
    ],
    probe: probe::<RecorderConfig>,
    defaults: defaults::<RecorderConfig>,
    refuses: NOTHING,
};
