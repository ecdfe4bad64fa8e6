//! Where the robot was, by what its sensors hear or see in a map that was saved before.

use anyhow::{Context, Result};
use echogrid_core::config::MapperConfig;
use echogrid_core::localization::Reason;
use echogrid_core::{Estimate, Fix, Matrix3, Pose2, Robot, Scales, SensorKind};
use echogrid_formats::map::{MapDocument, native};
use echogrid_slam::SlamConfig;
use echogrid_slam::known::{EchoMap, Gates, Ground, Located, MapModel, OutlineMap, Prior, Unlocated};
use echogrid_topics::LocalizationRequest;
use serde::Deserialize;

use crate::answer::Answer;
use crate::config::LocalizerConfig;
use crate::drive::Drive;

/// Where nobody knows where the robot is, so much more way is looked back over.
const LONGER: f64 = 1.5;
/// Then the readings must fit so much better.
const SURER: f64 = 1.5;
/// The way over which the scans of a lidar are put together, metres: near where the robot was believed to be the last counts alone, as what the
/// drive measures too much would turn the others; and anywhere.
const SEEN_NEAR_M: f64 = 0.0;
const SEEN_M: f64 = 1.5;
/// A robot that was not found for so much way is looked for everywhere, metres.
const LOST_M: f64 = 10.0;
/// It is looked for everywhere again after so much way, metres …
const EVERYWHERE_EVERY_M: f64 = 1.0;
/// … and once it was not found for so much, metres, each so many times as seldom: the less likely it is here at all.
const LONG_M: f64 = 25.0;
const SELDOM: i64 = 5;
/// That it is looked for is said when it was so often.
const SAID_AFTER: u32 = 5;
/// What the odometry is taken to be off by besides what it says, as a factor of its deviations, and at least, metres and radians.
const WIDER: f64 = 1.5;
const LEAST: (f64, f64) = (0.05, 0.02);
/// So much more with the way and the turn since the last fix: a drive that nobody calibrated measures too much or too little.
const SCALE: f64 = 0.05;

/// A known map.
#[derive(Debug)]
pub(crate) struct SavedMap {
    ground: Ground,
    /// Each made when it is needed first: whether it is needed the robot says.
    echoes: Option<EchoMap>,
    outlines: Option<OutlineMap>,
    window_m: f64,
    gates: Gates,
    /// Whether it was made by sonars alone.
    is_of_sonars: bool,
    /// What came of looking everywhere: at which step of the way, with which scales.
    looked: Option<(i64, Scales, Result<Located, Unlocated>)>,
    /// How often it was in vain, one after the other. For the log alone.
    in_vain: u32,
}

/// The part of what a map says of its making that matters here.
#[derive(Debug, Default, Deserialize)]
struct Made {
    #[serde(default)]
    mapper: MapperConfig,
    #[serde(default)]
    robot: Robot,
}

impl SavedMap {
    pub(crate) fn read(config: &LocalizerConfig) -> Result<Self> {
        let file = &config.map;
        let map = native::read(file).context("localizer.map")?;
        let made: Made = toml::from_str(&map.provenance.config_toml).unwrap_or_default();
        let ground = ground(&map, &made).with_context(|| format!("localizer.map: {}", file.display()))?;
        let sensors = &made.robot.sensors;
        let is_of_sonars = !sensors.is_empty() && sensors.iter().all(|sensor| sensor.kind == SensorKind::Sonar);
        let gates = Gates { evidence_min: config.map_evidence_nat, margin_min: config.map_margin_nat };
        Ok(Self {
            ground,
            echoes: None,
            outlines: None,
            window_m: config.map_window_m,
            gates,
            is_of_sonars,
            looked: None,
            in_vain: 0,
        })
    }

