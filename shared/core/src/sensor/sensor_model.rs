//! The inverse sensor model (eqs 21–23, Figs 4–6): what one reading says about one cell. The reference, in double
//! precision, one cell at a time; [`crate::kernel`] is the fast way to the same numbers.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::noise::NoiseTerms;
use crate::odometry::OdometryErrors;

/// k: region II reaches this many σ_z to either side of the echo.
pub const BAND: f64 = 2.0;

/// The deviations of a reading, and what they leave of its weight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Deviations {
    /// σ_z, metres: how far off the range may be (eq 22).
    pub sigma_z_m: f64,
    /// σ_θ, radians: how far off the bearing may be (eq 23).
    pub sigma_theta_rad: f64,
    /// w = σ_z0 σ_θ0 / (σ_z σ_θ), in [0, 1]: 1 without odometry error. NaN where the errors are.
    pub trust: f64,
}

impl Deviations {
    /// Eqs 22, 23 for a reading of `range_m` by a sensor of aperture β = `aperture_rad` and range error
    /// η = `range_error_ratio`, on a grid of `resolution_m`.
    #[must_use]
    pub fn of(
        range_m: f64,
        aperture_rad: f64,
        range_error_ratio: f64,
        resolution_m: f64,
        errors: &OdometryErrors,
        noise: NoiseTerms,
    ) -> Self {
        // Without odometry error; a range is never known better than half a cell.
        let sensor_z_m = range_m * range_error_ratio;
        let sigma_z0_m = sensor_z_m.max(0.5 * resolution_m);
        let sigma_theta0_rad = 0.5 * aperture_rad;
        // With it: a lucky draw must not make the reading better than the sensor.
        let sigma_z_m = at_least(sigma_z0_m, sensor_z_m + errors.e_lin_m + noise.lin_m);
        let sigma_theta_rad = at_least(sigma_theta0_rad, sigma_theta0_rad + errors.e_ang_rad + noise.ang_rad);
        let trust = (sigma_z0_m * sigma_theta0_rad) / (sigma_z_m * sigma_theta_rad);
        Self { sigma_z_m, sigma_theta_rad, trust }
    }

    /// The deviations from the covariance of the transducer's pose (x, y, θ; m², m rad, rad²) instead of eqs 22, 23.
    ///
    /// Of a reading along `bearing_rad` in the map: u along the beam, v across it,
    /// σ_z² = σ_z0² + uᵀ C_xy u, σ_θ² = σ_θ0² + C_θθ + vᵀ C_xy v / z² + 2 vᵀ C_xyθ / z.
    #[must_use]
    pub fn of_covariance(
        range_m: f64,
        bearing_rad: f64,
        aperture_rad: f64,
        range_error_ratio: f64,
        resolution_m: f64,
        covariance: &Matrix3<f64>,
    ) -> Self {
        let sigma_z0_m = (range_m * range_error_ratio).max(0.5 * resolution_m);
        let sigma_theta0_rad = 0.5 * aperture_rad;
        let (sin, cos) = libm::sincos(bearing_rad);
        let c = covariance;
        let along_m2 = cos * cos * c[(0, 0)] + 2.0 * sin * cos * c[(0, 1)] + sin * sin * c[(1, 1)];
        let across_m2 = sin * sin * c[(0, 0)] - 2.0 * sin * cos * c[(0, 1)] + cos * cos * c[(1, 1)];
        let across_heading = cos * c[(1, 2)] - sin * c[(0, 2)];
        let square_z = sigma_z0_m * sigma_z0_m + along_m2;
        let square_theta = sigma_theta0_rad * sigma_theta0_rad
            + c[(2, 2)]
            + across_m2 / (range_m * range_m)
            + 2.0 * across_heading / range_m;
        let sigma_z_m = at_least(sigma_z0_m, square_z.sqrt());
        let sigma_theta_rad = at_least(sigma_theta0_rad, square_theta.max(0.0).sqrt());
        let trust = (sigma_z0_m * sigma_theta0_rad) / (sigma_z_m * sigma_theta_rad);
        Self { sigma_z_m, sigma_theta_rad, trust }
    }
}

/// Not `f64::max`, which would take a NaN, an error that nobody knows, for the floor: no error at all.
fn at_least(floor: f64, value: f64) -> f64 {
    if value < floor { floor } else { value }
}

