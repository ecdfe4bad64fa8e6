//! The tables of a graph file.

use std::collections::BTreeMap;

use echogrid_topics::DeclaredTopic;
use serde::{Deserialize, Serialize};

use super::super::robot::FILE_ENDING;
use super::super::run::RunConfig;
use super::super::service::{Care, ServiceKind, Speech};
use super::super::{SupervisionConfig, Wiring};
use super::localizing::{LOCALIZATION, LOCALIZER, ODOMETRY, SLAM};
use super::mapping::{MAPPER, PUBLISHER, RECORDER};
use super::sensing::{LIDAR, PIONEER, REPLAY, SIMULATOR};
use super::{NOTHING, Section, Text, defaults, key, number, probe, refused, text, words};

/// All tables of a graph file but `[services]`.
pub(crate) static GRAPH: &[&Section] = &[
    &RUN,
    &REPLAY,
    &SIMULATOR,
    &PIONEER,
    &LIDAR,
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
        text(
            "continue",
            Text::Path,
            "a path",
            "the native map of an earlier drive, which this one is localized in and goes on with; empty: none",
        ),
    ],
    probe: probe::<RunConfig>,
    defaults: defaults::<RunConfig>,
    refuses: NOTHING,
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
    refuses: |table| refused(table, SupervisionConfig::validate),
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
            "what an executable reads, so that producers wait for it; unsaid: as its role does. Of a built-in sensor that drives: drive/command",
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
    refuses: NOTHING,
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
    refuses: NOTHING,
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
