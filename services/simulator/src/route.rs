//! Where the drive goes: from the names of a route to places, and from place to place.

use std::collections::VecDeque;

use echogrid_core::{Pose2, World, wrap_angle};

use crate::config::{Route, SimulatorConfig, Waypoint};
use crate::drive::{Command, Drive};
use crate::error::SimulatorError;
use crate::people::Disc;
use crate::planner::Planner;

/// A corner of the way is reached from here on, metres.
const NEAR_M: f64 = 0.02;
/// Headings are this good before it drives on, radians.
const AIMED_RAD: f64 = 0.01;
/// While it drives: beyond this it stops and turns anew, radians.
const ASTRAY_RAD: f64 = 0.3;
/// A robot that is faster than this gets on, m/s.
const MOVES_MPS: f64 = 0.05;
/// Turn rate against an error of heading while it drives, rad/s per radian.
const STEER_PER_S: f64 = 2.0;
/// The robot keeps so far from people ahead, beyond both their radii, metres.
const KEEP_BACK_M: f64 = 0.3;
/// The same to its sides.
const KEEP_ASIDE_M: f64 = 0.1;

/// A place to drive to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stop {
    /// In words, for people.
    pub(crate) name: String,
    place: [f64; 2],
    /// The heading to end in, if it counts.
    theta: Option<f64>,
}

/// The places of a route in a world.
pub(crate) fn stops(config: &SimulatorConfig, world: &World) -> Result<Vec<Stop>, SimulatorError> {
    let goals = &world.parts().places.goals;
    let stop = |goal: &echogrid_core::world::Goal| Stop {
        name: format!("goal {:?}", goal.name),
        place: [goal.pose.x, goal.pose.y],
        theta: goal.has_heading.then_some(goal.pose.theta),
    };
    match &config.route {
        Route::Commands => Ok(Vec::new()),
        Route::Tour => Ok(goals.iter().map(stop).collect()),
        Route::Places(places) => places
            .iter()
            .map(|place| match place {
                Waypoint::Point([x, y]) => Ok(Stop { name: format!("place [{x}, {y}]"), place: [*x, *y], theta: None }),
                Waypoint::Goal(name) => goals
                    .iter()
                    .find(|goal| goal.name == *name)
                    .map(stop)
                    .ok_or_else(|| unknown_goal(config, name, goals.iter().map(|goal| goal.name.clone()).collect())),
            })
            .collect(),
    }
}

fn unknown_goal(config: &SimulatorConfig, name: &str, goals: Vec<String>) -> SimulatorError {
    let similarity = |goal: &str| strsim::normalized_damerau_levenshtein(&name.to_lowercase(), &goal.to_lowercase());
    let near = goals.iter().map(|goal| (similarity(goal), goal)).filter(|(similarity, _)| *similarity > 0.6);
    let near = near.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, goal)| goal.clone());
    SimulatorError::UnknownGoal { world: config.world.clone(), name: name.to_owned(), goals, near }
}

/// What the robot is about.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// Turning towards the next corner.
    Aim,
    /// Driving there.
    Go,
    /// Turning to the heading of the place that it has reached.
    Settle,
}

/// A drive along a route.
#[derive(Debug, Clone)]
pub(crate) struct Tour {
    planner: Planner,
    stops: VecDeque<Stop>,
    /// Corners to the first of `stops`.
    way: VecDeque<[f64; 2]>,
    phase: Phase,
    /// How long somebody has been in the way.
    blocked_s: f64,
    /// How long a wall has.
    stalled_s: f64,
    patience_s: f64,
    robot_radius_m: f64,
    /// Stops that it gave up.
    pub(crate) given_up: Vec<String>,
}

impl Tour {
    /// Plans every leg. Stops of a tour of all goals that can't be reached are left out; those that were named must be
    /// reachable.
    pub(crate) fn plan(
        config: &SimulatorConfig,
        world: &World,
        start: Pose2,
        robot_radius_m: f64,
    ) -> Result<Self, SimulatorError> {
        let stops = stops(config, world)?;
        let places: Vec<[f64; 2]> = stops.iter().map(|stop| stop.place).chain([[start.x, start.y]]).collect();
        let clearance_m = robot_radius_m + config.margin_m;
        let planner = Planner::new(world, clearance_m, &places);
        let mut reachable = VecDeque::new();
        let mut first_way = None;
        let mut from = [start.x, start.y];
        for stop in stops {
            match planner.way(from, stop.place) {
                Some(way) => {
                    first_way.get_or_insert(way);
                    from = stop.place;
                    reachable.push_back(stop);
                }
                None if config.route == Route::Tour => {
                    tracing::info!("{} of {} can't be reached and is left out of the tour", stop.name, config.world);
                }
                None => {
                    return Err(SimulatorError::Unreachable {
                        world: config.world.clone(),
                        goal: stop.name,
                        x: from[0],
                        y: from[1],
                        clearance_m,
                        margin_m: config.margin_m,
                    });
                }
            }
        }
        let Some(way) = first_way else { return Err(SimulatorError::NoGoal { world: config.world.clone() }) };
        Ok(Self {
            planner,
            stops: reachable,
            way: way.into(),
            phase: Phase::Aim,
            blocked_s: 0.0,
            stalled_s: 0.0,
            patience_s: config.patience_s,
            robot_radius_m,
            given_up: Vec::new(),
        })
    }

