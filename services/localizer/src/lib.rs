//! Answers when an absolute localization is asked for (paper sections 3.1 and 4.1): where the robot was at the stamp of the
//! request, from something that does not drift.
//!
//! An answer depends on the request and the stamps alone, so that a replay is rectified as the run was.

pub mod config;
mod truth;

use std::collections::VecDeque;
use std::process::ExitCode;

use anyhow::{Context, Result};
use config::{LocalizerConfig, Source};
use echogrid_core::Fix;
use echogrid_core::noise::standard_normal_pair;
use echogrid_service::{Input, Outbox, Plan, Service, process};
use echogrid_topics::{LocalizationFix, LocalizationRequest, Message, Topic};
use truth::{Known, Truth};

/// What it reads. The requests end last, after the end of the truth was sent: what is read after them is read to its end.
pub const INPUTS: &[Topic] = &[Topic::LocalizationRequest, Topic::TruePose];
/// What it writes.
pub const OUTPUTS: &[Topic] = &[Topic::LocalizationFix];

/// The localizer service.
#[derive(Debug)]
pub struct LocalizerService {
    config: LocalizerConfig,
    truth: Truth,
    /// Requests, with their stamps, of times that the truth has not reached.
    waiting: VecDeque<(u64, LocalizationRequest)>,
}

impl LocalizerService {
    /// From the configuration.
    ///
    /// # Errors
    /// A value is out of range.
    pub fn new(config: &LocalizerConfig) -> Result<Self> {
        config.validate().context("[localizer]")?;
        Ok(Self { config: config.clone(), truth: Truth::default(), waiting: VecDeque::new() })
    }

    /// From the plan of a run.
    ///
    /// # Errors
    /// A section is missing or wrong.
    pub fn from_plan(plan: &Plan) -> Result<Self> {
        Self::new(&plan.section("localizer")?)
    }

    /// Answers what can be answered by now.
    fn answer_waiting(&mut self, out: &mut Outbox) {
        while let Some((stamp_ns, request)) = self.waiting.front() {
            let Some(fix) = self.locate(*stamp_ns, request) else { break };
            if fix.is_none() {
                tracing::debug!(request = request.id, stamp_ns, "the robot can't be localized");
            }
            out.send(*stamp_ns, Message::Fix(LocalizationFix { request: request.id, fix }));
            self.waiting.pop_front();
        }
    }

    /// Where the robot was; none inside if that can't be told, none outside if it can't be told yet.
    fn locate(&self, stamp_ns: u64, request: &LocalizationRequest) -> Option<Option<Fix>> {
        match self.config.source {
            Source::None | Source::Operator => Some(None),
            Source::Truth => match self.truth.at(stamp_ns) {
                Known::NotYet => None,
                Known::Never => Some(None),
                Known::Pose(pose) => Some(Some(self.about(Fix::certain(pose), request.id))),
            },
        }
    }

    /// The fix with the error that the source is configured to have; the same request draws the same error.
    fn about(&self, exact: Fix, request: u64) -> Fix {
        let LocalizerConfig { position_sigma_m, heading_sigma_rad, seed, .. } = self.config;
        let (x, y) = standard_normal_pair(seed, request, 0);
        let (theta, _) = standard_normal_pair(seed, request, 1);
        let pose = echogrid_core::Pose2::new(
            exact.pose.x + position_sigma_m * x,
            exact.pose.y + position_sigma_m * y,
            exact.pose.theta + heading_sigma_rad * theta,
        );
        Fix::about(pose, position_sigma_m, heading_sigma_rad)
    }
}

impl Service for LocalizerService {
    fn inputs(&self) -> &'static [Topic] {
        INPUTS
    }

    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn outlives(&self, topic: Topic) -> bool {
        // Not every sensor knows the truth, or says that it ends.
        topic == Topic::LocalizationRequest
    }

    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()> {
        match input {
            Input::Message { stamp_ns, message: Message::TruePose(pose), .. } => {
                self.truth.push(stamp_ns, pose.map_from_base);
            }
            Input::Message { stamp_ns, message: Message::Request(request), .. } => {
                self.waiting.push_back((stamp_ns, *request));
            }
            Input::Message { .. } | Input::Finish => {}
        }
        self.answer_waiting(out);
        Ok(())
    }
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run("localizer", INPUTS, OUTPUTS, LocalizerService::from_plan)
}

