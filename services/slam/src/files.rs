//! What is written beside the map: the path, the graph, and the closures with their evidence.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use echogrid_core::Pose2;
use echogrid_formats::localization::{Covariance, write_covariances, write_tum};
use echogrid_formats::write_whole;
use echogrid_slam::Drive;
use echogrid_slam::graph::{Edge, Graph};
use echogrid_slam::report::Report;

/// The corrected path: `t x y z qx qy qz qw`, a pose for every stamp of odometry and scans.
pub const PATH_FILE: &str = "path.tum";
/// The pose graph, in the format of g2o.
pub const GRAPH_FILE: &str = "graph.g2o";
/// Every closure with its evidence, as JSON.
pub const CLOSURES_FILE: &str = "closures.json";
/// How sure poses of the path are: `t xx xy xh yy yh hh`.
pub const COVARIANCE_FILE: &str = "path.covariance.txt";
/// All of them.
pub const FILES: [&str; 4] = [PATH_FILE, GRAPH_FILE, CLOSURES_FILE, COVARIANCE_FILE];

/// What came of a drive.
pub(crate) struct Written<'a> {
    pub(crate) path: &'a [(u64, Pose2)],
    pub(crate) covariances: Vec<(u64, Covariance)>,
    pub(crate) graph: &'a str,
    pub(crate) report: &'a Report,
}

/// Writes all of them, each whole or not at all.
pub(crate) fn write(folder: &Path, what: &Written<'_>) -> Result<()> {
    let Written { path, covariances, graph, report } = what;
    std::fs::create_dir_all(folder).with_context(|| format!("making the folder {}", folder.display()))?;
    write_tum(&folder.join(PATH_FILE), path.iter().copied())?;
    write_covariances(&folder.join(COVARIANCE_FILE), covariances.iter().copied())?;
    write_whole(&folder.join(GRAPH_FILE), graph.as_bytes())?;
    let report = serde_json::to_string_pretty(report).context("the closures as JSON")?;
    write_whole(&folder.join(CLOSURES_FILE), (report + "\n").as_bytes())?;
    Ok(())
}

/// The graph of lidars as it was solved last.
pub(crate) fn g2o_of(drive: &Drive) -> String {
    g2o(&drive.graph, if drive.refined.is_empty() { &drive.graph.edges } else { &drive.refined })
}

/// A graph as text (`VERTEX_SE2`, `EDGE_SE2`; Kümmerle et al. 2011).
pub(crate) fn g2o(graph: &Graph, edges: &[Edge]) -> String {
    let mut text = String::new();
    for (node, Pose2 { x, y, theta }) in graph.poses.iter().enumerate() {
        let _ = writeln!(text, "VERTEX_SE2 {node} {x:.9} {y:.9} {theta:.9}");
    }
    let _ = writeln!(text, "FIX 0");
    for edge in edges {
        let Pose2 { x, y, theta } = edge.expected(graph.scales);
        let [[a, b, c], [_, d, e], [_, _, f]] = edge.information;
        let (from, to) = (edge.from, edge.to);
        let _ = writeln!(text, "EDGE_SE2 {from} {to} {x:.9} {y:.9} {theta:.9} {a:e} {b:e} {c:e} {d:e} {e:e} {f:e}");
    }
    text
}
