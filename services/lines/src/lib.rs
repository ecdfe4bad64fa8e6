//! Any program that prints CARMEN lines on its standard output, as a sensor of the graph.
//!
//! The program is a child of this process, and shares its fate: it is started with it, told to end with it (SIGTERM), and when it
//! dies this process does, so that the launcher starts both again. What it writes to standard error is logged. Its lines are judged
//! as those of a log ([`LineStream`]); where it ends with exit code 0 its streams do.
//!
//! A program that measures what is now can't print it again: what it printed is kept until the map holds it, and its stamps are set
//! beside the time at which they came, so that they go on after a restart. One that prints the same whenever it is started
//! (`replays = true` in the graph file) is simply started again.

mod program;
mod sensor;

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;

use echogrid_service::{Declaration, process};
use echogrid_topics::Topic;

pub use echogrid_formats::log::carmen::LineStream;
pub use program::{Binder, Called, Ended, Printed, Program};
pub use sensor::Lines;

/// The topics that a program of lines writes.
pub const OUTPUTS: &[Topic] = &[Topic::RobotDescription, Topic::TruePose, Topic::OdometryRaw, Topic::RangeScan];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: &[], looks_on: &[], writes: OUTPUTS, orders: &[] };

/// Says that the program prints the same whenever it is started.
pub const REPLAYS: &str = "--replays";
/// Says that this process is to become the program, and to end when its parent does; the parent's number follows.
const BECOME: &str = "--become";

/// Runs it as this process, with what the command line says behind `before`: `[--replays] PROGRAM [ARGUMENT]…`.
#[must_use]
pub fn main(before: &'static [&'static str], arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let mut arguments = arguments.into_iter().peekable();
    if arguments.next_if(|argument| argument == BECOME).is_some() {
        return program::become_bound(arguments);
    }
    let replays = arguments.next_if(|argument| argument == REPLAYS).is_some();
    let Some(program) = arguments.next() else {
        let _ = writeln!(
            std::io::stderr(),
            "echogrid: no program that prints lines; expected [{REPLAYS}] PROGRAM [ARGUMENT]..."
        );
        return ExitCode::from(2);
    };
    let called = Called { program, arguments: arguments.collect() };
    // The executable that runs, whatever lies in its place by now.
    let binder = Binder { program: "/proc/self/exe".into(), arguments: before };
    process::run_sensor("lines", OUTPUTS, |plan| Lines::from_plan(plan, replays, &binder, &called))
}
