//! Logs and recordings.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use echogrid_core::{Sensor, SensorKind};
use echogrid_formats::log::{self, LogError, LogSurvey, RecordingContents};
use serde_json::json;

use super::{Facts, date, span};
use crate::commands::graph::remarks;
use crate::config::settings_of_recording;

/// Stamps before 2000 are those of a clock that began anywhere.
const DATED_FROM_NS: u64 = 946_684_800_000_000_000;
/// Sensors of one kind that are told one by one.
const SENSORS_SHOWN: usize = 32;

pub(super) fn facts(file: &Path) -> Result<Facts> {
    let format = log::detect_format(file)?;
    let mut facts = Facts::new(format.to_string(), "log");
    facts.value("format", json!(format));
    let contents = log::contents(file)?;
    match log::survey(file) {
        Ok(survey) => surveyed(&mut facts, &survey),
        // What is in a recording is told even where it takes a choice to map it.
        Err(error) if contents.is_some() => {
            let why = match &error {
                LogError::Topics { why, .. } => why.clone(),
                other => other.to_string(),
            };
            facts.line("to map it", why.clone());
            facts.value("unmappable", why);
        }
        Err(error) => return Err(error.into()),
    }
    if let Some(contents) = contents {
        recorded(&mut facts, &contents);
    }
    if let Some(settings) = settings_of_recording(file)? {
        for (key, value) in &settings {
            facts.line("settings", format!("{key} = {value}"));
        }
        if settings.is_empty() {
            facts.line("settings", "of its run: the defaults");
        }
        facts.value("settings", json!(settings.into_iter().collect::<BTreeMap<_, _>>()));
    }
    Ok(facts)
}

fn surveyed(facts: &mut Facts, survey: &LogSurvey) {
    let seconds = survey.duration().as_secs_f64();
    let begins = match survey.first_stamp_ns {
        first_ns if first_ns >= DATED_FROM_NS && !survey.clock.order_only => format!(", from {} on", date(first_ns)),
        _ => String::new(),
    };
    let rate = |count: u64| if seconds > 0.0 { format!(" ({:.1} Hz)", count as f64 / seconds) } else { String::new() };
    facts.line("time", format!("{}{begins}", span(seconds)));
    facts.line(
        "odometry",
        format!("{} poses{}, {:.1} m", survey.odometry_count, rate(survey.odometry_count), survey.distance_m),
    );
    facts.line("scans", format!("{}{}, {} readings", survey.scan_count, rate(survey.scan_count), survey.reading_count));
    for sensor in survey.robot.sensors.iter().take(SENSORS_SHOWN) {
        facts.line("sensors", words(sensor));
    }
    let untold = survey.robot.sensors.len().saturating_sub(SENSORS_SHOWN);
    if untold > 0 {
        facts.line("sensors", format!("and {untold} more"));
    }
    if survey.true_pose_count > 0 {
        facts.line("truth", format!("{} poses where the robot really was", survey.true_pose_count));
    }
    for remark in remarks::of_log(survey) {
        facts.line("log", remark);
    }
    facts.value("survey", json!(survey));
    facts.value("clock_remarks", json!(survey.clock.remarks()));
}

fn words(sensor: &Sensor) -> String {
    let pose = sensor.base_from_sensor;
    let mount = format!("at ({:.3}, {:.3}) m, {:.1}°", pose.x, pose.y, pose.theta.to_degrees());
    let range = format!("{:.2} to {:.2} m", sensor.range_min_m, sensor.range_max_m);
    let cone = format!("{:.2}° wide", sensor.aperture_rad.to_degrees());
    match sensor.kind {
        SensorKind::Sonar => format!("sonar {mount}, {cone}, {range}"),
        SensorKind::Lidar => {
            let first = sensor.first_bearing_rad.to_degrees();
            let last = first + f64::from(sensor.transducers.saturating_sub(1)) * sensor.bearing_step_rad.to_degrees();
            format!("lidar {mount}, {} beams from {first:.1}° to {last:.1}°, {range}", sensor.transducers)
        }
    }
}

fn recorded(facts: &mut Facts, contents: &RecordingContents) {
    let seconds = contents.last_ns.saturating_sub(contents.first_ns) as f64 * 1e-9;
    let count = contents.messages;
    facts.line("recorded", format!("{count} messages in {}, from {} on", span(seconds), date(contents.first_ns)));
    let name = contents.topics.iter().map(|topic| topic.topic.chars().count()).max().unwrap_or(0).min(60);
    let datatype = contents.topics.iter().map(|topic| topic.datatype.chars().count()).max().unwrap_or(0).min(60);
    for topic in &contents.topics {
        let frames = match topic.frames.as_slice() {
            [] => String::new(),
            [frame] => format!("  in {frame}"),
            frames => format!("  in {} frames", frames.len()),
        };
        let damaged = if topic.damaged > 0 { format!("  {} damaged", topic.damaged) } else { String::new() };
        facts.line(
            "topics",
            format!(
                "{:name$}  {:datatype$}  {:>7}  {:7.1} Hz{frames}{damaged}",
                topic.topic, topic.datatype, topic.count, topic.rate_hz
            ),
        );
    }
    facts.value("recording", json!(contents));
}
