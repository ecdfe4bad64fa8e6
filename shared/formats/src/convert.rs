//! From one file format to another.
//!
//! What goes in is told by its content, what comes out by the extension of its name:
//!
//! | in | out |
//! |---|---|
//! | a native map | `.png`; `.pgm` or `.yaml` (the pair, mode `trinary`); `.npy` with a `.yaml` beside it; `.echogrid` |
//! | a map_server YAML (with its image) | `.pgm` or `.yaml` (the pair, mode `trinary`); `.npy` with a `.yaml` beside it |
//! | a log of any readable format | `.log` or `.clf`, or the same with `.gz`: a CARMEN log |
//!
//! A map_server pair does not become a native map: that holds evidence, path and provenance,
//! which would have to be made up.

mod layer;

use std::io;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::kind::{self, Kind};
use crate::log::carmen::CarmenWriter;
use crate::log::{self, KNOWN_FORMATS, LogError};
use crate::map::map_server::{self, MapMode, MapYaml, Thresholds};
use crate::map::{Drawable, MapDocument, MapError, OccupancyMap, native, npy, picture};
use crate::near::near_word;
use crate::whole_file::{WholeFile, write_together, write_whole};
use crate::{WriteError, open_regular};

pub use layer::{MapLayer, convert_layer};

/// What a conversion did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConvertReport {
    /// What went in, in words.
    pub input: String,
    /// The files written.
    pub written: Vec<PathBuf>,
    /// What the output can't hold, in words; empty if nothing is lost.
    pub lost: Vec<String>,
    /// What is odd about a log's sensors, and what was made of it, in words.
    pub remarks: Vec<String>,
}

/// Why a conversion failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// The log can't be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The map can't be read or written.
    #[error(transparent)]
    Map(#[from] MapError),
    /// The output can't be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// What goes in is no map and no log.
    #[error("{}: neither a map nor a log: {why}; expected a native map (.echogrid), the YAML of a map_server map, {KNOWN_FORMATS}", path.display())]
    UnknownInput {
        /// The file.
        path: PathBuf,
        /// What it is instead.
        why: String,
    },
    /// The YAML beside the output tells where another image lies.
    #[error("{}: tells where {image} lies, and would tell of the array then; name the array otherwise", yaml.display())]
    OtherImage {
        /// The YAML.
        yaml: PathBuf,
        /// The image that it names.
        image: String,
    },
    /// There is no way from this input to that output.
    #[error(
        "{} is {input}, which can't be written as {}; possible: {possible}{}",
        path.display(),
        output.display(),
        near.map(|near| format!("; did you mean {near}?")).unwrap_or_default()
    )]
    Impossible {
        /// The input.
        path: PathBuf,
        /// What it is.
        input: &'static str,
        /// The output asked for.
        output: PathBuf,
        /// The extensions that are possible.
        possible: &'static str,
        /// The extension that was probably meant.
        near: Option<&'static str>,
    },
    /// What goes in has no layers.
    #[error("{} is {input}; expected a native map (.echogrid), which may have layers", path.display())]
    NoLayers {
        /// The file.
        path: PathBuf,
        /// What it is.
        input: &'static str,
    },
    /// The map was made without that layer.
    #[error("{}: holds no {layer}; a run with mapper.{layer} = true keeps it", path.display())]
    LayerMissing {
        /// The file.
        path: PathBuf,
        /// The layer asked for.
        layer: &'static str,
    },
    /// Input and output are the same file.
    #[error("{}: input and output are the same file", path.display())]
    SameFile {
        /// The file.
        path: PathBuf,
    },
}

/// What goes in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Given {
    NativeMap,
    MapServer,
    Log,
}

impl Given {
    fn name(self) -> &'static str {
        match self {
            Self::NativeMap => "a native map",
            Self::MapServer => "a map_server map",
            Self::Log => "a log",
        }
    }

    fn outputs(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::NativeMap => (".png, .pgm, .yaml, .npy, .echogrid", &["png", "pgm", "yaml", "npy", "echogrid"]),
            Self::MapServer => (".pgm, .yaml, .npy", &["pgm", "yaml", "npy"]),
            Self::Log => (".log, .log.gz, .clf, .clf.gz", &["log", "log.gz", "clf", "clf.gz"]),
        }
    }
}

/// Converts a file. Every output is written whole or not at all.
///
/// # Errors
/// When the input can't be read, the output can't be written, or there is no way from one to the
/// other (the error lists what is possible).
pub fn convert(input: &Path, output: &Path) -> Result<ConvertReport, ConvertError> {
    convert_with(input, output, log::SurveyOptions::default())
}

