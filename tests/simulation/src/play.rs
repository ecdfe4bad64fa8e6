//! A schedule that is played: whose turn it is, what goes wrong, and whether what comes of it is what must.

use std::cell::RefCell;
use std::rc::Rc;
use std::task::Poll;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_service::host::Told;
use echogrid_service::signals::Caught;
use echogrid_supervision::config::SupervisionConfig;
use echogrid_supervision::{Stage, Unit};
use echogrid_topics::ServiceState;
use echogrid_topics::memory::Bus;
use nix::sys::signal::Signal;

use crate::drive::Drive;
use crate::launcher::{Launcher, open_spool};
use crate::process::Life;
use crate::reference::{self, Ended};
use crate::schedule::{Failure, Played, RESTARTS_MAX, Schedule, What};
use crate::world::{Chance, Shared, World};

/// A run has come to its end by then, whatever happened.
const TURNS_MAX: u32 = 60_000;
/// A service has left by then when its launcher is gone.
const LEAVES_WITHIN: Duration = Duration::from_millis(1500);

/// How a launcher's life ended.
enum Over {
    /// Exit code 0.
    Done(Box<Ended>, Given),
    /// Exit code 1, for a reason that the schedule gave.
    Failed,
    /// Killed, or the power failed.
    Died,
}

/// What the sensor gave of its drive before the run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Given {
    All,
    /// So many messages, as the user ended the run.
    Only(u64),
    /// The user ended the run, and no sensor came back to end it: the streams end where they happened to be.
    Unknown,
}

pub(crate) struct Play<'a> {
    schedule: &'a Schedule,
    world: Shared,
    bus: Bus,
    lives: Vec<Life>,
    next_process: u32,
    next_fault: usize,
    /// The launcher was killed while it tidied up.
    was_tidying: bool,
    /// The run that is played.
    run: u64,
    /// The user ended it, in any life of its launcher.
    is_stopped: bool,
    /// It failed, as a service died too often.
    has_failed: bool,
    played: Played,
}

impl<'a> Play<'a> {
    pub(crate) fn new(schedule: &'a Schedule) -> Self {
        let world = Rc::new(RefCell::new(World::new(schedule.seed, schedule.late_permille, Instant::now())));
        let bus = Bus::new(Box::new(Chance(world.clone())));
        Self {
            schedule,
            world,
            bus,
            lives: Vec::new(),
            next_process: 100,
            next_fault: 0,
            was_tidying: false,
            run: 0,
            is_stopped: false,
            has_failed: false,
            played: Played::default(),
        }
    }

    pub(crate) fn play(mut self) -> Result<Played, Failure> {
        let mut drives = vec![self.schedule.drive];
        drives.extend(self.schedule.then.map(|(drive, _)| drive));
        for (place, drive) in drives.iter().enumerate() {
            self.world.borrow_mut().disk.map = None;
            loop {
                match self.launch(*drive)? {
                    Over::Died if place == 0 && self.schedule.then.is_some_and(|(_, at_once)| at_once) => break,
                    Over::Died | Over::Failed => {}
                    Over::Done(ended, given) => {
                        self.judge(*drive, &ended, given)?;
                        break;
                    }
                }
            }
        }
        self.played.simulated_ms = self.world.borrow().now.as_millis() as u64;
        Ok(self.played)
    }

    /// Whether a run that ended well came to what it must.
    fn judge(&self, drive: Drive, ended: &Ended, given: Given) -> Result<(), Failure> {
        let world = self.world.borrow();
        let left = (world.disk.run_file, world.disk.stores.keys().collect::<Vec<_>>());
        if left.0.is_some() || !left.1.is_empty() {
            return Err(Failure(format!("left in the spool: {left:?}")));
        }
        let messages = match given {
            Given::All => drive.messages().len(),
            Given::Only(messages) => messages as usize,
            Given::Unknown => return Ok(()),
        };
        let expected = reference::of(drive, messages).map_err(|error| Failure(format!("no reference: {error:#}")))?;
        if ended.map != expected.map {
            let bytes =
                |map: &Option<Vec<u8>>| map.as_ref().map_or("no map".to_owned(), |map| format!("{} bytes", map.len()));
            let (is, must) = (bytes(&ended.map), bytes(&expected.map));
            return Err(Failure(format!("another map with exit code 0: {is}, expected {must} of {messages} messages")));
        }
        if ended.info != expected.info {
            return Err(Failure(format!("another summary: {:?}, expected {:?}", ended.info, expected.info)));
        }
        Ok(())
    }

