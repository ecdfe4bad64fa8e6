//! The launcher of a simulated run: the real one's decisions (`echogrid_supervision`), carried out on processes that are played.
//!
//! What it does around them follows `launch/supervisor` and `launch/commands/spool.rs`: in which order it looks, when what the
//! dead left is cleaned up, when the spool is removed.

use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use echogrid_service::mutants::Mutant;
use echogrid_supervision::config::{Restart, SupervisionConfig};
use echogrid_supervision::{Clock, Event, Role, Settings, Supervision, Wiring};
use echogrid_topics::memory::Bus;
use echogrid_topics::{Health, Input, MapInfo, Message, Output, Received, ServiceState, Topic};

use crate::disk::RunFile;
use crate::drive::Drive;
use crate::process::{self, Life, SimulatedProcess, Start};
use crate::world::Shared;

/// It looks this often, whatever happens.
const LOOKS_EVERY: Duration = Duration::from_millis(100);
/// What the dead left is cleaned up by then.
const CLEANS_WITHIN: Duration = Duration::from_millis(20);
/// As `run.alive_within_s` and `supervision.ready_within_s` have it.
const HANGS_AFTER: Duration = Duration::from_secs(30);

/// A life of the launcher.
pub(crate) struct Launcher {
    pub(crate) process: u32,
    pub(crate) run: u64,
    pub(crate) drive: Drive,
    pub(crate) services: Supervision<SimulatedProcess>,
    pub(crate) info: Option<MapInfo>,
    ear: Input,
    map_info: Input,
    word: Output,
    clock: Clock,
    /// When the helper is done that cleans up after the dead; none: none is at work.
    clean_at: Option<Duration>,
    looks_at: Duration,
    /// The user has it end the run.
    pub(crate) wants_stop: bool,
    /// Somebody was taken for hanging, and how that was known.
    pub(crate) blamed: Option<String>,
}

impl Launcher {
    pub(crate) fn new(
        world: &Shared,
        bus: &Bus,
        process: u32,
        drive: Drive,
        run: u64,
        config: &SupervisionConfig,
    ) -> Result<Self> {
        let (now, time) = (world.borrow().now, world.borrow().time());
        Ok(Self {
            process,
            run,
            drive,
            services: Supervision::new(&roles(drive)?, settings(drive, run, config)?, time),
            info: None,
            ear: process::input(bus, process, Topic::Health),
            map_info: process::input(bus, process, Topic::MapInfo),
            word: process::output(bus, process, Topic::Health, run, &[]),
            clock: Clock::new(time),
            clean_at: None,
            looks_at: now,
            wants_stop: false,
            blamed: None,
        })
    }

    /// One look at everything, as the real one's.
    ///
    /// # Errors
    /// It died.
    pub(crate) fn turn(&mut self, world: &Shared, bus: &Bus, lives: &mut Vec<Life>, next: &mut u32) -> Result<()> {
        let now = world.borrow().now;
        self.looks_at = now + LOOKS_EVERY;
        self.services.is_now(self.clock.look(world.borrow().time()));
        if self.wants_stop && !self.services.stopped {
            self.services.stop();
        }
        self.hear()?;
        self.services.has_become_ready();
        let dead = self.services.reap()?;
        if !dead.is_empty() {
            // Their last words may still be on their way: whoever waits hears them.
            while bus.has_mail(self.process) {
                self.hear()?;
            }
        }
        let blamed = &mut self.blamed;
        let mut tell = |event: &Event<'_>| {
            if let Event::Ended { name, how } = event
                && how.contains("hangs")
            {
                *blamed = Some(format!("{name}: {how}"));
            }
        };
        self.services.bury(&dead, &mut tell);
        self.services.look(&mut tell);
        bury_the_killed(world, bus, lives);
        self.clean_up(bus, now);
        ensure!(!std::mem::take(&mut self.services.is_broken), "shared memory is never broken here");
        self.tell_who_is_gone()?;
        self.start_who_is_due(world, bus, lives, next)
    }

    fn clean_up(&mut self, bus: &Bus, now: Duration) {
        match self.clean_at {
            Some(at) if now < at => return,
            Some(_) => bus.clean(),
            None => {}
        }
        let is_anybody_due = self.services.next_due().is_some();
        let is_unclean = std::mem::take(&mut self.services.is_unclean) && is_anybody_due;
        self.clean_at = is_unclean.then_some(now + CLEANS_WITHIN);
    }

    fn start_who_is_due(&mut self, world: &Shared, bus: &Bus, lives: &mut Vec<Life>, next: &mut u32) -> Result<()> {
        if self.clean_at.is_some() || self.services.is_unclean {
            return Ok(());
        }
        let gone: Vec<String> = self.services.gone().map(str::to_owned).collect();
        for unit in self.services.due() {
            ensure!(bus.lives(self.process), "the launcher died");
            *next += 1;
            let process = *next;
            world.borrow_mut().waits.entry(process).or_default();
            let name = self.services.units[unit].name.clone();
            let start = Start { world, bus, drive: self.drive, run: self.run, name: &name, process, gone: &gone };
            match start.life() {
                Ok(life) => lives.push(life),
                Err(error) => {
                    bus.bury(process);
                    world.borrow_mut().note_end(process, &Err(error));
                }
            }
            self.services.started(unit, SimulatedProcess { number: process, world: world.clone() });
        }
        Ok(())
    }

    fn hear(&mut self) -> Result<()> {
        while let Some(received) = self.ear.receive()? {
            let Received::Message(_, Message::Health(health)) = received else { continue };
            self.services.hear(health);
        }
        self.tell_who_is_gone()?;
        while let Some(received) = self.map_info.receive()? {
            if let Received::Message(_, Message::Info(info)) = received {
                self.info = Some(info);
            }
        }
        Ok(())
    }

    fn tell_who_is_gone(&mut self) -> Result<()> {
        for name in self.services.words() {
            self.word.send(0, &Message::Health(Health::new(name, self.process, ServiceState::Gone)))?;
        }
        Ok(self.word.ring()?)
    }

    /// When it wants to look next.
    pub(crate) fn due(&self, world: &Shared) -> Duration {
        let begun = world.borrow().begun();
        let start = self.services.next_due().filter(|_| self.clean_at.is_none());
        let start = start.map(|due: Instant| due.saturating_duration_since(begun));
        start.into_iter().chain(self.clean_at).fold(self.looks_at, Duration::min)
    }

    /// Removes what the run could be resumed from.
    ///
    /// # Errors
    /// The launcher died.
    pub(crate) fn tidy_up(&self, world: &Shared) -> Result<()> {
        let lives = || ensure_lives(world, self.process);
        let is_stale = Mutant::StaleStores.lives();
        lives()?;
        if is_stale {
            world.borrow_mut().disk.remove_run_file();
        } else if let Some(run_file) = &mut world.borrow_mut().disk.run_file {
            run_file.ended = true;
        }
        sweep(world, self.process)
    }
}

