//! Dead reckoning and the odometry error model (paper section 3.1): raw odometry in, pose estimates with their accumulated
//! errors out, one for one; and one more wherever an absolute localization rectifies them (section 4.1).

mod history;

use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use echogrid_core::Fix;
use echogrid_core::localization::{Ask, Asking, Choice, Reason};
use echogrid_core::odometry::Contradiction;
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{
    DrivePose, Estimate, Gate, Incidents, Leap, Leaps, LocalizationConfig, MapperConfig, NominalSensor, Odometry,
    OdometryConfig, Placing, Pose2, Robot,
};
use echogrid_service::logging::Sparing;
use echogrid_service::{Declaration, Input, Outbox, Plan, Service, process};
use echogrid_topics::{Command, LocalizationFix, LocalizationRequest, Message, PoseEstimate, RawOdometry, Topic};
use history::{Applied, History};
use serde::{Deserialize, Serialize};

/// The topics that the odometry reads.
pub const INPUTS: &[Topic] = &[Topic::RobotDescription, Topic::LocalizationFix, Topic::OdometryRaw];
/// The topics that the odometry writes.
pub const OUTPUTS: &[Topic] = &[Topic::OdometryEstimate, Topic::LocalizationRequest];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: INPUTS, looks_on: &[], writes: OUTPUTS, orders: &["fix"] };

/// A localization that was asked for and has not come.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Asked {
    stamp_ns: u64,
    request: LocalizationRequest,
}

/// What the messages so far have come to.
#[derive(Debug, Serialize, Deserialize)]
struct State {
    odometry: Odometry,
    sensor: NominalSensor,
    /// Where the robot is now.
    estimate: Option<Estimate>,
    distance_m: f64,
    history: History,
    /// None where nobody would answer.
    asking: Option<Asking>,
    requests: u64,
    asked: Option<Asked>,
    /// A fix of a time that odometry has not reached.
    early: Option<(u64, Fix)>,
    /// While nothing has said yet where the map lies.
    placing: Option<Placing>,
    leaps: Leaps,
    leapt: Incidents,
    contradictions: Incidents,
}

/// The odometry service.
#[derive(Debug)]
pub struct OdometryService {
    resolution_m: f64,
    config: LocalizationConfig,
    state: State,
    /// Whether it was degraded and mapping held, as far as the log was told.
    was: (bool, bool),
    changes_told: Sparing,
    taken_told: Sparing,
    refused_told: Sparing,
}

impl OdometryService {
    /// Makes the odometry; `resolution_m` is the side of the map's cells, which bounds how exact a reading can be.
    /// Where `has_localizer`, it asks for localizations; `auto` in `localization` means always.
    ///
    /// # Errors
    /// A value is out of range.
    pub fn new(
        config: &OdometryConfig,
        resolution_m: f64,
        localization: &LocalizationConfig,
        has_localizer: bool,
    ) -> Result<Self> {
        config.validate().context("[odometry]")?;
        localization.validate().context("[localization]")?;
        let is_asked = has_localizer && localization.ask != Ask::Never;
        let is_open = config.start.is_open() && is_asked;
        let mut asking = has_localizer.then(|| Asking::new(localization));
        if let Some(asking) = asking.as_mut().filter(|_| is_open) {
            asking.urge(Reason::Start);
        }
        let state = State {
            odometry: Odometry::new(config),
            sensor: NominalSensor::of(&Robot::default()),
            estimate: None,
            distance_m: 0.0,
            history: History::default(),
            asking,
            requests: 0,
            asked: None,
            early: None,
            placing: is_open.then(Placing::default),
            leaps: Leaps::default(),
            leapt: Incidents::default(),
            contradictions: Incidents::default(),
        };
        let sparing = Sparing::default;
        Ok(Self {
            resolution_m,
            config: localization.clone(),
            state,
            was: (false, false),
            changes_told: sparing(),
            taken_told: sparing(),
            refused_told: sparing(),
        })
    }

