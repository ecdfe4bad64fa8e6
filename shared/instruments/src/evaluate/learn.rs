//! The parameters of each fusion, learnt: one after the other, each to the best of the values around it, until none gets better.

use anyhow::Result;
use echogrid_judge::Quality;
use serde::Serialize;

use super::drive::Lesson;
use super::mean;
use super::method::Schedule;
use super::request::Goal;
use crate::jobs;

/// A rule and what of it is learnt; each value is tried among its neighbours.
struct Learnable {
    fusion: &'static str,
    keys: &'static [(&'static str, &'static [f64])],
}

const ECHO_PRIOR: &[f64] = &[0.00001, 0.00002, 0.00005, 0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.2];
const ECHO_DETECTION: &[f64] = &[0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 0.9];
const ECHO_CLUTTER: &[f64] = &[0.01, 0.02, 0.05, 0.12, 0.2, 0.4, 0.6, 0.8];
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

/// Most free cells that [`Goal::Walls`] lets be called occupied, as a share.
const FREE_CALLED_OCCUPIED_MAX: f64 = 0.05;

impl Goal {
    /// The less, the better.
    fn cost(self, quality: &Quality) -> f64 {
        match self {
            Self::Bits => quality.bits,
            // What calls too much occupied is worse than whatever does not, and the less so the less it does.
            Self::Walls if quality.free_called_occupied > FREE_CALLED_OCCUPIED_MAX => {
                1.0 + quality.free_called_occupied
            }
            Self::Walls => 1.0 - quality.wall_recall_10cm,
        }
    }
}

/// What was learnt of a rule.
#[derive(Debug, Serialize)]
pub(super) struct Learnt {
    pub(super) fusion: &'static str,
    pub(super) goal: Goal,
    /// As `--set` takes them.
    pub(super) sets: Vec<String>,
    /// Means over all drives and schedules.
    pub(super) quality: Quality,
    pub(super) at_first: Quality,
}

/// What is learnt on.
pub(super) struct Lessons<'a> {
    pub(super) drives: &'a [Lesson],
    pub(super) schedules: &'a [Schedule],
    /// Settings of all runs.
    pub(super) common: &'a [String],
    pub(super) goal: Goal,
}

/// Learns for every rule of fusion that is asked for; `start` says where each key begins.
pub(super) fn learn(
    lessons: &Lessons<'_>,
    is_asked: impl Fn(&str) -> bool,
    start: impl Fn(&str) -> Option<f64>,
) -> Result<Vec<Learnt>> {
    LEARNABLE.iter().filter(|rule| is_asked(rule.fusion)).map(|rule| rule.learn(lessons, &start)).collect()
}

