//! `echogrid map` and `echogrid up`: a graph from its start to its summary.

use std::collections::BTreeMap;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, Result, bail, ensure};
use echogrid_core::config::Poses;
use echogrid_core::localization::Choice;
use echogrid_core::{GridMapper, Robot, SensorKind, Verdict};
use echogrid_formats::localization::{Landmarks, ReferencePath, Sightings};
use echogrid_formats::log::{self, LogSurvey};
use echogrid_formats::map::readings::READINGS_FILE;
use echogrid_formats::map::{MapFiles, MapFormat, Provenance};
use echogrid_formats::probe_file;
use echogrid_lidar::Lidar;
use echogrid_localizer::LocalizerService;
use echogrid_localizer::config::{LocalizerConfig, Source};
use echogrid_pioneer::Pioneer;
use echogrid_publisher::SONARS_FILE;
use echogrid_service::Plan;
use echogrid_simulator::Simulator;
use echogrid_topics::contract::{MAX_SENSORS, RobotWire};
use echogrid_topics::{Domain, MapInfo};

use super::live::{Watch, Watched};
use super::spool::Spool;
use super::{doctor, folder, going_on, recognised, stale};
use crate::cli::View;
use crate::config::{self, Builtin, Config, Exec, LoadRequest, Rate, RunSetting, ServiceKind};
use crate::limits;
use crate::progress::Display;
use crate::summary::{Recording, Summary};
use crate::supervisor::{self, Graph};

/// A reference of less than this share of a log is hardly of it.
const HARDLY_ANY: f64 = 0.2;
/// Scans of a sensor that says nothing of its size before it starts.
const READINGS_OF_AN_UNKNOWN_SENSOR: usize = 1024;

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

