//! What each command does.

mod check;
pub(crate) mod closures;
mod demo;
mod doctor;
mod emulate;
mod folder;
mod going_on;
mod graph;
mod info;
mod live;
mod manual;
mod new;
mod recognised;
mod relations;
mod score;
mod service;
mod spool;
mod stale;
mod status;
mod talk;
mod topic;
mod walls;
mod why;

use std::fmt::Display;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use echogrid_core::Pose2;
use echogrid_formats::convert::{MapLayer, convert_layer, convert_with};
use echogrid_instruments::{calibrate, evaluate, experiment, told};
use echogrid_replay::config::{LogUnit, ReplayConfig};
use echogrid_service::{in_words, logging, signals};
use serde::Serialize;

use crate::cli::{Cli, Command, Experiment, MapLayerName, NewCommand, View};
use crate::config::{LoadRequest, MAP_FILE};

/// Carries out a command: 0 done, 1 failed with one error on standard error.
#[must_use]
pub fn run(cli: Cli) -> ExitCode {
    signals::survive_file_size_limit();
    let view = cli.command.as_ref().and_then(Command::view);
    let _whose = view.filter(|view| view.logs_json()).map(|_| logging::start_json("launcher"));
    let result = match cli.command {
        None => demo::run(LoadRequest::default(), &View::default()),
        Some(Command::Demo { seed, settings, view }) => {
            let mut request = settings.request();
            request.sets.splice(0..0, seed.map(|seed| format!("simulator.seed={seed}")));
            demo::run(request, &view)
        }
        Some(Command::Map { log, topics, config, settings, view }) => {
            let log = log.to_string_lossy().into_owned();
            // Whatever the sensor of that graph is, here it is the log.
            let sensor = config.is_some().then(|| "replay".to_owned());
            graph::run(&LoadRequest { graph: config, sensor, log: Some(log), topics, ..settings.request() }, &view)
        }
        Some(Command::Info { file, json }) => {
            // A folder may be a recording, too.
            let map = file.join(MAP_FILE);
            info::run(if map.is_file() { &map } else { &file }, json)
        }
        Some(Command::Up { graph, sensor, topics, settings, view }) => {
            graph::run(&LoadRequest { graph: Some(graph), sensor, topics, ..settings.request() }, &view)
        }
        Some(Command::Check { schema: Some(files), .. }) => check::print_schema(files),
        Some(Command::Check { graph, sensor, map, settings, .. }) => {
            check::run(&LoadRequest { graph, sensor, ..settings.request() }, map)
        }
        Some(Command::Doctor { graph, sensor, clean, json, settings }) => {
            doctor::run(LoadRequest { graph, sensor, ..settings.request() }, clean, json)
        }
        Some(Command::Save { domain }) => talk::save(domain.as_deref()),
        Some(Command::Pause { domain }) => talk::pause(domain.as_deref()),
        Some(Command::Resume { domain }) => talk::resume(domain.as_deref()),
        Some(Command::Fix { x, y, theta, sigma, heading_sigma, domain }) => {
            talk::fix(domain.as_deref(), Pose2 { x, y, theta }, sigma, heading_sigma)
        }
        Some(Command::Drive { v, w, seconds, domain }) => talk::drive(domain.as_deref(), v, w, seconds),
        Some(Command::Emulate(request)) => emulate::run(&request),
        Some(Command::Live { domain, listen, hosts }) => live::run(live::Request { domain, listen, hosts }),
        Some(Command::Record { file, native_only, domain }) => talk::record(domain.as_deref(), &file, !native_only),
        Some(Command::Status { domain, json, watch }) => status::run(domain.as_deref(), json, watch),
        Some(Command::Completions { shell }) => manual::completions(shell),
        Some(Command::Man { out }) => manual::pages(out.as_deref()),
        Some(Command::Convert { input, output, range_unit, layer }) => convert(&input, &output, range_unit, layer),
        Some(Command::Score { map, world, path, truth, topics, align, points, json, picture }) => {
            let map = map_in(map);
            score::run(&score::Request { map, world, path, truth, topics, align, points, json, picture })
        }
        Some(Command::Walls { map, within, json, picture }) => {
            walls::run(&map_in(map), within, json, picture.as_deref())
        }
        Some(Command::Closures { map, json }) => closures::run(&map, json),
        Some(Command::Relations { relations, path, mount, json }) => {
            relations::run(&relations, &path, mount.and_then(|mount| mount.try_into().ok()), json)
        }
        Some(Command::Why { x, y, map, domain, limit, json }) => {
            let map = if domain.is_some() { talk::saved_map(domain.as_deref()) } else { Ok(map) };
            map.and_then(|map| why::run(&why::Request { at: [x, y], map: map_in(map), json, limit }))
        }
        Some(Command::Calibrate(request)) => calibrate::run(&request).and_then(|report| print(&report)),
        Some(Command::Experiment { name: Experiment::Paper, out, world, seed, json }) => {
            let request = experiment::Request { out, world, seed, json };
            experiment::run(&request).and_then(|scores| print(&scores))
        }
        Some(Command::Evaluate(request)) => evaluate::run(&request).and_then(|report| print(&report)),
        Some(Command::Topic(command)) => topic::run(&command),
        Some(Command::New(NewCommand::Sensor { folder, lang, source })) => {
            new::sensor(lang, &folder, source.as_deref())
        }
        Some(Command::Janitor) => service::janitor(),
        // Its own logs say what went wrong.
        Some(Command::Service { name, domain, arguments }) => return service::run(&name, domain, arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if logging::is_json() => {
            tracing::error!("{}", in_words(&error));
            ExitCode::FAILURE
        }
        Err(error) => {
            // Standard error may be closed; nobody is there to hear of that.
            let _ = writeln!(std::io::stderr(), "echogrid: {}", in_words(&error));
            ExitCode::FAILURE
        }
    }
}

fn convert(input: &Path, output: &Path, range_unit: LogUnit, layer: Option<MapLayerName>) -> Result<()> {
    let options = ReplayConfig { range_unit, ..ReplayConfig::default() }.survey_options();
    let report = match layer {
        None => convert_with(input, output, options)?,
        Some(MapLayerName::Doubt) => convert_layer(input, output, MapLayer::Doubt)?,
        Some(MapLayerName::Facing) => convert_layer(input, output, MapLayer::Facing)?,
    };
    let mut text = format!("{}\n", report.input);
    for path in &report.written {
        text += &format!("written   {}\n", path.display());
    }
    for remark in &report.remarks {
        text += &format!("log       {remark}\n");
    }
    for lost in &report.lost {
        text += &format!("lost      {lost}\n");
    }
    print(&text)
}

/// The native map that somebody named: the file, or the folder that it is in.
fn map_in(path: PathBuf) -> PathBuf {
    if path.is_dir() { path.join(MAP_FILE) } else { path }
}

/// Prints what was found: as JSON for programs, or as text for people.
fn print_found(found: &(impl Serialize + Display), as_json: bool) -> Result<()> {
    print(&told(found, as_json)?)
}

/// Prints to standard output; a reader that has had enough (`| head`) is no error.
fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).context("printing"),
        _ => Ok(()),
    }
}
