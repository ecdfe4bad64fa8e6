//! Faults that were mended, put back one at a time: a simulation that does not find them proves nothing.
//!
//! Without the feature `mutants` none can be, and the switches are constants.

/// A fault that was mended and can be put back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mutant {
    /// The end of a relayed stream is said to, and heard by, whoever was not told all before.
    EndOvertakes,
    /// A signal of a stranger is taken for the launcher's word, and who leaves with exit code 0 for done.
    SignalStops,
    /// A store of another run is taken for one's own.
    StaleStores,
    /// What was taken in is acknowledged before it is stored.
    AcknowledgesEarly,
    /// Where the user ended a run is not written down: a run that is resumed goes on beyond.
    ForgetsEnd,
    /// A state counts as stored though what had been written by then is not stored downstream.
    TrustsDownstream,
    /// Those upstream of a service that was given up are told that it is gone for good, though the run can be resumed.
    ForgetsTheGivenUp,
    /// Who is done acknowledges what it has not stored, whether the launcher heard that it was done or not.
    LeavesUnheard,
}

impl Mutant {
    /// Every fault, with its name on the command line.
    pub const ALL: [(Self, &str); 8] = [
        (Self::EndOvertakes, "end-overtakes"),
        (Self::SignalStops, "signal-stops"),
        (Self::StaleStores, "stale-stores"),
        (Self::AcknowledgesEarly, "acknowledges-early"),
        (Self::ForgetsEnd, "forgets-end"),
        (Self::TrustsDownstream, "trusts-downstream"),
        (Self::ForgetsTheGivenUp, "forgets-the-given-up"),
        (Self::LeavesUnheard, "leaves-unheard"),
    ];

    /// Whether the fault is there.
    #[cfg(feature = "mutants")]
    #[must_use]
    pub fn lives(self) -> bool {
        LIVING.get() == Some(self)
    }

    /// Whether the fault is there.
    #[cfg(not(feature = "mutants"))]
    #[must_use]
    pub const fn lives(self) -> bool {
        false
    }
}

#[cfg(feature = "mutants")]
thread_local! {
    static LIVING: std::cell::Cell<Option<Mutant>> = const { std::cell::Cell::new(None) };
}

/// Gives this thread this fault from now on, or none.
#[cfg(feature = "mutants")]
pub fn put_back(mutant: Option<Mutant>) {
    LIVING.set(mutant);
}
