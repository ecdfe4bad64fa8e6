//! Sensors that keep to no rule of the process loop: they write to the topics with their own hands.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use echogrid_service::process;
use echogrid_service::runtime::Runtime;
use echogrid_topics::{Health, Input, Message, Output, Participant, Received, ServiceState, Topic};

use super::walk::{OUTPUTS, odometry, robot, scan};

/// Something always ends a wait earlier.
const LONG: Duration = Duration::from_secs(1);

/// Is there, and says nothing until it is asked to leave.
pub(super) fn silent() -> Result<ExitCode> {
    let mut runtime = Runtime::enter("fault", &[], OUTPUTS)?;
    runtime.set_state(ServiceState::Running)?;
    while runtime.stop().is_none() {
        process::block_on(runtime.attend(LONG))?;
    }
    runtime.finish()?;
    Ok(ExitCode::SUCCESS)
}

/// Sends `steps` poses and scans without looking whether there is room, in the run that many epochs `off`.
pub(super) fn flood(steps: u64, off: u64) -> Result<ExitCode> {
    let mut runtime = Runtime::enter("fault", &[], &[])?;
    let plan = runtime.plan().clone();
    let participant = Participant::join(&super::domain()?, "fault")?;
    let open = |topic: &Topic| {
        Output::open(&participant, *topic, plan.max_readings, plan.epoch + off, plan.consumers_of(*topic))
    };
    let mut outputs = OUTPUTS.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let mut health = Input::typed(&participant)?;
    runtime.set_state(ServiceState::Running)?;
    while runtime.stop().is_none() && !outputs.iter().all(Output::is_met) {
        hear(&mut runtime, &mut health, &mut outputs)?;
    }
    outputs[0].send(0, &Message::Robot(robot()))?;
    outputs[0].ring()?;
    for step in 1..=steps {
        for ((stamp_ns, message), output) in [odometry(step), scan(step)].into_iter().zip(&mut outputs[1..]) {
            output.send(stamp_ns, &message)?;
        }
    }
    for output in &mut outputs[1..] {
        output.end(odometry(steps).0)?;
        output.ring()?;
    }
    // Nobody will ever say that a stream of another run has been read, only that it was refused.
    let mut refused = false;
    while runtime.stop().is_none() && !refused && !(off == 0 && outputs[1..].iter().all(Output::is_drained)) {
        refused = hear(&mut runtime, &mut health, &mut outputs)? && off != 0;
    }
    runtime.leave()?;
    Ok(ExitCode::SUCCESS)
}

/// Listens to what the others say of themselves; whether somebody refused a message.
fn hear(runtime: &mut Runtime, health: &mut Input<Health>, outputs: &mut [Output]) -> Result<bool> {
    process::block_on(runtime.attend(LONG))?;
    health.hush()?;
    let mut refused = false;
    while let Some(received) = health.receive()? {
        if let Received::Message(_, health) = received {
            refused |= health.faults > 0;
            outputs.iter_mut().for_each(|output| {
                output.note(&health);
            });
        }
    }
    // Who came late is to hear what the robot looks like.
    outputs.iter_mut().try_for_each(Output::welcome)?;
    Ok(refused)
}
