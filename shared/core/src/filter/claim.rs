//! What one reading says about the plane: its cone is empty up to the arc that the echo came from.

use serde::{Deserialize, Serialize};

use crate::pose::Pose2;

/// Where on the arc it is looked at, as shares of half the aperture.
const SAMPLES: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
/// A point this little beyond the rim of a cone is still in it: a share of half the aperture's cosine.
const RIM: f64 = 1e-9;

/// A reading of a sonar in the map frame. It is saved as what it was made of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "Heard", into = "Heard")]
pub(crate) struct Claim {
    /// Whose.
    pub(crate) transducer: u16,
    /// Metres.
    pub(crate) range_m: f64,
    /// Where the transducer was, metres.
    pub(crate) origin: [f64; 2],
    /// Where it looked, radians, and as a unit vector.
    theta: f64,
    axis: [f64; 2],
    /// Full aperture, radians.
    aperture_rad: f64,
    sin_half: f64,
    cos_half: f64,
    /// Of the arc, metres.
    samples: [[f64; 2]; 5],
}

/// What makes a claim.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Heard {
    transducer: u16,
    range_m: f64,
    map_from_transducer: Pose2,
    aperture_rad: f64,
}

impl From<Heard> for Claim {
    fn from(heard: Heard) -> Self {
        Self::new(heard.transducer, heard.map_from_transducer, heard.range_m, heard.aperture_rad)
    }
}

impl From<Claim> for Heard {
    fn from(claim: Claim) -> Self {
        let Claim { transducer, range_m, origin: [x, y], theta, aperture_rad, .. } = claim;
        Self { transducer, range_m, map_from_transducer: Pose2 { x, y, theta }, aperture_rad }
    }
}

/// A circle, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Circle {
    pub(crate) centre: [f64; 2],
    pub(crate) radius_m: f64,
}

pub(crate) fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::sqrt(distance2_m2(a, b))
}

fn distance2_m2(a: [f64; 2], b: [f64; 2]) -> f64 {
    let (x, y) = (a[0] - b[0], a[1] - b[1]);
    x * x + y * y
}

impl Claim {
    /// Of a transducer of this aperture (full, radians) at this pose.
    pub(crate) fn new(transducer: u16, map_from_transducer: Pose2, range_m: f64, aperture_rad: f64) -> Self {
        let half_rad = 0.5 * aperture_rad;
        let (sin, cos) = libm::sincos(map_from_transducer.theta);
        let (sin_half, cos_half) = libm::sincos(half_rad);
        let origin = [map_from_transducer.x, map_from_transducer.y];
        let samples = SAMPLES.map(|share| {
            let (sin, cos) = libm::sincos(map_from_transducer.theta + share * half_rad);
            [origin[0] + range_m * cos, origin[1] + range_m * sin]
        });
        let (theta, axis) = (map_from_transducer.theta, [cos, sin]);
        Self { transducer, range_m, origin, theta, axis, aperture_rad, sin_half, cos_half, samples }
    }

    /// Where the echo came from if it came from the axis, metres.
    pub(crate) fn end(&self) -> [f64; 2] {
        self.samples[2]
    }

    /// By how much the transducer turned until another claim of it, radians, 0 or more.
    pub(crate) fn turned_rad(&self, later: &Self) -> f64 {
        let (cos, sin) = (
            self.axis[0] * later.axis[0] + self.axis[1] * later.axis[1],
            self.axis[0] * later.axis[1] - self.axis[1] * later.axis[0],
        );
        libm::atan2(sin, cos).abs()
    }

    /// The largest circle inside the claimed cone and tangent to its arc (Lee & Chung 2006).
    pub(crate) fn bubble(&self) -> Circle {
        let way_m = self.range_m / (1.0 + self.sin_half);
        let centre = [self.origin[0] + way_m * self.axis[0], self.origin[1] + way_m * self.axis[1]];
        Circle { centre, radius_m: self.range_m - way_m }
    }

    /// Distance of a point that lies in the cone's angle from its transducer, metres.
    fn seen_at_m(&self, point: [f64; 2]) -> Option<f64> {
        let (x, y) = (point[0] - self.origin[0], point[1] - self.origin[1]);
        let away_m = libm::sqrt(x * x + y * y);
        let ahead_m = x * self.axis[0] + y * self.axis[1];
        (ahead_m >= away_m * (self.cos_half - RIM)).then_some(away_m)
    }