/// Converts a file as [`convert`] does, where the user says of a log what it does not.
///
/// # Errors
/// As [`convert`].
pub fn convert_with(input: &Path, output: &Path, options: log::SurveyOptions) -> Result<ConvertReport, ConvertError> {
    let kind = kind_of(input)?;
    let extension = extension(output);
    let (possible, extensions) = kind.outputs();
    if !extensions.contains(&extension.as_str()) {
        return Err(ConvertError::Impossible {
            path: input.to_path_buf(),
            input: kind.name(),
            output: output.to_path_buf(),
            possible,
            near: near_word(&extension, extensions.iter().copied()),
        });
    }
    match kind {
        Given::NativeMap => convert_native(input, output, &extension),
        Given::MapServer => convert_map_server(input, output, &extension),
        Given::Log => convert_log(input, output, extension.ends_with(".gz"), options),
    }
}

fn kind_of(input: &Path) -> Result<Given, ConvertError> {
    let unknown = |why: String| ConvertError::UnknownInput { path: input.to_path_buf(), why };
    match kind::kind_of(input) {
        Ok(Kind::NativeMap) => Ok(Given::NativeMap),
        Ok(Kind::MapServer) => Ok(Given::MapServer),
        Ok(Kind::Log(_)) => Ok(Given::Log),
        Ok(Kind::Foreign(kind)) => Err(unknown(format!("it is {}; {}", kind.with_article(), kind.advice))),
        Ok(Kind::KeptReadings) => Err(unknown("it holds the readings that a map is made of".into())),
        Ok(Kind::MobileSimWorld | Kind::Toml) => Err(unknown("it is a world or settings".into())),
        Err(LogError::UnknownFormat { begins, .. }) => Err(unknown(format!("it begins with \"{begins}\""))),
        Err(LogError::NotAFile { path }) => {
            Err(unknown(open_regular(&path).map_or_else(|no| no.to_string(), |_| "it is no regular file".into())))
        }
        Err(error) => Err(error.into()),
    }
}

fn extension(path: &Path) -> String {
    let name = path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
    let parts: Vec<&str> = name.split('.').skip(1).collect();
    match parts.as_slice() {
        [.., before, "gz"] => format!("{before}.gz"),
        [.., last] if *last == "yml" => "yaml".into(),
        [.., last] => (*last).to_owned(),
        [] => String::new(),
    }
}

fn convert_native(input: &Path, output: &Path, extension: &str) -> Result<ConvertReport, ConvertError> {
    let document = native::read(input)?;
    let mut report = ConvertReport {
        input: Given::NativeMap.name().into(),
        written: Vec::new(),
        lost: Vec::new(),
        remarks: Vec::new(),
    };
    if document.doubt.is_some() && extension != "echogrid" {
        report.lost.push("the doubt of each cell (--layer doubt)".into());
    }
    if document.facing.is_some() && extension != "echogrid" {
        report.lost.push("which way each wall faces (--layer facing)".into());
    }
    match extension {
        "echogrid" => {
            native::write(output, &document)?;
            report.written.push(output.to_path_buf());
        }
        "png" => {
            let document = drawn(document, &mut report)?;
            write_whole(output, &picture::encode(&document, true)?)?;
            report.written.push(output.to_path_buf());
            report.lost.push("a picture has no scale: resolution and origin are not in it".into());
        }
        _ => {
            report.lost.push("path, trust, revisions and provenance".into());
            let document = drawn(document, &mut report)?;
            write_occupancy(input, output, extension, &OccupancyMap::of(&document.grid)?, &mut report)?;
        }
    }
    Ok(report)
}

/// What a rectangle of cells can hold of a map.
fn drawn(document: MapDocument, report: &mut ConvertReport) -> Result<MapDocument, ConvertError> {
    let drawable = Drawable::of(&document)?;
    report.lost.extend(drawable.what_is_missing());
    Ok(drawable.document.unwrap_or(document))
}

fn convert_map_server(input: &Path, output: &Path, extension: &str) -> Result<ConvertReport, ConvertError> {
    let (_, map) = map_server::read(input)?;
    let mut report = ConvertReport {
        input: Given::MapServer.name().into(),
        written: Vec::new(),
        lost: Vec::new(),
        remarks: Vec::new(),
    };
    write_occupancy(input, output, extension, &map, &mut report)?;
    Ok(report)
}

/// Writes a map_server pair, or an array with its YAML.
fn write_occupancy(
    input: &Path,
    output: &Path,
    extension: &str,
    map: &OccupancyMap,
    report: &mut ConvertReport,
) -> Result<(), ConvertError> {
    let folder = output.parent().unwrap_or(Path::new(""));
    let stem = output.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let yaml_path = folder.join(format!("{stem}.yaml"));
    refuse_same(input, &yaml_path)?;
    if extension == "npy" {
        let name = output.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        refuse_other(&yaml_path, &name)?;
        let yaml = map_server::array_yaml(map, Thresholds::default(), name);
        write_together(&[(output.to_path_buf(), npy::encode(map)), (yaml_path.clone(), yaml)])?;
        report.written.extend([output.to_path_buf(), yaml_path]);
        return Ok(());
    }
    report.lost.push("probabilities: a cell is occupied, free or unknown (mode trinary)".into());
    report.written.extend(map_server::write(folder, &stem, map, MapMode::Trinary, Thresholds::default())?);
    Ok(())
}

