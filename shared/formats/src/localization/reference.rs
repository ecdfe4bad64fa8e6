//! Reference paths: where a robot was, known from elsewhere (a laser and SLAM, a motion-capture system, a total station).
//!
//! ```text
//! # t x y theta, seconds, metres, radians; map_from_base
//! 21.0199 0.897060 -0.180771 -0.454003
//! 21.9802 0.829539 -0.206873 -1.007360
//! ```
//!
//! Rows have four words; or seven, of which the last three (the raw odometry pose `ox oy otheta` of the reference files that were
//! made with GMapping) must be numbers and are not used; or eight, a trajectory in the format of the TUM benchmark (Sturm et al. 2012),
//! `t x y z qx qy qz qw` with a quaternion of length 1, of which the height is not used and the heading is taken. That is how
//! [`write_tum`] writes one. Any other number of words is refused.
//!
//! `t` is in the log's own time: for a CARMEN log the *ipc timestamp*, the third word from the end of a line, which is what
//! [`crate::log`] stamps its events with. The same decimal text gives the same nanosecond in both. A log whose stamps are
//! useless ([`ClockReport::order_only`](crate::log::ClockReport::order_only)) has none that a reference could share.
//!
//! A pose is that of the robot's base in the map frame. GMapping's references call theirs the pose of the *laser*; but the raw pose
//! that each was corrected from equals the log's odometry at that scan (aces, freiburg-101: exactly), so it is the pose of what the log
//! calls the robot. Should it be the laser's after all, it is off by the laser's mount: nothing for aces, 4 cm for
//! freiburg-101. The map frame of such a reference is the odometry frame at the start of the log, to within what the first scans
//! corrected (centimetres).

use std::fmt::Write as _;
use std::path::Path;

use echogrid_core::Pose2;

use super::rows::{Row, count_moved, rows};
use crate::text::{TextError, TextFileError, read_text};
use crate::whole_file::{WriteError, write_whole};

/// Longest reference file, bytes.
pub const REFERENCE_BYTES_MAX: u64 = 64 << 20;

const ROW: &str = "4 words `t x y theta`, 7 with the raw odometry pose after them, or 8 `t x y z qx qy qz qw`";
/// A quaternion is of length 1 to within this.
const UNIT: f64 = 0.01;
/// An angle beyond this is no angle, radians.
const ANGLE_MAX_RAD: f64 = 1e6;

/// A path of poses `map_from_base`, by stamp.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePath {
    /// By stamp, each later than the one before.
    poses: Vec<(u64, Pose2)>,
    moved: usize,
}

impl ReferencePath {
    /// Reads a reference file.
    ///
    /// # Errors
    /// When the file can't be read, is longer than [`REFERENCE_BYTES_MAX`], or is refused by [`ReferencePath::parse`].
    pub fn read(path: &Path) -> Result<Self, TextFileError> {
        read_text(path, REFERENCE_BYTES_MAX, Self::parse)
    }

    /// The path that a text tells. Rows that are out of order are sorted, and counted.
    ///
    /// # Errors
    /// When a row is none, a number is not finite or absurd, two rows have one stamp, or there is no row.
    pub fn parse(text: &str) -> Result<Self, TextError> {
        let mut found = rows(text).map(|row| pose(&row)).collect::<Result<Vec<_>, _>>()?;
        if found.is_empty() {
            return Err(TextError { line: 1, found: "no pose".to_owned(), expected: ROW.to_owned() });
        }
        let moved = count_moved(found.iter().map(|(stamp_ns, ..)| *stamp_ns));
        found.sort_unstable_by_key(|(stamp_ns, line, _)| (*stamp_ns, *line));
        let twice = found.windows(2).filter(|pair| pair[0].0 == pair[1].0).min_by_key(|pair| pair[1].1);
        if let Some([(_, first, _), (_, line, _)]) = twice {
            let expected = "a stamp of its own for each pose".to_owned();
            return Err(TextError { line: *line, found: format!("the stamp of line {first} again"), expected });
        }
        Ok(Self { poses: found.into_iter().map(|(stamp_ns, _, pose)| (stamp_ns, pose)).collect(), moved })
    }