/// w of a reading of 2 m whose noise is one standard deviation: how far mapping can be trusted now, in [0, 1].
/// `aperture_rad`, `range_error_ratio`: of the sensor; `resolution_m`: of the grid.
#[must_use]
pub fn nominal_trust(errors: &OdometryErrors, aperture_rad: f64, range_error_ratio: f64, resolution_m: f64) -> f64 {
    const NOMINAL_RANGE_M: f64 = 2.0;
    let noise = NoiseTerms::one_sigma(errors);
    Deviations::of(NOMINAL_RANGE_M, aperture_rad, range_error_ratio, resolution_m, errors, noise).trust
}

/// The regions of Fig. 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Region {
    /// I: nothing there, else the echo had come sooner.
    Free,
    /// II: the echo came from here.
    Echo,
    /// III: the reading says nothing about it.
    Unseen,
}

/// One reading, ready to be asked about cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// z: range of the echo, metres.
    pub range_m: f64,
    /// β: full aperture, radians.
    pub aperture_rad: f64,
    /// r_cap: the range to which the sensor can see at all, metres.
    pub range_cap_m: f64,
    /// Eqs 22, 23.
    pub deviations: Deviations,
    /// Peak of region II without odometry error, in (½, 1).
    pub p_occupied: f64,
    /// Peak (lowest) of region I without odometry error, in (0, ½).
    pub p_free: f64,
    /// Whether there are gaps between the beam and its neighbours. Where it is thinner than a cell, all cells that its axis crosses
    /// belong to it then, and none besides: it would pass between their centres.
    pub leaves_gaps: bool,
}

impl Cone {
    /// z − kσ_z: where region II begins, metres; not above 0 if there is no region I.
    #[must_use]
    pub fn near_m(&self) -> f64 {
        self.range_m - BAND * self.deviations.sigma_z_m
    }

    /// min(z + kσ_z, r_cap): where region II ends, metres.
    #[must_use]
    pub fn far_m(&self) -> f64 {
        (self.range_m + BAND * self.deviations.sigma_z_m).min(self.range_cap_m)
    }

    /// The region of a cell centre at `distance_m` from the transducer and `bearing_rad` (wrapped) off its axis.
    #[must_use]
    pub fn region(&self, distance_m: f64, bearing_rad: f64) -> Region {
        let in_cone = bearing_rad.abs() <= 0.5 * self.aperture_rad && distance_m > 0.0 && distance_m <= self.far_m();
        if !in_cone {
            Region::Unseen
        } else if distance_m < self.near_m() {
            Region::Free
        } else {
            Region::Echo
        }
    }

