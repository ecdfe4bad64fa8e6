//! An image and a YAML to occupancy, as map_server reads them.

use std::io::Cursor;
use std::path::Path;

use echogrid_core::Pose2;
use image::{ImageFormat, ImageReader, Limits, Rgba};

use super::{MapMode, MapYaml, SIDE_MAX};
use crate::map::{MapError, OccupancyMap};
use crate::read_at_most;

/// Memory that an image may take, bytes.
const ALLOCATION_MAX: u64 = 1 << 31;
/// Longest file of an image, bytes.
const IMAGE_BYTES_MAX: u64 = 1 << 30;
/// Longest YAML that is read, bytes; [`MapYaml::parse`] takes less.
const YAML_BYTES_MAX: u64 = 1 << 20;

/// Reads the map that a YAML file names.
///
/// # Errors
/// When the YAML or the image can't be read, or is wrong.
pub fn read(yaml_path: &Path) -> Result<(MapYaml, OccupancyMap), MapError> {
    let bytes = read_at_most(yaml_path, YAML_BYTES_MAX).map_err(|source| MapError::read(yaml_path, source))?;
    let yaml = MapYaml::parse(&String::from_utf8_lossy(&bytes))
        .map_err(|source| MapError::Yaml { path: yaml_path.to_path_buf(), source })?;
    let image_path = yaml_path.parent().unwrap_or(Path::new("")).join(&yaml.image);
    let image = read_at_most(&image_path, IMAGE_BYTES_MAX).map_err(|source| MapError::read(&image_path, source))?;
    let map = read_image(&image, &yaml).map_err(|what| MapError::Image { path: image_path, what })?;
    Ok((yaml, map))
}

/// Reads the image of a map: PGM, PPM or PNG, told by its content. An error says what is wrong with it.
///
/// # Errors
/// When the bytes are no such image, or a side is longer than [`SIDE_MAX`].
pub fn read_image(bytes: &[u8], yaml: &MapYaml) -> Result<OccupancyMap, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|error| error.to_string())?;
    match reader.format() {
        Some(ImageFormat::Png | ImageFormat::Pnm) => {}
        _ => return Err(format!("it begins with \"{}\"", bytes.get(..16).unwrap_or(bytes).escape_ascii())),
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(SIDE_MAX);
    limits.max_image_height = Some(SIDE_MAX);
    limits.max_alloc = Some(ALLOCATION_MAX);
    reader.limits(limits);
    let image = reader.decode().map_err(|error| error.to_string())?;
    let has_alpha = image.color().has_alpha();
    let image = image.into_rgba8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let mut probability = Vec::with_capacity(width * height);
    for row in image.rows().rev() {
        probability.extend(row.map(|pixel| occupancy(*pixel, has_alpha, yaml)));
    }
    let [x, y, yaw] = yaml.origin;
    let map_from_corner = Pose2::new(x, y, yaw);
    Ok(OccupancyMap { width, height, resolution_m: yaml.resolution_m, map_from_corner, probability })
}

