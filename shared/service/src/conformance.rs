//! What every sensor promises, checked: for the tests of whoever writes one.
//!
//! ```
//! use anyhow::Result;
//! use echogrid_service::{Sensor, conformance};
//! use echogrid_topics::{Message, Topic};
//! # use echogrid_core::{Echo, Pose2, Reading, Robot, SensorKind};
//! # use echogrid_topics::RawOdometry;
//!
//! struct MySensor(u64);
//!
//! impl Sensor for MySensor {
//!     // …
//! #     fn outputs(&self) -> &'static [Topic] {
//! #         &[Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan]
//! #     }
//! #     fn next(&mut self) -> Result<Option<(u64, Message)>> {
//! #         let odometry = RawOdometry { odom_from_base: Pose2::IDENTITY, v_mps: 0.0, w_radps: 0.0 };
//! #         let sonar = echogrid_core::Sensor {
//! #             kind: SensorKind::Sonar, base_from_sensor: Pose2::IDENTITY, first_transducer: 0, transducers: 1,
//! #             first_bearing_rad: 0.0, bearing_step_rad: 0.0, aperture_rad: 0.5, range_min_m: 0.1, range_max_m: 5.0,
//! #             range_error_ratio: 0.01,
//! #         };
//! #         let robot = Robot { name: "one".into(), sensors: vec![sonar], ..Robot::default() };
//! #         let reading = Reading { transducer: 0, echo: Echo::Hit { range_m: 1.0 }, offset_ns: 0 };
//! #         self.0 += 1;
//! #         Ok(match self.0 {
//! #             1 => Some((0, Message::Robot(robot))),
//! #             2 => Some((0, Message::Odometry(odometry))),
//! #             3 => Some((5, Message::Scan(vec![reading]))),
//! #             4 => Some((9, Message::Odometry(odometry))),
//! #             _ => None,
//! #         })
//! #     }
//! }
//!
//! conformance::check(|| Ok(MySensor(0))).unwrap();
//! ```

use anyhow::{Context, Result, bail, ensure};
use echogrid_core::{Echo, Pose2, Robot};
use echogrid_topics::{Message, Topic};

use crate::Sensor;

/// A sensor that has not ended after so many messages is taken for one that never does.
pub const MESSAGES_MAX: u64 = 10_000_000;
/// After the end it is asked so often whether it is.
const ASKED_AGAIN: usize = 3;
/// A reading is taken no longer than this before or after its scan, nanoseconds.
const OFFSET_MAX_NS: i32 = 1_000_000_000;

/// What a sensor gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Given {
    /// Messages in all.
    pub messages: u64,
    /// The number of odometry poses.
    pub odometry: u64,
    /// The number of scans.
    pub scans: u64,
    /// Readings in all scans.
    pub readings: u64,
    /// Readings that are echoes.
    pub hits: u64,
}

/// Makes a sensor twice, plays both to their ends, and checks what every sensor promises:
///
/// * the robot comes first, once, and only topics of [`Sensor::outputs`] come at all;
/// * stamps never run backwards, and at equal stamps odometry comes before scans;
/// * a sensor that tells the truth tells it before each odometry pose, with the same stamp, and nowhere else;
/// * poses are finite; every reading is of a transducer that the robot has, each once in a scan, its range finite, above 0
///   and not beyond the sensor's, its time within a second of its scan's;
/// * odometry begins before the first reading and goes on past the last one, so that every reading has a pose;
/// * the end stays the end, and [`Sensor::total`], if it says anything, is how many messages came;
/// * both give the same, to the bit.
///
/// A sensor that a robot or a network stands behind can't keep the last promise, nor end by itself: give it a recording.
///
/// # Errors
/// The first promise that is broken, in words, with the number of the message.
pub fn check<S: Sensor>(mut make: impl FnMut() -> Result<S>) -> Result<Given> {
    let mut first = make().context("making the sensor")?;
    let mut second = make().context("making the sensor for the second time")?;
    let total = first.total();
    let outputs = first.outputs();
    ensure!(outputs.first() == Some(&Topic::RobotDescription), "the first of its outputs is not robot/description");
    let mut checked = Checked::default();
    loop {
        let number = checked.given.messages + 1;
        let (one, other) = (first.next(), second.next());
        let one = one.with_context(|| format!("message {number}"))?;
        let other = other.with_context(|| format!("message {number}, for the second time"))?;
        // Exact: every number is written so that it can be told from any other.
        let same = format!("{one:?}") == format!("{other:?}");
        ensure!(same, "message {number} differs when the sensor is made anew: {one:?}, then {other:?}");
        let Some((stamp_ns, message)) = one else { break };
        ensure!(number <= MESSAGES_MAX, "it has not ended after {MESSAGES_MAX} messages");
        let topic = message.topic();
        ensure!(outputs.contains(&topic), "message {number} is of {}, which is none of its outputs", topic.name());
        checked.message(stamp_ns, &message).with_context(|| format!("message {number}, at {stamp_ns} ns"))?;
    }
    for _ in 0..ASKED_AGAIN {
        ensure!(first.next()?.is_none(), "it went on after its end");
    }
    checked.end()?;
    if let Some(total) = total {
        let messages = checked.given.messages;
        ensure!(total == messages, "it said that there would be {total} messages, and gave {messages}");
    }
    Ok(checked.given)
}

