//! Logs that GMapping writes (`.gfs`): metres, radians, seconds.
//!
//! `LASER_READING n r1 … rn x y theta t` holds what the robot measured, uncorrected, and where its odometry was then: what
//! GMapping itself went by. Odometry between the scans (`ODOM x y theta t`) and what GMapping made of it (`SM_UPDATE`,
//! `ODO_UPDATE`, `NEFF` …) is skipped and counted.

use crate::log::carmen::message::{self, Carried, Message, ScanKind, ScanLine, Shape, Words};
use crate::log::carmen::plain_fan;
use crate::log::fault::Refusal;

pub(super) fn looks_like<'a>(mut lines: impl Iterator<Item = &'a str>) -> bool {
    lines.any(|line| {
        line.starts_with("LASER_READING ") || line.starts_with("SM_UPDATE ") || line.starts_with("ODO_UPDATE ")
    })
}

pub(super) fn parse(line: &[u8]) -> Result<Message<'_>, Refusal> {
    let mut words = Words::new(line)?;
    match words.next_word() {
        Some("ODOM") => Ok(Message::Other { name: "ODOM" }),
        Some("LASER_READING") => {
            let count = words.count()?;
            let ranges = words.ranges(count)?;
            let odom_from_base = words.pose()?;
            let stamp_ns = words.last_stamp()?;
            let (first_bearing_rad, bearing_step_rad) = plain_fan(count);
            Ok(Message::Scan(ScanLine {
                kind: ScanKind::Front,
                shape: Shape::Fan { first_bearing_rad, bearing_step_rad, range_max_m: None },
                ranges,
                carried: Some(Carried { odom_from_base, odom_from_sensor: None, v_mps: 0.0, w_radps: 0.0 }),
                stamp_ns,
                described: None,
                oddities: Vec::new(),
            }))
        }
        _ => message::parse(line),
    }
}
