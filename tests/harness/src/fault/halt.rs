//! A loop in the graph: who reads the map tells the sensor to halt, on a topic that the graph file declares or on `drive/command`.

use std::process::ExitCode;

use anyhow::{Context, Result};
use echogrid_core::parts::{Parts, Saved};
use echogrid_service::{Input, Outbox, Plan, Service, process};
use echogrid_topics::velocity::{DRIVE_COMMAND, Velocity};
use echogrid_topics::{DeclaredInput, DeclaredOutput, DeclaredTopic, Message, Participant, Topic};

/// The topic that tells the sensor to halt.
pub const TOPIC: &str = "walk/halt";
/// Declares it; a message holds the scans that were in the map.
pub const DECLARATION: &str = "[topics.\"walk/halt\"]\ntype = \"harness/Halt/1\"\nbytes = 8\ndelivery = \"latest\"";

/// What the sensor hears of.
#[derive(Debug)]
pub(super) struct Ear {
    input: DeclaredInput,
    was_told: bool,
    // Last: ports go before the process leaves the domain.
    _participant: Participant,
}

impl Ear {
    pub(super) fn open(plan: &Plan) -> Result<Self> {
        let participant = Participant::join(&super::domain()?, "ear")?;
        let input = DeclaredInput::open(&participant, TOPIC, &declared(plan, TOPIC)?)?;
        Ok(Self { input, was_told: false, _participant: participant })
    }

    /// Whether the sensor was told to halt, ever: it may be asked while it still has something to send.
    pub(super) fn was_told(&mut self) -> Result<bool> {
        self.was_told |= self.input.receive()?.is_some();
        Ok(self.was_told)
    }
}

fn declared(plan: &Plan, name: &'static str) -> Result<DeclaredTopic> {
    let topic = plan.config.get("topics").and_then(|topics| topics.get(name));
    topic.with_context(|| format!("the plan declares no {name}"))?.clone().try_into().context(name)
}

/// Tells the sensor to halt when the map is of enough scans.
#[derive(Debug)]
struct Planner {
    inputs: &'static [Topic],
    scans: u64,
    /// What it says, of so many scans.
    says: fn(u64) -> Vec<u8>,
    output: DeclaredOutput,
    _participant: Participant,
}

impl Service for Planner {
    fn inputs(&self) -> &'static [Topic] {
        self.inputs
    }

    fn outputs(&self) -> &'static [Topic] {
        &[]
    }

    // The map tells it again.
    fn save(&mut self, _parts: &mut Parts) {}

    fn restore(&mut self, _saved: &Saved) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, input: Input, _out: &mut Outbox) -> Result<()> {
        if let Input::Message { stamp_ns, message: Message::Info(info), .. } = input
            && info.scans >= self.scans
        {
            self.output.send(stamp_ns, &(self.says)(info.scans))?;
        }
        Ok(())
    }
}

pub(super) fn tell(inputs: &'static [Topic], scans: u64) -> ExitCode {
    plan(inputs, scans, TOPIC, |scans| scans.to_ne_bytes().to_vec())
}

pub(super) fn drive(inputs: &'static [Topic], scans: u64) -> ExitCode {
    plan(inputs, scans, DRIVE_COMMAND, |_| Velocity { v_mps: 0.0, w_radps: 0.0 }.to_bytes().to_vec())
}

fn plan(inputs: &'static [Topic], scans: u64, topic: &'static str, says: fn(u64) -> Vec<u8>) -> ExitCode {
    process::run("fault", inputs, &[], |plan| {
        let participant = Participant::join(&super::domain()?, "planner")?;
        let output = DeclaredOutput::open(&participant, topic, &declared(plan, topic)?)?;
        Ok(Planner { inputs, scans, says, output, _participant: participant })
    })
}