#[derive(Default)]
struct Checked {
    given: Given,
    robot: Option<Robot>,
    stamp_ns: u64,
    /// The stamp of the last message is that of a scan.
    after_scan: bool,
    first_odometry_ns: Option<u64>,
    last_odometry_ns: u64,
    last_reading_ns: i128,
    /// Stamp of the true pose whose odometry has not come yet.
    truth_ns: Option<u64>,
    true_poses: u64,
}

impl Checked {
    fn message(&mut self, stamp_ns: u64, message: &Message) -> Result<()> {
        let before_ns = self.stamp_ns;
        ensure!(stamp_ns >= before_ns, "its stamp runs backwards: the one before is {before_ns} ns");
        if stamp_ns > before_ns {
            self.after_scan = false;
        }
        self.stamp_ns = stamp_ns;
        self.given.messages += 1;
        let is_robot = matches!(message, Message::Robot(_));
        ensure!(is_robot || self.robot.is_some(), "it comes before the robot's description");
        let truth_ns = self.truth_ns.take();
        let of_truth = matches!(message, Message::Odometry(_)) && truth_ns == Some(stamp_ns);
        ensure!(truth_ns.is_none() || of_truth, "it follows a true pose, and is not the odometry of the same stamp");
        match message {
            Message::TruePose(truth) => {
                ensure!(truth.map_from_base.is_none_or(Pose2::is_finite), "it is not finite: {truth:?}");
                ensure!(self.true_poses == self.given.odometry, "there was odometry without a true pose before it");
                self.true_poses += 1;
                self.truth_ns = Some(stamp_ns);
            }
            Message::Robot(robot) => {
                ensure!(self.robot.is_none(), "the robot is described twice");
                ensure!(robot.transducer_count() > 0, "the robot has no transducer");
                self.robot = Some(robot.clone());
            }
            Message::Odometry(odometry) => {
                ensure!(!self.after_scan, "odometry comes after a scan of the same stamp");
                let Pose2 { x, y, theta } = odometry.odom_from_base;
                let all = [x, y, theta, odometry.v_mps, odometry.w_radps];
                ensure!(all.into_iter().all(f64::is_finite), "its pose or speed is not finite: {odometry:?}");
                self.first_odometry_ns.get_or_insert(stamp_ns);
                self.last_odometry_ns = stamp_ns;
                self.given.odometry += 1;
                let told = self.true_poses == 0 || self.true_poses == self.given.odometry;
                ensure!(told, "there is no true pose before it");
            }
            Message::Scan(readings) => {
                self.after_scan = true;
                self.given.scans += 1;
                ensure!(!readings.is_empty(), "it has no reading");
                let mut seen = Vec::new();
                for reading in readings {
                    seen.push(reading.transducer);
                    self.reading(stamp_ns, reading).with_context(|| format!("{reading:?}"))?;
                }
                seen.sort_unstable();
                ensure!(seen.windows(2).all(|pair| pair[0] != pair[1]), "a transducer is read twice in one scan");
            }
            _ => {}
        }
        Ok(())
    }

