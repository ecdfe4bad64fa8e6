//! `echogrid` without a command, and `echogrid demo`: a simulated Pioneer 3-AT maps an office floor.

use anyhow::Result;
use echogrid_instruments::json;
use serde::Serialize;

use super::{graph, score};
use crate::cli::View;
use crate::config::{Config, LoadRequest, MAP_FILE};
use crate::summary::Summary;

/// As fast as the slowest process can, it would be over before anybody looked.
const WATCHED_RATE: &str = "8";
/// The drive as a log, beside the map.
const DRIVE: &str = "drive.log.gz";

/// Maps the floor, and tells how good the map is.
pub(super) fn run(asked: LoadRequest, view: &View) -> Result<()> {
    let mut request = asked.for_demo();
    if view.watch.is_some() && request.rate.is_none() {
        request.rate = Some(WATCHED_RATE.to_owned());
    }
    let config = Config::load(&request)?.into_config();
    let recorded = !config.simulator.record.as_os_str().is_empty();
    let drive = if recorded { config.simulator.record } else { config.run.out.join(DRIVE) };
    if !recorded {
        // Not as an argument of its own: a path may hold what is no TOML.
        request.record = Some(drive.to_string_lossy().into_owned());
    }
    let summary = graph::summary_of(&request, view)?;
    let request = score::Request {
        map: config.run.out.join(MAP_FILE),
        world: config.simulator.world.into(),
        path: Some(drive),
        truth: None,
        topics: Vec::new(),
        align: None,
        points: false,
        json: view.json,
        picture: Some(config.run.out.join("score.png")),
    };
    if view.json {
        // The map is there whether or not it can be judged.
        let judged = score::judge(&request);
        let told = Told { summary: &summary, score: judged.as_ref().ok() };
        super::print(&json(&told)?)?;
        judged?;
    } else {
        super::print(&summary.to_string())?;
        score::run(&request)?;
    }
    graph::check_recording(&summary)
}

/// One document: the summary of the run, and the score of its map.
#[derive(Serialize)]
struct Told<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    score: Option<&'a score::Score<'a>>,
}
