//! All files of a map.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::map_server::{self, MapMode, Thresholds};
use super::{Drawable, MapDocument, MapError, OccupancyMap, doubt, facing, layer, native, npy, picture};
use crate::WriteError;
use crate::whole_file::{write_together, write_whole};

/// A file that a map is saved to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapFormat {
    /// A picture for people.
    Png,
    /// An image and a YAML, as map_server writes and reads them.
    Pgm,
    /// The probabilities as a NumPy array, and a YAML that says where they lie.
    Npy,
    /// The native map: evidence, path and where they came from.
    Echogrid,
}

impl MapFormat {
    /// Every format of a map.
    pub const ALL: [Self; 4] = [Self::Png, Self::Pgm, Self::Npy, Self::Echogrid];
}

/// Which files of a map are written, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct MapFileOptions {
    /// The files that are written.
    pub formats: Vec<MapFormat>,
    /// How the map_server image is written; in mode `scale` it is `map_scale.png`, not `map.pgm`.
    pub mode: MapMode,
    /// What the YAML says, and which cells of a trinary image are occupied or free.
    pub thresholds: Thresholds,
    /// Whether the picture shows where the robot went; where it is now, it always shows.
    pub draw_path: bool,
    /// Whether heading, scale bar and a legend go with the picture.
    pub draw_legend: bool,
}

impl Default for MapFileOptions {
    fn default() -> Self {
        let formats = MapFormat::ALL.to_vec();
        Self {
            formats,
            mode: MapMode::default(),
            thresholds: Thresholds::default(),
            draw_path: true,
            draw_legend: false,
        }
    }
}

impl MapFileOptions {
    fn has(&self, format: MapFormat) -> bool {
        self.formats.contains(&format)
    }
}

/// The files of a map: `map.echogrid`, `map.png`, `map.pgm`, `map.yaml`, `map.npy`; `doubt.png` and `doubt.npy` where doubt was kept,
/// `facing.png` and `facing.npy` where it was told which way walls face.
#[derive(Debug)]
pub struct MapFiles;

impl MapFiles {
    /// The names of the files that [`MapFiles::write_all`] writes: those of the doubt and of facing, the last ones, if there is any.
    #[must_use]
    pub fn names(options: &MapFileOptions) -> Vec<String> {
        let (pgm, npy) = (options.has(MapFormat::Pgm), options.has(MapFormat::Npy));
        let names = [
            (options.has(MapFormat::Echogrid), "map.echogrid".to_owned()),
            (options.has(MapFormat::Png), "map.png".to_owned()),
            (pgm, map_server::image_name("map", options.mode)),
            (pgm || npy, "map.yaml".to_owned()),
            (npy, "map.npy".to_owned()),
            (options.has(MapFormat::Png), doubt::PICTURE.to_owned()),
            (npy, doubt::ARRAY.to_owned()),
            (options.has(MapFormat::Png), facing::PICTURE.to_owned()),
            (npy, facing::ARRAY.to_owned()),
        ];
        names.into_iter().filter(|(chosen, _)| *chosen).map(|(_, name)| name).collect()
    }

    /// The names of all files that [`MapFiles::write_all`] can write.
    #[must_use]
    pub fn every_name() -> Vec<String> {
        let scaled = MapFileOptions { mode: MapMode::Scale, ..MapFileOptions::default() };
        let mut names = Self::names(&MapFileOptions::default());
        names.extend(Self::names(&scaled));
        names.sort();
        names.dedup();
        names
    }