impl Learnable {
    fn learn(&self, lessons: &Lessons<'_>, start: &impl Fn(&str) -> Option<f64>) -> Result<Learnt> {
        let nearest = |values: &[f64], at: f64| {
            let off = |index: &usize| (values[*index].ln() - at.ln()).abs();
            (0..values.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
        };
        let mut places: Vec<usize> =
            self.keys.iter().map(|(key, values)| start(key).map_or(0, |at| nearest(values, at))).collect();
        let at_first = self.judge(lessons, &places)?;
        let mut best = self.descend(lessons, Goal::Bits, &mut places, at_first)?;
        if lessons.goal != Goal::Bits {
            // From what describes the sensor best: elsewhere there are summits that lead nowhere.
            best = self.descend(lessons, lessons.goal, &mut places, best)?;
        }
        let sets = self.sets(&places);
        Ok(Learnt { fusion: self.fusion, goal: lessons.goal, sets, quality: best, at_first })
    }

    /// One move after the other, each on as long as that makes it better.
    fn descend(
        &self,
        lessons: &Lessons<'_>,
        goal: Goal,
        places: &mut Vec<usize>,
        mut best: Quality,
    ) -> Result<Quality> {
        loop {
            let before = goal.cost(&best);
            for step in self.moves(goal) {
                while let Some(tried) = self.moved(places, &step) {
                    let quality = self.judge(lessons, &tried)?;
                    if goal.cost(&quality) >= goal.cost(&best) {
                        break;
                    }
                    (best, *places) = (quality, tried);
                }
            }
            if goal.cost(&best) >= before - 1e-4 {
                return Ok(best);
            }
        }
    }

    /// What is tried: one value up or down; where a limit must be kept, also two at a time, for the way goes along it.
    fn moves(&self, goal: Goal) -> Vec<Vec<isize>> {
        let keys = self.keys.len();
        let of = |steps: &[(usize, isize)]| {
            (0..keys).map(|key| steps.iter().find(|(moved, _)| *moved == key).map_or(0, |(_, step)| *step)).collect()
        };
        let mut moves: Vec<Vec<isize>> = (0..keys).flat_map(|key| [-1, 1].map(|step| of(&[(key, step)]))).collect();
        if goal == Goal::Walls {
            for first in 0..keys {
                for second in first + 1..keys {
                    moves.extend(
                        [(-1, -1), (-1, 1), (1, -1), (1, 1)].map(|(one, two)| of(&[(first, one), (second, two)])),
                    );
                }
            }
        }
        moves
    }

    /// None where a value would leave its range.
    fn moved(&self, places: &[usize], step: &[isize]) -> Option<Vec<usize>> {
        let moved = |((place, step), (_, values)): ((&usize, &isize), &(&str, &[f64]))| {
            place.checked_add_signed(*step).filter(|place| *place < values.len())
        };
        places.iter().zip(step).zip(self.keys).map(moved).collect()
    }

    fn sets(&self, places: &[usize]) -> Vec<String> {
        self.keys.iter().zip(places).map(|((key, values), place)| format!("{key}={}", values[*place])).collect()
    }

    fn judge(&self, lessons: &Lessons<'_>, places: &[usize]) -> Result<Quality> {
        let own: Vec<String> =
            self.sets(places).into_iter().chain([format!("mapper.fusion={}", self.fusion)]).collect();
        let runs: Vec<_> =
            lessons.drives.iter().flat_map(|drive| lessons.schedules.iter().map(move |at| (drive, at))).collect();
        let judged = jobs::run("lesson", &runs, |(drive, schedule)| {
            let told = schedule.sets.iter().map(|set| (*set).to_owned());
            let sets: Vec<String> = told.chain(lessons.common.iter().cloned()).chain(own.iter().cloned()).collect();
            drive.judge(&sets)
        })?;
        Ok(mean(&judged))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quality(bits: f64, walls: f64, free_called_occupied: f64) -> Quality {
        Quality {
            bits,
            bits_occupied: bits,
            bits_free: bits,
            calibration_error: 0.0,
            decided: 1.0,
            decided_wrong: 0.0,
            free_called_occupied,
            wall_recall_10cm: walls,
            wall_precision_10cm: 0.5,
        }
    }

    #[test]
    fn walls_count_only_within_the_limit() {
        let cost = |goal: Goal, walls, free| goal.cost(&quality(0.5, walls, free));
        assert!(cost(Goal::Walls, 0.9, 0.04) < cost(Goal::Walls, 0.8, 0.01), "more walls");
        assert!(cost(Goal::Walls, 0.1, 0.05) < cost(Goal::Walls, 0.99, 0.06), "over the limit");
        assert!(cost(Goal::Walls, 0.5, 0.1) < cost(Goal::Walls, 0.9, 0.2), "nearer to the limit");
        assert_eq!(cost(Goal::Bits, 0.9, 0.2), 0.5);
    }

    #[test]
    fn along_a_limit_two_values_move_at_a_time() {
        let rule = &LEARNABLE[2];
        assert_eq!(rule.moves(Goal::Bits).len(), 8);
        assert_eq!(rule.moves(Goal::Walls).len(), 8 + 6 * 4);
        assert!(rule.moves(Goal::Walls).contains(&vec![1, 0, -1, 0]));
        assert_eq!(rule.moved(&[0, 1, 2, 0], &[1, 0, -1, 0]), Some(vec![1, 1, 1, 0]));
        assert_eq!(rule.moved(&[0, 1, 2, 0], &[-1, 0, 0, 0]), None);
        assert_eq!(rule.moved(&[0, 0, 0, TEMPERING.len() - 1], &[0, 0, 0, 1]), None);
    }
}