fn convert_log(
    input: &Path,
    output: &Path,
    gzipped: bool,
    options: log::SurveyOptions,
) -> Result<ConvertReport, ConvertError> {
    refuse_same(input, output)?;
    let survey = log::survey_with(input, options)?;
    let mut events = log::open(input, &survey)?;
    let mut file = WholeFile::create(output)?;
    let scans_without_pose = if gzipped {
        let encoder = GzEncoder::new(&mut file, Compression::new(6));
        let (encoder, scans_without_pose) = write_events(encoder, &survey, &mut events, output)?;
        encoder.finish().map_err(|source| failed(output, source))?;
        scans_without_pose
    } else {
        write_events(&mut file, &survey, &mut events, output)?.1
    };
    file.commit()?;
    let mut lost = vec!["nearest ranges of the sensors, messages that are not used, refused lines".to_owned()];
    if scans_without_pose > 0 {
        lost.push(format!("{scans_without_pose} scans before the first odometry"));
    }
    if let Some(why) = survey.clock.invented() {
        lost.push(format!("the log's own stamps: {why}"));
    }
    Ok(ConvertReport {
        input: survey.format.to_string(),
        written: vec![output.to_path_buf()],
        lost,
        remarks: survey.remarks,
    })
}

/// Writes all events; the writer, and how many scans had no pose.
fn write_events<W: io::Write>(
    out: W,
    survey: &log::LogSurvey,
    events: &mut log::LogReader,
    output: &Path,
) -> Result<(W, u64), ConvertError> {
    let mut writer = CarmenWriter::new(out, &survey.robot).map_err(|source| failed(output, source))?;
    for event in events {
        writer.event(&event?).map_err(|source| failed(output, source))?;
    }
    let scans_without_pose = writer.scans_without_pose;
    let mut out = writer.into_inner();
    out.flush().map_err(|source| failed(output, source))?;
    Ok((out, scans_without_pose))
}

fn failed(path: &Path, source: io::Error) -> WriteError {
    WriteError { path: path.to_path_buf(), doing: "writing", source }
}

/// A log is read while its output is written beside it, so they could be one file; no user wants that.
/// The YAML of another image must go on telling where that lies.
fn refuse_other(yaml: &Path, image: &str) -> Result<(), ConvertError> {
    let known = std::fs::read_to_string(yaml).ok().and_then(|text| MapYaml::parse(&text).ok()).map(|known| known.image);
    match known.filter(|known| known != image) {
        Some(image) => Err(ConvertError::OtherImage { yaml: yaml.into(), image }),
        None => Ok(()),
    }
}

