//! `[simulator]`: which robot drives where, what its odometry does wrong, and what its sensors hear.

use std::fmt::Display;
use std::path::PathBuf;

use echogrid_core::config::ConfigError;
use serde::{Deserialize, Serialize};

use crate::fault::Fault;

/// The `[simulator]` section: which robot drives where, and what its sensors are like.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SimulatorConfig {
    /// A world that comes along (`office`, `room`), a floor drawn by lot (`floor-1` …), or a file of one.
    pub world: String,
    /// Where the drive starts: `[x, y]` or `[x, y, heading_deg]`; empty: at the world's home.
    pub start: Vec<f64>,
    /// The route of the robot.
    pub route: Route,
    /// The drive ends after so many seconds; 0: when the route is done.
    pub duration_s: f64,
    /// Seed of all that is drawn.
    pub seed: u64,
    /// The drive is written to this CARMEN log; empty: it is not.
    pub record: PathBuf,

    /// Speed on a straight way, m/s.
    pub speed_mps: f64,
    /// Speed of a turn on the spot, rad/s.
    pub turn_radps: f64,
    /// How fast it gets faster, m/s².
    pub accel_mps2: f64,
    /// How fast it gets slower, m/s².
    pub decel_mps2: f64,
    /// How fast its turning gets faster and slower, rad/s².
    pub turn_accel_radps2: f64,
    /// A planned way stays so far from walls, beyond the robot's own radius, metres.
    pub margin_m: f64,
    /// A robot that somebody blocks gives up the place that it drives to after so long, seconds.
    pub patience_s: f64,

    /// The time from one odometry pose to the next, seconds.
    pub odometry_period_s: f64,
    /// The distance between the wheels of both sides, as the odometry believes, metres.
    pub axle_m: f64,
    /// Resolution of the encoders: ticks per metre of the wheels' way.
    pub ticks_per_m: f64,
    /// By how much the odometry takes the left wheels' way for longer than it is, as a share.
    pub left_scale: f64,
    /// By how much the odometry takes the right wheels' way for longer than it is, as a share.
    pub right_scale: f64,
    /// By how much the axle is longer than the odometry believes, as a share.
    pub axle_scale: f64,
    /// Slip: variance of the way that each side's wheels measure, m² per metre.
    pub slip_m2_per_m: f64,
    /// Scrub: variance of the measured turn, rad² per radian turned.
    pub scrub_rad2_per_rad: f64,
    /// Scrub: variance of the measured way, m² per radian turned.
    pub scrub_m2_per_rad: f64,
    /// Bumps per metre in the mean.
    pub bumps_per_m: f64,
    /// What a bump turns the robot by, unnoticed by its wheels: standard deviation, radians.
    pub bump_rad: f64,

    /// Which sonars fire together, in turn; empty: one after the other.
    pub firing_order: Vec<Vec<u16>>,
    /// The time from one firing to the next, seconds.
    pub firing_period_s: f64,
    /// Rays that stand for the cone of a sonar.
    pub rays: u16,
    /// A wall that sound meets at a larger angle from its normal mirrors it away, degrees.
    pub critical_incidence_deg: f64,
    /// How many mirrors sound is followed over.
    pub bounces: u8,
    /// Whether sonars hear each other.
    pub crosstalk: bool,
    /// The sonars that break.
    pub faults: Vec<Fault>,

    /// The time from one scan of a lidar to the next, seconds.
    pub lidar_period_s: f64,
    /// Share of the lidar's beams that never come back.
    pub lidar_dropout_ratio: f64,
}

/// Where a simulated robot goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawRoute", into = "RawRoute")]
pub enum Route {
    /// To every goal of the world that can be reached, in its order.
    Tour,
    /// Where it is told to, at the speed it is told to.
    Commands,
    /// To these places, one after the other.
    Places(Vec<Waypoint>),
}

/// A place to drive to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Waypoint {
    /// A goal of the world.
    Goal(String),
    /// x and y, metres in the map frame.
    Point([f64; 2]),
}

/// A [`Route`] as it is written.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum RawRoute {
    Word(String),
    Places(Vec<Waypoint>),
}

