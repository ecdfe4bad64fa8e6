//! `echogrid calibrate`.

mod drive;
mod picture;
mod report;
mod request;
mod section;
mod sensor;
mod simulate;
#[cfg(test)]
mod tests;
mod trials;

use anyhow::{Context, Result, ensure};
use echogrid_core::Calibration;
use echogrid_core::calibration::{Bootstrap, RESAMPLES};
use echogrid_core::config::OdometryConfig;
use echogrid_formats::probe_file;

pub use self::request::{CALIBRATE_HELP, Calibrate, CalibrateSensor, CalibrateWhat, png};
use crate::told;
use report::Report;
use trials::Found;

/// Makes an odometry error model, or one of sonars, and tells how far it can be trusted, as text or JSON.
///
/// # Errors
/// A trial, log or setting is wrong, they don't tell enough, or a file can't be written.
pub fn run(request: &Calibrate) -> Result<String> {
    if let Some(CalibrateWhat::Sensor(request)) = &request.what {
        return sensor::run(request);
    }
    let report = calibrate(request)?;
    told(&report, request.json)
}

fn calibrate(request: &Calibrate) -> Result<Report> {
    // Before anything is read: that may take a while.
    if let Some(file) = request.out.as_deref().filter(|file| !request.force && file.exists()) {
        anyhow::bail!("{}: is there already; --force replaces it", file.display());
    }
    [&request.picture, &request.out].into_iter().flatten().try_for_each(|file| probe_file(file))?;
    let found = find(request)?;
    let fit = Calibration::fit(&found.translations, &found.rotations).with_context(|| found.name.clone())?;
    // What no graph would take is no model, either.
    fit.applied_to(&OdometryConfig::default()).validate().with_context(|| format!("{}: the fit", found.name))?;
    let interval = Bootstrap::of(&found.translations, &found.rotations, RESAMPLES, request.seed)
        .with_context(|| found.name.clone())?;
    let report = Report::new(request, &found, &fit, &interval);
    if let Some(file) = &request.picture {
        picture::write(file, &found, &fit)?;
    }
    if let Some(file) = &request.out {
        section::write(file, &report, &fit)?;
    }
    Ok(report)
}

/// The trials that were asked for.
fn find(request: &Calibrate) -> Result<Found> {
    if request.simulate {
        return simulate::trials(request);
    }
    let tables = request.inputs.iter().filter(|input| trials::is_table(input)).count();
    ensure!(tables == 0 || tables == request.inputs.len(), "tables and logs together; expected one or the other");
    if tables > 0 { trials::of_tables(request) } else { drive::trials(request) }
}
