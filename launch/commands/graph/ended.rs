//! What came of a run, when all processes have left.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use echogrid_core::Verdict;
use echogrid_formats::log::LogSurvey;
use echogrid_topics::MapInfo;

use super::outputs::of_an_earlier_run;
use crate::commands::recognised;
use crate::config::{Config, ServiceKind};
use crate::summary::Summary;
use crate::supervisor::Outcome;

/// Refuses a run that mapped nothing, though it came to its end or its sensor could have given something.
pub(super) fn check_mapped(config: &Config, survey: Option<&LogSurvey>, outcome: &Outcome) -> Result<()> {
    let earlier = of_an_earlier_run(config);
    if let Some(map) = outcome.map.as_ref().filter(|map| map.cells_known == 0 && !outcome.stopped) {
        let refused = map.verdicts.iter().filter(|(_, count)| *count > 0);
        let reasons: Vec<String> = refused.map(|(verdict, count)| format!("{count} {}", verdict.describe())).collect();
        ensure!(
            !map.unplaced,
            "nothing was mapped{earlier}: {}; --start X Y THETA says it, and --set odometry.start=odometry takes the odometry's own frame \
             for the map's",
            recognised::nobody_could_tell(&config.localizer)
        );
        bail!(
            "nothing was mapped{earlier}: none of {} readings could be used ({})",
            map.verdicts.total(),
            reasons.join(", ")
        );
    }
    // A robot that has not driven yet is no failure.
    let may_be_empty = !outcome.stopped || survey.is_none() && !config.simulates();
    ensure!(
        may_be_empty || outcome.map.as_ref().is_some_and(|map| map.cells_known > 0),
        "stopped before anything was mapped: no map was saved in {}{earlier}",
        config.run.out.display()
    );
    Ok(())
}

/// The figures of a run.
pub(super) fn figures(config: &Config, survey: Option<&LogSurvey>, outcome: &Outcome) -> Summary {
    // Simulated time begins at 0.
    let first_ns = survey.map(|survey| survey.first_stamp_ns).or(config.simulates().then_some(0));
    let mut summary = Summary::of(outcome, source(config), first_ns, config.mapper.resolution_m);
    // Stopped when all of it was in the map, it was not stopped before its end.
    let is_whole = |survey: &LogSurvey| (summary.scans, summary.odometry) == (survey.scan_count, survey.odometry_count);
    // What the mapper took in without ever hearing where the robot was is not in the map.
    let lacks_poses = |map: &MapInfo| map.verdicts.get(Verdict::NoPose) * 100 > map.verdicts.total();
    summary.stopped &= !survey.is_some_and(is_whole) || outcome.map.as_ref().is_some_and(lacks_poses);
    summary
}

/// What was mapped, in a few words.
fn source(config: &Config) -> String {
    if config.plays_log() {
        return config.replay.log.file_name().unwrap_or(config.replay.log.as_os_str()).to_string_lossy().into_owned();
    }
    if config.simulates() {
        let world = Path::new(&config.simulator.world);
        return format!("simulator in {}", world.file_name().unwrap_or(world.as_os_str()).to_string_lossy());
    }
    if config.drives_pioneer() {
        return format!("pioneer at {}", config.pioneer.port);
    }
    let sensor = config.services.iter().find(|(_, service)| service.kind == ServiceKind::Sensor);
    sensor.map_or_else(|| "sensor".into(), |(name, _)| name.clone())
}