/// A word that is no route.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("expected \"tour\", \"commands\" or a list of goals and [x, y] places")]
pub struct NotARoute;

impl TryFrom<RawRoute> for Route {
    type Error = NotARoute;

    fn try_from(raw: RawRoute) -> Result<Self, NotARoute> {
        match raw {
            RawRoute::Word(word) if word == "tour" => Ok(Self::Tour),
            RawRoute::Word(word) if word == "commands" => Ok(Self::Commands),
            RawRoute::Word(_) => Err(NotARoute),
            RawRoute::Places(places) => Ok(Self::Places(places)),
        }
    }
}

impl From<Route> for RawRoute {
    fn from(route: Route) -> Self {
        match route {
            Route::Tour => Self::Word("tour".to_owned()),
            Route::Commands => Self::Word("commands".to_owned()),
            Route::Places(places) => Self::Places(places),
        }
    }
}

/// A robot of no particular make, with sound wheels: one that counts 1 mm per tick and drifts by about a degree in 10 m.
impl Default for SimulatorConfig {
    fn default() -> Self {
        Self {
            world: "office".to_owned(),
            start: Vec::new(),
            route: Route::Tour,
            duration_s: 0.0,
            seed: 1,
            record: PathBuf::new(),
            speed_mps: 0.5,
            turn_radps: 0.75,
            accel_mps2: 0.3,
            decel_mps2: 0.6,
            turn_accel_radps2: 1.5,
            margin_m: 0.05,
            patience_s: 10.0,
            odometry_period_s: 0.1,
            axle_m: 0.4,
            ticks_per_m: 1000.0,
            left_scale: 0.0,
            right_scale: 0.0,
            axle_scale: 0.0,
            slip_m2_per_m: 2e-6,
            scrub_rad2_per_rad: 2e-4,
            scrub_m2_per_rad: 1e-6,
            bumps_per_m: 0.05,
            bump_rad: 0.01,
            firing_order: Vec::new(),
            firing_period_s: 0.04,
            rays: 31,
            critical_incidence_deg: 20.0,
            bounces: 2,
            crosstalk: true,
            faults: Vec::new(),
            lidar_period_s: 0.2,
            lidar_dropout_ratio: 0.01,
        }
    }
}

