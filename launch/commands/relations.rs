//! `echogrid relations`: how far a path is off, by relations between its poses (Kümmerle et al. 2009).

use std::fmt;
use std::path::Path;

use anyhow::{Result, ensure};
use echogrid_core::Pose2;
use echogrid_formats::localization::{ReferencePath, Relations};
use echogrid_slam::evaluate::{Spread, relative};
use serde::Serialize;

/// A path says nothing between two poses that are farther apart in time, nanoseconds.
const GAP_MAX_NS: u64 = 2_000_000_000;

#[derive(Debug, Serialize)]
struct Found<'a> {
    relations: &'a Path,
    path: &'a Path,
    /// Relations that count.
    count: usize,
    /// Relations with a stamp at which the path says nothing.
    left_out: usize,
    translation_m: Errors,
    rotation_rad: Errors,
}

#[derive(Debug, Serialize)]
struct Errors {
    mean: f64,
    std: f64,
    median: f64,
    max: f64,
}

impl From<Spread> for Errors {
    fn from(Spread { mean, std, median, max, .. }: Spread) -> Self {
        Self { mean, std, median, max }
    }
}

/// Judges `path` by `relations`, which are of what sits on the robot at `mount`, if anywhere.
pub(super) fn run(relations: &Path, path: &Path, mount: Option<[f64; 3]>, json: bool) -> Result<()> {
    let [x, y, theta] = mount.unwrap_or_default();
    let base_from_sensor = Pose2::new(x, y, theta);
    let read = Relations::read(relations)?;
    let poses = ReferencePath::read(path)?;
    let mut errors = Vec::new();
    for relation in read.all() {
        let at = |stamp_ns| Some(poses.at(stamp_ns, GAP_MAX_NS)? * base_from_sensor);
        if let Some((from, to)) = at(relation.from_ns).zip(at(relation.to_ns)) {
            errors.push(relative(relation.pose, from.inverse() * to));
        }
    }
    ensure!(
        !errors.is_empty(),
        "{}: at no stamp of a relation in {} is there a pose; are both of one drive, in its own time?",
        path.display(),
        relations.display()
    );
    let (metres, radians): (Vec<f64>, Vec<f64>) = errors.iter().copied().unzip();
    let found = Found {
        relations,
        path,
        count: errors.len(),
        left_out: read.all().len() - errors.len(),
        translation_m: Spread::of(&metres).into(),
        rotation_rad: Spread::of(&radians).into(),
    };
    super::print_found(&found, json)
}

impl fmt::Display for Found<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let left_out = match self.left_out {
            0 => String::new(),
            count => format!("; {count} left out: the path says nothing at their stamps"),
        };
        let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        writeln!(f, "{} by {} relations of {}{left_out}", name(self.path), self.count, name(self.relations))?;
        let Errors { mean, std, median, max } = &self.translation_m;
        writeln!(f, "translation  {mean:.4} ± {std:.4} m (median {median:.4}, largest {max:.3})")?;
        let [mean, std, median, max] = {
            let Errors { mean, std, median, max } = &self.rotation_rad;
            [mean, std, median, max].map(|value| value.to_degrees())
        };
        writeln!(f, "rotation     {mean:.3} ± {std:.3}° (median {median:.3}, largest {max:.2})")
    }
}