/// Runs the graph that was asked for; what came of it.
pub(super) fn summary_of(request: &LoadRequest, view: &View) -> Result<Summary> {
    let loaded = Config::load(request)?;
    loaded.require_runnable()?;
    let config = loaded.config();
    // What is wrong with the log is said before anything is started.
    let surveyed = Instant::now();
    let survey =
        plays_log(config).then(|| log::survey_with(&config.replay.log, config.replay.survey_options())).transpose()?;
    if let Some(survey) = survey.as_ref().filter(|_| config.localizer.needs_truth()) {
        let wanted = match config.localizer.source {
            Source::Landmarks => "localizer.source = \"landmarks\" without localizer.sightings measures from",
            _ => "localizer.source = \"truth\" (--fix truth) asks for",
        };
        ensure!(
            survey.true_pose_count > 0,
            "{}: no true pose in it, which {wanted}; expected TRUEPOS lines, or of a recording --fix tf or --fix topic:NAME",
            config.replay.log.display()
        );
    }
    if let Some(why) =
        survey.as_ref().and_then(|survey| survey.clock.invented()).filter(|_| config.localizer.needs_time())
    {
        bail!(
            "{}: {why}; {} asks for the log's own time",
            config.replay.log.display(),
            config.localizer.asks_by_time()
        );
    }
    if let (Some(survey), Some(robot)) = (&survey, &config.robot) {
        has_transducers_of(robot, survey)?;
    }
    let earlier = going_on::check(config)?;
    // With the files of who says where the robot is, too.
    LocalizerService::new(&config.localizer)?;
    recognised::check(&config.localizer, &config.run.out)?;
    let little = survey.as_ref().map(|survey| overlap(config, survey)).transpose()?.flatten();
    // So is a parameter file that is none. The robot itself may yet have to be turned on.
    if config.drives_pioneer() {
        Pioneer::new(config.pioneer.clone(), None, Vec::new())?;
    }
    if config.reads_lidar() {
        let robot = config.robot.as_ref();
        let robot = robot.context("where does the lidar sit? A robot file says it: --robot FILE, with [lidar]")?;
        Lidar::new(config.lidar.clone(), robot)?;
    }
    // So is what is wrong with the world, or the way through it.
    if config.simulates() {
        Simulator::check(&config.simulator, config.robot.clone().unwrap_or_default())?;
    }
    // The sensor will read log or world as we did, beside the others.
    let ready_within = Duration::from_secs_f64(config.supervision.ready_within_s) + 4 * surveyed.elapsed();
    doctor::require_addresses(config, survey.as_ref())?;
    probe_record(&config.simulator.record, &config.run.out)?;
    probe_output(config)?;
    let recording = config.recording();
    if let Some(file) = recording.as_ref().filter(|_| !request.resume) {
        probe_recording(file)?;
    }
    let _ours = folder::take(&config.run.out)?;
    let domain = match &config.run.domain {
        config::Domain::Auto => Domain::unique(),
        config::Domain::Named(name) => Domain::named(name)?,
    };
    let mut plan = plan(config, survey.as_ref(), earlier)?;
    let spool = &config.run.spool;
    ensure!(
        !request.resume || !spool.as_os_str().is_empty(),
        "--resume needs --spool FOLDER: where the run was spooled"
    );
    let spool = (!spool.as_os_str().is_empty())
        .then(|| Spool::open(spool, request.resume, plan.epoch, &plan.config))
        .transpose()?;
    if let Some(spool) = &spool {
        plan.epoch = spool.epoch();
        plan.state = Some(spool.folder().into());
        plan.synced = true;
    }
    let graph = Graph {
        domain,
        services: &config.services,
        topics: &config.topics,
        plan,
        kept_bytes: config.mapper.kept_bytes_max(),
        log_filter: view.log_level.as_deref(),
        log_json: view.logs_json(),
        alive_within: Duration::from_secs_f64(config.run.alive_within_s),
        ready_within,
        supervision: &config.supervision,
    };
    limits::allow_files(limits::files_needed(config.services.len() as u64));
    let before = Files::of(config);
    let watch = view.watch.map(|listen| Watch::new(graph.domain.name(), listen)).transpose()?;
    let mut display = Watched { display: Display::new(view.quiet, view.tells_lives()), watch };
    if let Some(file) = &recording {
        display.display.print(&format!("recording: {}", file.display()));
    }
    if !request.resume && !of_an_earlier_run(config).is_empty() {
        display.display.remark(&format!(
            "{}: the map of an earlier run is replaced there when this one is saved (--out names another folder)",
            config.run.out.display()
        ));
    }
    let outcome = supervisor::run(graph, &mut display);
    drop(display);
    let ended = outcome.and_then(|outcome| outcome.check().map(|()| outcome).with_context(|| kept(config, &before)));
    let outcome = ended.map_err(|error| match doctor::blame(config, survey.as_ref()) {
        Some(blame) => error.context(blame),
        None => error,
    })?;
    // Before what the run could be resumed from is removed.
    check_saved(config, &outcome, &before)?;
    spool.map_or(Ok(()), Spool::remove)?;
    let files = written(config, &before);
    let mut of_earlier_runs = if files.is_empty() { Vec::new() } else { stale::clear(config, &files)? };
    of_earlier_runs.extend(untold_facing(config, &files));
    if let Some(map) = outcome.map.as_ref().filter(|map| map.cells_known == 0 && !outcome.stopped) {
        let refused = map.verdicts.iter().filter(|(_, count)| *count > 0);
        let reasons: Vec<String> = refused.map(|(verdict, count)| format!("{count} {}", verdict.describe())).collect();
        ensure!(
            !map.unplaced,
            "nothing was mapped{}: {}; --start X Y THETA says it, and --set odometry.start=odometry takes the odometry's own frame \
             for the map's",
            of_an_earlier_run(config),
            recognised::nobody_could_tell(&config.localizer)
        );
        bail!(
            "nothing was mapped{}: none of {} readings could be used ({})",
            of_an_earlier_run(config),
            map.verdicts.total(),
            reasons.join(", ")
        );
    }
    // A robot that has not driven yet is no failure.
    ensure!(
        !outcome.stopped
            || survey.is_none() && !config.simulates()
            || outcome.map.as_ref().is_some_and(|map| map.cells_known > 0),
        "stopped before anything was mapped: no map was saved in {}{}",
        config.run.out.display(),
        of_an_earlier_run(config)
    );
    // Simulated time begins at 0.
    let first_ns = survey.as_ref().map(|survey| survey.first_stamp_ns).or(config.simulates().then_some(0));
    let mut summary = Summary::of(&outcome, source(config), first_ns, config.mapper.resolution_m);
    // Stopped when all of it was in the map, it was not stopped before its end.
    let is_whole = |survey: &LogSurvey| (summary.scans, summary.odometry) == (survey.scan_count, survey.odometry_count);
    // What the mapper took in without ever hearing where the robot was is not in the map.
    let lacks_poses = |map: &MapInfo| map.verdicts.get(Verdict::NoPose) * 100 > map.verdicts.total();
    summary.stopped &= !survey.as_ref().is_some_and(is_whole) || outcome.map.as_ref().is_some_and(lacks_poses);
    summary.log_faults = survey.as_ref().map(remarks).unwrap_or_default();
    summary.log_faults.extend(of_its_run(loaded.run_settings()));
    summary.log_faults.extend(survey.as_ref().and_then(|survey| suggestion(survey, config.odometry.poses)));
    summary.log_faults.extend(little);
    summary.log_faults.extend(recognised::remark(&config.localizer, outcome.map.as_ref()));
    summary.log_faults.extend(recognised::notes(config, &outcome));
    summary.log_faults.extend(of_earlier_runs);
    if config.does_slam() {
        let report = super::closures::read(&config.run.out)?;
        summary.log_faults.extend(super::closures::remark(&report));
        summary.slam = Some(report);
    }
    let earlier = &config.run.r#continue;
    summary.goes_on_with = (!earlier.as_os_str().is_empty()).then(|| earlier.clone());
    summary.files = written(config, &before);
    summary.files_lack = files_lack(config, &outcome);
    summary.recording = recording.map(|file| Recording { is_whole: echogrid_recorder::is_whole(&file), file });
    Ok(summary)
}

