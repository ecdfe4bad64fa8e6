//! The parameters of each fusion, learnt: one after the other, each to the best of the values around it, until none gets better.

use anyhow::Result;

use super::drive::Lesson;
use super::jobs;
use super::method::SCHEDULES;

/// A rule and what of it is learnt; each value is tried among its neighbours.
struct Learnable {
    fusion: &'static str,
    keys: &'static [(&'static str, &'static [f64])],
}

const ECHO_PRIOR: &[f64] = &[0.001, 0.003, 0.01, 0.03, 0.1, 0.2];
const ECHO_DETECTION: &[f64] = &[0.05, 0.1, 0.15, 0.2, 0.3, 0.5];
const ECHO_CLUTTER: &[f64] = &[0.05, 0.12, 0.2, 0.4, 0.6, 0.8];
const TEMPERING: &[f64] = &[0.0, 0.25, 0.5, 0.75, 1.0];
const P_OCCUPIED: &[f64] = &[0.55, 0.6, 0.65, 0.7, 0.8, 0.85, 0.9];
const P_FREE: &[f64] = &[0.1, 0.2, 0.3, 0.4, 0.45];

const LEARNABLE: [Learnable; 3] = [
    Learnable { fusion: "paper", keys: &[("mapper.p_occupied", P_OCCUPIED), ("mapper.p_free", P_FREE)] },
    Learnable { fusion: "covariance", keys: &[("mapper.p_occupied", P_OCCUPIED), ("mapper.p_free", P_FREE)] },
    Learnable {
        fusion: "first_echo",
        keys: &[
            ("mapper.echo_detection", ECHO_DETECTION),
            ("mapper.echo_clutter", ECHO_CLUTTER),
            ("mapper.echo_prior", ECHO_PRIOR),
            ("mapper.tempering", TEMPERING),
        ],
    },
];

/// What was learnt of a rule.
#[derive(Debug, serde::Serialize)]
pub(super) struct Learnt {
    pub(super) fusion: &'static str,
    /// As `--set` takes them.
    pub(super) sets: Vec<String>,
    /// Mean over all drives and schedules.
    pub(super) bits: f64,
    pub(super) bits_at_first: f64,
}

/// Learns on these drives; `start` says where each key begins.
pub(super) fn learn(drives: &[Lesson], common: &[String], start: impl Fn(&str) -> Option<f64>) -> Result<Vec<Learnt>> {
    LEARNABLE.iter().map(|rule| rule.learn(drives, common, &start)).collect()
}

impl Learnable {
    fn learn(&self, drives: &[Lesson], common: &[String], start: &impl Fn(&str) -> Option<f64>) -> Result<Learnt> {
        let nearest = |values: &[f64], at: f64| {
            let off = |index: &usize| (values[*index].ln() - at.ln()).abs();
            (0..values.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
        };
        let mut places: Vec<usize> =
            self.keys.iter().map(|(key, values)| start(key).map_or(0, |at| nearest(values, at))).collect();
        let bits_at_first = self.bits(drives, common, &places)?;
        let mut best = bits_at_first;
        loop {
            let before = best;
            for (key, (_, values)) in self.keys.iter().enumerate() {
                for step in [-1_isize, 1] {
                    // On in this direction while it gets better.
                    while let Some(place) = places[key].checked_add_signed(step).filter(|place| *place < values.len()) {
                        let mut tried = places.clone();
                        tried[key] = place;
                        let bits = self.bits(drives, common, &tried)?;
                        if bits >= best {
                            break;
                        }
                        (best, places) = (bits, tried);
                    }
                }
            }
            if best >= before - 1e-4 {
                return Ok(Learnt { fusion: self.fusion, sets: self.sets(&places), bits: best, bits_at_first });
            }
        }
    }

    fn sets(&self, places: &[usize]) -> Vec<String> {
        self.keys.iter().zip(places).map(|((key, values), place)| format!("{key}={}", values[*place])).collect()
    }

    fn bits(&self, drives: &[Lesson], common: &[String], places: &[usize]) -> Result<f64> {
        let own: Vec<String> =
            self.sets(places).into_iter().chain([format!("mapper.fusion={}", self.fusion)]).collect();
        let runs: Vec<_> = drives.iter().flat_map(|drive| SCHEDULES.iter().map(move |at| (drive, at))).collect();
        let bits = jobs::run("lesson", &runs, |(drive, schedule)| {
            let told = schedule.sets.iter().map(|set| (*set).to_owned());
            let sets: Vec<String> = told.chain(common.iter().cloned()).chain(own.iter().cloned()).collect();
            Ok(drive.judge(&sets)?.bits)
        })?;
        Ok(bits.iter().sum::<f64>() / bits.len().max(1) as f64)
    }
}
