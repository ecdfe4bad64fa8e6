//! The way of the robot as the page draws it, in bounded memory.

use echogrid_core::{Pose2, wrap_angle};

/// A point joins the trail when the robot has moved this far since the last one …
const STEP_M: f64 = 0.05;
/// … or turned this far.
const STEP_RAD: f64 = 0.2;

/// A point of the trail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TrailPoint {
    /// On the sensor's clock, nanoseconds.
    pub(crate) stamp_ns: u64,
    /// The robot in the map frame.
    pub(crate) pose: Pose2,
    /// The weight of a nominal reading then, 0 to 1.
    pub(crate) trust: f64,
}

/// The way so far. Points are only appended within a generation: a viewer that has the first *n* needs those after them.
/// When there are too many, every second one is dropped, and a new generation begins.
#[derive(Debug)]
pub(crate) struct Trail {
    points: Vec<TrailPoint>,
    points_max: usize,
    generation: u32,
    /// How many times as far apart as at first points lie now.
    apart: f64,
}

impl Trail {
    pub(crate) fn new(points_max: usize) -> Self {
        Self { points: Vec::new(), points_max, generation: 0, apart: 1.0 }
    }

    /// The robot is here now; whether that is a new point.
    pub(crate) fn follow(&mut self, point: TrailPoint) -> bool {
        if let Some(last) = self.points.last() {
            let step_m = last.pose.distance_m(point.pose);
            let step_rad = wrap_angle(point.pose.theta - last.pose.theta).abs();
            if step_m < self.apart * STEP_M && step_rad < self.apart * STEP_RAD {
                return false;
            }
        }
        self.points.push(point);
        if self.points.len() > self.points_max {
            let mut index = 0_usize;
            // The first and every second one after it; the newest is appended again by the next pose.
            self.points.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.apart *= 2.0;
            self.generation += 1;
        }
        true
    }

    pub(crate) fn generation(&self) -> u32 {
        self.generation
    }

    pub(crate) fn points(&self) -> &[TrailPoint] {
        &self.points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(centimetres: u32) -> TrailPoint {
        let pose = Pose2::new(f64::from(centimetres) / 100.0, 0.0, 0.0);
        TrailPoint { stamp_ns: u64::from(centimetres), pose, trust: 1.0 }
    }

    #[test]
    fn a_long_way_keeps_its_start_and_no_gap_grows_beyond_what_the_thinning_makes_of_it() {
        let mut trail = Trail::new(1000);
        for centimetres in 0..100_000 {
            trail.follow(at(centimetres));
        }
        let points = trail.points();
        assert!((400..=1000).contains(&points.len()), "{}", points.len());
        assert_eq!(points[0].stamp_ns, 0);
        let longest = points.windows(2).map(|two| two[0].pose.distance_m(two[1].pose)).fold(0.0, f64::max);
        assert!(longest < 4.0, "1 km in at most 1000 points: {longest}");
        assert!(points.last().is_some_and(|last| last.pose.x > 996.0));
    }

    #[test]
    fn within_a_generation_points_are_only_appended() {
        let mut trail = Trail::new(100);
        let (mut generation, mut seen) = (0, Vec::new());
        for centimetres in 0..5_000 {
            trail.follow(at(centimetres));
            if trail.generation() == generation {
                assert_eq!(&trail.points()[..seen.len()], &seen[..]);
            }
            (generation, seen) = (trail.generation(), trail.points().to_vec());
        }
        assert!(generation > 0);
    }
}
