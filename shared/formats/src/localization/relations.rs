//! Relations: how one pose of a drive truly lies, seen from another, as the public benchmark of SLAM gives them (Kümmerle et al. 2009,
//! "On measuring the accuracy of SLAM algorithms").
//!
//! ```text
//! # t1 t2 x y z roll pitch yaw, seconds, metres, radians
//! 976052857.337 976052863.512 1.021 0.018 0 0 0 0.131
//! ```
//!
//! Stamps are the log's own, as of a [reference path](super::reference). Height, roll and pitch must be numbers and are not used. Rows
//! may stand in any order, and a pair of stamps may come more than once.

use std::path::Path;

use echogrid_core::Pose2;

use super::rows::{Row, rows};
use crate::text::{TextError, TextFileError, read_text};

/// Longest file of relations, bytes.
pub const RELATIONS_BYTES_MAX: u64 = 256 << 20;

const ROW: &str = "8 words `t1 t2 x y z roll pitch yaw`";
/// An angle beyond this is no angle, radians.
const ANGLE_MAX_RAD: f64 = 1e6;

/// How the pose at one stamp lies, seen from that at another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relation {
    /// The stamp of the pose that looks, nanoseconds.
    pub from_ns: u64,
    /// The stamp of the pose that is seen, nanoseconds.
    pub to_ns: u64,
    /// The pose at `to_ns`, seen from that at `from_ns`.
    pub pose: Pose2,
}

/// The relations of a drive, in the order of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Relations {
    all: Vec<Relation>,
}

impl Relations {
    /// Reads a file of relations.
    ///
    /// # Errors
    /// When the file can't be read, is longer than [`RELATIONS_BYTES_MAX`], or is refused by [`Relations::parse`].
    pub fn read(path: &Path) -> Result<Self, TextFileError> {
        read_text(path, RELATIONS_BYTES_MAX, Self::parse)
    }

    /// The relations that a text tells.
    ///
    /// # Errors
    /// When a row is none, a number is not finite or absurd, or there is no row.
    pub fn parse(text: &str) -> Result<Self, TextError> {
        let all = rows(text).map(|row| relation(&row)).collect::<Result<Vec<_>, _>>()?;
        if all.is_empty() {
            return Err(TextError { line: 1, found: "no relation".to_owned(), expected: ROW.to_owned() });
        }
        Ok(Self { all })
    }

    /// All of them; never empty.
    #[must_use]
    pub fn all(&self) -> &[Relation] {
        &self.all
    }
}

fn relation(row: &Row<'_>) -> Result<Relation, TextError> {
    let words: &[&str; 8] = row.words.as_slice().try_into().map_err(|_| row.wrong(ROW))?;
    let [from, to, x, y, z, roll, pitch, yaw] = words;
    row.number("z", z, |_| true, "metres")?;
    let angle = |what, word| row.number(what, word, |angle| angle.abs() <= ANGLE_MAX_RAD, "radians, within 1e6");
    angle("roll", roll)?;
    angle("pitch", pitch)?;
    let pose = Pose2::new(row.coordinate("x", x)?, row.coordinate("y", y)?, angle("yaw", yaw)?);
    Ok(Relation { from_ns: row.stamp_ns(from)?, to_ns: row.stamp_ns(to)?, pose })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn rows_are_relations() {
        let relations = Relations::parse("# t1 t2 …\n2.5 1 0.5 -1 0 0 0 3.5\n\n1 2 0 0 0 0 0 0 # again\n").unwrap();
        let [first, second] = relations.all() else { panic!("{relations:?}") };
        assert_eq!((first.from_ns, first.to_ns), (2_500_000_000, 1_000_000_000));
        assert_eq!(first.pose, Pose2::new(0.5, -1.0, 3.5));
        assert_eq!(second.pose, Pose2::IDENTITY);
    }

    #[test]
    fn errors_name_line_value_and_expectation() {
        let check = |text: &str, expected: &str| {
            let error = Relations::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check("", "line 1: no relation; expected 8 words");
        check("1 2 3 4\n", "line 1: \"1 2 3 4\"; expected 8 words `t1 t2 x y z roll pitch yaw`");
        check("1 2 0 0 0 0 0 0\n1 x 0 0 0 0 0 0\n", "line 2: t is \"x\"; expected seconds");
        check("1 2 0 0 0 0 0 inf\n", "yaw is \"inf\"; expected radians");
        check("1 2 0 4e7 0 0 0 0\n", "y is \"4e7\"; expected metres");
    }

    proptest! {
        #[test]
        fn any_text_is_survived(text in "(-?[0-9.e]{1,5}| |nan|#|\n|\\PC){0,80}") {
            if let Ok(relations) = Relations::parse(&text) {
                prop_assert!(relations.all().iter().all(|relation| relation.pose.is_finite()));
            }
        }
    }
}
