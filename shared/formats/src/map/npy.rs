//! `map.npy`: probabilities for NumPy.
//!
//! `numpy.load("map.npy")` gives a float32 array `[row, column]`, row 0 at the lowest y, column 0 at
//! the lowest x; unknown cells are NaN. Resolution and origin stand in the YAML beside it. NPY
//! format 1.0, C order, little-endian.

use super::OccupancyMap;

/// The map as an NPY file's bytes.
#[must_use]
pub fn encode(map: &OccupancyMap) -> Vec<u8> {
    encode_array(map.width, map.height, &map.probability)
}

/// Numbers `[row * width + column]` as an NPY file's bytes.
pub(super) fn encode_array(width: usize, height: usize, numbers: &[f32]) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    // Magic, version and length take 10 bytes; all of the header ends in a line feed at a multiple of 64.
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut npy = b"\x93NUMPY\x01\x00".to_vec();
    npy.extend_from_slice(&u16::try_from(header.len()).unwrap_or(u16::MAX).to_le_bytes());
    npy.extend_from_slice(header.as_bytes());
    npy.reserve(numbers.len() * 4);
    for number in numbers {
        npy.extend_from_slice(&if number.is_nan() { f32::NAN } else { *number }.to_le_bytes());
    }
    npy
}

#[cfg(test)]
mod tests {
    use echogrid_core::Pose2;

    use super::*;

    #[test]
    fn layout() {
        let map = OccupancyMap {
            width: 3,
            height: 1,
            resolution_m: 0.05,
            map_from_corner: Pose2::IDENTITY,
            probability: vec![0.25, f32::NAN, 1.0],
        };
        let npy = encode(&map);
        assert_eq!(&npy[..8], b"\x93NUMPY\x01\x00");
        let header = usize::from(u16::from_le_bytes([npy[8], npy[9]]));
        assert_eq!((10 + header) % 64, 0);
        assert!(core::str::from_utf8(&npy[10..10 + header]).unwrap().contains("'shape': (1, 3)"));
        let cells = &npy[10 + header..];
        assert_eq!(cells.len(), 12);
        assert_eq!(&cells[..4], 0.25_f32.to_le_bytes());
        assert_eq!(&cells[4..8], f32::NAN.to_le_bytes());
    }
}
