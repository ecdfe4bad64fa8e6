//! What happens in a run, for whoever tells people of it.

use std::time::Duration;

/// Something that happens once.
#[derive(Debug)]
pub enum Event<'a> {
    /// A process was started.
    Started {
        /// The service.
        name: &'a str,
        /// The number of the process.
        pid: u32,
    },
    /// Every service is ready.
    Ready,
    /// A process is gone.
    Ended {
        /// The service.
        name: &'a str,
        /// How, for people.
        how: String,
    },
    /// It will be started again.
    Restarting {
        /// The service.
        name: &'a str,
        /// Why, for people.
        why: &'a str,
        /// How often it was within the window, this time included.
        number: u32,
        /// How soon.
        after: Duration,
    },
    /// The user has the graph end.
    Stopping {
        /// The signal that said so.
        signal: &'static str,
    },
    /// Something of a service that is no fault, and good to know.
    Note {
        /// The service.
        name: &'a str,
        /// What, for people.
        what: String,
    },
    /// It will not, and the others go on.
    GivenUp {
        /// The service.
        name: &'a str,
        /// Why, for people.
        why: &'a str,
    },
    /// The shared memory of the graph is made anew, and all its processes.
    Rebuilt {
        /// Why, for people.
        why: &'a str,
    },
}
