//! Trials, wherever they come from.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use echogrid_core::{Calibration, Trial};
use echogrid_formats::trials::{Phase, Trials};

use super::request::Calibrate;

/// The trials of both phases.
#[derive(Debug)]
pub(super) struct Found {
    /// Where they are from, for people.
    pub(super) name: String,
    pub(super) translations: Vec<Trial>,
    pub(super) rotations: Vec<Trial>,
    /// Poses of a drive where the truth was known.
    pub(super) known: Option<usize>,
    /// The model that a simulator was given.
    pub(super) given: Option<Calibration>,
}

/// Whether a file is a table, by its name: a log has names of its own.
pub(super) fn is_table(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"))
}

/// Names of files, for people.
pub(super) fn names(files: &[PathBuf]) -> String {
    let name = |file: &PathBuf| file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
    files.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// The trials of tables, all of them together.
pub(super) fn of_tables(request: &Calibrate) -> Result<Found> {
    ensure!(
        request.reference.is_none() && request.landmarks.is_none(),
        "--reference and --landmarks are for logs; a table tells itself what is true"
    );
    ensure!(
        request.robot.is_none() && request.sets.is_empty(),
        "--robot and --set are for logs and --simulate; they change nothing about a table"
    );
    let series = request.series.as_deref();
    let (mut translations, mut rotations) = (Vec::new(), Vec::new());
    for file in &request.inputs {
        let table = Trials::read(file)?;
        if let Some(series) = series {
            let known = table.series();
            let all = if known.is_empty() { "no column series at all".to_owned() } else { known.join(", ") };
            ensure!(known.contains(&series), "{}: no series {series:?} in it; there is {all}", file.display());
        }
        translations.extend(table.of(Phase::Translation, series));
        rotations.extend(table.of(Phase::Rotation, series));
    }
    let of = series.map(|series| format!(", series {series}")).unwrap_or_default();
    let name = format!("{}{of}", names(&request.inputs));
    Ok(Found { name, translations, rotations, known: None, given: None })
}
