//! `echogrid map` and `echogrid up`: a graph from its start to its summary.

mod checks;
mod ended;
mod outputs;
mod plan;
pub(super) mod remarks;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use echogrid_formats::log::LogSurvey;
use echogrid_service::Plan;
use echogrid_topics::Domain;

use self::outputs::Files;
use super::live::{Watch, Watched};
use super::spool::Spool;
use super::{closures, doctor, folder, going_on, recognised, stale};
use crate::cli::View;
use crate::config::{self, Config, LoadRequest, Loaded};
use crate::limits;
use crate::progress::Display;
use crate::summary::{Recording, Summary};
use crate::supervisor::{self, Graph, Outcome};

/// Runs the graph that was asked for, and tells what came of it.
pub(super) fn run(request: &LoadRequest, view: &View) -> Result<()> {
    let summary = summary_of(request, view)?;
    super::print_found(&summary, view.json)?;
    going_on::check_places(summary.goes_on_with.as_deref(), summary.contradictions.as_ref())?;
    check_recording(&summary)
}

/// Whoever asked for a recording must not take a part of it for the whole; the map is saved by then.
pub(super) fn check_recording(summary: &Summary) -> Result<()> {
    let Some(Recording { file, is_whole: false }) = &summary.recording else { return Ok(()) };
    bail!("{}: the recording ended before the run did, as was said then; the map is saved, and whole", file.display())
}

/// A run that can be started.
struct Run {
    loaded: Loaded,
    survey: Option<LogSurvey>,
    plan: Plan,
    /// Reading log or world may take so long.
    ready_within: Duration,
    /// What is odd about who says where the robot is.
    little: Option<String>,
}

/// Runs the graph that was asked for; what came of it.
pub(super) fn summary_of(request: &LoadRequest, view: &View) -> Result<Summary> {
    let mut run = prepare(request)?;
    let _ours = folder::take(&run.loaded.config().run.out)?;
    let spool = open_spool(&mut run, request.resume)?;
    let config = run.loaded.config();
    let before = Files::of(config);
    let outcome = play(&run, view, request.resume, &before)?;
    // Before what the run could be resumed from is removed.
    outputs::check_saved(config, &outcome, &before)?;
    spool.map_or(Ok(()), Spool::remove)?;
    let files = outputs::written(config, &before);
    let mut of_files = if files.is_empty() { Vec::new() } else { stale::clear(config, &files)? };
    of_files.extend(outputs::untold_facing(config, &files));
    ended::check_mapped(config, run.survey.as_ref(), &outcome)?;
    summary(&run, &outcome, &before, of_files)
}

/// What is wrong is said before anything is started.
fn prepare(request: &LoadRequest) -> Result<Run> {
    let loaded = Config::load(request)?;
    loaded.require_runnable()?;
    let config = loaded.config();
    let begun = Instant::now();
    let survey = checks::survey(config)?;
    let earlier = going_on::check(config)?;
    checks::services(config)?;
    recognised::check(&config.localizer, &config.run.out)?;
    let little = survey.as_ref().map(|survey| checks::overlap(config, survey)).transpose()?.flatten();
    // The sensor will read log or world as we did, beside the others.
    let ready_within = Duration::from_secs_f64(config.supervision.ready_within_s) + 4 * begun.elapsed();
    doctor::require_addresses(config, survey.as_ref())?;
    outputs::probe_record(&config.simulator.record, &config.run.out)?;
    outputs::probe_output(config)?;
    if let Some(file) = config.recording().filter(|_| !request.resume) {
        outputs::probe_recording(&file)?;
    }
    let plan = plan::of(config, survey.as_ref(), earlier)?;
    Ok(Run { loaded, survey, plan, ready_within, little })
}

/// What is stored so that the run can be resumed, if that was asked for.
fn open_spool(run: &mut Run, resumes: bool) -> Result<Option<Spool>> {
    let folder = &run.loaded.config().run.spool;
    if folder.as_os_str().is_empty() {
        ensure!(!resumes, "--resume needs --spool FOLDER: where the run was spooled");
        return Ok(None);
    }
    let spool = Spool::open(folder, resumes, run.plan.epoch, &run.plan.config)?;
    run.plan.epoch = spool.epoch();
    run.plan.state = Some(spool.folder().into());
    run.plan.synced = true;
    Ok(Some(spool))
}

/// The graph from its start to its end.
fn play(run: &Run, view: &View, resumes: bool, before: &Files) -> Result<Outcome> {
    let config = run.loaded.config();
    let domain = match &config.run.domain {
        config::Domain::Auto => Domain::unique(),
        config::Domain::Named(name) => Domain::named(name)?,
    };
    let graph = Graph {
        domain,
        services: &config.services,
        topics: &config.topics,
        plan: run.plan.clone(),
        kept_bytes: config.mapper.kept_bytes_max(),
        log_filter: view.log_level.as_deref(),
        log_json: view.logs_json(),
        alive_within: Duration::from_secs_f64(config.run.alive_within_s),
        ready_within: run.ready_within,
        supervision: &config.supervision,
    };
    limits::allow_files(limits::files_needed(config.services.len() as u64));
    let watch = view.watch.map(|listen| Watch::new(graph.domain.name(), listen)).transpose()?;
    let mut display = Watched { display: Display::new(view.quiet, view.tells_lives()), watch };
    if let Some(file) = config.recording() {
        display.display.print(&format!("recording: {}", file.display()));
    }
    if !resumes && !outputs::of_an_earlier_run(config).is_empty() {
        display.display.remark(&format!(
            "{}: the map of an earlier run is replaced there when this one is saved (--out names another folder)",
            config.run.out.display()
        ));
    }
    let outcome = supervisor::run(graph, &mut display);
    drop(display);
    let ended =
        outcome.and_then(|outcome| outcome.check().map(|()| outcome).with_context(|| outputs::kept(config, before)));
    ended.map_err(|error| match doctor::blame(config, run.survey.as_ref()) {
        Some(blame) => error.context(blame),
        None => error,
    })
}

/// What is told of a run: its figures, whatever is odd, its files.
fn summary(run: &Run, outcome: &Outcome, before: &Files, of_files: Vec<String>) -> Result<Summary> {
    let (config, survey) = (run.loaded.config(), run.survey.as_ref());
    let mut summary = ended::figures(config, survey, outcome);
    summary.log_faults = survey.map(remarks::of_log).unwrap_or_default();
    summary.log_faults.extend(remarks::of_its_run(run.loaded.run_settings()));
    summary.log_faults.extend(survey.and_then(|survey| remarks::suggestion(survey, config.odometry.poses)));
    summary.log_faults.extend(run.little.clone());
    summary.log_faults.extend(recognised::remark(&config.localizer, outcome.map.as_ref()));
    summary.log_faults.extend(recognised::notes(config, outcome));
    summary.log_faults.extend(of_files);
    if config.does_slam() {
        let report = closures::read(&config.run.out)?;
        summary.log_faults.extend(closures::remark(&report));
        summary.slam = Some(report);
    }
    let earlier: &PathBuf = &config.run.r#continue;
    summary.goes_on_with = (!earlier.as_os_str().is_empty()).then(|| earlier.clone());
    summary.files = outputs::written(config, before);
    summary.files_lack = outputs::files_lack(config, outcome);
    summary.recording = config.recording().map(|file| Recording { is_whole: echogrid_recorder::is_whole(&file), file });
    Ok(summary)
}