    /// Eq 21: the probability that the cell is occupied given this reading alone, in (0, 1), at `distance_m` metres from the
    /// transducer and `bearing_rad` radians off its axis; none in region III.
    #[must_use]
    pub fn probability(&self, distance_m: f64, bearing_rad: f64) -> Option<f64> {
        let Deviations { sigma_z_m, sigma_theta_rad, trust } = self.deviations;
        let square = |x: f64| x * x;
        match self.region(distance_m, bearing_rad) {
            Region::Unseen => None,
            Region::Echo => {
                let off = square((self.range_m - distance_m) / sigma_z_m) + square(bearing_rad / sigma_theta_rad);
                Some(0.5 + trust * (self.p_occupied - 0.5) * libm::exp(-0.5 * off))
            }
            Region::Free => {
                let fading = 1.0 - square(distance_m / self.near_m());
                let centred = libm::exp(-0.5 * square(bearing_rad / sigma_theta_rad));
                Some(0.5 - trust * (0.5 - self.p_free) * fading * centred)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::log_odds::log_odds_of;

    const APERTURE_RAD: f64 = core::f64::consts::PI / 6.0;

    fn cone(range_m: f64, errors: OdometryErrors) -> Cone {
        let noise = NoiseTerms::one_sigma(&errors);
        Cone {
            range_m,
            aperture_rad: APERTURE_RAD,
            range_cap_m: 5.0,
            deviations: Deviations::of(range_m, APERTURE_RAD, 0.01, 0.05, &errors, noise),
            p_occupied: 0.85,
            p_free: 0.30,
            leaves_gaps: false,
        }
    }

    fn errors() -> impl Strategy<Value = OdometryErrors> {
        (0.0..2.0f64, 0.0..2.0f64, 0.0..0.5f64, 0.0..0.5f64).prop_map(
            |(e_lin_m, e_ang_rad, eps_lin_m2, eps_ang_rad2)| OdometryErrors {
                e_lin_m,
                e_ang_rad,
                eps_lin_m2,
                eps_ang_rad2,
            },
        )
    }

    #[test]
    fn peaks_are_those_configured() {
        let cone = cone(2.0, OdometryErrors::default());
        assert_eq!(cone.deviations.trust, 1.0);
        assert_eq!(cone.probability(2.0, 0.0), Some(0.85));
        assert!((cone.probability(1e-9, 0.0).unwrap() - 0.30).abs() < 1e-12);
    }

    #[test]
    fn borders_of_the_regions() {
        let cone = cone(2.0, OdometryErrors::default());
        // σ_z = half a cell = 2.5 cm, so region II is 1.95 … 2.05 m.
        assert_eq!(cone.region(1.949, 0.0), Region::Free);
        assert_eq!(cone.region(cone.near_m(), 0.0), Region::Echo);
        assert_eq!(cone.region(cone.far_m(), 0.0), Region::Echo);
        assert_eq!(cone.region(2.051, 0.0), Region::Unseen);
        assert_eq!(cone.region(0.0, 0.0), Region::Unseen);
        assert_eq!(cone.region(1.0, 0.5 * APERTURE_RAD), Region::Free);
        assert_eq!(cone.region(1.0, -0.5 * APERTURE_RAD), Region::Free);
        assert_eq!(cone.region(1.0, (0.5 * APERTURE_RAD).next_up()), Region::Unseen);
    }

    #[test]
    fn nothing_is_seen_beyond_the_cap() {
        let cone = cone(4.99, OdometryErrors::default());
        assert_eq!(cone.region(5.0, 0.0), Region::Echo);
        assert_eq!(cone.region(5.001, 0.0), Region::Unseen);
    }

    #[test]
    fn trust_falls_with_the_errors() {
        let at = |eps: f64| {
            let errors = OdometryErrors { eps_lin_m2: eps, eps_ang_rad2: eps, ..OdometryErrors::default() };
            nominal_trust(&errors, APERTURE_RAD, 0.01, 0.05)
        };
        assert_eq!(at(0.0), 1.0);
        assert!(at(1e-4) > at(1e-2) && at(1e-2) > at(1.0));
        // By hand: σ_z = 0.02 + 0.1, floor 0.025; σ_θ = 0.261799… + 0.1.
        assert!((at(0.01) - 0.025 * 0.261_799_387_799_149_4 / (0.12 * 0.361_799_387_799_149_4)).abs() < 1e-15);
        assert_eq!(at(f64::INFINITY), 0.0);
    }

    #[test]
    fn a_lucky_draw_is_not_better_than_the_sensor() {
        let noise = NoiseTerms { lin_m: -1.0, ang_rad: -1.0 };
        let deviations = Deviations::of(2.0, APERTURE_RAD, 0.01, 0.05, &OdometryErrors::default(), noise);
        assert_eq!(deviations.trust, 1.0);
        assert_eq!(deviations.sigma_z_m, 0.025);
    }

    proptest! {
        #[test]
        fn probability_stays_between_the_peaks(
            z in 0.01..5.0f64, errors in errors(), d in 0.0..6.0f64, phi in -0.3..0.3f64,
        ) {
            let cone = cone(z, errors);
            prop_assert!(cone.deviations.trust > 0.0 && cone.deviations.trust <= 1.0);
            if let Some(p) = cone.probability(d, phi) {
                prop_assert!((0.30..=0.85).contains(&p), "{p}");
                prop_assert!(log_odds_of(p).is_finite());
                match cone.region(d, phi) {
                    Region::Free => prop_assert!(p <= 0.5),
                    _ => prop_assert!(p >= 0.5),
                }
            }
        }

        #[test]
        fn both_sides_of_the_axis_are_alike(z in 0.2..4.0f64, errors in errors(), d in 0.0..5.0f64, phi in 0.0..0.3f64) {
            let cone = cone(z, errors);
            prop_assert_eq!(cone.probability(d, phi), cone.probability(d, -phi));
        }

        #[test]
        fn hopeless_odometry_says_nearly_nothing(z in 0.2..4.0f64, d in 0.01..5.0f64, phi in -0.26..0.26f64) {
            let lost = OdometryErrors { eps_lin_m2: 1e10, eps_ang_rad2: 1e10, ..OdometryErrors::default() };
            let p = cone(z, lost).probability(d, phi).unwrap();
            prop_assert!((p - 0.5).abs() < 1e-9);
        }
    }
}
