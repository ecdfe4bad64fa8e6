//! What wheels measure of a way: the reasons of odometry's errors, systematic and not.
//!
//! | cause | kind | parameter |
//! |---|---|---|
//! | wheels of another diameter than believed | systematic | `left_scale` s_l, `right_scale` s_r |
//! | an axle of another length than believed (for skid steering: the one that it turns as if it had) | systematic | `axle_scale` s_b |
//! | wheels that slip | random, per metre of each side | `slip_m2_per_m` k |
//! | tyres that scrub over the floor as it turns | random, per radian | `scrub_rad2_per_rad` q, `scrub_m2_per_rad` p |
//! | bumps that turn the robot, unnoticed by its wheels | random, Poisson per metre | `bumps_per_m` λ, `bump_rad` γ |
//!
//! For a step that leads the robot dl ahead and turns it by dθ, with b' = b (1 + s_b) between its wheels, the sides travel
//! t = dl ∓ b' dθ/2, and measure
//!
//! ```text
//! m_l = t_l (1 + s_l) + √(k |t_l|) n₁ + √(p |dθ|) n₃ − b/2 √(q |dθ|) n₄
//! m_r = t_r (1 + s_r) + √(k |t_r|) n₂ + √(p |dθ|) n₃ + b/2 √(q |dθ|) n₄          n ~ N(0, 1)
//! ```
//!
//! of which the odometry makes Δl = (m_l + m_r)/2 and Δθ = (m_r − m_l)/b.

use echogrid_core::Calibration;
use echogrid_core::noise::Draws;

use crate::config::SimulatorConfig;

/// What the wheels of the two sides measured, metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Wheels {
    pub(crate) left_m: f64,
    pub(crate) right_m: f64,
}

/// The errors of a drive, in the making.
#[derive(Debug, Clone)]
pub(crate) struct Slip {
    axle_m: f64,
    true_axle_m: f64,
    left: f64,
    right: f64,
    slip_m2_per_m: f64,
    scrub_rad2_per_rad: f64,
    scrub_m2_per_rad: f64,
    /// From one bump to the next in the mean; none if the floor is even.
    bump_every_m: Option<f64>,
    bump_rad: f64,
    /// To the next bump.
    bump_in_m: f64,
    draws: Draws,
}

impl Slip {
    pub(crate) fn new(config: &SimulatorConfig) -> Self {
        let mut draws = Draws::new(config.seed, "drive");
        let bump_every_m = (config.bumps_per_m > 0.0).then(|| 1.0 / config.bumps_per_m);
        Self {
            axle_m: config.axle_m,
            true_axle_m: config.axle_m * (1.0 + config.axle_scale),
            left: 1.0 + config.left_scale,
            right: 1.0 + config.right_scale,
            slip_m2_per_m: config.slip_m2_per_m,
            scrub_rad2_per_rad: config.scrub_rad2_per_rad,
            scrub_m2_per_rad: config.scrub_m2_per_rad,
            bump_every_m,
            bump_rad: config.bump_rad,
            bump_in_m: bump_every_m.map_or(f64::INFINITY, |mean_m| draws.exponential(mean_m)),
            draws,
        }
    }

    /// What the wheels measure of a step.
    pub(crate) fn measured(&mut self, ahead_m: f64, turn_rad: f64) -> Wheels {
        let sideways_m = 0.5 * self.true_axle_m * turn_rad;
        let (left_m, right_m) = (ahead_m - sideways_m, ahead_m + sideways_m);
        let (mut common_m, mut twist_m) = (0.0, 0.0);
        if turn_rad != 0.0 {
            let turn_rad = turn_rad.abs();
            common_m = (self.scrub_m2_per_rad * turn_rad).sqrt() * self.draws.normal();
            twist_m = 0.5 * self.axle_m * (self.scrub_rad2_per_rad * turn_rad).sqrt() * self.draws.normal();
        }
        let slip = |way_m: f64, draws: &mut Draws| (self.slip_m2_per_m * way_m.abs()).sqrt() * draws.normal();
        Wheels {
            left_m: left_m * self.left + slip(left_m, &mut self.draws) + common_m - twist_m,
            right_m: right_m * self.right + slip(right_m, &mut self.draws) + common_m + twist_m,
        }
    }

