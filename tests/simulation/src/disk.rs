//! A disk that loses what was not synced, may be full, and is written by processes that die.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Result, ensure};
use echogrid_core::Grid;
use echogrid_formats::WriteError;
use echogrid_formats::map::{MapDocument, MapError, MapFileOptions, MapFormat};
use echogrid_publisher::Saver;
use echogrid_publisher::config::PublisherConfig;
use echogrid_service::store::{Change, Shelf, Table};

use crate::drive::Drive;
use crate::world::Shared;

type Tables = BTreeMap<(Table, Vec<u8>), Vec<u8>>;

/// What a spool's folder says of its run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RunFile {
    pub(crate) run: u64,
    pub(crate) drive: Drive,
    pub(crate) ended: bool,
}

/// What lies on the disk.
#[derive(Debug, Default)]
pub(crate) struct Disk {
    pub(crate) run_file: Option<RunFile>,
    /// Stores, by service.
    pub(crate) stores: BTreeMap<String, Tables>,
    /// What was removed, and may be there again if the power fails.
    removed_stores: BTreeMap<String, Tables>,
    removed_run_file: Option<RunFile>,
    /// The map that lies in the folder of output.
    pub(crate) map: Option<Vec<u8>>,
    /// How often one was saved.
    pub(crate) saves: u32,
    /// No room until then.
    pub(crate) full_until: Duration,
}

impl Disk {
    pub(crate) fn remove_store(&mut self, name: &str) {
        if let Some(tables) = self.stores.remove(name) {
            self.removed_stores.insert(name.to_owned(), tables);
        }
    }

    pub(crate) fn remove_run_file(&mut self) {
        self.removed_run_file = self.run_file.take().or(self.removed_run_file);
    }

    /// What the folder holds is there for good.
    pub(crate) fn sync_folder(&mut self) {
        self.removed_stores.clear();
        self.removed_run_file = None;
    }

    /// The power fails: each file that was removed may be there again.
    pub(crate) fn lose_power(&mut self, mut is_back: impl FnMut() -> bool) {
        for (name, tables) in std::mem::take(&mut self.removed_stores) {
            if is_back() {
                self.stores.entry(name).or_insert(tables);
            }
        }
        if let Some(run_file) = self.removed_run_file.take().filter(|_| is_back()) {
            self.run_file.get_or_insert(run_file);
        }
    }
}

fn full() -> io::Error {
    io::Error::from(io::ErrorKind::StorageFull)
}

/// The store of a service, in the spool's folder.
#[derive(Debug)]
pub(crate) struct SimulatedShelf {
    pub(crate) world: Shared,
    pub(crate) process: u32,
    pub(crate) service: String,
}

impl SimulatedShelf {
    fn with<T>(&self, look: impl FnOnce(&Tables) -> T) -> T {
        let world = self.world.borrow();
        look(world.disk.stores.get(&self.service).unwrap_or(&Tables::new()))
    }
}

impl Shelf for SimulatedShelf {
    fn get(&self, table: Table, key: &[u8]) -> Result<Option<Vec<u8>>> {
        Ok(self.with(|tables| tables.get(&(table, key.to_vec())).cloned()))
    }

    fn range(&self, table: Table, from: &[u8]) -> Result<Vec<(Vec<u8>, Vec<u8>)>> {
        Ok(self.with(|tables| {
            let from = tables.range((table, from.to_vec())..).take_while(|((of, _), _)| *of == table);
            from.map(|((_, key), value)| (key.clone(), value.clone())).collect()
        }))
    }

    fn last(&self, table: Table) -> Result<Option<Vec<u8>>> {
        Ok(self.with(|tables| {
            let of = tables.range((table, Vec::new())..).take_while(|((of, _), _)| *of == table);
            of.last().map(|((_, key), _)| key.clone())
        }))
    }

    fn commit(&mut self, changes: Vec<Change>) -> Result<()> {
        let mut world = self.world.borrow_mut();
        ensure!(world.lives(self.process), "killed before it stored");
        if world.now < world.disk.full_until {
            return Err(full().into());
        }
        let tables = world.disk.stores.entry(self.service.clone()).or_default();
        for Change { table, key, value } in changes {
            match value {
                Some(value) => drop(tables.insert((table, key), value)),
                None => drop(tables.remove(&(table, key))),
            }
        }
        ensure!(world.lives(self.process), "killed when it had stored");
        Ok(())
    }
}

/// One that draws no pictures, which would come to the real disk.
pub(crate) fn publisher() -> PublisherConfig {
    PublisherConfig { formats: vec![MapFormat::Echogrid], ..PublisherConfig::default() }
}

/// The folder of output.
#[derive(Debug)]
pub(crate) struct SimulatedFolder {
    pub(crate) world: Shared,
    pub(crate) process: u32,
}

impl Saver for SimulatedFolder {
    fn save(&mut self, folder: &Path, map: &MapDocument, _files: &MapFileOptions) -> Result<Vec<PathBuf>, MapError> {
        let refuse = |source| MapError::from(WriteError { path: folder.to_path_buf(), doing: "writing", source });
        let mut world = self.world.borrow_mut();
        if !world.lives(self.process) {
            return Err(refuse(io::ErrorKind::Interrupted.into()));
        }
        if world.now < world.disk.full_until {
            return Err(refuse(full()));
        }
        world.disk.map = Some(bytes(map));
        world.disk.saves += 1;
        if !world.lives(self.process) {
            return Err(refuse(io::ErrorKind::Interrupted.into()));
        }
        Ok(vec![folder.join("map.echogrid")])
    }
}

/// All that a map's files are made of, every bit of it.
pub(crate) fn bytes(map: &MapDocument) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut put_grid = |grid: &Grid| {
        for (index, tile) in grid.tiles() {
            bytes.extend(index.x.to_le_bytes().into_iter().chain(index.y.to_le_bytes()));
            bytes.extend(tile.revision.to_le_bytes());
            bytes.extend(tile.log_odds.iter().flat_map(|cell| cell.to_bits().to_le_bytes()));
            let codes = tile.shares.iter().flat_map(|shares| shares.codes());
            bytes.extend(codes.flat_map(|code| code.to_le_bytes()));
        }
    };
    put_grid(&map.grid);
    map.doubt.iter().for_each(&mut put_grid);
    for point in &map.path {
        bytes.extend(point.stamp_ns.to_le_bytes());
        let values = [point.pose.x, point.pose.y, point.pose.theta, point.trust];
        bytes.extend(values.iter().flat_map(|value| value.to_bits().to_le_bytes()));
    }
    bytes
}
