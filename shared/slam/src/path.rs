//! The corrected path: a pose for every stamp at which the odometry said something.

use echogrid_core::{Increment, Pose2};

use crate::slam::{Drive, Node};

/// What a turn counts as when a correction is spread over the way, metres per radian.
const TURN_M: f64 = 0.3;

/// A pose that is known, and where the odometry said that the robot was then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot {
    /// Nanoseconds.
    pub stamp_ns: u64,
    /// By the odometry.
    pub odom_from_base: Pose2,
    /// The pose of the base, as it is known.
    pub pose: Pose2,
}

/// The corrected poses at these stamps, `odom`: where the odometry said the robot was, in order of stamps. Between two knots the
/// odometry's steps count, with what they are off by at the second knot spread over the way. (Where nothing moved: over nothing.)
#[must_use]
pub fn through(knots: &[Knot], odom: &[(u64, Pose2)]) -> Vec<(u64, Pose2)> {
    let mut path = Vec::with_capacity(odom.len());
    let Some(first) = knots.first() else {
        path.extend_from_slice(odom);
        return path;
    };
    // Before the first knot, and after each.
    let ends = odom.partition_point(|(stamp_ns, _)| *stamp_ns < first.stamp_ns);
    let map_from_odom = first.pose * first.odom_from_base.inverse();
    path.extend(odom[..ends].iter().map(|(stamp_ns, pose)| (*stamp_ns, map_from_odom * *pose)));
    let mut begin = ends;
    for (index, knot) in knots.iter().enumerate() {
        let after = knots.get(index + 1);
        let end = after.map_or(odom.len(), |after| odom.partition_point(|(stamp_ns, _)| *stamp_ns < after.stamp_ns));
        let end = end.max(begin);
        path.extend(stretch(knot, after, &odom[begin..end]));
        begin = end;
    }
    path
}

/// The poses between a knot and the next.
fn stretch<'a>(
    knot: &'a Knot,
    after: Option<&'a Knot>,
    odom: &'a [(u64, Pose2)],
) -> impl Iterator<Item = (u64, Pose2)> + 'a {
    let (from, back) = (knot.odom_from_base, knot.odom_from_base.inverse());
    let off = after.map_or(Pose2::IDENTITY, |after| {
        let made = knot.pose.inverse() * after.pose;
        (back * after.odom_from_base).inverse() * made
    });
    let length = |a: Pose2, b: Pose2| {
        let step = Increment::between(a, b);
        step.length_m() + TURN_M * step.turn_rad.abs()
    };
    let way: Vec<f64> = odom
        .iter()
        .scan((from, 0.0), |(last, sum), (_, pose)| {
            *sum += length(*last, *pose);
            *last = *pose;
            Some(*sum)
        })
        .collect();
    let last = odom.last().map_or(from, |(_, pose)| *pose);
    let whole = way.last().copied().unwrap_or(0.0) + after.map_or(0.0, |after| length(last, after.odom_from_base));
    odom.iter().zip(way).map(move |((stamp_ns, pose), sum)| {
        let share = if whole > 0.0 { sum / whole } else { 0.0 };
        let spread = Pose2::new(share * off.x, share * off.y, share * off.theta);
        (*stamp_ns, knot.pose * (back * *pose) * spread)
    })
}

impl Drive {
    /// The corrected poses at these stamps, by the poses of its nodes.
    #[must_use]
    pub fn path(&self, odom: &[(u64, Pose2)]) -> Vec<(u64, Pose2)> {
        let knot = |(node, pose): (&Node, &Pose2)| Knot {
            stamp_ns: node.stamp_ns,
            odom_from_base: node.odom_from_base,
            pose: *pose,
        };
        let knots: Vec<Knot> = self.nodes.iter().zip(&self.graph.poses).map(knot).collect();
        through(&knots, odom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::Points;

    fn node(stamp_ns: u64, x: f64) -> Node {
        Node { stamp_ns, odom_from_base: Pose2::new(x, 0.0, 0.0), points: Points::default(), way_m: x }
    }

    #[test]
    fn corrections_are_spread_over_the_way() {
        let mut drive = Drive { nodes: vec![node(10, 0.0), node(20, 1.0)], ..Drive::default() };
        drive.graph.poses = vec![Pose2::new(5.0, 0.0, 0.0), Pose2::new(6.2, 0.1, 0.0)];
        let odom = [(5, -0.5), (10, 0.0), (15, 0.5), (16, 0.5), (20, 1.0), (30, 2.0)]
            .map(|(stamp_ns, x)| (stamp_ns, Pose2::new(x, 0.0, 0.0)));
        let path = drive.path(&odom);
        let expected = [(4.5, 0.0), (5.0, 0.0), (5.6, 0.05), (5.6, 0.05), (6.2, 0.1), (7.2, 0.1)];
        assert_eq!(path.len(), odom.len());
        for ((stamp_ns, pose), ((odom_ns, _), (x, y))) in path.iter().zip(odom.iter().zip(expected)) {
            assert_eq!(stamp_ns, odom_ns);
            assert!(pose.distance_m(Pose2::new(x, y, 0.0)) < 1e-9, "{pose:?} {x} {y}");
        }
    }
}
