//! `echogrid check`.

use echogrid_instruments::json;
use std::fmt::Write;

use anyhow::Result;
use echogrid_topics::Delivery;
use echogrid_topics::domain::{SHM, states_bytes};

use crate::cli::Files;
use crate::config::{Config, Exec, LoadRequest, json_schema_of_graphs, json_schema_of_robots, render};
use echogrid_supervision::{consumers, onlookers, places};

/// Prints the effective configuration, or the map of the graph.
pub(super) fn run(request: &LoadRequest, map: bool) -> Result<()> {
    let loaded = Config::load(request)?;
    super::print(&if map { graph(loaded.config()) } else { render(&loaded) })
}

/// Prints the JSON Schema of these files.
pub(super) fn print_schema(files: Files) -> Result<()> {
    let schema = match files {
        Files::Graph => json_schema_of_graphs(),
        Files::Robot => json_schema_of_robots(),
    };
    super::print(&json(&schema)?)
}

/// Who reads what of whom, and in which order the services end.
fn graph(config: &Config) -> String {
    let services = &config.services;
    let (readers, onlookers, places) = (consumers(services), onlookers(services), places(services));
    let mut order: Vec<_> = services.iter().filter_map(|(name, of)| Some((places.get(name)?, name, of))).collect();
    order.sort_by_key(|(place, name, of)| (place.rank, of.kind, *name));
    let mut text = String::new();
    for (_, name, service) in &order {
        let orders = match service.exec {
            Exec::Builtin(builtin) => builtin.declaration().orders,
            Exec::Path(_) => &[],
        };
        let orders = if orders.is_empty() { String::new() } else { format!("; takes orders: {}", orders.join(", ")) };
        let _ = writeln!(text, "{name} ({}, {}){orders}", service.kind, service.exec);
        for topic in &service.wiring.writes {
            let delivery = config.delivery(topic).map_or("", Delivery::word);
            let none = Vec::new();
            let read = readers.get(topic).unwrap_or(&none).iter().map(String::clone);
            let looked_on = onlookers.get(topic).unwrap_or(&none).iter().map(|name| format!("({name})"));
            let to: Vec<String> = read.chain(looked_on).collect();
            let to = if to.is_empty() { "nobody".to_owned() } else { to.join(", ") };
            let _ = writeln!(text, "  {topic:<21} {delivery:<10} -> {to}");
        }
    }
    let names = |told: bool| -> Vec<&str> {
        order.iter().filter(|(place, ..)| place.is_told == told).map(|(_, name, _)| name.as_str()).collect()
    };
    let _ = writeln!(text, "\nthe end of the streams reaches: {}", names(true).join(", "));
    let asked = names(false);
    if !asked.is_empty() {
        let _ = writeln!(text, "and is then said to: {}", asked.join(", "));
    }
    text += "in parentheses: who only looks on; nobody waits for it\n";
    let states = states_bytes(config.mapper.kept_bytes_max()).div_ceil(1 << 20);
    let _ = writeln!(
        text,
        "what the services store of themselves lies in {SHM} if {states} MiB are free there beside the topics, else in the folder for temporary files"
    );
    text
}

#[cfg(test)]
mod tests {
    use crate::config::{Config, default_services};

    #[test]
    fn the_map_of_the_graph_tells_who_reads_what_of_whom() {
        let text = super::graph(&Config { services: default_services(true), ..Config::default() });
        for line in [
            "odometry (odometry, builtin:odometry); takes orders: fix\n  odometry/estimate     lossless   -> mapper, publisher\n",
            "  map/info              latest     -> nobody\n",
            "the end of the streams reaches: sensor, odometry, localizer, mapper, publisher\n",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
    }
}
