//! What the sonars say in one scan, and what they said in the scans before.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::claim::Claim;
use crate::odometry::Estimate;
use crate::verdict::Verdict;

/// So many sonars of a scan are judged by each other: no description of a robot holds more.
const CLAIMS_MAX: usize = crate::robot::SENSORS_MAX;
/// Where the map moves under the robot by more, what was heard before is in the wrong place, metres.
const JUMP_M: f64 = 0.1;
/// What a turn moves is so far away, metres.
const ARM_M: f64 = 2.0;

/// A claim of the present scan.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Standing {
    /// Of its reading in the scan.
    pub(crate) index: usize,
    pub(crate) claim: Claim,
    /// Why it was refused, if it was.
    pub(crate) refusal: Option<Verdict>,
    /// Whether another sonar says so too.
    pub(crate) supported: bool,
}

/// A claim of a scan before.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Witness {
    claim: Claim,
    supported: bool,
}

/// The claims of the scan that is being judged, and those of the rings before it that still count.
#[derive(Debug, Clone)]
pub(crate) struct Ring {
    pub(crate) present: Vec<Standing>,
    pub(crate) past: Past,
    /// So many rings are remembered.
    memory: usize,
    bubble_memory: usize,
    tolerance_m: f64,
    /// Somebody was refused who may have supported others.
    stale: bool,
}

/// What is remembered from scan to scan.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Past {
    /// The latest first.
    rings: VecDeque<Vec<Witness>>,
    before: Option<Estimate>,
}

impl Ring {
    /// Claims whose arcs come within `tolerance_m` (metres) support each other.
    pub(crate) fn new(memory: usize, bubble_memory: usize, tolerance_m: f64) -> Self {
        Self { present: Vec::new(), past: Past::default(), memory, bubble_memory, tolerance_m, stale: true }
    }

    /// A scan begins.
    pub(crate) fn begin(&mut self, claims: impl Iterator<Item = (usize, Claim)>, estimate: Option<&Estimate>) {
        self.present.clear();
        let standing = |(index, claim)| Standing { index, claim, refusal: None, supported: false };
        self.present.extend(claims.take(CLAIMS_MAX).map(standing));
        self.stale = true;
        if let Some(estimate) = estimate {
            // A fix moves the robot, and not what it heard before.
            if self.past.before.is_some_and(|before| before.fixes != estimate.fixes && jump_m(&before) > JUMP_M) {
                self.past.rings.clear();
            }
            self.past.before = Some(*estimate);
        }
    }

    /// The claims that nobody refused are the past of the next scan. So are lone ones: what is seen for the first time is.
    pub(crate) fn end(&mut self) {
        self.support();
        let counts = |standing: &&Standing| matches!(standing.refusal, None | Some(Verdict::Lone));
        let witness = |standing: &Standing| Witness { claim: standing.claim, supported: standing.supported };
        let ring: Vec<Witness> = self.present.iter().filter(counts).map(witness).collect();
        if !ring.is_empty() {
            self.past.rings.push_front(ring);
            self.past.rings.truncate(self.memory.max(self.bubble_memory));
        }
    }

    /// Refuses claims of the present scan, by their place in it.
    pub(crate) fn refuse(&mut self, places: &[usize], verdict: Verdict) {
        for place in places {
            if let Some(standing) = self.present.get_mut(*place) {
                standing.refusal = standing.refusal.or(Some(verdict));
            }
        }
        // Who is lone supports nobody, because support is mutual.
        self.stale |= !places.is_empty() && verdict != Verdict::Lone;
    }

    /// Takes back that a claim of the present scan was refused.
    pub(crate) fn readmit(&mut self, place: usize) {
        if let Some(standing) = self.present.get_mut(place) {
            self.stale |= standing.refusal.take().is_some();
        }
    }

    /// Finds out which claims of the present scan are supported by another sonar, now or before.
    pub(crate) fn support(&mut self) {
        if !std::mem::replace(&mut self.stale, false) {
            return;
        }
        let supported: Vec<bool> = self
            .present
            .iter()
            .map(|one| {
                self.others(one.claim.transducer).any(|other| one.claim.agrees_with(&other.claim, self.tolerance_m))
            })
            .collect();
        for (standing, supported) in self.present.iter_mut().zip(supported) {
            standing.supported = supported;
        }
    }

    /// The places of the claims that stand.
    pub(crate) fn standing(&self) -> impl Iterator<Item = (usize, &Standing)> {
        self.present.iter().enumerate().filter(|(_, standing)| standing.refusal.is_none())
    }

    /// What other sonars say, now or before.
    fn others(&self, transducer: u16) -> impl Iterator<Item = Witness> {
        self.all(self.memory).filter(move |witness| witness.claim.transducer != transducer)
    }

    /// What other sonars say that is supported by more than one, now or before.
    pub(crate) fn supported_others(&self, transducer: u16) -> impl Iterator<Item = Claim> {
        self.others(transducer).filter(|witness| witness.supported).map(|witness| witness.claim)
    }

    /// All that is said and supported, now or before, but for a claim of the present scan.
    pub(crate) fn supported_but(&self, claim: &Claim) -> impl Iterator<Item = Claim> {
        self.all(self.bubble_memory)
            .filter(|witness| witness.supported && witness.claim != *claim)
            .map(|witness| witness.claim)
    }

    /// Of the present, and of so many rings before.
    fn all(&self, rings: usize) -> impl Iterator<Item = Witness> {
        let present = self.present.iter().filter(|standing| standing.refusal.is_none());
        let present = present.map(|standing| Witness { claim: standing.claim, supported: standing.supported });
        present.chain(self.past.rings.iter().take(rings).flatten().copied())
    }
}

/// By how much a fix may have moved a robot that doubted its place so, metres: one standard deviation.
fn jump_m(before: &Estimate) -> f64 {
    let c = &before.covariance;
    libm::sqrt((c[(0, 0)] + c[(1, 1)] + ARM_M * ARM_M * c[(2, 2)]).max(0.0))
}
