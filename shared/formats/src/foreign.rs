//! Files of kinds that are known and hold no log: named for what they are, with the way on from there.

/// A kind of file that can't be read as a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Foreign {
    /// What it is, without an article.
    pub name: &'static str,
    /// What to do with it.
    pub advice: &'static str,
}

impl Foreign {
    /// The name with its article, as in "an HDF5 file".
    #[must_use]
    pub fn with_article(&self) -> String {
        let is_spoken_with_a_vowel = ["HDF5", "LCM", "SQLite"].iter().any(|word| self.name.starts_with(word))
            || self.name.starts_with(['A', 'E', 'I', 'O', 'a', 'e', 'i', 'o']);
        format!("{} {}", if is_spoken_with_a_vowel { "an" } else { "a" }, self.name)
    }
}

/// Bytes that a file of some kind has at a place, the kind, and the advice.
type Magic = (usize, &'static [u8], &'static str, &'static str);

const ARCHIVE: &str = "unpack it, and name the log that was in it";
const PACKETS: &str = "play it through the sensor's driver in ROS and record its scans with the odometry: ros2 bag record -s mcap /scan /odom /tf \
                       /tf_static";
const CLOUD: &str =
    "a cloud says neither where the robot was nor what it did not hit; name the log that it was made of";
const PICTURE: &str =
    "a picture says nothing of metres: for a map name the YAML that goes with it, for a drive the log";
const NO_LOG: &str = "expected a log: odometry and range readings";
const DATA: &str = "write what it holds as CSV whose header names t, x, y, theta and ranges (docs/logs-formats.md)";

const UTF16: &str = "write it as UTF-8: iconv -f UTF-16 -t UTF-8 FILE > LOG, or in PowerShell Get-Content FILE | Set-Content -Encoding utf8 LOG";

const MAGICS: &[Magic] = &[
    (0, b"#ROSRECORD V", "ROS bag of version 1", "convert it by ROS 1: rosbag fix OLD.bag NEW.bag"),
    (0, b"#ROSBAG V1.", "ROS bag of version 1", "convert it by ROS 1: rosbag fix OLD.bag NEW.bag"),
    (0, b"\xd4\xc3\xb2\xa1", "capture of network packets (pcap)", PACKETS),
    (0, b"\xa1\xb2\xc3\xd4", "capture of network packets (pcap)", PACKETS),
    (0, b"\x4d\x3c\xb2\xa1", "capture of network packets (pcap)", PACKETS),
    (0, b"\xa1\xb2\x3c\x4d", "capture of network packets (pcap)", PACKETS),
    (0, b"\x0a\x0d\x0d\x0a", "capture of network packets (pcapng)", PACKETS),
    (0, b"\xff\xfe", "text in UTF-16", UTF16),
    (0, b"\xfe\xff", "text in UTF-16", UTF16),
    (0, b"\xed\xa1\xda\x01", "LCM log", DATA),
    (0, b"## Player version", "log of Player", DATA),
    (0, b"\x89HDF\r\n\x1a\n", "HDF5 file", DATA),
    (0, b"MATLAB 5.0 MAT-file", "MATLAB file", DATA),
    (0, b"\x93NUMPY", "NumPy array", DATA),
    (0, b"PAR1", "Parquet table", DATA),
    (0, b"# .PCD v", "point cloud (PCD)", CLOUD),
    (0, b"ply\n", "point cloud (PLY)", CLOUD),
    (0, b"ply\r\n", "point cloud (PLY)", CLOUD),
    (0, b"LASF", "point cloud (LAS)", CLOUD),
    (0, b"ASTM-E57", "point cloud (E57)", CLOUD),
    (0, b"# Octomap OcTree", "OctoMap", CLOUD),
    // The magic of its stream of protocol buffers, least byte first.
    (0, b"\x01\x5b\xf5\xb5\x7b\x1f\x1d\x7b", "state of Cartographer (.pbstream)", "name the bag that it was made of"),
    (0, b"PK\x03\x04", "ZIP archive", ARCHIVE),
    (257, b"ustar", "tar archive", ARCHIVE),
    (0, b"7z\xbc\xaf\x27\x1c", "7-Zip archive", ARCHIVE),
    (0, b"Rar!\x1a\x07", "RAR archive", ARCHIVE),
    (0, b"\xfd7zXZ\x00", "file packed by xz", "unpack it first: xz -d FILE"),
    (0, b"\x89PNG\r\n\x1a\n", "picture (PNG)", PICTURE),
    (0, b"\xff\xd8\xff", "picture (JPEG)", PICTURE),
    (0, b"GIF8", "picture (GIF)", PICTURE),
    (0, b"II*\x00", "picture (TIFF)", PICTURE),
    (0, b"MM\x00*", "picture (TIFF)", PICTURE),
    (0, b"P2\n", "picture (PGM)", PICTURE),
    (0, b"P5\n", "picture (PGM)", PICTURE),
    (0, b"P5 ", "picture (PGM)", PICTURE),
    (0, b"%PDF", "PDF document", NO_LOG),
    (0, b"\x7fELF", "program", NO_LOG),
    (0, b"<!DOCTYPE html", "web page", "it may be what a server sent in place of the file: fetch it again"),
    (0, b"<!doctype html", "web page", "it may be what a server sent in place of the file: fetch it again"),
    (0, b"<html", "web page", "it may be what a server sent in place of the file: fetch it again"),
    (0, b"version https://git-lfs", "pointer of Git LFS, not the file itself", "fetch what it points at: git lfs pull"),
];

/// MRPT's objects begin with the length of the name of their class, the highest bit set, and the name.
const RAWLOG_CLASSES: [&[u8]; 5] =
    [b"CActionCollection", b"CSensoryFrame", b"CObservation", b"mrpt::obs::", b"mrpt::slam::"];

/// Words that the first lines of graphs of poses begin with.
const GRAPH_WORDS: [&str; 6] = ["VERTEX_SE2", "EDGE_SE2", "VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", "VERTEX2", "EDGE2"];

/// The kind of file that begins with `head` (unpacked, where it was packed), if it is one of these.
pub(crate) fn foreign(head: &[u8]) -> Option<Foreign> {
    let begins = |(at, magic, ..): &&Magic| head.get(*at..).is_some_and(|rest| rest.starts_with(magic));
    if let Some((.., name, advice)) = MAGICS.iter().find(begins) {
        return Some(Foreign { name, advice });
    }
    if let Some((length, class)) = head.split_first()
        && *length >= 0x80
        && RAWLOG_CLASSES.iter().any(|name| class.starts_with(name))
    {
        let advice = "export its scans and odometry by MRPT (rawlog-edit --export-2d-scans-txt --export-odometry-txt) and join them as CSV whose \
                      header names t, x, y, theta and ranges (docs/logs-formats.md)";
        return Some(Foreign { name: "rawlog of MRPT", advice });
    }
    let first = head.split(|byte| *byte == b'\n').filter_map(|line| core::str::from_utf8(line).ok());
    let mut words = first.filter_map(|line| line.split_ascii_whitespace().next()).filter(|word| *word != "#");
    let is_graph = words.next().is_some_and(|word| GRAPH_WORDS.contains(&word));
    is_graph.then_some(Foreign {
        name: "graph of poses (g2o or TORO)",
        advice: "it holds no range readings: name the log that it was made of",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_told_by_their_first_bytes() {
        let check = |head: &[u8], expected: Option<&str>| {
            let found = foreign(head);
            assert_eq!(found.is_some(), expected.is_some(), "{head:?}");
            assert!(found.is_none_or(|found| found.name.contains(expected.unwrap())), "{found:?}");
        };
        check(b"#ROSBAG V1.2\n", Some("version 1"));
        check(b"#ROSRECORD V1.1\n", Some("version 1"));
        check(b"#ROSBAG V2.0\n", None);
        check(b"\xd4\xc3\xb2\xa1\x02\x00\x04\x00", Some("pcap"));
        check(b"\x91CActionCollection\x00", Some("rawlog"));
        check(b"\x99mrpt::obs::CSensoryFrame\x00", Some("rawlog"));
        check(b"VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 1 0 0\n", Some("g2o"));
        check(b"# VERTEX_SE2\nODOM 1 2 3\n", None);
        check(&[&[b'a'; 257][..], b"ustar\x0000"].concat(), Some("tar"));
        check(b"", None);
        check(b"\x80", None);
        check(b"t,x,y,theta\n", None);
    }
}
