//! A loop in the graph: who reads the map tells the sensor to halt, on a topic that the graph file declares.

use std::process::ExitCode;

use anyhow::{Context, Result};
use echogrid_core::parts::{Parts, Saved};
use echogrid_service::{Input, Outbox, Plan, Service, process};
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
        let input = DeclaredInput::open(&participant, TOPIC, &declared(plan)?)?;
        Ok(Self { input, was_told: false, _participant: participant })
    }

    /// Whether the sensor was told to halt, ever: it may be asked while it still has something to send.
    pub(super) fn was_told(&mut self) -> Result<bool> {
        self.was_told |= self.input.receive()?.is_some();
        Ok(self.was_told)
    }
}

fn declared(plan: &Plan) -> Result<DeclaredTopic> {
    let topic = plan.config.get("topics").and_then(|topics| topics.get(TOPIC));
    topic.with_context(|| format!("the plan declares no {TOPIC}"))?.clone().try_into().context(TOPIC)
}

/// Tells the sensor to halt when the map is of enough scans.
#[derive(Debug)]
struct Planner {
    inputs: &'static [Topic],
    scans: u64,
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
            self.output.send(stamp_ns, &info.scans.to_ne_bytes())?;
        }
        Ok(())
    }
}

pub(super) fn tell(inputs: &'static [Topic], scans: u64) -> ExitCode {
    process::run("fault", inputs, &[], |plan| {
        let participant = Participant::join(&super::domain()?, "planner")?;
        let output = DeclaredOutput::open(&participant, TOPIC, &declared(plan)?)?;
        Ok(Planner { inputs, scans, output, _participant: participant })
    })
}
