//! How long after an echo was sent a tile with it can be read, beside what as many wake-ups of threads cost that do nothing else.
//!
//! ```sh
//! cargo build --release --example latency
//! target/release/echogrid up launch/graphs/map.toml --sensor target/release/examples/latency --rate 1 --out /tmp/latency
//! ```
//!
//! It is a live sensor of 25 rings per second for 20 s that looks on at `map/tiles` in a thread of its own. What it measured is said
//! when the run ends: middle and 99 % of the rings, microseconds.

#[path = "random_walk.rs"]
#[allow(dead_code)] // its `main`
mod random_walk;

use std::collections::BTreeMap;
use std::io::{PipeReader, PipeWriter, Read, Write, pipe};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_service::{Sensor, process};
use echogrid_topics::{Domain, Input, Message, Participant, Received, Topic};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use random_walk::{OUTPUTS, RandomWalk};

const RINGS: u64 = 500;
const EVERY: Duration = Duration::from_millis(40);
/// Processes that a ring passes on its way: odometry, mapper, and who reads the tile.
const WAKE_UPS: usize = 3;

/// When each ring was sent.
type Sent = Arc<Mutex<BTreeMap<u64, Instant>>>;

struct Latency {
    walk: RandomWalk,
    sent: Sent,
    rings: u64,
    due: Instant,
    reader: Option<JoinHandle<Result<Vec<Duration>>>>,
}

impl Latency {
    fn begin(domain: &Domain) -> Self {
        let sent = Sent::default();
        let (domain, of_reader) = (domain.clone(), Arc::clone(&sent));
        let reader = spawn(move || read_tiles(&domain, &of_reader));
        Self { walk: RandomWalk::new(), sent, rings: 0, due: Instant::now() + EVERY, reader: Some(reader) }
    }
}

impl Sensor for Latency {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn is_live(&self) -> bool {
        true
    }

    fn is_ready(&mut self) -> Result<bool> {
        let wait = self.due.saturating_duration_since(Instant::now());
        sleep(wait.min(EVERY));
        Ok(Instant::now() >= self.due)
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        let message = self.walk.next()?;
        if let Some((_, Message::Scan(_))) = &message {
            self.rings += 1;
            self.due += EVERY;
            self.sent.lock().unwrap_or_else(PoisonError::into_inner).insert(self.rings, Instant::now());
        }
        Ok(message.filter(|_| self.rings <= RINGS))
    }

    fn close(&mut self) {
        // No ring: the reader has seen all.
        self.sent.lock().unwrap_or_else(PoisonError::into_inner).insert(u64::MAX, Instant::now());
        let measured = self.reader.take().map(JoinHandle::join);
        match measured {
            Some(Ok(Ok(took))) => eprintln!("echo to tile: {}", summary(took)),
            Some(Ok(Err(error))) => eprintln!("nothing was measured: {error:#}"),
            _ => eprintln!("nothing was measured"),
        }
        match bare_wake_ups() {
            Ok(took) => eprintln!("{WAKE_UPS} bare wake-ups: {}", summary(took)),
            Err(error) => eprintln!("no bare wake-ups: {error}"),
        }
    }
}

/// Of each ring, how long it took until the first tile that knows it could be read.
fn read_tiles(domain: &Domain, sent: &Sent) -> Result<Vec<Duration>> {
    let participant = Participant::join(domain, "latency-reader")?;
    let mut tiles = Input::open(&participant, Topic::MapTiles)?;
    let (mut took, mut last) = (Vec::new(), 0);
    loop {
        let fd = tiles.fd().context("nobody wakes the reader up")?;
        poll(&mut [PollFd::new(fd, PollFlags::POLLIN)], PollTimeout::from(100_u8))?;
        tiles.hush()?;
        while let Some(received) = tiles.receive()? {
            let Received::Message(_, Message::Tile(tile)) = received else { continue };
            if tile.revision > last {
                last = tile.revision;
                let sent = sent.lock().unwrap_or_else(PoisonError::into_inner);
                took.extend(sent.get(&last).map(Instant::elapsed));
            }
        }
        if sent.lock().unwrap_or_else(PoisonError::into_inner).contains_key(&u64::MAX) {
            return Ok(took);
        }
    }
}

/// A byte that goes through threads that wait for nothing else, as often and as seldom as rings come.
fn bare_wake_ups() -> std::io::Result<Vec<Duration>> {
    let pass = |(mut from, mut to): (PipeReader, PipeWriter)| {
        spawn(move || {
            let mut byte = [0];
            while from.read_exact(&mut byte).is_ok() && to.write_all(&byte).is_ok() {}
        })
    };
    let (mut from, mut first) = pipe()?;
    for _ in 1..WAKE_UPS {
        let (next, to) = pipe()?;
        pass((from, to));
        from = next;
    }
    let mut took = Vec::new();
    for _ in 0..RINGS / 5 {
        sleep(EVERY);
        let begun = Instant::now();
        first.write_all(&[0])?;
        from.read_exact(&mut [0])?;
        took.push(begun.elapsed());
    }
    Ok(took)
}

fn summary(mut took: Vec<Duration>) -> String {
    took.sort_unstable();
    let at = |share: usize| took.get(took.len() * share / 100).map_or(0, Duration::as_micros);
    format!("{} of them, p50 {} µs, p99 {} µs", took.len(), at(50), at(99))
}

fn main() -> ExitCode {
    process::run_sensor("latency", OUTPUTS, |_plan| {
        let name = std::env::var("ECHOGRID_DOMAIN").context("no graph")?;
        Ok(Latency::begin(&Domain::named(&name)?))
    })
}
