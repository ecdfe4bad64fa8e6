//! What the processes of a simulated run have in common: the time, their signals, their deaths, the disk.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::BorrowedFd;
use std::rc::Rc;
use std::task::Poll;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_service::host::{Host, Told, Woken};
use echogrid_service::process::exit_code;
use echogrid_supervision::End;
use echogrid_topics::memory::Schedule;

use crate::dice::Dice;
use crate::disk::Disk;

/// What a process waits for.
#[derive(Debug, Default)]
pub(crate) struct Wait {
    /// Until when at most.
    pub(crate) until: Duration,
    /// It is its turn.
    turn: bool,
    pub(crate) told: Vec<Told>,
    pub(crate) orphaned: bool,
    /// Somebody stopped it (SIGSTOP) until then.
    pub(crate) stopped_until: Duration,
    /// What was on its way did not arrive at its last turn.
    pub(crate) is_late: bool,
}

/// By somebody's SIGKILL.
pub(crate) const KILLED: End = End::Signal(9);

#[derive(Debug)]
pub(crate) struct World {
    pub(crate) dice: Dice,
    pub(crate) now: Duration,
    begun: Instant,
    /// So often of a thousand a message is still on its way.
    pub(crate) late_permille: u32,
    /// What each process does before it dies, for those that do.
    pub(crate) doomed: BTreeMap<u32, u32>,
    pub(crate) dead: BTreeSet<u32>,
    pub(crate) waits: BTreeMap<u32, Wait>,
    /// How processes ended.
    pub(crate) ends: BTreeMap<u32, End>,
    /// Somebody ended since the launcher looked last.
    pub(crate) has_ended: bool,
    /// Whose turn it is.
    current: u32,
    pub(crate) disk: Disk,
}

/// The world, shared by all in it.
pub(crate) type Shared = Rc<RefCell<World>>;

impl World {
    pub(crate) fn new(seed: u64, late_permille: u32, begun: Instant) -> Self {
        Self {
            dice: Dice::new(seed),
            now: Duration::ZERO,
            begun,
            late_permille,
            doomed: BTreeMap::new(),
            dead: BTreeSet::new(),
            waits: BTreeMap::new(),
            ends: BTreeMap::new(),
            has_ended: false,
            current: 0,
            disk: Disk::default(),
        }
    }

    /// Whether a process lives to do what it is about to.
    pub(crate) fn lives(&mut self, process: u32) -> bool {
        if self.dead.contains(&process) {
            return false;
        }
        match self.doomed.get_mut(&process) {
            Some(0) => {
                self.doomed.remove(&process);
                self.dead.insert(process);
                false
            }
            Some(left) => {
                *left -= 1;
                true
            }
            None => true,
        }
    }

    /// A process does nothing for a while.
    pub(crate) fn stop(&mut self, process: u32, millis: u32) {
        self.waits.entry(process).or_default().stopped_until = self.now + Duration::from_millis(millis.into());
    }

    /// When a process goes on.
    pub(crate) fn stopped_until(&self, process: u32) -> Duration {
        self.waits.get(&process).map_or(Duration::ZERO, |wait| wait.stopped_until)
    }

    /// When time began.
    pub(crate) fn begun(&self) -> Instant {
        self.begun
    }

    /// What time it is.
    pub(crate) fn time(&self) -> Instant {
        self.begun + self.now
    }

    /// A process has ended by itself, or died on the way.
    pub(crate) fn note_end(&mut self, process: u32, end: &Result<()>) {
        let end = match end {
            _ if self.dead.contains(&process) => KILLED,
            Ok(()) => End::Code(0),
            Err(error) => End::Code(exit_code(error).into()),
        };
        self.ends.entry(process).or_insert(end);
        self.has_ended = true;
    }

    /// It is this process's turn.
    pub(crate) fn give_turn(&mut self, process: u32) {
        self.current = process;
        if let Some(wait) = self.waits.get_mut(&process) {
            (wait.turn, wait.is_late) = (true, false);
        }
    }
}

/// What is open in shared memory, decided by the world.
#[derive(Debug)]
pub(crate) struct Chance(pub(crate) Shared);

impl Schedule for Chance {
    fn choose(&mut self, producers: usize) -> Option<usize> {
        let world = &mut *self.0.borrow_mut();
        if world.dice.permille(world.late_permille) {
            let (current, now) = (world.current, world.now);
            if let Some(wait) = world.waits.get_mut(&current) {
                (wait.is_late, wait.until) = (true, wait.until.min(now));
            }
            return None;
        }
        Some(world.dice.below(producers))
    }

    fn lives(&mut self, process: u32) -> bool {
        self.0.borrow_mut().lives(process)
    }
}

/// The system that a simulated process runs on.
#[derive(Debug)]
pub(crate) struct SimulatedHost {
    pub(crate) process: u32,
    pub(crate) world: Shared,
}

impl Host for SimulatedHost {
    fn now(&self) -> Instant {
        self.world.borrow().time()
    }

    fn pid(&self) -> u32 {
        self.process
    }

    fn is_launched(&self) -> bool {
        true
    }

    fn poll_wait(&mut self, _fds: &[BorrowedFd<'_>], patience: Duration) -> Poll<Result<Woken>> {
        let mut world = self.world.borrow_mut();
        let now = world.now;
        let wait = world.waits.entry(self.process).or_default();
        if !std::mem::take(&mut wait.turn) {
            wait.until = now.saturating_add(patience);
            return Poll::Pending;
        }
        Poll::Ready(Ok(Woken { told: std::mem::take(&mut wait.told), orphaned: wait.orphaned }))
    }
}
