//! What became of the readings of each sonar, and which sonars seem to be broken.

use std::collections::BTreeMap;

use echogrid_core::{SILENT_SHARE, Verdict, VerdictCounts};
use serde::Serialize;

/// Of fewer readings nothing is said.
const READINGS_MIN: u64 = 50;
/// A sonar is conspicuous for being stuck in this share of what it heard …
const STUCK: f64 = 0.1;
/// … or for hearing things nearer than a sonar can.
const TOO_NEAR: f64 = 0.5;

/// Readings of a sonar by verdict; those without any are left out.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Sonar {
    /// The number of readings by the name of the verdict.
    pub verdicts: BTreeMap<&'static str, u64>,
}

impl Sonar {
    pub(crate) fn of(counts: &VerdictCounts) -> Self {
        let some = counts.iter().filter(|(_, count)| *count > 0);
        Self { verdicts: some.map(|(verdict, count)| (verdict.name(), count)).collect() }
    }
}

/// What is to be said of sonars that seem to be broken: `sonar 5 is stuck or blocked …`.
pub(crate) fn conspicuous(sonars: &[VerdictCounts]) -> Vec<String> {
    let mut shares: Vec<f64> = sonars.iter().map(heard_share).collect();
    shares.sort_by(f64::total_cmp);
    let usual = shares.get(shares.len() / 2).copied().unwrap_or(0.0);
    sonars
        .iter()
        .enumerate()
        .filter_map(|(number, counts)| Some(format!("sonar {number} {}", says(counts, usual)?)))
        .collect()
}

fn heard(counts: &VerdictCounts) -> u64 {
    counts.total().saturating_sub(counts.get(Verdict::NoEcho)).saturating_sub(counts.get(Verdict::Invalid))
}

fn heard_share(counts: &VerdictCounts) -> f64 {
    share(heard(counts), counts.total())
}

fn share(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}

fn says(counts: &VerdictCounts, usual: f64) -> Option<String> {
    let (total, heard) = (counts.total(), heard(counts));
    if total < READINGS_MIN {
        return None;
    }
    let (stuck, near) = (counts.get(Verdict::Stuck), counts.get(Verdict::BelowMinimum));
    if heard_share(counts) < SILENT_SHARE * usual {
        Some(format!(
            "hears hardly anything: {heard} echoes in {total} readings, while others hear {:.0} %",
            100.0 * usual
        ))
    } else if share(stuck, heard) >= STUCK {
        Some(format!("is stuck or blocked: {stuck} of its {heard} echoes were contradicted by others"))
    } else if share(near, heard) >= TOO_NEAR {
        Some(format!("is blocked: {near} of its {heard} echoes were nearer than the lower range limit"))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(of: &[(Verdict, u64)]) -> VerdictCounts {
        let mut counts = VerdictCounts::default();
        of.iter().for_each(|(verdict, count)| counts.add_many(*verdict, *count));
        counts
    }

    #[test]
    fn broken_sonars_are_named_and_others_are_not() {
        let healthy = counts(&[(Verdict::Accepted, 300), (Verdict::NoEcho, 400), (Verdict::Lone, 100)]);
        let stuck = counts(&[(Verdict::Accepted, 300), (Verdict::Stuck, 250)]);
        let silent = counts(&[(Verdict::Accepted, 10), (Verdict::NoEcho, 790)]);
        let near = counts(&[(Verdict::Accepted, 10), (Verdict::BelowMinimum, 790)]);
        let young = counts(&[(Verdict::NoEcho, 49)]);
        assert_eq!(conspicuous(&[healthy, healthy]), Vec::<String>::new());
        assert_eq!(conspicuous(&[]), Vec::<String>::new());
        let said = conspicuous(&[healthy, stuck, healthy, silent, healthy, near, young, healthy]);
        let said: Vec<String> = said.iter().map(|text| text.chars().take(17).collect()).collect();
        assert_eq!(said, ["sonar 1 is stuck ", "sonar 3 hears har", "sonar 5 is blocke"]);
        let absurd = counts(&Verdict::ALL.map(|verdict| (verdict, u64::MAX)));
        conspicuous(&[absurd, absurd]);
    }
}