    /// Makes the odometry from the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        let mapper: MapperConfig = plan.section("mapper")?;
        let has_localizer = !plan.consumers_of(Topic::LocalizationRequest).is_empty();
        Self::new(&plan.section("odometry")?, mapper.resolution_m, &plan.section("localization")?, has_localizer)
    }

    fn moved(&mut self, stamp_ns: u64, raw: &RawOdometry, out: &mut Outbox) {
        let before = self.state.estimate.map(|estimate| estimate.pose);
        let RawOdometry { odom_from_base, v_mps, w_radps } = *raw;
        let leap = self.state.leaps.next(DrivePose { stamp_ns, odom_from_base, v_mps, w_radps });
        let estimate = match &leap {
            Some(leap) => {
                self.leapt(stamp_ns, leap);
                self.state.odometry.leapt(odom_from_base, leap)
            }
            None => self.state.odometry.step(odom_from_base),
        };
        self.state.distance_m += before.map_or(0.0, |before: Pose2| before.distance_m(estimate.pose));
        self.state.history.push(stamp_ns, odom_from_base, leap, &self.state.odometry);
        let told = self.tell(stamp_ns, estimate, out);
        if let Some((fix_ns, fix)) = self.state.early.filter(|(fix_ns, _)| *fix_ns <= stamp_ns) {
            self.state.early = None;
            self.take(fix_ns, &fix, out);
        } else {
            self.ask(stamp_ns, told, out);
        }
    }

    /// Counts a leap, and asks where the robot is now.
    fn leapt(&mut self, stamp_ns: u64, leap: &Leap) {
        self.state.leapt.add(stamp_ns, leap.length_m, leap.turn_rad);
        if Incidents::is_worth_a_line(self.state.leapt.count) {
            tracing::warn!(
                leaps = self.state.leapt.count,
                stamp_s = stamp_ns as f64 * 1e-9,
                "the odometry leapt by {:.2} m and {:.0}°, which no drive does",
                leap.length_m,
                leap.turn_rad.to_degrees()
            );
        }
        if let Some(asking) = &mut self.state.asking {
            asking.urge(Reason::Leap);
        }
    }

    /// Publishes where the robot is now, and how far to believe it.
    fn tell(&mut self, stamp_ns: u64, estimate: Estimate, out: &mut Outbox) -> PoseEstimate {
        self.state.estimate = Some(estimate);
        let trust = self.state.sensor.trust(&estimate.errors, self.resolution_m);
        let degraded = self.config.is_degraded(trust);
        let hold = degraded && self.config.hold.resolve(self.state.asking.is_some());
        self.tell_the_log(stamp_ns, trust, degraded, hold);
        let told = PoseEstimate {
            degraded,
            hold,
            unplaced: self.state.placing.is_some(),
            leaps: self.state.leapt,
            contradictions: self.state.contradictions,
            ..PoseEstimate::plain(estimate, trust, self.state.distance_m)
        };
        out.send(stamp_ns, Message::Estimate(told.clone()));
        told
    }

    /// Says when what the estimate is good for changes.
    fn tell_the_log(&mut self, stamp_ns: u64, trust: f64, degraded: bool, hold: bool) {
        let was = std::mem::replace(&mut self.was, (degraded, hold));
        if was == (degraded, hold) {
            return;
        }
        let Some(withheld) = self.changes_told.is_due(stamp_ns) else { return };
        let distance_m = self.state.distance_m;
        let what = match (degraded, hold) {
            (true, true) => "degraded: mapping holds",
            (true, false) => "degraded: mapping goes on",
            (false, _) if was.1 => "good again: mapping goes on",
            (false, _) => "good again",
        };
        tracing::info!(stamp_ns, trust, distance_m, withheld, "{what}");
    }

    /// Asks for an absolute localization if it is time for one.
    fn ask(&mut self, stamp_ns: u64, estimate: PoseEstimate, out: &mut Outbox) {
        let Some(asking) = &mut self.state.asking else { return };
        // Who does not wait for an answer does not wait for ever either.
        let given_up =
            self.state.asked.as_ref().is_some_and(|asked| stamp_ns.saturating_sub(asked.stamp_ns) > ANSWER_WITHIN_NS);
        if self.state.asked.is_some() && !given_up {
            return;
        }
        if let Some(reason) = asking.reason(stamp_ns, self.state.distance_m, estimate.degraded) {
            self.state.requests += 1;
            let request = LocalizationRequest { id: self.state.requests, estimate, reason };
            self.state.asked = Some(Asked { stamp_ns, request: request.clone() });
            out.send(stamp_ns, Message::Request(request));
        }
    }

    fn answered(&mut self, stamp_ns: u64, answer: LocalizationFix, out: &mut Outbox) {
        let is_mine = self.state.asked.as_ref().is_some_and(|asked| asked.request.id == answer.request);
        if answer.request != 0 && !is_mine {
            // Of a request that was given up, or was answered before.
            return;
        }
        if is_mine {
            self.state.asked = None;
        }
        match (answer.fix, self.state.history.latest_ns()) {
            (None, _) => self.asked_in_vain(stamp_ns),
            (Some(fix), Some(latest_ns)) if stamp_ns <= latest_ns => self.take(stamp_ns, &fix, out),
            (Some(fix), _) => self.state.early = Some((stamp_ns, fix)),
        }
    }

    /// For whoever is not the user.
    fn gate(&self) -> Gate {
        Gate::closed(self.config.gate_sigmas)
    }

    /// Takes a fix from whoever is not the user: the first says where the map lies, alone or with the one after it.
    fn take(&mut self, fix_ns: u64, fix: &Fix, out: &mut Outbox) {
        let Some(placing) = &mut self.state.placing else { return self.rectify(fix_ns, fix, self.gate(), out) };
        let odom_from_base = self.state.history.odom_from_base(fix_ns);
        match odom_from_base.and_then(|odom_from_base| placing.place(odom_from_base, fix)) {
            Some(whole) => self.rectify(fix_ns, &whole, Gate::placing(), out),
            // Of another place, a little later.
            None => self.asked_in_vain(fix_ns),
        }
    }

    fn asked_in_vain(&mut self, stamp_ns: u64) {
        if let Some(asking) = &mut self.state.asking {
            asking.failed(self.state.history.latest_ns().unwrap_or(stamp_ns));
        }
    }

    /// Applies a fix when it was true, and publishes what that makes of the present.
    fn rectify(&mut self, fix_ns: u64, fix: &Fix, gate: Gate, out: &mut Outbox) {
        let applied = self.state.history.apply(fix_ns, fix, gate);
        let now_ns = self.state.history.latest_ns().unwrap_or(fix_ns);
        let refused = match applied {
            Ok(Applied { odometry, estimate, refused, contradiction }) => {
                self.state.odometry = odometry;
                if let Some(contradiction) = contradiction {
                    self.contradicted(fix_ns, &contradiction);
                }
                if refused.is_none() {
                    self.state.placing = None;
                    self.tell(now_ns, estimate, out);
                }
                self.state.estimate = Some(estimate);
                refused
            }
            Err(error) => Some(error),
        };
        match &refused {
            Some(error) => {
                if let Some(withheld) = self.refused_told.is_due(now_ns) {
                    tracing::warn!(%error, withheld, "localization refused");
                }
            }
            None => {
                if let Some(withheld) = self.taken_told.is_due(now_ns) {
                    let Pose2 { x, y, theta } = fix.pose;
                    tracing::info!(fix_ns, x, y, theta, withheld, "localized: fix taken");
                }
            }
        }
        if let Some(asking) = &mut self.state.asking {
            if refused.is_some() {
                asking.failed(now_ns);
            } else {
                asking.fixed(now_ns, self.state.distance_m);
            }
        }
    }
}