fn refuse_same(input: &Path, output: &Path) -> Result<(), ConvertError> {
    match (input.canonicalize(), output.canonicalize()) {
        (Ok(input), Ok(output)) if input == output => Err(ConvertError::SameFile { path: output }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::{CellIndex, Grid, Pose2};

    use super::*;
    use crate::map::{MapDocument, PathPoint, Provenance};

    const LOG: &str = "PARAM robot_front_laser_max 10 nohost 0\n\
        ODOM 0 0 0.1 0.25 -0.1 0 1.000000001 h 0\n\
        FLASER 3 1.25 10 nan 0 0 0 0 0 0 1.1 h 0\n\
        ROBOTLASER3 0 -1 2 1 20 0 0 3 5.5 20 1 0 0.3 0 0.1 0 0 0.1 0.25 0 0 0 0 1.2 h 0\n\
        SONAR 0.5 2 2.5 5 0.1 0 1.57 0.1 0 -1.57 1.3 h 0\n\
        SONAR 0.5 2 5 5 0.1 0 1.57 0.1 0 -1.57 1.4 h 0\n\
        TRUEPOS 7 8 0.5 0 0 0 1.5 h 0\n";

    fn native_map(folder: &Path) -> PathBuf {
        let mut grid = Grid::new(0.1);
        for (i, log_odds) in [(0, 3.0), (1, -3.0), (3, 0.1)] {
            let cell = CellIndex { i, j: 0 };
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = log_odds;
        }
        let path = vec![PathPoint { stamp_ns: 1, pose: Pose2::IDENTITY, trust: 1.0 }];
        let file = folder.join("m.echogrid");
        native::write(&file, &MapDocument { grid, doubt: None, facing: None, path, provenance: Provenance::default() })
            .unwrap();
        file
    }

    #[test]
    fn a_layer_of_a_map_comes_out_where_the_map_has_it() {
        let folder = tempfile::tempdir().unwrap();
        let map = native_map(folder.path());
        let out = |name: &str| folder.path().join(name);
        let error =
            |input: &Path, output: &str| convert_layer(input, &out(output), MapLayer::Facing).unwrap_err().to_string();
        assert!(error(&map, "f.png").contains("m.echogrid: holds no facing; a run with mapper.facing = true keeps it"));
        let mut document = native::read(&map).unwrap();
        let mut facing = Grid::new(0.1);
        let cell = CellIndex { i: 0, j: 0 };
        facing.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = 1.0;
        document.facing = Some(facing);
        native::write(&map, &document).unwrap();
        convert_layer(&map, &out("f.png"), MapLayer::Facing).unwrap();
        convert_layer(&map, &out("f.npy"), MapLayer::Facing).unwrap();
        assert!(std::fs::read(out("f.png")).unwrap().starts_with(b"\x89PNG"));
        assert!(std::fs::read(out("f.npy")).unwrap().starts_with(b"\x93NUMPY"));
        assert!(error(&map, "f.pgm").contains("a layer of a native map, which can't be written as"));
        assert!(error(&map, "m.echogrid").contains("same file"));
        std::fs::write(out("a.log"), LOG).unwrap();
        assert!(error(&out("a.log"), "f.png").contains("a.log is a log; expected a native map"));
    }

    #[test]
    fn a_log_comes_back_event_for_event() {
        let folder = tempfile::tempdir().unwrap();
        let [first, second, third] = ["a.txt", "b.log.gz", "c.log"].map(|name| folder.path().join(name));
        std::fs::write(&first, LOG).unwrap();
        convert(&first, &second).unwrap();
        convert(&second, &third).unwrap();
        let read = |path: &Path| {
            let survey = log::survey(path).unwrap();
            let events: Vec<_> = log::open(path, &survey).unwrap().map(Result::unwrap).collect();
            (survey.robot, events)
        };
        let (robot, events) = read(&first);
        assert_eq!(events.len(), 6);
        assert_eq!(robot.transducer_count(), 8);
        for path in [second, third] {
            let (robot_again, events_again) = read(&path);
            assert_eq!(events_again, events);
            assert_eq!(robot_again.transducer_count(), 8);
            let mount = |robot: &echogrid_core::Robot| robot.sensors[1].base_from_sensor;
            assert!(mount(&robot).distance_m(mount(&robot_again)) < 1e-12);
        }
    }

    #[test]
    fn a_native_map_becomes_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let map = native_map(folder.path());
        for (name, files) in [("p.png", 1), ("q.pgm", 2), ("r.yaml", 2), ("s.npy", 2), ("t.echogrid", 1)] {
            let report = convert(&map, &folder.path().join(name)).unwrap();
            assert_eq!(report.written.len(), files, "{name}");
            assert!(report.written.iter().all(|path| path.is_file()));
        }
        assert_eq!(std::fs::read(&map).unwrap(), std::fs::read(folder.path().join("t.echogrid")).unwrap());
        let (_, back) = map_server::read(&folder.path().join("q.yaml")).unwrap();
        assert_eq!(
            (0..4).map(|column| back.probability_at(column, 0)).collect::<Vec<_>>(),
            [Some(1.0), Some(0.0), None, None]
        );
        let report = convert(&folder.path().join("q.yaml"), &folder.path().join("u.npy")).unwrap();
        assert_eq!(report.input, "a map_server map");
    }

    #[test]
    fn errors_say_what_is_possible() {
        let folder = tempfile::tempdir().unwrap();
        let map = native_map(folder.path());
        let check = |input: &Path, output: &str, expected: &str| {
            let error = convert(input, &folder.path().join(output)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check(&map, "a.log", "possible: .png, .pgm, .yaml, .npy, .echogrid");
        check(&map, "a.pmg", "did you mean pgm?");
        convert(&map, &folder.path().join("pair.yaml")).unwrap();
        check(&map, "pair.npy", "tells where pair.pgm lies");
        check(&folder.path().join("m.echogird"), "a.png", "did you mean");
        let log = folder.path().join("l.log");
        std::fs::write(&log, LOG).unwrap();
        check(&log, "a.png", "a log, which can't be written as");
        check(&log, "l.log", "same file");
        let image = folder.path().join("i.pgm");
        std::fs::write(&image, b"P5\n1 1\n255\n\0").unwrap();
        check(&image, "a.npy", "name the YAML");
        let other = folder.path().join("x");
        std::fs::write(&other, b"\x01\x02").unwrap();
        check(&other, "a.npy", "it begins with");
        std::fs::write(&other, b"%PDF-1.7").unwrap();
        check(&other, "a.npy", "it is a PDF document");
    }
}
