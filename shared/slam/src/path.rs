//! The corrected path: a pose for every stamp at which the odometry said something.

use echogrid_core::{Increment, Pose2};

use crate::slam::Drive;

/// What a turn counts as when a correction is spread over the way, metres per radian.
const TURN_M: f64 = 0.3;

impl Drive {
    /// The corrected poses at these stamps, `odom`: where the odometry said the robot was, in order of stamps. Between two nodes the
    /// odometry's steps count, with what they are off by at the second node spread over the way. (Where nothing moved: over nothing.)
    #[must_use]
    pub fn path(&self, odom: &[(u64, Pose2)]) -> Vec<(u64, Pose2)> {
        let mut path = Vec::with_capacity(odom.len());
        if self.nodes.is_empty() {
            path.extend_from_slice(odom);
            return path;
        }
        let mut next = 0;
        // Before the first node, and after each.
        let ends = odom.partition_point(|(stamp_ns, _)| *stamp_ns < self.nodes[0].stamp_ns);
        let first = self.graph.poses[0] * self.nodes[0].odom_from_base.inverse();
        path.extend(odom[..ends].iter().map(|(stamp_ns, pose)| (*stamp_ns, first * *pose)));
        let mut begin = ends;
        while next < self.nodes.len() {
            let node = &self.nodes[next];
            let after = self.nodes.get(next + 1);
            let end =
                after.map_or(odom.len(), |after| odom.partition_point(|(stamp_ns, _)| *stamp_ns < after.stamp_ns));
            let stretch = &odom[begin..end.max(begin)];
            path.extend(self.stretch(next, node.odom_from_base, stretch));
            (begin, next) = (end.max(begin), next + 1);
        }
        path
    }

    /// The poses between a node and the next.
    fn stretch<'a>(
        &'a self,
        node: usize,
        from: Pose2,
        odom: &'a [(u64, Pose2)],
    ) -> impl Iterator<Item = (u64, Pose2)> + 'a {
        let back = from.inverse();
        let after = self.nodes.get(node + 1);
        let off = after.map_or(Pose2::IDENTITY, |after| {
            let made = self.graph.poses[node].inverse() * self.graph.poses[node + 1];
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
            (*stamp_ns, self.graph.poses[node] * (back * *pose) * spread)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::Points;
    use crate::slam::Node;

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
