//! Schedules that nobody would wait for: none comes to another map, and every fault that was mended is found when it is back.

#![allow(clippy::panic, reason = "tests")]

use echogrid_service::mutants::{Mutant, put_back};
use echogrid_simulation::{Schedule, shrink};

/// How many seeds are played on each processor; `ECHOGRID_SCHEDULES` says how many in all.
fn schedules() -> u64 {
    std::env::var("ECHOGRID_SCHEDULES").ok().and_then(|count| count.parse().ok()).unwrap_or(2000)
}

#[test]
fn no_order_of_events_ends_with_another_map() {
    let threads = std::thread::available_parallelism().map_or(1, |count| count.get() as u64).min(8);
    let play = |first: u64| {
        let mut deaths = 0;
        for seed in (first..schedules()).step_by(threads as usize) {
            let schedule = Schedule::of(seed);
            match schedule.play() {
                Ok(played) => deaths += u64::from(played.deaths + played.launchers),
                Err(failure) => panic!("{schedule}{}: cargo run -p echogrid-simulation -- --seed {seed}", failure.0),
            }
        }
        deaths
    };
    let deaths: u64 = std::thread::scope(|scope| {
        let players: Vec<_> = (0..threads).map(|first| scope.spawn(move || play(first))).collect();
        players.into_iter().map(|player| player.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))).sum()
    });
    assert!(deaths * 2 > schedules(), "hardly anybody died: {deaths}");
}

#[test]
fn a_seed_gives_the_same_each_time() {
    for seed in 0..20 {
        assert_eq!(Schedule::of(seed).play(), Schedule::of(seed).play(), "seed {seed}");
    }
}

#[test]
fn every_mended_fault_is_found_within_a_thousand_seeds() {
    for (mutant, name) in Mutant::ALL {
        put_back(Some(mutant));
        let found = (0..1000).map(Schedule::of).find(|schedule| schedule.play().is_err());
        let Some(schedule) = found else { panic!("{name} is not found") };
        // What is left still fails, and is no more than it was.
        let (kept, _) = shrink(&schedule).unwrap_or_else(|| panic!("{name}: seed {} passes now", schedule.seed));
        assert!(kept.len() <= schedule.faults.len());
        put_back(None);
        assert!(schedule.play().is_ok(), "{name}: seed {} fails without it, too", schedule.seed);
    }
}
