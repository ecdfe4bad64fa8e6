//! Inverses of covariances that need not have one.

use nalgebra::{Matrix3, Vector3};

/// A pivot that has shrunk to this share of its variance is taken for rounding: divided by less, the rounding of a covariance
/// would be no longer small.
const NOTHING: f64 = 1e-8;

/// Whether `off` is, but for rounding, what a covariance `a` with semi-inverse `g` can explain.
pub(crate) fn explains(a: &Matrix3<f64>, g: &Matrix3<f64>, off: &Vector3<f64>) -> bool {
    let unexplained = off - a * g * off;
    // Ten deviations of a direction that is left out, or a micrometre.
    (0..3).all(|i| unexplained[i].abs() <= 1e-3 * a[(i, i)].max(0.0).sqrt() + 1e-6)
}

/// A symmetric G with A G A = A for a symmetric, positive semidefinite A: its inverse, if it has one. What is certain (a
/// variance of zero), or told by the rest, has zeros in its row and column.
///
/// By sweeping the diagonal, largest remaining share first; metres and radians don't mix in that choice.
pub(crate) fn semi_inverse(a: &Matrix3<f64>) -> Matrix3<f64> {
    let mut swept = *a;
    let mut done = [false; 3];
    let share = |swept: &Matrix3<f64>, k: usize| if a[(k, k)] > 0.0 { swept[(k, k)] / a[(k, k)] } else { 0.0 };
    for _ in 0..3 {
        let left = (0..3).filter(|k| !done[*k]);
        let Some(k) = left.max_by(|i, j| share(&swept, *i).total_cmp(&share(&swept, *j))) else { break };
        let left = share(&swept, k);
        if left.is_nan() || left <= NOTHING {
            break;
        }
        done[k] = true;
        let pivot = swept[(k, k)];
        let before = swept;
        for i in 0..3 {
            for j in 0..3 {
                swept[(i, j)] = match (i == k, j == k) {
                    (true, true) => -1.0 / pivot,
                    (true, false) => before[(k, j)] / pivot,
                    (false, true) => before[(i, k)] / pivot,
                    (false, false) => before[(i, j)] - before[(i, k)] * before[(k, j)] / pivot,
                };
            }
        }
    }
    Matrix3::from_fn(|i, j| if done[i] && done[j] { -0.5 * (swept[(i, j)] + swept[(j, i)]) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn of_nothing_there_is_nothing() {
        assert_eq!(semi_inverse(&Matrix3::zeros()), Matrix3::zeros());
        let one = Matrix3::new(0.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0);
        assert_eq!(semi_inverse(&one)[(1, 1)], 0.25);
        assert!(semi_inverse(&Matrix3::from_element(f64::NAN)).iter().all(|value| *value == 0.0));
    }

    proptest! {
        #[test]
        fn it_takes_the_place_of_an_inverse(
            numbers in prop::array::uniform9(-1.0..1.0f64), rank in 1..=3usize, metres in -6..6i32,
        ) {
            let factor = Matrix3::from_fn(|row, column| if column < rank { numbers[3 * row + column] } else { 0.0 });
            // A heading has another unit than a position.
            let unit_m = libm::pow(10.0, f64::from(metres));
            let unit = Matrix3::from_diagonal(&nalgebra::Vector3::new(unit_m, unit_m, 1.0));
            let a = unit * factor * factor.transpose() * unit;
            let g = semi_inverse(&a);
            prop_assert_eq!(g, g.transpose());
            let back = a * g * a;
            for i in 0..3 {
                for j in 0..3 {
                    let scale = (a[(i, i)] * a[(j, j)]).sqrt();
                    prop_assert!((back - a)[(i, j)].abs() <= 1e-3 * scale, "{} {}", back, a);
                }
            }
        }
    }
}
