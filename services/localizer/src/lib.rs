//! Answers when an absolute localization is asked for (paper sections 3.1 and 4.1): where the robot was at the stamp of the
//! request, from something that does not drift.
//!
//! An answer depends on the request and the stamps alone, so that a replay is rectified as the run was.

mod answer;
pub mod config;
mod drive;
mod landmarks;
mod reference;
mod saved_map;
mod source;
mod truth;

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::ExitCode;

use answer::Answer;
use anyhow::{Context, Result, ensure};
use config::LocalizerConfig;
use drive::Drive;
use echogrid_core::DrivePose;
use echogrid_core::parts::{Parts, Saved};
use echogrid_service::{Declaration, Input, Outbox, Plan, Service, process};
use echogrid_topics::{LocalizationFix, LocalizationRequest, Message, RawOdometry, Topic};
use serde::{Deserialize, Serialize};
use source::Source;
use truth::Truth;

/// What it reads, unless it is in a map that it localizes. The requests end last, after the end of the truth was sent: what is read
/// after them is read to its end.
pub const INPUTS: &[Topic] = &[Topic::LocalizationRequest, Topic::TruePose];
/// What it reads where it localizes in a map: what the odometry reads, and what the sensors hear and see.
pub const MAP_INPUTS: &[Topic] =
    &[Topic::RobotDescription, Topic::RangeScan, Topic::OdometryRaw, Topic::LocalizationRequest];
/// Either: which of them in a graph its plan says.
const ALL_INPUTS: &[Topic] =
    &[Topic::RobotDescription, Topic::RangeScan, Topic::OdometryRaw, Topic::LocalizationRequest, Topic::TruePose];
/// What it writes.
pub const OUTPUTS: &[Topic] = &[Topic::LocalizationFix];
/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: INPUTS, looks_on: &[], writes: OUTPUTS, orders: &[] };

/// What it declares of itself where it localizes in a map.
pub const MAP_DECLARATION: Declaration = Declaration { reads: MAP_INPUTS, ..DECLARATION };

/// Name of the only part that is saved.
const STATE: &str = "state";

/// The localizer service.
#[derive(Debug)]
pub struct LocalizerService {
    source: Source,
    state: State,
}

/// What the messages so far have come to.
#[derive(Debug, Default, Serialize, Deserialize)]
struct State {
    truth: Truth,
    drive: Drive,
    /// Requests, with their stamps, of times that the truth has not reached.
    waiting: VecDeque<(u64, LocalizationRequest)>,
    /// Requests that were answered without a fix.
    unanswered: u64,
    /// What the files of the configuration came to when the run began: another life must not answer by others.
    files: u32,
}

impl LocalizerService {
    /// From the configuration; reads the files that it names.
    ///
    /// # Errors
    /// A value is out of range, or a file can't be read or makes no sense.
    pub fn new(config: &LocalizerConfig) -> Result<Self> {
        config.validate().context("[localizer]")?;
        let source = Source::new(config)?;
        let files = checksum(config.files().into_iter().map(|(_, file)| file)).context("[localizer]")?;
        Ok(Self { source, state: State { files, ..State::default() } })
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
        while let Some((stamp_ns, request)) = self.state.waiting.front() {
            let fix = match self.source.answer(*stamp_ns, request, &self.state.truth, &self.state.drive) {
                Answer::NotYet => break,
                Answer::Fix(fix) => Some(fix),
                Answer::TooEarly => None,
                Answer::Unknown(why) => {
                    self.state.unanswered += 1;
                    // The first tells what is wrong, and there may be thousands.
                    if self.state.unanswered == 1 {
                        tracing::warn!(request = request.id, stamp_ns, why, "where the robot was can't be told");
                    } else {
                        tracing::debug!(request = request.id, stamp_ns, why, "where the robot was can't be told");
                    }
                    None
                }
            };
            out.send(*stamp_ns, Message::Fix(LocalizationFix { request: request.id, fix }));
            self.state.waiting.pop_front();
        }
    }
}

impl Service for LocalizerService {
    fn inputs(&self) -> &'static [Topic] {
        if matches!(self.source, Source::Map(_)) { MAP_INPUTS } else { INPUTS }
    }

    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn outlives(&self, topic: Topic) -> bool {
        // Not every sensor knows the truth, or says that it ends.
        topic == Topic::LocalizationRequest
    }

    fn save(&mut self, parts: &mut Parts) {
        parts.put_value(STATE, &self.state);
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        let state: State = saved.value(STATE)?;
        ensure!(
            state.files == self.state.files,
            "the files that say where the robot was (localizer.{}) are others than when the run began; put them back, or begin anew",
            self.source.key()
        );
        self.state = state;
        Ok(())
    }

    fn note(&self) -> String {
        let unanswered = match self.state.unanswered {
            0 => String::new(),
            1 => "once where the robot was could not be told".to_owned(),
            times => format!("{times} times where the robot was could not be told"),
        };
        let oddity = match &self.source {
            Source::Map(map) => map.oddity(&self.state.drive),
            _ => "",
        };
        let said: Vec<&str> = [oddity, &unanswered].into_iter().filter(|said| !said.is_empty()).collect();
        said.join("; ")
    }

    fn ended(&mut self, topic: Topic, out: &mut Outbox) {
        match topic {
            Topic::RangeScan => self.state.drive.scans_ended(),
            Topic::OdometryRaw => self.state.drive.odometry_ended(),
            _ => {}
        }
        self.answer_waiting(out);
    }

    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()> {
        match input {
            Input::Message { stamp_ns, message: Message::TruePose(pose), .. } => {
                self.state.truth.push(stamp_ns, pose.map_from_base);
            }
            Input::Message { stamp_ns, message: Message::Request(request), .. } => {
                self.state.waiting.push_back((stamp_ns, request));
            }
            Input::Message { message: Message::Robot(robot), .. } => self.state.drive.described(robot),
            Input::Message { stamp_ns, message: Message::Odometry(raw), .. } => {
                let RawOdometry { odom_from_base, v_mps, w_radps } = raw;
                self.state.drive.moved(DrivePose { stamp_ns, odom_from_base, v_mps, w_radps });
            }
            Input::Message { stamp_ns, message: Message::Scan(readings), .. } => {
                self.state.drive.scanned(stamp_ns, readings);
            }
            Input::Finish if self.state.unanswered > 1 => {
                tracing::warn!(requests = self.state.unanswered, "so often where the robot was could not be told");
            }
            Input::Message { .. } | Input::Finish => {}
        }
        self.answer_waiting(out);
        Ok(())
    }
}

