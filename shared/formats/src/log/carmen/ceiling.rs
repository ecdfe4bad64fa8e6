//! From which range on a reading means "nothing came back".
//!
//! Logs don't say it: a sensor writes its maximum, or a code above it. The rule:
//!
//! 1. The log's parameter (`robot_front_laser_max` …) or the message's own maximum counts if any
//!    range reaches it.
//! 2. Otherwise, or if far more readings sit on a lower value, the largest value seen that stands
//!    out: it repeats, is at least twice as frequent as the next lower value, and 8 times as
//!    frequent as all that lies above (which is noise then). If that value belongs to a family of
//!    known codes ([`CODES`]), the whole family means no return.
//! 3. If nothing stands out every range is an echo, and the sensor's limit is the next whole metre
//!    above the largest range.
//!
//! A robot that stands still before its farthest wall may fool rule 2: a few readings then lose
//! their echo, which costs a little evidence and never makes a wall of a no-return.

use std::collections::BTreeMap;

/// Codes of known sensors that mean "no return": from, to (metres).
/// SICK LMS in cm mode writes 81.83 to 81.91, in mm mode 32.759 to 32.767; logs cut at 50 m hold
/// 50.0 or 51.x.
const CODES: [(f64, f64); 3] = [(81.83, 81.925), (50.0, 51.995), (32.759, 32.7675)];
/// How many of the largest values are remembered.
const KEPT: usize = 64;
/// With a maximum given, so many readings must sit on a lower value to overrule it.
const OVERRULE: u64 = 50;

/// The largest ranges of one sensor, with their numbers.
#[derive(Debug, Default)]
pub(crate) struct RangeTally {
    /// By the bits of the range: for positive numbers they sort as the numbers do.
    top: BTreeMap<u64, u64>,
}

impl RangeTally {
    /// Takes note of a range, finite and positive.
    pub(crate) fn add(&mut self, range_m: f64) {
        let key = range_m.to_bits();
        match self.top.first_key_value() {
            Some((smallest, _)) if self.top.len() >= KEPT && key < *smallest => return,
            _ => {}
        }
        *self.top.entry(key).or_insert(0) += 1;
        if self.top.len() > KEPT {
            self.top.pop_first();
        }
    }

    /// The range from which on a reading is no echo, given the maximum that the log states.
    pub(crate) fn ceiling_m(&self, stated_m: Option<f64>) -> f64 {
        let stated = stated_m.filter(|max| max.is_finite() && *max > 0.0);
        let standing_out = self.standing_out();
        match (stated, standing_out) {
            (Some(stated), Some((value, count))) => {
                let reached: u64 = self.top.range(stated.to_bits()..).map(|(_, count)| count).sum();
                let overruled = value < stated && count >= OVERRULE && count >= 8 * reached;
                if overruled { value } else { stated }
            }
            (Some(stated), None) => stated,
            (None, Some((value, _))) => value,
            (None, None) => {
                self.top.last_key_value().map_or(1.0, |(largest, _)| f64::from_bits(*largest).floor() + 1.0)
            }
        }
    }

    /// The same ranges, each so many times as long.
    pub(crate) fn scaled(&self, by: f64) -> Self {
        let mut top = BTreeMap::new();
        for (bits, count) in &self.top {
            *top.entry((f64::from_bits(*bits) * by).to_bits()).or_insert(0) += count;
        }
        Self { top }
    }

    /// From which range on nothing comes back, if that stands out.
    pub(crate) fn no_echo_from(&self) -> Option<f64> {
        self.standing_out().map(|(value, _)| value)
    }

    /// The lowest of several codes, and the number of all, where the largest values are far more frequent than those below: some
    /// sensors have one code for "nothing came back" and another for "dazzled".
    fn several_codes(&self) -> Option<(f64, u64)> {
        let mut counts: Vec<u64> = self.top.values().copied().collect();
        counts.sort_unstable();
        let usual = counts.get(counts.len() / 2).copied().unwrap_or(0);
        let least = OVERRULE.max(20 * usual);
        let codes: Vec<(&u64, &u64)> = self.top.iter().rev().take_while(|(_, count)| **count >= least).collect();
        let (lowest, _) = codes.last().filter(|_| codes.len() > 1)?;
        Some((f64::from_bits(**lowest), codes.iter().map(|(_, count)| **count).sum()))
    }

    /// The largest value that stands out, or the floor of its family of codes, and its number.
    fn standing_out(&self) -> Option<(f64, u64)> {
        if let Some(codes) = self.several_codes() {
            return Some(codes);
        }
        let mut above = 0;
        let mut values = self.top.iter().rev().map(|(bits, count)| (f64::from_bits(*bits), *count)).peekable();
        while let Some((value, count)) = values.next() {
            if let Some((from, _)) = CODES.into_iter().find(|(from, to)| (*from..*to).contains(&value)) {
                let family: u64 = self.top.range(from.to_bits()..=value.to_bits()).map(|(_, count)| count).sum();
                if family >= 2 && family >= 8 * above {
                    return Some((from, family));
                }
            }
            let next = values.peek().map_or(0, |(_, count)| *count);
            if count >= 2 && count >= 2 * next && count >= 8 * above {
                return Some((value, count));
            }
            above += count;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(ranges: &[(f64, usize)], stated: Option<f64>, expected: f64) {
        let mut tally = RangeTally::default();
        for (range, count) in ranges {
            for _ in 0..*count {
                tally.add(*range);
            }
        }
        assert_eq!(tally.ceiling_m(stated), expected, "{ranges:?} {stated:?}");
    }

    #[test]
    fn the_rule() {
        check(&[(81.91, 3), (12.0, 1)], Some(80.99), 80.99);
        check(&[(81.91, 30), (81.83, 2), (12.0, 1)], None, 81.83);
        check(&[(50.0, 620), (43.81, 10)], None, 50.0);
        check(&[(32.767, 5), (31.0, 3)], None, 32.759);
        check(&[(5.0, 14_062), (4.999, 1)], None, 5.0);
        check(&[(9.5, 1), (9.4, 1)], None, 10.0);
        check(&[], None, 1.0);
        // Nothing repeats at the top: a robot in a room.
        check(&[(9.5, 3), (9.4, 2), (9.3, 3)], Some(80.0), 80.0);
        // Two codes, as of a sensor in millimetres.
        let mut ranges: Vec<(f64, usize)> = (0..60).map(|step| (4.0 + f64::from(step) * 0.01, 2)).collect();
        ranges.extend([(8.191, 400), (65.535, 380)]);
        check(&ranges, None, 8.191);
        // One wild range above the sensor's maximum.
        check(&[(9999.0, 1), (50.0, 620), (43.0, 10)], None, 50.0);
        // A stated maximum that the sensor never reaches, but another one.
        check(&[(50.0, 620), (43.0, 10)], Some(80.99), 50.0);
    }
}
