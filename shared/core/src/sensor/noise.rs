//! The random part n of eqs 9, 10, 22, 23: n ~ N(0, ε).
//!
//! A draw depends on the seed, the number of the ring and the transducer, and on nothing else: a run is repeatable, and
//! a process that was restarted in the middle of one draws the same numbers as if it had not been.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::config::Noise;
use crate::odometry::OdometryErrors;

/// What is added to the systematic errors in eqs 22, 23.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NoiseTerms {
    /// n_lin, what is added to the linear error, metres.
    pub lin_m: f64,
    /// n_ang, what is added to the angular error, radians.
    pub ang_rad: f64,
}

impl NoiseTerms {
    /// The terms of one reading, as configured.
    #[must_use]
    pub fn of(noise: Noise, errors: &OdometryErrors, seed: u64, sequence: u64, transducer: u16) -> Self {
        match noise {
            Noise::Sampled => Self::sampled(errors, seed, sequence, transducer),
            Noise::OneSigma => Self::one_sigma(errors),
        }
    }

    /// The random part of eqs 9, 10, drawn: n_lin ~ N(0, ε_lin) in metres, n_ang ~ N(0, ε_ang) in radians.
    #[must_use]
    pub fn sampled(errors: &OdometryErrors, seed: u64, sequence: u64, transducer: u16) -> Self {
        let deviation = Self::one_sigma(errors);
        if deviation == Self::default() {
            return deviation;
        }
        let (lin, ang) = standard_normal_pair(seed, sequence, transducer);
        Self { lin_m: deviation.lin_m * lin, ang_rad: deviation.ang_rad * ang }
    }

    /// The terms of one standard deviation, n = √ε, which are not drawn.
    #[must_use]
    pub fn one_sigma(errors: &OdometryErrors) -> Self {
        Self { lin_m: errors.eps_lin_m2.sqrt(), ang_rad: errors.eps_ang_rad2.sqrt() }
    }
}

/// Two independent draws from N(0, 1) that belong to one reading.
///
/// The key of a ChaCha8 stream is spelled out of the three numbers; two 53-bit uniforms of that stream give the pair
/// by Box and Muller's transform. (The usual ziggurat asks the system's mathematical library in its tail, which would
/// make runs differ between machines.)
#[must_use]
pub fn standard_normal_pair(seed: u64, sequence: u64, transducer: u16) -> (f64, f64) {
    let mut key = [0u8; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..16].copy_from_slice(&sequence.to_le_bytes());
    key[16..18].copy_from_slice(&transducer.to_le_bytes());
    key[24..].copy_from_slice(b"echogrid");
    let mut stream = ChaCha8Rng::from_seed(key);
    // (0, 1]: its logarithm is finite.
    let radius_draw = ((stream.next_u64() >> 11) + 1) as f64 / TWO_TO_53;
    let angle_draw = (stream.next_u64() >> 11) as f64 / TWO_TO_53;
    let radius = (-2.0 * libm::log(radius_draw)).sqrt();
    let (s, c) = libm::sincos(core::f64::consts::TAU * angle_draw);
    (radius * c, radius * s)
}

/// Draws of one purpose, one after the other: the same seed and purpose give the same numbers on every machine, and two
/// purposes never share one, so that what one of them draws does not change what another does.
#[derive(Debug, Clone)]
pub struct Draws {
    stream: ChaCha8Rng,
    /// Box and Muller's transform makes two at a time.
    spare: Option<f64>,
}

impl Draws {
    /// The stream of a purpose, told by a short name: its first 16 bytes count.
    #[must_use]
    pub fn new(seed: u64, purpose: &str) -> Self {
        let mut key = [0u8; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        for (place, byte) in key[8..24].iter_mut().zip(purpose.bytes()) {
            *place = byte;
        }
        key[24..].copy_from_slice(b"simulate");
        Self { stream: ChaCha8Rng::from_seed(key), spare: None }
    }

    /// Uniform in [0, 1), in steps of 2⁻⁵³.
    pub fn uniform(&mut self) -> f64 {
        (self.stream.next_u64() >> 11) as f64 / TWO_TO_53
    }

    /// Draws from N(0, 1).
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        // 1 − [0, 1) is (0, 1]: its logarithm is finite.
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        let (s, c) = libm::sincos(core::f64::consts::TAU * self.uniform());
        self.spare = Some(radius * s);
        radius * c
    }

