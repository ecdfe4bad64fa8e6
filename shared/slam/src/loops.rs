//! How far apart two nodes are by what is known: the shortest way through the graph, on which closures are no way at all.
//! What is settled lies where it lies: from one of its nodes to another is no way.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::graph::Kind;
use crate::slam::Slam;

/// What a closure counts as, metres.
const CLOSURE_M: f64 = 0.5;

impl Slam {
    /// Of every node: the shortest way from `from`, in millimetres.
    pub(crate) fn ways_mm(&self, from: usize) -> Vec<u64> {
        let (count, settled) = (self.drive.nodes.len(), self.drive.graph.settled as usize);
        // The settled nodes count as one, the last of them.
        let first = settled.saturating_sub(1);
        let place = |node: u32| (node as usize).max(first);
        let mut jumps: Vec<Vec<usize>> = vec![Vec::new(); count];
        for edge in self.drive.graph.edges.iter().filter(|edge| matches!(edge.kind, Kind::Closure(_))) {
            jumps[place(edge.from)].push(place(edge.to));
            jumps[place(edge.to)].push(place(edge.from));
        }
        let mm = |metres: f64| (metres * 1e3) as u64;
        let mut ways = vec![u64::MAX; count];
        let mut open = BinaryHeap::from([Reverse((0, from))]);
        while let Some(Reverse((way, node))) = open.pop() {
            if way >= ways[node] {
                continue;
            }
            ways[node] = way;
            let mut push = |next: usize, length_m: f64| {
                if way + mm(length_m) < ways[next] {
                    open.push(Reverse((way + mm(length_m), next)));
                }
            };
            if node > first {
                push(node - 1, self.drive.nodes[node].way_m - self.drive.nodes[node - 1].way_m);
            }
            if node + 1 < count {
                push(node + 1, self.drive.nodes[node + 1].way_m - self.drive.nodes[node].way_m);
            }
            for jump in &jumps[node] {
                push(*jump, CLOSURE_M);
            }
        }
        let of_settled = ways.get(first).copied().unwrap_or(u64::MAX);
        ways.iter_mut().take(first).for_each(|way| *way = of_settled);
        ways
    }
}
