//! `--spool`: a run that outlives its processes, all of them at once.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
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
        if file.exists() {
            ensure!(
                resumes,
                "{}: a run that did not come to its end is spooled there; go on with it (--resume), or remove the folder",
                folder.display()
            );
            let text = std::fs::read_to_string(&file).with_context(|| file.display().to_string())?;
            let run: RunFile = toml::from_str(&text).with_context(|| file.display().to_string())?;
            if let Some(difference) = difference("", &run.config, &config) {
                bail!("{}: this run can't be resumed with another configuration: {difference}", folder.display());
            }
            return Ok(Self { folder: folder.into(), run });
        }
        ensure!(!resumes, "{}: no run to resume there (no {RUN_FILE})", folder.display());
        std::fs::create_dir_all(folder).with_context(|| format!("making the folder {}", folder.display()))?;
        let run = RunFile { epoch, config };
        let new = file.with_extension("new");
        let write = || std::fs::write(&new, toml::to_string(&run)?).map_err(anyhow::Error::from);
        write().and_then(|()| Ok(std::fs::rename(&new, &file)?)).with_context(|| file.display().to_string())?;
        Ok(Self { folder: folder.into(), run })
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
    pub(super) fn remove(self) -> Result<()> {
        // First what says that there is a run.
        let mut files = vec![self.folder.join(RUN_FILE)];
        let entries = std::fs::read_dir(&self.folder).with_context(|| self.folder.display().to_string())?;
        files.extend(
            entries.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "redb")),
        );
        for file in files {
            std::fs::remove_file(&file).with_context(|| file.display().to_string())?;
        }
        // What else is there is not ours.
        let _ = std::fs::remove_dir(&self.folder);
        Ok(())
    }
}

/// The first key that differs, and how.
fn difference(prefix: &str, before: &Table, now: &Table) -> Option<String> {
    let keys = before.keys().chain(now.keys().filter(|key| !before.contains_key(*key)));
    keys.into_iter().find_map(|key| {
        let path = format!("{prefix}{key}");
        match (before.get(key), now.get(key)) {
            (Some(Value::Table(before)), Some(Value::Table(now))) => difference(&format!("{path}."), before, now),
            (before, now) if before == now => None,
            (before, now) => {
                let shown = |value: Option<&Value>| value.map_or("nothing".to_owned(), ToString::to_string);
                Some(format!("{path} was {}, now it is {}", shown(before), shown(now)))
            }
        }
    })
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
        std::fs::write(folder.join("mapper.redb"), "").unwrap();
        resumed.remove().unwrap();
        assert!(!folder.exists());
    }
}
