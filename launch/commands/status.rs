//! `echogrid status`: which graphs run, and how their services are doing.

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::io::IsTerminal as _;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_service::Plan;
use echogrid_topics::{Domain, Health, Input, MapInfo, Participant, Received};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use serde::Serialize;

use super::talk::{choose, none_runs};
use crate::config;

/// Every service says how it is doing four times a second.
const HEARD_WITHIN: Duration = Duration::from_secs(1);
/// From one look to the next.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Clears a terminal.
const CLEAR: &str = "\x1b[H\x1b[2J";

/// How a graph is doing.
#[derive(Debug, Serialize)]
struct Status {
    domain: String,
    services: Vec<ServiceStatus>,
    map: Option<MapStatus>,
}

#[derive(Debug, Serialize)]
struct ServiceStatus {
    name: String,
    /// None: not heard of.
    health: Option<HealthStatus>,
}

#[derive(Debug, Serialize)]
struct HealthStatus {
    state: &'static str,
    pid: u32,
    messages: u64,
    /// 0: unknown.
    total: u64,
    faulty: u64,
    lost: u64,
    last_error: String,
    /// What is worth knowing of it.
    note: String,
}

#[derive(Debug, Serialize)]
struct MapStatus {
    scans: u64,
    distance_m: f64,
    trust: f64,
    fixes: u32,
    cells_known: u64,
    cells_occupied: u64,
    cells_free: u64,
    holds: bool,
    degraded: bool,
}

/// Tells how the services of a graph are doing, or which graphs run; once, or until it ends.
pub(super) fn run(domain: Option<&str>, as_json: bool, watch: bool) -> Result<()> {
    let running = echogrid_topics::domain::running();
    if domain.is_none() && running.len() != 1 {
        if as_json {
            return super::print(&format!("{}\n", serde_json::json!({ "graphs": running })));
        }
        let text = if running.is_empty() { none_runs() } else { running.join("\n") };
        return super::print(&format!("{text}\n"));
    }
    let domain = choose(domain)?;
    let participant = Participant::join(&domain, "echogrid status")?;
    let clears = watch && !as_json && std::io::stdout().is_terminal();
    loop {
        let looked = Instant::now();
        let status = look(&domain, &participant)?;
        let mut text = if clears { CLEAR.to_owned() } else { String::new() };
        if !as_json {
            text += &status.to_string();
        } else if watch {
            let _ = writeln!(text, "{}", serde_json::to_string(&status)?);
        } else {
            let _ = writeln!(text, "{}", serde_json::to_string_pretty(&status)?);
        }
        super::print(&text)?;
        if !watch {
            return Ok(());
        }
        thread::sleep(LOOK_EVERY.saturating_sub(looked.elapsed()));
        if !echogrid_topics::domain::running().iter().any(|name| name == domain.name()) {
            return if as_json { Ok(()) } else { super::print(&format!("graph {} has ended\n", domain.name())) };
        }
    }
}

fn look(domain: &Domain, participant: &Participant) -> Result<Status> {
    let services: config::Config = Plan::read(domain)?.config.try_into().context("in the plan of the graph")?;
    let heard = listen(participant, services.services.len())?;
    let services = services.services.into_keys().map(|name| {
        let health = heard.get(&name).map(|health| HealthStatus {
            state: health.state.word(),
            pid: health.pid,
            messages: health.progress,
            total: health.total,
            faulty: health.faults,
            lost: health.lost,
            last_error: health.last_error.clone(),
            note: health.note.clone(),
        });
        ServiceStatus { name, health }
    });
    let map = latest_map(participant)?.map(|map| MapStatus {
        scans: map.scans,
        distance_m: map.distance_m,
        trust: map.trust,
        fixes: map.fixes,
        cells_known: map.cells_known,
        cells_occupied: map.cells_occupied,
        cells_free: map.cells_free,
        holds: map.held,
        degraded: map.degraded,
    });
    Ok(Status { domain: domain.name().to_owned(), services: services.collect(), map })
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "domain {}", self.domain)?;
        for ServiceStatus { name, health } in &self.services {
            let Some(health) = health else {
                writeln!(f, "{name:<10} not heard of within {} s", HEARD_WITHIN.as_secs())?;
                continue;
            };
            let of = if health.total > 0 { format!(" of {}", health.total) } else { String::new() };
            let HealthStatus { state, pid, messages, faulty, lost, note, .. } = health;
            let note = if note.is_empty() { String::new() } else { format!("; {note}") };
            writeln!(
                f,
                "{name:<10} {state:<9} process {pid}, {messages}{of} messages, {faulty} faulty, {lost} lost{note}"
            )?;
        }
        let Some(map) = &self.map else { return Ok(()) };
        let state = match (map.holds, map.degraded) {
            (true, true) => ", degraded: mapping holds",
            (true, false) => ", mapping holds",
            (false, true) => ", degraded",
            (false, false) => "",
        };
        let localized = crate::summary::localized(map.fixes);
        let MapStatus { scans, trust, distance_m, .. } = map;
        writeln!(f, "map        {scans} scans, {distance_m:.1} m, trust {trust:.3}{localized}{state}")
    }
}

/// The map in numbers, as the mapper told last.
fn latest_map(participant: &Participant) -> Result<Option<MapInfo>> {
    let mut port: Input<MapInfo> = Input::typed(participant)?;
    let deadline = Instant::now() + HEARD_WITHIN;
    loop {
        port.hush()?;
        if let Some(Received::Message(_, info)) = port.receive()? {
            return Ok(Some(info));
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(None);
        }
        let mut fds: Vec<_> = port.fd().into_iter().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        let millis = u16::try_from(left.as_millis()).unwrap_or(u16::MAX);
        poll(&mut fds, PollTimeout::from(millis)).context("waiting for the mapper")?;
    }
}

/// What the services say of themselves, until `services` of them were heard.
fn listen(participant: &Participant, services: usize) -> Result<BTreeMap<String, Health>> {
    let mut port: Input<Health> = Input::typed(participant)?;
    let mut heard = BTreeMap::new();
    let deadline = Instant::now() + HEARD_WITHIN;
    while heard.len() < services {
        port.hush()?;
        while let Some(received) = port.receive()? {
            if let Received::Message(_, health) = received {
                heard.insert(health.service.clone(), health);
            }
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            break;
        }
        let timeout = PollTimeout::try_from(left).unwrap_or(PollTimeout::MAX);
        let mut fds: Vec<_> = port.fd().into_iter().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        poll(&mut fds, timeout).context("waiting for the services")?;
    }
    Ok(heard)
}
