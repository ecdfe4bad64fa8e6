//! Where the robot was, from what is measured of surveyed landmarks.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use echogrid_core::landmarks::triangulate;
use echogrid_core::{Fix, Pose2, Sighting, wrap_angle};
use echogrid_formats::localization::{Landmarks as Surveyed, Sightings, TimedSighting};
use echogrid_topics::LocalizationRequest;

use crate::answer::{Answer, NO_TRUTH, draws, nanoseconds};
use crate::config::LocalizerConfig;
use crate::truth::{Known, Truth};

/// Why sightings that would do later don't at the start.
const TWO_PLACES: &str = "two places fit the sightings, and nothing says yet which it is (odometry.start, or --start X Y THETA, says \
                          where the drive begins)";

/// Surveyed landmarks, and how they are measured.
#[derive(Debug)]
pub(crate) struct Landmarks {
    surveyed: Surveyed,
    /// None: measured from where the robot really is.
    recorded: Option<Sightings>,
    config: LocalizerConfig,
}

impl Landmarks {
    pub(crate) fn read(config: &LocalizerConfig) -> Result<Self> {
        let surveyed = Surveyed::read(&config.landmarks).context("localizer.landmarks")?;
        let is_recorded = !config.sightings.as_os_str().is_empty();
        let recorded = is_recorded.then(|| Sightings::read(&config.sightings, &surveyed)).transpose();
        let recorded = recorded.context("localizer.sightings")?;
        if let Some(moved) = recorded.as_ref().map(Sightings::moved).filter(|moved| *moved > 0) {
            tracing::info!(rows = moved, "rows of the sightings were out of order");
        }
        Ok(Self { surveyed, recorded, config: config.clone() })
    }

    pub(crate) fn answer(&self, stamp_ns: u64, request: &LocalizationRequest, truth: &Truth) -> Answer {
        let sightings = match &self.recorded {
            Some(recorded) => self.recall(recorded, stamp_ns),
            None => match truth.at(stamp_ns) {
                Known::NotYet => return Answer::NotYet,
                Known::Never => return Answer::Unknown(NO_TRUTH.to_owned()),
                Known::Pose(pose) => self.measure(pose, request.id),
            },
        };
        match triangulate(&sightings, request.estimate.estimate.pose) {
            // Where the map lies is not known: the guess is in another frame.
            Ok(found) if found.guess_decided && request.estimate.unplaced => Answer::Unknown(TWO_PLACES.to_owned()),
            Ok(found) => Answer::Fix(Fix {
                pose: found.pose,
                covariance: found.covariance,
                position_known: true,
                heading_known: found.heading_known,
            }),
            Err(error) => Answer::Unknown(error.to_string()),
        }
    }

    /// What a sensor at `pose` measures of the landmarks in sight; the same request draws the same errors.
    fn measure(&self, pose: Pose2, request: u64) -> Vec<Sighting> {
        let LocalizerConfig { measure, range_sigma_m, bearing_sigma_rad, sight_m, seed, .. } = self.config;
        let base_from_map = pose.inverse();
        let sighting = |(index, at): (usize, [f64; 2])| {
            let [x, y] = base_from_map.transform(at);
            let range_m = libm::hypot(x, y);
            let (range, bearing) = draws(seed, request, u16::try_from(index).unwrap_or(u16::MAX));
            (range_m <= sight_m).then(|| Sighting {
                landmark: at,
                range_m: measure.ranges().then(|| (range_m + range_sigma_m * range).max(0.0)),
                bearing_rad: measure.bearings().then(|| wrap_angle(libm::atan2(y, x) + bearing_sigma_rad * bearing)),
                range_sigma_m,
                bearing_sigma_rad,
            })
        };
        self.surveyed.all().iter().map(|landmark| landmark.at).enumerate().filter_map(sighting).collect()
    }

