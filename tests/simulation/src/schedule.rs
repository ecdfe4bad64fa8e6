//! A whole run, or two in the same folder, of one seed: what happens, and what must come of it.

use std::cell::RefCell;
use std::fmt;
use std::rc::Rc;
use std::task::Poll;
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_service::host::Told;
use echogrid_service::signals::Caught;
use echogrid_topics::memory::Bus;
use nix::sys::signal::Signal;

use crate::dice::Dice;
use crate::drive::Drive;
use crate::launcher::{Exit, Launcher, Stage, open_spool};
use crate::process::Life;
use crate::reference::{self, Ended};
use crate::world::{Chance, Shared, World};

/// A run has come to its end by then, whatever happened.
const TURNS_MAX: u32 = 60_000;
/// A service has left by then when its launcher is gone.
const LEAVES_WITHIN: Duration = Duration::from_millis(1500);

/// Something that goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// A service is killed, when it has done so many more things.
    Kill(usize, u32),
    /// A stranger asks a service to end (SIGTERM).
    Terminate(usize),
    /// A service is stopped for so many milliseconds (SIGSTOP).
    Stop(usize, u32),
    /// The launcher is killed, when it has done so many more things.
    KillLauncher(u32),
    /// Likewise, when all is done and it removes what the run could be resumed from.
    KillTidying(u32),
    /// All dies at once, and the disk loses what was not synced.
    PowerFails,
    /// The disk is full for so many milliseconds.
    DiskFull(u32),
    /// The user ends the run.
    UserStops,
}

/// A seed, spelled out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schedule {
    /// What it was drawn from, and what is drawn while it runs.
    pub seed: u64,
    drive: Drive,
    /// Another drive is mapped after it, in the same folder; and whether the first is left as soon as its launcher died.
    then: Option<(Drive, bool)>,
    late_permille: u32,
    /// What goes wrong, at which turn.
    pub faults: Vec<(u32, What)>,
}

impl Schedule {
    /// The schedule of a seed.
    #[must_use]
    pub fn of(seed: u64) -> Self {
        let mut dice = Dice::new(seed ^ 0x5EED);
        let drive = Drive::ALL[dice.below(Drive::ALL.len())];
        let another = Drive::ALL[dice.below(Drive::ALL.len())];
        let then = dice.permille(150).then(|| (another, dice.permille(700)));
        let late_permille = [0, 100, 400][dice.below(3)];
        let count = dice.below(8);
        let last = [60, 200, 500][dice.below(3)];
        let mut faults: Vec<(u32, What)> = (0..count).map(|_| draw(&mut dice, last)).collect();
        if dice.permille(100) {
            faults.push((u32::MAX, What::KillTidying(dice.below(7) as u32)));
        }
        faults.sort_by_key(|(turn, _)| *turn);
        Self { seed, drive, then, late_permille, faults }
    }

    /// Without one of its faults.
    #[must_use]
    pub fn without(&self, index: usize) -> Self {
        let mut fewer = self.clone();
        fewer.faults.remove(index);
        fewer
    }

    /// With only those of its faults, by their places in the whole.
    #[must_use]
    pub fn keeping(&self, kept: &[usize]) -> Self {
        let faults = self.faults.iter().enumerate().filter(|(index, _)| kept.contains(index));
        Self { faults: faults.map(|(_, fault)| *fault).collect(), ..self.clone() }
    }

    /// Plays it.
    ///
    /// # Errors
    /// What came of it is not what must.
    pub fn play(&self) -> Result<Played, Failure> {
        Play::new(self).play()
    }
}

impl fmt::Display for Schedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seed, drive, then, late_permille, faults } = self;
        writeln!(f, "seed {seed}: {drive:?}, then {then:?}, {late_permille} of 1000 messages late")?;
        faults.iter().try_for_each(|(turn, what)| writeln!(f, "  turn {turn}: {what:?}"))
    }
}

fn draw(dice: &mut Dice, last: usize) -> (u32, What) {
    let turn = dice.below(last) as u32;
    let victim = dice.below(5);
    let what = match dice.below(20) {
        0..=8 => What::Kill(victim, dice.below(60) as u32),
        9..=11 => What::Terminate(victim),
        12..=14 => What::Stop(victim, [5, 100, 700, 4000][dice.below(4)]),
        15..=16 => What::KillLauncher(dice.below(60) as u32),
        17 => What::PowerFails,
        18 => What::DiskFull([10, 300, 1500][dice.below(3)]),
        _ => What::UserStops,
    };
    (turn, what)
}

/// What a schedule came to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Played {
    /// Turns of all processes.
    pub turns: u32,
    /// Processes that died of a fault.
    pub deaths: u32,
    /// Launchers that did.
    pub launchers: u32,
    /// Time that passed in it, milliseconds.
    pub simulated_ms: u64,
}

/// What must not be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure(pub String);

/// How a launcher's life ended.
enum Over {
    /// Exit code 0.
    Done(Box<Ended>, Option<u64>),
    /// Killed, or the power failed.
    Died,
}

struct Play<'a> {
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
    played: Played,
}

