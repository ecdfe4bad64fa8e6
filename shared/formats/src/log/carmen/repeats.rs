//! Lines that stand twice in a log: two loggers wrote one file, or a file was appended to itself.

use std::collections::BTreeMap;

use super::message::Message;

/// Kinds of lines that are remembered: more than there are.
const KINDS_MAX: usize = 64;

/// The last line of each kind, by its first word, and whether stamps can tell a copy from another.
#[derive(Debug, Default)]
pub(super) struct Repeats {
    lines: BTreeMap<Vec<u8>, Vec<u8>>,
    /// Of the last message that had one.
    stamp_ns: Option<u64>,
    /// A clock that stands still gives a robot that stands still the same lines again and again.
    has_moved: bool,
}

impl Repeats {
    /// Whether a line is, word for word, the last of its kind. What follows is compared with it.
    pub(super) fn stands_twice(&mut self, line: &[u8]) -> bool {
        let kind = line.split(u8::is_ascii_whitespace).next().unwrap_or_default();
        // In a table the first word is a stamp, and all lines are of a kind.
        let kind = if kind.first().is_some_and(u8::is_ascii_alphabetic) { kind } else { &[] };
        match self.lines.get_mut(kind) {
            Some(last) if last == line => true,
            Some(last) => {
                last.clear();
                last.extend_from_slice(line);
                false
            }
            None => {
                if self.lines.len() < KINDS_MAX {
                    self.lines.insert(kind.to_vec(), line.to_vec());
                }
                false
            }
        }
    }

    /// Whether a message is a copy, of a line that `stands_twice`: without a stamp that says when it may be another, of a robot that
    /// stands still.
    pub(super) fn is_copy(&mut self, stands_twice: bool, message: &Message<'_>) -> bool {
        let stamp_ns = match message {
            Message::Odometry { stamp_ns, .. } | Message::TruePose { stamp_ns, .. } => *stamp_ns,
            Message::Scan(scan) => scan.stamp_ns,
            Message::Param { .. } | Message::Other { .. } | Message::Nothing => return false,
        };
        let is_copy = stands_twice && self.has_moved && stamp_ns.is_some_and(|stamp_ns| stamp_ns > 0);
        if stamp_ns.is_some() {
            self.has_moved |= self.stamp_ns.is_some() && self.stamp_ns != stamp_ns;
            self.stamp_ns = stamp_ns;
        }
        is_copy
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_compared_with_its_own() {
        let mut repeats = Repeats::default();
        let lines: [&[u8]; 7] = [b"ODOM 1 2", b"SONAR 3", b"ODOM 1 2", b"ODOM 1 3", b"SONAR 3", b"1.5,2,3", b"1.5,2,3"];
        assert_eq!(lines.map(|line| repeats.stands_twice(line)), [false, false, true, false, true, false, true]);
    }
}
