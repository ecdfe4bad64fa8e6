//! What the angles of a line mean: those that say where a laser's beams lie, and the cone of a sonar.
//!
//! The step counts, and either sign says the sense of rotation. What contradicts itself is decided by the rules below, each of
//! which leaves a remark with its line and value.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_6, PI, TAU};

use crate::log::fault::{FaultKind, Refusal};

/// Angles of a laser up to here are radians: a turn and a little. Larger ones are degrees.
const RADIANS_MAX: f64 = 6.5;
/// The largest angle in degrees: two turns.
const DEGREES_MAX: f64 = 720.0;
/// Angles that differ by less are the same, radians: four decimals, rounded.
const SAME_RAD: f64 = 0.01;
/// What all beams can cover, radians: some lidars tell the end of a turn again with the beginning of the next.
const SPAN_MAX_RAD: f64 = 1.25 * TAU;
/// Sonars of narrower cones are taken to be of this one, radians: no cell is as narrow.
const CONE_MIN_RAD: f64 = 1e-3;

/// Where the beams of a line lie, and what is odd about how it says so.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Beams {
    pub(super) first_bearing_rad: f64,
    /// Positive counter-clockwise.
    pub(super) bearing_step_rad: f64,
    pub(super) oddities: Vec<Refusal>,
}

impl Beams {
    /// Of a line that states start, field of view and step, all finite.
    ///
    /// # Errors
    /// They are no angles at all.
    pub(super) fn stated(start: f64, view: f64, step: f64, count: usize) -> Result<Self, Refusal> {
        let mut oddities = Vec::new();
        let (mut start, mut view, mut step) = (start, view, step);
        let as_stated = format!("start {start}, field of view {view}, step {step}");
        let largest = start.abs().max(view.abs());
        if largest > DEGREES_MAX {
            return Err(Refusal::new(FaultKind::AbsurdPose, as_stated));
        }
        if largest > RADIANS_MAX {
            (start, view, step) = (start.to_radians(), view.to_radians(), step.to_radians());
            oddities.push(Refusal::new(FaultKind::AnglesInDegrees, &as_stated));
        }
        if count < 2 {
            let step = if step.abs() > RADIANS_MAX { 0.0 } else { step };
            return Ok(Self { first_bearing_rad: start, bearing_step_rad: step, oddities });
        }
        let gaps = (count - 1) as f64;
        let clockwise = step < 0.0 || view < 0.0;
        let signed = |magnitude: f64| if clockwise { -magnitude } else { magnitude };
        let (view, step) = (view.abs(), step.abs());
        let span = step * gaps;
        let bearing_step_rad = if step == 0.0 && view == 0.0 {
            oddities.push(Refusal::new(FaultKind::AnglesMissing, &as_stated));
            let (first_bearing_rad, bearing_step_rad) = plain_fan(count);
            return Ok(Self { first_bearing_rad, bearing_step_rad, oddities });
        } else if step == 0.0 {
            signed(view / gaps)
        } else if span > SPAN_MAX_RAD {
            if view == 0.0 || view > SPAN_MAX_RAD {
                return Err(Refusal::new(FaultKind::AbsurdPose, format!("{count} beams: {as_stated}")));
            }
            oddities.push(Refusal::new(FaultKind::StepBeyondTurn, format!("{count} beams: {as_stated}")));
            signed(view / gaps)
        } else {
            if view > 0.0 && (view - span).abs() > 1.5 * step + SAME_RAD {
                oddities.push(Refusal::new(FaultKind::StepNotOfView, format!("{count} beams: {as_stated}")));
            }
            signed(step)
        };
        Ok(Self { first_bearing_rad: start, bearing_step_rad, oddities })
    }
}

/// First bearing and step of `FLASER` and `RLASER`, which don't say them: from −90° on, 1° for
/// 180 or 181 beams, ½° for 360 or 361, any other number spread over 180°.
pub(in crate::log) fn plain_fan(count: usize) -> (f64, f64) {
    let step_deg = match count {
        180 | 181 => 1.0,
        360 | 361 => 0.5,
        0 | 1 => return (0.0, 0.0),
        _ => 180.0 / (count - 1) as f64,
    };
    (-FRAC_PI_2, f64::to_radians(step_deg))
}

