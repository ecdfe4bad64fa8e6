//! `echogrid score`.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use echogrid_core::Pose2;
use echogrid_formats::localization::{Covariance, ReferencePath, read_covariances};
use echogrid_formats::log::{self, LogEvent, SurveyOptions};
use echogrid_formats::map::{MapDocument, native, picture};
use echogrid_formats::{probe_file, world};
use echogrid_judge::quality::{Quality, TrueCell, Truth};
use echogrid_slam::evaluate::{Consistency, NEES_OF_ONE, PathError};
use echogrid_slam_service::{COVARIANCE_FILE, PATH_FILE};
use serde::Serialize;

use echogrid_instruments::{Align, Alignment, at};

/// What is judged, and by what.
pub(super) struct Request {
    pub(super) map: PathBuf,
    pub(super) world: PathBuf,
    pub(super) path: Option<PathBuf>,
    /// Who says it in a recording.
    pub(super) truth: Option<String>,
    pub(super) topics: Vec<String>,
    /// Nothing: as the map suggests.
    pub(super) align: Option<Align>,
    pub(super) points: bool,
    pub(super) json: bool,
    pub(super) picture: Option<PathBuf>,
}

/// What it came to.
#[derive(Debug, Serialize)]
pub(super) struct Score<'a> {
    map: &'a Path,
    world: &'a Path,
    /// The log of the true path; none: the map's own path was taken for true.
    path: Option<&'a Path>,
    /// Poses of that path.
    poses: usize,
    /// How the map was laid on the world; none: the map's own path was taken for true.
    alignment: Option<Alignment>,
    /// How far the map's own path is off; none without the true one.
    path_error: Option<PathFigures>,
    /// Whether what the path claims of its error is so; none where it claims nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    claims: Option<Claims>,
    /// Points of the world that were not taken for walls.
    points_left_out: usize,
    /// Cells of walls that count.
    cells_occupied: u64,
    /// Free cells that count.
    cells_free: u64,
    #[serde(flatten)]
    quality: Quality,
    picture: Option<&'a Path>,
}

/// How far a path is off, laid on the true one by all of it.
#[derive(Debug, Serialize)]
struct PathFigures {
    /// ATE: distances to the true positions, metres.
    absolute_mean_m: f64,
    absolute_rms_m: f64,
    absolute_max_m: f64,
    /// Over each metre of true way: metres per metre, and radians per metre.
    per_metre_m: f64,
    per_metre_rad: f64,
}

/// NEES: the normalized squared error of poses, whose covariances are known.
#[derive(Debug, Serialize)]
struct Claims {
    poses: usize,
    nees_mean: f64,
    within_three_sigmas: f64,
}

impl Claims {
    /// Of the poses of which it is said beside the map how sure they are.
    fn of(map: &Path, truth: &[(u64, Pose2)]) -> Result<Option<Self>> {
        let [path, covariances] = [PATH_FILE, COVARIANCE_FILE].map(|name| map.with_file_name(name));
        if !(path.is_file() && covariances.is_file()) {
            return Ok(None);
        }
        let poses = ReferencePath::read(&path)?;
        let claimed = read_covariances(&covariances)?;
        let of = |(stamp_ns, covariance): &(u64, Covariance)| {
            Some((poses.at(*stamp_ns, u64::MAX)?, at(truth, *stamp_ns)?, *covariance))
        };
        let first =
            poses.poses().first().and_then(|(stamp_ns, pose)| Some((*pose, at(truth, *stamp_ns)?, [[0.0; 3]; 3])));
        let claims: Vec<_> = first.into_iter().chain(claimed.iter().filter_map(of)).collect();
        let found = first.and_then(|_| Consistency::of(&claims));
        Ok(found.map(|Consistency { poses, mean, within_three_sigmas }| Self {
            poses,
            nees_mean: mean,
            within_three_sigmas,
        }))
    }
}

impl PathFigures {
    fn of(document: &MapDocument, truth: &[(u64, Pose2)]) -> Option<Self> {
        let pairs: Vec<(Pose2, Pose2)> =
            document.last_drive().iter().filter_map(|point| Some((point.pose, at(truth, point.stamp_ns)?))).collect();
        let error = PathError::of(&pairs)?;
        Some(Self {
            absolute_mean_m: error.absolute_m.mean,
            absolute_rms_m: error.absolute_m.rms,
            absolute_max_m: error.absolute_m.max,
            per_metre_m: error.per_metre_m.mean,
            per_metre_rad: error.per_metre_rad.mean,
        })
    }
}

/// Judges a map, and tells what it came to.
pub(super) fn run(request: &Request) -> Result<()> {
    let score = judge(request)?;
    super::print_found(&score, request.json)
}