    /// What is odd about looking for this robot in this map, in words; empty: nothing.
    pub(crate) fn oddity(&self, drive: &Drive) -> &'static str {
        let sees_finer = self.is_of_sonars && drive.has_lidar() == Some(true);
        if sees_finer {
            "the map is of sonars, too coarse for a lidar: where it is found in it may be a metre off"
        } else {
            ""
        }
    }

    /// Where the robot was at a stamp, as far as all has come until then.
    pub(crate) fn answer(&mut self, stamp_ns: u64, request: &LocalizationRequest, drive: &Drive) -> Answer {
        if !drive.reaches(stamp_ns) {
            return Answer::NotYet;
        }
        let estimate = &request.estimate.estimate;
        // Until it was recognised once, that it is in this map at all is for the map to show.
        if estimate.fixes > 0 && !request.estimate.unplaced {
            let prior = Prior { pose: estimate.pose, covariance: widened(estimate) };
            let found = self.near(stamp_ns, &prior, estimate.scales, drive);
            let is_lost = request.reason == Reason::Leap || estimate.travel_m > LOST_M;
            match found {
                Err(Some(_)) if is_lost => {}
                other => return told(stamp_ns, other),
            }
        }
        told(stamp_ns, self.anywhere(stamp_ns, estimate, drive))
    }

    fn near(
        &mut self,
        stamp_ns: u64,
        prior: &Prior,
        scales: Scales,
        drive: &Drive,
    ) -> Result<Located, Option<Unlocated>> {
        let piece = drive.piece(stamp_ns, self.window_m, SEEN_NEAR_M, scales).ok_or(None)?;
        if drive.has_lidar() == Some(true) {
            return self.outlines().track(&piece.points[0], prior, &lidar_gates()).map_err(Some);
        }
        let gates = self.gates;
        self.echoes().track(&piece.trail, prior, &gates).map_err(Some)
    }

    /// Looks everywhere, but not again before the robot has come farther.
    fn anywhere(&mut self, stamp_ns: u64, estimate: &Estimate, drive: &Drive) -> Result<Located, Option<Unlocated>> {
        let scales = estimate.scales;
        let (step, then_ns) = drive.step_before(stamp_ns, EVERYWHERE_EVERY_M).ok_or(None)?;
        if estimate.travel_m > LONG_M && step % SELDOM != 0 {
            return Err(None);
        }
        let has_lidar = drive.has_lidar() == Some(true);
        let known = self.looked.filter(|(at, with, _)| *at == step && *with == scales).map(|(_, _, found)| found);
        let found = match known {
            Some(found) => found,
            None => {
                let window_m = LONGER * self.window_m;
                let piece = drive.piece(then_ns, window_m, SEEN_M, scales).ok_or(None)?;
                if piece.way_m < window_m - 0.1 {
                    return Err(None);
                }
                let gates = Gates { evidence_min: SURER * self.gates.evidence_min, ..self.gates };
                let [seen, before] = &piece.points;
                let found = if has_lidar {
                    self.outlines().find(seen, before, &lidar_gates())
                } else {
                    self.echoes().find(&piece.trail, &gates)
                };
                self.looked = Some((step, scales, found));
                self.say(found.is_ok());
                found
            }
        };
        let located = found.map_err(Some)?;
        let since = drive.between(then_ns, stamp_ns, scales).ok_or(None)?;
        Ok(Located { pose: located.pose * since, ..located })
    }

    fn say(&mut self, is_found: bool) {
        self.in_vain = if is_found { 0 } else { self.in_vain + 1 };
        if self.in_vain == SAID_AFTER {
            tracing::warn!(
                searches = self.in_vain,
                "the robot is not recognised yet, and is looked for in the whole map: every metre, from {LONG_M} m on every {SELDOM} m; is it of this \
                 place?"
            );
        }
    }

    fn outlines(&mut self) -> &mut OutlineMap {
        self.outlines.get_or_insert_with(|| OutlineMap::new(&self.ground))
    }

    fn echoes(&mut self) -> &mut EchoMap {
        self.echoes.get_or_insert_with(|| EchoMap::new(self.ground.clone()))
    }
}

/// The covariance of an estimate, with what its odometry may be off by besides what it says.
fn widened(estimate: &Estimate) -> [[f64; 3]; 3] {
    let mut covariance = rows(&estimate.pose_covariance());
    let more_m = LEAST.0 + SCALE * estimate.travel_m;
    let more_rad = LEAST.1 + SCALE * estimate.turn_rad;
    for (axis, line) in covariance.iter_mut().enumerate() {
        line.iter_mut().for_each(|value| *value *= WIDER * WIDER);
        let more = if axis < 2 { more_m } else { more_rad };
        line[axis] += more * more;
    }
    covariance
}

/// The map as it can be localized in.
fn ground(map: &MapDocument, made: &Made) -> Result<Ground> {
    let prior = match made.mapper.fusion.of(SensorKind::Sonar) {
        echogrid_core::config::Fusion::Oriented => made.mapper.oriented_prior,
        echogrid_core::config::Fusion::FirstEcho => made.mapper.echo_prior,
        _ => 0.02,
    };
    Ok(Ground::of(&map.grid, MapModel { prior })?)
}

/// Shares of points on walls.
fn lidar_gates() -> Gates {
    let SlamConfig { closure_score_min, closure_margin, .. } = SlamConfig::default();
    Gates { evidence_min: closure_score_min, margin_min: closure_margin }
}

fn told(stamp_ns: u64, found: Result<Located, Option<Unlocated>>) -> Answer {
    match found {
        Ok(Located { pose, covariance, evidence }) => {
            let Pose2 { x, y, theta } = pose;
            let [sigma_x_m, sigma_y_m, sigma_rad] = [0, 1, 2].map(|axis| covariance[axis][axis].sqrt());
            tracing::debug!(stamp_ns, x, y, theta, evidence, sigma_x_m, sigma_y_m, sigma_rad, "found in the map");
            let covariance = Matrix3::from_fn(|row, column| covariance[row][column]);
            Answer::Fix(Fix { covariance, ..Fix::certain(pose) })
        }
        Err(Some(Unlocated::TooFew { .. }) | None) => Answer::TooEarly,
        Err(Some(why)) => Answer::Unknown(why.to_string()),
    }
}

fn rows(covariance: &Matrix3<f64>) -> [[f64; 3]; 3] {
    core::array::from_fn(|row| core::array::from_fn(|column| covariance[(row, column)]))
}
