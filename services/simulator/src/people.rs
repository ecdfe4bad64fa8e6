//! People on their ways.

use echogrid_core::Person;
use echogrid_core::noise::Draws;

/// Somebody keeps so far from the robot, beyond both their radii, metres.
const KEEP_AWAY_M: f64 = 0.1;

/// A disc that rays meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disc {
    pub(crate) centre: [f64; 2],
    pub(crate) radius_m: f64,
}

impl Disc {
    /// Where a ray (`direction` of length 1) meets it, if it does.
    pub(crate) fn distance_m(&self, origin: [f64; 2], direction: [f64; 2]) -> Option<f64> {
        let [x, y] = [self.centre[0] - origin[0], self.centre[1] - origin[1]];
        let (ahead, aside) = (x * direction[0] + y * direction[1], x * direction[1] - y * direction[0]);
        let half_chord_m2 = self.radius_m * self.radius_m - aside * aside;
        if half_chord_m2 < 0.0 {
            return None;
        }
        let half_chord_m = half_chord_m2.sqrt();
        (ahead > -half_chord_m).then_some((ahead - half_chord_m).max(0.0))
    }
}

/// Where a ray first meets one of them.
pub(crate) fn nearest_m(people: &[Disc], origin: [f64; 2], direction: [f64; 2]) -> f64 {
    people.iter().filter_map(|disc| disc.distance_m(origin, direction)).fold(f64::INFINITY, f64::min)
}

/// All who walk about.
#[derive(Debug, Clone)]
pub(crate) struct People {
    people: Vec<Walker>,
    /// Where they are now.
    discs: Vec<Disc>,
}

#[derive(Debug, Clone)]
struct Walker {
    person: Person,
    length_m: f64,
    along_m: f64,
    /// Back again.
    back: bool,
}

impl People {
    /// Each somewhere on their way.
    pub(crate) fn new(people: &[Person], seed: u64) -> Self {
        let mut draws = Draws::new(seed, "people");
        let people: Vec<Walker> = people
            .iter()
            .map(|person| {
                let length_m = person.length_m();
                Walker {
                    person: person.clone(),
                    length_m,
                    along_m: draws.uniform() * length_m,
                    back: draws.uniform() < 0.5,
                }
            })
            .collect();
        let discs = people.iter().map(Walker::disc).collect();
        Self { people, discs }
    }

    pub(crate) fn discs(&self) -> &[Disc] {
        &self.discs
    }

    /// They walk on; nobody walks into the robot: who would turns round.
    pub(crate) fn step(&mut self, dt_s: f64, robot: [f64; 2], robot_radius_m: f64) {
        for (walker, disc) in self.people.iter_mut().zip(&mut self.discs) {
            let before = (walker.along_m, walker.back);
            walker.walk(dt_s);
            let next = walker.disc();
            let distance_m = |from: [f64; 2]| libm::hypot(from[0] - robot[0], from[1] - robot[1]);
            let keep_m = robot_radius_m + next.radius_m + KEEP_AWAY_M;
            if distance_m(next.centre) < keep_m && distance_m(next.centre) < distance_m(disc.centre) {
                (walker.along_m, walker.back) = (before.0, !before.1);
            } else {
                *disc = next;
            }
        }
    }
}

impl Walker {
    fn walk(&mut self, dt_s: f64) {
        let step_m = self.person.speed_mps * dt_s;
        self.along_m += if self.back { -step_m } else { step_m };
        if self.along_m > self.length_m {
            (self.along_m, self.back) = ((2.0 * self.length_m - self.along_m).max(0.0), true);
        } else if self.along_m < 0.0 {
            (self.along_m, self.back) = ((-self.along_m).min(self.length_m), false);
        }
    }

    fn disc(&self) -> Disc {
        Disc { centre: self.person.at(self.along_m), radius_m: self.person.radius_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one() -> People {
        let person = Person { path: vec![[0.0, 0.0], [4.0, 0.0]], speed_mps: 1.0, radius_m: 0.25 };
        People::new(&[person], 1)
    }

    #[test]
    fn to_and_fro() {
        let mut people = one();
        let mut xs = Vec::new();
        for _ in 0..1000 {
            people.step(0.02, [90.0, 0.0], 0.4);
            xs.push(people.discs()[0].centre[0]);
        }
        assert!(xs.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.02 + 1e-12));
        assert!(xs.iter().copied().fold(f64::INFINITY, f64::min) < 0.03);
        assert!(xs.iter().copied().fold(0.0, f64::max) > 3.97);
    }

    #[test]
    fn nobody_walks_into_the_robot() {
        let mut people = one();
        for _ in 0..2000 {
            people.step(0.02, [4.0, 0.1], 0.4);
            let [x, y] = people.discs()[0].centre;
            assert!(libm::hypot(x - 4.0, y - 0.1) > 0.4 + 0.25, "{x}");
        }
    }

    #[test]
    fn rays_meet_the_near_side() {
        let disc = Disc { centre: [2.0, 0.1], radius_m: 0.5 };
        assert!((disc.distance_m([0.0, 0.1], [1.0, 0.0]).unwrap() - 1.5).abs() < 1e-12);
        assert_eq!(disc.distance_m([0.0, 0.7], [1.0, 0.0]), None);
        assert_eq!(disc.distance_m([3.0, 0.1], [1.0, 0.0]), None);
        assert_eq!(disc.distance_m([2.1, 0.1], [1.0, 0.0]), Some(0.0));
    }
}
