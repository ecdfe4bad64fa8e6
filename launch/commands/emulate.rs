//! `echogrid emulate`: a robot for whoever has none.

use std::time::Duration;

use anyhow::{Context, Result};
use echogrid_pioneer::emulator::{Door, Emulator, Who, serve};
use echogrid_service::signals::Signals;
use echogrid_simulator::{Simulator, world_of};
use nix::sys::signal::Signal;

use crate::cli::Emulate;
use crate::config::{Config, LoadRequest};

/// The simulated robot behind the door of a Pioneer, until it is told to end.
pub(super) fn run(request: &Emulate) -> Result<()> {
    let sets = [format!("simulator.world={}", request.world)].into_iter();
    let sets =
        sets.chain(request.seed.map(|seed| format!("simulator.seed={seed}"))).chain(request.sets.iter().cloned());
    let load = LoadRequest {
        sensor: Some("simulator".into()),
        robot: Some(request.robot.clone()),
        sets: sets.collect(),
        ..LoadRequest::default()
    };
    let config = Config::load(&load)?.config().clone();
    let robot = config.robot.clone().context("there is no such robot")?;
    // As the firmware has it: a whole number of milliseconds in a byte.
    let cycle_ms = (config.simulator.firing_period_s * 1e3).round().clamp(1.0, 255.0) as u8;
    let who = Who::of(&request.model, cycle_ms)
        .with_context(|| format!("--model {:?}: expected p3at-sh, p3dx-sh, p3at or p3dx", request.model))?;
    let simulator = Simulator::new(&config.simulator, world_of(&config.simulator)?, robot)?;
    let start = simulator.true_pose();
    let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP])?;
    let mut door = match request.listen {
        Some(address) => Door::tcp(address)?,
        None => Door::terminal(request.link.as_deref())?,
    };
    let (x, y, heading_deg) = (start.x, start.y, start.theta.to_degrees());
    super::print(&format!(
        "a {} in {} at {}; it drives when somebody connects:\n  echogrid up GRAPH.toml --sensor pioneer --robot {} --rate 1 --set \
         pioneer.port={} --start {x:.3} {y:.3} {heading_deg:.3}deg\n",
        request.model,
        request.world,
        door.name(),
        request.robot,
        door.name()
    ))?;
    let mut emulator = Emulator::new(who, simulator);
    let mut was_over = false;
    let mut failed = Ok(());
    serve(&mut emulator, &mut door, |emulator| {
        if emulator.is_over() && !was_over {
            was_over = true;
            let drive = Duration::from_millis(100 * emulator.sips()).as_secs_f64();
            failed = super::print(&format!("the drive is over: {} packets in {drive:.1} s\n", emulator.sips()));
        }
        failed.is_err() || !matches!(signals.next(), Ok(None))
    })?;
    failed?;
    super::print(&format!("{} packets\n", emulator.sips()))
}
