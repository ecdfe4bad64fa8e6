//! Where the robot went, in bounded memory.

use anyhow::Result;
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{Pose2, wrap_angle};
use echogrid_formats::map::PathPoint;

/// A point joins the path when the robot has moved this far …
const STEP_M: f64 = 0.05;
/// … or turned this far since the one before.
const STEP_RAD: f64 = 0.1;

/// Points that are saved as one part.
const PART: usize = 1024;

/// A point, saved: stamp, pose, trust.
type Saveable = (u64, Pose2, f64);

/// The way so far. When it has too many points every second one is dropped, and from then on they lie twice as far apart:
/// what is kept depends on the poses alone.
#[derive(Debug)]
pub(crate) struct Path {
    points: Vec<PathPoint>,
    points_max: usize,
    /// How often every second point was dropped.
    thinned: u32,
    /// The latest pose, if it is not among the points.
    latest: Option<PathPoint>,
    /// Parts that are saved and will not change; the one after them was saved, too, and may.
    saved_parts: usize,
    /// The last part that was saved.
    last_saved: usize,
}

impl Path {
    /// Nowhere yet; of at most `points_max` points.
    pub(crate) fn new(points_max: usize) -> Self {
        Self { points: Vec::new(), points_max, thinned: 0, latest: None, saved_parts: 0, last_saved: 0 }
    }

    /// The robot is here now.
    pub(crate) fn follow(&mut self, point: PathPoint) {
        if !self.points.last().is_none_or(|last| self.is_step(last.pose, point.pose)) {
            self.latest = Some(point);
            return;
        }
        self.points.push(point);
        self.latest = None;
        if self.points.len() > self.points_max {
            self.thin();
        }
    }

    /// Every point, the latest pose last.
    pub(crate) fn points(&self) -> Vec<PathPoint> {
        self.points.iter().copied().chain(self.latest).collect()
    }

    fn is_step(&self, from: Pose2, to: Pose2) -> bool {
        let times = self.apart();
        from.distance_m(to) >= times * STEP_M || wrap_angle(to.theta - from.theta).abs() >= times * STEP_RAD
    }

    /// How many times as far apart as at first the points lie: 1, 2, 4 … (exact on every machine).
    fn apart(&self) -> f64 {
        2.0_f64.powi(self.thinned.cast_signed())
    }

    fn thin(&mut self) {
        // Where the robot is stays known, whichever half the newest point is of.
        if self.points.len().is_multiple_of(2) {
            self.latest = self.points.last().copied();
        }
        let mut index = 0;
        self.points.retain(|_| {
            index += 1;
            index % 2 == 1
        });
        self.thinned += 1;
        self.saved_parts = 0;
        let (times, metres) = (self.thinned, self.apart() * STEP_M);
        tracing::info!("the path is long: every second point dropped, {times} times by now; a point per {metres} m");
    }

    pub(crate) fn save(&mut self, parts: &mut Parts) {
        let saveable = |point: &PathPoint| (point.stamp_ns, point.pose, point.trust);
        let whole = self.points.len() / PART;
        for part in self.saved_parts..=whole {
            let points = &self.points[part * PART..self.points.len().min((part + 1) * PART)];
            parts.put_value(name(part), &points.iter().map(saveable).collect::<Vec<Saveable>>());
        }
        for gone in whole + 1..=self.last_saved {
            parts.remove(name(gone));
        }
        (self.saved_parts, self.last_saved) = (whole, whole);
        parts.put_value("thinned", &self.thinned);
        parts.put_value("latest", &self.latest.as_ref().map(saveable));
    }

    pub(crate) fn restore(&mut self, saved: &Saved) -> Result<()> {
        let point = |(stamp_ns, pose, trust): Saveable| PathPoint { stamp_ns, pose, trust };
        self.points.clear();
        while saved.get(&name(self.points.len() / PART)).is_some() {
            let points: Vec<Saveable> = saved.value(&name(self.points.len() / PART))?;
            let is_last = points.len() < PART;
            self.points.extend(points.into_iter().map(point));
            if is_last {
                break;
            }
        }
        self.saved_parts = self.points.len() / PART;
        self.last_saved = self.saved_parts;
        self.thinned = saved.value("thinned")?;
        self.latest = saved.value::<Option<Saveable>>("latest")?.map(point);
        Ok(())
    }
}

fn name(part: usize) -> String {
    format!("path/{part}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Straight on, a pose every centimetre.
    fn drive(path: &mut Path, centimetres: core::ops::Range<u32>) {
        for at in centimetres {
            let pose = Pose2::new(f64::from(at) / 100.0, 0.0, 0.0);
            path.follow(PathPoint { stamp_ns: u64::from(at), pose, trust: 1.0 });
        }
    }

    #[test]
    fn a_long_way_keeps_its_ends_and_evenly_fewer_points_between() {
        let mut path = Path::new(1000);
        drive(&mut path, 0..4_900);
        // A point per 5 cm, or 6 where rounding has it.
        assert!((4_900 / 6..=980 + 1).contains(&path.points().len()), "{}", path.points().len());
        drive(&mut path, 4_900..100_003);
        let points = path.points();
        assert!((400..=1001).contains(&points.len()), "{}", points.len());
        assert_eq!((points[0].stamp_ns, points[points.len() - 1].stamp_ns), (0, 100_002));
        let steps = points.windows(2).map(|two| two[0].pose.distance_m(two[1].pose));
        let longest = steps.fold(0.0, f64::max);
        assert!(longest < 2.5, "1 km in at most 1000 points, half of them at worst: {longest}");
    }

    #[test]
    fn the_newest_pose_is_never_dropped() {
        let mut path = Path::new(16);
        for at in 0..2_000 {
            drive(&mut path, at..at + 1);
            assert_eq!(path.points().last().unwrap().stamp_ns, u64::from(at));
        }
    }

    #[test]
    fn a_path_that_is_restored_anywhere_goes_on_as_if_nothing_had_been() {
        let mut whole = Path::new(3000);
        drive(&mut whole, 0..60_000);
        let mut saved = Saved::default();
        let mut path = Path::new(3000);
        // Stops before, between and after the times it is thinned.
        for (from, to) in [(0, 7), (7, 14_000), (14_000, 15_001), (15_001, 31_000), (31_000, 60_000)] {
            drive(&mut path, from..to);
            let mut parts = Parts::default();
            path.save(&mut parts);
            saved.apply(parts.into_changes());
            path = Path::new(3000);
            path.restore(&saved).unwrap();
        }
        assert_eq!(path.points(), whole.points());
        assert_eq!(path.thinned, whole.thinned);
        assert!(whole.thinned > 0);
    }

    #[test]
    fn what_was_thinned_is_not_stored_any_more() {
        let mut saved = Saved::default();
        let mut path = Path::new(3000);
        for hectometre in 0..10 {
            drive(&mut path, hectometre * 10_000..(hectometre + 1) * 10_000);
            let mut parts = Parts::default();
            path.save(&mut parts);
            saved.apply(parts.into_changes());
            let beyond = name(path.points.len() / PART + 1);
            assert!(saved.get(&beyond).is_none(), "{beyond} after {hectometre}");
        }
    }
}
