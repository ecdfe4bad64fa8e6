//! What the user typed.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use echogrid_formats::map::native;
use echogrid_localizer::config as localizer;
use serde::Deserialize as _;
use serde::de::IntoDeserializer as _;
use serde::de::value::{Error as ValueError, StrDeserializer};

use super::argument;
use super::interval::Interval;
use super::reading::{Findings, Setting};
use super::service::{BUILTIN_PREFIX, Builtin, ServiceKind};
use super::source::Source;

/// The native map in a folder of maps.
pub const MAP_FILE: &str = "map.echogrid";

/// What the user typed. What is left out comes from the graph file or is a default.
#[derive(Debug, Clone, Default)]
pub struct LoadRequest {
    /// The graph file; none: the default graph.
    pub graph: Option<PathBuf>,
    /// `--robot`: the name of a built-in robot, a robot file, or `auto`.
    pub robot: Option<String>,
    /// `--rate`: the speed, `max` or times real time.
    pub rate: Option<String>,
    /// `--out`: the folder that the map is saved in.
    pub out: Option<String>,
    /// `--domain`: the name that keeps the graph apart from others on the machine.
    pub domain: Option<String>,
    /// `--spool`: the folder of what the run can be resumed from.
    pub spool: Option<String>,
    /// `--resume`: goes on with what is spooled.
    pub resume: bool,
    /// `--sensor`: the name of a built-in sensor, or an executable.
    pub sensor: Option<String>,
    /// `--slam`: poses are corrected where a lidar sees, or sonars hear, the same again.
    pub slam: bool,
    /// Each `--forbid`: the nodes of a closure that is none.
    pub forbid: Vec<[u32; 2]>,
    /// Each `--require`: the nodes of one that is right.
    pub require: Vec<[u32; 2]>,
    /// `--fix`: who says where the robot is; or a file of landmarks (`.toml`), of a reference path, or a map (`.echogrid`).
    pub fix: Option<String>,
    /// `--continue`: the map of an earlier drive, or its folder.
    pub go_on_with: Option<String>,
    /// `--fix-every`: metres or seconds, with their unit.
    pub fix_every: Option<Interval>,
    /// `--start`: where in the map the odometry begins, metres and radians.
    pub start: Option<[f64; 3]>,
    /// `--poses`: `drive` or `exact`.
    pub poses: Option<String>,
    /// Where a simulated drive is written to, as a log.
    pub record: Option<String>,
    /// `--record`: where the run is recorded; empty: beside the maps.
    pub recording: Option<String>,
    /// The log to play.
    pub log: Option<String>,
    /// Each `--topic`: of a recording, what is used.
    pub topics: Vec<String>,
    /// Each `--set key=value`; these have the last word.
    pub sets: Vec<String>,
    /// What relative paths of the command line are relative to; none: the working directory.
    pub base: Option<PathBuf>,
}

impl LoadRequest {
    /// What the command line sets, in rising precedence.
    pub(crate) fn settings(&self, graph: &[Setting], base: &Path) -> Findings {
        let sensor_key = format!("services.{}.exec", name_of(graph, ServiceKind::Sensor));
        let sensor = self.sensor.as_ref().map(|sensor| match Builtin::from_name(sensor) {
            Some(builtin) => format!("{BUILTIN_PREFIX}{}", builtin.name()),
            None => sensor.clone(),
        });
        let recorded = self.fix.as_deref().and_then(recorded_truth);
        let fix_file = self.fix.as_deref().filter(|_| recorded.is_none()).and_then(|text| fix_file(text, base));
        let fix = self.fix.clone().filter(|_| fix_file.is_none() && recorded.is_none());
        let mut found = Findings::default();
        if let (Some(fix), Some((source, key, file))) = (&self.fix, fix_file) {
            // The word says who, the file from what: both were typed as one.
            let origin = Source::argument(&format!("--fix {fix}"), Some(base));
            found.add(argument::assign("localizer.source", source, &origin));
            found.add(argument::assign(key, &file, &origin));
        }
        if let (Some(fix), Some(truth)) = (&self.fix, recorded) {
            let origin = Source::argument(&format!("--fix {fix}"), Some(base));
            found.add(argument::assign("localizer.source", "truth", &origin));
            found.add(argument::assign("replay.truth", truth, &origin));
        }
        self.add_earlier(base, &mut found);
        self.add_topics(base, &mut found);
        self.add_recorder(graph, base, &mut found);
        for (flag, key, value) in [
            ("--robot", "run.robot", &self.robot),
            ("--rate", "run.rate", &self.rate),
            ("--out", "run.out", &self.out),
            ("--domain", "run.domain", &self.domain),
            ("--spool", "run.spool", &self.spool),
            ("--sensor", &sensor_key, &sensor),
            ("--fix", "localizer.source", &fix),
            ("--poses", "odometry.poses", &self.poses),
            ("RECORD", "simulator.record", &self.record),
            ("LOG", "replay.log", &self.log),
        ] {
            if let Some(value) = value {
                found.add(argument::assign(key, value, &Source::argument(&format!("{flag} {value}"), Some(base))));
            }
        }
        self.add_slam(graph, base, &mut found);
        if let Some(every) = &self.fix_every {
            let source = Source::argument(&format!("--fix-every {every}"), Some(base));
            found.add(argument::assign("localization.ask", "schedule", &source));
            found.add(argument::assign(every.key(), &every.amount().to_string(), &source));
        }
        if let Some([x, y, theta]) = self.start {
            let source = Source::argument(&format!("--start {x} {y} {theta}"), Some(base));
            found.add(argument::assign("odometry.start", &format!("[{x:?}, {y:?}, {theta:?}]"), &source));
        }
        for set in &self.sets {
            found.add(argument::set(set, &Source::argument(&format!("--set {set}"), Some(base))));
        }
        found
    }

