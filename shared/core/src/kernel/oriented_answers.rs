//! How walls of each direction answer over the width of a beam, as polynomials across it.

use super::fit::Fitter;
use super::functions::polynomial_in_halves;
use super::lanes::Lanes;
use crate::oriented::{DIRECTIONS, Response, STATES};

/// Coefficients across a beam.
const ACROSS: usize = 12;
/// Of the table of a wall's response by the angle from its normal, over half a turn; a multiple of the directions.
const STEPS: usize = 4096;
/// Half apertures up to this (20°) so few coefficients do for.
const WIDEST_HALF_APERTURE_RAD: f64 = core::f64::consts::PI / 9.0 + 1e-9;
/// Of the cells around the echo, what answers less does not answer.
const LEAST: f64 = 1e-5;
/// Nor does in front of it: there a state loses no more than its r.
const LEAST_IN_FRONT: f64 = 2e-4;

/// The responses of a beam.
#[derive(Debug, Clone)]
pub(super) struct Answers {
    response: Response,
    /// g of the first direction.
    table: Box<[f64; STEPS + 1]>,
    fitter: Fitter<ACROSS>,
    nodes: [f64; ACROSS],
    /// β, and the bearings at the nodes.
    bearings: (f64, [f64; ACROSS]),
    /// r0.
    diffuse: f64,
    /// r of the walls of each direction, in powers of sin φ / sin ½β.
    across: [[f32; ACROSS]; DIRECTIONS],
    /// Which of them answer somewhere in the beam: a bit for each.
    facing: u8,
    /// Likewise, in front of the echo.
    in_front: u8,
}

impl Answers {
    pub(super) fn new(critical_rad: f64) -> Self {
        let response = Response::new(critical_rad, DIRECTIONS);
        let mut table = Box::new([0.0; STEPS + 1]);
        for (step, share) in table.iter_mut().enumerate() {
            *share = response.share(0, core::f64::consts::PI * step as f64 / STEPS as f64);
        }
        let nodes = core::array::from_fn(|k| libm::cos(core::f64::consts::PI * (k as f64 + 0.5) / ACROSS as f64));
        Self {
            response,
            table,
            fitter: Fitter::over(&nodes),
            nodes,
            bearings: (f64::NAN, [0.0; ACROSS]),
            diffuse: 0.0,
            across: [[0.0; ACROSS]; DIRECTIONS],
            facing: 0,
            in_front: 0,
        }
    }

    /// Whether the polynomials do for such an aperture.
    pub(super) fn are_smooth(aperture_rad: f64) -> bool {
        0.5 * aperture_rad <= WIDEST_HALF_APERTURE_RAD
    }

    /// r of each state along a ray.
    pub(super) fn of_ray(&self, ray_rad: f64, detection: f64) -> [f64; STATES] {
        core::array::from_fn(|state| match state {
            0 => detection,
            state => detection * self.response.share(state - 1, ray_rad),
        })
    }

    /// To a beam along `axis_rad`, where a cell that does not mirror answers with `detection`.
    #[inline(always)]
    pub(super) fn turn_to(&mut self, axis_rad: f64, aperture_rad: f64, detection: f64) {
        if self.bearings.0 != aperture_rad {
            let edge = libm::sin(0.5 * aperture_rad);
            self.bearings = (aperture_rad, self.nodes.map(|node| libm::asin(node * edge)));
        }
        self.diffuse = detection;
        let mut values = [[0.0; ACROSS]; DIRECTIONS];
        for (node, bearing) in self.bearings.1.iter().enumerate() {
            let half_turns = (axis_rad + bearing) / core::f64::consts::PI;
            let place = (half_turns - half_turns.floor()) * STEPS as f64;
            let whole = place.floor();
            let (step, rest) = (whole as usize, place - whole);
            for (direction, values) in values.iter_mut().enumerate() {
                let step = (step + STEPS - direction * (STEPS / DIRECTIONS)) % STEPS;
                let (low, high) = (self.table[step], self.table[step + 1]);
                values[node] = detection * (low + rest * (high - low));
            }
        }
        (self.facing, self.in_front) = (0, 0);
        for (direction, values) in values.iter().enumerate() {
            let most = values.iter().copied().fold(0.0, f64::max);
            if most >= LEAST {
                self.across[direction] = self.fitter.through(values).map(|coefficient| coefficient as f32);
                self.facing |= 1 << direction;
                self.in_front |= u8::from(most >= LEAST_IN_FRONT) << direction;
            }
        }
    }

    /// r of walls of a direction that answer, at `aside` = sin φ / sin ½β and its square.
    #[inline(always)]
    pub(super) fn at<L: Lanes>(&self, direction: usize, aside: L, square: L) -> L {
        polynomial_in_halves(&self.across[direction], aside, square).at_least(L::splat(0.0))
    }

    /// r of what does not mirror.
    pub(super) fn diffuse(&self) -> f32 {
        self.diffuse as f32
    }

    /// The walls that answer around the echo: a bit for each direction.
    pub(super) fn facing(&self) -> u8 {
        self.facing
    }

    /// The walls that answer in front of it: some of them.
    pub(super) fn in_front(&self) -> u8 {
        self.in_front
    }
}
