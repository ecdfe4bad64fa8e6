//! All files of a map.

use std::path::{Path, PathBuf};

use super::map_server::{self, MapMode};
use super::{MapDocument, MapError, OccupancyMap, native, npy, picture};
use crate::WriteError;
use crate::whole_file::write_whole;

/// How the files of a map are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MapFileOptions {
    /// How the map_server image is written; in mode `scale` it is `map_scale.png`, not `map.pgm`.
    pub mode: MapMode,
}

/// The files of a map: `map.echogrid`, `map.png`, `map.pgm`, `map.yaml`, `map.npy`.
#[derive(Debug)]
pub struct MapFiles;

impl MapFiles {
    /// Writes all files into a folder, which is made if it is not there; each file whole or not at
    /// all, the native map first. The paths written.
    ///
    /// # Errors
    /// When a file can't be written; those written before it are there then. When the known cells
    /// lie too far apart for a picture, the native map is still written.
    pub fn write_all(
        folder: &Path,
        document: &MapDocument,
        options: &MapFileOptions,
    ) -> Result<Vec<PathBuf>, MapError> {
        std::fs::create_dir_all(folder).map_err(|source| WriteError {
            path: folder.to_path_buf(),
            doing: "making the folder",
            source,
        })?;
        let file = |name: &str| folder.join(name);
        let mut written = vec![file("map.echogrid")];
        native::write(&file("map.echogrid"), document)?;
        write_whole(&file("map.png"), &picture::encode(document)?)?;
        written.push(file("map.png"));
        let map = OccupancyMap::of(&document.grid)?;
        written.extend(map_server::write(folder, "map", &map, options.mode)?);
        write_whole(&file("map.npy"), &npy::encode(&map))?;
        written.push(file("map.npy"));
        Ok(written)
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::{CellIndex, Grid};

    use super::*;
    use crate::map::Provenance;

    #[test]
    fn all_files_are_there_and_the_same_each_time() {
        let mut grid = Grid::new(0.05);
        let cell = CellIndex { i: 5, j: -70 };
        grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 2.0;
        let document = MapDocument { grid, path: Vec::new(), provenance: Provenance::default() };
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("new/maps");
        let files = MapFiles::write_all(&target, &document, &MapFileOptions::default()).unwrap();
        let names: Vec<_> = files.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["map.echogrid", "map.png", "map.pgm", "map.yaml", "map.npy"]);
        let bytes = || files.iter().map(|path| std::fs::read(path).unwrap()).collect::<Vec<_>>();
        let first = bytes();
        MapFiles::write_all(&target, &document, &MapFileOptions::default()).unwrap();
        assert_eq!(bytes(), first);
        assert_eq!(std::fs::read_dir(&target).unwrap().count(), 5);
        let (yaml, map) = map_server::read(&files[3]).unwrap();
        assert_eq!((yaml.origin, map.width), ([0.25, -3.5, 0.0], 1));
        let scale = MapFileOptions { mode: MapMode::Scale };
        let files = MapFiles::write_all(&target, &document, &scale).unwrap();
        assert!(files[2].ends_with("map_scale.png"));
        assert!((map_server::read(&files[3]).unwrap().1.probability[0] - 0.88).abs() < 0.003);
    }

    #[test]
    fn a_folder_that_cannot_be_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let document = MapDocument { grid: Grid::new(0.05), path: Vec::new(), provenance: Provenance::default() };
        let error = MapFiles::write_all(&file.path().join("maps"), &document, &MapFileOptions::default()).unwrap_err();
        assert!(error.to_string().contains("maps"), "{error}");
    }
}
