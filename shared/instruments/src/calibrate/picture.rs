//! What the trials erred by, and what the model makes of it.

use std::path::Path;

use anyhow::Result;
use echogrid_core::{Calibration, Trial};
use echogrid_formats::chart::{self, Panel};

use super::trials::Found;

/// Each phase along its own axis, with the fitted line and twice the standard deviation around it.
pub(super) fn write(file: &Path, found: &Found, fit: &Calibration) -> Result<()> {
    let points = |trials: &[Trial], of: fn(&Trial) -> [f64; 2]| trials.iter().map(of).collect();
    let panels = [
        Panel {
            title: format!("{} translations, slope {:.4}", found.translations.len(), fit.lin_scale),
            x: "measured Δl, m".to_owned(),
            y: "linear error, m; band ±2σ".to_owned(),
            points: points(&found.translations, |trial| [trial.measured_m, trial.lin_error_m()]),
            slope: fit.lin_scale,
            band: 2.0 * fit.k_ll.sqrt(),
        },
        Panel {
            title: format!("{} rotations, slope {:.4}", found.rotations.len(), fit.ang_scale),
            x: "measured Δθ, rad".to_owned(),
            y: "angular error, rad; band ±2σ".to_owned(),
            points: points(&found.rotations, |trial| [trial.measured_rad, trial.ang_error_rad()]),
            slope: fit.ang_scale,
            band: 2.0 * fit.k_tt.sqrt(),
        },
    ];
    Ok(chart::write(file, &panels)?)
}
