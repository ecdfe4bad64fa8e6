//! What a calibration came to, for people and as JSON.

use std::fmt;
use std::path::PathBuf;

use echogrid_core::Calibration;
use echogrid_core::calibration::{Bootstrap, RESAMPLES};
use serde::Serialize;

use super::request::Calibrate;
use super::trials::Found;

/// A coefficient: its key in `[odometry]`, its unit, and where it is.
type Of = (&'static str, &'static str, fn(&Calibration) -> f64);

/// In the order of `[odometry]`.
const ALL: [Of; 8] = [
    ("lin_scale", "m/m", |c| c.lin_scale),
    ("lin_offset_m", "m", |c| c.lin_offset_m),
    ("ang_scale", "rad/rad", |c| c.ang_scale),
    ("ang_offset_rad", "rad", |c| c.ang_offset_rad),
    ("k_ll", "m²/m", |c| c.k_ll),
    ("k_lt", "m²/rad", |c| c.k_lt),
    ("k_tt", "rad²/rad", |c| c.k_tt),
    ("k_tl", "rad²/m", |c| c.k_tl),
];

/// All of it.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    /// Where the trials are from.
    pub(super) from: String,
    /// Poses of the drives where the truth was known.
    #[serde(skip_serializing_if = "Option::is_none")]
    known_poses: Option<usize>,
    pub(super) translations: Trials,
    pub(super) rotations: Trials,
    /// How often trials were drawn anew for the intervals.
    resamples: usize,
    seed: u64,
    pub(super) coefficients: Vec<Coefficient>,
    picture: Option<PathBuf>,
    out: Option<PathBuf>,
}

/// The trials of a phase.
#[derive(Debug, Serialize)]
pub(super) struct Trials {
    pub(super) count: usize,
    /// What was measured of all of them, back and forth: metres of translations, radians of rotations.
    pub(super) measured: f64,
}

/// One coefficient.
#[derive(Debug, Serialize)]
pub(super) struct Coefficient {
    pub(super) key: &'static str,
    pub(super) unit: &'static str,
    pub(super) estimate: f64,
    /// Ends of the 95 % confidence interval.
    pub(super) low: f64,
    pub(super) high: f64,
    /// What a simulator was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) given: Option<f64>,
    /// Whether that lies in the interval.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) inside: Option<bool>,
}

impl Report {
    pub(super) fn new(request: &Calibrate, found: &Found, fit: &Calibration, interval: &Bootstrap) -> Self {
        let coefficient = |(key, unit, of): Of| {
            let (estimate, low, high) = (of(fit), of(&interval.low), of(&interval.high));
            let given = found.given.as_ref().map(of);
            let inside = given.map(|given| (low..=high).contains(&given));
            Coefficient { key, unit, estimate, low, high, given, inside }
        };
        let measured = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).sum();
        Self {
            from: found.name.clone(),
            known_poses: found.known,
            translations: Trials {
                count: found.translations.len(),
                measured: measured(&mut found.translations.iter().map(|trial| trial.measured_m)),
            },
            rotations: Trials {
                count: found.rotations.len(),
                measured: measured(&mut found.rotations.iter().map(|trial| trial.measured_rad)),
            },
            resamples: RESAMPLES,
            seed: request.seed,
            coefficients: ALL.map(coefficient).into(),
            picture: request.picture.clone(),
            out: request.out.clone(),
        }
    }

    /// What it was made of, in one line.
    pub(super) fn made_of(&self) -> String {
        let Self { from, translations, rotations, .. } = self;
        format!(
            "{from}: {} translations ({:.1} m), {} rotations ({:.1} rad)",
            translations.count, translations.measured, rotations.count, rotations.measured
        )
    }
}

/// Five decimals, or three digits where that would show hardly any.
pub(super) fn shown(value: f64) -> String {
    if value == 0.0 || value.abs() >= 2e-3 { format!("{value:.5}") } else { format!("{value:.2e}") }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.made_of())?;
        let known = self.coefficients.iter().any(|coefficient| coefficient.given.is_some());
        let given = if known { format!("{:>12}", "given") } else { String::new() };
        writeln!(f, "{:<16}{:<9}{:>10}{:>26}{given}", "", "unit", "estimate", "95 % interval")?;
        for Coefficient { key, unit, estimate, low, high, given, inside } in &self.coefficients {
            let interval = format!("{} … {}", shown(*low), shown(*high));
            write!(f, "{key:<16}{unit:<9}{:>10}{interval:>26}", shown(*estimate))?;
            match (given, inside) {
                (Some(given), Some(inside)) => {
                    writeln!(f, "{:>12} {}", shown(*given), if *inside { "inside" } else { "outside" })?;
                }
                _ => writeln!(f)?,
            }
        }
        if known {
            let inside = self.coefficients.iter().filter(|coefficient| coefficient.inside == Some(true)).count();
            let all = self.coefficients.len();
            writeln!(f, "{inside} of {all} intervals hold what was given; an interval does so 95 times in 100")?;
        }
        if let Some(picture) = &self.picture {
            writeln!(f, "picture         {}", picture.display())?;
        }
        if let Some(out) = &self.out {
            writeln!(f, "written         {0} (echogrid map LOG --config {0})", out.display())?;
        }
        Ok(())
    }
}
