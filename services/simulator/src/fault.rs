//! Sonars that break on the way, so that one can see what becomes of the map.

use echogrid_core::config::ConfigError;
use echogrid_core::noise::Draws;
use echogrid_core::{Echo, Reading, Robot, SensorKind};
use serde::{Deserialize, Serialize};

use crate::cause::{Cause, Heard};
use crate::error::SimulatorError;

/// What is before a blocked sonar trembles by this much, metres, standard deviation.
const TREMBLE_M: f64 = 0.01;

/// A sonar that breaks: `{ sonar = 5, kind = "stuck", range_m = 0.8, from_s = 30 }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// Number of the transducer.
    pub sonar: u16,
    /// What it does then.
    pub kind: FaultKind,
    /// The range that it tells, metres; a silent one tells none.
    #[serde(default = "default_range_m")]
    pub range_m: f64,
    /// The time at which it breaks, seconds from the start.
    #[serde(default)]
    pub from_s: f64,
}

fn default_range_m() -> f64 {
    0.5
}

/// What a broken sonar does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// Tells one range for ever.
    Stuck,
    /// Something is before it: it hears that, give or take a centimetre, or what is nearer.
    Short,
    /// Hears nothing.
    Silent,
}

impl Fault {
    /// Whether every value is in its range.
    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        let sound = self.range_m > 0.0 && self.range_m <= 100.0 && self.from_s >= 0.0 && self.from_s.is_finite();
        let value = || format!("range_m = {}, from_s = {}", self.range_m, self.from_s);
        let expected = "range_m above 0, at most 100; from_s 0 or more";
        if sound { Ok(()) } else { Err(ConfigError { key: "faults", value: value(), expected }) }
    }
}

/// All that break.
#[derive(Debug)]
pub(crate) struct Faults {
    faults: Vec<Fault>,
    draws: Draws,
}

impl Faults {
    /// Of sonars that the robot has.
    pub(crate) fn new(faults: &[Fault], robot: &Robot, seed: u64) -> Result<Self, SimulatorError> {
        let is_sonar = |number: u16| robot.transducer(number).is_some_and(|t| t.kind == SensorKind::Sonar);
        if let Some(fault) = faults.iter().find(|fault| !is_sonar(fault.sonar)) {
            return Err(SimulatorError::NoSuchFault { number: fault.sonar, robot: robot.name.clone() });
        }
        Ok(Self { faults: faults.to_vec(), draws: Draws::new(seed, "fault") })
    }

    /// What the ring says at a time (nanoseconds from the start), for all that is broken by then.
    pub(crate) fn spoil(&mut self, now_ns: u64, readings: &mut [Reading], heard: &mut [Heard]) {
        for fault in self.faults.iter().filter(|fault| now_ns >= crate::nanoseconds(fault.from_s)) {
            for reading in readings.iter_mut().filter(|reading| reading.transducer == fault.sonar) {
                let told = |range_m: f64| Echo::Hit { range_m: range_m.max(1e-3) };
                reading.echo = match (fault.kind, reading.echo) {
                    (FaultKind::Stuck, _) => told(fault.range_m),
                    (FaultKind::Short, Echo::Hit { range_m }) if range_m < fault.range_m => reading.echo,
                    (FaultKind::Short, _) => told(fault.range_m + TREMBLE_M * self.draws.normal()),
                    (FaultKind::Silent, _) => Echo::NoEcho,
                };
                for heard in heard.iter_mut().filter(|heard| heard.transducer == fault.sonar) {
                    (heard.echo, heard.cause) = (reading.echo, Cause::Fault);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spoilt(kind: FaultKind, now_ns: u64, range_m: f64) -> Echo {
        let fault = Fault { sonar: 5, kind, range_m: 0.8, from_s: 30.0 };
        let mut faults = Faults { faults: vec![fault], draws: Draws::new(1, "fault") };
        let reading = |transducer| Reading { transducer, echo: Echo::Hit { range_m }, offset_ns: 0 };
        let mut readings = [reading(4), reading(5)];
        faults.spoil(now_ns, &mut readings, &mut []);
        assert_eq!(readings[0], reading(4), "the neighbour is sound");
        readings[1].echo
    }

    #[test]
    fn each_kind() {
        let late_ns = 30_000_000_000;
        assert_eq!(spoilt(FaultKind::Stuck, late_ns - 1, 2.0), Echo::Hit { range_m: 2.0 });
        assert_eq!(spoilt(FaultKind::Stuck, late_ns, 2.0), Echo::Hit { range_m: 0.8 });
        assert_eq!(spoilt(FaultKind::Silent, late_ns, 2.0), Echo::NoEcho);
        assert_eq!(spoilt(FaultKind::Short, late_ns, 0.4), Echo::Hit { range_m: 0.4 });
        let Echo::Hit { range_m } = spoilt(FaultKind::Short, late_ns, 2.0) else { panic!("no echo") };
        assert!(range_m != 0.8 && (range_m - 0.8).abs() < 0.05, "{range_m}");
    }

    #[test]
    fn what_makes_no_sense_is_told() {
        let fault = Fault { sonar: 0, kind: FaultKind::Stuck, range_m: 0.8, from_s: 0.0 };
        assert_eq!(fault.validate(), Ok(()));
        assert_eq!(Fault { range_m: f64::NAN, ..fault.clone() }.validate().unwrap_err().key, "faults");
        assert_eq!(Fault { from_s: -1.0, ..fault.clone() }.validate().unwrap_err().key, "faults");
        assert!(Faults::new(&[fault], &Robot::default(), 1).is_err());
    }
}