    /// A life of the launcher, from its start to its end.
    fn launch(&mut self, drive: Drive) -> Result<Over, Failure> {
        self.next_process += 1;
        let process = self.next_process;
        self.world.borrow_mut().waits.entry(process).or_default();
        // Another domain: nothing of those before is in it.
        self.bus = Bus::new(Box::new(Chance(self.world.clone())));
        let Ok(run) = open_spool(&self.world, process, drive) else { return Ok(self.launcher_died(process)) };
        if run != self.run {
            (self.run, self.is_stopped, self.has_failed) = (run, false, false);
            // What lies there is of an earlier run, and the real launcher tells it from its own.
            self.world.borrow_mut().disk.map = None;
        }
        let config = SupervisionConfig {
            // Whoever resumes a run that failed so has mended the cause.
            restarts_max: if self.has_failed { RESTARTS_MAX } else { self.schedule.restarts_max },
            strategy: self.schedule.strategy,
            ..SupervisionConfig::default()
        };
        let broken = |error: anyhow::Error| Failure(format!("{error:#}"));
        let mut launcher = Launcher::new(&self.world, &self.bus, process, drive, run, &config).map_err(broken)?;
        let saves = self.world.borrow().disk.saves;
        while !launcher.services.is_over() {
            self.played.turns += 1;
            if self.played.turns > TURNS_MAX {
                return Err(Failure(self.who_hangs(&launcher)));
            }
            let lives = self.strike(&mut launcher) && self.turn(&mut launcher).is_ok();
            if let Some(blamed) = launcher.blamed {
                return Err(Failure(format!("taken for hanging, and nobody hangs here: {blamed}")));
            }
            self.is_stopped |= launcher.services.stopped;
            if !lives {
                return Ok(self.launcher_died(process));
            }
        }
        self.end(launcher, saves)
    }

    /// What the launcher does when nobody is there any more.
    fn end(&mut self, mut launcher: Launcher, saves: u32) -> Result<Over, Failure> {
        let services = &launcher.services;
        let healths = services.units.iter().filter_map(|unit| unit.health.as_ref());
        if let Some(health) = healths.into_iter().find(|health| health.lost > 0 || health.faults > 0) {
            let (service, lost, faults) = (&health.service, health.lost, health.faults);
            return Err(Failure(format!("{service} lost {lost} messages and refused {faults}")));
        }
        if let Some(cause) = services.failures.first().or(services.killed.first()) {
            // A service that died too often, the sensor while the user ended the run, or no room at the end.
            let was_full = self.schedule.faults.iter().any(|(_, what)| matches!(what, What::DiskFull(_)));
            let is_refused = was_full && cause.contains("starting it again would not help");
            let is_due = cause.contains("supervision.restarts_max") || self.is_stopped || is_refused;
            self.has_failed = true;
            return if is_due { Ok(Over::Failed) } else { Err(Failure(format!("exit code 1: {cause}"))) };
        }
        let sensor = services.units.iter().find(|unit| unit.is_source());
        let last = sensor.filter(|sensor| sensor.stage == Stage::Done).and_then(|sensor| sensor.health.as_ref());
        let given = match last.filter(|health| health.state == ServiceState::Finished) {
            _ if !self.is_stopped => Given::All,
            Some(health) => Given::Only(health.progress),
            None => Given::Unknown,
        };
        let map = self.world.borrow().disk.map.clone();
        let was_mapped = launcher.info.as_ref().is_some_and(|info| info.cells_known > 0);
        if was_mapped && self.world.borrow().disk.saves == saves {
            // The launcher says so and exits with 1. Nobody hindered it, unless the user ended the run while the sensor was dead.
            return match given {
                Given::Unknown => Ok(Over::Failed),
                _ => Err(Failure("cells were mapped, and no map was saved".into())),
            };
        }
        let tidying = self.schedule.faults.iter().find_map(|(_, what)| match what {
            What::KillTidying(after) if !self.was_tidying => Some(*after),
            _ => None,
        });
        let process = launcher.process;
        if let Some(after) = tidying {
            self.was_tidying = true;
            self.world.borrow_mut().doomed.insert(process, after);
        }
        if launcher.tidy_up(&self.world).is_err() {
            return Ok(self.launcher_died(process));
        }
        Ok(Over::Done(Box::new(Ended { map, info: launcher.info.take() }), given))
    }

    /// Somebody's turn.
    fn turn(&mut self, launcher: &mut Launcher) -> Result<()> {
        let mut ready: Vec<Option<usize>> = Vec::new();
        {
            let world = self.world.borrow();
            for (place, life) in self.lives.iter().enumerate() {
                let Some(wait) = world.waits.get(&life.process) else { continue };
                let is_woken = wait.until <= world.now
                    || wait.is_late
                    || wait.orphaned
                    || !wait.told.is_empty()
                    || self.bus.rung(life.process) != life.rung;
                if is_woken && world.stopped_until(life.process) <= world.now {
                    ready.push(Some(place));
                }
            }
            let is_due = launcher.due(&self.world) <= world.now || self.bus.has_mail(launcher.process);
            if (world.has_ended || is_due) && world.stopped_until(launcher.process) <= world.now {
                ready.push(None);
            }
        }
        if ready.is_empty() {
            self.pass_time(launcher);
            return Ok(());
        }
        let chosen = {
            let mut world = self.world.borrow_mut();
            // Everything takes a little while, and now and then a long one.
            let passed = if world.dice.permille(20) { 200 } else { world.dice.below(3) as u64 };
            world.now += Duration::from_millis(passed);
            let chosen = world.dice.below(ready.len());
            ready[chosen]
        };
        match chosen {
            None => {
                let mut world = self.world.borrow_mut();
                world.give_turn(launcher.process);
                world.has_ended = false;
                drop(world);
                launcher.turn(&self.world, &self.bus, &mut self.lives, &mut self.next_process)
            }
            Some(place) => {
                self.run(place);
                Ok(())
            }
        }
    }

