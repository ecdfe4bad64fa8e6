//! `lone`: crosstalk and other ghosts, heard by one sonar that no other supports: neither its neighbours in the ring nor
//! any other in the rings before.

//!
//! Where few sonars are used, each looks its own way and none could support another: then nothing is lone.

use super::ring::Ring;
use crate::verdict::Verdict;

/// Fewer sonars are no ring.
const RING_MIN: usize = 6;

/// Whether so many sonars can support each other.
pub(crate) fn is_ring(sonars: usize) -> bool {
    sonars >= RING_MIN
}

pub(crate) fn judge(ring: &mut Ring) {
    ring.support();
    let lone: Vec<usize> =
        ring.standing().filter(|(_, standing)| !standing.supported).map(|(place, _)| place).collect();
    ring.refuse(&lone, Verdict::Lone);
}
