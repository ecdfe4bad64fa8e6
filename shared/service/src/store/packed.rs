//! Parts of a state, packed: most of what a mapper keeps repeats itself.
//!
//! A byte says whether what follows is packed (LZ4, its length before it) or plain; a state of an earlier version hardly begins with either.

use anyhow::{Result, bail, ensure};

/// What is shorter is stored as it is.
const WORTH_IT: usize = 256;
const PLAIN: u8 = 0xE0;
const PACKED: u8 = 0xE1;
/// LZ4 makes no more of a byte, and some of nothing.
const GROWS_BY: usize = 255;

/// `bytes` as they are stored.
pub(super) fn pack(bytes: &[u8]) -> Vec<u8> {
    if bytes.len() >= WORTH_IT {
        let packed = lz4_flex::block::compress_prepend_size(bytes);
        if packed.len() < bytes.len() {
            return [&[PACKED], packed.as_slice()].concat();
        }
    }
    [&[PLAIN], bytes].concat()
}

/// What was packed.
///
/// # Errors
/// It is damaged.
pub(super) fn unpack(stored: &[u8]) -> Result<Vec<u8>> {
    const DAMAGED: &str = "a stored state is of another version, or damaged";
    match stored.split_first() {
        Some((&PLAIN, bytes)) => Ok(bytes.to_vec()),
        Some((&PACKED, packed)) => {
            let (size, rest) = lz4_flex::block::uncompressed_size(packed).map_err(|_| anyhow::anyhow!(DAMAGED))?;
            // Nobody reserves what can't come.
            ensure!(size / GROWS_BY <= rest.len(), DAMAGED);
            Ok(lz4_flex::block::decompress(rest, size).map_err(|error| anyhow::anyhow!("{DAMAGED} ({error})"))?)
        }
        _ => bail!(DAMAGED),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_repeats_itself_is_small() {
        let bytes: Vec<u8> = (0..4096_u32).flat_map(|n| (n / 16).to_le_bytes()).collect();
        assert!(pack(&bytes).len() < bytes.len() / 4);
        assert_eq!(unpack(&pack(&bytes)).unwrap(), bytes);
    }

    #[test]
    fn what_is_damaged_is_refused() {
        for stored in [&[][..], &[7, 1, 2], &[PACKED], &[PACKED, 255, 255, 255, 255, 0], &[PACKED, 9, 0, 0, 0, 0x10]] {
            assert!(unpack(stored).is_err(), "{stored:?}");
        }
    }

    proptest! {
        #[test]
        fn anything_comes_back(bytes in prop::collection::vec(0..4_u8, 0..1000)) {
            prop_assert_eq!(unpack(&pack(&bytes)).unwrap(), bytes);
        }

        #[test]
        fn no_bytes_make_it_panic(stored in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = unpack(&stored);
        }
    }
}
