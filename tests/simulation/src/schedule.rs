//! A whole run, or two in the same folder, of one seed: what happens, and what must come of it.

use std::fmt;

use echogrid_supervision::config::Strategy;

use crate::dice::Dice;
use crate::drive::Drive;
use crate::play::Play;

/// More than there are faults.
pub(crate) const RESTARTS_MAX: u32 = 1000;

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
    /// The launcher is killed when all is done and it removes what the run could be resumed from.
    KillTidying(u32),
    /// The launcher is stopped for so many milliseconds.
    StopLauncher(u32),
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
    pub(crate) drive: Drive,
    /// Another drive is mapped after it, in the same folder; and whether the first is left as soon as its launcher died.
    pub(crate) then: Option<(Drive, bool)>,
    pub(crate) late_permille: u32,
    /// How often a service may be restarted in a life of the launcher.
    pub(crate) restarts_max: u32,
    pub(crate) strategy: Strategy,
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
        let restarts_max = if dice.permille(150) { dice.below(2) as u32 } else { RESTARTS_MAX };
        let strategy = if dice.permille(100) { Strategy::RestForOne } else { Strategy::OneForOne };
        Self { seed, drive, then, late_permille, restarts_max, strategy, faults }
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
        let Self { seed, drive, then, late_permille, restarts_max, strategy, faults } = self;
        writeln!(
            f,
            "seed {seed}: {drive:?}, then {then:?}, {late_permille} of 1000 messages late, {strategy:?}, at most {restarts_max} restarts"
        )?;
        faults.iter().try_for_each(|(turn, what)| writeln!(f, "  turn {turn}: {what:?}"))
    }
}

fn draw(dice: &mut Dice, last: usize) -> (u32, What) {
    let turn = dice.below(last) as u32;
    let victim = dice.below(5);
    let what = match dice.below(21) {
        0..=8 => What::Kill(victim, dice.below(60) as u32),
        9..=11 => What::Terminate(victim),
        12..=14 => What::Stop(victim, [5, 100, 700, 4000][dice.below(4)]),
        15..=16 => What::KillLauncher(dice.below(60) as u32),
        17 => What::PowerFails,
        18 => What::DiskFull([10, 300, 1500][dice.below(3)]),
        19 => What::UserStops,
        _ => What::StopLauncher([100, 700, 4000][dice.below(3)]),
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
