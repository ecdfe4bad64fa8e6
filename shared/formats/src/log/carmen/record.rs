//! A CARMEN log in the making.

use std::io::{self, Write};
use std::path::Path;

use echogrid_core::Robot;
use flate2::Compression;
use flate2::write::GzEncoder;

use super::CarmenWriter;
use crate::WriteError;
use crate::log::LogEvent;
use crate::whole_file::WholeFile;

/// A CARMEN log that is written event by event. It stands at its path, whole, when it is finished or dropped; until then
/// what stood there before still does.
pub struct LogFile {
    /// None once it is finished.
    writer: Option<CarmenWriter<Out>>,
}

/// The log, gzipped or not.
enum Out {
    Plain(WholeFile),
    Gzip(GzEncoder<WholeFile>),
}

impl core::fmt::Debug for LogFile {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("LogFile")
    }
}

impl LogFile {
    /// Begins a log at `path`, gzipped if that ends in `.gz`, of a robot whose sonars fire `sonar_offsets_ns` nanoseconds
    /// after the stamps of their scans (empty: at the stamps).
    ///
    /// # Errors
    /// No file can be made in the folder of `path`.
    pub fn create(path: &Path, robot: &Robot, sonar_offsets_ns: &[i32]) -> Result<Self, WriteError> {
        let file = WholeFile::create(path)?;
        let gzipped = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gz"));
        let out = if gzipped { Out::Gzip(GzEncoder::new(file, Compression::new(6))) } else { Out::Plain(file) };
        let writer = CarmenWriter::with_offsets(out, robot, sonar_offsets_ns);
        let writer = writer.map_err(|source| WriteError { path: path.to_path_buf(), doing: "writing", source })?;
        Ok(Self { writer: Some(writer) })
    }

    /// Adds an event; stamps must not run backwards.
    ///
    /// # Errors
    /// The disk is full, or the like.
    pub fn event(&mut self, event: &LogEvent) -> Result<(), WriteError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        writer.event(event).map_err(|source| writer.out().file().failed(source))
    }

    /// Ends the log and puts it in place.
    ///
    /// # Errors
    /// The disk is full, or the like; then what stood at the path still does.
    pub fn finish(mut self) -> Result<(), WriteError> {
        self.put_in_place()
    }

    fn put_in_place(&mut self) -> Result<(), WriteError> {
        let Some(writer) = self.writer.take() else { return Ok(()) };
        match writer.into_inner() {
            Out::Plain(file) => file.commit(),
            Out::Gzip(mut encoder) => match encoder.try_finish() {
                Ok(()) => encoder.finish().map_err(failed_unnamed)?.commit(),
                Err(source) => Err(encoder.get_ref().failed(source)),
            },
        }
    }
}

/// `try_finish` went well, so there is nothing left that could fail.
fn failed_unnamed(source: io::Error) -> WriteError {
    WriteError { path: std::path::PathBuf::new(), doing: "writing", source }
}

impl Drop for LogFile {
    fn drop(&mut self) {
        // Nobody is left to hear of an error: whoever wants to know calls `finish`.
        let _ = self.put_in_place();
    }
}

impl Out {
    fn file(&self) -> &WholeFile {
        match self {
            Self::Plain(file) => file,
            Self::Gzip(encoder) => encoder.get_ref(),
        }
    }
}

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(file) => file.write(bytes),
            Self::Gzip(encoder) => encoder.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(file) => file.flush(),
            Self::Gzip(encoder) => encoder.flush(),
        }
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::{Echo, Pose2, Reading, Sensor, SensorKind};

    use super::*;
    use crate::log::{open, survey};

    fn robot() -> Robot {
        let sonar = |first_transducer: u16, theta: f64| Sensor {
            kind: SensorKind::Sonar,
            base_from_sensor: Pose2::new(0.1, 0.0, theta),
            first_transducer,
            transducers: 1,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.0,
            aperture_rad: 0.5,
            range_min_m: 0.1,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        };
        Robot { name: "two".into(), sensors: vec![sonar(0, 0.0), sonar(1, 1.0)], ..Robot::default() }
    }

    fn events() -> Vec<LogEvent> {
        let odometry = |stamp_ns, x| LogEvent::Odometry {
            stamp_ns,
            odom_from_base: Pose2::new(x, 0.1 + 0.2, 0.3),
            v_mps: 0.5,
            w_radps: 0.0,
        };
        let readings = vec![
            Reading { transducer: 0, echo: Echo::Hit { range_m: 1.0 / 3.0 }, offset_ns: -40_000_000 },
            Reading { transducer: 1, echo: Echo::NoEcho, offset_ns: 0 },
        ];
        vec![
            odometry(0, 0.0),
            LogEvent::TruePose { stamp_ns: 0, map_from_base: Pose2::new(0.7, 0.1, 0.2) },
            odometry(100_000_000, 0.05),
            LogEvent::Scan { stamp_ns: 120_000_001, readings },
            odometry(200_000_000, 0.1),
        ]
    }

    #[test]
    fn what_is_written_is_read_again_with_its_offsets() {
        let folder = tempfile::tempdir().unwrap();
        for (name, finish) in [("a.log", true), ("b.log.gz", true), ("c.log.gz", false)] {
            let path = folder.path().join(name);
            let mut log = LogFile::create(&path, &robot(), &[-40_000_000, 0]).unwrap();
            for event in events() {
                log.event(&event).unwrap();
            }
            assert!(!path.exists(), "not before it is whole");
            if finish {
                log.finish().unwrap();
            } else {
                drop(log);
            }
            let surveyed = survey(&path).unwrap();
            assert!(surveyed.faults.is_empty(), "{:?}", surveyed.faults);
            let read: Vec<LogEvent> = open(&path, &surveyed).unwrap().map(Result::unwrap).collect();
            assert_eq!(read, events(), "{name}");
        }
        let error = LogFile::create(Path::new("/nowhere/at/all.log"), &robot(), &[]).unwrap_err().to_string();
        assert!(error.contains("/nowhere/at/all.log"), "{error}");
    }

    #[test]
    fn offsets_that_are_none_are_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.log");
        let mut log = LogFile::create(&path, &robot(), &[-5, 0]).unwrap();
        events().iter().for_each(|event| log.event(event).unwrap());
        log.finish().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        for offsets in ["x,y", "9999999999,0", "", "nan"] {
            std::fs::write(&path, text.replace("-5,0", offsets)).unwrap();
            let surveyed = survey(&path).unwrap();
            let scans: Vec<LogEvent> = open(&path, &surveyed).unwrap().map(Result::unwrap).collect();
            let none = scans.iter().any(
                |event| matches!(event, LogEvent::Scan { readings, .. } if readings.iter().all(|r| r.offset_ns == 0)),
            );
            assert!(none, "{offsets}");
        }
    }
}
