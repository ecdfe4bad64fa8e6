//! Whether poses are those of a drive: wheels do not slide sideways, what corrects poses from outside moves them any way.

use crate::angle::wrap_angle;
use crate::odometry::increment::Increment;
use crate::pose::Pose2;

/// Ways are looked at in pieces of this length, so that digits that were not written do not count, metres.
const PIECE_M: f64 = 0.25;
/// A longer piece is a leap, or lacks poses, metres.
const PIECE_MAX_M: f64 = 1.0;
/// Who turns more on a piece may end beside it by driving, radians.
const TURN_MAX_RAD: f64 = 0.2;
/// A piece slides that ends so much to its side, as a share of its length. Of raw odometry one in thirty does, of a SLAM's poses one in four.
const SLIDES: f64 = 0.04;
/// So many pieces say something.
const PIECES_MIN: u64 = 30;
/// One piece in so many slides: no drive.
const ONE_IN: u64 = 8;

/// Pieces of a way, and how many of them slide sideways.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sideways {
    /// Pieces that are fairly straight.
    pub pieces: u64,
    /// Those that end beside where they head for.
    pub sliding: u64,
    /// Where the present piece began, its length and its turn.
    piece: Option<(Pose2, f64, f64)>,
    last: Option<Pose2>,
}

impl Sideways {
    /// Takes the next pose.
    pub fn add(&mut self, pose: Pose2) {
        let Some(last) = self.last.replace(pose) else { return };
        let (begin, length_m, turn_rad) = self.piece.unwrap_or((last, 0.0, 0.0));
        let length_m = length_m + last.distance_m(pose);
        let turn_rad = turn_rad + wrap_angle(pose.theta - last.theta).abs();
        let is_straight = turn_rad <= TURN_MAX_RAD && length_m < PIECE_MAX_M;
        self.piece = (is_straight && length_m < PIECE_M).then_some((begin, length_m, turn_rad));
        if is_straight && length_m >= PIECE_M {
            let step = Increment::between(begin, pose);
            self.pieces += 1;
            self.sliding += u64::from(step.lateral_m.abs() > SLIDES * step.length_m());
        }
    }

    /// Share of the pieces that slide, in [0, 1].
    #[must_use]
    pub fn share(&self) -> f64 {
        self.sliding as f64 / self.pieces.max(1) as f64
    }

    /// Whether no drive makes such a way.
    #[must_use]
    pub fn is_no_drive(&self) -> bool {
        self.pieces >= PIECES_MIN && self.sliding * ONE_IN >= self.pieces
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::standard_normal_pair;

    /// 60 m of bends; each pose is off by so much on its way and in its heading.
    fn way(off_m: f64, off_rad: f64, digits: f64) -> Sideways {
        let mut sideways = Sideways::default();
        for step in 0..1200_u32 {
            let turn = f64::from(step) * 0.01;
            let (x, y) = standard_normal_pair(7, u64::from(step), 0);
            let (theta, _) = standard_normal_pair(7, u64::from(step), 1);
            let round = |value: f64| (value * digits).round() / digits;
            let (s, c) = libm::sincos(turn);
            let pose =
                Pose2::new(round(5.0 * s + off_m * x), round(-5.0 * c + off_m * y), round(turn + off_rad * theta));
            sideways.add(pose);
        }
        sideways
    }

    #[test]
    fn a_drive_does_not_slide_whatever_its_digits() {
        assert!(!way(0.0, 0.0, 1e6).is_no_drive());
        assert!(!way(0.0, 0.0, 1e3).is_no_drive());
        assert_eq!(way(0.0, 0.0, 1e6).sliding, 0);
    }

    #[test]
    fn what_is_corrected_slides() {
        let corrected = way(0.01, 0.01, 1e6);
        assert!(corrected.is_no_drive() && corrected.share() > 0.2, "{corrected:?}");
    }

    #[test]
    fn a_short_way_says_nothing_and_neither_does_none() {
        let mut sideways = Sideways::default();
        assert!(!sideways.is_no_drive() && sideways.share() == 0.0);
        (0..29).for_each(|step| sideways.add(Pose2::new(0.0, 0.3 * f64::from(step), 0.0)));
        assert!(!sideways.is_no_drive() && sideways.sliding == 28, "{sideways:?}");
    }
}
