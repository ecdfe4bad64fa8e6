//! What lidars say, and what is said to them: bytes in, beams out. No I/O, no clock.
//!
//! A decoder finds its way back into a stream that has lost or turned bytes: it goes on byte by byte until what follows is whole, and
//! gives nothing of what is not.

pub mod ld19;
pub mod rplidar;

/// One beam of a turning lidar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Where it looks, radians clockwise from the lidar's front, 0 to 2π.
    pub clockwise_rad: f64,
    /// How far it saw, metres; 0: nothing.
    pub range_m: f64,
    /// Whether the lidar says that a turn begins with it.
    pub begins_turn: bool,
    /// The place in the stream behind the last byte that it was told by, from 0.
    pub at: u64,
}

/// Takes the bytes of a lidar, and gives its beams.
pub trait Decoder: core::fmt::Debug + Send {
    /// Takes what has come.
    fn push(&mut self, bytes: &[u8]);

    /// The next beam, if one is whole.
    fn next_beam(&mut self) -> Option<Beam>;

    /// Bytes that belonged to nothing whole.
    fn skipped(&self) -> u64;

    /// Forgets what is half there: the line was cut.
    fn clear(&mut self);
}

/// Bytes that have come and are not used up, and where in the stream the first of them is.
#[derive(Debug, Default)]
pub(crate) struct Buffer {
    bytes: Vec<u8>,
    used: usize,
    at: u64,
    skipped: u64,
}

impl Buffer {
    pub(crate) fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.used);
        self.used = 0;
        self.bytes.extend_from_slice(bytes);
    }

    pub(crate) fn rest(&self) -> &[u8] {
        self.bytes.get(self.used..).unwrap_or_default()
    }

    /// The place in the stream behind what is used up.
    pub(crate) fn at(&self) -> u64 {
        self.at
    }

    pub(crate) fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Uses bytes up.
    pub(crate) fn take(&mut self, count: usize) {
        self.used += count;
        self.at += count as u64;
    }

    /// Passes over a byte that belongs to nothing.
    pub(crate) fn skip(&mut self) {
        self.take(1);
        self.skipped += 1;
    }

    pub(crate) fn clear(&mut self) {
        let left = self.rest().len();
        self.skipped += left as u64;
        self.take(left);
    }
}