#[cfg(test)]
mod tests {
    use echogrid_core::localization::Reason;
    use echogrid_core::{Estimate, Pose2};
    use echogrid_topics::{PoseEstimate, TruePose};

    use super::*;

    fn service(config: &LocalizerConfig) -> LocalizerService {
        LocalizerService::new(config).unwrap()
    }

    fn give(service: &mut LocalizerService, stamp_ns: u64, message: Message) -> Vec<LocalizationFix> {
        let mut out = Outbox::default();
        service.step(Input::Message { sequence: 1, stamp_ns, message }, &mut out).unwrap();
        std::iter::from_fn(|| out.pop())
            .map(|(_, message)| match message {
                Message::Fix(fix) => fix,
                other => panic!("{other:?}"),
            })
            .collect()
    }

    fn truth(x: f64) -> Message {
        Message::TruePose(TruePose { map_from_base: Some(Pose2::new(x, 0.0, 0.0)) })
    }

    fn request(id: u64) -> Message {
        let estimate = Estimate::certain(Pose2::IDENTITY);
        let estimate = PoseEstimate { estimate, trust: 0.1, distance_m: 1.0, degraded: true, hold: true };
        Message::Request(Box::new(LocalizationRequest { id, estimate, reason: Reason::Degraded }))
    }

    #[test]
    fn answers_once_the_truth_is_known_whichever_comes_first() {
        let config = LocalizerConfig { source: Source::Truth, ..LocalizerConfig::default() };
        let exact = |x| Some(Fix::certain(Pose2::new(x, 0.0, 0.0)));
        let mut early = service(&config);
        assert!(give(&mut early, 100, request(1)).is_empty());
        assert!(give(&mut early, 50, truth(1.0)).is_empty());
        assert_eq!(give(&mut early, 100, truth(2.0)), [LocalizationFix { request: 1, fix: exact(2.0) }]);
        let mut late = service(&config);
        for (stamp_ns, x) in [(50, 1.0), (100, 2.0), (150, 3.0)] {
            assert!(give(&mut late, stamp_ns, truth(x)).is_empty());
        }
        assert_eq!(give(&mut late, 100, request(1)), [LocalizationFix { request: 1, fix: exact(2.0) }]);
    }

    #[test]
    fn says_so_when_nobody_knows() {
        let mut service = service(&LocalizerConfig { source: Source::Truth, ..LocalizerConfig::default() });
        assert!(give(&mut service, 100, request(1)).is_empty());
        let unknown = Message::TruePose(TruePose { map_from_base: None });
        assert_eq!(give(&mut service, 100, unknown), [LocalizationFix { request: 1, fix: None }]);
    }

    #[test]
    fn errors_are_as_large_as_configured_and_the_same_again() {
        let config = LocalizerConfig {
            source: Source::Truth,
            position_sigma_m: 0.2,
            heading_sigma_rad: 0.05,
            ..LocalizerConfig::default()
        };
        let fixes = || {
            let mut service = service(&config);
            give(&mut service, 0, truth(0.0));
            let answers = (1..=2000).flat_map(|id| give(&mut service, 0, request(id)));
            answers.map(|answer| answer.fix.unwrap()).collect::<Vec<_>>()
        };
        let first = fixes();
        assert_eq!(first, fixes());
        let spread = |value: fn(&Fix) -> f64| {
            (first.iter().map(|fix| value(fix) * value(fix)).sum::<f64>() / first.len() as f64).sqrt()
        };
        // Five standard errors of a standard deviation over 2000 draws: 8 %.
        for (found, expected) in
            [(spread(|f| f.pose.x), 0.2), (spread(|f| f.pose.y), 0.2), (spread(|f| f.pose.theta), 0.05)]
        {
            assert!((found / expected - 1.0).abs() < 0.08, "{found} {expected}");
        }
        assert!((first[0].covariance[(1, 1)] - 0.04).abs() < 1e-15);
    }
}
