//! What came of it, for people and programs.

use crate::graph::Solver;
use crate::known::Located;
use crate::report::{By, Evidence, Report};

use super::closures::Closure;
use super::slam::SonarSlam;

impl SonarSlam<'_> {
    /// What it did. `way_m`: the corrected way.
    #[must_use]
    pub fn report(&self, way_m: f64) -> Report {
        let last = self.nodes.len().checked_sub(1).filter(|_| self.is_corrected());
        let covariance = last.and_then(|last| Solver::new(&self.graph).covariances(&self.graph, [last]).pop());
        Report {
            nodes: self.nodes.len() as u64,
            lost: 0,
            way_m,
            places_tried: self.tries,
            ambiguous: self.unrecognised.ambiguous,
            unrecognised: Some(self.unrecognised),
            instead_of_lidar: None,
            scales: self.graph.scales,
            end_sigma: covariance.map(|c| [c[0][0].sqrt(), c[1][1].sqrt(), c[2][2].sqrt()]),
            closures: self.closures.iter().map(|closure| self.evidence(closure)).collect(),
        }
    }

    fn evidence(&self, closure: &Closure) -> Evidence {
        let Located { pose, covariance: c, evidence } = closure.located;
        let off = closure.believed.inverse() * pose;
        // The greater of the eigenvalues of the position.
        let root = libm::hypot(c[0][0] - c[1][1], 2.0 * c[0][1]);
        let worst = 0.5 * (c[0][0] + c[1][1] + root);
        let (from, to) = (&self.nodes[closure.from], &self.nodes[closure.to]);
        Evidence {
            from: closure.from as u32,
            to: closure.to as u32,
            from_ns: from.stamp_ns,
            to_ns: to.stamp_ns,
            measured: [pose.x, pose.y, pose.theta],
            standing: closure.standing,
            loop_m: to.way_m - from.way_m,
            off: (libm::hypot(off.x, off.y), off.theta),
            by: By::Echoes { evidence_nat: evidence, sigma: (worst.sqrt(), c[2][2].sqrt()) },
            slides: false,
            support: closure.support,
        }
    }

    /// How many closures count.
    #[must_use]
    pub fn applied(&self) -> usize {
        self.closures.iter().filter(|closure| closure.standing.counts()).count()
    }
}