impl OdometryService {
    /// Counts a fix that no odometry is so bad to be off by, and says so the first time.
    fn contradicted(&mut self, fix_ns: u64, found: &Contradiction) {
        self.state.contradictions.add(fix_ns, found.off_m, found.off_rad);
        let count = self.state.contradictions.count;
        if Incidents::is_worth_a_line(count) {
            tracing::warn!(
                count,
                stamp_s = fix_ns as f64 * 1e-9,
                "fix and odometry contradict each other: {:.2} m and {:.0}° apart after {:.1} m; is the fix of this drive, and in \
                 metres and radians?",
                found.off_m,
                found.off_rad.to_degrees(),
                found.travel_m
            );
        }
    }
}

/// Name of the only part that is saved.
const STATE: &str = "state";
/// A request that nobody answered is made again after this, by the sensor's clock (where the odometry does not wait).
const ANSWER_WITHIN_NS: u64 = 10_000_000_000;

impl Service for OdometryService {
    fn inputs(&self) -> &'static [Topic] {
        INPUTS
    }

    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn is_ready_for(&self, topic: Topic) -> bool {
        topic != Topic::OdometryRaw || self.state.asked.is_none() || self.config.wait == Choice::Never
    }

    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()> {
        let Input::Message { stamp_ns, message, .. } = input else { return Ok(()) };
        match message {
            Message::Robot(robot) => self.state.sensor = NominalSensor::of(&robot),
            Message::Odometry(raw) => self.moved(stamp_ns, &raw, out),
            Message::Fix(answer) => self.answered(stamp_ns, answer, out),
            _ => {}
        }
        Ok(())
    }

    fn save(&mut self, parts: &mut Parts) {
        parts.put_value(STATE, &self.state);
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        self.state = saved.value(STATE)?;
        Ok(())
    }

    fn welcome(&mut self, topic: Topic, out: &mut Outbox) {
        // It may not have heard what was asked of the one before it.
        if let Some(Asked { stamp_ns, request }) =
            self.state.asked.clone().filter(|_| topic == Topic::LocalizationRequest)
        {
            out.send(stamp_ns, Message::Request(request));
        }
    }

    fn command(&mut self, command: Command, out: &mut Outbox) -> Result<String> {
        let Command::Fix(fix) = command else { bail!("this service has nothing to {}", command.word()) };
        fix.validate()?;
        let Some(now_ns) = self.state.history.latest_ns() else {
            bail!("no odometry has come yet that could be rectified")
        };
        let before = self.state.estimate.map(|estimate| estimate.pose).unwrap_or_default();
        self.rectify(now_ns, &fix, Gate::open(), out);
        let after = self.state.estimate.map(|estimate| estimate.pose).unwrap_or_default();
        Ok(format!(
            "localized, {:.2} m and {:.1}° from where the robot was believed to be",
            before.distance_m(after),
            echogrid_core::wrap_angle(after.theta - before.theta).abs().to_degrees()
        ))
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run("odometry", INPUTS, OUTPUTS, OdometryService::from_plan)
}

#[cfg(test)]
mod tests;
