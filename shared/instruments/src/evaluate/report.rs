//! What an evaluation came to, as tables.

use std::fmt::Write as _;

use echogrid_judge::Quality;
use serde::Serialize;

use super::learn::Learnt;
use super::request::Goal;

/// The evaluation.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) learnt: Vec<Learnt>,
    /// How often there is a fix, column by column of the tables.
    pub(super) columns: Vec<&'static str>,
    pub(super) tables: Vec<Table>,
    /// With true poses.
    pub(super) workload: Vec<(&'static str, Quality)>,
}

/// One set of drives.
#[derive(Debug, Serialize)]
pub(super) struct Table {
    pub(super) about: String,
    pub(super) rows: Vec<Row>,
}

/// A way of mapping.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    pub(super) method: &'static str,
    /// Means over the drives, one per schedule.
    pub(super) columns: Vec<Quality>,
}

impl Report {
    /// For people and for a documentation.
    pub(super) fn markdown(&self) -> String {
        let mut text = String::new();
        for Learnt { fusion, goal, sets, quality, at_first } in &self.learnt {
            let figures = |quality: &Quality| match goal {
                Goal::Bits => format!("{:.3} bits", quality.bits),
                Goal::Walls => {
                    let shares = [quality.wall_recall_10cm, quality.free_called_occupied].map(|share| 100.0 * share);
                    format!("{:.1} % of the walls, {:.1} % of the free cells called occupied", shares[0], shares[1])
                }
            };
            let (first, last) = (figures(at_first), figures(quality));
            let _ = writeln!(text, "Learnt for {fusion}: {} (from {first} to {last})\n", sets.join(", "));
        }
        for table in &self.tables {
            table.write(&self.columns, &mut text);
        }
        if !self.workload.is_empty() {
            text += "Workload with true poses:\n\n";
            text += "| way of mapping | bits | walls found within 0.10 m | free cells called occupied | occupied cells within 0.10 m of a wall |\n";
            text += "|---|---|---|---|---|\n";
            for (method, quality) in &self.workload {
                let [found, wrong, real] =
                    [quality.wall_recall_10cm, quality.free_called_occupied, quality.wall_precision_10cm]
                        .map(|share| 100.0 * share);
                let _ =
                    writeln!(text, "| {method} | {:.3} | {found:.1} % | {wrong:.1} % | {real:.1} % |", quality.bits);
            }
            text.push('\n');
        }
        text
    }
}

impl Table {
    fn write(&self, names: &[&str], text: &mut String) {
        let _ = writeln!(text, "{}; bits per cell by how often there is a fix (walls / free cells):\n", self.about);
        // The shares are told of one column.
        let shown = names.iter().position(|name| *name == "5 m").unwrap_or(0);
        let shown_name = names.get(shown).copied().unwrap_or_default();
        let _ = writeln!(
            text,
            "| way of mapping | {} | walls found, real, decided wrong ({shown_name}) |",
            names.join(" | ")
        );
        let _ = writeln!(text, "|---|{}---|", "---|".repeat(names.len()));
        for Row { method, columns } in &self.rows {
            let _ = write!(text, "| {method} |");
            for quality in columns {
                let _ =
                    write!(text, " {:.3} ({:.2} / {:.2}) |", quality.bits, quality.bits_occupied, quality.bits_free);
            }
            if let Some(told) = columns.get(shown) {
                let shares = [told.wall_recall_10cm, told.wall_precision_10cm, told.decided_wrong];
                let [found, real, wrong] = shares.map(|share| 100.0 * share);
                let _ = write!(text, " {found:.0} %, {real:.0} %, {wrong:.1} % |");
            }
            text.push('\n');
        }
        text.push('\n');
    }
}
