//! `echogrid closures`: what SLAM recognised, and with what evidence.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use echogrid_formats::open_regular;
use echogrid_slam::closures::Standing;
use echogrid_slam::report::{By, Evidence, Report};
use echogrid_slam_service::CLOSURES_FILE;

/// Prints the closures of a folder of maps, or of a file.
pub(super) fn run(map: &Path, json: bool) -> Result<()> {
    let report = read(map)?;
    super::print(&if json { echogrid_instruments::json(&report)? } else { Table(&report).to_string() })
}

/// Reads what SLAM wrote beside a map: `map` is the folder, the map, or the file itself.
pub(super) fn read(map: &Path) -> Result<Report> {
    let file = file(map);
    let text = open_regular(&file).and_then(io::read_to_string).with_context(|| {
        format!("{}: the closures of a map that was made with --slam are expected there", file.display())
    })?;
    serde_json::from_str(&text).with_context(|| format!("{}: expected what `--slam` writes there", file.display()))
}

fn file(map: &Path) -> PathBuf {
    if map.is_dir() {
        return map.join(CLOSURES_FILE);
    }
    match map.extension() {
        Some(ending) if ending == "json" => map.into(),
        _ => map.with_file_name(CLOSURES_FILE),
    }
}

struct Table<'a>(&'a Report);

impl fmt::Display for Table<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let report = self.0;
        let closures = &report.closures;
        writeln!(f, "{}", summary(report))?;
        if closures.is_empty() {
            return Ok(());
        }
        let is_of_sonars = matches!(closures[0].by, By::Echoes { .. });
        let [a, b, c] = if is_of_sonars { ["nat", "± m", "± °"] } else { ["score", "near", "rms m"] };
        writeln!(
            f,
            "{:>11} {:>9} {:>9}  {:>7} {:>6} {:>6}  {a:>5} {b:>5} {c:>5}  {:>5}  what became of it",
            "name", "place s", "again s", "loop m", "off m", "off °", "agree"
        )?;
        let first_ns = closures.iter().map(|closure| closure.from_ns).min().unwrap_or(0);
        for closure in closures {
            let Evidence { from, to, from_ns, to_ns, loop_m, off, by, support, .. } = closure;
            let seconds = |stamp_ns: u64| stamp_ns.saturating_sub(first_ns) as f64 * 1e-9;
            let what = match (closure.standing, closure.slides) {
                (Standing::Applied, false) => "applied",
                (Standing::Applied, true) => "applied, but along the corridor",
                (Standing::Alone, _) => "not applied: too few agree",
                (Standing::TakenBack, _) => "taken back: the rest is against it",
                (Standing::Forbidden, _) => "forbidden by hand",
                (Standing::Required, false) => "required by hand",
                (Standing::Required, true) => "required by hand, but along the corridor",
            };
            let by = match by {
                By::Points { score, inliers, rms_m } => format!("{score:5.2} {inliers:5.2} {rms_m:5.3}"),
                By::Echoes { evidence_nat, sigma } => {
                    format!("{evidence_nat:5.2} {:5.2} {:5.1}", sigma.0, sigma.1.to_degrees())
                }
            };
            writeln!(
                f,
                "{:>11} {:9.1} {:9.1}  {loop_m:7.1} {:6.2} {:6.1}  {by}  {support:5}  {what}",
                format!("{from},{to}"),
                seconds(*from_ns),
                seconds(*to_ns),
                off.0,
                off.1.to_degrees(),
            )?;
        }
        let by = if is_of_sonars {
            "nat: how much better a reading fits\nthe place than nothing; ±: how exactly it lies, one standard deviation"
        } else {
            "score: share of points on walls;\nnear: with a partner within 10 cm, rms m off its wall"
        };
        writeln!(
            f,
            "name: for --forbid and --require, the numbers of its nodes in graph.g2o. Seconds since the first place. off: from where it \
             was believed to be. {by}. agree: how many other closures do."
        )
    }
}

/// What is worth knowing of a drive whose lidar saw next to nothing that it could match.
pub(super) fn remark(report: &Report) -> Option<String> {
    let Report { nodes, lost, .. } = report;
    if let Some([lost, nodes]) = report.instead_of_lidar {
        return Some(format!(
            "--slam: {lost} of {nodes} scans of the lidar could not be matched, and it recognised no place: the sonars corrected the poses in its place"
        ));
    }
    (report.unrecognised.is_none() && 2 * lost > *nodes).then(|| {
        format!(
            "--slam: {lost} of {nodes} scans of the lidar could not be matched; the poses are hardly better than the odometry's, but the map \
             is drawn as if they were; a map without --slam shows the doubt"
        )
    })
}

/// What SLAM came to, in a line.
pub(crate) fn summary(report: &Report) -> String {
    let (all, applied) = (report.closures.len(), report.applied());
    let closures = match (all, applied) {
        (0, _) => "no place was recognised".to_owned(),
        (all, applied) if all == applied => format!("{applied} closures"),
        (all, applied) => format!("{applied} closures of {all} found"),
    };
    let unrecognised = report.unrecognised.unwrap_or_default();
    let no_fit = match unrecognised.no_fit {
        0 => String::new(),
        count => format!(", {count} did not fit"),
    };
    let few = match unrecognised.too_few {
        0 => String::new(),
        count => format!(", {count} of which too little was heard"),
    };
    let ambiguous = match report.ambiguous {
        0 => String::new(),
        count => format!(", {count} places not told apart"),
    };
    let lost = match report.lost {
        0 => String::new(),
        lost => format!(", {lost} of {} scans not matched", report.nodes),
    };
    let end = report.end_sigma.map_or(String::new(), |[x, y, theta]| {
        format!("; at the end ± {:.2} m, {:.1}°", x.hypot(y), theta.to_degrees())
    });
    format!("{closures}{ambiguous}{no_fit}{few}{lost}{end}")
}