    fn reading(&mut self, stamp_ns: u64, reading: &echogrid_core::Reading) -> Result<()> {
        let transducer = self.robot.as_ref().and_then(|robot| robot.transducer(reading.transducer));
        let transducer = transducer.context("the robot has no such transducer")?;
        ensure!(reading.offset_ns.abs() <= OFFSET_MAX_NS, "its time is not that of its scan");
        let at_ns = i128::from(stamp_ns) + i128::from(reading.offset_ns);
        let Some(first_ns) = self.first_odometry_ns else { bail!("there is no odometry before it") };
        ensure!(at_ns >= i128::from(first_ns), "it was taken before the first odometry, at {first_ns} ns");
        self.last_reading_ns = self.last_reading_ns.max(at_ns);
        self.given.readings += 1;
        if let Echo::Hit { range_m } = reading.echo {
            self.given.hits += 1;
            let max_m = transducer.range_max_m;
            ensure!(range_m > 0.0 && range_m <= max_m, "its range is not within 0 to {max_m} m");
        }
        Ok(())
    }

    fn end(&self) -> Result<()> {
        ensure!(self.robot.is_some(), "it never described the robot");
        ensure!(self.given.scans > 0, "it gave no scan");
        let (last_ns, reading_ns) = (self.last_odometry_ns, self.last_reading_ns);
        ensure!(
            i128::from(last_ns) >= reading_ns,
            "odometry ends at {last_ns} ns, before the last reading, at {reading_ns} ns: that has no pose"
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::{Reading, Sensor as RangeSensor, SensorKind};
    use echogrid_topics::{RawOdometry, TruePose};

    use super::*;

    /// Messages as they are given.
    struct Scripted {
        messages: std::vec::IntoIter<(u64, Message)>,
        total: Option<u64>,
    }

    impl Sensor for Scripted {
        fn outputs(&self) -> &'static [Topic] {
            &[Topic::RobotDescription, Topic::TruePose, Topic::OdometryRaw, Topic::RangeScan]
        }

        fn next(&mut self) -> Result<Option<(u64, Message)>> {
            Ok(self.messages.next())
        }

        fn total(&self) -> Option<u64> {
            self.total
        }
    }

    fn robot() -> Message {
        let sonar = |first_transducer| RangeSensor {
            kind: SensorKind::Sonar,
            base_from_sensor: Pose2::IDENTITY,
            first_transducer,
            transducers: 1,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.0,
            aperture_rad: 0.5,
            range_min_m: 0.1,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        };
        Message::Robot(Robot { name: "two".into(), sensors: vec![sonar(0), sonar(1)], ..Robot::default() })
    }

    fn odometry(x: f64) -> Message {
        Message::Odometry(RawOdometry { odom_from_base: Pose2 { x, ..Pose2::IDENTITY }, v_mps: 0.0, w_radps: 0.0 })
    }

    fn scan(transducers: &[u16], range_m: f64, offset_ns: i32) -> Message {
        let echo = Echo::Hit { range_m };
        Message::Scan(transducers.iter().map(|&transducer| Reading { transducer, echo, offset_ns }).collect())
    }

    fn good() -> Vec<(u64, Message)> {
        vec![(0, robot()), (10, odometry(0.0)), (20, odometry(0.1)), (20, scan(&[0, 1], 5.0, -10)), (30, odometry(0.2))]
    }

    #[test]
    fn a_good_one_passes() {
        let given = check(|| Ok(Scripted { messages: good().into_iter(), total: Some(5) })).unwrap();
        assert_eq!(given, Given { messages: 5, odometry: 3, scans: 1, readings: 2, hits: 2 });
    }

    #[test]
    fn every_promise_can_be_broken() {
        let told = |messages: Vec<(u64, Message)>, total| {
            let error = check(|| Ok(Scripted { messages: messages.clone().into_iter(), total })).unwrap_err();
            crate::in_words(&error)
        };
        let check = |at: usize, change: Option<(u64, Message)>, expected: &str| {
            let mut messages = good();
            messages.splice(at..=at, change);
            let told = told(messages, None);
            assert!(told.contains(expected), "{told}\n  wanted: {expected}");
        };
        check(0, None, "message 1, at 10 ns: it comes before the robot's description");
        check(4, Some((30, robot())), "the robot is described twice");
        check(2, Some((9, odometry(0.1))), "message 3, at 9 ns: its stamp runs backwards: the one before is 10 ns");
        check(4, Some((20, odometry(0.2))), "odometry comes after a scan of the same stamp");
        check(2, Some((20, odometry(f64::NAN))), "not finite");
        check(3, Some((20, scan(&[0, 2], 1.0, 0))), "transducer: 2");
        check(3, Some((20, scan(&[1, 1], 1.0, 0))), "read twice");
        check(3, Some((20, scan(&[], 1.0, 0))), "it has no reading");
        check(3, Some((20, scan(&[0], 5.1, 0))), "its range is not within 0 to 5 m");
        check(3, Some((20, scan(&[0], 0.0, 0))), "its range is not within");
        check(3, Some((20, scan(&[0], 1.0, -11))), "it was taken before the first odometry, at 10 ns");
        check(3, Some((20, scan(&[0], 1.0, 2_000_000_000))), "its time is not that of its scan");
        check(3, Some((20, scan(&[0], 1.0, 11))), "odometry ends at 30 ns, before the last reading, at 31 ns");
        check(3, None, "it gave no scan");
        let estimate = echogrid_core::Estimate::certain(Pose2::IDENTITY);
        let health = Message::Estimate(echogrid_topics::PoseEstimate::plain(estimate, 1.0, 0.0));
        check(4, Some((30, health)), "odometry/estimate, which is none of its outputs");
        assert!(told(good(), Some(6)).contains("it said that there would be 6 messages, and gave 5"));
        assert!(told(Vec::new(), None).contains("it never described the robot"));
    }

    #[test]
    fn the_truth_comes_before_its_odometry_or_not_at_all() {
        let truth = |stamp_ns| (stamp_ns, Message::TruePose(TruePose { map_from_base: Some(Pose2::IDENTITY) }));
        let told = |places: &[(usize, u64)]| {
            let mut messages = good();
            places.iter().for_each(|(at, stamp_ns)| messages.insert(*at, truth(*stamp_ns)));
            check(|| Ok(Scripted { messages: messages.clone().into_iter(), total: None }))
                .map_err(|e| crate::in_words(&e))
        };
        assert_eq!(told(&[(1, 10), (3, 20), (6, 30)]).unwrap().messages, 8);
        assert!(told(&[(1, 10), (3, 15)]).unwrap_err().contains("not the odometry of the same stamp"));
        assert!(told(&[(1, 10)]).unwrap_err().contains("there is no true pose before it"));
        assert!(told(&[(2, 20)]).unwrap_err().contains("odometry without a true pose"));
    }

    #[test]
    fn what_differs_each_time_is_noticed() {
        let mut made = 0.0;
        let error = super::check(|| {
            made += 1.0;
            let mut messages = good();
            messages[4] = (30, odometry(made));
            Ok(Scripted { messages: messages.into_iter(), total: None })
        });
        assert!(error.unwrap_err().to_string().starts_with("message 5 differs when the sensor is made anew"));
    }

    #[test]
    fn the_end_must_stay_the_end() {
        struct Risen(Scripted, u32);
        impl Sensor for Risen {
            fn outputs(&self) -> &'static [Topic] {
                self.0.outputs()
            }
            fn next(&mut self) -> Result<Option<(u64, Message)>> {
                let next = self.0.next()?;
                self.1 += u32::from(next.is_none());
                Ok(if self.1 == 3 { Some((99, odometry(0.0))) } else { next })
            }
        }
        let make = || Ok(Risen(Scripted { messages: good().into_iter(), total: None }, 0));
        assert_eq!(super::check(make).unwrap_err().to_string(), "it went on after its end");
    }
}
