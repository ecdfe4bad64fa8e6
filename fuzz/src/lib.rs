//! What the targets share: numbers out of the bytes that the fuzzer grows, and files that hold them.

pub mod log_files;

/// Takes its numbers from the front; none when too little is left.
pub struct Numbers<'a> {
    /// What is left.
    pub bytes: &'a [u8],
    /// Whether numbers are any at all, or hundredths, of which more make sense.
    pub any: bool,
}

impl Numbers<'_> {
    pub fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.bytes.split_first_chunk()?;
        self.bytes = rest;
        Some(*first)
    }

    pub fn next(&mut self) -> Option<f64> {
        if self.any { self.take().map(f64::from_le_bytes) } else { self.hundredths() }
    }

    pub fn hundredths(&mut self) -> Option<f64> {
        self.take().map(|two| f64::from(i16::from_le_bytes(two)) / 100.0)
    }
}
