//! The ways to misbehave.

/// Names the file that says how far the robot of [`Mode::Live`] is: the number of the step, as text.
pub const WORLD_VARIABLE: &str = "ECHOGRID_FAULT_WORLD";
/// Names the file that a sensor of [`Mode::Gated`] waits for.
pub const GATE_VARIABLE: &str = "ECHOGRID_FAULT_GATE";

/// What `echogrid-fault` does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// All is as it should be: for comparison.
    Good,
    /// Aborts before it enters the graph.
    AlwaysCrash,
    /// Aborts after so many messages, in each of its lives.
    CrashLate,
    /// Never enters the graph.
    HangBeforeReady,
    /// Hangs after so many messages.
    HangAfterReady,
    /// Goes on when it is asked to end.
    IgnoresSigterm,
    /// A sensor that measures what will not be there again, and aborts after so many messages, in each of its lives. How far
    /// the robot is in the world is in the file that [`WORLD_VARIABLE`] names.
    Live,
    /// A sensor that waits, after so many messages, until the file is there that [`GATE_VARIABLE`] names.
    Gated,
    /// A sensor that is ready, and lives, and never says a word.
    Silent,
    /// A sensor that sends as many messages as it is told to, whether anybody keeps up or not.
    Flooding,
    /// A sensor that numbers its streams as those of another run.
    WrongEpoch,
    /// Between the messages of a good sensor: poses that are none, that are beyond the moon, or of the past.
    Garbage,
    /// A reader that takes a message every 50 ms.
    Slow,
    /// A reader that works for five seconds at one message, and says nothing meanwhile.
    Toiling,
    /// A sensor that walks until it is told to halt, on the topic [`super::halt::TOPIC`] of the graph file.
    WalksUntilTold,
    /// A reader of `map/info` that says so when it has heard of as many scans as it is told.
    TellsToHalt,
    /// A reader of `map/info` that has the robot stand still, by `drive/command`, as soon as it has heard of as many scans.
    Halts,
    /// No service of the graph: writes garbage into the topic that it is told.
    GarbageOn,
    /// No service of the graph: reads the topic that it is told, a message every 50 ms.
    SlowReader,
}

impl Mode {
    /// All of them.
    pub const ALL: [Self; 19] = [
        Self::Good,
        Self::AlwaysCrash,
        Self::CrashLate,
        Self::HangBeforeReady,
        Self::HangAfterReady,
        Self::IgnoresSigterm,
        Self::Live,
        Self::Gated,
        Self::Silent,
        Self::Flooding,
        Self::WrongEpoch,
        Self::Garbage,
        Self::Slow,
        Self::Toiling,
        Self::WalksUntilTold,
        Self::TellsToHalt,
        Self::Halts,
        Self::GarbageOn,
        Self::SlowReader,
    ];

    /// The mode as it is written.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::AlwaysCrash => "always-crash",
            Self::CrashLate => "crash-late",
            Self::HangBeforeReady => "hang-before-ready",
            Self::HangAfterReady => "hang-after-ready",
            Self::IgnoresSigterm => "ignores-sigterm",
            Self::Live => "live",
            Self::Gated => "gated",
            Self::Silent => "silent",
            Self::Flooding => "flooding",
            Self::WrongEpoch => "wrong-epoch",
            Self::Garbage => "garbage",
            Self::Slow => "slow",
            Self::Toiling => "toiling",
            Self::WalksUntilTold => "walks-until-told",
            Self::TellsToHalt => "tells-to-halt",
            Self::Halts => "halts",
            Self::GarbageOn => "garbage-on",
            Self::SlowReader => "slow-reader",
        }
    }

    pub(super) fn of(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.word() == word)
    }

    pub(super) fn words() -> String {
        Self::ALL.map(Self::word).join(", ")
    }
}
