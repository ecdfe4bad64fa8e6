//! What sonars hear, and why: how often walls answer, mirror sound away or seem too far, by the angle at which a sonar's
//! axis meets them.
//!
//! `cargo run --release --example echo_statistics [WORLD [KEY=VALUE …]]` drives the simulator through a world and prints the
//! shares of causes as a table; settings are those of `[simulator]`.

use std::io::Write;

use anyhow::{Context, Result, bail};
use echogrid::config::{Config, LoadRequest};
use echogrid_service::Sensor;
use echogrid_simulator::{Cause, IncidenceTable, Simulator, world_of};
use echogrid_topics::Message;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let world = arguments.next().unwrap_or_else(|| "office".to_owned());
    let settings = arguments.map(|setting| format!("simulator.{setting}"));
    let request = LoadRequest {
        sensor: Some("simulator".to_owned()),
        sets: [format!("simulator.world={world}")].into_iter().chain(settings).collect(),
        ..LoadRequest::default()
    };
    let config = Config::load(&request)?.into_config();
    let robot = config.robot.context("the simulated robot")?;
    let mut simulator = Simulator::new(&config.simulator, world_of(&config.simulator)?, robot)?;
    let (mut table, mut scans, mut readings, mut last_ns) = (IncidenceTable::default(), 0_u64, [0_u64; 7], 0);
    while let Some((stamp_ns, message)) = simulator.next()? {
        last_ns = stamp_ns;
        if let Message::Scan(_) = message {
            scans += 1;
            for heard in simulator.last_causes() {
                table.add(heard);
                readings[heard.cause as usize] += 1;
            }
        }
    }
    let total: u64 = readings.iter().sum();
    if total == 0 {
        bail!("the drive has no scan");
    }
    let mut out = std::io::stdout().lock();
    let error_m = simulator.true_pose().distance_m(simulator.odometry_pose());
    writeln!(out, "{scans} scans in {:.0} s; odometry is wrong by {error_m:.2} m at the end", last_ns as f64 * 1e-9)?;
    for cause in Cause::ALL {
        let count = readings[cause as usize];
        writeln!(out, "{:10} {count:7} {:5.1} %", cause.word(), 100.0 * count as f64 / total as f64)?;
    }
    writeln!(out, "\n{table}")?;
    Ok(())
}
