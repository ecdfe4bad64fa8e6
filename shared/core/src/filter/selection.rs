//! `selection`: the sonars that are used (section 4.2 of the paper). Lidars always are.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use crate::angle::wrap_angle;
use crate::config::{ConfigError, SonarSelection, SonarWord};
use crate::robot::{SensorKind, Transducer};

/// Ahead, left, back, right.
const DIRECTIONS_RAD: [f64; 4] = [0.0, FRAC_PI_2, PI, -FRAC_PI_2];
/// Sonars that differ by less look the same way, radians: robot files are written in whole degrees.
const SAME_RAD: f64 = 0.01;

/// Whether each transducer, by index, is used. Sonars are counted in the order of their transducers.
///
/// # Errors
/// A number that no sonar has.
pub(crate) fn selected(
    selection: &SonarSelection,
    transducers: &[Option<Transducer>],
) -> Result<Vec<bool>, ConfigError> {
    let sonar = |transducer: &Option<Transducer>| transducer.is_some_and(|t| t.kind == SensorKind::Sonar);
    let bearings: Vec<f64> = transducers
        .iter()
        .flatten()
        .filter(|transducer| transducer.kind == SensorKind::Sonar)
        .map(|transducer| transducer.base_from_transducer.theta)
        .collect();
    let sonars: Vec<bool> = match selection {
        SonarSelection::Word(SonarWord::All) => vec![true; bearings.len()],
        SonarSelection::Word(SonarWord::Corridor) => of_corridors(&bearings),
        SonarSelection::Numbers(numbers) => {
            for number in numbers {
                let has = usize::from(*number) < bearings.len();
                ConfigError::unless(has, "sonars", number, "numbers of sonars that the robot has")?;
            }
            (0..bearings.len()).map(|number| numbers.iter().any(|n| usize::from(*n) == number)).collect()
        }
    };
    let mut sonars = sonars.into_iter();
    Ok(transducers.iter().map(|transducer| !sonar(transducer) || sonars.next().unwrap_or(false)).collect())
}

/// Of sonars at these bearings (radians) those that meet a corridor's walls at right angles, and those with the smallest
/// angle to the robot's axis: in each of four directions the nearest, by less than 45°.
fn of_corridors(bearings: &[f64]) -> Vec<bool> {
    let off = |bearing: f64, direction: f64| wrap_angle(bearing - direction).abs();
    let nearest = DIRECTIONS_RAD
        .map(|direction| bearings.iter().map(|bearing| off(*bearing, direction)).fold(FRAC_PI_4, f64::min));
    let is_nearest = |bearing: f64| {
        let looks =
            |(direction, nearest): (&f64, &f64)| *nearest < FRAC_PI_4 && off(bearing, *direction) <= nearest + SAME_RAD;
        DIRECTIONS_RAD.iter().zip(&nearest).any(looks)
    };
    bearings.iter().map(|bearing| is_nearest(*bearing)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(degrees: &[f64], expected: &[usize]) {
        let bearings: Vec<f64> = degrees.iter().map(|degrees| degrees.to_radians()).collect();
        let kept: Vec<usize> =
            of_corridors(&bearings).iter().enumerate().filter(|(_, k)| **k).map(|(n, _)| n).collect();
        assert_eq!(kept, expected, "{degrees:?}");
    }

    #[test]
    fn the_papers_eight_of_a_pioneer() {
        let pioneer = [
            90.0, 50.0, 30.0, 10.0, -10.0, -30.0, -50.0, -90.0, -90.0, -130.0, -150.0, -170.0, 170.0, 150.0, 130.0,
            90.0,
        ];
        check(&pioneer, &[0, 3, 4, 7, 8, 11, 12, 15]);
    }

    #[test]
    fn other_robots() {
        check(&[], &[]);
        check(&[0.0], &[0]);
        check(&[60.0, 85.0, 120.0], &[1]);
        // Right between two directions is neither.
        check(&[45.0, -135.0], &[]);
        check(&[-0.2, 0.2, 180.0, -179.9], &[0, 1, 2, 3]);
    }
}
