//! Sonars that hear hardly anything. Where a reading without an echo clears the map, a dead sonar would clear it for ever: so
//! its silence counts only while it hears as others do.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::SILENT_SHARE;

/// What each sonar has heard so far.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Hearing {
    sonars: BTreeMap<u16, Heard>,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Heard {
    readings: u32,
    echoes: u32,
}

impl Heard {
    /// Echoes by readings, 0 to 1.
    fn share(self) -> f64 {
        f64::from(self.echoes) / f64::from(self.readings.max(1))
    }
}

impl Hearing {
    /// Takes note of a reading of the transducer `sonar`.
    pub(crate) fn note(&mut self, sonar: u16, is_echo: bool) {
        let heard = self.sonars.entry(sonar).or_default();
        if let Some(readings) = heard.readings.checked_add(1) {
            (heard.readings, heard.echoes) = (readings, heard.echoes + u32::from(is_echo));
        }
    }

    /// The share of readings with an echo of the middle one of all sonars, 0 to 1.
    pub(crate) fn usual_share(&self) -> f64 {
        let mut shares: Vec<f64> = self.sonars.values().map(|heard| heard.share()).collect();
        shares.sort_by(f64::total_cmp);
        shares.get(shares.len() / 2).copied().unwrap_or(0.0)
    }

    /// Whether a sonar has heard next to nothing where the middle one hears `usual_share`; one that has not heard anything
    /// yet has not shown that it can.
    pub(crate) fn is_silent(&self, sonar: u16, usual_share: f64) -> bool {
        self.sonars.get(&sonar).is_none_or(|heard| heard.echoes == 0 || heard.share() < SILENT_SHARE * usual_share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sonar_that_hears_as_others_do_is_not_silent() {
        let mut hearing = Hearing::default();
        for reading in 0..60 {
            hearing.note(0, true);
            hearing.note(1, reading % 3 == 0);
            hearing.note(2, false);
            hearing.note(3, reading == 0);
        }
        let usual_share = hearing.usual_share();
        let silent = [0, 1, 2, 3].map(|sonar| hearing.is_silent(sonar, usual_share));
        assert_eq!((usual_share, silent), (1.0 / 3.0, [false, false, true, true]));
    }

    #[test]
    fn where_nobody_hears_anything_nobody_clears() {
        let mut hearing = Hearing::default();
        (0..3).for_each(|sonar| hearing.note(sonar, false));
        assert!((0..4).all(|sonar| hearing.is_silent(sonar, hearing.usual_share())));
    }
}
