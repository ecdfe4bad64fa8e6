//! A drive as parts of a state, of which only those are written again that changed.
//!
//! | part | what |
//! |---|---|
//! | `drive` | counts, scales, what is settled |
//! | `nodes/n`, `poses/n` | of the n-th 64 nodes: what was seen; where |
//! | `edges/n`, `closures/n` | the n-th 256 |

use std::collections::VecDeque;

use echogrid_core::Chunks;
use echogrid_core::parts::{Parts, Saved, SavedError};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::graph::Graph;
use crate::settling::Settled;
use crate::slam::{Drive, Slam};

const DRIVE: &str = "drive";
const NODES: (&str, u64) = ("nodes/", 64);
const POSES: (&str, u64) = ("poses/", 64);
const EDGES: (&str, u64) = ("edges/", 256);
const CLOSURES: (&str, u64) = ("closures/", 256);

/// What of a drive is stored, and what of that is to be stored anew.
#[derive(Debug, Clone)]
pub(crate) struct Stored {
    pub(crate) nodes: Chunks,
    pub(crate) closures: Chunks,
    poses: Chunks,
    edges: Chunks,
    /// Edges that are gone: their places are not used again.
    edges_gone: u64,
    /// Whether poses that are not settled are others.
    is_solved: bool,
    /// From this pose on.
    solved_from: u32,
}

impl Default for Stored {
    fn default() -> Self {
        let [nodes, poses, edges, closures] = [NODES, POSES, EDGES, CLOSURES].map(|(_, size)| Chunks::new(size));
        Self { nodes, closures, poses, edges, edges_gone: 0, is_solved: false, solved_from: 0 }
    }
}

impl Stored {
    /// Poses that are not settled are others.
    pub(crate) fn solved(&mut self) {
        self.is_solved = true;
    }

    /// The edges, so many until now, are others.
    pub(crate) fn edges_are_others(&mut self, count: usize) {
        self.edges_gone += count as u64;
    }
}

/// What is saved besides lists.
#[derive(Debug, Serialize, Deserialize)]
struct State {
    scales: [f64; 2],
    scales_before: [f64; 2],
    scale_sigma: f64,
    settled: Settled,
    settled_nodes: u32,
    solved_from: u32,
    /// Nodes, edges that are gone, edges with those, closures.
    counts: [u64; 4],
    seen: [u64; 3],
    speed: [f64; 3],
    searched_at_m: f64,
    solved: u64,
}

impl Slam {
    /// Puts what changed since this was called last into `parts`; at first all there is.
    pub fn save(&mut self, parts: &mut Parts) {
        let Self { drive, stored, .. } = self;
        if std::mem::take(&mut stored.is_solved) {
            let solved = u64::from(stored.solved_from)..drive.graph.poses.len() as u64;
            solved
                .step_by(POSES.1 as usize)
                .chain(drive.graph.poses.len().checked_sub(1).map(|last| last as u64))
                .for_each(|place| stored.poses.replace(place));
        }
        stored.solved_from = drive.graph.settled;
        save_list(&mut stored.nodes, parts, NODES, 0, &mut drive.nodes);
        save_list(&mut stored.poses, parts, POSES, 0, &mut drive.graph.poses);
        save_list(&mut stored.edges, parts, EDGES, stored.edges_gone, &mut drive.graph.edges);
        save_list(&mut stored.closures, parts, CLOSURES, 0, &mut drive.closures);
        let edges = stored.edges_gone + drive.graph.edges.len() as u64;
        let Graph { scales, scales_before, scale_sigma, settled, .. } = drive.graph;
        let state = State {
            scales,
            scales_before,
            scale_sigma,
            settled: drive.settled.clone(),
            settled_nodes: settled,
            solved_from: stored.solved_from,
            counts: [drive.nodes.len() as u64, stored.edges_gone, edges, drive.closures.len() as u64],
            seen: [drive.lost, drive.tries, drive.ambiguous],
            speed: drive.speed,
            searched_at_m: drive.searched_at_m,
            solved: drive.solved as u64,
        };
        parts.put_value(DRIVE, &state);
    }

    /// Goes on where the one was that was saved; this one is new and of the same configuration.
    ///
    /// # Errors
    /// A part is missing, or damaged; then this one is as it was.
    pub fn restore(&mut self, saved: &Saved) -> Result<(), SavedError> {
        let state: State = saved.value(DRIVE)?;
        let [nodes_count, edges_gone, edges_end, closures_count] = state.counts;
        let (of_nodes, nodes) = list(saved, NODES, 0, nodes_count)?;
        let (of_poses, poses) = list(saved, POSES, 0, nodes_count)?;
        let (of_edges, edges) = list(saved, EDGES, edges_gone, edges_end)?;
        let (of_closures, closures) = list(saved, CLOSURES, 0, closures_count)?;
        let State { scales, scales_before, scale_sigma, settled_nodes, .. } = state;
        let graph =
            Graph { poses, scales, scales_before, scale_sigma, settled: settled_nodes, edges, anchors: Vec::new() };
        let [lost, tries, ambiguous] = state.seen;
        self.drive = Drive {
            graph,
            nodes,
            closures,
            refined: Vec::new(),
            settled: state.settled,
            lost,
            tries,
            ambiguous,
            speed: state.speed,
            searched_at_m: state.searched_at_m,
            solved: state.solved as usize,
        };
        self.stored = Stored {
            nodes: of_nodes,
            closures: of_closures,
            poses: of_poses,
            edges: of_edges,
            edges_gone,
            is_solved: false,
            solved_from: state.solved_from,
        };
        Ok(())
    }
}

fn save_list<T: Serialize>(
    chunks: &mut Chunks,
    parts: &mut Parts,
    (prefix, _): (&str, u64),
    begin: u64,
    list: &mut Vec<T>,
) {
    // Neither way copies anything.
    let entries = VecDeque::from(std::mem::take(list));
    chunks.save(parts, prefix, begin, &entries);
    *list = Vec::from(entries);
}

fn list<T: DeserializeOwned>(
    saved: &Saved,
    (prefix, size): (&str, u64),
    begin: u64,
    end: u64,
) -> Result<(Chunks, Vec<T>), SavedError> {
    let (chunks, list) = Chunks::restore(size, saved, prefix, begin, end)?;
    Ok((chunks, Vec::from(list)))
}