impl<'a> Play<'a> {
    fn new(schedule: &'a Schedule) -> Self {
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
            played: Played::default(),
        }
    }

    fn play(mut self) -> Result<Played, Failure> {
        let mut drives = vec![self.schedule.drive];
        drives.extend(self.schedule.then.map(|(drive, _)| drive));
        for (place, drive) in drives.iter().enumerate() {
            self.world.borrow_mut().disk.map = None;
            loop {
                match self.launch(*drive)? {
                    Over::Died if place == 0 && self.schedule.then.is_some_and(|(_, at_once)| at_once) => break,
                    Over::Died => {}
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
    fn judge(&self, drive: Drive, ended: &Ended, given: Option<u64>) -> Result<(), Failure> {
        let messages = given.map_or_else(|| drive.messages().len(), |given| given as usize);
        let expected = reference::of(drive, messages).map_err(|error| Failure(format!("no reference: {error:#}")))?;
        let world = self.world.borrow();
        let left = (world.disk.run_file, world.disk.stores.keys().collect::<Vec<_>>());
        if left.0.is_some() || !left.1.is_empty() {
            return Err(Failure(format!("left in the spool: {left:?}")));
        }
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
            (self.run, self.is_stopped) = (run, false);
            // What lies there is of an earlier run, and the real launcher tells it from its own.
            self.world.borrow_mut().disk.map = None;
        }
        let mut launcher = Launcher::new(&self.world, &self.bus, process, drive, run);
        while !launcher.is_over() {
            self.played.turns += 1;
            if self.played.turns > TURNS_MAX {
                return Err(Failure(self.who_hangs(&launcher)));
            }
            if !self.strike(&mut launcher) {
                self.is_stopped |= launcher.is_stopping;
                return Ok(self.launcher_died(process));
            }
            if self.turn(&mut launcher).is_err() {
                self.is_stopped |= launcher.is_stopping;
                return Ok(self.launcher_died(process));
            }
        }
        self.is_stopped |= launcher.is_stopping;
        let healths = launcher.units.iter().filter_map(|unit| unit.health.as_ref());
        if let Some(health) = healths.into_iter().find(|health| health.lost > 0 || health.faults > 0) {
            let (service, lost, faults) = (&health.service, health.lost, health.faults);
            return Err(Failure(format!("{service} lost {lost} messages and refused {faults}")));
        }
        let given = launcher.given.filter(|_| self.is_stopped);
        let map = self.world.borrow().disk.map.clone();
        if map.is_none() && launcher.info.as_ref().is_some_and(|info| info.cells_known > 0) {
            // The launcher says so and exits with 1: what was mapped is not on the disk, and nobody hindered it.
            return Err(Failure("cells were mapped, and no map was saved".into()));
        }
        let tidying = self.schedule.faults.iter().find_map(|(_, what)| match what {
            What::KillTidying(after) if !self.was_tidying => Some(*after),
            _ => None,
        });
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
                if is_woken && wait.stopped_until <= world.now {
                    ready.push(Some(place));
                }
            }
            if launcher.due() <= world.now || self.bus.has_mail(launcher.process) {
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
                self.world.borrow_mut().give_turn(launcher.process);
                launcher.turn(&self.world, &self.bus, &mut self.lives, &mut self.next_process)
            }
            Some(place) => match self.run(place) {
                None => Ok(()),
                Some(exit) => {
                    let life = self.lives.remove(place);
                    self.bus.bury(life.process);
                    self.world.borrow_mut().give_turn(launcher.process);
                    let now = self.world.borrow().now;
                    launcher.ended(life.unit, &exit, now, &self.bus)
                }
            },
        }
    }

    /// One turn of a service; how it ended, if it did.
    fn run(&mut self, place: usize) -> Option<Exit> {
        let life = &mut self.lives[place];
        life.rung = self.bus.rung(life.process);
        self.world.borrow_mut().give_turn(life.process);
        let end = life.turn();
        let is_dead = self.world.borrow().dead.contains(&life.process);
        match end {
            _ if is_dead => {
                self.played.deaths += 1;
                Some(Exit::Failure)
            }
            Poll::Pending => None,
            Poll::Ready(Ok(())) => Some(Exit::Success),
            Poll::Ready(Err(_)) => Some(Exit::Failure),
        }
    }

    /// Nobody has anything to do before that.
    fn pass_time(&mut self, launcher: &Launcher) {
        let mut world = self.world.borrow_mut();
        let of_lives = self.lives.iter().filter_map(|life| world.waits.get(&life.process));
        let next = of_lives.map(|wait| wait.until.max(wait.stopped_until)).fold(launcher.due(), Duration::min);
        world.now = world.now.max(next);
    }

    /// What goes wrong at this turn; whether the launcher is still there.
    fn strike(&mut self, launcher: &mut Launcher) -> bool {
        while let Some((turn, what)) = self.schedule.faults.get(self.next_fault) {
            if *turn > self.played.turns {
                break;
            }
            self.next_fault += 1;
            let of_unit = |unit: usize| match launcher.units.get(unit).map(|unit| unit.stage) {
                // What it had given is the whole then: nobody would ask the next one to end.
                Some(Stage::Alive(process)) if unit > 0 || !launcher.wants_stop => Some(process),
                _ => None,
            };
            let mut world = self.world.borrow_mut();
            let now = world.now;
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
                    let until = now + Duration::from_millis(millis.into());
                    let process = of_unit(unit);
                    process
                        .into_iter()
                        .for_each(|process| world.waits.entry(process).or_default().stopped_until = until);
                }
                What::DiskFull(millis) => world.disk.full_until = now + Duration::from_millis(millis.into()),
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
                world.waits.get(&process).is_some_and(|wait| wait.stopped_until > world.now)
            };
            if !is_stopped && self.run(place).is_some() {
                self.lives.remove(place);
                self.bus.bury(process);
            }
        }
        self.lives.drain(..).for_each(|life| self.bus.bury(life.process));
        Over::Died
    }

    fn who_hangs(&self, launcher: &Launcher) -> String {
        let units = launcher.units.iter().map(|unit| {
            let said = unit.health.as_ref().map(|health| (health.state, health.progress, health.waits_for));
            format!("{} {:?} {said:?}", unit.name, unit.stage)
        });
        format!("no end after {TURNS_MAX} turns: {}", units.collect::<Vec<_>>().join("; "))
    }
}
