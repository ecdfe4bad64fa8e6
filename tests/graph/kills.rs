//! Whatever is killed, whenever: the map is the one of an undisturbed run, byte for byte.
//!
//! `ECHOGRID_KILLS` says how many kills each series makes (docs/reliability.md), `ECHOGRID_KILLS_SEED` which.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use echogrid_harness::files;
use echogrid_topics::Domain;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::support::{Drive, ECHOGRID, data, echogrid, path, said};

/// A run that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(180);

struct Storm {
    random: ChaCha8Rng,
    kills: u64,
    wanted: u64,
    runs: u64,
    /// Of the domains: two storms may rage at the same time.
    name: &'static str,
    /// Keeps the drive, where there is no recording.
    drive: Drive,
    log: PathBuf,
    /// Further arguments.
    more: &'static [&'static str],
}

impl Storm {
    fn new(name: &'static str, salt: u64, by_default: u64) -> Self {
        let number = |name| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
        let drive = Drive::new(60.0);
        Self {
            random: ChaCha8Rng::seed_from_u64(number("ECHOGRID_KILLS_SEED").unwrap_or(1) + salt),
            kills: 0,
            wanted: number("ECHOGRID_KILLS").unwrap_or(by_default),
            runs: 0,
            name,
            log: data("sonar/columbia-sonar.log.gz").unwrap_or_else(|| drive.out("drive.log")),
            drive,
            more: &[],
        }
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.random.next_u64() % limit
    }

    fn millis(&mut self, limit: u64) -> Duration {
        Duration::from_micros(self.below(1000 * limit))
    }

    fn arguments(&self, out: &str, domain: &Domain, rate: &str) -> Vec<String> {
        let words =
            ["map", &path(&self.log), "--out", &path(&self.drive.out(out)), "--domain", domain.name(), "--rate", rate];
        let restarts = ["--verbose", "--set", "supervision.backoff_s=0", "--set", "supervision.restarts_max=100000"];
        words.into_iter().chain(restarts).chain(self.more.iter().copied()).map(str::to_owned).collect()
    }

    fn domain(&mut self) -> Domain {
        self.runs += 1;
        Domain::named(&format!("k{}-{}-{}", self.name, std::process::id(), self.runs)).unwrap()
    }

    fn map(&self, out: &str) -> Vec<u8> {
        std::fs::read(self.drive.out(out).join("map.echogrid")).unwrap()
    }

    fn undisturbed(&mut self) -> Vec<u8> {
        let domain = self.domain();
        let output = echogrid(self.arguments("undisturbed", &domain, "max"));
        assert!(output.status.success(), "{}", said(&output));
        self.map("undisturbed")
    }

    fn tell(&self, what: &str) {
        let _ = writeln!(std::io::stderr(), "{what}: {} kills in {} runs", self.kills, self.runs - 1);
    }
}

/// A launcher, and what it says.
struct Running {
    child: std::process::Child,
    lines: Receiver<String>,
    heard: Vec<String>,
    /// The latest process of each service.
    services: BTreeMap<String, i32>,
}

impl Running {
    fn start(arguments: &[String]) -> Self {
        let mut command = Command::new(ECHOGRID);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let stderr = child.stderr.take().unwrap();
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            BufReader::new(stderr)
                .lines()
                .map_while(Result::ok)
                .take_while(|line| sender.send(line.clone()).is_ok())
                .count()
        });
        Self { child, lines, heard: Vec::new(), services: BTreeMap::new() }
    }

    /// Listens for so long; the service that was started last meanwhile, none; or that all is over.
    fn listen(&mut self, patience: Duration) -> Result<Option<String>, ()> {
        let deadline = Instant::now() + patience;
        loop {
            match self.lines.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(line) => {
                    let started =
                        line.split_once(" started (process ").map(|(name, rest)| (name.to_owned(), rest.to_owned()));
                    self.heard.push(line);
                    if let Some((name, rest)) = started {
                        self.services.insert(name.clone(), rest.trim_end_matches(')').parse().unwrap());
                        return Ok(Some(name));
                    }
                }
                Err(RecvTimeoutError::Timeout) => return Ok(None),
                Err(RecvTimeoutError::Disconnected) => return Err(()),
            }
        }
    }

    /// Waits for the end, which must be a good one.
    fn end(mut self, domain: &Domain) {
        let status = self.child.wait().unwrap();
        assert!(status.success(), "{status}\n{}", self.heard.join("\n"));
        assert_eq!(files(domain), Vec::<String>::new());
    }
}

