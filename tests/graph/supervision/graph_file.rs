//! Graph files with something wrong in them.

use std::path::PathBuf;

use echogrid_harness::fault::Mode;
use echogrid_harness::{GraphProcess, fault_program};

use crate::support::{Drive, ECHOGRID, path};

/// A graph file over a drive, written as it grows.
pub(super) struct GraphFile<'a> {
    drive: &'a Drive,
    name: &'static str,
    text: String,
}

impl<'a> GraphFile<'a> {
    /// The drive is played as fast as the graph takes it; all services are the built-in ones.
    pub(super) fn new(drive: &'a Drive, name: &'static str) -> Self {
        Self { drive, name, text: "[replay]\nlog = \"drive.log\"\n".to_owned() }
    }

    /// One more section, or several.
    pub(super) fn with(mut self, text: &str) -> Self {
        self.text += text;
        self.text += "\n";
        self
    }

    /// A service of this name and kind that is `echogrid-fault`.
    pub(super) fn fault(self, name: &str, kind: &str, mode: Mode, argument: u64, more: &str) -> Self {
        let (exec, mode) = (fault_program(), mode.word());
        self.with(&format!(
            "[services.{name}]\nkind = \"{kind}\"\nexec = {exec:?}\nargs = [{mode:?}, \"{argument}\"]\n{more}"
        ))
    }

    /// A built-in publisher beside others.
    pub(super) fn publisher(self) -> Self {
        self.with("[services.publisher]\nkind = \"publisher\"\nexec = \"builtin:publisher\"")
    }

    pub(super) fn start(&self, sets: &[&str]) -> GraphProcess {
        self.start_with(sets, &[])
    }

    /// As it is started, with `more` arguments.
    pub(super) fn start_with(&self, sets: &[&str], more: &[&str]) -> GraphProcess {
        let file = self.drive.out(&format!("{}.toml", self.name));
        std::fs::write(&file, &self.text).unwrap();
        let (file, out) = (path(&file), path(&self.drive.out(self.name)));
        let sets = sets.iter().flat_map(|set| ["--set", set]);
        let arguments = ["up", &file, "--json", "--out", &out].into_iter().chain(sets).chain(more.iter().copied());
        GraphProcess::start(ECHOGRID, arguments)
    }

    fn map_file(&self) -> PathBuf {
        self.drive.out(self.name).join("map.echogrid")
    }

    pub(super) fn map_bytes(&self) -> Vec<u8> {
        std::fs::read(self.map_file()).unwrap()
    }
}

/// Restarts come soon, and are soon over.
pub(super) const IMPATIENT: [&str; 3] =
    ["supervision.backoff_s=0.02", "supervision.restarts_max=1", "run.alive_within_s=2"];

pub(super) const NOTHING: Vec<String> = Vec::new();
