//! What a robot measured of one landmark.

use core::f64::consts::TAU;

use super::error::TriangulationError;
use crate::pose::Pose2;

/// Coordinates and ranges beyond this are no place on a floor, metres.
pub const LENGTH_MAX_M: f64 = crate::pose::POSITION_MAX_M;
/// Smallest standard deviation that is taken, metres or radians.
pub const SIGMA_MIN: f64 = 1e-9;
/// Largest standard deviation that is taken, metres or radians.
pub const SIGMA_MAX: f64 = 1e6;
/// Most sightings of one localization.
pub const SIGHTINGS_MAX: usize = 256;

/// What a robot measured of one landmark, from the origin of its base frame. Several sightings of one landmark count as
/// measurements independent of each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Where the landmark is: x, y in the map frame, metres.
    pub landmark: [f64; 2],
    /// Distance from the robot, metres, if it was measured.
    pub range_m: Option<f64>,
    /// Direction as seen from the robot, radians counter-clockwise from straight ahead, within a turn, if it was measured.
    pub bearing_rad: Option<f64>,
    /// Standard deviation of the range, metres; not looked at without one.
    pub range_sigma_m: f64,
    /// Standard deviation of the bearing, radians; not looked at without one.
    pub bearing_sigma_rad: f64,
}

impl Sighting {
    /// The same in a frame in which the landmark lies `by` farther on.
    pub(super) fn moved(self, by: [f64; 2]) -> Self {
        Self { landmark: [self.landmark[0] + by[0], self.landmark[1] + by[1]], ..self }
    }

    fn check(&self, sighting: usize) -> Result<(), TriangulationError> {
        let check = |what, value: f64, fits: bool, expected| {
            if fits { Ok(()) } else { Err(TriangulationError::BadValue { sighting, what, value, expected }) }
        };
        if self.range_m.is_none() && self.bearing_rad.is_none() {
            return Err(TriangulationError::NothingMeasured { sighting });
        }
        for value in self.landmark {
            check("position of its landmark", value, is_length(value), PLACE)?;
        }
        if let Some(range_m) = self.range_m {
            check("range", range_m, is_length(range_m) && range_m >= 0.0, "metres, from 0 to 3e7")?;
            check("range's sigma", self.range_sigma_m, is_sigma(self.range_sigma_m), SIGMA)?;
        }
        if let Some(bearing_rad) = self.bearing_rad {
            check("bearing", bearing_rad, bearing_rad.abs() <= TAU, "radians within a turn")?;
            check("bearing's sigma", self.bearing_sigma_rad, is_sigma(self.bearing_sigma_rad), SIGMA)?;
        }
        Ok(())
    }
}

const PLACE: &str = "metres, within 3e7 of the origin";
const SIGMA: &str = "a standard deviation from 1e-9 to 1e6";

/// Also false for NaN.
fn is_length(value: f64) -> bool {
    value.abs() <= LENGTH_MAX_M
}

fn is_sigma(value: f64) -> bool {
    (SIGMA_MIN..=SIGMA_MAX).contains(&value)
}

/// Whether all numbers are usable and the landmarks, if they lie well, settle a pose.
pub(super) fn check(sightings: &[Sighting], guess: Pose2) -> Result<(), TriangulationError> {
    if sightings.len() > SIGHTINGS_MAX {
        return Err(TriangulationError::TooMany { count: sightings.len() });
    }
    for (index, sighting) in sightings.iter().enumerate() {
        sighting.check(index)?;
    }
    for value in [guess.x, guess.y] {
        if !is_length(value) {
            return Err(TriangulationError::BadGuess { value, expected: PLACE });
        }
    }
    if !guess.theta.is_finite() {
        return Err(TriangulationError::BadGuess { value: guess.theta, expected: "radians" });
    }
    let ranges = different_places(sightings.iter().filter(|sighting| sighting.range_m.is_some()));
    let bearings = different_places(sightings.iter().filter(|sighting| sighting.bearing_rad.is_some()));
    let missing = if bearings == 0 { 2_usize } else { 3 }.saturating_sub(ranges + bearings);
    if missing == 0 {
        return Ok(());
    }
    Err(if sightings.len() > 1 && different_places(sightings.iter()) == 1 {
        TriangulationError::OnePlace { count: sightings.len() }
    } else {
        TriangulationError::TooFew { ranges, bearings, missing }
    })
}

/// Number of places among the landmarks.
fn different_places<'a>(sightings: impl Iterator<Item = &'a Sighting>) -> usize {
    // -0 is 0.
    let mut places: Vec<[u64; 2]> =
        sightings.map(|sighting| sighting.landmark.map(|value| (value + 0.0).to_bits())).collect();
    places.sort_unstable();
    places.dedup();
    places.len()
}
