//! The odometry error model: what a way and a turn are wrong by (eqs 1–4).

use serde::{Deserialize, Serialize};

use crate::config::{OdometryConfig, Systematic};

/// What the odometry may be wrong by since the last absolute fix.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct OdometryErrors {
    /// E_lin: systematic linear error, metres (eq 1); 0 unless systematic errors are carried.
    pub e_lin_m: f64,
    /// E_ang: systematic angular error, radians (eq 2); 0 unless systematic errors are carried.
    pub e_ang_rad: f64,
    /// ε_lin: variance of the linear error, m² (eq 3).
    pub eps_lin_m2: f64,
    /// ε_ang: variance of the angular error, rad² (eq 4).
    pub eps_ang_rad2: f64,
}

/// Eqs 1–4: the errors as functions of the way travelled and turned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorModel {
    pub(super) config: OdometryConfig,
}

impl ErrorModel {
    /// The error model of a configuration.
    #[must_use]
    pub fn new(config: &OdometryConfig) -> Self {
        Self { config: config.clone() }
    }

    /// Eqs 1–4: the errors E_lin, E_ang, ε_lin, ε_ang after travelling Λ = `travel_m` and turning Θ = `turn_rad` (both sums of absolute values, 0 or more).
    #[must_use]
    pub fn errors(&self, travel_m: f64, turn_rad: f64) -> OdometryErrors {
        let c = &self.config;
        let (e_lin_m, e_ang_rad) = match c.systematic {
            Systematic::Carry => {
                let sigma = if turn_rad >= c.lin_offset_from_turn_rad { c.lin_offset_m } else { 0.0 };
                let alpha = if travel_m >= c.ang_offset_from_travel_m { c.ang_offset_rad } else { 0.0 };
                (c.lin_scale * travel_m + sigma, c.ang_scale * turn_rad + alpha)
            }
            Systematic::Correct | Systematic::Off => (0.0, 0.0),
        };
        OdometryErrors {
            e_lin_m,
            e_ang_rad,
            eps_lin_m2: c.k_ll * travel_m + c.k_lt * turn_rad,
            eps_ang_rad2: c.k_tt * turn_rad + c.k_tl * travel_m,
        }
    }
}
