//! A sensor that misbehaves: the random walk with a fault, for tests of what echogrid does about it.
//!
//! `FAULT` says which (see [`Fault`]), `FAULT_AFTER` after how many messages:
//!
//! ```toml
//! [services.sensor]
//! kind = "sensor"
//! exec = "target/debug/examples/faulty_sensor"
//! env = { FAULT = "crash", FAULT_AFTER = "500" }
//! ```

#[path = "random_walk.rs"]
#[allow(dead_code)] // its `main`
mod random_walk;

use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use echogrid_core::{Echo, Pose2, Reading};
use echogrid_service::{Sensor, process};
use echogrid_topics::{Message, RawOdometry, Topic};
use nix::sys::signal::{SigHandler, SigSet, Signal, signal};
use random_walk::{OUTPUTS, RandomWalk};

#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    /// Before every hundredth message a pose that is none.
    Nan,
    /// Two more readings in every scan: one from beyond the moon, one of a sonar that is not there.
    Absurd,
    /// Aborts.
    Crash,
    /// Gives nothing any more, and hears nothing.
    Hang,
    /// Exits as if all were done, but without ending its streams.
    Leave,
    /// Never says what the robot looks like.
    Undescribed,
    /// Has no ears: it gives poses, ends them properly, and never says a word of ranges.
    Mute,
    /// Goes on when it is asked to end.
    Deaf,
}

#[derive(Debug)]
struct Faulty {
    walk: RandomWalk,
    fault: Fault,
    after: u64,
    count: u64,
    stamp_ns: u64,
}

impl Faulty {
    fn from_environment() -> Result<Self> {
        let fault = std::env::var("FAULT").context("FAULT is not set")?;
        let fault = match fault.as_str() {
            "nan" => Fault::Nan,
            "absurd" => Fault::Absurd,
            "crash" => Fault::Crash,
            "hang" => Fault::Hang,
            "leave" => Fault::Leave,
            "undescribed" => Fault::Undescribed,
            "mute" => Fault::Mute,
            "deaf" => Fault::Deaf,
            other => bail!("FAULT = {other}: no such fault"),
        };
        let after = std::env::var("FAULT_AFTER").map_or(Ok(0), |text| text.parse()).context("FAULT_AFTER")?;
        if fault == Fault::Deaf {
            // SAFETY: the handler only writes to standard error.
            unsafe { signal(Signal::SIGTERM, SigHandler::Handler(heard)) }?;
            SigSet::from(Signal::SIGTERM).thread_unblock()?;
        }
        Ok(Self { walk: RandomWalk::new(), fault, after, count: 0, stamp_ns: 0 })
    }
}

extern "C" fn heard(_signal: i32) {
    let _ = nix::unistd::write(std::io::stderr(), b"SIGTERM was heard and ignored\n");
}

impl Sensor for Faulty {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        self.count += 1;
        let due = self.count > self.after;
        match self.fault {
            Fault::Nan if self.count.is_multiple_of(100) => {
                let odom_from_base = Pose2 { x: f64::NAN, y: 0.0, theta: 0.0 };
                let nowhere = RawOdometry { odom_from_base, v_mps: 0.0, w_radps: 0.0 };
                return Ok(Some((self.stamp_ns, Message::Odometry(nowhere))));
            }
            Fault::Crash if due => std::process::abort(),
            Fault::Hang if due => loop {
                std::thread::sleep(Duration::from_secs(3600));
            },
            Fault::Leave if due => std::process::exit(0),
            _ => {}
        }
        let Some((stamp_ns, mut message)) = self.walk.next()? else { return Ok(None) };
        self.stamp_ns = stamp_ns;
        match (self.fault, &mut message) {
            (Fault::Undescribed, Message::Robot(_)) | (Fault::Mute, Message::Scan(_)) => return self.next(),
            (Fault::Absurd, Message::Scan(readings)) => {
                let far = Echo::Hit { range_m: 1e9 };
                readings.push(Reading { transducer: 0, echo: far, offset_ns: 0 });
                readings.push(Reading { transducer: 999, echo: Echo::Hit { range_m: 1.0 }, offset_ns: 0 });
            }
            _ => {}
        }
        Ok(Some((stamp_ns, message)))
    }
}

fn main() -> ExitCode {
    let mute = std::env::var("FAULT").is_ok_and(|fault| fault == "mute");
    let outputs = if mute { &OUTPUTS[..2] } else { OUTPUTS };
    process::run_sensor("faulty", outputs, |_plan| Faulty::from_environment())
}
