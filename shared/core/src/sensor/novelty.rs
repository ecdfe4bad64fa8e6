//! Evidence that is not new: readings taken from the same place repeat the same echo, errors and all, and a robot that stands still
//! must not turn them into certainty.
//!
//! Each transducer has a budget, 1 at most. A reading counts as much as the budget says and takes a tenth of it; the budget comes
//! back as the transducer gets farther than it was from where it last began: all of it over `novelty_m`. So all that is said from
//! one place counts like ten readings, nine of them within the first second at 25 Hz, and whoever moves a tenth of `novelty_m` from
//! reading to reading loses nothing. To and fro is no way.

use serde::{Deserialize, Serialize};

use crate::angle::wrap_angle;
use crate::pose::Pose2;

/// What a reading leaves of the budget.
const LEFT: f64 = 0.9;
/// Turning by a radian shows as much that is new as moving by this, metres: what turning moves at a metre's distance.
const LEVER_M: f64 = 1.0;

/// How much of what each transducer says is new.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Novelty {
    /// By number of the transducer.
    places: Vec<Option<Stay>>,
    /// The last distance: what it is between, and how far that is. The beams of a lidar share it.
    #[serde(skip)]
    last_way: Option<([f64; 4], f64)>,
}

/// Where a transducer has been speaking from.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Stay {
    begun: Pose2,
    /// How far it has got from there.
    farthest_m: f64,
    budget: f64,
}

impl Novelty {
    /// How much a reading of this transducer counts, in (0, 1], now that it is at `map_from_transducer` (finite). `novelty_m`: the
    /// way after which all is new again, metres; 0: everything always is.
    pub fn of(&mut self, transducer: u16, map_from_transducer: Pose2, novelty_m: f64) -> f64 {
        if novelty_m <= 0.0 {
            return 1.0;
        }
        let index = usize::from(transducer);
        if self.places.len() <= index {
            self.places.resize(index + 1, None);
        }
        let place = self.places[index].get_or_insert(Stay { begun: map_from_transducer, farthest_m: 0.0, budget: 1.0 });
        let turned = wrap_angle(map_from_transducer.theta - place.begun.theta).abs();
        let between = [place.begun.x, place.begun.y, map_from_transducer.x, map_from_transducer.y];
        let way_m = match self.last_way {
            Some((last, way_m)) if last == between => way_m,
            _ => place.begun.distance_m(map_from_transducer),
        };
        self.last_way = Some((between, way_m));
        let moved_m = way_m + LEVER_M * turned;
        if moved_m > place.farthest_m {
            place.budget = (place.budget + (moved_m - place.farthest_m) / novelty_m).min(1.0);
            place.farthest_m = moved_m;
        }
        if moved_m >= novelty_m {
            (place.begun, place.farthest_m) = (map_from_transducer, 0.0);
        }
        let counts = place.budget;
        place.budget *= LEFT;
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standing_still_says_little_more_than_the_first_second() {
        let mut novelty = Novelty::default();
        let mut said = |readings: u32| (0..readings).map(|_| novelty.of(3, Pose2::IDENTITY, 0.05)).sum::<f64>();
        let (first_second, ten_minutes) = (said(25), said(25 * 600));
        assert!(ten_minutes < 0.1 * first_second, "{first_second} {ten_minutes}");
        // Shaking is standing still.
        let mut shaking = Novelty::default();
        let shake = |n: u32| Pose2::new(if n.is_multiple_of(2) { 0.01 } else { 0.0 }, 0.0, 0.0);
        let said: f64 = (0..10_000).map(|n| shaking.of(3, shake(n), 0.05)).sum();
        assert!(said < 15.0, "{said}");
    }

    #[test]
    fn who_moves_loses_nothing() {
        let (mut moving, mut turning, mut off) = (Novelty::default(), Novelty::default(), Novelty::default());
        for n in 0..100 {
            let n = f64::from(n);
            assert_eq!(moving.of(0, Pose2::new(0.006 * n, 0.0, 0.0), 0.05), 1.0);
            assert_eq!(turning.of(0, Pose2::new(0.0, 0.0, 0.006 * n), 0.05), 1.0);
            assert_eq!(off.of(0, Pose2::IDENTITY, 0.0), 1.0);
        }
    }

    #[test]
    fn each_transducer_has_its_own() {
        let mut novelty = Novelty::default();
        assert_eq!((novelty.of(1, Pose2::IDENTITY, 0.05), novelty.of(0, Pose2::IDENTITY, 0.05)), (1.0, 1.0));
        assert!(novelty.of(1, Pose2::IDENTITY, 0.05) < 1.0);
    }
}
