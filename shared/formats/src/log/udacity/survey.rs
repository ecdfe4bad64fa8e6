//! The first pass over a sonar pair.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek};
use std::path::Path;

use sha2::{Digest as _, Sha256};

use super::rows::{Half, Next, Row, Rows};
use super::{SONARS, robot};
use crate::log::carmen::CarmenPlan;
use crate::log::fault::{FaultCounter, Refusal, first_fault};
use crate::log::source::hex;
use crate::log::tally::{EventTally, Summary};
use crate::log::timeline::Rank;
use crate::log::{LogError, LogFormat, LogSurvey};

/// Surveys a sonar pair. The paths are for errors only.
///
/// # Errors
/// When reading fails, or there is no row of poses or none of readings.
pub fn survey(
    mut measurement: impl Read + Seek,
    measurement_path: &Path,
    mut poses: impl Read + Seek,
    poses_path: &Path,
) -> Result<LogSurvey, LogError> {
    let failed =
        |(half, source)| LogError::open(if half == Half::Measurement { measurement_path } else { poses_path }, source);
    let mut hasher = Sha256::new();
    let measurement_bytes = hash(&mut measurement, &mut hasher).map_err(|error| failed((Half::Measurement, error)))?;
    let poses_bytes = hash(&mut poses, &mut hasher).map_err(|error| failed((Half::Poses, error)))?;
    let mut rows = Rows::new(measurement.take(measurement_bytes), poses.take(poses_bytes)).map_err(failed)?;
    let mut faults = FaultCounter::default();
    let mut events = EventTally::new();
    while let Some(next) = rows.next().map_err(failed)? {
        match next {
            Next::Row(Row::Pose { stamp_ns, odom_from_base }) => {
                events.add(Rank::Odometry, Rank::Odometry, Some(odom_from_base), Some(stamp_ns), 0);
            }
            Next::Row(Row::Ranges { stamp_ns, .. }) => {
                events.add(Rank::Scan, Rank::Scan, None, Some(stamp_ns), SONARS);
            }
            Next::Refused(half, line, Refusal { kind, sample }) => {
                let file = if half == Half::Measurement { "measurement" } else { "poses" };
                faults.count(line, Refusal { kind, sample: format!("{file}: {sample}") });
            }
        }
    }
    events.finish();
    let faults = faults.into_faults();
    if events.lines(Rank::Odometry) == 0 {
        return Err(LogError::NoOdometry {
            path: poses_path.to_path_buf(),
            expected: "rows of 4 whole numbers: t x y theta10 (ms, mm, 0.1 deg)",
            first_fault: first_fault(&faults),
        });
    }
    if events.lines(Rank::Scan) == 0 {
        return Err(LogError::NoReadings {
            path: measurement_path.to_path_buf(),
            expected: "rows of 9 whole numbers: t r1 … r8 (ms, mm)",
            first_fault: first_fault(&faults),
        });
    }
    let Summary { stamps, first_stamp_ns, last_stamp_ns, distance_m } = events.summary(Rank::Odometry, |_| true);
    Ok(LogSurvey {
        format: LogFormat::UdacitySonar,
        robot: robot(),
        odometry_count: events.lines(Rank::Odometry),
        scan_count: events.lines(Rank::Scan),
        reading_count: events.lines(Rank::Scan) * SONARS as u64,
        true_pose_count: 0,
        max_readings_per_scan: SONARS,
        first_stamp_ns,
        last_stamp_ns,
        distance_m,
        stamps,
        skipped: BTreeMap::new(),
        faults,
        remarks: Vec::new(),
        sha256: hex(hasher),
        params: BTreeMap::new(),
        byte_counts: vec![measurement_bytes, poses_bytes],
        plan: CarmenPlan::default(),
    })
}

/// Hashes a file to its end and goes back to where it began; how many bytes there were.
fn hash(file: &mut (impl Read + Seek), hasher: &mut Sha256) -> io::Result<u64> {
    let start = file.stream_position()?;
    let mut buffer = vec![0; 64 * 1024];
    let mut bytes = 0;
    loop {
        let length = match file.read(&mut buffer) {
            Ok(0) => break,
            Ok(length) => length,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(error),
        };
        hasher.update(buffer.get(..length).unwrap_or_default());
        bytes += length as u64;
    }
    file.seek(io::SeekFrom::Start(start))?;
    Ok(bytes)
}