pub(super) fn plays_log(config: &Config) -> bool {
    config.services.values().any(|service| service.exec == Exec::Builtin(Builtin::Replay))
}

/// What the processes are told.
fn plan(config: &Config, survey: Option<&LogSurvey>, earlier: Vec<String>) -> Result<Plan> {
    let robot: Option<&Robot> = config.robot.as_ref().or(survey.map(|survey| &survey.robot));
    if let Some(robot) = robot.filter(|robot| robot.sensors.len() > MAX_SENSORS) {
        bail!("robot {:?} has {} sensors, at most {MAX_SENSORS} are possible", robot.name, robot.sensors.len());
    }
    // Who reads its description would refuse what can't be, and all would wait for another.
    if let Some(robot) = robot {
        Robot::try_from(&RobotWire::from(robot)).with_context(|| format!("robot {:?}", robot.name))?;
    }
    // A sonar that the robot does not have, limits that leave a sensor nothing: said before anything is started.
    if let Some(robot) = robot {
        let odometry = &config.odometry;
        GridMapper::new(&config.mapper, odometry.noise, odometry.seed, robot.clone())?;
    }
    let provenance = Provenance { earlier, ..provenance(config, survey)? };
    // What `auto` comes to, the processes can't know.
    let (mut localization, odometry) = (config.resolved_localization(), config.resolved_odometry());
    let has_lidars_alone =
        robot.is_some_and(|robot| robot.sensors.iter().all(|sensor| sensor.kind == SensorKind::Lidar));
    if config.localizer.source == Source::Map && config.localization.hold == Choice::Auto && has_lidars_alone {
        // Beams so long are never trusted much: to wait for better would be to wait for ever.
        localization.hold = false.into();
    }
    let mut table = Config { localization, odometry, ..config.clone() }.to_table()?;
    table.insert("provenance".into(), toml::Value::try_from(&provenance)?);
    table.insert(Plan::SETTINGS.into(), config.run_settings()?.into());
    if config.drives_pioneer() {
        table.insert("robots".into(), toml::Value::try_from(config::known_robots())?);
    }
    Ok(Plan {
        rate: match config.run.rate {
            Rate::Max => None,
            Rate::Times(times) => Some(times),
        },
        max_readings: max_readings(config, survey),
        epoch: new_epoch(),
        state: None,
        synced: false,
        consumers: echogrid_supervision::consumers(&config.services),
        config: table,
    })
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

/// Readings in the largest scan.
pub(super) fn max_readings(config: &Config, survey: Option<&LogSurvey>) -> usize {
    let of_robot = config.robot.as_ref().map_or(READINGS_OF_AN_UNKNOWN_SENSOR, Robot::transducer_count);
    survey.map_or(of_robot, |survey| survey.max_readings_per_scan).max(1)
}

/// Differs between any two runs of this machine.
fn new_epoch() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    // Never 0, which means "no message yet".
    since.as_nanos() as u64 | 1
}

