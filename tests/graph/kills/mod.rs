//! Whatever is killed, stopped or told to end, whenever: every file is that of an undisturbed run, byte for byte.
//!
//! `ECHOGRID_KILLS` says how many faults each series makes (docs/reliability.md), `ECHOGRID_KILLS_SEED` which,
//! `ECHOGRID_KILLS_KIND` over which kind of runs alone.

mod kinds;
mod running;

use std::collections::BTreeMap;
use std::fmt;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use echogrid_harness::leftovers;
use echogrid_topics::Domain;
use kinds::{KINDS, Kind};
use nix::sys::signal::Signal;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use running::{LAUNCHER, Running};

use crate::support::{Drive, echogrid, path, said};

/// A run that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(900);
/// Metres.
const DRIVE_M: f64 = 10.0;

type Files = BTreeMap<String, Vec<u8>>;
/// The arguments of an undisturbed run, and what it writes; none before it was run, or where it can't be.
type Undisturbed = Option<(Vec<String>, Files)>;

fn files(folder: &Path) -> Files {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap())).collect()
}

/// What was done.
#[derive(Debug, Default, Clone, Copy)]
struct Count {
    runs: u64,
    resumptions: u64,
    kills: u64,
    launchers: u64,
    signals: u64,
    stops: u64,
}

impl Count {
    fn faults(&self) -> u64 {
        self.kills + self.launchers + self.signals + self.stops
    }
}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { runs, resumptions, kills, launchers, signals, stops } = self;
        write!(
            f,
            "{runs} runs, {resumptions} times resumed: {kills} services and {launchers} launchers killed, {signals} services told to \
             end, {stops} processes stopped"
        )
    }
}

struct Storm {
    random: ChaCha8Rng,
    seed: u64,
    count: Count,
    drive: Drive,
    is_spooled: bool,
}

impl Storm {
    fn new(is_spooled: bool) -> Self {
        let seed = number("ECHOGRID_KILLS_SEED").unwrap_or(1);
        let random = ChaCha8Rng::seed_from_u64(2 * seed + u64::from(is_spooled));
        Self { random, seed, count: Count::default(), drive: Drive::new(DRIVE_M), is_spooled }
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.random.next_u64() % limit
    }

    fn millis(&mut self, limit: u64) -> Duration {
        Duration::from_micros(self.below(1000 * limit))
    }

    fn name(&self) -> String {
        format!("{}{}-{}", if self.is_spooled { "r" } else { "s" }, self.seed, self.count.runs)
    }

    /// Rages until there were so many faults, over every kind of run in turn.
    fn rage(mut self, wanted: u64) {
        let only = std::env::var("ECHOGRID_KILLS_KIND").ok();
        let mut kinds: Vec<(&Kind, Undisturbed)> = KINDS
            .iter()
            .filter(|kind| only.as_deref().is_none_or(|only| only == kind.name))
            .map(|kind| (kind, None))
            .collect();
        for at in (0..kinds.len()).cycle() {
            if self.count.faults() >= wanted {
                break;
            }
            let (kind, known) = &mut kinds[at];
            let kind = *kind;
            if known.is_none() {
                *known = self.undisturbed(kind);
            }
            let Some((arguments, expected)) = known else { continue };
            let rate = kind.rates[self.below(kind.rates.len() as u64) as usize];
            self.run(kind, arguments, rate, expected);
        }
    }

    /// The arguments of such a run, and what it writes.
    fn undisturbed(&self, kind: &Kind) -> Undisturbed {
        let arguments = kind.arguments(&self.drive)?;
        let out = self.drive.out(kind.name);
        let output = echogrid(arguments.iter().cloned().chain(["--out".into(), path(&out)]));
        assert!(output.status.success(), "{}: {}", kind.name, said(&output));
        Some((arguments, files(&out)))
    }

