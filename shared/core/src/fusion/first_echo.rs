//! The first-echo model: the exact Bayes update of one reading, given the map so far. Beyond the paper, whose eq 20 asks for it.
//!
//! The echo came from one place: the first cell along the cone that is occupied and answers. Cell i, occupied with probability
//! p_i, answers with r_i = r0 exp(−½ (φ_i/σ_θ)²) if it is; the cells are sorted by distance.
//!
//! | | |
//! |---|---|
//! | a_i = p_i r_i | it is there and answers |
//! | S_i = Π_{j<i} (1 − a_j) | nothing before it did |
//! | L_i = N(z; d_i, σ_z²) | what it says of the range, 1/m |
//! | c = clutter / r_cap | the echo is nobody's: multipath, crosstalk; 1/m |
//! | B_i, A_i | Σ a_j S_j L_j over the cells before and after it |
//!
//! What p_i/(1 − p_i) is multiplied by has a form without cancellation, 1 + r_i (S_i L_i − A_i')/(B_i + c + A_i') with
//! A_i' = A_i/(1 − a_i), and its logarithm is what the cell gains. Without an echo L = 0, c is the probability m that an echo is
//! lost, and A_i' = (1 − m) S_{n+1}/(1 − a_i).
//!
//! This is the reference, in double precision; [`crate::kernel::FirstEchoKernel`] is the fast way to the same numbers.

/// Cells farther than this many σ_z behind the echo are not looked at.
pub const BEHIND: f64 = 3.0;

/// How a sensor answers, and with what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstEcho {
    /// z, metres; none: nothing came back.
    pub range_m: Option<f64>,
    /// σ_z, the standard deviation of the range, metres.
    pub sigma_z_m: f64,
    /// σ_θ, the standard deviation of the bearing, radians.
    pub sigma_theta_rad: f64,
    /// r0: how probably an occupied cell on the axis answers, in (0, 1).
    pub detection: f64,
    /// How probably an echo is nobody's, in (0, 1); spread evenly over r_cap.
    pub clutter: f64,
    /// r_cap, the farthest range of the sensor, metres.
    pub range_cap_m: f64,
    /// m: how probably an echo is lost, in (0, 1).
    pub lost: f64,
}

/// A cell of a cone, as the transducer sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenCell {
    /// d, the distance from the transducer, metres.
    pub distance_m: f64,
    /// φ, radians off the axis.
    pub bearing_rad: f64,
    /// p: how probably it is occupied, as far as is known so far; in [0, 1].
    pub probability: f64,
}

