//! `stuck`: sonars that lie for long. A stuck one repeats a value while the robot moves, a blocked one claims obstacles
//! where other sonars see through.
//!
//! Neither is a sin by itself: a sonar that looks at the wall along which the robot drives repeats itself too, and who
//! hears the echo of a mirror sees through walls. So a sonar is judged by what it says over time, and only where others
//! contradict it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::claim::{Claim, distance_m};
use super::ring::{Ring, Standing};
use crate::verdict::Verdict;

/// A range is the same as before within this, metres.
const SAME_M: f64 = 0.02;
/// A radian turned counts like so much way, metres.
const TURN_M: f64 = 0.5;
/// Readings that a sonar must repeat, besides.
const REPEATS: u32 = 8;
/// Share of a single reading in what is thought of a sonar.
const SHARE: f64 = 1.0 / 12.0;
/// A sonar that repeats itself is stuck when it is wrong in this share of the repetitions.
const WRONG_REPEATING: f64 = 0.25;
/// A sonar is blocked when it sees obstacles that are none this often …
const WRONG: f64 = 0.6;
/// … and sound again when it does so less often.
const WRONG_NO_MORE: f64 = 0.3;
/// Others see through an arc if they see this much farther, metres …
const THROUGH_M: f64 = 0.2;
/// … over so much of it.
const SAMPLES_CLEARED: u32 = 4;
/// Points this far from its rim do not invade a bubble, metres.
const INVADED_M: f64 = 0.1;

/// What is thought of each sonar.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Health {
    sonars: BTreeMap<u16, Sonar>,
}

/// What is thought of one sonar.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Sonar {
    /// The range that it repeats, metres.
    same_m: f64,
    repeats: u32,
    /// How often it was wrong meanwhile.
    wrong: u32,
    /// Way that it went meanwhile, metres.
    went_m: f64,
    before: Option<Claim>,
    /// How often, lately, it saw an obstacle where there is none: a share.
    imagines: f64,
    stuck: bool,
    blocked: bool,
    faulty: bool,
}

/// What other sonars make of a claim.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Opinion {
    Supported,
    /// They see through it.
    Nothing,
    /// They see something in the way.
    Something,
    None,
}

impl Health {
    /// A sonar that repeats itself over `stuck_after_m` (metres) may be stuck.
    pub(crate) fn judge(&mut self, ring: &mut Ring, stuck_after_m: f64) {
        // Who is known to lie is no witness.
        let suspects: Vec<(usize, Standing)> = ring.standing().map(|(place, standing)| (place, *standing)).collect();
        let known = |standing: &Standing| self.sonars.get(&standing.claim.transducer).is_some_and(|s| s.faulty);
        let liars: Vec<usize> = suspects.iter().filter(|(_, s)| known(s)).map(|(place, _)| *place).collect();
        ring.refuse(&liars, Verdict::Stuck);
        ring.support();
        let mut stuck = Vec::new();
        for (place, standing) in suspects {
            let supported = ring.present.get(place).is_some_and(|now| now.supported);
            let opinion = opinion(ring, &standing.claim, supported);
            let sonar = self.sonars.entry(standing.claim.transducer).or_default();
            if sonar.is_faulty(&standing.claim, opinion, stuck_after_m) {
                stuck.push(place);
            } else {
                // Sound again, perhaps.
                ring.readmit(place);
            }
        }
        ring.refuse(&stuck, Verdict::Stuck);
    }
}

fn opinion(ring: &Ring, claim: &Claim, supported: bool) -> Opinion {
    if supported {
        return Opinion::Supported;
    }
    let (mut cleared, mut invaded) = (0, false);
    let bubble = claim.bubble();
    for other in ring.supported_others(claim.transducer) {
        cleared |= other.clears(claim, THROUGH_M);
        invaded |= bubble.holds(other.end(), INVADED_M);
    }
    if cleared.count_ones() >= SAMPLES_CLEARED {
        Opinion::Nothing
    } else if invaded {
        Opinion::Something
    } else {
        Opinion::None
    }
}

impl Sonar {
    fn is_faulty(&mut self, claim: &Claim, opinion: Opinion, stuck_after_m: f64) -> bool {
        self.repeat(claim, matches!(opinion, Opinion::Nothing | Opinion::Something));
        let wrong = f64::from(self.wrong) >= WRONG_REPEATING * f64::from(self.repeats);
        // Until it tells another range.
        self.stuck |= self.repeats >= REPEATS && self.went_m >= stuck_after_m && wrong;
        if opinion != Opinion::None {
            self.imagines += SHARE * (f64::from(u8::from(opinion == Opinion::Nothing)) - self.imagines);
        }
        self.blocked = self.imagines >= if self.blocked { WRONG_NO_MORE } else { WRONG };
        self.faulty = self.stuck || self.blocked;
        self.faulty
    }

    fn repeat(&mut self, claim: &Claim, wrong: bool) {
        if (claim.range_m - self.same_m).abs() <= SAME_M {
            self.repeats = self.repeats.saturating_add(1);
            self.went_m += self.before.map_or(0.0, |before| {
                // The middle of the arc goes with the transducer and turns around it.
                let turned_rad = before.turned_rad(claim);
                distance_m(before.origin, claim.origin) + TURN_M * turned_rad
            });
        } else {
            (self.same_m, self.repeats, self.went_m, self.wrong) = (claim.range_m, 1, 0.0, 0);
            self.stuck = false;
        }
        self.wrong = self.wrong.saturating_add(u32::from(wrong));
        self.before = Some(*claim);
    }
}
