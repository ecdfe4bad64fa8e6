//! From the messages of a recording to those of a log.

use std::sync::Arc;

use echogrid_core::Pose2;

use super::container::Channel;
use super::message::{Head, LaserScan, Placed, Range, Type};
use super::plan::{OdometryFrom, RecordingPlan, Stream, TruthFrom};
use super::wire::Fields;
use crate::log::carmen::cone;
use crate::log::carmen::message::{Described, Message, READINGS_MAX, ScanKind, ScanLine, Shape};
use crate::log::fault::{FaultKind, Refusal};

/// A scan takes no longer, seconds: else its time from beam to beam is none.
const SWEEP_MAX_S: f64 = 1.0;
/// Beyond this a number is no bearing, radians.
const BEARING_MAX_RAD: f64 = 100.0;

/// Gives messages their meaning; what they say of the frames is remembered.
pub(crate) struct Translator {
    plan: Arc<RecordingPlan>,
    /// The latest pose of the odometry that `tf` told: several who publish it repeat each other.
    last: Option<(Option<u64>, Pose2)>,
    /// Where the odometry's frame stands in the map, as told last.
    map_from_odom: Option<Pose2>,
}

/// Takes what a message says, or why it says nothing.
pub(crate) type TakeMessage<'a> = dyn FnMut(Result<Message<'static>, Refusal>) + 'a;

impl Translator {
    pub(crate) fn new(plan: Arc<RecordingPlan>) -> Self {
        Self { plan, last: None, map_from_odom: None }
    }

    pub(crate) fn message(&mut self, channel: &Channel, log_ns: u64, data: &[u8], take: &mut TakeMessage<'_>) {
        let Some(kind) = Type::of(channel) else { return };
        let read = self.read(kind, channel, log_ns, data, take);
        if read.is_none() {
            let what = format!("{} of {}, {} bytes", channel.topic, channel.datatype, data.len());
            take(Err(Refusal::new(FaultKind::MessageDamaged, what)));
        }
    }

    /// None where the message is not what its type says.
    fn read(
        &mut self,
        kind: Type,
        channel: &Channel,
        log_ns: u64,
        data: &[u8],
        take: &mut TakeMessage<'_>,
    ) -> Option<()> {
        let plan = Arc::clone(&self.plan);
        let topic = channel.topic.as_str();
        let fields = || Fields::new(data, channel.encoding);
        if let Some(TruthFrom::Topic(truth)) = &plan.truth
            && truth == topic
        {
            let placed = match kind {
                Type::Odometry => Placed::odometry(fields()?)?,
                Type::Transform => Placed::transform(fields()?)?,
                _ => Placed::pose(fields()?)?,
            };
            let map_from_base = placed.transform?.planar();
            take(Ok(Message::TruePose { map_from_base, stamp_ns: self.stamp(&placed.head, log_ns) }));
            return Some(());
        }
        match kind {
            Type::LaserScan if plan.has(topic) => {
                let scan = LaserScan::read(fields()?)?;
                if let Some(stream) = plan.stream(topic, &scan.head.frame) {
                    take(self.laser(stream, scan, log_ns));
                }
            }
            Type::Range if plan.has(topic) => {
                let range = Range::read(fields()?)?;
                if let Some(stream) = plan.stream(topic, &range.head.frame) {
                    take(self.range(stream, &range, log_ns));
                }
            }
            Type::Odometry if plan.odometry == OdometryFrom::Topic(topic.to_owned()) => {
                let placed = Placed::odometry(fields()?)?;
                let pose = placed.transform?.planar();
                self.odometry(pose, &placed, log_ns, take);
            }
            Type::Transforms => self.transforms(&Placed::transforms(fields()?)?, log_ns, take)?,
            _ => {}
        }
        Some(())
    }

    fn stamp(&self, head: &Head, log_ns: u64) -> Option<u64> {
        if self.plan.by_arrival { Some(log_ns) } else { head.stamp_ns }
    }