    fn add_earlier(&self, base: &Path, found: &mut Findings) {
        if let Some(map) = &self.go_on_with {
            let origin = Source::argument(&format!("--continue {map}"), Some(base));
            let inside = Path::new(map).join(MAP_FILE).to_string_lossy().into_owned();
            let file = if base.join(map).is_dir() { &inside } else { map };
            found.add(argument::assign("run.continue", file, &origin));
        }
    }

    fn add_slam(&self, graph: &[Setting], base: &Path, found: &mut Findings) {
        if self.slam {
            let key = format!("services.{}.exec", name_of(graph, ServiceKind::Odometry));
            let slam = format!("{BUILTIN_PREFIX}{}", Builtin::Slam.name());
            found.add(argument::assign(&key, &slam, &Source::argument("--slam", Some(base))));
        }
        for (flag, key, pairs) in
            [("--forbid", "slam.forbid", &self.forbid), ("--require", "slam.require", &self.require)]
        {
            if !pairs.is_empty() {
                let typed: Vec<String> = pairs.iter().map(|[from, to]| format!("{flag} {from},{to}")).collect();
                found.add(argument::assign(
                    key,
                    &format!("{pairs:?}"),
                    &Source::argument(&typed.join(" "), Some(base)),
                ));
            }
        }
    }

    fn add_recorder(&self, graph: &[Setting], base: &Path, found: &mut Findings) {
        let Some(file) = &self.recording else { return };
        let origin = Source::argument(&format!("--record={file}"), Some(base));
        let recorder = format!("{BUILTIN_PREFIX}{}", Builtin::Recorder.name());
        let has_one = graph.iter().any(|setting| setting.value.as_str() == Some(&recorder));
        if !has_one {
            found.add(argument::assign("services.recorder.exec", &recorder, &origin));
            // Each tile that is told is written.
            found.add(argument::assign("mapper.tiles_every_s", "0.5", &origin));
        }
        if !file.is_empty() {
            found.add(argument::assign("recorder.file", file, &origin));
        }
    }

    fn add_topics(&self, base: &Path, found: &mut Findings) {
        if !self.topics.is_empty() {
            let quoted: Vec<String> = self.topics.iter().map(|topic| format!("{topic:?}")).collect();
            let origin = Source::argument(&format!("--topic {}", self.topics.join(" --topic ")), Some(base));
            found.add(argument::assign("replay.topics", &format!("[{}]", quoted.join(", ")), &origin));
        }
    }
}

/// Who of a recording says where the robot was, where `--fix` names that: `tf`, or `topic:/NAME`.
fn recorded_truth(text: &str) -> Option<&str> {
    if text == "tf" { Some(text) } else { text.strip_prefix("topic:").filter(|topic| !topic.is_empty()) }
}

/// The source that a file of `--fix` is for, its key, and the file; none when it is no file but a word. A map is known by what it
/// holds, whatever its name, and the folder of a map is it; whoever names another picture of it is told so by the reader of maps.
fn fix_file(text: &str, base: &Path) -> Option<(&'static str, &'static str, String)> {
    const MAP: (&str, &str) = ("map", "localizer.map");
    let word = text.into_deserializer();
    if text.is_empty() || localizer::Source::deserialize::<StrDeserializer<'_, ValueError>>(word).is_ok() {
        return None;
    }
    let file = base.join(text);
    let ends_in = |word| Path::new(text).extension().is_some_and(|ending| ending.eq_ignore_ascii_case(word));
    if file.is_dir() {
        let inside = Path::new(text).join(MAP_FILE).to_string_lossy().into_owned();
        return Some((MAP.0, MAP.1, inside));
    }
    let (source, key) = if ["echogrid", "png", "pgm", "yaml", "npy"].into_iter().any(ends_in) || is_native_file(&file) {
        MAP
    } else if ends_in("toml") {
        ("landmarks", "localizer.landmarks")
    } else if text.contains(['/', '.']) || file.is_file() {
        ("reference", "localizer.reference")
    } else {
        return None;
    };
    Some((source, key, text.to_owned()))
}

fn is_native_file(file: &Path) -> bool {
    let mut head = [0; native::MAGIC.len()];
    // To open a pipe waits for whoever writes to it.
    file.is_file() && File::open(file).and_then(|mut file| file.read_exact(&mut head)).is_ok() && head == native::MAGIC
}

/// The name of the service of a kind that there is one of.
pub(crate) fn name_of(graph: &[Setting], kind: ServiceKind) -> &str {
    let word = kind.word();
    let named = graph.iter().find_map(|setting| match setting.path.as_slice() {
        [services, name, key] if services == "services" && key == "kind" => {
            (setting.value.as_str() == Some(word)).then_some(name.as_str())
        }
        _ => None,
    });
    named.unwrap_or(word)
}
