//! Where the robot drove nothing is: its own footprint clears the cells that it covers for certain.
//!
//! The cells of the largest disc that fits into the footprint, less two standard deviations of the position, are rather free, whatever
//! rule fuses: a robot whose position is in doubt by half of that radius clears nothing.

use crate::config::{Limit, MapperConfig};
use crate::grid::{CellIndex, Grid};
use crate::odometry::Estimate;
use crate::pose::Pose2;
use crate::robot::Robot;

/// Of a robot that does not say how large it is, metres: half the width of a Pioneer.
const RADIUS_M: f64 = 0.25;
/// No robot is larger, metres.
pub(crate) const MOST_M: f64 = 2.0;
/// How many standard deviations of the position are left out.
const SURE: f64 = 2.0;
/// What a cell under the robot gains in log-odds: of what is left out on both sides 1 in 40 is not under it after all.
const GAIN: f32 = -3.7;

/// What the robot covers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Driven {
    /// 0: it clears nothing.
    radius_m: f64,
    start: f32,
    max: f32,
    /// Where it cleared last, metres.
    pub(crate) last: Option<[f64; 2]>,
}

impl Driven {
    pub(crate) fn new(config: &MapperConfig, robot: &Robot) -> Self {
        let of_robot = 0.5 * robot.footprint.length_m.min(robot.footprint.width_m);
        let radius_m = match config.footprint_m {
            Limit::Metres(radius_m) => radius_m,
            Limit::Word(_) if of_robot > 0.0 => of_robot.min(MOST_M),
            Limit::Word(_) => RADIUS_M,
        };
        Self { radius_m, start: config.log_odds_prior as f32, max: config.log_odds_max as f32, last: None }
    }

    /// Clears what the robot covers where it is now. The radius that was cleared, metres; 0 where that is nothing new.
    pub(crate) fn clear(&mut self, grid: &mut Grid, estimate: &Estimate, revision: u64) -> f64 {
        let radius_m = self.radius_m(estimate);
        self.clear_disc(grid, [estimate.pose.x, estimate.pose.y], radius_m, revision);
        radius_m
    }

    /// Whether [`Driven::clear`] would change anything.
    pub(crate) fn is_due(&self, estimate: &Estimate) -> bool {
        !self.is_here(estimate) && self.sure_radius_m(estimate) > 0.0
    }

    /// Whether it cleared here last.
    fn is_here(&self, estimate: &Estimate) -> bool {
        let Pose2 { x, y, .. } = estimate.pose;
        let step_m = 0.5 * self.radius_m;
        self.last.is_some_and(|[last_x, last_y]| libm::hypot(x - last_x, y - last_y) < step_m)
    }

    /// The radius of what is free for certain where the robot is now, metres; 0 where that is nothing new.
    fn radius_m(&mut self, estimate: &Estimate) -> f64 {
        let Pose2 { x, y, .. } = estimate.pose;
        if self.is_here(estimate) {
            return 0.0;
        }
        let radius_m = self.sure_radius_m(estimate);
        if radius_m > 0.0 {
            self.last = Some([x, y]);
        }
        radius_m
    }

    fn sure_radius_m(&self, estimate: &Estimate) -> f64 {
        let covariance = estimate.covariance_of(Pose2::IDENTITY);
        let variance = covariance[(0, 0)].max(covariance[(1, 1)]).max(0.0);
        let radius_m = self.radius_m - SURE * variance.sqrt();
        if radius_m > 0.0 { radius_m } else { 0.0 }
    }

    /// The cells of such a radius around (x, y), metres, become freer.
    pub(crate) fn clear_disc(&self, grid: &mut Grid, at: [f64; 2], radius_m: f64, revision: u64) {
        // A disc of no size would have a centre.
        if radius_m <= 0.0 {
            return;
        }
        let [x, y] = at;
        let (low, high) = (grid.cell_at(x - radius_m, y - radius_m), grid.cell_at(x + radius_m, y + radius_m));
        for j in low.j..=high.j {
            for i in low.i..=high.i {
                let cell = CellIndex { i, j };
                let [cell_x, cell_y] = grid.centre(cell);
                if libm::hypot(cell_x - x, cell_y - y) > radius_m {
                    continue;
                }
                let value = grid.log_odds_mut(cell, revision);
                let before = if value.is_nan() { self.start } else { *value };
                *value = (before + GAIN).clamp(-self.max, self.max);
            }
        }
    }
}
