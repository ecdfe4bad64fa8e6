//! Any bytes as what a robot's serial line gives: packets are found however the bytes come in pieces, and can be read or not.
#![no_main]

use echogrid_arcos::{Argument, Command, Configuration, Decoder, Found, Identity, Packet, Sip};
use libfuzzer_sys::fuzz_target;

fn decode(bytes: &[u8], piece: usize) -> (Vec<Found>, u64) {
    let mut decoder = Decoder::default();
    let mut found = Vec::new();
    for bytes in bytes.chunks(piece) {
        decoder.push(bytes);
        found.extend(std::iter::from_fn(|| decoder.next_packet()));
    }
    found.extend(std::iter::from_fn(|| decoder.last_packet()));
    (found, decoder.skipped())
}

fuzz_target!(|bytes: &[u8]| {
    let Some((piece, bytes)) = bytes.split_first() else { return };
    let (found, skipped) = decode(bytes, usize::from(*piece).max(1));
    assert_eq!((&found, skipped), (&decode(bytes, bytes.len().max(1)).0, decode(bytes, 1).1));
    let in_packets: usize = found.iter().map(|found| found.packet.bytes().len()).sum();
    assert_eq!(in_packets as u64 + skipped, bytes.len() as u64);
    for Found { packet, at } in &found {
        let at = *at as usize;
        assert_eq!(&bytes[at..at + packet.bytes().len()], packet.bytes());
        assert_eq!(Packet::new(packet.id(), packet.arguments()).as_ref(), Some(packet));
        let _ = (Command::of(packet), Argument::of(packet), Identity::read(packet));
        if let Ok(told) = Configuration::read(packet) {
            assert_eq!(told.packet().map(|packet| Configuration::read(&packet)), told.packet().map(|_| Ok(told)));
        }
        let Ok(sip) = Sip::read(packet) else { continue };
        let again = sip.packet().map(|packet| Sip::read(&packet));
        let masked = Sip { x: sip.x & 0x7FFF, y: sip.y & 0x7FFF, is_moving: packet.id() == Sip::MOVING, ..sip };
        // One that is too long for a packet by what it gains, or ends in the middle of its later fields, is cut there.
        if let Some(Ok(again)) = again {
            assert_eq!(again, masked);
        }
    }
});