/// What a pixel says; NaN is unknown.
fn occupancy(Rgba([red, green, blue, alpha]): Rgba<u8>, has_alpha: bool, yaml: &MapYaml) -> f32 {
    let sum = u32::from(red) + u32::from(green) + u32::from(blue);
    // In this mode map_server counts opacity as a fourth colour.
    let brightness = if has_alpha && yaml.mode == MapMode::Trinary {
        f64::from(sum + u32::from(alpha)) / (4.0 * 255.0)
    } else {
        f64::from(sum) / (3.0 * 255.0)
    };
    let occupied = if yaml.negate { brightness } else { 1.0 - brightness };
    match yaml.mode {
        MapMode::Trinary if occupied > yaml.occupied_thresh => 1.0,
        MapMode::Trinary if occupied < yaml.free_thresh => 0.0,
        MapMode::Trinary => f32::NAN,
        MapMode::Scale if alpha != 255 => f32::NAN,
        MapMode::Scale if occupied > yaml.occupied_thresh => 1.0,
        MapMode::Scale if occupied < yaml.free_thresh => 0.0,
        MapMode::Scale if yaml.occupied_thresh <= yaml.free_thresh => occupied as f32,
        MapMode::Scale => ((occupied - yaml.free_thresh) / (yaml.occupied_thresh - yaml.free_thresh)) as f32,
        MapMode::Raw => {
            let percent = (brightness * 255.0).round();
            if percent <= 100.0 { (percent / 100.0) as f32 } else { f32::NAN }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::Thresholds;
    use super::super::write::{encode_image, yaml};
    use super::*;

    fn map(probability: Vec<f32>, width: usize) -> OccupancyMap {
        let height = probability.len() / width;
        OccupancyMap { width, height, resolution_m: 0.1, map_from_corner: Pose2::new(-1.0, 2.0, 0.0), probability }
    }

    const USUAL: Thresholds = Thresholds { occupied: 0.65, free: 0.196 };

    fn there_and_back(map: &OccupancyMap, mode: MapMode, thresholds: Thresholds) -> OccupancyMap {
        let yaml = MapYaml::parse(&yaml(map, mode, thresholds, "map.pgm".into()).to_string()).unwrap();
        read_image(&encode_image(map, mode, thresholds).unwrap(), &yaml).unwrap()
    }

    #[test]
    fn rows_keep_their_place() {
        let map = map(vec![0.0, 1.0, f32::NAN, 0.0, 1.0, 1.0], 2);
        for mode in [MapMode::Trinary, MapMode::Scale, MapMode::Raw] {
            let back = there_and_back(&map, mode, USUAL);
            assert_eq!((back.width, back.height), (2, 3));
            assert_eq!((back.probability_at(1, 0), back.probability_at(0, 1)), (Some(1.0), None));
            assert_eq!(back.map_from_corner, map.map_from_corner);
        }
    }

    #[test]
    fn others_205_is_unknown_or_free_as_their_thresholds_say() {
        let mut yaml = yaml(&map(vec![0.5], 1), MapMode::Trinary, USUAL, "a.pgm".into());
        let image = b"P5\n1 1\n255\n\xcd";
        assert_eq!(read_image(image, &yaml).unwrap().probability_at(0, 0), None);
        yaml.free_thresh = 0.25;
        assert_eq!(read_image(image, &yaml).unwrap().probability_at(0, 0), Some(0.0));
    }

    #[test]
    fn colours_are_averaged_and_may_be_negated() {
        let mut yaml = yaml(&map(vec![0.5], 1), MapMode::Scale, USUAL, "a.ppm".into());
        let image = b"P6\n1 1\n255\n\xff\x00\x00";
        let p = read_image(image, &yaml).unwrap().probability[0];
        assert!((p - 2.0 / 3.0).abs() < 1e-6);
        yaml.negate = true;
        assert!((read_image(image, &yaml).unwrap().probability[0] - 1.0 / 3.0).abs() < 1e-6);
    }

    #[test]
    fn no_image_no_map() {
        let yaml = yaml(&map(vec![0.5], 1), MapMode::Trinary, USUAL, "a.pgm".into());
        for bytes in [b"".as_slice(), b"P5", b"GIF89a", b"P5\n999999999 999999999\n255\n", b"P5\n2 2\n255\n\x00"] {
            assert!(read_image(bytes, &yaml).is_err());
        }
    }

    proptest! {
        #[test]
        fn unknown_and_only_unknown_comes_back_as_unknown(
            cells in prop::collection::vec(prop::option::weighted(0.7, 0.0_f32..=1.0), 1..40),
            free in 0.001..0.98, apart in 0.0..1.0_f64,
        ) {
            let map = map(cells.iter().map(|p| p.unwrap_or(f32::NAN)).collect(), cells.len());
            for (mode, tolerance) in [(MapMode::Scale, 0.002), (MapMode::Raw, 0.005001)] {
                for (before, after) in map.probability.iter().zip(there_and_back(&map, mode, USUAL).probability) {
                    prop_assert!((before.is_nan() && after.is_nan()) || (before - after).abs() <= tolerance);
                }
            }
            let occupied = free + Thresholds::APART_MIN + apart * (0.999 - free - Thresholds::APART_MIN);
            for thresholds in [USUAL, Thresholds { occupied, free }] {
                let back = there_and_back(&map, MapMode::Trinary, thresholds);
                for (before, after) in map.probability.iter().zip(back.probability) {
                    let expected = match f64::from(*before) {
                        p if p > thresholds.occupied => 1.0,
                        p if p < thresholds.free => 0.0,
                        _ => f32::NAN,
                    };
                    prop_assert!(after == expected || (after.is_nan() && expected.is_nan()), "{thresholds:?}");
                }
            }
        }
    }
}