impl FirstEcho {
    /// Eq 20 over a whole cone: what each cell's log-odds gain, in the order in which the cells are given. That order does not matter, but for cells at
    /// the very same distance.
    #[must_use]
    pub fn gains(&self, cells: &[SeenCell]) -> Vec<f64> {
        let mut order: Vec<usize> = (0..cells.len()).collect();
        order.sort_by(|a, b| cells[*a].distance_m.total_cmp(&cells[*b].distance_m));
        let answers = |cell: &SeenCell| {
            let off = cell.bearing_rad / self.sigma_theta_rad;
            self.detection * libm::exp(-0.5 * off * off)
        };

        // S and B along the cone
        let (mut unanswered, mut before) = (1.0, 0.0);
        let mut passed = Vec::with_capacity(cells.len());
        for index in &order {
            let cell = &cells[*index];
            let (a, l) = (cell.probability * answers(cell), self.likelihood(cell.distance_m));
            passed.push((unanswered, before, l));
            before += a * unanswered * l;
            unanswered *= 1.0 - a;
        }
        let (nobodys, silent) = match self.range_m {
            Some(_) => (self.clutter / self.range_cap_m, 0.0),
            None => (self.lost, (1.0 - self.lost) * unanswered),
        };

        // A, back along it
        let mut gains = vec![0.0; cells.len()];
        let mut after = silent;
        for (index, (unanswered, before, l)) in order.iter().zip(passed).rev() {
            let cell = &cells[*index];
            let r = answers(cell);
            let a = cell.probability * r;
            let behind = after / (1.0 - a);
            gains[*index] = libm::log1p(r * (unanswered * l - behind) / (before + nobodys + behind));
            after += a * unanswered * l;
        }
        gains
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
    use crate::log_odds::{log_odds_of, probability_of};

    fn reading() -> impl Strategy<Value = FirstEcho> {
        let range = prop_oneof![4 => (0.2..4.0f64).prop_map(Some), 1 => Just(None)];
        (range, 0.01..0.6f64, 0.1..0.6f64, 0.01..0.99f64, 0.001..0.9f64, 0.01..0.99f64).prop_map(
            |(range_m, sigma_z_m, sigma_theta_rad, detection, clutter, lost)| FirstEcho {
                range_m,
                sigma_z_m,
                sigma_theta_rad,
                detection,
                clutter,
                range_cap_m: 5.0,
                lost,
            },
        )
    }

    fn cells(most: usize) -> impl Strategy<Value = Vec<SeenCell>> {
        let cell = (0.05..4.5f64, -0.26..0.26f64, 0.001..0.999f64)
            .prop_map(|(distance_m, bearing_rad, probability)| SeenCell { distance_m, bearing_rad, probability });
        prop::collection::vec(cell, 1..most)
    }

    /// The posterior of each cell by going through all worlds.
    fn by_enumeration(reading: &FirstEcho, cells: &[SeenCell]) -> Vec<f64> {
        let mut sorted: Vec<usize> = (0..cells.len()).collect();
        sorted.sort_by(|a, b| cells[*a].distance_m.total_cmp(&cells[*b].distance_m));
        let (mut total, mut occupied) = (0.0, vec![0.0; cells.len()]);
        for world in 0..1_u32 << cells.len() {
            let is_occupied = |index: usize| world >> index & 1 == 1;
            let mut probability = 1.0;
            for (index, cell) in cells.iter().enumerate() {
                probability *= if is_occupied(index) { cell.probability } else { 1.0 - cell.probability };
            }
            let (mut likelihood, mut unanswered) = (0.0, 1.0);
            for index in sorted.iter().copied().filter(|index| is_occupied(*index)) {
                let cell = &cells[index];
                let off = cell.bearing_rad / reading.sigma_theta_rad;
                let r = reading.detection * libm::exp(-0.5 * off * off);
                likelihood += unanswered * r * reading.likelihood(cell.distance_m);
                unanswered *= 1.0 - r;
            }
            likelihood = match reading.range_m {
                Some(_) => likelihood + reading.clutter / reading.range_cap_m,
                None => unanswered * (1.0 - reading.lost) + reading.lost,
            };
            total += probability * likelihood;
            for (_, sum) in occupied.iter_mut().enumerate().filter(|(index, _)| is_occupied(*index)) {
                *sum += probability * likelihood;
            }
        }
        occupied.iter().map(|sum| sum / total).collect()
    }

    proptest! {
        #[test]
        fn is_bayes_rule_over_all_worlds(reading in reading(), cells in cells(9)) {
            let expected = by_enumeration(&reading, &cells);
            for ((cell, gain), expected) in cells.iter().zip(reading.gains(&cells)).zip(expected) {
                let after = probability_of(log_odds_of(cell.probability) + gain);
                prop_assert!((after - expected).abs() < 1e-11, "{after} {expected}");
                prop_assert!(after > 0.0 && after < 1.0);
            }
        }

        /// One cell alone: p L' / (p L' + (1 − p) c) with what it answers, written out.
        #[test]
        fn of_one_cell_is_bayes_rule(reading in reading(), cells in cells(2)) {
            let (cell, gain) = (cells[0], reading.gains(&cells)[0]);
            let off = cell.bearing_rad / reading.sigma_theta_rad;
            let r = reading.detection * libm::exp(-0.5 * off * off);
            let (if_occupied, if_free) = match reading.range_m {
                Some(_) => {
                    let c = reading.clutter / reading.range_cap_m;
                    (c + r * reading.likelihood(cell.distance_m), c)
                }
                None => ((1.0 - r) * (1.0 - reading.lost) + reading.lost, 1.0),
            };
            prop_assert!((gain - libm::log(if_occupied / if_free)).abs() < 1e-11);
        }

        #[test]
        fn does_not_depend_on_the_order_of_cells(reading in reading(), cells in cells(40), turn in 0..40usize) {
            let mut turned = cells.clone();
            turned.rotate_left(turn % cells.len());
            let (gains, mut turned_gains) = (reading.gains(&cells), reading.gains(&turned));
            turned_gains.rotate_right(turn % cells.len());
            prop_assert_eq!(gains, turned_gains);
        }

        #[test]
        fn who_knows_nothing_says_nothing(reading in reading(), cells in cells(40)) {
            let lost = FirstEcho { range_m: Some(2.0), sigma_z_m: 1e11, ..reading };
            for gain in lost.gains(&cells) {
                prop_assert!(gain.abs() < 1e-6, "{gain}");
            }
        }
    }
}
