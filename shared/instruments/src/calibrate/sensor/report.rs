//! What a drive says of its sonars, for people and as JSON.

use std::fmt;
use std::path::PathBuf;

use echogrid_core::calibration::Told;
use serde::Serialize;

use super::drive::Heard;
use super::search::{ALL, Found, RANGE_ERROR_RATIO};
use crate::calibrate::CalibrateSensor;

/// All of it.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) from: String,
    way_m: f64,
    /// Sonar echoes that can be mapped, and how many of them the map was asked about.
    echoes: usize,
    asked: usize,
    /// ln p of an echo before it was taken, in the mean, nat: as the sensor model was, and as it is best.
    pub(super) nats_before: f64,
    pub(super) nats_after: f64,
    pub(super) parameters: Vec<Learnt>,
    out: Option<PathBuf>,
}

/// A parameter.
#[derive(Debug, Serialize)]
pub(super) struct Learnt {
    pub(super) key: &'static str,
    pub(super) unit: &'static str,
    pub(super) was: f64,
    pub(super) estimate: f64,
    /// Ends of the 95 % interval.
    pub(super) low: f64,
    pub(super) high: f64,
    /// Whether the drive tells it at all.
    pub(super) told: bool,
    /// That it may be still less, or still more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) bound: Option<&'static str>,
}

impl Report {
    pub(super) fn new(request: &CalibrateSensor, heard: &Heard, found: Found) -> Self {
        let learnt = |(parameter, (was, told)): (&super::search::Parameter, (f64, Told))| {
            let Told { estimate, low, high, is_told, is_at_end } = told;
            let bound = match is_at_end {
                [true, false] => Some("or less"),
                [false, true] => Some("or more"),
                _ => None,
            };
            Learnt {
                key: parameter.key,
                unit: parameter.unit,
                was,
                estimate: rounded(estimate),
                low: rounded(low),
                high: rounded(high),
                told: is_told,
                bound,
            }
        };
        let asked = heard.asked();
        let [nats_before, nats_after] = found.nats.map(|sum| sum / asked as f64);
        Self {
            from: request.log.display().to_string(),
            way_m: heard.way_m,
            echoes: heard.echoes,
            asked,
            nats_before,
            nats_after,
            parameters: ALL.iter().zip(found.told).map(learnt).collect(),
            out: request.out.clone(),
        }
    }

    /// What it was made of, in one line.
    pub(super) fn made_of(&self) -> String {
        format!("{}: {} sonar echoes on {:.1} m of way", self.from, self.echoes, self.way_m)
    }

    pub(super) fn told(&self) -> impl Iterator<Item = &Learnt> {
        self.parameters.iter().filter(|learnt| learnt.told)
    }
}

impl Learnt {
    /// The value for maps: of the critical incidence the lower end of the interval, for too large an angle erases walls, and too small
    /// a one only leaves some free space grey.
    pub(super) fn for_maps(&self) -> f64 {
        if self.key == "oriented_incidence_deg" { self.low } else { self.estimate }
    }

    /// Where it goes: the sonars are the robot's.
    pub(super) fn is_of_robot(&self) -> bool {
        self.key == RANGE_ERROR_RATIO
    }
}

/// Three digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.made_of())?;
        let Self { asked, nats_before, nats_after, .. } = self;
        writeln!(
            f,
            "{asked} of them were asked of the map before it took them: {nats_after:.3} nat an echo at best, {nats_before:.3} as it was"
        )?;
        writeln!(f, "{:<24}{:<13}{:>8}{:>10}{:>22}", "", "unit", "was", "estimate", "95 % interval")?;
        for Learnt { key, unit, was, estimate, low, high, told, bound } in &self.parameters {
            let interval = format!("{low} … {high}");
            let note = if *told { bound.unwrap_or_default() } else { "this drive can't tell" };
            let line = format!("{key:<24}{unit:<13}{was:>8}{estimate:>10}{interval:>22}   {note}");
            writeln!(f, "{}", line.trim_end())?;
        }
        if let Some(ratio) = self.told().find(|learnt| learnt.is_of_robot()) {
            writeln!(f, "{RANGE_ERROR_RATIO} belongs to the robot: [sonars] of its file, {}", ratio.estimate)?;
        }
        if let Some(out) = &self.out {
            writeln!(f, "written         {0} (echogrid map LOG --config {0})", out.display())?;
        }
        Ok(())
    }
}
