//! The settings that a recording carries of its run: what decides the bytes of the map, so that the recording alone makes it again.

use std::path::Path;

use echogrid_formats::log::{RUN_SETTINGS, words_of_run};
use echogrid_localizer::config::Source as LocatedBy;
use toml::{Table, Value};

use super::assemble::Origins;
use super::problem::ConfigError;
use super::reading::{self, Findings, Setting, dotted};
use super::service::{BUILTIN_PREFIX, Builtin, ServiceKind};
use super::source::Source;
use super::standard::default_services;
use super::{Config, request};

/// A setting that a recording carries: its key with its tables, and the value.
pub type RunSetting = (String, Value);

impl Config {
    /// What a recording of this run carries: a graph file with the sections that decide the map and the files it is saved to. The
    /// robot is in the recording anyway.
    ///
    /// # Errors
    /// As [`Config::to_toml`].
    pub fn run_settings(&self) -> Result<String, ConfigError> {
        let all = self.as_when_played().to_table()?;
        let sections = ["odometry", "localization", "localizer", "mapper", "publisher"];
        let mut table: Table = all.into_iter().filter(|(name, _)| sections.contains(&name.as_str())).collect();
        if let Some(Value::Table(publisher)) = table.get_mut("publisher") {
            // It is of a map that grows.
            publisher.remove("save_every_s");
        }
        let earlier = &self.run.r#continue;
        if !earlier.as_os_str().is_empty() {
            let run = Table::from_iter([("continue".to_owned(), Value::try_from(earlier)?)]);
            table.insert("run".to_owned(), run.into());
        }
        if self.does_slam() {
            table.insert("slam".to_owned(), Value::try_from(&self.slam)?);
            let service = Table::from_iter([("exec".to_owned(), slam().into())]);
            table.insert("services".to_owned(), Table::from_iter([(ODOMETRY.to_owned(), service.into())]).into());
        }
        Ok(toml::to_string(&table)?)
    }

    /// With what `auto` comes to in this graph, where it would come to something else in one that plays the recording. An operator does
    /// not fix again, and a map that is held until then would stay empty.
    fn as_when_played(&self) -> Self {
        let mut localizer = self.localizer.clone();
        if localizer.source == LocatedBy::Operator {
            localizer.source = LocatedBy::None;
        }
        let services = default_services(self.has_localizer());
        let played = Self { services, localizer: localizer.clone(), ..self.clone() };
        let (mut localization, mut odometry) = (self.localization.clone(), self.odometry.clone());
        let (here, there) = (self.resolved_localization(), played.resolved_localization());
        if here.hold != there.hold && self.localizer.source != LocatedBy::Operator {
            localization.hold = here.hold;
        }
        if here.wait != there.wait {
            localization.wait = here.wait;
        }
        let (here, there) = (self.resolved_odometry(), played.resolved_odometry());
        if here.start != there.start {
            odometry.start = here.start;
        }
        Self { localization, odometry, localizer, ..self.clone() }
    }
}

/// The name of the service that is told of where poses are corrected by SLAM.
const ODOMETRY: &str = "odometry";

fn slam() -> String {
    format!("{BUILTIN_PREFIX}{}", Builtin::Slam.name())
}

/// The settings of the run, where a recording of one is played. Who says himself where the robot is located, says it all.
pub(crate) fn settings(said: &[Setting]) -> Findings {
    let last = |key: &str| said.iter().rev().find(|setting| setting.path == ["replay", key]).map(|found| &found.value);
    let is_unwanted = last("use_settings").and_then(Value::as_bool) == Some(false);
    let Some(log) = last("log").and_then(Value::as_str).filter(|_| !is_unwanted) else { return Findings::default() };
    let Some(mut found) = read(Path::new(log)) else { return Findings::default() };
    if said.iter().any(locates) {
        found.settings.retain(|setting| !locates(setting) && setting.path != ["odometry", "start"]);
    }
    let name = request::name_of(said, ServiceKind::Odometry);
    for setting in &mut found.settings {
        if let [services, service, ..] = setting.path.as_mut_slice()
            && services == "services"
        {
            name.clone_into(service);
        }
    }
    found
}

/// Whether a setting says by what the robot is located.
fn locates(setting: &Setting) -> bool {
    match setting.path.as_slice() {
        [section, ..] if section == "localizer" || section == "localization" || section == "slam" => true,
        [run, key] if run == "run" => key == "continue",
        [services, _, key] => services == "services" && key == "exec" && setting.value.as_str() == Some(&slam()),
        _ => false,
    }
}

/// None where the recording carries none, or can't be read: that is said by who reads its messages.
fn read(recording: &Path) -> Option<Findings> {
    let words = words_of_run(recording).ok().flatten()?;
    let text = words.get(RUN_SETTINGS)?;
    let name = format!("{} (the settings of its run)", recording.display());
    Some(reading::graph(text, &Source::file(&name, text, None)))
}

/// Those of the settings that are in force and no defaults.
pub(crate) fn in_force(recorded: &[Setting], origins: &Origins) -> Result<Vec<RunSetting>, ConfigError> {
    let defaults = Config::default().to_table()?;
    let default_of = |path: &[String]| {
        let mut value = None;
        let mut table = Some(&defaults);
        for part in path {
            value = table.and_then(|table| table.get(part));
            table = value.and_then(Value::as_table);
        }
        value
    };
    let keys = recorded.iter().filter(|setting| setting.value.as_table().is_none_or(|table| !table.is_empty()));
    Ok(keys
        .map(|setting| (dotted(&setting.path), setting))
        .filter(|(key, setting)| origins.get(key) == Some(&setting.origin))
        .filter(|(_, setting)| default_of(&setting.path) != Some(&setting.value))
        .map(|(key, setting)| (key, setting.value.clone()))
        .collect())
}

/// The settings that the recording at `path` carries of its run, but for those that are defaults; none where it carries none.
///
/// # Errors
/// The defaults can't be written, which is no fault of the recording.
pub fn settings_of_recording(path: &Path) -> Result<Option<Vec<RunSetting>>, ConfigError> {
    let Some(found) = read(path) else { return Ok(None) };
    in_force(&found.settings, &super::assemble::origins(&found.settings)).map(Some)
}

#[cfg(test)]
mod tests {
    use super::super::parse_graph;
    use super::*;

    #[test]
    fn what_is_carried_is_a_graph_that_makes_the_same_of_a_recording() {
        let check = |graph: &str, wanted: &[&str], unwanted: &[&str]| {
            let text = parse_graph(graph).unwrap().run_settings().unwrap();
            let carried = reading::graph(&text, &Source::file("carried", &text, None));
            assert_eq!(carried.problems, [], "{text}");
            wanted.iter().for_each(|line| assert!(text.lines().any(|other| other == *line), "{line} in {text}"));
            unwanted.iter().for_each(|line| assert!(!text.contains(line), "{line} in {text}"));
        };
        check(
            "[mapper]\nresolution_m = 0.2\n",
            &["resolution_m = 0.2", "hold = \"auto\""],
            &["save_every_s", "[services"],
        );
        let simulated = "[services.sensor]\nexec = \"builtin:simulator\"\n";
        check(simulated, &["start = \"odometry\""], &["[simulator]", "[run]"]);
        check("[services.odometry]\nexec = \"builtin:slam\"\n", &["[slam]", "exec = \"builtin:slam\""], &[]);
        // Nobody fixes by hand again.
        check("[localizer]\nsource = \"operator\"\n", &["source = \"none\"", "hold = \"auto\""], &[]);
    }
}