impl SimulatorConfig {
    /// Whether every value is in its range.
    ///
    /// # Errors
    /// The first key that is not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        const SCALE: &str = "a share from -0.5 to 0.5";
        let scale = |key, value: f64| within(key, value, -0.5, 0.5, SCALE);
        let variance = |key, value: f64| within(key, value, 0.0, 1.0, "a number from 0 to 1");
        let period = |key, value: f64| within(key, value, 1e-3, 10.0, "a number of seconds from 0.001 to 10");
        let start = matches!(self.start.len(), 0 | 2 | 3) && self.start.iter().all(|value| value.is_finite());
        unless(start, "start", format!("{:?}", self.start), "[], [x, y] or [x, y, heading_deg], metres and degrees")?;
        let route = match &self.route {
            Route::Places(places) => {
                let finite =
                    |place: &Waypoint| !matches!(place, Waypoint::Point([x, y]) if !(x.is_finite() && y.is_finite()));
                !places.is_empty() && places.iter().all(finite)
            }
            Route::Tour | Route::Commands => true,
        };
        unless(route, "route", "[…]", "\"tour\", \"commands\" or a list of goals and [x, y] places")?;
        within(
            "duration_s",
            self.duration_s,
            0.0,
            1e6,
            "a number of seconds from 0 (until the route is done) to 1000000",
        )?;
        within("speed_mps", self.speed_mps, 0.01, 10.0, "a number of m/s from 0.01 to 10")?;
        within("turn_radps", self.turn_radps, 0.01, 10.0, "a number of rad/s from 0.01 to 10")?;
        within("accel_mps2", self.accel_mps2, 0.01, 100.0, "a number of m/s² from 0.01 to 100")?;
        within("decel_mps2", self.decel_mps2, 0.01, 100.0, "a number of m/s² from 0.01 to 100")?;
        within("turn_accel_radps2", self.turn_accel_radps2, 0.01, 100.0, "a number of rad/s² from 0.01 to 100")?;
        within("margin_m", self.margin_m, 0.0, 10.0, "a number of metres from 0 to 10")?;
        within("patience_s", self.patience_s, 0.0, 1e6, "a number of seconds from 0 to 1000000")?;
        period("odometry_period_s", self.odometry_period_s)?;
        within("axle_m", self.axle_m, 0.01, 10.0, "a number of metres from 0.01 to 10")?;
        within("ticks_per_m", self.ticks_per_m, 1.0, 1e9, "a number from 1 to 1000000000")?;
        scale("left_scale", self.left_scale)?;
        scale("right_scale", self.right_scale)?;
        scale("axle_scale", self.axle_scale)?;
        variance("slip_m2_per_m", self.slip_m2_per_m)?;
        variance("scrub_rad2_per_rad", self.scrub_rad2_per_rad)?;
        variance("scrub_m2_per_rad", self.scrub_m2_per_rad)?;
        within("bumps_per_m", self.bumps_per_m, 0.0, 100.0, "a number from 0 to 100")?;
        within("bump_rad", self.bump_rad, 0.0, 1.0, "a number of radians from 0 to 1")?;
        let mut fired: Vec<u16> = self.firing_order.iter().flatten().copied().collect();
        let count = fired.len();
        fired.sort_unstable();
        fired.dedup();
        let order = fired.len() == count && self.firing_order.iter().all(|together| !together.is_empty());
        let expected = "a list of lists of sonar numbers, each number once, like [[0, 8], [1, 9]]";
        unless(order, "firing_order", format!("{:?}", self.firing_order), expected)?;
        period("firing_period_s", self.firing_period_s)?;
        within("rays", f64::from(self.rays), 1.0, 1001.0, "a whole number from 1 to 1001")?;
        within("critical_incidence_deg", self.critical_incidence_deg, 0.0, 90.0, "a number of degrees from 0 to 90")?;
        within("bounces", f64::from(self.bounces), 0.0, 8.0, "a whole number from 0 to 8")?;
        self.faults.iter().try_for_each(Fault::validate)?;
        period("lidar_period_s", self.lidar_period_s)?;
        within("lidar_dropout_ratio", self.lidar_dropout_ratio, 0.0, 1.0, "a share from 0 to 1")
    }
}

fn unless(holds: bool, key: &'static str, value: impl Display, expected: &'static str) -> Result<(), ConfigError> {
    if holds { Ok(()) } else { Err(ConfigError { key, value: value.to_string(), expected }) }
}

fn within(key: &'static str, value: f64, least: f64, most: f64, expected: &'static str) -> Result<(), ConfigError> {
    // Not a number is in no range.
    unless((least..=most).contains(&value), key, value, expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_their_range_are_told() {
        assert_eq!(SimulatorConfig::default().validate(), Ok(()));
        let check = |change: &dyn Fn(&mut SimulatorConfig), told: &str| {
            let mut config = SimulatorConfig::default();
            change(&mut config);
            let error = config.validate().unwrap_err().to_string();
            assert!(error.starts_with(told), "{error}");
        };
        check(&|c| c.start = vec![1.0], "start = [1.0]: expected [], [x, y] or");
        check(&|c| c.start = vec![f64::NAN, 0.0], "start = [NaN, 0.0]");
        check(&|c| c.route = Route::Places(vec![]), "route = […]: expected \"tour\"");
        check(&|c| c.route = Route::Places(vec![Waypoint::Point([0.0, f64::INFINITY])]), "route");
        check(&|c| c.firing_order = vec![vec![0], vec![0]], "firing_order = [[0], [0]]: expected");
        check(&|c| c.firing_order = vec![vec![]], "firing_order");
        check(&|c| c.rays = 0, "rays = 0");
        check(&|c| c.axle_m = f64::NAN, "axle_m = NaN");
        check(&|c| c.firing_period_s = 0.0, "firing_period_s = 0: expected a number of seconds");
    }
}