/// The CRC-32 of what is in some files, one after the other.
fn checksum<'a>(files: impl Iterator<Item = &'a Path>) -> Result<u32> {
    let mut sum = crc32fast::Hasher::new();
    for path in files {
        let shown = || path.display().to_string();
        let mut file = BufReader::with_capacity(1 << 20, File::open(path).with_context(shown)?);
        loop {
            let read = file.fill_buf().with_context(shown)?.len();
            if read == 0 {
                break;
            }
            sum.update(file.buffer());
            file.consume(read);
        }
    }
    Ok(sum.finalize())
}

/// Runs it as this process.
#[must_use]
pub fn main() -> ExitCode {
    process::run("localizer", ALL_INPUTS, OUTPUTS, LocalizerService::from_plan)
}

#[cfg(test)]
mod tests {
    use config::Source;
    use echogrid_core::localization::Reason;
    use echogrid_core::{Estimate, Fix, Pose2};
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
        let estimate = PoseEstimate { degraded: true, hold: true, ..PoseEstimate::plain(estimate, 0.1, 1.0) };
        Message::Request(LocalizationRequest { id, estimate, reason: Reason::Degraded })
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

    #[test]
    fn a_reference_answers_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let reference = folder.path().join("path.txt");
        std::fs::write(&reference, "1 0 0 0\n2 1 0 0\n9 8 0 0\n").unwrap();
        let config = LocalizerConfig { source: Source::Reference, reference, ..LocalizerConfig::default() };
        let mut service = service(&config);
        let exact = |x| Some(Fix::certain(Pose2::new(x, 0.0, 0.0)));
        for (id, (stamp_s, fix)) in (1..).zip([(1.5, exact(0.5)), (2.0, exact(1.0)), (5.0, None), (10.0, None)]) {
            let answers = give(&mut service, (stamp_s * 1e9) as u64, request(id));
            assert_eq!(answers, [LocalizationFix { request: id, fix }], "{stamp_s} s");
        }
        assert_eq!(service.state.unanswered, 2);
    }

    fn empty_map(folder: &std::path::Path) -> std::path::PathBuf {
        let file = folder.join("empty.echogrid");
        let grid = echogrid_core::Grid::new(0.05);
        let (path, provenance) = (Vec::new(), echogrid_formats::map::Provenance::default());
        let map = echogrid_formats::map::MapDocument { grid, doubt: None, facing: None, path, provenance };
        echogrid_formats::map::native::write(&file, &map).unwrap();
        file
    }

    #[test]
    fn another_life_does_not_answer_by_other_files() {
        let folder = tempfile::tempdir().unwrap();
        let reference = folder.path().join("path.txt");
        std::fs::write(&reference, "1 0 0 0\n2 1 0 0\n").unwrap();
        let config =
            LocalizerConfig { source: Source::Reference, reference: reference.clone(), ..LocalizerConfig::default() };
        let (mut parts, mut saved) = (Parts::default(), Saved::default());
        service(&config).save(&mut parts);
        saved.apply(parts.into_changes());
        service(&config).restore(&saved).unwrap();
        std::fs::write(&reference, "1 0 0 0\n2 3 0 0\n").unwrap();
        let error = service(&config).restore(&saved).unwrap_err().to_string();
        assert!(error.contains("localizer.reference") && error.contains("others than when the run began"), "{error}");
    }

    #[test]
    fn files_that_are_wrong_are_told_with_their_key() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            let file = folder.path().join(name);
            std::fs::write(&file, text).unwrap();
            file
        };
        let landmarks = file("marks.toml", "[[landmark]]\nname = \"a\"\nat = [1, 2]\n");
        let plain = LocalizerConfig::default;
        for (config, expected) in [
            (
                LocalizerConfig { source: Source::Reference, reference: file("r", "1 2 3\n"), ..plain() },
                ["localizer.reference", "r: line 1: \"1 2 3\"; expected 4 words"],
            ),
            (
                LocalizerConfig { source: Source::Landmarks, landmarks: file("l", "[[mark]]\n"), ..plain() },
                ["localizer.landmarks", "l: line 1: "],
            ),
            (
                LocalizerConfig { source: Source::Landmarks, landmarks, sightings: file("s", "1 b 1 -"), ..plain() },
                ["localizer.sightings", "s: line 1: landmark is \"b\""],
            ),
            (
                LocalizerConfig { source: Source::Map, map: file("m", "no map"), ..plain() },
                ["localizer.map", "m: not a native map"],
            ),
            (
                LocalizerConfig { source: Source::Map, map: empty_map(folder.path()), ..plain() },
                ["localizer.map: ", "0.0 m of wall"],
            ),
        ] {
            let error = format!("{:#}", LocalizerService::new(&config).unwrap_err());
            assert!(expected.iter().all(|expected| error.contains(expected)), "{error}");
        }
    }
}
