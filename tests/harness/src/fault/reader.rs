//! A service that takes in what it is to read, and makes nothing of it.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_core::parts::{Parts, Saved};
use echogrid_service::{Input, Outbox, Service, process};
use echogrid_topics::Topic;

use super::{Mode, go_deaf, strike};

/// What a slow reader takes for a message.
pub(super) const PER_MESSAGE: Duration = Duration::from_millis(50);

/// What a toiling reader takes for one message.
const TOILS_FOR: Duration = Duration::from_secs(5);

#[derive(Debug)]
struct Reader {
    inputs: &'static [Topic],
    mode: Mode,
    after: u64,
    taken: u64,
}

impl Service for Reader {
    fn inputs(&self) -> &'static [Topic] {
        self.inputs
    }

    fn outputs(&self) -> &'static [Topic] {
        &[]
    }

    // It has nothing to lose.
    fn save(&mut self, _parts: &mut Parts) {}

    fn restore(&mut self, _saved: &Saved) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, input: Input, _out: &mut Outbox) -> Result<()> {
        if let Input::Message { .. } = input {
            if self.taken >= self.after {
                strike(self.mode);
            }
            if self.mode == Mode::Toiling && self.taken == self.after {
                toil();
            }
            self.taken += 1;
            if self.mode == Mode::Slow {
                std::thread::sleep(PER_MESSAGE);
            }
        }
        Ok(())
    }
}

fn toil() {
    let begun = Instant::now();
    while begun.elapsed() < TOILS_FOR {
        std::hint::spin_loop();
    }
}

pub(super) fn run(inputs: &'static [Topic], mode: Mode, after: u64) -> ExitCode {
    process::run("fault", inputs, &[], |_plan| {
        if mode == Mode::IgnoresSigterm {
            go_deaf();
        }
        Ok(Reader { inputs, mode, after, taken: 0 })
    })
}
