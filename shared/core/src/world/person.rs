//! People in a world: discs that walk to and fro.

use super::{COORDINATE_MAX_M, WorldError};

/// Somebody who walks along a path to its end, and back.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    /// The path, metres in the map frame; two points or more.
    pub path: Vec<[f64; 2]>,
    /// The speed of walking, m/s.
    pub speed_mps: f64,
    /// The radius of the disc that stands for the person, metres.
    pub radius_m: f64,
}

impl Person {
    /// Length of the path, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.path.windows(2).map(|step| length_m(step[0], step[1])).sum()
    }

    /// The place on the path at `along_m` from its beginning; kept to its ends.
    #[must_use]
    pub fn at(&self, along_m: f64) -> [f64; 2] {
        let mut left_m = along_m;
        for step in self.path.windows(2) {
            let (from, to) = (step[0], step[1]);
            let length_m = length_m(from, to);
            if left_m <= length_m && length_m > 0.0 {
                let part = (left_m / length_m).max(0.0);
                return [from[0] + part * (to[0] - from[0]), from[1] + part * (to[1] - from[1])];
            }
            left_m -= length_m;
        }
        self.path.last().copied().unwrap_or_default()
    }

    pub(super) fn validate(&self, named: impl Fn(&str) -> String) -> Result<(), WorldError> {
        let check = |holds: bool, what: &str, value: f64, expected| {
            if holds { Ok(()) } else { Err(WorldError::Value { what: named(what), value, expected }) }
        };
        for value in self.path.iter().flatten() {
            check(value.abs() <= COORDINATE_MAX_M, "a coordinate", *value, "metres within ± 100000")?;
        }
        check(self.path.len() >= 2, "the number of points", self.path.len() as f64, "two or more")?;
        check(self.length_m() > 0.0, "the length of the path", self.length_m(), "metres above 0")?;
        check((0.0..=10.0).contains(&self.speed_mps), "the speed", self.speed_mps, "metres per second from 0 to 10")?;
        check((0.01..=2.0).contains(&self.radius_m), "the radius", self.radius_m, "metres from 0.01 to 2")
    }
}

fn length_m(from: [f64; 2], to: [f64; 2]) -> f64 {
    libm::hypot(to[0] - from[0], to[1] - from[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn along_a_path_with_a_bend() {
        let person =
            Person { path: vec![[0.0, 0.0], [2.0, 0.0], [2.0, 0.0], [2.0, 1.0]], speed_mps: 1.0, radius_m: 0.2 };
        assert_eq!(person.length_m(), 3.0);
        for (along, expected) in
            [(-1.0, [0.0, 0.0]), (0.5, [0.5, 0.0]), (2.5, [2.0, 0.5]), (3.0, [2.0, 1.0]), (9.0, [2.0, 1.0])]
        {
            assert_eq!(person.at(along), expected, "{along}");
        }
    }

    #[test]
    fn who_can_not_be() {
        let good = Person { path: vec![[0.0, 0.0], [2.0, 0.0]], speed_mps: 1.0, radius_m: 0.2 };
        let check = |person: Person, expected: &str| {
            let told = person.validate(|what| format!("{what} of person 1")).unwrap_err().to_string();
            assert!(told.contains(expected), "{told}");
        };
        assert!(good.validate(str::to_owned).is_ok());
        check(Person { path: vec![[0.0, 0.0]], ..good.clone() }, "the number of points of person 1 is 1");
        check(Person { path: vec![[0.0, 0.0]; 2], ..good.clone() }, "the length of the path of person 1 is 0");
        check(Person { path: vec![[0.0, 0.0], [f64::NAN, 0.0]], ..good.clone() }, "a coordinate of person 1 is NaN");
        check(Person { speed_mps: -1.0, ..good.clone() }, "the speed of person 1 is -1");
        check(Person { radius_m: 0.0, ..good }, "the radius of person 1 is 0; expected metres from 0.01 to 2");
    }
}
