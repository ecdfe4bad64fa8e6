//! The oriented first-echo model: the exact Bayes update of one reading where smooth walls mirror sound.
//!
//! A smooth wall answers a sonar only near its normal; from elsewhere it mirrors the sound away. To [`crate::first_echo`] a look that
//! comes back from farther on is proof that the wall is not there. Here a cell is free, *diffuse* (a corner, a post, something rough:
//! it answers from everywhere), or a smooth wall with its normal in one of [`DIRECTIONS`] directions n_k = kπ/K; a look along which a
//! wall would not have answered says nothing of it. (Orientation per cell: Lim & Cho 1994; evidence by direction of view: Konolige
//! 1997; forward models: Thrun 2003.)
//!
//! | | |
//! |---|---|
//! | v_s | log-weight of state s relative to free; p_s = e^{v_s} / (1 + Σ e^v) |
//! | r_s | how probably it answers if it is so: r0 for diffuse, r0 g_k(ψ) for a wall seen along ψ ([`Response`]) |
//! | a_i = Σ p_s r_s | something is there and answers |
//! | S_i = Π_{j<i} (1 − a_j) | nothing before it did |
//! | L_i = N(z; d_i, σ_z²) | what it says of the range, 1/m |
//! | c = clutter / r_cap | the echo is nobody's: multipath, crosstalk; 1/m |
//! | B_i, A_i | Σ a_j S_j L_j over the cells before and after it; A_i' = A_i/(1 − a_i) |
//!
//! v_s gains ln(1 + r_s (S_i L_i − A_i')/(B_i + c + A_i')). Without an echo L = 0, B_i + c is the probability m that an echo is lost, and
//! A_i' = (1 − m) S_{n+1}/(1 − a_i): a wall that stands obliquely has a ≈ 0 and loses nothing.
//!
//! This is the reference, in double precision; [`crate::kernel::OrientedKernel`] is the fast way to the same numbers.

use core::f64::consts::{FRAC_PI_2, PI};

/// K: directions that the normal of a wall may have.
pub const DIRECTIONS: usize = 8;
/// What a cell may be if it is occupied: diffuse, or a wall in one of the directions.
pub const STATES: usize = 1 + DIRECTIONS;

/// w: how soon beyond the critical incidence a wall ceases to answer, radians (4°).
const SOFTNESS_RAD: f64 = 4.0 * PI / 180.0;

/// How a smooth wall answers by the angle at which it is met.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    critical_rad: f64,
    directions: usize,
}

impl Response {
    /// The response of walls that answer up to α_c = `critical_rad` from their normal, which has one of so many directions.
    #[must_use]
    pub fn new(critical_rad: f64, directions: usize) -> Self {
        Self { critical_rad, directions }
    }

    /// g_k(ψ): the share that a wall of direction k has in the answer of a diffuse one, seen along `ray_rad`: the mean, over the normals
    /// within ±π/2K of n_k, of 1/(1 + exp((α − α_c)/w)) with α in [0, π/2] the angle between ray and normal.
    #[must_use]
    pub fn share(&self, direction: usize, ray_rad: f64) -> f64 {
        let sector = PI / self.directions as f64;
        let off = ray_rad - direction as f64 * sector;
        // A normal has no sign.
        let off = off - PI * (off / PI).round();
        let mean = (self.until(off + 0.5 * sector) - self.until(off - 0.5 * sector)) / sector;
        mean.clamp(0.0, 1.0)
    }

    /// The answer summed over α from 0 to `angle_rad`, within ±π.
    fn until(&self, angle_rad: f64) -> f64 {
        let angle = angle_rad.abs();
        let within = |angle: f64| {
            let soft = |angle: f64| SOFTNESS_RAD * softplus((angle - self.critical_rad) / SOFTNESS_RAD);
            angle - (soft(angle) - soft(0.0))
        };
        // Beyond a right angle it comes nearer to the normal again.
        let sum = if angle <= FRAC_PI_2 { within(angle) } else { 2.0 * within(FRAC_PI_2) - within(PI - angle) };
        if angle_rad < 0.0 { -sum } else { sum }
    }
}

/// ln(1 + e^x)
fn softplus(x: f64) -> f64 {
    x.max(0.0) + libm::log1p(libm::exp(-x.abs()))
}

/// What looks along which a wall answers with probability r leave of its weight at least, relative to what it was before any reading:
/// 1 − (n r)² with n = `looks`, at least 0. More than that they do not take, however many they are: what the model has wrong at
/// the edge of a wall's response is wrong each time.
#[must_use]
pub fn left_by_looks(r: f64, looks: f64) -> f64 {
    if looks.is_finite() { (1.0 - looks * r * looks * r).max(0.0) } else { 0.0 }
}

/// What a reading says, and how far it is to be believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oriented {
    /// z, metres; none: nothing came back.
    pub range_m: Option<f64>,
    /// σ_z, the standard deviation of the range, metres.
    pub sigma_z_m: f64,
    /// How probably an echo is nobody's, in (0, 1); spread evenly over r_cap.
    pub clutter: f64,
    /// r_cap, the farthest range of the sensor, metres.
    pub range_cap_m: f64,
    /// m: how probably an echo is lost, in (0, 1).
    pub lost: f64,
}