/// Judges a map.
pub(super) fn judge(request: &Request) -> Result<Score<'_>> {
    request.picture.iter().try_for_each(|file| probe_file(file))?;
    let document = native::read(&request.map)?;
    let world = world::find(&request.world)?;
    let (world, points_left_out) = if request.points { (world, 0) } else { world.walls_only()? };
    let truth = request.path.as_deref().map(|path| true_path(path, request)).transpose()?;
    let alignment = match &truth {
        Some(truth) => {
            Some(Alignment::of(&document, truth, request.align).with_context(|| request.map.display().to_string())?)
        }
        None => {
            ensure!(
                request.align.is_none_or(|align| align == Align::None),
                "--align needs --path LOG, a log with TRUEPOS lines: the map's own path is taken for true without it"
            );
            None
        }
    };
    let path_error = truth.as_ref().and_then(|truth| PathFigures::of(&document, truth));
    let claims = truth.as_ref().map(|truth| Claims::of(&request.map, truth)).transpose()?.flatten();
    let map_from_world = alignment.filter(Alignment::moves).map(|alignment| alignment.map_from_world);
    let world = map_from_world.map_or(Ok(world.clone()), |map_from_world| world.moved(map_from_world))?;
    let path = match truth {
        Some(truth) => truth.into_iter().map(|(_, pose)| map_from_world.map_or(pose, |moved| moved * pose)).collect(),
        None => own_path(&document, &request.map)?,
    };
    let failed = || format!("{} in {}", request.map.display(), request.world.display());
    let truth = Truth::of(&world, &path, &document.grid).with_context(failed)?;
    let quality = Quality::against(&document.grid, &truth).with_context(failed)?;
    if let Some(file) = &request.picture {
        picture::write_judged(file, &document.grid, &truth, &path)?;
    }
    let count = |kind| truth.cells().filter(|(_, is)| *is == kind).count() as u64;
    Ok(Score {
        map: &request.map,
        world: &request.world,
        path: request.path.as_deref(),
        poses: path.len(),
        alignment,
        path_error,
        claims,
        points_left_out,
        cells_occupied: count(TrueCell::Wall),
        cells_free: count(TrueCell::Free),
        quality,
        picture: request.picture.as_deref(),
    })
}

/// Where the robot really was, and when.
pub(super) fn true_path(log: &Path, request: &Request) -> Result<Vec<(u64, Pose2)>> {
    let (truth, topics) = (request.truth.clone(), request.topics.clone());
    let survey = log::survey_with(log, SurveyOptions { truth, topics, ..SurveyOptions::default() })?;
    ensure!(
        survey.true_pose_count > 0,
        "{}: no true pose in it; expected a log with TRUEPOS lines, or a recording and --truth tf or a topic (without --path, the map's own path is taken for true)",
        log.display()
    );
    let mut path = Vec::new();
    for event in log::open(log, &survey)? {
        if let LogEvent::TruePose { stamp_ns, map_from_base } = event? {
            path.push((stamp_ns, map_from_base));
        }
    }
    Ok(path)
}

fn own_path(document: &MapDocument, map: &Path) -> Result<Vec<Pose2>> {
    ensure!(
        !document.path.is_empty(),
        "{}: no path in it; expected --path LOG, a log with TRUEPOS lines",
        map.display()
    );
    Ok(document.path.iter().map(|point| point.pose).collect())
}

impl fmt::Display for Score<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let left_out = self.points_left_out;
        let Quality { bits, bits_occupied, bits_free, .. } = self.quality;
        write!(f, "{} in {}, ", name(self.map), name(self.world))?;
        match self.path {
            Some(log) => writeln!(f, "along the true path of {} ({} poses)", name(log), self.poses)?,
            None => writeln!(f, "along the map's own path, taken for true ({} poses)", self.poses)?,
        }
        writeln!(
            f,
            "bits         {bits:.3} per cell: {bits_occupied:.3} of walls, {bits_free:.3} of free cells (1: knows nothing; 0: perfect)"
        )?;
        writeln!(f, "calibration  {:.3} between what was said and what is", self.quality.calibration_error)?;
        writeln!(
            f,
            "decided      {:.1} % of {} cells that count, {:.1} % wrong; {:.1} % of the free ones are called occupied",
            100.0 * self.quality.decided,
            self.cells_occupied + self.cells_free,
            100.0 * self.quality.decided_wrong,
            100.0 * self.quality.free_called_occupied
        )?;
        writeln!(
            f,
            "walls        {:.1} % of {} cells found within 10 cm; {:.1} % of the map's are real",
            100.0 * self.quality.wall_recall_10cm,
            self.cells_occupied,
            100.0 * self.quality.wall_precision_10cm
        )?;
        if let Some(alignment) = &self.alignment {
            writeln!(f, "aligned      {alignment}")?;
        }
        if let Some(off) = &self.path_error {
            writeln!(f, "path error   {off}")?;
        }
        if let Some(claims) = &self.claims {
            writeln!(f, "claims       {claims}")?;
        }
        if bits > 1.0 {
            writeln!(
                f,
                "note         worse than a map that knows nothing: is this its world, and the path (--path) that of its drive?"
            )?;
        }
        if left_out > 0 {
            writeln!(f, "world        {left_out} points not taken for walls (--points takes them)")?;
        }
        self.picture.map_or(Ok(()), |picture| writeln!(f, "picture      {}", picture.display()))
    }
}

impl fmt::Display for PathFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:.3} m in the mean, {:.3} m rms, {:.3} m at most, laid on the true one; {:.2} % of each metre and {:.3}°",
            self.absolute_mean_m,
            self.absolute_rms_m,
            self.absolute_max_m,
            100.0 * self.per_metre_m,
            self.per_metre_rad.to_degrees()
        )
    }
}

impl fmt::Display for Claims {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { poses, nees_mean, within_three_sigmas } = self;
        write!(
            f,
            "NEES {nees_mean:.2} in the mean of {poses} poses (right: 1; of a single pose {:.2} to {:.1} in 95 of 100), {:.1} % within \
             three of its deviations",
            NEES_OF_ONE.0,
            NEES_OF_ONE.1,
            100.0 * within_three_sigmas
        )
    }
}
