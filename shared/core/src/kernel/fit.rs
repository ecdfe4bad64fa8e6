//! Polynomials in place of exp, ln and atan, which would be most of the work of a reading.

/// The nodes of Chebyshev on [0, 1] at which a polynomial with N coefficients is fitted.
pub(super) fn nodes<const N: usize>() -> [f64; N] {
    core::array::from_fn(|k| {
        let angle = core::f64::consts::PI * (k as f64 + 0.5) / N as f64;
        0.5 * (1.0 + libm::cos(angle))
    })
}

/// Fits polynomials over [0, 1] to values at [`nodes`].
#[derive(Debug, Clone)]
pub(super) struct Fitter<const N: usize> {
    /// `basis[node][power]`: the polynomial that is 1 at this node and 0 at all others.
    basis: [[f64; N]; N],
}

impl<const N: usize> Fitter<N> {
    pub(super) fn new() -> Self {
        Self::over(&nodes::<N>())
    }

    /// To values at these nodes, no two of which are the same.
    pub(super) fn over(nodes: &[f64; N]) -> Self {
        let mut basis = [[0.0; N]; N];
        for (own, row) in nodes.iter().zip(&mut basis) {
            // Π (x − other) / (own − other), multiplied out one factor at a time.
            row[0] = 1.0;
            for other in nodes.iter().filter(|other| *other != own) {
                let scale = 1.0 / (own - other);
                for power in (0..N).rev() {
                    let below = if power > 0 { row[power - 1] } else { 0.0 };
                    row[power] = (below - other * row[power]) * scale;
                }
            }
        }
        Self { basis }
    }

    /// Coefficients of 1, x, x² … of the polynomial that has `values` at the nodes.
    #[inline(always)]
    pub(super) fn through(&self, values: &[f64; N]) -> [f64; N] {
        let mut coefficients = [0.0; N];
        for (value, row) in values.iter().zip(&self.basis) {
            for (coefficient, part) in coefficients.iter_mut().zip(row) {
                *coefficient += value * part;
            }
        }
        coefficients
    }
}

/// Coefficients of 1, x, x² … of the polynomial that follows `function` over [0, `high`].
pub(super) fn fit<const N: usize>(function: impl Fn(f64) -> f64, high: f64) -> [f64; N] {
    let values = nodes::<N>().map(|x| function(high * x));
    let mut coefficients = Fitter::<N>::new().through(&values);
    let mut scale = 1.0;
    for coefficient in &mut coefficients {
        *coefficient *= scale;
        scale /= high;
    }
    coefficients
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evaluate(coefficients: &[f64], x: f64) -> f64 {
        coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
    }

    #[test]
    fn follows_smooth_functions() {
        let exp = fit::<12>(|x| libm::exp(-x), 2.0);
        for step in 0..=1000 {
            let x = 2.0 * f64::from(step) / 1000.0;
            assert!((evaluate(&exp, x) - libm::exp(-x)).abs() < 1e-9, "{x}");
        }
    }

    #[test]
    fn a_polynomial_is_its_own_fit() {
        let ours = fit::<4>(|x| 2.0 - x + 0.5 * x * x * x, 3.0);
        for (ours, expected) in ours.iter().zip([2.0, -1.0, 0.0, 0.5]) {
            assert!((ours - expected).abs() < 1e-13, "{ours} {expected}");
        }
    }
}