/// A cell of a cone, as the transducer sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacedCell<'a> {
    /// d, the distance from the transducer, metres.
    pub distance_m: f64,
    /// v_s: of each state, relative to free.
    pub log_weights: &'a [f64],
    /// r_s: how probably the cell answers if it is in that state, in [0, 1).
    pub responses: &'a [f64],
}

impl FacedCell<'_> {
    /// a: how probably something is there and answers.
    fn answers(&self) -> f64 {
        let highest = self.log_weights.iter().copied().fold(0.0, f64::max);
        let weights = || self.log_weights.iter().map(|v| libm::exp(v - highest));
        let total: f64 = libm::exp(-highest) + weights().sum::<f64>();
        weights().zip(self.responses).map(|(weight, r)| weight * r).sum::<f64>() / total
    }
}

impl Oriented {
    /// What x is for each cell, in the order in which they are given: state s of it gains ln(1 + r_s x). That order does not matter,
    /// but for cells at the very same distance.
    #[must_use]
    pub fn evidence(&self, cells: &[FacedCell<'_>]) -> Vec<f64> {
        let mut order: Vec<usize> = (0..cells.len()).collect();
        order.sort_by(|a, b| cells[*a].distance_m.total_cmp(&cells[*b].distance_m));

        // S and B along the cone
        let (mut unanswered, mut before) = (1.0, 0.0);
        let mut passed = Vec::with_capacity(cells.len());
        for index in &order {
            let (a, l) = (cells[*index].answers(), self.likelihood(cells[*index].distance_m));
            passed.push((a, unanswered, before, l));
            before += a * unanswered * l;
            unanswered *= 1.0 - a;
        }
        let (nobodys, silent) = match self.range_m {
            Some(_) => (self.clutter / self.range_cap_m, 0.0),
            None => (self.lost, (1.0 - self.lost) * unanswered),
        };

        // A, back along it
        let mut evidence = vec![0.0; cells.len()];
        let mut after = silent;
        for (index, (a, unanswered, before, l)) in order.iter().zip(passed).rev() {
            let behind = after / (1.0 - a);
            evidence[*index] = (unanswered * l - behind) / (before + nobodys + behind);
            after += a * unanswered * l;
        }
        evidence
    }

    /// What the log-weight of each state of each cell gains.
    #[must_use]
    pub fn gains(&self, cells: &[FacedCell<'_>]) -> Vec<Vec<f64>> {
        let of_cell = |(cell, x): (&FacedCell<'_>, f64)| cell.responses.iter().map(|r| libm::log1p(r * x)).collect();
        cells.iter().zip(self.evidence(cells)).map(of_cell).collect()
    }

    /// L of a cell at `distance_m`, 1/m.
    fn likelihood(&self, distance_m: f64) -> f64 {
        const FRAC_1_SQRT_TAU: f64 = 0.398_942_280_401_432_7;
        let Some(range_m) = self.range_m else { return 0.0 };
        let off = (range_m - distance_m) / self.sigma_z_m;
        FRAC_1_SQRT_TAU / self.sigma_z_m * libm::exp(-0.5 * off * off)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A cell of two directions besides diffuse.
    #[derive(Debug, Clone)]
    struct Cell {
        distance_m: f64,
        log_weights: [f64; 3],
        responses: [f64; 3],
    }

    fn faced(cells: &[Cell]) -> Vec<FacedCell<'_>> {
        cells
            .iter()
            .map(|cell| FacedCell {
                distance_m: cell.distance_m,
                log_weights: &cell.log_weights,
                responses: &cell.responses,
            })
            .collect()
    }

    fn reading() -> impl Strategy<Value = Oriented> {
        let range = prop_oneof![3 => (0.2..4.0f64).prop_map(Some), 1 => Just(None)];
        (range, 0.01..0.6f64, 0.001..0.9f64, 0.01..0.99f64).prop_map(|(range_m, sigma_z_m, clutter, lost)| Oriented {
            range_m,
            sigma_z_m,
            clutter,
            range_cap_m: 5.0,
            lost,
        })
    }

    fn cells(most: usize) -> impl Strategy<Value = Vec<Cell>> {
        let cell = (0.05..4.5f64, prop::array::uniform3(-8.0..5.0f64), prop::array::uniform3(0.0..0.99f64))
            .prop_map(|(distance_m, log_weights, responses)| Cell { distance_m, log_weights, responses });
        prop::collection::vec(cell, 1..most)
    }

    /// Of each state of each cell, the log of how much its weight relative to free changes, by going through all worlds.
    fn by_enumeration(reading: &Oriented, cells: &[Cell]) -> Vec<[f64; 3]> {
        let mut sorted: Vec<usize> = (0..cells.len()).collect();
        sorted.sort_by(|a, b| cells[*a].distance_m.total_cmp(&cells[*b].distance_m));
        // Of each cell, how probable it and the reading are in each of its four states, free first
        let mut joint = vec![[0.0; 4]; cells.len()];
        for world in 0..4_usize.pow(cells.len() as u32) {
            let state = |index: usize| world / 4_usize.pow(index as u32) % 4;
            let weight = |index: usize| match state(index) {
                0 => 1.0,
                s => libm::exp(cells[index].log_weights[s - 1]),
            };
            let probability: f64 = (0..cells.len()).map(weight).product();
            let (mut likelihood, mut unanswered) = (0.0, 1.0);
            for index in sorted.iter().copied().filter(|index| state(*index) > 0) {
                let r = cells[index].responses[state(index) - 1];
                likelihood += unanswered * r * reading.likelihood(cells[index].distance_m);
                unanswered *= 1.0 - r;
            }
            likelihood = match reading.range_m {
                Some(_) => likelihood + reading.clutter / reading.range_cap_m,
                None => unanswered * (1.0 - reading.lost) + reading.lost,
            };
            for (index, sums) in joint.iter_mut().enumerate() {
                sums[state(index)] += probability * likelihood;
            }
        }
        let gain = |(sums, cell): (&[f64; 4], &Cell)| {
            core::array::from_fn(|s| libm::log(sums[s + 1] / sums[0]) - cell.log_weights[s])
        };
        joint.iter().zip(cells).map(gain).collect()
    }

    proptest! {
        #[test]
        fn is_bayes_rule_over_all_worlds(reading in reading(), cells in cells(6)) {
            let expected = by_enumeration(&reading, &cells);
            for (gains, expected) in reading.gains(&faced(&cells)).iter().zip(expected) {
                for (gain, expected) in gains.iter().zip(expected) {
                    prop_assert!((gain - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{gain} {expected}");
                }
            }
        }

        /// With states that all answer alike it is the plain model.
        #[test]
        fn without_orientation_it_is_first_echo(reading in reading(), cells in cells(20)) {
            use crate::first_echo::{FirstEcho, SeenCell};
            let cells: Vec<Cell> = cells.iter().map(|cell| Cell { responses: [0.4; 3], ..cell.clone() }).collect();
            let plain = FirstEcho {
                range_m: reading.range_m,
                sigma_z_m: reading.sigma_z_m,
                sigma_theta_rad: 0.3,
                detection: 0.4,
                clutter: reading.clutter,
                range_cap_m: reading.range_cap_m,
                lost: reading.lost,
            };
            let seen = |cell: &Cell| {
                let weight: f64 = cell.log_weights.iter().map(|v| libm::exp(*v)).sum();
                SeenCell { distance_m: cell.distance_m, bearing_rad: 0.0, probability: weight / (1.0 + weight) }
            };
            let plain = plain.gains(&cells.iter().map(seen).collect::<Vec<_>>());
            for (gains, plain) in reading.gains(&faced(&cells)).iter().zip(plain) {
                prop_assert!(gains.iter().all(|gain| (gain - plain).abs() < 1e-9 * (1.0 + plain.abs())));
            }
        }

        #[test]
        fn a_wall_answers_by_the_angle_between_ray_and_normal(ray in -20.0..20.0f64, critical in 0.1..1.2f64) {
            let response = Response::new(critical, DIRECTIONS);
            let sector = PI / DIRECTIONS as f64;
            for k in 0..DIRECTIONS {
                let share = response.share(k, ray);
                prop_assert!((0.0..=1.0).contains(&share));
                // From the other side, and turned with the wall
                prop_assert!((share - response.share(k, ray + PI)).abs() < 1e-9);
                prop_assert!((share - response.share((k + 1) % DIRECTIONS, ray + sector)).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_wall_seen_obliquely_loses_nothing_by_an_echo_from_behind() {
        let response = Response::new(25.0_f64.to_radians(), DIRECTIONS);
        let responses = |ray: f64| {
            core::array::from_fn::<f64, 9, _>(|s| match s {
                0 => 0.95,
                k => 0.95 * response.share(k - 1, ray),
            })
        };
        // A sure wall with its normal along x, before an echo that came from 1 m behind it
        let mut wall = [-9.0; 9];
        wall[1] = 3.0;
        let reading = Oriented { range_m: Some(2.0), sigma_z_m: 0.025, clutter: 0.4, range_cap_m: 5.0, lost: 0.8 };
        let gains = |ray: f64| {
            let behind = [0.0; 9];
            let cells = [(1.0, &wall), (2.0, &behind)];
            let answers = responses(ray);
            let cells = cells.map(|(distance_m, v)| FacedCell { distance_m, log_weights: v, responses: &answers });
            reading.gains(&cells)[0].clone()
        };
        assert!(gains(0.0)[1] < -1.5, "met at its normal it would have answered");
        assert!(gains(1.2)[1] > -0.01, "met at 69° it mirrors the sound away");
        assert!(gains(1.2)[0] < -1.5, "a post would have answered");
    }
}
