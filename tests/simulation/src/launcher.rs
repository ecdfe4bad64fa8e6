//! The launcher of a simulated run: it starts what died again, and tidies up when all is done.
//!
//! What it does follows `launch/supervisor`: what counts as done, who is told that somebody left, when the spool is removed.

use std::time::Duration;

use anyhow::{Result, ensure};
use echogrid_service::host::Told;
use echogrid_service::mutants::Mutant;
use echogrid_topics::memory::Bus;
use echogrid_topics::{Health, Input, MapInfo, Message, Output, Received, ServiceState, Topic};

use crate::disk::RunFile;
use crate::drive::Drive;
use crate::process::{self, Life, Start, believes_exit_codes};
use crate::world::Shared;

const BACKOFF: Duration = Duration::from_millis(200);
const LOOKS_EVERY: Duration = Duration::from_millis(100);

/// Where a service is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    Waiting(Duration),
    Alive(u32),
    Done,
}

#[derive(Debug)]
pub(crate) struct Unit {
    pub(crate) name: &'static str,
    pub(crate) stage: Stage,
    pub(crate) health: Option<Health>,
    asked: bool,
    restarts: u32,
}

/// How a process ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Exit {
    Success,
    Failure,
}

/// A life of the launcher.
pub(crate) struct Launcher {
    pub(crate) process: u32,
    pub(crate) run: u64,
    pub(crate) drive: Drive,
    pub(crate) units: Vec<Unit>,
    pub(crate) info: Option<MapInfo>,
    ear: Input,
    map_info: Input,
    word: Output,
    /// Somebody died whose leftovers are still there.
    clean_at: Option<Duration>,
    pub(crate) looks_at: Duration,
    pub(crate) wants_stop: bool,
    pub(crate) is_stopping: bool,
    /// Messages that the sensor had given when it ended.
    pub(crate) given: Option<u64>,
}

impl Launcher {
    pub(crate) fn new(world: &Shared, bus: &Bus, process: u32, drive: Drive, run: u64) -> Self {
        let now = world.borrow().now;
        let names = std::iter::once("sensor").chain(drive.services().iter().copied());
        let unit = |name| Unit { name, stage: Stage::Waiting(now), health: None, asked: false, restarts: 0 };
        Self {
            process,
            run,
            drive,
            units: names.map(unit).collect(),
            info: None,
            ear: process::input(bus, process, Topic::Health),
            map_info: process::input(bus, process, Topic::MapInfo),
            word: process::output(bus, process, Topic::Health, run, &[]),
            clean_at: None,
            looks_at: now,
            wants_stop: false,
            is_stopping: false,
            given: None,
        }
    }

    /// One look at everything: hears, and starts who is due.
    ///
    /// # Errors
    /// It died.
    pub(crate) fn turn(&mut self, world: &Shared, bus: &Bus, lives: &mut Vec<Life>, next: &mut u32) -> Result<()> {
        self.hear()?;
        let now = world.borrow().now;
        self.looks_at = now + LOOKS_EVERY;
        if self.clean_at.is_some_and(|at| at <= now) {
            self.clean_at = None;
            bus.clean();
        }
        let gone: Vec<String> =
            self.units.iter().filter(|unit| unit.stage == Stage::Done).map(|unit| unit.name.to_owned()).collect();
        for index in 0..self.units.len() {
            let unit = &mut self.units[index];
            if !matches!(unit.stage, Stage::Waiting(due) if due <= now && self.clean_at.is_none()) {
                continue;
            }
            ensure!(bus.lives(self.process), "the launcher died");
            *next += 1;
            let process = *next;
            (unit.stage, unit.health, unit.asked) = (Stage::Alive(process), None, false);
            world.borrow_mut().waits.entry(process).or_default();
            let (name, drive, run) = (unit.name, self.drive, self.run);
            let start = Start { world, bus, drive, run, unit: index, name, process, gone: &gone };
            match start.life() {
                Ok(life) => lives.push(life),
                Err(_) => {
                    bus.bury(process);
                    self.bury(index, &Exit::Failure, now)?;
                }
            }
        }
        if self.wants_stop && !self.is_stopping {
            self.stop(world);
        }
        Ok(())
    }

    /// Has the sensor end the stream, as soon as it gives one.
    fn stop(&mut self, world: &Shared) {
        let sensor = &mut self.units[0];
        let is_running = sensor.health.as_ref().is_some_and(|health| health.state == ServiceState::Running);
        if let (Stage::Alive(process), true) = (sensor.stage, is_running) {
            sensor.asked = true;
            self.is_stopping = true;
            world.borrow_mut().waits.entry(process).or_default().told.push(Told::Stop);
        }
    }

    fn hear(&mut self) -> Result<()> {
        let mut newcomers = false;
        while let Some(received) = self.ear.receive()? {
            let Received::Message(_, Message::Health(health)) = received else { continue };
            let mine = |unit: &&mut Unit| unit.name == health.service && unit.stage == Stage::Alive(health.pid);
            if let Some(unit) = self.units.iter_mut().find(mine) {
                newcomers |= unit.health.is_none();
                unit.health = Some(health);
            }
        }
        if newcomers {
            self.tell_who_is_gone()?;
        }
        while let Some(received) = self.map_info.receive()? {
            if let Received::Message(_, Message::Info(info)) = received {
                self.info = Some(info);
            }
        }
        Ok(())
    }

    /// A process has ended.
    ///
    /// # Errors
    /// The launcher died.
    pub(crate) fn ended(&mut self, index: usize, exit: &Exit, now: Duration, bus: &Bus) -> Result<()> {
        // Its last words may still be on their way: whoever waits hears them.
        while bus.has_mail(self.process) {
            self.hear()?;
        }
        self.bury(index, exit, now)
    }

    fn bury(&mut self, index: usize, exit: &Exit, now: Duration) -> Result<()> {
        let unit = &mut self.units[index];
        let state = unit.health.as_ref().map_or(ServiceState::Starting, |health| health.state);
        let may_leave = index == 0 || unit.asked || state > ServiceState::Running || believes_exit_codes();
        if (*exit == Exit::Success && may_leave) || state == ServiceState::Finished {
            unit.stage = Stage::Done;
            if index == 0 {
                self.given = unit.health.as_ref().map(|health| health.progress);
            }
            return self.tell_who_is_gone();
        }
        unit.restarts += 1;
        unit.stage = Stage::Waiting(now + BACKOFF * 2_u32.pow(unit.restarts.min(5) - 1));
        self.clean_at = Some(now + Duration::from_millis(20));
        Ok(())
    }

    fn tell_who_is_gone(&mut self) -> Result<()> {
        for unit in self.units.iter().filter(|unit| unit.stage == Stage::Done) {
            let gone = Health::new(unit.name, self.process, ServiceState::Gone);
            self.word.send(0, &Message::Health(gone))?;
        }
        Ok(self.word.ring()?)
    }

    /// Whether nobody is there any more.
    pub(crate) fn is_over(&self) -> bool {
        self.units.iter().all(|unit| unit.stage == Stage::Done)
    }

    /// When it wants to look next.
    pub(crate) fn due(&self) -> Duration {
        let starts = self.units.iter().filter_map(|unit| match unit.stage {
            Stage::Waiting(due) => Some(due),
            _ => None,
        });
        starts.chain(self.clean_at).fold(self.looks_at, Duration::min)
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
