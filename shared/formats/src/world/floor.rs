//! Floors drawn by lot, `floor-1`, `floor-2` …: a corridor with rooms on both sides, doors, furniture, slanted walls. To judge maps in
//! worlds that nobody tuned anything on.

use std::fmt::Write as _;

use echogrid_core::noise::Draws;

/// What the names begin with.
const NAME: &str = "floor-";
/// Walls between rooms are at least so far apart, metres.
const ROOM_M: (f64, f64) = (3.0, 6.5);
/// Furniture stays so far from doors and goals, metres.
const CLEAR_M: f64 = 0.8;

/// The number of a floor, if `name` is the name of one.
pub(super) fn number(name: &str) -> Option<u64> {
    name.strip_prefix(NAME)?.parse().ok()
}

/// A floor as a world of our own would be written.
pub(super) fn plan(number: u64) -> String {
    Floor { draws: Draws::new(number, "floor"), text: String::new() }.plan(number)
}

struct Floor {
    draws: Draws,
    text: String,
}

/// From low to high corner, metres.
#[derive(Debug, Clone, Copy)]
struct Rectangle {
    low: [f64; 2],
    high: [f64; 2],
}

impl Rectangle {
    /// Whether a disc around a point meets it.
    fn meets(&self, [x, y]: [f64; 2], radius_m: f64) -> bool {
        let nearest = [x.clamp(self.low[0], self.high[0]), y.clamp(self.low[1], self.high[1])];
        libm::hypot(nearest[0] - x, nearest[1] - y) < radius_m
    }
}

impl Floor {
    /// In whole centimetres.
    fn between(&mut self, (low, high): (f64, f64)) -> f64 {
        (100.0 * (low + (high - low) * self.draws.uniform())).round() / 100.0
    }

    fn chance(&mut self, share: f64) -> bool {
        self.draws.uniform() < share
    }

    fn wall(&mut self, from: [f64; 2], to: [f64; 2]) {
        let [[a, b], [c, d]] = [from, to];
        let _ = write!(self.text, "[[wall]]\nfrom = [{a:.2}, {b:.2}]\nto = [{c:.2}, {d:.2}]\n");
    }

    fn goal(&mut self, name: &str, [x, y]: [f64; 2]) {
        let _ = write!(self.text, "[[goal]]\nname = \"{name}\"\nat = [{x:.2}, {y:.2}]\n");
    }

    fn plan(mut self, number: u64) -> String {
        let (width, corridor) = (self.between((14.0, 22.0)), self.between((1.6, 2.4)));
        let (below, above) = (self.between((3.0, 5.5)), self.between((3.0, 5.5)));
        let depth = below + corridor + above;
        let middle = below + 0.5 * corridor;
        let _ =
            write!(self.text, "# Floor {number}, drawn by lot.\n[home]\nat = [1.00, {middle:.2}]\nheading_deg = 0\n");
        for (from, to) in [
            ([0.0, 0.0], [width, 0.0]),
            ([width, 0.0], [width, depth]),
            ([width, depth], [0.0, depth]),
            ([0.0, depth], [0.0, 0.0]),
            ([0.0, below], [width, below]),
            ([0.0, below + corridor], [width, below + corridor]),
        ] {
            self.wall(from, to);
        }
        let lower = self.rooms(width, below, 0.0, "lower");
        self.goal("corridor, far end", [width - 1.0, middle]);
        let mut upper = self.rooms(width, below + corridor, depth, "upper");
        upper.reverse();
        for (name, at) in lower.into_iter().chain(upper) {
            self.goal(&name, at);
        }
        self.goal("corridor, home", [1.0, middle]);
        self.text
    }

    /// Rooms side by side between the corridor's wall at `inner` and the outside at `outer`; where to go in each.
    fn rooms(&mut self, width: f64, inner: f64, outer: f64, side: &str) -> Vec<(String, [f64; 2])> {
        let (mut goals, mut from) = (Vec::new(), 0.0);
        while from < width {
            let mut to = from + self.between(ROOM_M);
            if width - to < ROOM_M.0 {
                to = width;
            } else {
                self.wall([to, inner], [to, outer]);
            }
            let goal = self.room((from, to), inner, outer);
            goals.push((format!("{side} room {}", goals.len() + 1), goal));
            from = to;
        }
        goals
    }

    fn room(&mut self, (from, to): (f64, f64), inner: f64, outer: f64) -> [f64; 2] {
        let opening = self.between((1.0, 1.3));
        let door = [self.between((from + 0.8, to - 0.8)), inner];
        let _ = write!(self.text, "[[door]]\nat = [{:.2}, {inner:.2}]\nwidth = {opening:.2}\n", door[0]);
        let inwards = (outer - inner).signum();
        let deep = (outer - inner).abs();
        let goal = [door[0], inner + inwards * self.between((0.45, 0.6)) * deep];
        let (low_y, high_y) = (inner.min(outer), inner.max(outer));
        if self.chance(0.4) {
            // A corner cut off, where sound is mirrored away.
            let cut = self.between((0.5, 1.0));
            let (x, towards) = if door[0] - from > to - door[0] { (from, 1.0) } else { (to, -1.0) };
            self.wall([x + towards * cut, outer], [x, outer - inwards * cut]);
        }
        let furniture = (4.0 * self.draws.uniform()) as usize;
        for _ in 0..furniture {
            let size = [self.between((0.3, 1.4)), self.between((0.3, 0.9))];
            let at = [self.between((from, to - size[0])), self.between((low_y, high_y - size[1]))];
            let piece = Rectangle { low: at, high: [at[0] + size[0], at[1] + size[1]] };
            let way = (0..=10).map(|step| f64::from(step) / 10.0);
            let is_clear = way
                .map(|share| [door[0], door[1] + share * (goal[1] - door[1])])
                .all(|place| !piece.meets(place, CLEAR_M));
            if is_clear {
                let ([x, y], [w, h]) = (at, size);
                let _ = write!(self.text, "[[box]]\nat = [{x:.2}, {y:.2}]\nsize = [{w:.2}, {h:.2}]\n");
            }
        }
        goal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::find;

    #[test]
    fn every_number_makes_a_world_with_places_to_go() {
        for number in 0..200 {
            let world = find(format!("floor-{number}").as_ref()).unwrap();
            let places = &world.parts().places;
            assert!(places.home.is_some() && places.goals.len() >= 6, "{number}");
            for goal in &places.goals {
                let clearance_m = world.clearance_m([goal.pose.x, goal.pose.y], 1.0);
                assert!(clearance_m > 0.6, "floor-{number}, {}: {clearance_m}", goal.name);
            }
        }
    }

    #[test]
    fn a_number_is_one_floor() {
        assert_eq!(plan(7), plan(7));
        assert_ne!(plan(7), plan(8));
        assert_eq!((number("floor-12"), number("floor-x"), number("flor-1")), (Some(12), None, None));
    }
}
