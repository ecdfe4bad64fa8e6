//! What has been heard before: lap by lap a robot hears the same again from the same places, and what the model has wrong there is wrong
//! each time.
//!
//! Readings from one place in one direction are no independent witnesses, however far apart in time: a wall that mirrors sound does so
//! on every lap, and what little each look takes from it adds up to certainty that it is not there. So of each place of a transducer (a
//! square of `place_m`) and each of [`DIRECTIONS`] directions the visits are counted, whichever transducer spoke. What is heard on the
//! first [`VISITS`] of them counts in full, and on later ones [`AGAIN`] of that, so that a world that changed is learnt at last.
//! (Konolige 1997 counts one reading for each 10° and 5 cm.)

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::grid::TileIndex;
use crate::parts::{Parts, Saved, SavedError};
use crate::pose::Pose2;

/// Directions that are told apart, 10° each.
const DIRECTIONS: usize = 36;
/// So many visits count in full.
const VISITS: u8 = 2;
/// What a reading of a later visit counts.
const AGAIN: f64 = 0.05;
/// A stage of the way, metres; a visit is over at the latest after two of them.
const STAGE_M: f64 = 16.0;
/// Stages are told apart by their number up to this: who comes back after so many, or one more, is taken for never having left.
const STAGES: i32 = 64;
/// Bits of a stage's number.
const STAGE_BITS: u32 = STAGES.ilog2();
/// What moves less stands still, metres.
const STEP_M: f64 = 0.1;
/// Places of a square of them, along each side.
const SIDE: i32 = 16;
const BYTES: usize = (SIDE * SIDE) as usize * DIRECTIONS;

/// How often something was heard at each place, in each direction.
#[derive(Debug, Clone, Default)]
pub(crate) struct Heard {
    squares: BTreeMap<TileIndex, Square>,
    way: Way,
}

#[derive(Debug, Clone)]
struct Square {
    /// The number of visits, up to [`VISITS`] + 1, and the stage in which the last of them began; 0: nothing was heard.
    visits: Box<[u8; BYTES]>,
    changed: bool,
}

/// How far the robot has driven.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Way {
    driven_m: f64,
    last: Option<[f64; 2]>,
}

/// What is small of it, when it is saved.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct HeardState {
    way: Way,
    squares: u64,
}

impl Way {
    fn go_to(&mut self, robot: Pose2) {
        let [x, y] = *self.last.get_or_insert([robot.x, robot.y]);
        let moved_m = libm::hypot(robot.x - x, robot.y - y);
        if moved_m >= STEP_M {
            (self.driven_m, self.last) = (self.driven_m + moved_m, Some([robot.x, robot.y]));
        }
    }

    /// The number of the stage that is under way, below [`STAGES`].
    fn stage(&self) -> i32 {
        (self.driven_m / STAGE_M) as i32 % STAGES
    }
}

impl Heard {
    /// How much a reading counts, in (0, 1], that is taken at `map_from_transducer` (finite) by a robot at `robot`, and would count `news`
    /// by itself. `place_m`: the side of a place, metres; 0: nothing is held against it.
    pub(crate) fn count(&mut self, robot: Pose2, map_from_transducer: Pose2, place_m: f64, news: f64) -> f64 {
        if place_m <= 0.0 {
            return news;
        }
        self.way.go_to(robot);
        let Pose2 { x, y, theta } = map_from_transducer;
        let [column, row] = [x, y].map(|at| (at / place_m).floor() as i32);
        let turns = theta / core::f64::consts::TAU;
        let direction = ((turns - turns.floor()) * DIRECTIONS as f64) as usize % DIRECTIONS;
        let place = (row.rem_euclid(SIDE) * SIDE + column.rem_euclid(SIDE)) as usize;
        let index = TileIndex { x: column.div_euclid(SIDE), y: row.div_euclid(SIDE) };
        let new = || Square { visits: Box::new([0; BYTES]), changed: true };
        let square = self.squares.entry(index).or_insert_with(new);
        let (told, stage) = (&mut square.visits[place * DIRECTIONS + direction], self.way.stage());
        let (visits, begun) = (*told >> STAGE_BITS, i32::from(*told) % STAGES);
        let is_visit = visits == 0 || (stage - begun).rem_euclid(STAGES) > 1;
        if is_visit && visits <= VISITS {
            (*told, square.changed) = ((visits + 1) << STAGE_BITS | stage as u8, true);
        }
        if *told >> STAGE_BITS > VISITS { AGAIN * news } else { news }
    }

