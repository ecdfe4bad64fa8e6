//! What is said of a run before anything is started: whatever is wrong with its log, its robot, and who says where that is.

use anyhow::{Context, Result, bail, ensure};
use echogrid_core::Robot;
use echogrid_formats::localization::{Landmarks, ReferencePath, Sightings};
use echogrid_formats::log::{self, LogSurvey};
use echogrid_lidar::Lidar;
use echogrid_localizer::LocalizerService;
use echogrid_localizer::config::{LocalizerConfig, Source};
use echogrid_pioneer::Pioneer;
use echogrid_simulator::Simulator;

use crate::config::Config;

/// A reference of less than this share of a log is hardly of it.
const HARDLY_ANY: f64 = 0.2;

/// Surveys the log, if one is played, and refuses one that does not hold what the run asks of it.
pub(super) fn survey(config: &Config) -> Result<Option<LogSurvey>> {
    if !config.plays_log() {
        return Ok(None);
    }
    let (log, localizer) = (&config.replay.log, &config.localizer);
    let survey = log::survey_with(log, config.replay.survey_options())?;
    if localizer.needs_truth() {
        let wanted = match localizer.source {
            Source::Landmarks => "localizer.source = \"landmarks\" without localizer.sightings measures from",
            _ => "localizer.source = \"truth\" (--fix truth) asks for",
        };
        ensure!(
            survey.true_pose_count > 0,
            "{}: no true pose in it, which {wanted}; expected TRUEPOS lines, or of a recording --fix tf or --fix topic:NAME",
            log.display()
        );
    }
    if let Some(why) = survey.clock.invented().filter(|_| localizer.needs_time()) {
        bail!("{}: {why}; {} asks for the log's own time", log.display(), localizer.asks_by_time());
    }
    if let Some(robot) = &config.robot {
        has_transducers_of(robot, &survey)?;
    }
    Ok(Some(survey))
}

/// Refuses settings, and files that they name, by which a service could not begin. The robot itself may yet have to be turned on.
pub(super) fn services(config: &Config) -> Result<()> {
    LocalizerService::new(&config.localizer)?;
    if config.drives_pioneer() {
        Pioneer::new(config.pioneer.clone(), None, Vec::new())?;
    }
    if config.reads_lidar() {
        let robot = config.robot.as_ref();
        let robot = robot.context("where does the lidar sit? A robot file says it: --robot FILE, with [lidar]")?;
        Lidar::new(config.lidar.clone(), robot)?;
    }
    if config.simulates() {
        Simulator::check(&config.simulator, config.robot.clone().unwrap_or_default())?;
    }
    Ok(())
}

/// Refuses a robot that does not have the transducers whose readings the log holds: these would be another's, or nobody's.
fn has_transducers_of(robot: &Robot, survey: &LogSurvey) -> Result<()> {
    let (has, needs) = (robot.transducer_count(), survey.robot.transducer_count());
    let ways = match survey.robot.sensors.len() {
        1 => String::new(),
        sensors => format!(" of {sensors} sensors, or ways in which beams lie"),
    };
    ensure!(
        has >= needs,
        "robot {:?} has {has} transducers, but the log has readings of {needs}{ways}: describe them all, or let the log say where \
         they are (without --robot)",
        robot.name
    );
    Ok(())
}

/// How much of a log the times of a reference or of sightings cover; said where that is hardly anything.
///
/// # Errors
/// It is nothing at all: no fix could ever come.
pub(super) fn overlap(config: &Config, survey: &LogSurvey) -> Result<Option<String>> {
    let LocalizerConfig { source, reference, landmarks, sightings, .. } = &config.localizer;
    let (file, known) = match source {
        Source::Reference => {
            let path = ReferencePath::read(reference)?;
            (reference, path.poses().iter().map(|(stamp_ns, _)| *stamp_ns).collect::<Vec<_>>())
        }
        Source::Landmarks if config.localizer.needs_truth() => return Ok(None),
        Source::Landmarks => {
            let seen = Sightings::read(sightings, &Landmarks::read(landmarks)?)?;
            (sightings, seen.all().iter().map(|sighting| sighting.stamp_ns).collect())
        }
        Source::None | Source::Operator | Source::Truth | Source::Map => return Ok(None),
    };
    let (Some(first_ns), Some(last_ns)) = (known.first(), known.last()) else { return Ok(None) };
    let seconds = |ns: u64| ns as f64 * 1e-9;
    let times = format!(
        "{} is of {:.3} s to {:.3} s, the log of {:.3} s to {:.3} s",
        file.display(),
        seconds(*first_ns),
        seconds(*last_ns),
        seconds(survey.first_stamp_ns),
        seconds(survey.last_stamp_ns)
    );
    let both_ns = survey.last_stamp_ns.min(*last_ns).checked_sub(survey.first_stamp_ns.max(*first_ns));
    let both_ns = both_ns.with_context(|| format!("{times}: it is of another time, and no fix would ever come"))?;
    let share = both_ns as f64 / survey.duration().as_nanos().max(1) as f64;
    let is_little = share < HARDLY_ANY;
    Ok(is_little.then(|| format!("{times}: that is {:.0} % of it; is it of this drive?", 100.0 * share)))
}
