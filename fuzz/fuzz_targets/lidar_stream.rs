//! Any bytes as what a lidar says: beams are the same however the bytes come in pieces, and each of them can be.
#![no_main]

use echogrid_lidar::Model;
use echogrid_lidar::codec::{Beam, ld19, rplidar};
use libfuzzer_sys::fuzz_target;

fn decode<'a>(model: Model, pieces: impl Iterator<Item = &'a [u8]>) -> (Vec<Beam>, u64) {
    let mut decoder = model.decoder();
    let mut beams = Vec::new();
    for piece in pieces {
        decoder.push(piece);
        beams.extend(core::iter::from_fn(|| decoder.next_beam()));
    }
    (beams, decoder.skipped())
}

fuzz_target!(|bytes: &[u8]| {
    let Some((choice, bytes)) = bytes.split_first() else { return };
    let model = if choice & 1 == 0 { Model::Ld19 } else { Model::RplidarA1 };
    let (whole, skipped) = decode(model, core::iter::once(bytes));
    let size = usize::from(choice >> 1) + 1;
    assert_eq!(decode(model, bytes.chunks(size)), (whole.clone(), skipped));
    for beam in &whole {
        assert!((0.0..core::f64::consts::TAU).contains(&beam.clockwise_rad), "{beam:?}");
        assert!(beam.range_m >= 0.0 && beam.range_m <= 65.535 && beam.at <= bytes.len() as u64, "{beam:?}");
    }
    if let Some(packet) = bytes.first_chunk().and_then(ld19::Packet::read) {
        assert_eq!(packet.bytes(), bytes[..ld19::PACKET_BYTES]);
    }
    if let Some(point) = bytes.first_chunk().and_then(rplidar::Point::read) {
        assert_eq!(point.bytes(), bytes[..rplidar::POINT_BYTES]);
    }
});