    /// The pose at a stamp: as it stands in the file, or between the two poses around the stamp (position on the straight line,
    /// heading along the shorter way) if they are at most `gap_max_ns` apart. None outside the path and in longer gaps.
    #[must_use]
    pub fn at(&self, stamp_ns: u64, gap_max_ns: u64) -> Option<Pose2> {
        match self.poses.binary_search_by_key(&stamp_ns, |(stamp_ns, _)| *stamp_ns) {
            Ok(index) => self.poses.get(index).map(|(_, pose)| *pose),
            Err(index) => {
                let (before_ns, before) = self.poses.get(index.checked_sub(1)?)?;
                let (after_ns, after) = self.poses.get(index)?;
                let gap_ns = after_ns - before_ns;
                let fraction = (stamp_ns - before_ns) as f64 / gap_ns as f64;
                (gap_ns <= gap_max_ns).then(|| before.interpolate(*after, fraction))
            }
        }
    }

    /// The poses `map_from_base` with their stamps in nanoseconds, each later than the one before; never empty.
    #[must_use]
    pub fn poses(&self) -> &[(u64, Pose2)] {
        &self.poses
    }

    /// How many rows were earlier than one before them.
    #[must_use]
    pub fn moved(&self) -> usize {
        self.moved
    }
}

/// Writes poses `map_from_base` in the format of the TUM benchmark, whole or not at all: `t x y z qx qy qz qw`, seconds and metres.
///
/// # Errors
/// The file can't be written.
pub fn write_tum(path: &Path, poses: impl IntoIterator<Item = (u64, Pose2)>) -> Result<(), WriteError> {
    let mut text = String::from("# t x y z qx qy qz qw\n");
    for (stamp_ns, Pose2 { x, y, theta }) in poses {
        let (s, c) = libm::sincos(0.5 * theta);
        let (seconds, rest_ns) = (stamp_ns / 1_000_000_000, stamp_ns % 1_000_000_000);
        let _ = writeln!(text, "{seconds}.{rest_ns:09} {x:.6} {y:.6} 0 0 0 {s:.9} {c:.9}");
    }
    write_whole(path, text.as_bytes())
}

/// The pose of a row of eight words.
fn of_quaternion(row: &Row<'_>, words: [&str; 8]) -> Result<(u64, usize, Pose2), TextError> {
    let [t, x, y, z, q @ ..] = words;
    row.number("z", z, |_| true, "metres")?;
    let mut quaternion = [0.0; 4];
    for ((slot, what), word) in quaternion.iter_mut().zip(["qx", "qy", "qz", "qw"]).zip(q) {
        *slot = row.number(what, word, |value| value.abs() <= 1.0 + UNIT, "a part of a quaternion, -1 to 1")?;
    }
    let [qx, qy, qz, qw] = quaternion;
    if ((qx * qx + qy * qy + qz * qz + qw * qw).sqrt() - 1.0).abs() > UNIT {
        return Err(row.wrong("a quaternion of length 1, in the order qx qy qz qw"));
    }
    let theta = libm::atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz));
    Ok((row.stamp_ns(t)?, row.line, Pose2::new(row.coordinate("x", x)?, row.coordinate("y", y)?, theta)))
}