    /// Puts what changed since this was called last into `parts`, under names that begin with `prefix`; the rest is told.
    pub(crate) fn save(&mut self, parts: &mut Parts, prefix: &str) -> HeardState {
        for (index, square) in self.squares.iter_mut().filter(|(_, square)| square.changed) {
            parts.put_checked(format!("{prefix}{}/{}", index.x, index.y), square.visits.to_vec());
            square.changed = false;
        }
        HeardState { way: self.way, squares: self.squares.len() as u64 }
    }

    /// What was saved.
    ///
    /// # Errors
    /// A square is missing, or not what was saved.
    pub(crate) fn restore(saved: &Saved, prefix: &str, state: &HeardState) -> Result<Self, SavedError> {
        let mut squares = BTreeMap::new();
        for (part, _) in saved.under(prefix) {
            let of_name = || {
                let (x, y) = part.strip_prefix(prefix)?.split_once('/')?;
                Some(TileIndex { x: x.parse().ok()?, y: y.parse().ok()? })
            };
            let wrong = || SavedError::new(part, "no square of places");
            let index = of_name().ok_or_else(wrong)?;
            let visits = Box::new(<[u8; BYTES]>::try_from(saved.checked(part)?).map_err(|_| wrong())?);
            squares.insert(index, Square { visits, changed: false });
        }
        let found = squares.len() as u64;
        if found == state.squares {
            Ok(Self { squares, way: state.way })
        } else {
            Err(SavedError::new(prefix, format!("{found} squares of {}", state.squares)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Pose2 = Pose2 { x: -3.17, y: 8.08, theta: 0.5 };

    /// Drives so far to and fro.
    fn drive(heard: &mut Heard, way_m: f64) {
        (1..=(way_m / 0.5) as u32).for_each(|k| heard.way.go_to(Pose2 { x: HERE.x + 0.5 * f64::from(k % 2), ..HERE }));
    }

    #[test]
    fn what_is_heard_on_later_visits_says_little_that_is_new() {
        let mut heard = Heard::default();
        let said = |heard: &mut Heard| heard.count(HERE, HERE, 0.2, 0.8);
        for lap in 0..12 {
            let expected = if lap < 2 { 0.8 } else { 0.8 * AGAIN };
            assert!((0..100).all(|_| said(&mut heard) == expected), "{lap}");
            drive(&mut heard, 40.0);
        }
        assert!((0..9).all(|_| heard.count(HERE, HERE, 0.0, 0.7) == 0.7), "0 is off");
    }

    #[test]
    fn from_elsewhere_or_another_way_it_is_new() {
        let mut heard = Heard::default();
        let at = |x: f64, direction: u32| {
            let theta = f64::from(direction) * core::f64::consts::TAU / 36.0 + 0.01;
            Pose2::new(x, -0.01, theta)
        };
        for _ in 0..2 {
            heard.count(HERE, at(0.1, 0), 0.2, 1.0);
            drive(&mut heard, 40.0);
        }
        assert_eq!(heard.count(HERE, at(0.1, 0), 0.2, 1.0), AGAIN);
        assert!((1..36).all(|direction| heard.count(HERE, at(0.1, direction), 0.2, 1.0) == 1.0));
        assert!((1..99).all(|place| heard.count(HERE, at(0.1 - 0.2 * f64::from(place), 0), 0.2, 1.0) == 1.0));
    }

    #[test]
    fn it_comes_back_as_it_was_saved() {
        let (mut heard, mut saved) = (Heard::default(), Saved::default());
        let at = |k: i32| Pose2::new(1.7 * f64::from(k) - 20.0, -0.9 * f64::from(k), 0.3 * f64::from(k));
        let mut state = heard.save(&mut Parts::default(), "heard/");
        for k in (0..40).chain(0..20).chain(0..10) {
            heard.count(at(k), at(k), 0.2, 0.8);
            let mut parts = Parts::default();
            state = heard.save(&mut parts, "heard/");
            assert!(parts.into_changes().into_iter().map(|change| saved.apply([change].into())).count() <= 1);
        }
        let mut back = Heard::restore(&saved, "heard/", &state).unwrap();
        let counts = |heard: &mut Heard| (0..80).map(|k| heard.count(at(k), at(k), 0.2, 1.0)).collect::<Vec<_>>();
        let said = counts(&mut heard);
        assert!(said.contains(&AGAIN) && said.contains(&1.0));
        assert_eq!(counts(&mut back), said);
        let more = HeardState { squares: state.squares + 1, ..state };
        assert!(Heard::restore(&saved, "heard/", &more).is_err());
        let mut parts = Parts::default();
        parts.put_checked("heard/0/a", vec![0; BYTES]);
        saved.apply(parts.into_changes());
        assert_eq!(Heard::restore(&saved, "heard/", &more).unwrap_err().part, "heard/0/a");
    }
}
