//! The files of a run: whether they can be written, which were, and whose lie there.

use std::collections::BTreeMap;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use echogrid_formats::map::readings::READINGS_FILE;
use echogrid_formats::map::{MapFiles, MapFormat};
use echogrid_formats::probe_file;
use echogrid_publisher::SONARS_FILE;

use crate::config::{Builtin, Config, Exec, ServiceKind};
use crate::supervisor;

/// An output directory that can't be written is said now, not after the drive; and so is a folder where a file would be.
pub(super) fn probe_output(config: &Config) -> Result<()> {
    let out = &config.run.out;
    std::fs::create_dir_all(out).with_context(|| format!("making the output directory {}", out.display()))?;
    tempfile::tempfile_in(out).with_context(|| format!("the output directory {} can't be written", out.display()))?;
    file_names(config).iter().try_for_each(|name| Ok(probe_file(&out.join(name))?))
}

/// So is a folder for the record that can't be; the output directory `out` may yet have to be made.
pub(super) fn probe_record(record: &Path, out: &Path) -> Result<()> {
    if let Some(folder) = record.parent().filter(|folder| !folder.as_os_str().is_empty() && *folder != out) {
        tempfile::tempfile_in(folder)
            .with_context(|| format!("simulator.record: {} can't be written there", record.display()))?;
    }
    ensure!(!record.is_dir(), "simulator.record: {} is a folder; expected a file or nothing", record.display());
    Ok(())
}

/// Nor is a recording ever replaced.
pub(super) fn probe_recording(file: &Path) -> Result<()> {
    ensure!(
        !file.exists(),
        "{}: is there already, and a recording is never replaced; name another: --record=FILE",
        file.display()
    );
    if let Some(folder) = file.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).with_context(|| format!("making the folder {}", folder.display()))?;
        tempfile::tempfile_in(folder)
            .with_context(|| format!("recorder.file: {} can't be written there", file.display()))?;
    }
    Ok(())
}

/// The files that a run may write.
fn file_names(config: &Config) -> Vec<String> {
    let mut names = MapFiles::names(&config.publisher.map_files());
    names.extend([SONARS_FILE.to_owned(), READINGS_FILE.to_owned()]);
    if config.does_slam() {
        names.extend(echogrid_slam_service::FILES.map(str::to_owned));
    }
    names
}

/// The files that a run may write, as they are on the disk: each by what tells it from any other at its place, whatever the
/// clock says. Of a file that is not there: nothing.
#[derive(Debug)]
pub(super) struct Files(BTreeMap<PathBuf, (u64, i64, i64)>);

impl Files {
    pub(super) fn of(config: &Config) -> Self {
        let paths = file_names(config).into_iter().map(|name| config.run.out.join(name));
        let identity = |path: PathBuf| {
            let meta = std::fs::metadata(&path).ok()?;
            Some((path, (meta.ino(), meta.mtime(), meta.mtime_nsec())))
        };
        Self(paths.filter_map(identity).collect())
    }
}

/// The files that were written since it was as `before`; the others are of another run.
pub(super) fn written(config: &Config, before: &Files) -> Vec<PathBuf> {
    let now = Files::of(config);
    let is_new = |path: &PathBuf| now.0.get(path).is_some_and(|file| before.0.get(path) != Some(file));
    file_names(config).into_iter().map(|name| config.run.out.join(name)).filter(is_new).collect()
}

/// What is said where it was asked which way walls face, and nobody knows.
pub(super) fn untold_facing(config: &Config, files: &[PathBuf]) -> Option<String> {
    let is_told =
        files.iter().any(|file| file.file_name().is_some_and(|name| name.to_string_lossy().starts_with("facing.")));
    let draws = config.publisher.formats.iter().any(|format| matches!(format, MapFormat::Png | MapFormat::Npy));
    (config.mapper.facing && draws && !files.is_empty() && !is_told).then(|| {
        "mapper.facing: nothing is known of which way walls face: sonars tell it, by mapper.fusion = \"oriented\""
            .to_owned()
    })
}

/// What the publishers say that their files lack of the map.
pub(super) fn files_lack(config: &Config, outcome: &supervisor::Outcome) -> Vec<String> {
    let publishers = config.services.iter().filter(|(_, service)| service.kind == ServiceKind::Publisher);
    let notes = publishers.filter_map(|(name, _)| Some(outcome.health.get(name)?.note.clone()));
    notes.filter(|note| !note.is_empty()).collect()
}

/// Whatever was mapped must lie on the disk now.
pub(super) fn check_saved(config: &Config, outcome: &supervisor::Outcome, before: &Files) -> Result<()> {
    let cells = outcome.map.as_ref().map_or(0, |map| map.cells_known);
    let publishes = |exec: &Exec| *exec == Exec::Builtin(Builtin::Publisher);
    let has_publisher = config.services.values().any(|service| publishes(&service.exec));
    let given_up = !outcome.given_up.is_empty();
    ensure!(
        cells == 0 || !has_publisher || given_up || !written(config, before).is_empty(),
        "{} cells were mapped, and no map was saved in {}",
        cells,
        config.run.out.display()
    );
    Ok(())
}

/// Where the map so far is, for whoever reads the error.
pub(super) fn kept(config: &Config, before: &Files) -> String {
    let files = written(config, before);
    match files.first() {
        Some(_) => format!("the graph stopped early (what is in {} is the map so far)", config.run.out.display()),
        None => format!("the graph stopped early{}", of_an_earlier_run(config)),
    }
}

/// Whose map it is that lies where a run that saved none would have saved its own.
pub(super) fn of_an_earlier_run(config: &Config) -> String {
    let out = &config.run.out;
    let is_there = |name: &String| out.join(name).exists();
    let lies_there = MapFiles::names(&config.publisher.map_files()).iter().any(is_there);
    if lies_there { format!(" (the map in {} is of an earlier run)", out.display()) } else { String::new() }
}
