//! Text logs of one line a message: each dialect turns its lines into the messages of a CARMEN log.
//!
//! What the lines mean for a map (clock, sensors, what a reading says) is told in one place for all, by
//! [`super::carmen`]. A new dialect is a module with `looks_like` and `parse`, a variant and its lines here.

mod csv;
mod gfs;
mod wean;

use super::LogFormat;
use super::carmen::message::{self, Message};
use super::fault::Refusal;

/// How the lines of a text log are read.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) enum Dialect {
    /// CARMEN's own.
    #[default]
    Carmen,
    /// CMU's Wean Hall.
    Wean,
    /// GMapping's output.
    Gfs,
    /// A table, with what its header says.
    Csv(csv::Columns),
}

impl Dialect {
    /// The dialect of a log that begins so.
    pub(crate) fn of(head: &[u8]) -> Option<Self> {
        let lines = || head.split(|byte| *byte == b'\n').filter_map(|line| core::str::from_utf8(line).ok());
        if gfs::looks_like(lines()) {
            return Some(Self::Gfs);
        }
        if lines().any(|line| line.split_ascii_whitespace().next().is_some_and(message::is_message_name)) {
            return Some(Self::Carmen);
        }
        if wean::looks_like(lines()) {
            return Some(Self::Wean);
        }
        csv::Columns::of(lines()).ok().map(Self::Csv)
    }

    /// What is wrong with a table that can't be read, if it is one.
    pub(crate) fn wrong_with_table(head: &[u8]) -> Option<String> {
        csv::Columns::of(head.split(|byte| *byte == b'\n').filter_map(|line| core::str::from_utf8(line).ok())).err()?
    }

    pub(crate) fn format(&self) -> LogFormat {
        match self {
            Self::Carmen => LogFormat::CarmenLog,
            Self::Wean => LogFormat::WeanLog,
            Self::Gfs => LogFormat::GmappingLog,
            Self::Csv(_) => LogFormat::CsvTable,
        }
    }

    /// Reads one line, without its end: the messages in it, one after the other.
    pub(crate) fn parse(&self, line: &[u8], take: &mut dyn FnMut(Message<'_>)) -> Result<(), Refusal> {
        match self {
            Self::Carmen => take(message::parse(line)?),
            Self::Wean => take(wean::parse(line)?),
            Self::Gfs => take(gfs::parse(line)?),
            Self::Csv(columns) => return columns.parse(line, take),
        }
        Ok(())
    }

    /// The word of a line that should be its stamp, and where that stands, for people.
    pub(crate) fn stamp_of(&self, line: &[u8]) -> String {
        let text = String::from_utf8_lossy(line);
        let from_end = |place: usize| text.split_ascii_whitespace().rev().nth(place).unwrap_or_default().to_owned();
        match self {
            Self::Carmen => format!("{}, the third word from the end", from_end(2)),
            Self::Wean | Self::Gfs => format!("{}, the last word", from_end(0)),
            Self::Csv(_) => "the column of stamps".to_owned(),
        }
    }

    /// What is odometry in it, for people.
    pub(crate) fn odometry_lines(&self) -> &'static str {
        match self {
            Self::Carmen => "ODOM lines, or FLASER, RLASER, ROBOTLASER or SONAR lines that carry a robot pose",
            Self::Wean => "L lines",
            Self::Gfs => "LASER_READING lines",
            Self::Csv(_) => "rows with numbers in the columns of stamp, x, y and heading",
        }
    }

    /// What is a reading in it, for people.
    pub(crate) fn reading_lines(&self) -> &'static str {
        match self {
            Self::Carmen => "FLASER, RLASER, ROBOTLASER, RAWLASER or SONAR lines",
            Self::Wean => "L lines",
            Self::Gfs => "LASER_READING lines",
            Self::Csv(_) => "rows with numbers in the columns r0, r1 … or sonar_0, sonar_90 …",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_decides() {
        let check = |head: &str, expected: Option<LogFormat>| {
            assert_eq!(Dialect::of(head.as_bytes()).map(|dialect| dialect.format()), expected, "{head}");
        };
        check("# a comment\nPARAM a b nohost 0\n", Some(LogFormat::CarmenLog));
        check("ODOM 0 0 0 0 0 0 1 h 1\n", Some(LogFormat::CarmenLog));
        check("PARAM a b\nODOM 0 0 0 1.5\nLASER_READING 2 1 2 0 0 0 1.5\n", Some(LogFormat::GmappingLog));
        check("L -94 -139 -1.3 -88 -164 -1.3 66 66 0.02\nO -94 -139 -1.3 0.03\n", Some(LogFormat::WeanLog));
        check("t,x,y,theta,r0,r1\n0,0,0,0,1,1\n", Some(LogFormat::CsvTable));
        check("O Tannenbaum, o Tannenbaum\n", None);
        check("a,b,c,d\n0,0,0,0\n", None);
        check("", None);
    }
}
