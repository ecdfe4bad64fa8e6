//! `echogrid evaluate`: every way of mapping, scored where the truth is known.

mod drive;
mod learn;
mod method;
mod report;
mod request;
mod workload;

use anyhow::{Result, ensure};
use echogrid_formats::{probe_file, write_whole};
use echogrid_judge::Quality;
use toml::Value;

use self::drive::{Drive, Lesson};
use self::learn::Lessons;
use self::method::{Method, Schedule};
use self::report::{Report, Row, Table};
pub use self::request::{Evaluate, Goal};
use self::workload::Workload;
use crate::{jobs, json};
use echogrid_config::{Config, LoadRequest};

/// Carries out the evaluation; its report, as text or JSON.
///
/// # Errors
/// A drive, log, world or setting is wrong, or a file can't be written.
pub fn run(request: &Evaluate) -> Result<String> {
    ensure!(request.seeds > 0, "--seeds 0: expected 1 or more");
    // Whatever is wrong is said before hours of work.
    let methods = method::methods(&request.methods)?;
    let schedules = method::schedules(&request.fixes)?;
    let drives = drive::simulated(&request.worlds, request.seeds)?;
    let learn_on = drive::simulated(&request.learn, request.seeds)?;
    let logs = request.logs.iter().map(|log| drive::logged(log, request.align)).collect::<Result<Vec<Drive>>>()?;
    let workload = request.workload.as_deref().map(Workload::read).transpose()?;
    request.out.iter().try_for_each(|file| probe_file(file))?;

    let lessons = |drives: &[Drive]| jobs::run("drive", drives, |drive| Lesson::of(drive, &request.sets));
    let learnt = match lessons(&learn_on)? {
        none if none.is_empty() => Vec::new(),
        lessons => {
            let is_asked = |fusion: &str| methods.iter().any(|method| method.fusion() == Some(fusion));
            let (common, goal) = (&request.sets, request.goal);
            let lessons = Lessons { drives: &lessons, schedules: &schedules, common, goal };
            learn::learn(&lessons, is_asked, setting(request)?)?
        }
    };
    let sets_of = |method: &Method| {
        let learnt = learnt
            .iter()
            .filter(|learnt| Some(learnt.fusion) == method.fusion())
            .flat_map(|learnt| learnt.sets.clone());
        let own = method.sets.iter().map(|set| (*set).to_owned());
        learnt.chain(request.sets.iter().cloned()).chain(own).collect::<Vec<String>>()
    };
    let mut tables = Vec::new();
    if !drives.is_empty() {
        let about = format!("{} simulated drives: {}, {} each", drives.len(), request.worlds.join(", "), request.seeds);
        tables.push(Table { about, rows: judge(&lessons(&drives)?, &methods, &schedules, sets_of)? });
    }
    for (named, log) in request.logs.iter().zip(logs) {
        let about = named.rsplit('/').next().unwrap_or(named).to_owned();
        let name = named.split('=').next().and_then(|log| log.rsplit('/').next()).unwrap_or_default();
        tables.push(Table {
            about: format!("{name} in {about}, {}", request.align.words()),
            rows: judge(&lessons(&[log])?, &methods, &schedules, sets_of)?,
        });
    }
    let on_workload = match &workload {
        Some(workload) => {
            let judged = jobs::run("map of the workload", &methods, |method| workload.judge(&sets_of(method)))?;
            methods.iter().map(|method| method.name).zip(judged).collect()
        }
        None => Vec::new(),
    };
    let columns = schedules.iter().map(|schedule| schedule.name).collect();
    let report = Report { learnt, columns, tables, workload: on_workload };
    if let Some(file) = &request.out {
        write_whole(file, report.markdown().as_bytes())?;
    }
    if request.json { json(&report) } else { Ok(report.markdown()) }
}

/// Where learning begins: what is configured.
fn setting(request: &Evaluate) -> Result<impl Fn(&str) -> Option<f64>> {
    let load =
        LoadRequest { sensor: Some("simulator".to_owned()), sets: request.sets.clone(), ..LoadRequest::default() };
    let table = Config::load(&load)?.table().clone();
    Ok(move |key: &str| {
        let (section, key) = key.split_once('.')?;
        table.get(section)?.get(key).and_then(Value::as_float)
    })
}

/// Every method by every schedule, over these drives.
fn judge(
    drives: &[Lesson],
    methods: &[Method],
    schedules: &[Schedule],
    sets_of: impl Fn(&Method) -> Vec<String> + Sync,
) -> Result<Vec<Row>> {
    let runs: Vec<_> = methods
        .iter()
        .flat_map(|method| schedules.iter().flat_map(move |at| drives.iter().map(move |drive| (method, at, drive))))
        .collect();
    let judged = jobs::run("map", &runs, |(method, schedule, drive)| {
        let told = schedule.sets.iter().map(|set| (*set).to_owned());
        drive.judge(&told.chain(sets_of(method)).collect::<Vec<_>>())
    })?;
    let mut columns = judged.chunks_exact(drives.len()).map(mean);
    Ok(methods
        .iter()
        .map(|method| Row { method: method.name, columns: columns.by_ref().take(schedules.len()).collect() })
        .collect())
}

fn mean(judged: &[Quality]) -> Quality {
    let of = |figure: fn(&Quality) -> f64| judged.iter().map(figure).sum::<f64>() / judged.len().max(1) as f64;
    Quality {
        bits: of(|quality| quality.bits),
        bits_occupied: of(|quality| quality.bits_occupied),
        bits_free: of(|quality| quality.bits_free),
        calibration_error: of(|quality| quality.calibration_error),
        decided: of(|quality| quality.decided),
        decided_wrong: of(|quality| quality.decided_wrong),
        free_called_occupied: of(|quality| quality.free_called_occupied),
        wall_recall_10cm: of(|quality| quality.wall_recall_10cm),
        wall_precision_10cm: of(|quality| quality.wall_precision_10cm),
    }
}
