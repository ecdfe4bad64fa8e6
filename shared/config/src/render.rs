//! The whole effective configuration, for people: every key, what it is, where it came from.

use std::fmt::Write;

use echogrid_core::{Robot, SensorKind};
use toml::{Table, Value};

use super::reading::dotted;
use super::schema::{GRAPH, SERVICE, Section, TOPIC};
use super::{Loaded, Wiring};

/// Values up to this wide have their comments in one column.
const VALUE_WIDTH: usize = 32;

/// The effective configuration as a graph file: loaded again, it comes to the same.
#[must_use]
pub fn render(loaded: &Loaded) -> String {
    let mut out = String::from(
        "# The effective configuration: every key, its default or what was set.\n\
         # `<- PLACE` is where a value was set; a value without it is a default.\n",
    );
    for section in GRAPH {
        let table = loaded.table().get(section.name).and_then(Value::as_table);
        heading(&mut out, section.name, section.about);
        keys(&mut out, loaded, section, section.name, table);
        if section.name == "run" {
            robot(&mut out, loaded.robot());
            services(&mut out, loaded);
            topics(&mut out, loaded);
        }
    }
    out
}

fn services(out: &mut String, loaded: &Loaded) {
    let services = loaded.table().get(SERVICE.name).and_then(Value::as_table);
    let _ = write!(out, "\n# {}\n", SERVICE.about);
    // Upstream to downstream, as the data flows.
    let mut names: Vec<_> = loaded.config().services.iter().collect();
    names.sort_by_key(|(name, service)| (service.kind, name.as_str()));
    for (name, service) in names {
        let section = format!("{}.{name}", SERVICE.name);
        let _ = write!(out, "\n[{section}]\n");
        let mut table = services.and_then(|all| all.get(name)).and_then(Value::as_table).cloned().unwrap_or_default();
        if let Some(declared) = service.declared() {
            // It says itself what it reads and writes: no key for a graph file, unless a sensor writes a part of that.
            let is_part = service.wiring.writes != declared.writes;
            table.retain(|key, _| !Wiring::KEYS.contains(&key) || (is_part && key == "writes"));
        }
        keys(out, loaded, &SERVICE, &section, Some(&table));
    }
}

fn topics(out: &mut String, loaded: &Loaded) {
    let declared = loaded.table().get(TOPIC.name).and_then(Value::as_table).filter(|topics| !topics.is_empty());
    let Some(declared) = declared else { return };
    let _ = write!(out, "\n# {}\n", TOPIC.about);
    for (name, topic) in declared {
        let section = dotted(&[TOPIC.name, name]);
        let _ = write!(out, "\n[{section}]\n");
        keys(out, loaded, &TOPIC, &section, topic.as_table());
    }
}

fn heading(out: &mut String, name: &str, about: &str) {
    let _ = write!(out, "\n[{name}] # {about}\n");
}

fn keys(out: &mut String, loaded: &Loaded, section: &Section, prefix: &str, table: Option<&Table>) {
    for name in section.names() {
        let Some(value) = table.and_then(|table| table.get(&name)) else { continue };
        let about = section.key(&name).map_or("", |key| key.about);
        let path = format!("{prefix}.{name}");
        let origin = loaded.origin(&path).or_else(|| {
            // Variables of an environment are set one by one.
            let inner = format!("{path}.");
            loaded.origins().find(|(key, _)| key.starts_with(&inner)).map(|(_, origin)| origin)
        });
        let origin = origin.map_or_else(String::new, |origin| one_line(&format!(" <- {origin}")));
        let setting = format!("{name} = {}", inline(value));
        let _ = writeln!(out, "{setting:VALUE_WIDTH$} # {about}{origin}");
    }
}

/// A comment ends with its line.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

fn inline(value: &Value) -> String {
    match value {
        Value::Table(table) if table.is_empty() => "{}".to_owned(),
        // Names of variables are bare keys.
        Value::Table(table) => {
            let entries: Vec<_> = table.iter().map(|(name, value)| format!("{name} = {}", inline(value))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
        other => other.to_string(),
    }
}

fn robot(out: &mut String, robot: Option<&Robot>) {
    let Some(robot) = robot else { return };
    let _ = writeln!(out, "# robot {}, {} x {} m:", robot.name, robot.footprint.length_m, robot.footprint.width_m);
    for sensor in &robot.sensors {
        let pose = sensor.base_from_sensor;
        let kind = match sensor.kind {
            SensorKind::Sonar => "sonar".to_owned(),
            SensorKind::Lidar => format!("lidar, {} beams of", sensor.transducers),
        };
        let _ = writeln!(
            out,
            "#   {:>3} {kind} {:.1} deg at x {:+.3} m, y {:+.3} m, heading {:+.1} deg, {} to {} m",
            sensor.first_transducer,
            sensor.aperture_rad.to_degrees(),
            pose.x,
            pose.y,
            pose.theta.to_degrees(),
            sensor.range_min_m,
            sensor.range_max_m,
        );
    }
}
