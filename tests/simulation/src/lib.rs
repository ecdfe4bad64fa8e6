//! Whole runs of a graph in one thread, of one seed.
//!
//! The steps of the services, the loops of their lives, what they store and how they go on are the very ones of the real
//! processes; shared memory, clock, signals and disk are played, and whoever reads next, dies, is stopped or finds no room is
//! drawn from the seed. What a run comes to is compared with the same drive mapped by one thread that nobody disturbs.

mod dice;
mod disk;
mod drive;
mod launcher;
mod play;
mod process;
mod reference;
mod schedule;
mod world;

pub use schedule::{Failure, Played, Schedule, What};

/// The faults that are left when as many as possible are left out, by their places; and what still fails.
#[must_use]
pub fn shrink(schedule: &Schedule) -> Option<(Vec<usize>, Failure)> {
    let mut kept: Vec<usize> = (0..schedule.faults.len()).collect();
    let mut failure = schedule.keeping(&kept).play().err()?;
    let mut place = 0;
    while place < kept.len() {
        let mut fewer = kept.clone();
        fewer.remove(place);
        match schedule.keeping(&fewer).play() {
            Err(still) => (kept, failure) = (fewer, still),
            Ok(_) => place += 1,
        }
    }
    Some((kept, failure))
}