    /// Writes the chosen files into a folder, which is made if it is not there; each file whole or
    /// not at all, the native map first, and those that share the frame that the YAML tells together. The paths written.
    ///
    /// # Errors
    /// When a file can't be written; those written before it are there then. When the known cells lie too far apart for a
    /// picture, the other files show what a picture can hold ([`Drawable`]); where that is nothing, they are not written.
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
        if options.has(MapFormat::Echogrid) {
            native::write(&file("map.echogrid"), document)?;
        }
        let drawable = match Drawable::of(document) {
            Ok(drawable) => drawable,
            Err(_) => {
                return Ok(if options.has(MapFormat::Echogrid) { vec![file("map.echogrid")] } else { Vec::new() });
            }
        };
        let document = drawable.document.as_ref().unwrap_or(document);
        if options.has(MapFormat::Png) {
            let encode = if options.draw_legend { picture::encode_with_legend } else { picture::encode };
            write_whole(&file("map.png"), &encode(document, options.draw_path)?)?;
        }
        write_together(&Self::framed(folder, document, options)?)?;
        if let Some(metres) = document.doubt.as_ref().filter(|_| options.has(MapFormat::Png)) {
            write_whole(&file(doubt::PICTURE), &doubt::encode_picture(metres, &document.grid)?)?;
        }
        if let Some(radians) = document.facing.as_ref().filter(|_| options.has(MapFormat::Png)) {
            write_whole(&file(facing::PICTURE), &facing::encode_picture(radians, &document.grid)?)?;
        }
        let is_written = |name: &String| match name.as_str() {
            doubt::PICTURE | doubt::ARRAY => document.doubt.is_some(),
            facing::PICTURE | facing::ARRAY => document.facing.is_some(),
            _ => true,
        };
        Ok(Self::names(options).iter().filter(|name| is_written(name)).map(|name| file(name)).collect())
    }

    /// The files that lie in the rectangle that `map.yaml` tells, and it.
    fn framed(
        folder: &Path,
        document: &MapDocument,
        options: &MapFileOptions,
    ) -> Result<Vec<(PathBuf, Vec<u8>)>, MapError> {
        let (pgm, npy) = (options.has(MapFormat::Pgm), options.has(MapFormat::Npy));
        let mut files = Vec::new();
        if !(pgm || npy) {
            return Ok(files);
        }
        let map = OccupancyMap::of(&document.grid)?;
        if pgm {
            files.extend(map_server::files(folder, "map", &map, options.mode, options.thresholds)?);
        } else {
            let yaml = map_server::array_yaml(&map, options.thresholds, "map.npy".into());
            files.push((folder.join("map.yaml"), yaml));
        }
        if npy {
            files.push((folder.join("map.npy"), npy::encode(&map)));
            if let Some(metres) = &document.doubt {
                files.push((folder.join(doubt::ARRAY), layer::encode_array(metres, &document.grid)?));
            }
            if let Some(radians) = &document.facing {
                files.push((folder.join(facing::ARRAY), layer::encode_array(radians, &document.grid)?));
            }
        }
        Ok(files)
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::{CellIndex, Grid};

    use super::*;
    use crate::map::Provenance;

    fn document() -> MapDocument {
        let mut grid = Grid::new(0.05);
        let cell = CellIndex { i: 5, j: -70 };
        grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 2.0;
        MapDocument { grid, doubt: None, facing: None, path: Vec::new(), provenance: Provenance::default() }
    }

    #[test]
    fn all_files_are_there_and_the_same_each_time() {
        let document = document();
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
        let scale = MapFileOptions { mode: MapMode::Scale, ..MapFileOptions::default() };
        let files = MapFiles::write_all(&target, &document, &scale).unwrap();
        assert!(files[2].ends_with("map_scale.png"));
        assert!((map_server::read(&files[3]).unwrap().1.probability[0] - 0.88).abs() < 0.003);
    }

    #[test]
    fn doubt_has_files_where_it_was_kept() {
        let folder = tempfile::tempdir().unwrap();
        let mut document = document();
        document.doubt = Some(document.grid.clone());
        let files = MapFiles::write_all(folder.path(), &document, &MapFileOptions::default()).unwrap();
        let names: Vec<_> = files.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names[5..], ["doubt.png", "doubt.npy"]);
        assert!(files.iter().all(|file| file.exists()));
        let options = MapFileOptions { formats: vec![MapFormat::Pgm], ..MapFileOptions::default() };
        assert_eq!(MapFiles::write_all(folder.path(), &document, &options).unwrap().len(), 2);
    }

    #[test]
    fn facing_has_files_where_it_was_told() {
        let folder = tempfile::tempdir().unwrap();
        let mut document = document();
        document.facing = Some(Grid::new(document.grid.resolution_m()));
        let files = MapFiles::write_all(folder.path(), &document, &MapFileOptions::default()).unwrap();
        let names: Vec<_> = files.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names[5..], ["facing.png", "facing.npy"]);
        assert!(files.iter().all(|file| file.exists()));
    }

    #[test]
    fn what_is_not_chosen_is_not_written() {
        let check = |formats: &[MapFormat], expected: &[&str]| {
            let folder = tempfile::tempdir().unwrap();
            let options = MapFileOptions { formats: formats.to_vec(), ..MapFileOptions::default() };
            let mut files = MapFiles::write_all(folder.path(), &document(), &options).unwrap();
            assert_eq!(files, expected.iter().map(|name| folder.path().join(name)).collect::<Vec<_>>());
            let mut there: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).collect();
            files.sort();
            there.sort();
            assert_eq!(there, files);
        };
        check(&[MapFormat::Png], &["map.png"]);
        check(&[MapFormat::Pgm], &["map.pgm", "map.yaml"]);
        check(&[MapFormat::Npy], &["map.yaml", "map.npy"]);
        check(&[MapFormat::Npy, MapFormat::Pgm], &["map.pgm", "map.yaml", "map.npy"]);
        check(&[MapFormat::Echogrid], &["map.echogrid"]);
    }

    #[test]
    fn an_array_alone_has_its_geometry_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let options = MapFileOptions { formats: vec![MapFormat::Npy], ..MapFileOptions::default() };
        MapFiles::write_all(folder.path(), &document(), &options).unwrap();
        let text = std::fs::read_to_string(folder.path().join("map.yaml")).unwrap();
        let yaml = map_server::MapYaml::parse(&text).unwrap();
        assert_eq!((yaml.image.as_str(), yaml.resolution_m, yaml.origin), ("map.npy", 0.05, [0.25, -3.5, 0.0]));
    }

    #[test]
    fn thresholds_decide_and_are_told() {
        // The one cell has log-odds 2: p = 0.88.
        let check = |occupied: f64, free: f64, expected: Option<f32>| {
            let folder = tempfile::tempdir().unwrap();
            let thresholds = Thresholds { occupied, free };
            let options = MapFileOptions { formats: vec![MapFormat::Pgm], thresholds, ..MapFileOptions::default() };
            MapFiles::write_all(folder.path(), &document(), &options).unwrap();
            let (yaml, map) = map_server::read(&folder.path().join("map.yaml")).unwrap();
            assert_eq!((yaml.occupied_thresh, yaml.free_thresh), (occupied, free));
            assert_eq!(map.probability_at(0, 0), expected, "{thresholds:?}");
        };
        check(0.65, 0.196, Some(1.0));
        check(0.95, 0.196, None);
        check(0.95, 0.25, None);
        check(0.95, 0.9, Some(0.0));
    }

    #[test]
    fn a_folder_that_cannot_be_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let document = MapDocument {
            grid: Grid::new(0.05),
            doubt: None,
            facing: None,
            path: Vec::new(),
            provenance: Provenance::default(),
        };
        let error = MapFiles::write_all(&file.path().join("maps"), &document, &MapFileOptions::default()).unwrap_err();
        assert!(error.to_string().contains("maps"), "{error}");
    }
}
