//! `echogrid calibrate sensor`: the parameters of the oriented model that make a drive's own echoes most probable.

mod drive;
mod report;
mod search;
mod section;
#[cfg(test)]
mod tests;

use anyhow::Result;
use echogrid_formats::probe_file;

use crate::calibrate::CalibrateSensor;
use drive::Heard;
use report::Report;

/// Learns the parameters, and tells how surely.
pub(super) fn run(request: &CalibrateSensor) -> Result<String> {
    let report = learn(request)?;
    crate::told(&report, request.json)
}

fn learn(request: &CalibrateSensor) -> Result<Report> {
    if let Some(file) = request.out.as_deref().filter(|file| !request.force && file.exists()) {
        anyhow::bail!("{}: is there already; --force replaces it", file.display());
    }
    request.out.iter().try_for_each(|file| probe_file(file))?;
    let heard = Heard::of(request)?;
    let found = search::search(&heard, request.seed)?;
    let report = Report::new(request, &heard, found);
    if let Some(file) = &request.out {
        section::write(file, &report, &heard.mapper)?;
    }
    Ok(report)
}
