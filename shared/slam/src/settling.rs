//! What of a long drive is settled: its poses are told, stay what they are, and cost no memory but for one scan of each place.
//!
//! In a building that is driven for hours a closure moves nothing that was driven long ago. So when what is not settled is as long as
//! `slam.settle_after_m`, the first half of it is made what it is in the end. Its poses are held from then on; of its scans one is kept of
//! each place and direction. When that happens depends on the way alone.

use core::f64::consts::FRAC_PI_4;
use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::closures::{PLACE_M, PLACE_SCANS};
use crate::cloud::Cloud;
use crate::matrix::{self, Matrix, ZERO};
use crate::scan::Points;
use crate::slam::Slam;

/// One scan is kept of each such square, metres, and of each eighth of a turn.
const CELL_M: f64 = 0.3;
/// So much way before what is not settled all scans are kept: its first scans are laid on them.
const LATEST_M: f64 = 10.0;
/// So many poses are told of at a time, how sure they are.
const DOUBTS: usize = 100;

/// What of a drive can't change any more, besides how many of its nodes that are.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Settled {
    /// Of the nodes before `thinned` those that have their points.
    kept: Vec<u32>,
    thinned: u32,
    /// How sure the last settled pose was: what comes after it is no surer.
    pub(crate) doubt: Matrix,
    /// How sure some of the settled poses were.
    pub(crate) doubts: Vec<(u64, Matrix)>,
}

impl Settled {
    /// The nodes before `end` that have their points, in order.
    pub(crate) fn with_points(&self, end: usize) -> impl Iterator<Item = usize> {
        let kept = self.kept.iter().map(|node| *node as usize).take_while(move |node| *node < end);
        kept.chain(self.thinned as usize..end.max(self.thinned as usize))
    }
}

impl Slam {
    /// Whether so much was driven that a part of it is to be settled.
    #[must_use]
    pub fn is_long(&self) -> bool {
        let first = self.drive.nodes.get(self.drive.graph.settled as usize);
        let way = first.zip(self.drive.nodes.last()).map(|(first, last)| last.way_m - first.way_m);
        way.is_some_and(|way_m| way_m > self.config.settle_after_m.max(4.0 * self.config.closure_after_m))
    }

    /// Settles the first half of what is not settled.
    pub fn settle(&mut self) {
        let first = self.drive.graph.settled as usize;
        let Some((begin, last)) = self.drive.nodes.get(first).zip(self.drive.nodes.last()) else { return };
        let middle_m = 0.5 * (begin.way_m + last.way_m);
        let upto = self.drive.nodes.partition_point(|node| node.way_m < middle_m);
        if upto <= first {
            return;
        }
        self.end(upto);
        let doubts = self.doubts_of(first.max(1)..upto, DOUBTS);
        let doubt = self.covariances(&[upto - 1]).pop().unwrap_or(ZERO);
        self.drive.settled.doubts.extend(doubts);
        self.drive.settled.doubt = matrix::symmetric(&doubt);
        self.thin(upto);
        let graph = &mut self.drive.graph;
        graph.settled = upto as u32;
        graph.scales_before = graph.scales;
        self.stored.edges_are_others(graph.edges.len());
        graph.edges.retain(|edge| edge.to as usize >= upto);
        self.drive.refined = Vec::new();
        self.solve();
    }

    /// Forgets what was seen before node `upto` where something else was seen from there.
    fn thin(&mut self, upto: usize) {
        let poses = &self.drive.graph.poses;
        let of = |node: usize| {
            let at = poses[node];
            let cell = |metres: f64| (metres / CELL_M).floor() as i64;
            (cell(at.x), cell(at.y), (at.theta / FRAC_PI_4).floor() as i64)
        };
        let mut seen: BTreeSet<(i64, i64, i64)> =
            self.drive.settled.kept.iter().map(|node| of(*node as usize)).collect();
        let latest_m = self.drive.nodes[upto - 1].way_m - LATEST_M;
        let end = self.drive.nodes[..upto].partition_point(|node| node.way_m < latest_m);
        for node in self.drive.settled.thinned as usize..end {
            if !self.drive.nodes[node].points.is_empty() && seen.insert(of(node)) {
                self.drive.settled.kept.push(node as u32);
            } else {
                self.drive.nodes[node].points = Points::default();
                self.stored.nodes.replace(node as u64);
            }
        }
        self.drive.settled.thinned = self.drive.settled.thinned.max(end as u32);
    }

    /// The scans about a settled node, of all passes, seen from it.
    pub(crate) fn settled_place(&self, about: usize) -> Cloud {
        let poses = &self.drive.graph.poses;
        let apart = |node: usize| (poses[node].distance_m(poses[about]), node);
        let nodes = self.drive.settled.with_points(self.drive.graph.settled as usize);
        let mut near: Vec<(f64, usize)> = nodes.map(apart).filter(|(apart_m, _)| *apart_m <= PLACE_M).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(2 * PLACE_SCANS);
        let scans = near.iter().map(|(_, node)| (poses[*node], &self.drive.nodes[*node].points));
        Cloud::of(poses[about], scans)
    }
}
