//! `--spool`: a run that outlives its processes, all of them at once.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use echogrid_formats::sweep_unfinished;
use echogrid_service::store::Store;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

/// The file that tells what the run is.
const RUN_FILE: &str = "run.toml";
/// What decides nothing about the map.
const FREE: [&str; 2] = ["run", "supervision"];

/// The folder of a run that can be resumed.
#[derive(Debug)]
pub(super) struct Spool {
    folder: PathBuf,
    run: RunFile,
}

#[derive(Debug, Serialize, Deserialize)]
struct RunFile {
    epoch: u64,
    /// Whether it came to its end: what lies beside this is left over.
    #[serde(default)]
    ended: bool,
    /// What the run was started with: another configuration would make another map.
    config: Table,
}

impl Spool {
    /// Begins a run in `folder`, or goes on with the one that is there.
    ///
    /// # Errors
    /// There is one and it is not to be resumed, or there is none and one is, or it was another; or the folder can't be
    /// written.
    pub(super) fn open(folder: &Path, resumes: bool, epoch: u64, config: &Table) -> Result<Self> {
        let file = folder.join(RUN_FILE);
        let mut config = config.clone();
        FREE.iter().for_each(|section| drop(config.remove(*section)));
        let shown = || file.display().to_string();
        if file.exists() {
            let text = std::fs::read_to_string(&file).with_context(shown)?;
            let run: RunFile = toml::from_str(&text).with_context(shown)?;
            if run.ended {
                // Its launcher died while it tidied up.
                Self { folder: folder.into(), run }.sweep()?;
                return Self::open(folder, resumes, epoch, &config);
            }
            ensure!(
                resumes,
                "{}: a run that did not come to its end is spooled there; go on with it (--resume), or remove the folder",
                folder.display()
            );
            if let Some(difference) = difference("", &run.config, &config) {
                bail!("{}: this run can't be resumed with another configuration: {difference}", folder.display());
            }
            for store in stores(folder)?.iter().filter(|store| store.extension().is_some_and(|of| of == "redb")) {
                Store::check(store, run.epoch)
                    .with_context(|| format!("{}: this run can't be resumed", folder.display()))?;
            }
            return Ok(Self { folder: folder.into(), run });
        }
        ensure!(!resumes, "{}: no run to resume there (no {RUN_FILE})", folder.display());
        std::fs::create_dir_all(folder).with_context(|| format!("making the folder {}", folder.display()))?;
        if let Some(store) = stores(folder)?.first() {
            bail!(
                "{}: {} is of a run whose {RUN_FILE} is gone, which can't be told from this one; remove it, or choose another \
                 folder",
                folder.display(),
                store.file_name().unwrap_or_default().display()
            );
        }
        let spool = Self { folder: folder.into(), run: RunFile { epoch, ended: false, config } };
        spool.write()?;
        Ok(spool)
    }

    /// Writes what the run is, so that it outlives the machine.
    fn write(&self) -> Result<()> {
        let file = self.folder.join(RUN_FILE);
        let text = toml::to_string(&self.run)?;
        echogrid_formats::write_whole(&file, text.as_bytes())?;
        Ok(())
    }

    /// The run's, over all its resumptions.
    pub(super) fn epoch(&self) -> u64 {
        self.run.epoch
    }

    /// Where the services store their states.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The run came to its end: nothing is left to resume.
    pub(super) fn remove(mut self) -> Result<()> {
        // Whoever dies from here on leaves what nobody takes for a run.
        self.run.ended = true;
        self.write()?;
        self.sweep()
    }

    /// Removes what there is of it; last what says so.
    fn sweep(&self) -> Result<()> {
        sweep_unfinished(&self.folder).with_context(|| self.folder.display().to_string())?;
        let mut files = stores(&self.folder)?;
        files.push(self.folder.join(RUN_FILE));
        for file in files {
            std::fs::remove_file(&file).with_context(|| file.display().to_string())?;
        }
        // What else is there is not ours.
        let _ = std::fs::remove_dir(&self.folder);
        Ok(())
    }
}

/// What services stored in a folder, and what they had begun to.
fn stores(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let is_store = |path: &PathBuf| {
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        extension == "redb" || extension.starts_with("new-")
    };
    let mut stores: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_store).collect();
    stores.sort();
    Ok(stores)
}

/// What a run was made of, in words of its own: what differs in it is said of the keys that it was made of.
const PROVENANCE: &str = "provenance";
/// Longer values are not shown whole.
const SHOWN_CHARS: usize = 80;

/// The first key that differs, and how.
fn difference(prefix: &str, before: &Table, now: &Table) -> Option<String> {
    let keys = || before.keys().chain(now.keys().filter(|key| !before.contains_key(*key)));
    let (last, first): (Vec<_>, Vec<_>) = keys().partition(|key| prefix.is_empty() && *key == PROVENANCE);
    first.into_iter().chain(last).find_map(|key| {
        let path = format!("{prefix}{key}");
        match (before.get(key), now.get(key)) {
            (Some(Value::Table(before)), Some(Value::Table(now))) => difference(&format!("{path}."), before, now),
            (before, now) if before == now => None,
            (before, now) => Some(format!("{path} was {}, now it is {}", shown(before), shown(now))),
        }
    })
}

fn shown(value: Option<&Value>) -> String {
    let value = value.map_or("nothing".to_owned(), ToString::to_string);
    match value.char_indices().nth(SHOWN_CHARS) {
        Some((end, _)) => format!("{}…", &value[..end]),
        None => value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> Table {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn a_run_is_begun_once_and_resumed_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("spool");
        let first = config("[mapper]\nresolution_m = 0.05\n[run]\nrate = 1\n");
        let open = |resumes, epoch, config: &Table| Spool::open(&folder, resumes, epoch, config);
        let told = |result: Result<Spool>| format!("{:#}", result.unwrap_err());
        assert!(told(open(true, 1, &first)).contains("no run to resume"));
        assert_eq!(open(false, 1, &first).unwrap().epoch(), 1);
        assert!(told(open(false, 2, &first)).contains("--resume"));
        let faster = config("[mapper]\nresolution_m = 0.05\n[run]\nrate = 2\n");
        let resumed = open(true, 2, &faster).unwrap();
        assert_eq!(resumed.epoch(), 1);
        let coarser = config("[mapper]\nresolution_m = 0.1\n");
        assert!(told(open(true, 2, &coarser)).contains("mapper.resolution_m was 0.05, now it is 0.1"));
        std::fs::write(folder.join("mapper.redb"), "no store at all").unwrap();
        let error = told(open(true, 2, &faster));
        assert!(error.contains("can't be resumed") && error.contains("mapper.redb"), "{error}");
        // Of a launcher that was killed while it wrote.
        std::fs::write(folder.join(".echogrid-Ab12.part"), "").unwrap();
        resumed.remove().unwrap();
        assert!(!folder.exists());
        // What a launcher left that died while it tidied up is no run.
        let mut ended = open(false, 3, &first).unwrap();
        ended.run.ended = true;
        ended.write().unwrap();
        std::fs::write(folder.join("mapper.redb"), "").unwrap();
        assert!(told(open(true, 4, &first)).contains("no run to resume"));
        // Nor is a store without the word that says of what.
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("mapper.redb"), "").unwrap();
        let error = told(open(false, 5, &first));
        assert!(error.contains("mapper.redb is of a run whose run.toml is gone"), "{error}");
    }
}