/// The full aperture of a sonar whose line states this cone (finite), and what is odd about that.
///
/// # Errors
/// It is no angle at all.
pub(in crate::log) fn cone(stated: f64) -> Result<(f64, Vec<Refusal>), Refusal> {
    let mut oddities = Vec::new();
    let mut odd = |kind| oddities.push(Refusal::new(kind, stated.to_string()));
    let size = stated.abs();
    if size > 360.0 {
        return Err(Refusal::new(FaultKind::AbsurdPose, format!("a cone of {stated}")));
    }
    if stated < 0.0 {
        odd(FaultKind::ConeNegative);
    }
    let aperture_rad = if size == 0.0 {
        odd(FaultKind::ConeMissing);
        FRAC_PI_6
    } else if size > PI + SAME_RAD && (size - TAU).abs() > SAME_RAD {
        odd(FaultKind::ConeInDegrees);
        size.to_radians()
    } else {
        if size > FRAC_PI_2 + SAME_RAD {
            odd(FaultKind::ConeWide);
        } else if size < PI / 180.0 {
            odd(FaultKind::ConeNarrow);
        }
        size
    };
    Ok((aperture_rad.clamp(CONE_MIN_RAD, TAU), oddities))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `odd`: what is odd about it, if anything is.
    fn check(stated: [f64; 3], count: usize, first: f64, step: f64, odd: Option<FaultKind>) {
        let beams = Beams::stated(stated[0], stated[1], stated[2], count).unwrap();
        assert!((beams.first_bearing_rad - first).abs() < 1e-9, "{stated:?} {beams:?}");
        assert!((beams.bearing_step_rad - step).abs() < 1e-9, "{stated:?} {beams:?}");
        assert_eq!(beams.oddities.iter().map(|o| o.kind).collect::<Vec<_>>(), Vec::from_iter(odd), "{stated:?}");
    }

    #[test]
    fn the_step_counts_and_either_sign_is_the_sense_of_rotation() {
        let step = PI / 180.0;
        check([-FRAC_PI_2, PI, step], 181, -FRAC_PI_2, step, None);
        check([-FRAC_PI_2, PI, 0.0], 181, -FRAC_PI_2, step, None);
        // A turn whose end is the beginning, or the beam before it.
        check([-PI, TAU, TAU / 360.0], 360, -PI, TAU / 360.0, None);
        check([FRAC_PI_2, PI, -2.0 * step], 91, FRAC_PI_2, -2.0 * step, None);
        check([FRAC_PI_2, -PI, 2.0 * step], 91, FRAC_PI_2, -2.0 * step, None);
        check([FRAC_PI_2, -PI, 0.0], 91, FRAC_PI_2, -2.0 * step, None);
        check([FRAC_PI_2, -PI, -2.0 * step], 91, FRAC_PI_2, -2.0 * step, None);
        check([0.3, 0.0, 0.0], 1, 0.3, 0.0, None);
        check([0.3, PI, step], 1, 0.3, step, None);
    }

    #[test]
    fn angles_that_contradict_each_other_are_decided_and_said() {
        let step = PI / 180.0;
        check([-1.0, 3.0, step], 91, -1.0, step, Some(FaultKind::StepNotOfView));
        check([-FRAC_PI_2, PI, 1.0], 181, -FRAC_PI_2, step, Some(FaultKind::StepBeyondTurn));
        check([0.0, 0.0, 0.0], 181, -FRAC_PI_2, step, Some(FaultKind::AnglesMissing));
        check([-90.0, 180.0, 1.0], 181, -FRAC_PI_2, step, Some(FaultKind::AnglesInDegrees));
        check([0.0, 360.0, -1.0], 360, 0.0, -step, Some(FaultKind::AnglesInDegrees));
        assert_eq!(Beams::stated(0.0, 1e4, 1.0, 9).unwrap_err().kind, FaultKind::AbsurdPose);
        assert_eq!(Beams::stated(0.0, 0.0, 3.0, 9).unwrap_err().kind, FaultKind::AbsurdPose);
    }

    #[test]
    fn cones_of_sonars() {
        let check = |stated: f64, aperture_rad: f64, odd: Option<FaultKind>| {
            let (cone, oddities) = cone(stated).unwrap();
            assert!((cone - aperture_rad).abs() < 1e-9, "{stated} {cone}");
            assert_eq!(oddities.iter().map(|o| o.kind).collect::<Vec<_>>(), Vec::from_iter(odd), "{stated}");
        };
        check(0.5, 0.5, None);
        check(0.0, FRAC_PI_6, Some(FaultKind::ConeMissing));
        check(-0.5, 0.5, Some(FaultKind::ConeNegative));
        check(5.0, 5_f64.to_radians(), Some(FaultKind::ConeInDegrees));
        check(15.0, 15_f64.to_radians(), Some(FaultKind::ConeInDegrees));
        check(360.0, TAU, Some(FaultKind::ConeInDegrees));
        check((TAU * 1e4).round() * 1e-4, TAU, Some(FaultKind::ConeWide));
        check(2.0, 2.0, Some(FaultKind::ConeWide));
        check(1e-12, CONE_MIN_RAD, Some(FaultKind::ConeNarrow));
        assert_eq!(super::cone(361.0).unwrap_err().kind, FaultKind::AbsurdPose);
    }
}
