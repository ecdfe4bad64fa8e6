//! Talking to a running graph: `echogrid save`, `echogrid fix`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail, ensure};
use echogrid_core::{Fix, Pose2};
use echogrid_formats::map::MapFormat;
use echogrid_recorder::Recorded;
use echogrid_service::Plan;
use echogrid_topics::{Command, Domain, Participant, Topic};

use crate::config::{self, MAP_FILE, ServiceKind};

/// Writing a large map to a slow disk takes its time.
const SAVED_WITHIN: Duration = Duration::from_secs(60);
/// Between two steps of a service.
const DONE_WITHIN: Duration = Duration::from_secs(10);
/// A robot that nobody tells to go on stops: within a second, say.
const TOLD_AGAIN: Duration = Duration::from_millis(250);

/// Records a graph until it is over.
pub(super) fn record(domain: Option<&str>, file: &Path, with_foxglove: bool) -> Result<()> {
    let Recorded { messages, missed } = echogrid_recorder::record(&choose(domain)?, file, with_foxglove)?;
    let missed = match missed {
        0 => "none missed".to_owned(),
        missed => {
            format!("{missed} missed: it did not keep up with the graph (--record of up, map and demo is waited for)")
        }
    };
    super::print(&format!("{}: {messages} messages, {missed}\n", file.display()))
}

/// Has every publisher of a graph save its map.
pub(super) fn save(domain: Option<&str>) -> Result<()> {
    order(domain, ServiceKind::Publisher, Command::Save, SAVED_WITHIN)?;
    let (_, _, config) = running(domain, "echogrid save")?;
    // After the map: what it is made of must be among them.
    if config.mapper.keep_readings { order(domain, ServiceKind::Mapper, Command::Save, SAVED_WITHIN) } else { Ok(()) }
}

/// Has a graph save its map and the readings that it keeps; the native map. Nothing is printed.
pub(super) fn saved_map(domain: Option<&str>) -> Result<PathBuf> {
    let (domain, participant, config) = running(domain, "echogrid why")?;
    ensure!(
        config.mapper.keep_readings,
        "graph {} keeps no readings; start it with --set mapper.keep_readings=true, and ask then",
        domain.name()
    );
    ensure!(
        config.publisher.formats.contains(&MapFormat::Echogrid),
        "graph {} saves no native map; expected echogrid in publisher.formats",
        domain.name()
    );
    for kind in [ServiceKind::Publisher, ServiceKind::Mapper] {
        for (name, _) in config.services.iter().filter(|(_, service)| service.kind == kind) {
            let done = echogrid_topics::control::order(&participant, name, Command::Save, SAVED_WITHIN)?;
            done.map_err(|why| anyhow!("{name}: {why}"))?;
        }
    }
    Ok(config.run.out.join(MAP_FILE))
}

/// A running graph, `name` as a participant of it, and its configuration.
pub(super) fn running(domain: Option<&str>, name: &str) -> Result<(Domain, Participant, config::Config)> {
    let domain = choose(domain)?;
    let participant = Participant::join(&domain, name)?;
    let config = Plan::read(&domain)?.config.try_into().context("in the plan of the graph")?;
    Ok((domain, participant, config))
}

/// Has nothing mapped until told to resume.
pub(super) fn pause(domain: Option<&str>) -> Result<()> {
    order(domain, ServiceKind::Mapper, Command::Pause, DONE_WITHIN)
}

/// Has the mapper go on.
pub(super) fn resume(domain: Option<&str>) -> Result<()> {
    order(domain, ServiceKind::Mapper, Command::Resume, DONE_WITHIN)
}

/// Tells the odometry where the robot is now.
pub(super) fn fix(domain: Option<&str>, pose: Pose2, position_sigma_m: f64, heading_sigma_rad: f64) -> Result<()> {
    let fix = Fix::about(pose, position_sigma_m, heading_sigma_rad);
    fix.validate().context("a robot can't be there")?;
    order(domain, ServiceKind::Odometry, Command::Fix(fix), DONE_WITHIN)
}

/// Drives a robot that can be driven. For so many seconds, if given: a real robot must be told again and again.
pub(super) fn drive(domain: Option<&str>, v_mps: f64, w_radps: f64, seconds: Option<f64>) -> Result<()> {
    order(domain, ServiceKind::Sensor, Command::Drive { v_mps, w_radps }, DONE_WITHIN)?;
    let Some(seconds) = seconds else { return Ok(()) };
    let (_, participant, config) = running(domain, "echogrid drive")?;
    let until = Instant::now() + Duration::from_secs_f64(seconds);
    let command = Command::Drive { v_mps, w_radps };
    let drives = |service: &config::Service| is_told(service, ServiceKind::Sensor, command);
    let sensors: Vec<&String> = config.services.iter().filter(|(_, s)| drives(s)).map(|(name, _)| name).collect();
    let tell = |v_mps, w_radps| -> Result<()> {
        for name in &sensors {
            let told =
                echogrid_topics::control::order(&participant, name, Command::Drive { v_mps, w_radps }, DONE_WITHIN)?;
            told.map_err(|why| anyhow!("{name}: {why}"))?;
        }
        Ok(())
    };
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return tell(0.0, 0.0);
        }
        std::thread::sleep(left.min(TOLD_AGAIN));
        tell(v_mps, w_radps)?;
    }
}

/// Whether a service is told what those of a kind are; only who says where the robot drives is told to drive.
fn is_told(service: &config::Service, kind: ServiceKind, command: Command) -> bool {
    let drives = || service.wiring.writes.iter().any(|topic| topic == Topic::OdometryRaw.name());
    service.kind == kind && (!matches!(command, Command::Drive { .. }) || drives())
}

/// Tells all services of a kind to do something, and prints what they say.
fn order(domain: Option<&str>, kind: ServiceKind, command: Command, within: Duration) -> Result<()> {
    let (_, participant, config) = running(domain, &format!("echogrid {}", command.word()))?;
    for (name, _) in config.services.iter().filter(|(_, service)| is_told(service, kind, command)) {
        match echogrid_topics::control::order(&participant, name, command, within)? {
            Ok(done) => super::print(&format!("{name}: {done}\n"))?,
            Err(why) => bail!("{name}: {why}"),
        }
    }
    Ok(())
}

/// That no graph of this user runs; and whose do, which are theirs to talk to.
pub(super) fn none_runs() -> String {
    let others = echogrid_topics::domain::others();
    let others: Vec<String> = others
        .iter()
        .map(|(user, domains)| {
            let domains: Vec<&str> = domains.iter().map(String::as_str).collect();
            format!("{user}: {}, with `{} echogrid …`", domains.join(", "), user.run_as())
        })
        .collect();
    if others.is_empty() {
        return "no graph runs".to_owned();
    }
    let me = echogrid_topics::domain::User::current();
    format!("no graph of {me} runs; other users talk to theirs ({})", others.join("; "))
}

/// The graph that was named, or the only one that runs.
pub(super) fn choose(domain: Option<&str>) -> Result<Domain> {
    if let Some(name) = domain {
        return Ok(Domain::named(name)?);
    }
    match echogrid_topics::domain::running().as_slice() {
        [] => bail!(none_runs()),
        [only] => Ok(Domain::named(only)?),
        several => bail!("several graphs run: choose one with --domain ({})", several.join(", ")),
    }
}
