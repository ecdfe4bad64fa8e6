//! `sonars.png`: what each sonar alone says, side by side.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use echogrid_core::{Grid, Tile, TileIndex};
use echogrid_formats::map::MapError;
use echogrid_formats::map::sheet::{self, Panel, Row, Sheet};

/// The file's name.
pub const SONARS_FILE: &str = "sonars.png";

/// So many maps to a row.
const COLUMNS: usize = 4;

/// The map of each sonar, by its number.
#[derive(Debug, Default)]
pub(crate) struct SonarSheet {
    grids: BTreeMap<u16, Grid>,
}

impl SonarSheet {
    pub(crate) fn take(&mut self, sonar: u16, index: TileIndex, tile: Tile, resolution_m: f64) {
        *self.grids.entry(sonar).or_insert_with(|| Grid::new(resolution_m)).tile_mut(index) = tile;
    }

    /// Writes the sheet into a folder, all maps in one frame; the file, if there is anything to show.
    ///
    /// # Errors
    /// The maps lie too far apart for a picture, or it can't be written.
    pub(crate) fn write(&self, folder: &Path) -> Result<Option<PathBuf>, MapError> {
        let Some(frame_m) = frame_m(self.grids.values()) else { return Ok(None) };
        let panel = |(sonar, grid): (&u16, &Grid)| Panel {
            grid: grid.clone(),
            robot: None,
            true_robot: None,
            label: format!("sonar {sonar}"),
        };
        let mut panels = self.grids.iter().map(panel).peekable();
        let mut rows = Vec::new();
        while panels.peek().is_some() {
            rows.push(Row { label: String::new(), panels: panels.by_ref().take(COLUMNS).collect() });
        }
        let columns = vec![String::new(); COLUMNS.min(self.grids.len())];
        let file = folder.join(SONARS_FILE);
        sheet::write(&file, &Sheet { world: None, frame_m, columns, rows })?;
        Ok(Some(file))
    }
}

/// Lowest and highest corner of what any of them knows, metres.
fn frame_m<'a>(grids: impl Iterator<Item = &'a Grid>) -> Option<[[f64; 2]; 2]> {
    let known = grids.filter_map(|grid| {
        let (low, high) = grid.bounds()?;
        let half_m = 0.5 * grid.resolution_m();
        let ([x0, y0], [x1, y1]) = (grid.centre(low), grid.centre(high));
        Some([[x0 - half_m, y0 - half_m], [x1 + half_m, y1 + half_m]])
    });
    known.reduce(|[a, b], [c, d]| [[a[0].min(c[0]), a[1].min(c[1])], [b[0].max(d[0]), b[1].max(d[1])]])
}
