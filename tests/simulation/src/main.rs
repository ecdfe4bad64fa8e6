//! `echogrid-simulation`: plays seeds, and shrinks those that fail.

use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use echogrid_service::mutants::{Mutant, put_back};
use echogrid_simulation::{Schedule, shrink};

const USAGE: &str =
    "usage: echogrid-simulation [--seeds COUNT] [--from SEED] [--seed SEED [--keep 0,3,…]] [--mutant NAME]
  --seeds COUNT   plays so many seeds, and stops at the first that fails
  --seed SEED     plays this one, and leaves out what it fails without
  --keep PLACES   only these of its faults
  --mutant NAME   with this fault put back:";

#[derive(Debug, Default)]
struct Arguments {
    seeds: Option<u64>,
    from: u64,
    seed: Option<u64>,
    keep: Option<Vec<usize>>,
    mutant: Option<Mutant>,
}

fn arguments() -> Result<Arguments> {
    let mut all = std::env::args().skip(1);
    let mut arguments = Arguments::default();
    while let Some(flag) = all.next() {
        let value = all.next().with_context(|| format!("{flag}: a value is missing"))?;
        let number = || value.parse::<u64>().with_context(|| format!("{flag} {value:?}: expected a number"));
        match flag.as_str() {
            "--seeds" => arguments.seeds = Some(number()?),
            "--from" => arguments.from = number()?,
            "--seed" => arguments.seed = Some(number()?),
            "--keep" => {
                let places = value.split(',').filter(|place| !place.is_empty()).map(str::parse);
                arguments.keep = Some(places.collect::<Result<_, _>>().context("--keep: expected places")?);
            }
            "--mutant" => {
                let known = Mutant::ALL.iter().find(|(_, name)| *name == value);
                arguments.mutant = Some(known.with_context(|| format!("no mutant {value:?}"))?.0);
            }
            _ => bail!("{flag}: not known"),
        }
    }
    Ok(arguments)
}

fn main() -> ExitCode {
    match arguments() {
        Ok(arguments) => run(&arguments),
        Err(error) => {
            let names: Vec<&str> = Mutant::ALL.iter().map(|(_, name)| *name).collect();
            eprintln!("{error:#}\n{USAGE} {}", names.join(", "));
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> ExitCode {
    put_back(arguments.mutant);
    if let Some(seed) = arguments.seed {
        return one(seed, arguments.keep.as_deref());
    }
    let begun = Instant::now();
    let (from, count) = (arguments.from, arguments.seeds.unwrap_or(1000));
    let (mut turns, mut deaths, mut launchers) = (0_u64, 0_u64, 0_u64);
    for seed in from..from + count {
        match Schedule::of(seed).play() {
            Ok(played) => {
                turns += u64::from(played.turns);
                deaths += u64::from(played.deaths);
                launchers += u64::from(played.launchers);
            }
            Err(failure) => {
                eprintln!("seed {seed} fails after {} seeds: {}", seed - from + 1, failure.0);
                return one(seed, None);
            }
        }
    }
    let seconds = begun.elapsed().as_secs_f64();
    eprintln!(
        "{count} schedules from seed {from}: none fails; {deaths} services and {launchers} launchers died; {turns} turns; \
         {seconds:.1} s, {:.2} s per thousand",
        1000.0 * seconds / count as f64
    );
    ExitCode::SUCCESS
}

/// Plays one seed, and tells what it needs to fail.
fn one(seed: u64, keep: Option<&[usize]>) -> ExitCode {
    let whole = Schedule::of(seed);
    let schedule = keep.map_or_else(|| whole.clone(), |keep| whole.keeping(keep));
    eprint!("{schedule}");
    let Some((kept, failure)) = shrink(&schedule) else {
        eprintln!("passes");
        return ExitCode::SUCCESS;
    };
    let places = kept.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
    eprintln!("fails: {}\nit needs (--seed {seed} --keep {places:?}):\n{}", failure.0, schedule.keeping(&kept));
    ExitCode::FAILURE
}