#[test]
fn killed_services_change_nothing() {
    change_nothing(Storm::new("s", 0, 24));
}

/// With closures pending, and while all is solved at the end.
#[test]
fn killed_slam_changes_nothing() {
    let Some(log) = data("carmen/freiburg-101-raw.log.gz") else { return };
    change_nothing(Storm { log, more: &["--slam"], ..Storm::new("m", 2000, 8) });
}

fn change_nothing(mut storm: Storm) {
    let undisturbed = storm.undisturbed();
    while storm.kills < storm.wanted {
        let domain = storm.domain();
        let rate = ["300", "600", "max"][storm.below(3) as usize];
        let mut kills = 1 + storm.below(12);
        let mut running = Running::start(&storm.arguments("disturbed", &domain, rate));
        let begun = Instant::now();
        let mut patience = storm.millis(150);
        while let Ok(started) = running.listen(patience) {
            assert!(begun.elapsed() < PATIENCE, "it hangs:\n{}", running.heard.join("\n"));
            patience = storm.millis(150);
            if kills == 0 || running.services.is_empty() {
                continue;
            }
            // Half of the kills hit a process in its first milliseconds.
            let victim = match started {
                Some(started) if storm.below(2) == 0 => {
                    std::thread::sleep(storm.millis(30));
                    started
                }
                Some(_) => continue,
                None => {
                    let names: Vec<&String> = running.services.keys().collect();
                    names[storm.below(names.len() as u64) as usize].clone()
                }
            };
            if kill(Pid::from_raw(running.services[&victim]), Signal::SIGKILL).is_ok() {
                storm.kills += 1;
                kills -= 1;
            }
        }
        running.end(&domain);
        assert!(storm.map("disturbed") == undisturbed, "run {}: another map", storm.runs);
    }
    storm.tell("services");
}

#[test]
fn a_killed_graph_resumes_where_it_was() {
    let mut storm = Storm::new("l", 1000, 8);
    let undisturbed = storm.undisturbed();
    let spool = storm.drive.out("spool");
    while storm.kills < storm.wanted {
        let domain = storm.domain();
        let mut kills = 1 + storm.below(6);
        loop {
            let mut arguments = storm.arguments("resumed", &domain, "500");
            arguments.extend(["--spool".to_owned(), path(&spool)]);
            // Killed before it had begun, there is nothing to resume.
            if spool.join("run.toml").exists() {
                arguments.push("--resume".to_owned());
            }
            let mut running = Running::start(&arguments);
            let limit = if storm.below(2) == 0 { 200 } else { 900 };
            let end = Instant::now() + if kills > 0 { storm.millis(limit) } else { PATIENCE };
            let over = loop {
                let left = end.saturating_duration_since(Instant::now());
                match running.listen(left) {
                    Err(()) => break true,
                    Ok(_) if left.is_zero() => break false,
                    Ok(_) => {}
                }
            };
            if over {
                running.end(&domain);
                break;
            }
            assert!(kills > 0, "it hangs:\n{}", running.heard.join("\n"));
            running.child.kill().unwrap();
            running.child.wait().unwrap();
            storm.kills += 1;
            kills -= 1;
        }
        assert!(storm.map("resumed") == undisturbed, "run {}: another map", storm.runs);
        assert!(!spool.exists());
    }
    storm.tell("launcher");
}