    /// What bumps turn the robot by on a way, radians.
    pub(crate) fn bumps(&mut self, way_m: f64) -> f64 {
        let Some(mean_m) = self.bump_every_m else { return 0.0 };
        let mut turned_rad = 0.0;
        self.bump_in_m -= way_m.abs();
        while self.bump_in_m <= 0.0 {
            turned_rad += self.bump_rad * self.draws.normal();
            self.bump_in_m += self.draws.exponential(mean_m);
        }
        turned_rad
    }
}

/// The error model (eqs 1–4) that follows from the parameters of a drive; see [`SimulatorConfig::expected_error_model`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedErrors {
    /// a_l, a_θ and the κ; σ and α are 0: they depend on how far a trial goes.
    pub per_way: Calibration,
    /// σ per radian of a trial's turn, counter-clockwise, metres.
    pub lin_offset_m_per_rad: f64,
    /// α per metre of a trial's way, radians.
    pub ang_offset_rad_per_m: f64,
}

impl ExpectedErrors {
    /// What a calibration over trials of `straight_m` ahead and `turn_rad` counter-clockwise is expected to find.
    #[must_use]
    pub fn over(&self, straight_m: f64, turn_rad: f64) -> Calibration {
        Calibration {
            lin_offset_m: self.lin_offset_m_per_rad * turn_rad,
            ang_offset_rad: self.ang_offset_rad_per_m * straight_m,
            ..self.per_way
        }
    }
}

impl SimulatorConfig {
    /// The error model that the drive's parameters come to, in closed form: of the equations above, with
    /// S = 1 + (s_l + s_r)/2 and F = S (1 + s_b), over the measured way as in [`Calibration`],
    ///
    /// ```text
    /// a_l  = 1 − 1/S                                a_θ  = 1 − 1/F
    /// κ_ll = k/2 / S³                               κ_θθ = (k (1 + s_b)/b + q) / F³
    /// κ_θl = (2 k/b² + λ γ²) / S                    κ_lθ = (k b (1 + s_b)/4 + p) / F
    /// α    = (s_r − s_l)/b · metres                 σ    = b (1 + s_b)(s_r − s_l)/4 · radians
    /// ```
    ///
    /// Exact but for the resolution of the encoders, which adds δ²/12 to the variance of a trial's Δl and δ²/(3 b²) to that
    /// of its Δθ, however long it is (δ: the way of a tick); and but for terms in (s_r − s_l)², which no real robot notices.
    #[must_use]
    pub fn expected_error_model(&self) -> ExpectedErrors {
        let (k, b) = (self.slip_m2_per_m, self.axle_m);
        let difference = self.right_scale - self.left_scale;
        let s = 1.0 + 0.5 * (self.left_scale + self.right_scale);
        let longer = 1.0 + self.axle_scale;
        let f = s * longer;
        let bumps_rad2_per_m = self.bumps_per_m * self.bump_rad * self.bump_rad;
        ExpectedErrors {
            per_way: Calibration {
                lin_scale: 1.0 - 1.0 / s,
                ang_scale: 1.0 - 1.0 / f,
                k_ll: 0.5 * k / (s * s * s),
                k_lt: (0.25 * k * b * longer + self.scrub_m2_per_rad) / f,
                k_tt: (k * longer / b + self.scrub_rad2_per_rad) / (f * f * f),
                k_tl: (2.0 * k / (b * b) + bumps_rad2_per_m) / s,
                lin_offset_m: 0.0,
                ang_offset_rad: 0.0,
            },
            lin_offset_m_per_rad: 0.25 * b * longer * difference,
            ang_offset_rad_per_m: difference / b,
        }
    }
}
