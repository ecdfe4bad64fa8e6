//! `readings.echogrid`: the kept readings, saved beside the map.

use std::collections::VecDeque;
use std::path::PathBuf;

use anyhow::{Context, Result};
use echogrid_core::kept::KeptReadings;
use echogrid_core::{Chunks, MapperConfig, Parts, Robot, Saved, SavedError};
use echogrid_formats::map::readings::{self, READINGS_FILE, ReadingsDocument};

/// Where they are saved, and what the file needs besides.
#[derive(Debug)]
pub(crate) struct ReadingsFile {
    folder: PathBuf,
    robot: Robot,
    /// Number and stamp of each scan, 16 bytes each.
    scans: VecDeque<(u64, u64)>,
    chunks: Chunks,
}

/// Under what the scans are saved, by so many.
const PREFIX: &str = "scans/";
const CHUNK: u64 = 1024;

impl ReadingsFile {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self { folder, robot: Robot::default(), scans: VecDeque::new(), chunks: Chunks::new(CHUNK) }
    }

    pub(crate) fn set_robot(&mut self, robot: Robot) {
        self.robot = robot;
    }

    /// The readings that come next are of this scan.
    pub(crate) fn begin_scan(&mut self, sequence: u64, stamp_ns: u64) {
        if self.scans.back().is_none_or(|(last, _)| *last < sequence) {
            self.scans.push_back((sequence, stamp_ns));
        }
    }

    /// Saves the scans that came since the last time; how many there are.
    pub(crate) fn save(&mut self, parts: &mut Parts) -> u64 {
        self.chunks.save(parts, PREFIX, 0, &self.scans);
        self.scans.len() as u64
    }

    /// Takes so many scans that were saved.
    ///
    /// # Errors
    /// A part is missing, or damaged.
    pub(crate) fn restore(&mut self, saved: &Saved, scans: u64) -> Result<(), SavedError> {
        (self.chunks, self.scans) = Chunks::restore(CHUNK, saved, PREFIX, 0, scans)?;
        Ok(())
    }

    /// Writes the file, whole or not at all.
    pub(crate) fn write(&self, mapper: &MapperConfig, kept: &KeptReadings) -> Result<PathBuf> {
        let first = kept.iter().next().map_or(0, |kept| kept.sequence);
        let document = ReadingsDocument {
            mapper: mapper.clone(),
            robot: self.robot.clone(),
            scans: self.scans.iter().copied().filter(|(sequence, _)| *sequence >= first).collect(),
            given_up: kept.given_up(),
            readings: kept.iter().copied().collect(),
        };
        std::fs::create_dir_all(&self.folder)
            .with_context(|| format!("making the folder {}", self.folder.display()))?;
        let file = self.folder.join(READINGS_FILE);
        readings::write(&file, &document)?;
        Ok(file)
    }
}