/// Who was killed by the launcher is gone at once.
fn bury_the_killed(world: &Shared, bus: &Bus, lives: &mut Vec<Life>) {
    let (dead, alive): (Vec<Life>, Vec<Life>) =
        lives.drain(..).partition(|life| world.borrow().ends.contains_key(&life.process));
    *lives = alive;
    dead.into_iter().for_each(|life| bus.bury(life.process));
}

/// What each service of a drive is to its graph, upstream to downstream.
fn roles(drive: Drive) -> Result<Vec<(String, Role)>> {
    let names = std::iter::once(&"sensor").chain(drive.services());
    let role = |name: &&str| {
        let (reads, writes) = process::topics(name)?;
        let words = |topics: &[Topic]| topics.iter().map(|topic| topic.name().to_owned()).collect();
        let (reads, writes) = (words(reads), words(writes));
        let wiring = Wiring { reads, looks_on: Vec::new(), writes, source: *name == "sensor" };
        Ok(((*name).to_owned(), Role { wiring, restart: Restart::OnFailure, required: true }))
    };
    names.map(role).collect()
}

fn settings(drive: Drive, run: u64, config: &SupervisionConfig) -> Result<Settings> {
    Ok(Settings {
        config: config.clone(),
        alive_within: HANGS_AFTER,
        ready_within: HANGS_AFTER,
        is_resumable: true,
        consumers: process::plan(drive, run)?.consumers,
    })
}

fn ensure_lives(world: &Shared, process: u32) -> Result<()> {
    ensure!(world.borrow_mut().lives(process), "the launcher died");
    Ok(())
}

/// Removes stores, and last what says of which run they are.
fn sweep(world: &Shared, process: u32) -> Result<()> {
    let names: Vec<String> = world.borrow().disk.stores.keys().cloned().collect();
    for name in names {
        ensure_lives(world, process)?;
        world.borrow_mut().disk.remove_store(&name);
    }
    ensure_lives(world, process)?;
    world.borrow_mut().disk.remove_run_file();
    Ok(())
}

/// What the user does with a folder before a run of a drive: goes on with it, or begins anew. The number of the run.
///
/// # Errors
/// The launcher died.
pub(crate) fn open_spool(world: &Shared, process: u32, drive: Drive) -> Result<u64> {
    ensure_lives(world, process)?;
    let run_file = world.borrow().disk.run_file;
    if let Some(run_file) = run_file {
        if run_file.drive == drive && !run_file.ended {
            return Ok(run_file.run);
        }
        // Either its launcher died while it tidied up, or it is refused, and its user removes the folder.
        sweep(world, process)?;
    }
    let mut world = world.borrow_mut();
    if !Mutant::StaleStores.lives() {
        // Refused; its user removes the folder.
        world.disk.stores.clear();
    }
    let run = u64::from(process) << 8 | 1;
    world.disk.run_file = Some(RunFile { run, drive, ended: false });
    world.disk.sync_folder();
    Ok(run)
}
