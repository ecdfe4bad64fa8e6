//! What the tests share.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use echogrid::config::{Config, LoadRequest};
use echogrid_core::Robot;
use echogrid_formats::map::Provenance;
use echogrid_publisher::PublisherService;
use tempfile::TempDir;

pub(crate) use echogrid_harness::namespace::{folder_in_a_namespace, in_a_namespace, mount_shared_memory};
pub(crate) use echogrid_harness::said;

use crate::drive;

/// The program under test.
pub(crate) const ECHOGRID: &str = env!("CARGO_BIN_EXE_echogrid");

/// The robot that drives in [`drive`].
pub(crate) fn pioneer() -> Robot {
    let request = LoadRequest { robot: Some("pioneer3at".into()), ..LoadRequest::default() };
    Config::load(&request).unwrap().robot().unwrap().clone()
}

/// A folder with a log of `metres` of the project's own drive in it.
pub(crate) struct Drive {
    folder: TempDir,
}

impl Drive {
    pub(crate) fn new(metres: f64) -> Self {
        let drive = Self { folder: tempfile::tempdir().unwrap() };
        std::fs::write(drive.log(), drive::carmen_log(&pioneer(), 1, metres)).unwrap();
        drive
    }

    /// The same drive in a folder of its own.
    pub(crate) fn of(other: &Self) -> Self {
        let drive = Self { folder: tempfile::tempdir().unwrap() };
        std::fs::copy(other.log(), drive.log()).unwrap();
        drive
    }

    pub(crate) fn log(&self) -> PathBuf {
        self.folder.path().join("drive.log")
    }

    /// A folder for a map.
    pub(crate) fn out(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `echogrid map` of the drive, arguments first.
    pub(crate) fn map_arguments(&self, out: &str, more: &[&str]) -> Vec<String> {
        let mut arguments = vec!["map".to_owned(), path(&self.log()), "--out".into(), path(&self.out(out))];
        arguments.extend(more.iter().map(|argument| (*argument).to_owned()));
        arguments
    }

    /// Runs `echogrid map` to its end.
    pub(crate) fn map(&self, out: &str, more: &[&str]) -> Output {
        echogrid(self.map_arguments(out, more))
    }

    /// Runs `echogrid map` and gives the bytes of the native map.
    pub(crate) fn native_map(&self, out: &str, more: &[&str]) -> Vec<u8> {
        let output = self.map(out, more);
        assert!(output.status.success(), "{}", said(&output));
        std::fs::read(self.out(out).join("map.echogrid")).unwrap()
    }
}

pub(crate) fn path(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// Runs the program to its end.
pub(crate) fn echogrid<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> Output {
    Command::new(ECHOGRID).args(arguments).output().unwrap()
}

/// The summary of `--json`.
pub(crate) fn summary(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", said(output));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}\n{}", said(output)))
}

/// Logs of others, where there are any.
pub(crate) fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(name);
    if path.exists() {
        return Some(path);
    }
    let _ = writeln!(std::io::stderr(), "skipped: no {}", path.display());
    None
}

/// The native map of a configuration, made in this process.
pub(crate) fn native_map_of(config: &Config, provenance: Provenance, out: &Path) -> Vec<u8> {
    let mut publisher = PublisherService::new(config.publisher.clone(), out.into(), provenance).unwrap();
    echogrid::in_process::run(config, &mut publisher).unwrap();
    std::fs::read(out.join("map.echogrid")).unwrap()
}
