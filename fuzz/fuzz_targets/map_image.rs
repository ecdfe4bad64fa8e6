//! Any bytes as the image of a map.
#![no_main]

use echogrid_formats::map::map_server::{MapMode, MapYaml, Thresholds, encode_image, read_image};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((mode, bytes)) = bytes.split_first() else { return };
    let mode = [MapMode::Trinary, MapMode::Scale, MapMode::Raw][usize::from(mode % 3)];
    let yaml = MapYaml {
        image: "fuzz.pgm".into(),
        resolution_m: 0.05,
        origin: [0.0; 3],
        negate: false,
        occupied_thresh: 0.65,
        free_thresh: 0.196,
        mode,
    };
    if let Ok(map) = read_image(bytes, &yaml) {
        assert_eq!(map.probability.len(), map.width * map.height);
        assert!(map.probability.iter().all(|p| p.is_nan() || (0.0..=1.0).contains(p)));
        let image = encode_image(&map, MapMode::Raw, Thresholds::default()).expect("a PGM has no limits");
        let raw = MapYaml { mode: MapMode::Raw, ..yaml };
        let back = read_image(&image, &raw).expect("what was written can be read");
        assert!(map.probability.iter().zip(&back.probability).all(|(a, b)| a.is_nan() == b.is_nan()));
    }
});
