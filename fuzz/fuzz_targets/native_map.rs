//! Any bytes as a native map; checksums are put right, or the fuzzer would never get past them.
#![no_main]

use echogrid_formats::map::native::{MAGIC, decode, encode};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let _ = decode(bytes);
    // All tiles in one stream, and in a section of their own
    for version in [2_u32, 3] {
        there_and_back(version, bytes);
    }
});

fn there_and_back(version: u32, bytes: &[u8]) {
    let mut file = MAGIC.to_vec();
    file.extend(version.to_le_bytes());
    // Sections: a length of two bytes, then the content.
    let mut rest = bytes;
    for tag in [b"GRID", b"PROV", b"PATH", b"TILE", b"doub", b"END "] {
        let Some((length, after)) = rest.split_at_checked(2) else { break };
        let length = usize::from(u16::from_le_bytes([length[0], length[1]])).min(after.len());
        let (content, after) = after.split_at(length);
        rest = after;
        let start = file.len();
        file.extend(tag);
        file.extend((content.len() as u64).to_le_bytes());
        file.extend(content);
        file.extend(crc32fast::hash(&file[start..]).to_le_bytes());
    }
    if let Ok(document) = decode(&file) {
        let again = encode(&document).expect("what was read can be written");
        assert_eq!(encode(&decode(&again).expect("what was written can be read")), Ok(again));
    }
}
