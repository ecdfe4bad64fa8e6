//! What an experiment came to, for people and as JSON.

use std::fmt;
use std::path::PathBuf;

use echogrid_judge::Quality;
use serde::Serialize;

/// A moment of the drive.
#[derive(Debug, Serialize)]
pub(super) struct Moment {
    pub(super) what: String,
    #[serde(skip)]
    pub(super) stamp_ns: u64,
    /// Since the start.
    pub(super) stamp_s: f64,
}

/// What became of one way of mapping.
#[derive(Debug, Serialize)]
pub(super) struct Score {
    pub(super) name: &'static str,
    pub(super) about: String,
    /// How many are used.
    pub(super) sonars: usize,
    pub(super) fixes: usize,
    pub(super) readings_used: u64,
    #[serde(flatten)]
    pub(super) quality: Quality,
    /// Share of the occupied cells that are behind the walls: farther than 0.3 m from any, and never in sight.
    pub(super) false_walls: f64,
    /// What they cover.
    pub(super) walls_behind_m2: f64,
    /// What cells cover that are said to be free, there.
    pub(super) free_behind_m2: f64,
    /// In a nominal reading, at each moment.
    pub(super) trust: Vec<f64>,
    /// How far the robot was from where it believed to be, at each moment.
    pub(super) off_m: Vec<Option<f64>>,
}

/// The experiment.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) world: PathBuf,
    pub(super) seed: u64,
    /// Really driven.
    pub(super) way_m: f64,
    pub(super) duration_s: f64,
    pub(super) moments: Vec<Moment>,
    pub(super) variants: Vec<Score>,
    pub(super) sheet: PathBuf,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:.1} m in {:.0} s in {}, seed {}", self.way_m, self.duration_s, self.world.display(), self.seed)?;
        writeln!(
            f,
            "\n{:16} {:>6} {:>5} {:>6}  {:>5} {:>5} {:>5}  {:>7} {:>7}  {:>7} {:>7}  {:>7} {:>7}",
            "",
            "sonars",
            "fixes",
            "used",
            "bits",
            "walls",
            "free",
            "decided",
            "wrong",
            "recall",
            "precis.",
            "behind",
            "off"
        )?;
        for score in &self.variants {
            let quality = &score.quality;
            let off_m = score.off_m.last().copied().flatten().unwrap_or(f64::NAN);
            writeln!(
                f,
                "{:16} {:6} {:5} {:6}  {:5.3} {:5.3} {:5.3}  {:5.1} % {:5.1} %  {:5.1} % {:5.1} %  {:5.1} % {off_m:5.2} m",
                score.name,
                score.sonars,
                score.fixes,
                score.readings_used,
                quality.bits,
                quality.bits_occupied,
                quality.bits_free,
                100.0 * quality.decided,
                100.0 * quality.decided_wrong,
                100.0 * quality.wall_recall_10cm,
                100.0 * quality.wall_precision_10cm,
                100.0 * score.false_walls,
            )?;
        }
        writeln!(
            f,
            "\nused: readings in the map; bits per cell, 1 is a map that knows nothing, 0 a perfect one; recall: walls found within"
        )?;
        writeln!(
            f,
            "10 cm; precision: occupied cells that are walls; behind: those beyond the walls; off: the robot, at the end\n"
        )?;
        for score in &self.variants {
            writeln!(f, "{:16} {}", score.name, score.about)?;
        }
        writeln!(f, "\npictures: {}, and one of each map beside it", self.sheet.display())
    }
}
