//! Logs of CMU's Wean Hall: centimetres and radians, stamps in seconds since the log began.
//!
//! `L x y theta xl yl thetal r1 … rn t` a scan with the pose of the robot and that of its
//! laser, from right to left; 8183 and 8191 mean that nothing came back.
//! `O x y theta t` is odometry between them. It is not used: a scan's stamp is some 0.2 s younger than the pose that stands
//! beside it, which is where it was measured, so with the poses of both the robot seems to go to and fro.

use echogrid_core::Pose2;

use crate::log::carmen::message::{Carried, Message, ScanKind, ScanLine, Shape, Words};
use crate::log::carmen::plain_fan;
use crate::log::fault::{FaultKind, Refusal};

const M_PER_CM: f64 = 0.01;

/// Whether the first line that is not blank is of this kind.
pub(super) fn looks_like<'a>(mut lines: impl Iterator<Item = &'a str>) -> bool {
    let Some(line) = lines.find(|line| !line.trim().is_empty()) else { return false };
    let mut words = line.split_ascii_whitespace();
    let least = match words.next() {
        Some("O") => 4,
        Some("L") => 8,
        _ => return false,
    };
    let mut count = 0;
    let are_numbers = words.all(|word| {
        count += 1;
        word.parse::<f64>().is_ok()
    });
    are_numbers && count >= least && (least > 4 || count == 4)
}

pub(super) fn parse(line: &[u8]) -> Result<Message<'static>, Refusal> {
    let mut words = Words::new(line)?;
    let Some(name) = words.next_word() else { return Ok(Message::Nothing) };
    match name {
        "O" => Ok(Message::Other { name: "O" }),
        "L" => {
            let odom_from_base = pose(&mut words)?;
            let odom_from_sensor = Some(pose(&mut words)?);
            let count = words.left().checked_sub(1).filter(|count| *count > 0);
            let count = count.ok_or_else(|| Refusal::new(FaultKind::Truncated, "end of line"))?;
            let mut ranges = words.ranges(count)?;
            ranges.iter_mut().for_each(|range| *range *= M_PER_CM);
            let stamp_ns = words.last_stamp()?;
            let (first_bearing_rad, bearing_step_rad) = plain_fan(count);
            Ok(Message::Scan(ScanLine {
                kind: ScanKind::Front,
                shape: Shape::Fan { first_bearing_rad, bearing_step_rad, range_max_m: None },
                ranges,
                carried: Some(Carried { odom_from_base, odom_from_sensor, v_mps: 0.0, w_radps: 0.0 }),
                stamp_ns,
                described: None,
                oddities: Vec::new(),
            }))
        }
        _ => Err(Refusal::new(FaultKind::NotAMessage, String::from_utf8_lossy(line.get(..200).unwrap_or(line)))),
    }
}

fn pose(words: &mut Words<'_>) -> Result<Pose2, Refusal> {
    let pose = words.pose()?;
    Ok(Pose2 { x: pose.x * M_PER_CM, y: pose.y * M_PER_CM, theta: pose.theta })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centimetres_become_metres() {
        let Message::Scan(scan) = parse(b"L 100 -50 0.5 125 -50 0.5 200 8183 12.5").unwrap() else { panic!() };
        let carried = scan.carried.unwrap();
        assert_eq!(
            (carried.odom_from_base.x, carried.odom_from_base.y, carried.odom_from_base.theta),
            (1.0, -0.5, 0.5)
        );
        assert_eq!(carried.odom_from_sensor.unwrap().x, 1.25);
        assert_eq!((scan.ranges, scan.stamp_ns), (vec![2.0, 81.83], Some(12_500_000_000)));
    }

    #[test]
    fn what_is_wrong_is_told_apart() {
        let check = |line: &str, expected: FaultKind| assert_eq!(parse(line.as_bytes()).unwrap_err().kind, expected);
        check("L 1 2 3 4 5 6 0.5", FaultKind::Truncated);
        check("L 1 2 3", FaultKind::Truncated);
        check("L 1 2 x 4 5 6 7 0.5", FaultKind::BadNumber);
        check("L 1 nan 3 4 5 6 7 0.5", FaultKind::NotFinite);
        check("M 1 2 3", FaultKind::NotAMessage);
        assert_eq!(parse(b"").unwrap(), Message::Nothing);
    }
}
