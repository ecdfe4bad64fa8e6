//! `bubble`: the bubble circle threshold (Lee & Chung 2006), which the paper tried against multiple reflections.
//!
//! A reading z claims that its cone is empty up to z. Its bubble is the largest circle inside the claimed cone and
//! tangent to its arc. Where the end point of another reading lies inside, the claim is false. That other reading may be
//! the false one: it counts only if it is supported by yet another sonar, so that one sonar that lies throws out nobody.

use super::ring::Ring;
use crate::verdict::Verdict;

/// Points within `tolerance_m` (metres) of the bubble's rim do not invade it.
pub(crate) fn judge(ring: &mut Ring, tolerance_m: f64) {
    ring.support();
    let invaded: Vec<usize> = ring
        .standing()
        .filter(|(_, standing)| {
            let bubble = standing.claim.bubble();
            ring.supported_but(&standing.claim).any(|other| bubble.holds(other.end(), tolerance_m))
        })
        .map(|(place, _)| place)
        .collect();
    ring.refuse(&invaded, Verdict::MultipleReflection);
}
