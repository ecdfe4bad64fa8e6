//! A drive that goes on with the map of an earlier one, and what a later one needs to go on with this.

use anyhow::{Context, Result};
use echogrid_core::oriented::STATES;
use echogrid_formats::map::native;
use echogrid_service::Outbox;
use echogrid_topics::{Layer, Message, TileUpdate};

use crate::MapperService;

impl MapperService {
    /// Goes on with the map of an earlier drive, once it is known where in it the robot is. Until then nothing of it is told: a drive that
    /// it does not recognise has no map.
    pub(crate) fn go_on(&mut self) -> Result<()> {
        let Some((mapper, file)) = self.mapper.as_mut().zip(self.earlier.as_ref()) else { return Ok(()) };
        if self.trajectory.latest().is_none_or(|latest| latest.unplaced) {
            return Ok(());
        }
        let map = native::read(file).context("run.continue")?.grid;
        // Scans are numbered on: what is told of a tile later has a higher number.
        self.scans_before = map.tiles().map(|(_, tile)| tile.revision).max().unwrap_or(0);
        mapper.go_on_with(map)?;
        self.earlier = None;
        Ok(())
    }

    /// Sends what whoever goes on with this map has to know of each cell besides its log-odds.
    pub(crate) fn send_states(&self, out: &mut Outbox) {
        let tiles = self.mapper.iter().flat_map(|mapper| mapper.grid().tiles());
        for (index, tile) in tiles {
            let Some(shares) = &tile.shares else { continue };
            for state in 0..STATES {
                let (revision, resolution_m) = (tile.revision, self.config.resolution_m);
                let (layer, log_odds) = (Layer::State(state as u16), shares.state(state));
                out.send(self.stamp_ns, Message::Tile(TileUpdate { layer, index, revision, resolution_m, log_odds }));
            }
        }
    }
}