    /// One turn of a service; whether it has ended.
    fn run(&mut self, place: usize) -> bool {
        let life = &mut self.lives[place];
        let process = life.process;
        life.rung = self.bus.rung(process);
        self.world.borrow_mut().give_turn(process);
        let turn = life.turn();
        let is_dead = self.world.borrow().dead.contains(&process);
        self.played.deaths += u32::from(is_dead);
        let end = match turn {
            Poll::Ready(end) => end,
            Poll::Pending if is_dead => Ok(()),
            Poll::Pending => return false,
        };
        self.lives.remove(place);
        self.bus.bury(process);
        self.world.borrow_mut().note_end(process, &end);
        true
    }

    /// Nobody has anything to do before that.
    fn pass_time(&mut self, launcher: &Launcher) {
        let due = launcher.due(&self.world);
        let mut world = self.world.borrow_mut();
        let due = due.max(world.stopped_until(launcher.process));
        let of_lives = self.lives.iter().filter_map(|life| world.waits.get(&life.process));
        let next = of_lives.map(|wait| wait.until.max(wait.stopped_until)).fold(due, Duration::min);
        world.now = world.now.max(next);
    }

    /// What goes wrong at this turn; whether the launcher is still there.
    fn strike(&mut self, launcher: &mut Launcher) -> bool {
        while let Some((turn, what)) = self.schedule.faults.get(self.next_fault) {
            if *turn > self.played.turns {
                break;
            }
            self.next_fault += 1;
            let of_unit = |unit: usize| launcher.services.units.get(unit).and_then(Unit::alive).map(|life| life.pid());
            let mut world = self.world.borrow_mut();
            match *what {
                What::Kill(unit, after) => {
                    of_unit(unit).into_iter().for_each(|process| {
                        world.doomed.insert(process, after);
                    });
                }
                What::Terminate(unit) => {
                    let told = Told::Leave(Caught { signal: Signal::SIGTERM, sender: 1 });
                    let process = of_unit(unit);
                    process.into_iter().for_each(|process| world.waits.entry(process).or_default().told.push(told));
                }
                What::Stop(unit, millis) => {
                    of_unit(unit).into_iter().for_each(|process| world.stop(process, millis));
                }
                What::StopLauncher(millis) => world.stop(launcher.process, millis),
                What::DiskFull(millis) => world.disk.full_until = world.now + Duration::from_millis(millis.into()),
                What::UserStops if !launcher.drive.is_live() => launcher.wants_stop = true,
                What::KillLauncher(after) => {
                    world.doomed.insert(launcher.process, after);
                }
                What::PowerFails => {
                    drop(world);
                    self.lose_power();
                    return false;
                }
                What::UserStops | What::KillTidying(_) => {}
            }
        }
        true
    }

    fn lose_power(&mut self) {
        self.lives.drain(..).for_each(|life| self.bus.bury(life.process));
        let world = &mut *self.world.borrow_mut();
        world.disk.lose_power(|| world.dice.permille(500));
    }

    /// Those that are left notice it, and leave soon.
    fn launcher_died(&mut self, process: u32) -> Over {
        self.played.launchers += 1;
        self.bus.bury(process);
        let until = self.world.borrow().now + LEAVES_WITHIN;
        for life in &self.lives {
            self.world.borrow_mut().waits.entry(life.process).or_default().orphaned = true;
        }
        while !self.lives.is_empty() && self.world.borrow().now < until {
            let place = {
                let mut world = self.world.borrow_mut();
                world.now += Duration::from_millis(5);
                world.dice.below(self.lives.len())
            };
            let process = self.lives[place].process;
            let is_stopped = {
                let world = self.world.borrow();
                world.stopped_until(process) > world.now
            };
            if !is_stopped {
                self.run(place);
            }
        }
        self.lives.drain(..).for_each(|life| self.bus.bury(life.process));
        Over::Died
    }

    fn who_hangs(&self, launcher: &Launcher) -> String {
        let services = &launcher.services;
        let units = services.units.iter().map(|unit| {
            let said = unit
                .health
                .as_ref()
                .map(|health| (health.state, health.progress, health.waits_for, &health.last_error));
            format!("{} {:?} {said:?}", unit.name, unit.stage)
        });
        format!(
            "no end after {TURNS_MAX} turns, {:?}: {}; {:?}, killed {:?}",
            self.world.borrow().now,
            units.collect::<Vec<_>>().join("; "),
            services.failures,
            services.killed
        )
    }
}