/// Where the map comes from: what goes into its file.
///
/// # Errors
/// The configuration can't be written as TOML.
pub fn provenance(config: &Config, survey: Option<&LogSurvey>) -> Result<Provenance> {
    Ok(Provenance {
        software: concat!("echogrid ", env!("CARGO_PKG_VERSION")).into(),
        log_sha256: survey.map(|survey| survey.sha256.clone()),
        earlier: Vec::new(),
        config_toml: config.provenance_toml(survey.map(|survey| &survey.robot))?,
    })
}

/// An output directory that can't be written is said now, not after the drive; and so is a folder where a file would be.
fn probe_output(config: &Config) -> Result<()> {
    let out = &config.run.out;
    std::fs::create_dir_all(out).with_context(|| format!("making the output directory {}", out.display()))?;
    tempfile::tempfile_in(out).with_context(|| format!("the output directory {} can't be written", out.display()))?;
    file_names(config).iter().try_for_each(|name| Ok(probe_file(&out.join(name))?))
}

/// So is a folder for the record that can't be; the output directory `out` may yet have to be made.
fn probe_record(record: &Path, out: &Path) -> Result<()> {
    if let Some(folder) = record.parent().filter(|folder| !folder.as_os_str().is_empty() && *folder != out) {
        tempfile::tempfile_in(folder)
            .with_context(|| format!("simulator.record: {} can't be written there", record.display()))?;
    }
    ensure!(!record.is_dir(), "simulator.record: {} is a folder; expected a file or nothing", record.display());
    Ok(())
}

/// Nor is a recording ever replaced.
fn probe_recording(file: &Path) -> Result<()> {
    ensure!(
        !file.exists(),
        "{}: is there already, and a recording is never replaced; name another: --record=FILE",
        file.display()
    );
    if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).with_context(|| format!("making the folder {}", folder.display()))?;
        tempfile::tempfile_in(folder)
            .with_context(|| format!("recorder.file: {} can't be written there", file.display()))?;
    }
    Ok(())
}

