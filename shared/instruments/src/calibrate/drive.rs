//! Trials out of recordings, as the services see them: the replay plays the log, the localizer says where the robot was.

use std::collections::VecDeque;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use echogrid_core::calibration::{Drive, Limits, TRIALS_MIN, separate};
use echogrid_core::localization::Reason;
use echogrid_core::{Estimate, Pose2};
use echogrid_formats::log;
use echogrid_localizer::LocalizerService;
use echogrid_replay::Replay;
use echogrid_service::{Input, Outbox, Sensor as _, Service as _};
use echogrid_topics::{LocalizationRequest, Message, PoseEstimate};

use super::request::Calibrate;
use super::trials::{Found, names};
use echogrid_config::{Config, LoadRequest};

/// The pieces of all logs that make trials.
pub(super) fn trials(request: &Calibrate) -> Result<Found> {
    ensure!(request.series.is_none(), "--series is for tables; expected none with logs");
    let limits = Limits::default();
    let (mut translations, mut rotations, mut known) = (Vec::new(), Vec::new(), 0);
    for file in &request.inputs {
        let drive = drive(request, file, limits)?;
        known += drive.known();
        let (more_translations, more_rotations) = drive.trials();
        translations.extend(more_translations);
        rotations.extend(more_rotations);
    }
    let name = names(&request.inputs);
    ensure!(
        translations.len() >= TRIALS_MIN && rotations.len() >= TRIALS_MIN,
        "{name}: {} translations (of {} m or more, with less than {} rad turned) and {} rotations (of {} rad or more, \
         within {} m) in it; expected {TRIALS_MIN} or more of each",
        translations.len(),
        limits.straight_min_m,
        limits.straight_turn_rad,
        rotations.len(),
        limits.turn_min_rad,
        limits.turn_travel_m,
    );
    separate(&mut translations, &mut rotations).with_context(|| name.clone())?;
    Ok(Found { name, translations, rotations, known: Some(known), given: None })
}

/// What is asked of the configuration: who knows where the robot was.
fn request(request: &Calibrate, log: &Path) -> LoadRequest {
    let path = |path: &Path| path.to_string_lossy().into_owned();
    let mut sets = Vec::new();
    if let Some(reference) = &request.reference {
        // Between poses that are farther apart in time, a straight line would be no truth to measure by.
        sets.extend(["localizer.source=reference".to_owned(), "localizer.reference_gap_s=1".to_owned()]);
        sets.push(format!("localizer.reference={}", path(reference)));
    } else if let (Some(landmarks), Some(sightings)) = (&request.landmarks, &request.sightings) {
        // The robot drives on meanwhile.
        sets.extend(["localizer.source=landmarks".to_owned(), "localizer.sightings_within_s=0.1".to_owned()]);
        sets.push(format!("localizer.landmarks={}", path(landmarks)));
        sets.push(format!("localizer.sightings={}", path(sightings)));
    } else {
        sets.push("localizer.source=truth".to_owned());
    }
    sets.extend(request.sets.iter().cloned());
    LoadRequest { log: Some(path(log)), robot: request.robot.clone(), sets, ..LoadRequest::default() }
}

fn drive(asked: &Calibrate, file: &Path, limits: Limits) -> Result<Drive> {
    let config = Config::load(&request(asked, file))?.into_config();
    ensure!(
        !config.localizer.needs_truth() || log::survey_with(file, config.replay.survey_options())?.true_pose_count > 0,
        "{}: no true pose in it; expected a log with TRUEPOS lines, or --reference FILE, or --landmarks FILE with --sightings FILE",
        file.display()
    );
    let mut replay = Replay::new(&config.replay, config.robot.clone())?;
    let mut asks = Asks::new(LocalizerService::new(&config.localizer)?, limits);
    while let Some((stamp_ns, message)) = replay.next()? {
        match message {
            Message::TruePose(_) => asks.tell(stamp_ns, message)?,
            Message::Odometry(odometry) => asks.ask(stamp_ns, odometry.odom_from_base)?,
            _ => {}
        }
    }
    let Asks { drive, poses, .. } = asks;
    ensure!(
        drive.known() > 0,
        "{}: where the robot was is known at none of its {poses} odometry poses; expected stamps and landmarks of that drive",
        file.display()
    );
    Ok(drive)
}

/// The localizer, asked at every pose of the odometry.
struct Asks {
    localizer: LocalizerService,
    out: Outbox,
    drive: Drive,
    poses: u64,
    /// Poses without an answer yet.
    waiting: VecDeque<Pose2>,
    /// The last pose that was answered, and the answer: from there the next guess is led on.
    fixed: Option<(Pose2, Pose2)>,
}

impl Asks {
    fn new(localizer: LocalizerService, limits: Limits) -> Self {
        Self {
            localizer,
            out: Outbox::default(),
            drive: Drive::new(limits),
            poses: 0,
            waiting: VecDeque::new(),
            fixed: None,
        }
    }

    fn tell(&mut self, stamp_ns: u64, message: Message) -> Result<()> {
        self.localizer.step(Input::Message { sequence: 0, stamp_ns, message }, &mut self.out)?;
        while let Some((_, message)) = self.out.pop() {
            // Answers come in the order of the requests.
            if let (Message::Fix(answer), Some(odom_from_base)) = (message, self.waiting.pop_front()) {
                let fix = answer.fix.filter(|fix| fix.position_known && fix.heading_known);
                self.drive.push(odom_from_base, fix.map(|fix| fix.pose));
                self.fixed = fix.map(|fix| (odom_from_base, fix.pose)).or(self.fixed);
            }
        }
        Ok(())
    }

    fn ask(&mut self, stamp_ns: u64, odom_from_base: Pose2) -> Result<()> {
        self.poses += 1;
        self.waiting.push_back(odom_from_base);
        let guess = self.fixed.map_or(odom_from_base, |(odom_from_fixed, map_from_fixed)| {
            map_from_fixed * (odom_from_fixed.inverse() * odom_from_base)
        });
        let estimate = PoseEstimate::plain(Estimate::certain(guess), 1.0, 0.0);
        let request = LocalizationRequest { id: self.poses, estimate, reason: Reason::Schedule };
        self.tell(stamp_ns, Message::Request(request))
    }
}
