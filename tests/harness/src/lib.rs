//! For tests: a whole graph of processes in a domain of its own.
//!
//! ```no_run
//! use echogrid_harness::{GraphProcess, echogrid};
//!
//! let mut graph = GraphProcess::start(echogrid(), ["map", "drive.log", "--rate", "5", "--json"]);
//! graph.wait_for_progress("mapper", 200);
//! graph.kill("mapper");
//! graph.wait_until("the mapper has caught up", |graph| graph.progress("mapper") > 300);
//! let ended = graph.wait();
//! assert!(ended.status.success(), "{}", ended.stderr);
//! assert_eq!(ended.summary()["restarts"]["mapper"], 1);
//! assert_eq!(ended.leftovers(), Vec::<String>::new());
//! ```
//!
//! Nothing here sleeps for luck: every wait ends with a condition, or fails with what was said so far. However a test
//! ends, dropping a [`GraphProcess`] ends all of its processes and takes what they left out of shared memory; of a test
//! that fails the log of its graphs is printed.
//!
//! What can be broken:
//!
//! - a service: [`GraphProcess::kill`], [`GraphProcess::stop`] and [`GraphProcess::go_on`], at any point that can be
//!   waited for ([`GraphProcess::wait_for`], [`GraphProcess::wait_until`], [`GraphProcess::wait_for_progress`]);
//! - what a service does: a graph file with `exec` = [`fault_program`], and a [`fault::Mode`] among its `args`;
//! - a topic: [`GraphProcess::garbage`] writes nonsense into it, [`GraphProcess::slow_reader`] reads it far too slowly;
//! - the machine: [`namespace`] gives a test a disk and a shared memory of its own, [`disk::fill`] fills them.

pub mod cut;
pub mod disk;
mod ended;
pub mod fault;
mod graph;
mod leftovers;
pub mod namespace;
mod program;
mod stranger;
mod topic;
mod view;

pub use ended::Ended;
pub use graph::GraphProcess;
pub use leftovers::{files, leftovers};
pub use program::{echogrid, example, fault_program, said};
pub use stranger::Stranger;
pub use topic::TopicReader;
pub use view::View;

use std::time::Duration;

/// A wait that takes longer has failed. Generous: test machines are slow and busy.
pub const PATIENCE: Duration = Duration::from_secs(120);