    /// What was measured around `stamp_ns`: of each landmark the range and the bearing that are nearest in time, as the robot
    /// may have driven on between two of them.
    fn recall(&self, recorded: &Sightings, stamp_ns: u64) -> Vec<Sighting> {
        let LocalizerConfig { measure, range_sigma_m, bearing_sigma_rad, .. } = self.config;
        let mut near: Vec<&TimedSighting> =
            recorded.near(stamp_ns, nanoseconds(self.config.sightings_within_s)).iter().collect();
        near.sort_by_key(|sighting| sighting.stamp_ns.abs_diff(stamp_ns));
        let mut of: BTreeMap<usize, Sighting> = BTreeMap::new();
        for timed in near {
            let nothing =
                Sighting { landmark: timed.at, range_m: None, bearing_rad: None, range_sigma_m, bearing_sigma_rad };
            let sighting = of.entry(timed.landmark).or_insert(nothing);
            sighting.range_m = sighting.range_m.or(timed.range_m.filter(|_| measure.ranges()));
            sighting.bearing_rad = sighting.bearing_rad.or(timed.bearing_rad.filter(|_| measure.bearings()));
        }
        of.into_values().filter(|sighting| sighting.range_m.is_some() || sighting.bearing_rad.is_some()).collect()
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::Estimate;
    use echogrid_core::localization::Reason;
    use echogrid_topics::PoseEstimate;

    use super::*;
    use crate::config::Measure;

    const SECOND: u64 = 1_000_000_000;
    const MARKS: &str = "[[landmark]]\nname = \"a\"\nat = [4, 0]\n[[landmark]]\nname = \"b\"\nat = [0, 5]\n\
        [[landmark]]\nname = \"c\"\nat = [-3, -3]\n[[landmark]]\nname = \"far\"\nat = [30, 0]\n";

    fn landmarks(sightings: Option<&str>, change: impl FnOnce(&mut LocalizerConfig)) -> Landmarks {
        let folder = tempfile::tempdir().unwrap();
        let mut config = LocalizerConfig { landmarks: folder.path().join("marks.toml"), ..LocalizerConfig::default() };
        std::fs::write(&config.landmarks, MARKS).unwrap();
        if let Some(text) = sightings {
            config.sightings = folder.path().join("seen.txt");
            std::fs::write(&config.sightings, text).unwrap();
        }
        change(&mut config);
        Landmarks::read(&config).unwrap()
    }

    fn request(id: u64) -> LocalizationRequest {
        let estimate = Estimate::certain(Pose2::new(0.3, -0.2, 0.1));
        let estimate = PoseEstimate { degraded: true, hold: true, ..PoseEstimate::plain(estimate, 0.1, 1.0) };
        LocalizationRequest { id, estimate, reason: Reason::Degraded }
    }

    fn truth() -> Truth {
        let mut truth = Truth::default();
        truth.push(SECOND, Some(Pose2::new(0.5, 0.5, 0.4)));
        truth.push(2 * SECOND, None);
        truth
    }

    fn fix(answer: Answer) -> Fix {
        match answer {
            Answer::Fix(fix) => fix,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn measured_from_where_the_robot_is() {
        let landmarks = landmarks(None, |_| {});
        assert_eq!(landmarks.measure(Pose2::IDENTITY, 1).len(), 3, "one is out of sight");
        let truth = truth();
        let first = fix(landmarks.answer(SECOND, &request(1), &truth));
        assert_eq!(first, fix(landmarks.answer(SECOND, &request(1), &truth)), "the same request draws the same");
        assert_ne!(first, fix(landmarks.answer(SECOND, &request(2), &truth)));
        // Hundreds of answers err as their covariances promise: the mean of the squared error over its variance is 1.
        let mut squares = [0.0; 3];
        for id in 1..=500 {
            let fix = fix(landmarks.answer(SECOND, &request(id), &truth));
            assert!(fix.validate().is_ok() && fix.position_known && fix.heading_known);
            let errors = [fix.pose.x - 0.5, fix.pose.y - 0.5, wrap_angle(fix.pose.theta - 0.4)];
            for (axis, error) in errors.into_iter().enumerate() {
                squares[axis] += error * error / fix.covariance[(axis, axis)] / 500.0;
            }
        }
        // Five standard errors of a variance over 500 draws: 5 √(2 / 500).
        assert!(squares.iter().all(|square| (square - 1.0).abs() < 0.32), "{squares:?}");
        assert_eq!(landmarks.answer(3 * SECOND, &request(1), &truth), Answer::NotYet);
        assert_eq!(landmarks.answer(2 * SECOND, &request(1), &truth), Answer::Unknown(NO_TRUTH.to_owned()));
    }

    #[test]
    fn ranges_tell_the_position_only_and_bearings_both() {
        let ranges = landmarks(None, |config| config.measure = Measure::Range);
        let ranged = fix(ranges.answer(SECOND, &request(1), &truth()));
        assert!(ranged.position_known && !ranged.heading_known && ranged.validate().is_ok(), "{ranged:?}");
        assert!(ranged.pose.distance_m(Pose2::new(0.5, 0.5, 0.0)) < 0.4, "{ranged:?}");
        let bearings = landmarks(None, |config| config.measure = Measure::Bearing);
        let borne = fix(bearings.answer(SECOND, &request(1), &truth()));
        assert!(borne.heading_known && borne.pose.distance_m(Pose2::new(0.5, 0.5, 0.0)) < 0.4, "{borne:?}");
    }

    #[test]
    fn too_few_in_sight_is_no_fix_and_says_why() {
        let landmarks = landmarks(None, |config| config.sight_m = 4.0);
        let answer = landmarks.answer(SECOND, &request(1), &truth());
        let Answer::Unknown(why) = answer else { panic!("{answer:?}") };
        assert!(why.contains("1 range and 1 bearing to different landmarks are too few"), "{why}");
    }

    #[test]
    fn recorded_sightings_are_the_nearest_in_time_and_need_no_truth() {
        // At the origin, straight ahead: what was seen at 9.9 s is nearer to 10 s than what was at 9.7 s.
        let text = "9.7 a 4.4 0.1\n9.9 a 4 -\n10.2 a - 0\n10 b 5 1.570796\n10.1 c 4.242641 -2.356194\n10.6 b 9 3\n";
        let seen = landmarks(Some(text), |_| {});
        let nobody = Truth::default();
        let found = fix(seen.answer(10 * SECOND, &request(1), &nobody));
        assert!(found.pose.distance_m(Pose2::IDENTITY) < 1e-5 && found.pose.theta.abs() < 1e-5, "{found:?}");
        assert!(matches!(seen.answer(12 * SECOND, &request(1), &nobody), Answer::Unknown(_)));
        let ranges = landmarks(Some(text), |config| config.measure = Measure::Range);
        assert!(!fix(ranges.answer(10 * SECOND, &request(1), &nobody)).heading_known);
    }
}
