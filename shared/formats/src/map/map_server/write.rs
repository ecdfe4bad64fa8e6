//! Occupancy to an image and a YAML.

use std::path::{Path, PathBuf};

use image::ExtendedColorType;

use super::{MapMode, MapYaml};
use crate::map::picture::encode_png;
use crate::map::{MapError, OccupancyMap};
use crate::whole_file::write_whole;

const OCCUPIED_THRESH: f64 = 0.65;
/// 205, which every reader of maps takes for unknown, has darkness 0.196078: just not free.
const FREE_THRESH: f64 = 0.196;
const OCCUPIED: u8 = 0;
const FREE: u8 = 254;
const UNKNOWN: u8 = 205;
const UNKNOWN_RAW: u8 = 255;

/// Writes `stem.yaml` and its image into a folder: `stem.pgm`, in mode `scale` `stem_scale.png`.
/// The paths written, the image first.
///
/// # Errors
/// When a file can't be written.
pub fn write(folder: &Path, stem: &str, map: &OccupancyMap, mode: MapMode) -> Result<Vec<PathBuf>, MapError> {
    let image = match mode {
        MapMode::Trinary | MapMode::Raw => format!("{stem}.pgm"),
        MapMode::Scale => format!("{stem}_scale.png"),
    };
    let (image_path, yaml_path) = (folder.join(&image), folder.join(format!("{stem}.yaml")));
    write_whole(&image_path, &encode_image(map, mode)?)?;
    write_whole(&yaml_path, yaml(map, mode, image).to_string().as_bytes())?;
    Ok(vec![image_path, yaml_path])
}

/// The YAML that goes with an image written in a mode.
pub(crate) fn yaml(map: &OccupancyMap, mode: MapMode, image: String) -> MapYaml {
    let (occupied_thresh, free_thresh) = match mode {
        MapMode::Scale => (1.0, 0.0),
        MapMode::Trinary | MapMode::Raw => (OCCUPIED_THRESH, FREE_THRESH),
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
pub fn encode_image(map: &OccupancyMap, mode: MapMode) -> Result<Vec<u8>, MapError> {
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
    let level: fn(f32) -> u8 = if mode == MapMode::Raw { raw_level } else { trinary_level };
    pgm.extend(rows.flatten().map(|p| level(*p)));
    Ok(pgm)
}

fn trinary_level(p: f32) -> u8 {
    let p = f64::from(p);
    if p > OCCUPIED_THRESH {
        OCCUPIED
    } else if p < FREE_THRESH {
        FREE
    } else {
        UNKNOWN
    }
}

fn raw_level(p: f32) -> u8 {
    if p.is_nan() { UNKNOWN_RAW } else { (p.clamp(0.0, 1.0) * 100.0).round() as u8 }
}