    /// Whether both may be echoes of one thing: their arcs come within a tolerance (metres) of each other.
    pub(crate) fn agrees_with(&self, other: &Self, tolerance_m: f64) -> bool {
        // No arc is longer than its aperture: most pairs are far apart.
        let reach_m = |claim: &Self| 2.0 * claim.range_m * claim.sin_half;
        let near_m = reach_m(self) + reach_m(other) + tolerance_m;
        if distance2_m2(self.end(), other.end()) > near_m * near_m {
            return false;
        }
        let on = |arc: &Self, point: [f64; 2]| {
            arc.seen_at_m(point).is_some_and(|away_m| (away_m - arc.range_m).abs() <= tolerance_m)
        };
        other.samples.iter().any(|point| on(self, *point)) || self.samples.iter().any(|point| on(other, *point))
    }

    /// Which samples of another's arc this claim says to be empty, by more than a margin (metres): a bit each.
    pub(crate) fn clears(&self, other: &Self, margin_m: f64) -> u8 {
        // What ends before the other's arc begins says nothing about it.
        let reach_m = self.range_m - margin_m;
        let near_m = reach_m + 2.0 * other.range_m * other.sin_half;
        if reach_m <= 0.0 || distance2_m2(self.origin, other.end()) > near_m * near_m {
            return 0;
        }
        let bit = |(number, point): (usize, &[f64; 2])| {
            u8::from(self.seen_at_m(*point).is_some_and(|away_m| away_m < reach_m)) << number
        };
        other.samples.iter().enumerate().map(bit).fold(0, |bits, bit| bits | bit)
    }
}

impl Circle {
    /// Whether a point lies inside by more than a tolerance, metres.
    pub(crate) fn holds(&self, point: [f64; 2], tolerance_m: f64) -> bool {
        let inner_m = self.radius_m - tolerance_m;
        inner_m > 0.0 && distance2_m2(self.centre, point) < inner_m * inner_m
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const BETA_RAD: f64 = core::f64::consts::PI / 6.0;

    fn claim(x: f64, y: f64, theta: f64, range_m: f64) -> Claim {
        Claim::new(0, Pose2::new(x, y, theta), range_m, BETA_RAD)
    }

    proptest! {
        /// The bubble touches both sides of the cone and its arc, and nothing reaches farther.
        #[test]
        fn a_bubble_fits_its_cone(x in -9.0..9.0f64, theta in -3.0..3.0f64, z in 0.1..5.0f64, beta in 0.01..1.5f64) {
            let claim = Claim::new(0, Pose2::new(x, 1.0, theta), z, beta);
            let Circle { centre, radius_m } = claim.bubble();
            let way_m = distance_m(claim.origin, centre);
            prop_assert!((way_m + radius_m - z).abs() < 1e-12 * z.max(1.0));
            prop_assert!((way_m * libm::sin(0.5 * beta) - radius_m).abs() < 1e-12);
            prop_assert!(distance_m(claim.end(), centre) - radius_m < 1e-9);
        }

        /// Agreement is mutual, and everything agrees with itself.
        #[test]
        fn agreement_is_mutual(
            a in (-2.0..2.0f64, -2.0..2.0f64, -3.0..3.0f64, 0.2..4.0f64),
            b in (-2.0..2.0f64, -2.0..2.0f64, -3.0..3.0f64, 0.2..4.0f64),
        ) {
            let (a, b) = (claim(a.0, a.1, a.2, a.3), claim(b.0, b.1, b.2, b.3));
            prop_assert_eq!(a.agrees_with(&b, 0.1), b.agrees_with(&a, 0.1));
            prop_assert!(a.agrees_with(&a, 1e-6));
            // What one says to be empty, it does not say to be a wall.
            prop_assert_eq!(a.clears(&a, 0.01), 0);
        }
    }

    #[test]
    fn one_wall_from_two_places() {
        // Both look at the wall y = 1 from 0.3 m apart.
        let quarter = core::f64::consts::FRAC_PI_2;
        assert!(claim(0.0, 0.0, quarter, 1.0).agrees_with(&claim(0.3, 0.0, quarter, 1.0), 0.05));
        assert!(!claim(0.0, 0.0, quarter, 1.0).agrees_with(&claim(0.3, 0.0, quarter, 1.5), 0.05));
        assert!(!claim(0.0, 0.0, quarter, 1.0).agrees_with(&claim(0.0, 0.0, -quarter, 1.0), 0.05));
    }

    #[test]
    fn a_far_echo_clears_the_way_to_it() {
        let (near, far) = (claim(0.0, 0.0, 0.0, 0.5), claim(0.2, 0.0, 0.0, 3.0));
        assert_eq!(far.clears(&near, 0.2), 0b0_1110, "the rim of the near cone is outside the far one");
        assert_eq!(near.clears(&far, 0.2), 0);
        assert_eq!(far.clears(&claim(0.0, 0.0, 3.0, 0.5), 0.2), 0, "behind");
    }
}
