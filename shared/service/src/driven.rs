//! Orders of a sensor that is also driven by a topic, [`DRIVE_COMMAND`].

use std::os::fd::BorrowedFd;

use anyhow::{Context, Result};
use echogrid_topics::velocity::{DRIVE_COMMAND, Velocity};
use echogrid_topics::{Command, ControlServer, DeclaredInput, DeclaredTopic, Participant, TopicError};

use crate::host::Orders;
use crate::plan::Plan;

/// Orders of the user, and what a planner says.
#[derive(Debug)]
pub(crate) struct Driven {
    orders: ControlServer,
    planner: DeclaredInput,
    /// What was refused last: it is said once, not with every message.
    refused: String,
}

impl Driven {
    /// The orders of the service `name`, and what is said on the topic if the plan has it read that.
    ///
    /// # Errors
    /// Shared memory refuses, or the plan is broken.
    pub(crate) fn over(
        orders: ControlServer,
        participant: &Participant,
        plan: &Plan,
        name: &str,
    ) -> Result<Box<dyn Orders>> {
        if !plan.reads(name, DRIVE_COMMAND) {
            return Ok(Box::new(orders));
        }
        let topic = plan.config.get("topics").and_then(|topics| topics.get(DRIVE_COMMAND)).cloned();
        let topic: DeclaredTopic = topic
            .with_context(|| format!("the plan declares no {DRIVE_COMMAND}"))?
            .try_into()
            .context("in section [topics] of the plan")?;
        let planner = DeclaredInput::open(participant, DRIVE_COMMAND, &topic)?;
        Ok(Box::new(Self { orders, planner, refused: String::new() }))
    }
}

impl Orders for Driven {
    fn serve(
        &mut self,
        carry_out: &mut dyn FnMut(Option<u64>, Command) -> Result<String, String>,
    ) -> Result<(), TopicError> {
        self.orders.serve(&mut |order, command| carry_out(Some(order), command))?;
        self.planner.hush()?;
        let mut latest = None;
        while let Some((_, bytes)) = self.planner.receive()? {
            latest = Some(bytes);
        }
        let Some(bytes) = latest else { return Ok(()) };
        let carried_out = Velocity::of(&bytes)
            .ok_or_else(|| "its numbers are not finite".to_owned())
            .and_then(|Velocity { v_mps, w_radps }| carry_out(None, Command::Drive { v_mps, w_radps }));
        match carried_out {
            Ok(_) => self.refused.clear(),
            Err(why) if why != self.refused => {
                tracing::warn!("{DRIVE_COMMAND} is not followed: {why}");
                self.refused = why;
            }
            Err(_) => {}
        }
        Ok(())
    }

    fn fds(&self) -> Vec<BorrowedFd<'_>> {
        vec![self.orders.fd(), self.planner.fd()]
    }
}