fn source(config: &Config) -> String {
    if plays_log(config) {
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

/// The files that a run may write.
fn file_names(config: &Config) -> Vec<String> {
    let mut names = MapFiles::names(&config.publisher.map_files());
    names.extend([SONARS_FILE.to_owned(), READINGS_FILE.to_owned()]);
    if config.does_slam() {
        names.extend(echogrid_slam_service::FILES.map(str::to_owned));
    }
    names
}

/// The files that a run may write, as they are on the disk: each by what tells it from any other at its place, whatever the
/// clock says. Of a file that is not there: nothing.
#[derive(Debug)]
struct Files(BTreeMap<PathBuf, (u64, i64, i64)>);

impl Files {
    fn of(config: &Config) -> Self {
        let paths = file_names(config).into_iter().map(|name| config.run.out.join(name));
        let identity = |path: PathBuf| {
            let meta = std::fs::metadata(&path).ok()?;
            Some((path, (meta.ino(), meta.mtime(), meta.mtime_nsec())))
        };
        Self(paths.filter_map(identity).collect())
    }
}

/// The files that were written since it was as `before`; the others are of another run.
fn written(config: &Config, before: &Files) -> Vec<PathBuf> {
    let now = Files::of(config);
    let is_new = |path: &PathBuf| now.0.get(path).is_some_and(|file| before.0.get(path) != Some(file));
    file_names(config).into_iter().map(|name| config.run.out.join(name)).filter(is_new).collect()
}

/// What is said where it was asked which way walls face, and nobody knows.
fn untold_facing(config: &Config, files: &[PathBuf]) -> Option<String> {
    let is_told =
        files.iter().any(|file| file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("facing.")));
    let draws = config.publisher.formats.iter().any(|format| matches!(format, MapFormat::Png | MapFormat::Npy));
    (config.mapper.facing && draws && !files.is_empty() && !is_told).then(|| {
        "mapper.facing: nothing is known of which way walls face: sonars tell it, by mapper.fusion = \"oriented\""
            .to_owned()
    })
}

/// What the publishers say that their files lack of the map.
fn files_lack(config: &Config, outcome: &supervisor::Outcome) -> Vec<String> {
    let publishers = config.services.iter().filter(|(_, service)| service.kind == ServiceKind::Publisher);
    let notes = publishers.filter_map(|(name, _)| Some(outcome.health.get(name)?.note.clone()));
    notes.filter(|note| !note.is_empty()).collect()
}

/// Whatever was mapped must lie on the disk now.
fn check_saved(config: &Config, outcome: &supervisor::Outcome, before: &Files) -> Result<()> {
    let cells = outcome.map.as_ref().map_or(0, |map| map.cells_known);
    let publishes = |exec: &Exec| *exec == Exec::Builtin(Builtin::Publisher);
    let has_publisher = config.services.values().any(|service| publishes(&service.exec));
    let given_up = !outcome.given_up.is_empty();
    ensure!(
        cells == 0 || !has_publisher || given_up || !written(config, before).is_empty(),
        "{} cells were mapped, and no map was saved in {}",
        cells,
        config.run.out.display()
    );
    Ok(())
}

/// Where the map so far is, for whoever reads the error.
fn kept(config: &Config, before: &Files) -> String {
    let files = written(config, before);
    match files.first() {
        Some(_) => format!("the graph stopped early (what is in {} is the map so far)", config.run.out.display()),
        None => format!("the graph stopped early{}", of_an_earlier_run(config)),
    }
}

/// Whose map it is that lies where a run that saved none would have saved its own.
fn of_an_earlier_run(config: &Config) -> String {
    let out = &config.run.out;
    let is_there = |name: &String| out.join(name).exists();
    let lies_there = MapFiles::names(&config.publisher.map_files()).iter().any(is_there);
    if lies_there { format!(" (the map in {} is of an earlier run)", out.display()) } else { String::new() }
}

/// What is said of poses that do not seem to be a drive's.
fn suggestion(survey: &LogSurvey, poses: Poses) -> Option<String> {
    let percent = 100.0 * survey.sideways.share();
    let slide = format!("its poses slide sideways on {percent:.0} % of their way, as those of wheels do not");
    match percent {
        _ if !survey.sideways.is_no_drive() => None,
        // No correction is so large: what they call ahead is not where they go.
        60.0.. => Some(format!("{slide}: are x, y and heading in order, and not mirrored?")),
        _ if poses == Poses::Exact => None,
        _ => Some(format!(
            "{slide}: if they are a SLAM's or from motion capture, --poses exact says that they have no error"
        )),
    }
}

/// How much of a log the times of a reference or of sightings cover; said where that is hardly anything.
///
/// # Errors
/// It is nothing at all: no fix could ever come.
fn overlap(config: &Config, survey: &LogSurvey) -> Result<Option<String>> {
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

/// What is said where a recording is mapped with settings of its run.
fn of_its_run(settings: &[RunSetting]) -> Option<String> {
    let list: Vec<String> = settings.iter().map(|(key, value)| format!("{key} = {value}")).collect();
    let why = "as in the run that it is of (--set replay.use_settings=false takes the defaults)";
    (!list.is_empty()).then(|| format!("mapped with {}, {why}", list.join(", ")))
}

/// What is worth knowing of a log besides its counts.
pub(super) fn remarks(survey: &LogSurvey) -> Vec<String> {
    let mut remarks = survey.clock.remarks();
    remarks.extend(survey.remarks.iter().cloned());
    remarks.extend(survey.faults.iter().map(ToString::to_string));
    if !survey.skipped.is_empty() {
        let kinds: Vec<String> = survey.skipped.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        remarks.push(format!("messages not used: {}", kinds.join(", ")));
    }
    remarks
}