fn pose(row: &Row<'_>) -> Result<(u64, usize, Pose2), TextError> {
    if let Ok(words) = <[&str; 8]>::try_from(row.words.as_slice()) {
        return of_quaternion(row, words);
    }
    let (&[t, x, y, theta], raw) = row.words.split_first_chunk().ok_or_else(|| row.wrong(ROW))?;
    if !matches!(raw.len(), 0 | 3) {
        return Err(row.wrong(ROW));
    }
    for (what, word) in ["ox", "oy", "otheta"].iter().zip(raw) {
        row.number(what, word, |_| true, "a number")?;
    }
    let angle = |angle: f64| angle.abs() <= ANGLE_MAX_RAD;
    let (x, y) = (row.coordinate("x", x)?, row.coordinate("y", y)?);
    Ok((row.stamp_ns(t)?, row.line, Pose2::new(x, y, row.number("theta", theta, angle, "radians, within 1e6")?)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PATH: &str = "# t x y theta\n\n1.0 0 0 3.0\n2.0 2 1 -3.0 0.5 0.5 0.5 # raw\n\t12 2 2 0\n";
    const SECOND: u64 = 1_000_000_000;

    #[test]
    fn between_poses_but_not_over_gaps() {
        let path = ReferencePath::parse(PATH).unwrap();
        assert_eq!((path.poses().len(), path.moved()), (3, 0));
        assert_eq!(path.at(2 * SECOND, 0), Some(Pose2::new(2.0, 1.0, -3.0)));
        let middle = path.at(3 * SECOND / 2, SECOND).unwrap();
        assert_eq!((middle.x, middle.y), (1.0, 0.5));
        assert!((middle.theta.abs() - core::f64::consts::PI).abs() < 1e-12, "the shorter way");
        assert_eq!(path.at(3 * SECOND / 2, SECOND - 1), None);
        assert_eq!(path.at(5 * SECOND, SECOND), None);
        for outside in [0, SECOND - 1, 12 * SECOND + 1, u64::MAX] {
            assert_eq!(path.at(outside, u64::MAX), None);
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.tum");
        let poses =
            [(1_000_000_007, Pose2::new(1.5, -2.25, 3.0)), (1_717_171_717_000_000_001, Pose2::new(0.0, 7.0, -0.5))];
        write_tum(&path, poses).unwrap();
        let read = ReferencePath::read(&path).unwrap();
        for ((stamp_ns, pose), (read_ns, read)) in poses.iter().zip(read.poses()) {
            assert_eq!(stamp_ns, read_ns);
            assert!(pose.distance_m(*read) < 1e-6 && (pose.theta - read.theta).abs() < 1e-8);
        }
    }

    #[test]
    fn disorder_is_sorted_and_counted() {
        let path = ReferencePath::parse("3 3 0 0\n1 1 0 0\n4 4 0 0\n2 2 0 0\n").unwrap();
        assert_eq!(path.moved(), 2);
        assert!(path.poses().iter().map(|(_, pose)| pose.x).eq([1.0, 2.0, 3.0, 4.0]));
    }

    #[test]
    fn errors_name_line_value_and_expectation() {
        let check = |text: &str, expected: &str| {
            let error = ReferencePath::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check("# nothing\n", "line 1: no pose; expected 4 words `t x y theta`");
        check("1 2 3\n", "line 1: \"1 2 3\"; expected 4 words");
        check("1 2 3 0 0 0\n", "expected 4 words `t x y theta`, 7 with");
        check("1 2 3 0 0 0 0 0.5\n", "line 1: \"1 2 3 0 0 0 0 0.5\"; expected a quaternion of length 1");
        check("1 2 3 0 0 0 0 2\n", "qw is \"2\"; expected a part of a quaternion");
        check("\n-1 2 3 4\n", "line 2: t is \"-1\"; expected seconds");
        check("1 nan 3 4\n", "line 1: x is \"nan\"; expected metres");
        check("1 2 4e7 4\n", "y is \"4e7\"");
        check("1 2 3 4°\n", "theta is \"4°\"; expected radians");
        check("1 2 3 4 5 6 inf\n", "otheta is \"inf\"; expected a number");
        check("1 0 0 0\n2 0 0 0\n1.0 0 0 0\n", "line 3: the stamp of line 1 again; expected a stamp of its own");
    }

    #[test]
    fn errors_name_the_file_and_a_near_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("reference.txt");
        std::fs::write(&path, "1 2 x 4").unwrap();
        let error = ReferencePath::read(&path).unwrap_err().to_string();
        assert!(error.contains("reference.txt: line 1: y is \"x\""), "{error}");
        let error = ReferencePath::read(&folder.path().join("referense.txt")).unwrap_err().to_string();
        assert!(error.contains("no such file; did you mean") && error.contains("reference.txt?"), "{error}");
        std::fs::File::create(&path).unwrap().set_len(2 << 30).unwrap();
        let error = ReferencePath::read(&path).unwrap_err().to_string();
        assert!(error.contains("2147483648 bytes; expected at most"), "{error}");
    }

    proptest! {
        #[test]
        fn any_text_is_survived(text in "(-?[0-9.e]{1,5}| |nan|#|\n|\\PC){0,60}", stamp_ns: u64) {
            if let Ok(path) = ReferencePath::parse(&text) {
                prop_assert!(path.at(stamp_ns, u64::MAX).is_none_or(Pose2::is_finite));
            }
        }
    }
}
