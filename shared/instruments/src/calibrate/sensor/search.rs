//! One parameter after the other, each to the best of some values, until none gets better.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use echogrid_core::calibration::{Profile, Told};
use echogrid_core::{MapperConfig, Robot, SensorKind};

use super::drive::Heard;
use crate::jobs;

/// Most rounds over all parameters.
const ROUNDS_MAX: usize = 6;
/// How often blocks are drawn anew.
const DRAWS: usize = 2000;

/// A parameter that is learnt.
pub(super) struct Parameter {
    pub(super) key: &'static str,
    pub(super) unit: &'static str,
    values: &'static [f64],
    pub(super) at: fn(&mut Tried) -> &mut f64,
}

/// A sensor model.
#[derive(Debug, Clone)]
pub(super) struct Tried {
    pub(super) mapper: MapperConfig,
    pub(super) range_error_ratio: f64,
}

/// The share of the range, which the robot has.
pub(super) const RANGE_ERROR_RATIO: &str = "range_error_ratio";

/// In the order in which they are sought: those that say most first.
pub(super) const ALL: [Parameter; 5] = [
    Parameter {
        key: RANGE_ERROR_RATIO,
        unit: "share of z",
        values: &[0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045, 0.07, 0.1],
        at: |tried| &mut tried.range_error_ratio,
    },
    Parameter {
        key: "oriented_clutter",
        unit: "probability",
        values: &[0.01, 0.02, 0.04, 0.07, 0.12, 0.2, 0.3, 0.4, 0.55, 0.75, 0.95],
        at: |tried| &mut tried.mapper.oriented_clutter,
    },
    Parameter {
        key: "oriented_detection",
        unit: "probability",
        values: &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97],
        at: |tried| &mut tried.mapper.oriented_detection,
    },
    Parameter {
        key: "oriented_incidence_deg",
        unit: "degrees",
        values: &[7.0, 10.0, 14.0, 18.0, 22.0, 26.0, 30.0, 36.0, 44.0, 55.0, 70.0, 90.0],
        at: |tried| &mut tried.mapper.oriented_incidence_deg,
    },
    Parameter {
        key: "oriented_diffuse",
        unit: "probability",
        values: &[0.02, 0.04, 0.07, 0.12, 0.2, 0.3, 0.45, 0.65, 0.9],
        at: |tried| &mut tried.mapper.oriented_diffuse,
    },
];

/// What was found.
pub(super) struct Found {
    /// Of each parameter: what it was, and what the drive says.
    pub(super) told: Vec<(f64, Told)>,
    /// Σ ln p of all echoes that were asked about, before and after, nat.
    pub(super) nats: [f64; 2],
}

/// Of a place in the values of each parameter, Σ ln p of each block.
type Known = BTreeMap<Vec<usize>, Vec<f64>>;

struct Search<'a> {
    heard: &'a Heard,
    given: Tried,
    /// The values of each parameter, what it was among them.
    values: Vec<Vec<f64>>,
    known: Known,
}

/// Seeks the parameters under which the echoes are most probable.
pub(super) fn search(heard: &Heard, seed: u64) -> Result<Found> {
    let sonar = heard.robot.sensors.iter().find(|sensor| sensor.kind == SensorKind::Sonar);
    let range_error_ratio = sonar.map(|sonar| sonar.range_error_ratio).context("a robot without sonars")?;
    let mut given = Tried { mapper: heard.mapper.clone(), range_error_ratio };
    let (mut values, mut places) = (Vec::new(), Vec::new());
    for parameter in &ALL {
        let was = *(parameter.at)(&mut given);
        let mut all: Vec<f64> = parameter.values.to_vec();
        // A value that is nearly that of the configuration gives way to it.
        all.retain(|value| (value / was).ln().abs() > 0.05);
        all.push(was);
        all.sort_unstable_by(f64::total_cmp);
        places.push(all.iter().position(|value| *value == was).unwrap_or(0));
        values.push(all);
    }
    let mut search = Search { heard, given, values, known: Known::new() };
    let first = places.clone();
    for _ in 0..ROUNDS_MAX {
        let before = places.clone();
        for parameter in 0..ALL.len() {
            places[parameter] = search.best(&places, parameter)?;
        }
        if places == before {
            break;
        }
    }
    let told = (0..ALL.len()).map(|parameter| search.tell(&places, parameter, seed)).collect::<Result<Vec<_>>>()?;
    let nats = [&first, &places].map(|places| search.known.get(places).map_or(f64::NAN, |blocks| blocks.iter().sum()));
    Ok(Found { told, nats })
}

impl Search<'_> {
    /// All values of a parameter, the others as they are.
    fn line(&self, places: &[usize], parameter: usize) -> Vec<Vec<usize>> {
        let with = |place| {
            let mut moved = places.to_vec();
            moved[parameter] = place;
            moved
        };
        (0..self.values[parameter].len()).map(with).collect()
    }

    /// The place of the best value of a parameter.
    fn best(&mut self, places: &[usize], parameter: usize) -> Result<usize> {
        self.learn(&self.line(places, parameter))?;
        let line = self.line(places, parameter);
        let sum = |place: &usize| self.known.get(&line[*place]).map_or(f64::NEG_INFINITY, |blocks| blocks.iter().sum());
        Ok((0..line.len()).max_by(|a, b| sum(a).total_cmp(&sum(b))).unwrap_or(0))
    }

    fn tell(&mut self, places: &[usize], parameter: usize, seed: u64) -> Result<(f64, Told)> {
        let line = self.line(places, parameter);
        self.learn(&line)?;
        let blocks: Vec<&[f64]> = line.iter().filter_map(|places| self.known.get(places)).map(Vec::as_slice).collect();
        let told = Profile { values: &self.values[parameter], blocks: &blocks }.tell(DRAWS, seed);
        Ok((*(ALL[parameter].at)(&mut self.given.clone()), told.context("nothing was heard")?))
    }

    /// Maps with what is not known yet.
    fn learn(&mut self, wanted: &[Vec<usize>]) -> Result<()> {
        let new: Vec<&Vec<usize>> = wanted.iter().filter(|places| !self.known.contains_key(*places)).collect();
        let done = jobs::run("map", &new, |places| {
            let mut tried = self.given.clone();
            for ((parameter, place), values) in ALL.iter().zip(places.iter()).zip(&self.values) {
                *(parameter.at)(&mut tried) = values[*place];
            }
            self.heard.likelihoods(&tried.mapper, &with_ratio(&self.heard.robot, tried.range_error_ratio))
        })?;
        let new: Vec<Vec<usize>> = new.into_iter().cloned().collect();
        self.known.extend(new.into_iter().zip(done));
        Ok(())
    }
}

/// A robot whose sonars' ranges are off by such a share.
fn with_ratio(robot: &Robot, range_error_ratio: f64) -> Robot {
    let mut robot = robot.clone();
    let sonars = robot.sensors.iter_mut().filter(|sensor| sensor.kind == SensorKind::Sonar);
    sonars.for_each(|sonar| sonar.range_error_ratio = range_error_ratio);
    robot
}