    /// Draws from the exponential distribution of this mean.
    pub fn exponential(&mut self, mean: f64) -> f64 {
        -mean * libm::log(1.0 - self.uniform())
    }
}

const TWO_TO_53: f64 = 9_007_199_254_740_992.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(eps_lin_m2: f64, eps_ang_rad2: f64) -> OdometryErrors {
        OdometryErrors { eps_lin_m2, eps_ang_rad2, ..OdometryErrors::default() }
    }

    #[test]
    fn the_same_reading_draws_the_same_numbers() {
        // Recorded: a run made today must be repeatable with tomorrow's version.
        let (lin, ang) = standard_normal_pair(1, 2, 3);
        assert_eq!((lin.to_bits(), ang.to_bits()), (RECORDED.0.to_bits(), RECORDED.1.to_bits()), "{lin:?} {ang:?}");
        for other in [standard_normal_pair(2, 2, 3), standard_normal_pair(1, 3, 3), standard_normal_pair(1, 2, 4)] {
            assert_ne!(other, (lin, ang));
        }
    }

    const RECORDED: (f64, f64) = (0.095_820_261_587_244_05, -1.219_116_340_519_040_8);

    #[test]
    fn draws_are_standard_normal() {
        const N: u32 = 100_000;
        let n = f64::from(N);
        let (mut sum, mut square, mut product, mut within, mut fourth) = (0.0, 0.0, 0.0, 0u32, 0.0);
        for k in 0..N {
            let (a, b) = standard_normal_pair(7, u64::from(k / 16), (k % 16) as u16);
            sum += a + b;
            square += a * a + b * b;
            fourth += a * a * a * a;
            product += a * b;
            within += u32::from(a.abs() < 1.0);
        }
        // Five standard errors each.
        assert!((sum / (2.0 * n)).abs() < 5.0 / (2.0 * n).sqrt());
        assert!((square / (2.0 * n) - 1.0).abs() < 5.0 * (1.0 / n).sqrt());
        assert!((fourth / n - 3.0).abs() < 5.0 * (96.0 / n).sqrt());
        assert!((product / n).abs() < 5.0 / n.sqrt());
        assert!((f64::from(within) / n - 0.682_689_5).abs() < 5.0 * (0.2166 / n).sqrt());
    }

    #[test]
    fn streams_are_repeatable_and_apart() {
        let draw = |seed, purpose| Draws::new(seed, purpose).normal();
        assert_eq!(draw(1, "sonar").to_bits(), draw(1, "sonar").to_bits());
        assert!(draw(1, "sonar") != draw(1, "lidar") && draw(1, "sonar") != draw(2, "sonar"));
        let mut draws = Draws::new(3, "test");
        const N: u32 = 100_000;
        let n = f64::from(N);
        let normals: Vec<f64> = (0..N).map(|_| draws.normal()).collect();
        let sum: f64 = normals.iter().sum();
        let square: f64 = normals.iter().map(|x| x * x).sum();
        let next: f64 = normals.windows(2).map(|pair| pair[0] * pair[1]).sum();
        let waits: f64 = (0..N).map(|_| draws.exponential(3.0)).sum();
        // Five standard errors each.
        assert!((sum / n).abs() < 5.0 / n.sqrt());
        assert!((square / n - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        assert!((next / n).abs() < 5.0 / n.sqrt());
        assert!((waits / n - 3.0).abs() < 5.0 * 3.0 / n.sqrt());
        assert!((0..N).all(|_| (0.0..1.0).contains(&draws.uniform())));
    }

    #[test]
    fn epsilon_is_a_variance() {
        let (lin, ang) = standard_normal_pair(5, 6, 7);
        let terms = NoiseTerms::sampled(&errors(0.04, 0.0009), 5, 6, 7);
        assert!((terms.lin_m - 0.2 * lin).abs() < 1e-15 && (terms.ang_rad - 0.03 * ang).abs() < 1e-15);
        let terms = NoiseTerms::of(Noise::OneSigma, &errors(0.04, 0.0009), 5, 6, 7);
        assert!((terms.lin_m - 0.2).abs() < 1e-15 && (terms.ang_rad - 0.03).abs() < 1e-15);
        assert_eq!(NoiseTerms::of(Noise::Sampled, &errors(0.0, 0.0), 5, 6, 7), NoiseTerms::default());
    }
}
