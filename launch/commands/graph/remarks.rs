//! What is worth knowing of a log and its run, besides the figures.

use echogrid_core::config::Poses;
use echogrid_formats::log::LogSurvey;

use crate::config::RunSetting;

/// What is said of poses that do not seem to be a drive's.
pub(super) fn suggestion(survey: &LogSurvey, poses: Poses) -> Option<String> {
    let percent = 100.0 * survey.sideways.share();
    let slide = format!("its poses slide sideways on {percent:.0} % of their way, as those of wheels do not");
    match percent {
        _ if !survey.sideways.is_no_drive() => None,
        // No correction is so large: what they call ahead is not where they go.
        60.0.. => Some(format!("{slide}: are x, y and heading in order, and not mirrored?")),
        _ if poses == Poses::Exact => None,
        _ => Some(format!(
            "{slide}: if they are a SLAM's or from motion capture, --poses exact says that they have no error"
        )),
    }
}

/// What is said where a recording is mapped with settings of its run.
pub(super) fn of_its_run(settings: &[RunSetting]) -> Option<String> {
    let list: Vec<String> = settings.iter().map(|(key, value)| format!("{key} = {value}")).collect();
    let why = "as in the run that it is of (--set replay.use_settings=false takes the defaults)";
    (!list.is_empty()).then(|| format!("mapped with {}, {why}", list.join(", ")))
}

/// What is worth knowing of a log besides its counts.
pub(in crate::commands) fn of_log(survey: &LogSurvey) -> Vec<String> {
    let mut remarks = survey.clock.remarks();
    remarks.extend(survey.remarks.iter().cloned());
    remarks.extend(survey.faults.iter().map(ToString::to_string));
    if !survey.skipped.is_empty() {
        let kinds: Vec<String> = survey.skipped.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        remarks.push(format!("messages not used: {}", kinds.join(", ")));
    }
    remarks
}