    /// One run, over all its resumptions, in a folder of its own.
    fn run(&mut self, kind: &Kind, arguments: &[String], rate: &str, expected: &Files) {
        self.count.runs += 1;
        let name = self.name();
        let domain = Domain::named(&format!("k{}-{name}", std::process::id())).unwrap();
        let (out, spool) = (self.drive.out(&format!("{name}-maps")), self.drive.out(&format!("{name}-spool")));
        let mut whole = arguments.to_vec();
        whole.extend(["--out", &path(&out), "--domain", domain.name(), "--rate", rate, "--verbose"].map(str::to_owned));
        whole.extend(
            ["--set", "supervision.backoff_s=0", "--set", "supervision.restarts_max=100000"].map(str::to_owned),
        );
        if self.is_spooled {
            whole.extend(["--spool".to_owned(), path(&spool)]);
        }
        let mut faults = 1 + self.below(14);
        let (code, heard) = loop {
            let resumes = spool.join("run.toml").exists();
            let arguments: Vec<String> = whole.iter().cloned().chain(resumes.then(|| "--resume".to_owned())).collect();
            let mut running = Running::start(&arguments);
            self.disturb(&mut running, &mut faults);
            let (code, heard) = (running.end(), running.heard.join("\n"));
            match code {
                None => self.count.resumptions += 1,
                // It had come to its end, and was killed while it tidied up.
                Some(1) if resumes && heard.contains("no run to resume") => break (Some(0), heard),
                _ => break (code, heard),
            }
        };
        let what = format!("seed {}, run {} ({}, rate {rate})", self.seed, self.count.runs, kind.name);
        assert_eq!(code, Some(0), "{what}: {heard}");
        assert_eq!(leftovers(&domain), Vec::<String>::new(), "{what}: {heard}");
        assert!(!spool.exists(), "{what}: the spool is left\n{heard}");
        let found = files(&out);
        let names = |files: &Files| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&found), names(expected), "{what}: other files\n{heard}");
        let other: Vec<&String> = found.keys().filter(|name| found[*name] != expected[*name]).collect();
        assert!(other.is_empty(), "{what}: {other:?} differ\n{heard}");
        std::fs::remove_dir_all(&out).unwrap();
    }

    /// Has faults happen until the launcher is gone.
    fn disturb(&mut self, running: &mut Running, faults: &mut u64) {
        let begun = Instant::now();
        let mut patience = self.millis(150);
        while let Ok(started) = running.listen(patience) {
            assert!(begun.elapsed() < PATIENCE, "it hangs:\n{}", running.heard.join("\n"));
            patience = self.millis(150);
            // While there is nobody but the launcher, it is hit now and then.
            if *faults == 0 || !running.has_services() && self.below(8) > 0 {
                continue;
            }
            let victims = match started {
                // A process in its first milliseconds.
                Some(newborn) if self.below(2) == 0 => {
                    std::thread::sleep(self.millis(30));
                    vec![newborn]
                }
                Some(_) => continue,
                // One after the other, or several at once.
                None => {
                    let burst = [1, 1, 1, 2, 3][self.below(5) as usize];
                    let names = running.names();
                    (0..burst).map(|_| names[self.below(names.len() as u64) as usize].clone()).collect()
                }
            };
            for victim in victims {
                *faults = faults.saturating_sub(u64::from(self.strike(running, &victim)));
            }
        }
    }

    /// Kills, stops or signals somebody; whether anybody was there.
    fn strike(&mut self, running: &mut Running, victim: &str) -> bool {
        let is_launcher = victim == LAUNCHER;
        let count = &mut self.count;
        let (what, struck) = match self.random.next_u64() % 20 {
            0..=11 if is_launcher && self.is_spooled => (&mut count.launchers, running.signal(victim, Signal::SIGKILL)),
            0..=11 if !is_launcher => (&mut count.kills, running.signal(victim, Signal::SIGKILL)),
            12..=14 if !is_launcher => {
                let asks = [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP];
                (&mut count.signals, running.signal(victim, asks[self.random.next_u64() as usize % 3]))
            }
            number => {
                let pause = [5, 60, 300, 1500][number as usize % 4];
                (&mut count.stops, running.stop(victim, Duration::from_millis(self.random.next_u64() % pause)))
            }
        };
        *what += u64::from(struck);
        struck
    }
}

impl Drop for Storm {
    fn drop(&mut self) {
        let _ = writeln!(std::io::stderr(), "{}", self.count);
    }
}

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

#[test]
fn whatever_happens_to_services_changes_nothing() {
    Storm::new(false).rage(number("ECHOGRID_KILLS").unwrap_or(36));
}

#[test]
fn nor_does_what_happens_to_launchers_of_runs_that_are_resumed() {
    Storm::new(true).rage(number("ECHOGRID_KILLS").unwrap_or(36));
}