    fn odometry(&self, odom_from_base: Pose2, placed: &Placed, log_ns: u64, take: &mut TakeMessage<'_>) {
        let stamp_ns = self.stamp(&placed.head, log_ns);
        let Placed { v_mps, w_radps, .. } = *placed;
        take(Ok(Message::Odometry { odom_from_base, v_mps, w_radps, stamp_ns }));
        if let Some(map_from_odom) = self.map_from_odom {
            take(Ok(Message::TruePose { map_from_base: map_from_odom * odom_from_base, stamp_ns }));
        }
    }

    fn transforms(&mut self, transforms: &[Placed], log_ns: u64, take: &mut TakeMessage<'_>) -> Option<()> {
        let plan = Arc::clone(&self.plan);
        for placed in transforms {
            let stands = |parent: &str, child: &str| placed.head.frame == parent && placed.child == child;
            if let OdometryFrom::Transforms { odom, base } = &plan.odometry
                && stands(odom, base)
            {
                let pose = placed.transform?.planar();
                let now = (self.stamp(&placed.head, log_ns), pose);
                if self.last.replace(now) != Some(now) {
                    self.odometry(pose, placed, log_ns, take);
                }
            }
            if let Some(TruthFrom::Transforms { map, child, is_of_odom }) = &plan.truth
                && stands(map, child)
            {
                let pose = placed.transform?.planar();
                if *is_of_odom {
                    self.map_from_odom = Some(pose);
                } else {
                    take(Ok(Message::TruePose { map_from_base: pose, stamp_ns: self.stamp(&placed.head, log_ns) }));
                }
            }
        }
        Some(())
    }

    fn laser(&self, stream: &Stream, scan: LaserScan, log_ns: u64) -> Result<Message<'static>, Refusal> {
        let count = scan.ranges.len();
        if count == 0 || count > READINGS_MAX {
            return Err(Refusal::new(FaultKind::BadCount, format!("{count} ranges")));
        }
        let (first, step) = (scan.first_bearing_rad, scan.bearing_step_rad);
        let are_bearings =
            first.abs() <= BEARING_MAX_RAD && step.abs() <= BEARING_MAX_RAD && (step != 0.0 || count == 1);
        if !are_bearings {
            return Err(Refusal::new(FaultKind::AbsurdPose, format!("bearings from {first} by {step}")));
        }
        let side = if stream.is_mirrored { -1.0 } else { 1.0 };
        let sweep_s = scan.beam_step_s * (count - 1) as f64;
        // Who states a scan's period can't take longer for its beams.
        let longest_s = if scan.period_s > 0.0 { scan.period_s * 1.05 } else { SWEEP_MAX_S };
        let beam_step_s = if sweep_s >= 0.0 && sweep_s <= longest_s.min(SWEEP_MAX_S) { scan.beam_step_s } else { 0.0 };
        Ok(Message::Scan(ScanLine {
            kind: ScanKind::Stream(stream.number),
            shape: Shape::Fan {
                first_bearing_rad: side * first,
                bearing_step_rad: side * step,
                range_max_m: Some(scan.range_max_m),
            },
            stamp_ns: self.stamp(&scan.head, log_ns),
            described: Some(Described {
                base_from_sensor: stream.base_from_sensor,
                range_min_m: scan.range_min_m,
                range_max_m: scan.range_max_m,
                reading_step_ns: beam_step_s * 1e9,
            }),
            ranges: scan.ranges,
            carried: None,
            oddities: Vec::new(),
        }))
    }

    fn range(&self, stream: &Stream, range: &Range, log_ns: u64) -> Result<Message<'static>, Refusal> {
        let stated = if range.aperture_rad.is_finite() { range.aperture_rad } else { 0.0 };
        let (aperture_rad, oddities) = cone(stated)?;
        Ok(Message::Scan(ScanLine {
            kind: ScanKind::Stream(stream.number),
            shape: Shape::Ring { aperture_rad, base_from_sonar: vec![stream.base_from_sensor] },
            ranges: vec![range.range_m],
            carried: None,
            stamp_ns: self.stamp(&range.head, log_ns),
            described: Some(Described {
                base_from_sensor: stream.base_from_sensor,
                range_min_m: range.range_min_m,
                range_max_m: range.range_max_m,
                reading_step_ns: 0.0,
            }),
            oddities,
        }))
    }
}
