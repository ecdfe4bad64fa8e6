//! Occupancy to an image and a YAML.

use std::path::{Path, PathBuf};

use image::ExtendedColorType;

use super::{MapMode, MapYaml};
use crate::map::picture::encode_png;
use crate::map::{MapError, OccupancyMap};
use crate::whole_file::write_together;

const OCCUPIED: u8 = 0;
const FREE: u8 = 254;
const UNKNOWN: u8 = 205;
const UNKNOWN_RAW: u8 = 255;

/// The probabilities from which on a cell is occupied or free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    /// A cell is occupied above this probability.
    pub occupied: f64,
    /// A cell is free below this probability.
    pub free: f64,
}

impl Default for Thresholds {
    /// As map savers have them: level 205, which every reader of maps takes for unknown, has
    /// darkness 0.196078: just not free.
    fn default() -> Self {
        Self { occupied: 0.65, free: 0.196 }
    }
}

impl Thresholds {
    /// Thresholds that are at least so far apart have a grey level between them, for unknown.
    pub const APART_MIN: f64 = 0.01;

    /// The level that is read as unknown.
    fn unknown_level(self) -> u8 {
        let darkness = 1.0 - f64::from(UNKNOWN) / 255.0;
        // Readers compute in floating point: a level on a threshold may fall to either side.
        if darkness > self.free + 1e-6 && darkness < self.occupied - 1e-6 {
            return UNKNOWN;
        }
        (255.0 * (1.0 - 0.5 * (self.free + self.occupied))).round() as u8
    }

    /// The level that is read as free.
    fn free_level(self) -> u8 {
        if 1.0 - f64::from(FREE) / 255.0 < self.free - 1e-6 { FREE } else { 255 }
    }
}

/// The file name of the image that goes with `stem.yaml`: a PGM, in mode `scale` a PNG.
pub(crate) fn image_name(stem: &str, mode: MapMode) -> String {
    match mode {
        MapMode::Trinary | MapMode::Raw => format!("{stem}.pgm"),
        MapMode::Scale => format!("{stem}_scale.png"),
    }
}

/// Writes `stem.yaml` and its image into a folder: `stem.pgm`, in mode `scale` `stem_scale.png`; both or neither.
/// The paths written, the image first.
///
/// # Errors
/// When a file can't be written.
pub fn write(
    folder: &Path,
    stem: &str,
    map: &OccupancyMap,
    mode: MapMode,
    thresholds: Thresholds,
) -> Result<Vec<PathBuf>, MapError> {
    let files = files(folder, stem, map, mode, thresholds)?;
    write_together(&files)?;
    Ok(files.into_iter().map(|(path, _)| path).collect())
}

/// What [`write`] writes, path and bytes.
pub(crate) fn files(
    folder: &Path,
    stem: &str,
    map: &OccupancyMap,
    mode: MapMode,
    thresholds: Thresholds,
) -> Result<[(PathBuf, Vec<u8>); 2], MapError> {
    let image = image_name(stem, mode);
    let bytes = encode_image(map, mode, thresholds)?;
    let yaml = yaml(map, mode, thresholds, image.clone()).to_string();
    Ok([(folder.join(image), bytes), (folder.join(format!("{stem}.yaml")), yaml.into_bytes())])
}

/// The YAML of an array that has no image beside it: where it lies, and how large its cells are.
pub(crate) fn array_yaml(map: &OccupancyMap, thresholds: Thresholds, array: String) -> Vec<u8> {
    let yaml = yaml(map, MapMode::Trinary, thresholds, array);
    format!("# Resolution and origin of a NumPy array of probabilities; no image for map_server.\n{yaml}").into_bytes()
}

/// The YAML that goes with an image written in a mode.
pub(super) fn yaml(map: &OccupancyMap, mode: MapMode, thresholds: Thresholds, image: String) -> MapYaml {
    let (occupied_thresh, free_thresh) = match mode {
        // Others would stretch the levels between them: p would come back as another.
        MapMode::Scale => (1.0, 0.0),
        MapMode::Trinary | MapMode::Raw => (thresholds.occupied, thresholds.free),
    };
    let corner = map.map_from_corner;
    MapYaml {
        image,
        resolution_m: map.resolution_m,
        origin: [corner.x, corner.y, corner.theta],
        negate: false,
        occupied_thresh,
        free_thresh,
        mode,
    }
}

/// The image of a map: a PGM file's bytes, or in mode `scale` a PNG file's.
///
/// # Errors
/// When the map is too large for a PNG.
pub fn encode_image(map: &OccupancyMap, mode: MapMode, thresholds: Thresholds) -> Result<Vec<u8>, MapError> {
    let rows = map.probability.chunks_exact(map.width.max(1)).rev();
    if mode == MapMode::Scale {
        let pixel = |p: &f32| {
            let level = ((1.0 - p) * 255.0).round() as u8;
            if p.is_nan() { [UNKNOWN, UNKNOWN, UNKNOWN, 0] } else { [level, level, level, 255] }
        };
        let pixels: Vec<u8> = rows.flatten().flat_map(pixel).collect();
        return encode_png(&pixels, map.width, map.height, ExtendedColorType::Rgba8);
    }
    let mut pgm = format!("P5\n{} {}\n255\n", map.width, map.height).into_bytes();
    if mode == MapMode::Raw {
        pgm.extend(rows.flatten().map(|p| raw_level(*p)));
        return Ok(pgm);
    }
    let (free, unknown) = (thresholds.free_level(), thresholds.unknown_level());
    pgm.extend(rows.flatten().map(|p| match f64::from(*p) {
        p if p > thresholds.occupied => OCCUPIED,
        p if p < thresholds.free => free,
        _ => unknown,
    }));
    Ok(pgm)
}

fn raw_level(p: f32) -> u8 {
    if p.is_nan() { UNKNOWN_RAW } else { (p.clamp(0.0, 1.0) * 100.0).round() as u8 }
}