    /// What to do next; none: the last place is reached.
    pub(crate) fn next(&mut self, drive: &Drive, people: &[Disc], dt_s: f64) -> Option<Command> {
        loop {
            let stop = self.stops.front()?;
            let pose = drive.true_pose();
            let Some(corner) = self.way.front() else {
                // There; but for its heading.
                let error = stop.theta.map_or(0.0, |theta| wrap_angle(theta - pose.theta));
                if error.abs() < AIMED_RAD && is_at_rest(drive) {
                    self.leave_for_next(drive);
                    continue;
                }
                return Some(turn(drive, error));
            };
            let (dx, dy) = (corner[0] - pose.x, corner[1] - pose.y);
            let left_m = libm::hypot(dx, dy);
            if left_m < NEAR_M {
                self.way.pop_front();
                self.phase = if self.way.is_empty() { Phase::Settle } else { Phase::Aim };
                continue;
            }
            let error = wrap_angle(libm::atan2(dy, dx) - pose.theta);
            if self.phase != Phase::Go {
                if error.abs() >= AIMED_RAD || drive.w_radps().abs() > 0.1 {
                    return Some(turn(drive, error));
                }
                self.phase = Phase::Go;
            }
            if error.abs() > ASTRAY_RAD {
                self.phase = Phase::Aim;
                continue;
            }
            if is_blocked(drive, people, self.robot_radius_m) {
                self.blocked_s += dt_s;
                if self.blocked_s > self.patience_s {
                    self.give_up(drive);
                    continue;
                }
                return Some(Command::default());
            }
            self.blocked_s = 0.0;
            if drive.v_mps() > MOVES_MPS {
                self.stalled_s = 0.0;
            }
            let command = Command {
                v_mps: drive.speed_to_stop_in(left_m),
                w_radps: STEER_PER_S * error,
                at_most_m: Some(left_m),
                at_most_rad: None,
            };
            return Some(command);
        }
    }

    /// It could not move though it was told to.
    pub(crate) fn stalled(&mut self, drive: &Drive, dt_s: f64) {
        self.stalled_s += dt_s;
        if self.stalled_s > self.patience_s {
            self.give_up(drive);
        }
    }

    fn give_up(&mut self, drive: &Drive) {
        if let Some(stop) = self.stops.front() {
            tracing::warn!("{} is given up: something was in the way for {} s", stop.name, self.patience_s);
            self.given_up.push(stop.name.clone());
        }
        self.leave_for_next(drive);
    }

    /// The next stop that there is a way to.
    fn leave_for_next(&mut self, drive: &Drive) {
        self.stops.pop_front();
        (self.blocked_s, self.stalled_s) = (0.0, 0.0);
        self.phase = Phase::Aim;
        let Pose2 { x, y, .. } = drive.true_pose();
        while let Some(stop) = self.stops.front() {
            if let Some(way) = self.planner.way([x, y], stop.place) {
                self.way = way.into();
                return;
            }
            tracing::warn!("there is no way from ({x:.2}, {y:.2}) to {}: it is left out", stop.name);
            self.given_up.push(stop.name.clone());
            self.stops.pop_front();
        }
    }
}

fn is_at_rest(drive: &Drive) -> bool {
    drive.v_mps().abs() < 1e-3 && drive.w_radps().abs() < 1e-2
}

/// On the spot; it comes to a halt first.
fn turn(drive: &Drive, error_rad: f64) -> Command {
    if drive.v_mps().abs() > 1e-3 {
        return Command::default();
    }
    let w_radps = drive.turn_to_stop_in(error_rad.abs()).copysign(error_rad);
    Command { w_radps, at_most_rad: Some(error_rad.abs()), ..Command::default() }
}

/// Whether somebody stands where the robot is about to be.
fn is_blocked(drive: &Drive, people: &[Disc], robot_radius_m: f64) -> bool {
    let base_from_map = drive.true_pose().inverse();
    people.iter().any(|disc| {
        let [ahead, aside] = base_from_map.transform(disc.centre);
        let apart_m = robot_radius_m + disc.radius_m;
        ahead > 0.0 && ahead < apart_m + KEEP_BACK_M + drive.way_to_stop_m() && aside.abs() < apart_m + KEEP_ASIDE_M
    })
}
