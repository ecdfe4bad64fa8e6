//! A table with a header: one row is where the robot was, and what its sensors said then.
//!
//! | column | what it holds |
//! |---|---|
//! | `t`, `time`, `stamp`, `timestamp` | seconds; `_ms`, `_us` or `_ns` after the name says otherwise |
//! | `x`, `y` | metres; `_cm` or `_mm` |
//! | `theta`, `yaw`, `heading` | radians; `_deg` |
//! | `v`, `w` | m/s and rad/s; may be missing |
//! | `r0`, `r1` … | beams of a lidar on the base, from right to left as in `FLASER`: `_m` or nothing, `_cm`, `_mm` |
//! | `sonar_B` | a sonar on the base that looks to B degrees, counter-clockwise from ahead; cone 30°; units as of beams |
//!
//! Commas, semicolons or tabs part the columns; other columns are not used. A row whose ranges are all blank is odometry.

use core::f64::consts::FRAC_PI_6;
use std::collections::BTreeMap;

use echogrid_core::{POSITION_MAX_M, Pose2};

use crate::log::carmen::message::{Message, ScanKind, ScanLine, Shape};
use crate::log::carmen::plain_fan;
use crate::log::fault::{FaultKind, Refusal};
use crate::log::parse_stamp_ns;

/// Columns that are told apart.
const COLUMNS_MAX: usize = 65_536;
/// No lidar has a beam of a higher number.
const BEAMS_MAX: u16 = 16_384;
const NUMBER_MAX: f64 = 1e6;
/// Names of columns that an error shows.
const NAMES_SHOWN: usize = 12;
/// Names of the columns of stamps, and of headings.
const STAMPS: [&str; 4] = ["t", "time", "stamp", "timestamp"];
const HEADINGS: [&str; 3] = ["theta", "yaw", "heading"];

/// What the header says.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Columns {
    separator: char,
    header: String,
    count: usize,
    stamp: (usize, u64),
    x: (usize, f64),
    y: (usize, f64),
    theta: (usize, f64),
    v: Option<usize>,
    w: Option<usize>,
    /// Column and unit, in the order of their numbers; none: the table lacks that beam.
    beams: Vec<Option<(usize, f64)>>,
    /// Column, unit and where it looks.
    sonars: Vec<(usize, f64, Pose2)>,
}

impl Columns {
    /// Those of a table, whose header is the first line that is neither blank nor a comment.
    ///
    /// # Errors
    /// What is wrong with the header, in words; none: it is no table's.
    pub(super) fn of<'a>(mut lines: impl Iterator<Item = &'a str>) -> Result<Self, Option<String>> {
        let header = lines.find(|line| is_row(line)).ok_or(None)?.trim();
        let separator = [',', ';', '\t'].into_iter().find(|separator| header.contains(*separator)).ok_or(None)?;
        let names = Names(header.split(separator).map(plain_name).collect());
        if names.0.len() > COLUMNS_MAX {
            return Err(None);
        }
        let [stamp, x, y, theta] = names.needed()?;
        let ns = if stamp.1 == 1.0 && !names.0[stamp.0].ends_with("_ns") { 1e9 } else { stamp.1 };
        let (beams, sonars) = (names.beams()?, names.sonars()?);
        if beams.is_empty() && sonars.is_empty() {
            return Err(Some(format!(
                "no column holds ranges: r0, r1 … of a lidar, or sonar_90 of a sonar that looks to 90° (_m, _cm, _mm); there are {}",
                names.listed()
            )));
        }
        let speed = |name: &str, unit: &'static str| names.all(&[name], &[(unit, 1.0)]).first().map(|(at, _)| *at);
        Ok(Self {
            separator,
            header: header.to_owned(),
            count: names.0.len(),
            stamp: (stamp.0, ns as u64),
            x,
            y,
            theta,
            v: speed("v", "_mps"),
            w: speed("w", "_radps"),
            beams,
            sonars,
        })
    }

    /// The odometry of a row, then its readings.
    pub(super) fn parse(&self, line: &[u8], take: &mut dyn FnMut(Message<'_>)) -> Result<(), Refusal> {
        let text = core::str::from_utf8(line)
            .map_err(|_| Refusal::new(FaultKind::NotUtf8, String::from_utf8_lossy(line.get(..200).unwrap_or(line))))?;
        if !is_row(text) || text.trim() == self.header {
            return Ok(());
        }
        let cells: Vec<&str> = text.split(self.separator).map(|cell| cell.trim().trim_matches('"')).collect();
        match cells.len() {
            more if more > self.count => return Err(Refusal::new(FaultKind::ExtraWords, text)),
            fewer if fewer < self.count => return Err(Refusal::new(FaultKind::Truncated, text)),
            _ => {}
        }
        let cell = |at: usize| cells.get(at).copied().unwrap_or_default();
        let number = |at: usize, unit: f64, most: f64, beyond: FaultKind| {
            let value: f64 = cell(at).parse().map_err(|_| Refusal::new(FaultKind::BadNumber, cell(at)))?;
            match value * unit {
                value if !value.is_finite() => Err(Refusal::new(FaultKind::NotFinite, cell(at))),
                value if value.abs() > most => Err(Refusal::new(beyond, cell(at))),
                value => Ok(value),
            }
        };
        let place = |(at, unit): (usize, f64)| number(at, unit, POSITION_MAX_M, FaultKind::AbsurdPose);
        let theta = number(self.theta.0, self.theta.1, NUMBER_MAX, FaultKind::AbsurdPose)?;
        let odom_from_base = Pose2::new(place(self.x)?, place(self.y)?, theta);
        let speed = |at: Option<usize>| at.map_or(Ok(0.0), |at| number(at, 1.0, 1e3, FaultKind::AbsurdVelocity));
        let (v_mps, w_radps) = (speed(self.v)?, speed(self.w)?);
        let range = |at: usize, unit: f64| match cell(at) {
            "" => Ok(f64::NAN),
            word => word.parse::<f64>().map(|range| range * unit).map_err(|_| Refusal::new(FaultKind::BadNumber, word)),
        };
        let beam = |column: &Option<(usize, f64)>| column.map_or(Ok(f64::NAN), |(at, unit)| range(at, unit));
        let beams = self.beams.iter().map(beam).collect::<Result<Vec<f64>, _>>()?;
        let sonars = self.sonars.iter().map(|(at, unit, _)| range(*at, *unit)).collect::<Result<Vec<f64>, _>>()?;
        let stamp_ns = self.stamp_ns(cell(self.stamp.0));
        take(Message::Odometry { odom_from_base, v_mps, w_radps, stamp_ns });
        let (first_bearing_rad, bearing_step_rad) = plain_fan(beams.len());
        let fan = Shape::Fan { first_bearing_rad, bearing_step_rad, range_max_m: None };
        let mounts = self.sonars.iter().map(|(_, _, mount)| *mount).collect();
        let ring = Shape::Ring { aperture_rad: FRAC_PI_6, base_from_sonar: mounts };
        for (kind, shape, ranges) in [(ScanKind::Front, fan, beams), (ScanKind::Sonar, ring, sonars)] {
            if !ranges.iter().all(|range| range.is_nan()) {
                take(Message::Scan(ScanLine {
                    kind,
                    shape,
                    ranges,
                    carried: None,
                    stamp_ns,
                    described: None,
                    oddities: Vec::new(),
                }));
            }
        }
        Ok(())
    }

    /// Exact to the last digit, whatever the unit.
    fn stamp_ns(&self, word: &str) -> Option<u64> {
        match self.stamp.1 {
            1_000_000_000 => parse_stamp_ns(word),
            // Whole or decimal units: the digits before and after the point apart.
            unit => {
                let (whole, fraction) = word.split_once('.').unwrap_or((word, ""));
                let fraction: f64 = if fraction.is_empty() { 0.0 } else { format!("0.{fraction}").parse().ok()? };
                whole.parse::<u64>().ok()?.checked_mul(unit)?.checked_add((fraction * unit as f64) as u64)
            }
        }
        .filter(|stamp_ns| *stamp_ns < 10_000_000_000 * 1_000_000_000)
    }
}

/// The names of a table's columns, plain.
struct Names(Vec<String>);

impl Names {
    /// The columns of one of these names, with what one of their unit is.
    fn all(&self, wanted: &[&str], units: &[Unit]) -> Vec<(usize, f64)> {
        let unit_of = |name: &String| {
            let (name, unit) = with_unit(name, units);
            wanted.contains(&name).then_some(unit)
        };
        self.0.iter().enumerate().filter_map(|(at, name)| Some((at, unit_of(name)?))).collect()
    }

    /// The columns of stamp, x, y and heading.
    ///
    /// # Errors
    /// Which is missing, or there twice; none: it is no table's header.
    fn needed(&self) -> Result<[(usize, f64); 4], Option<String>> {
        let angles = [("_rad", 1.0), ("_deg", 1_f64.to_radians())];
        let needed: [(&[&str], &[Unit], &str); 4] = [
            (&STAMPS, &TIMES, "t, time, stamp or timestamp (_s, _ms, _us, _ns)"),
            (&["x"], &LENGTHS, "x (_m, _cm, _mm)"),
            (&["y"], &LENGTHS, "y (_m, _cm, _mm)"),
            (&HEADINGS, &angles, "theta, yaw or heading (_rad, _deg)"),
        ];
        let found = needed.map(|(wanted, units, _)| self.all(wanted, units));
        // Two of four are no accident.
        let is_table = found.iter().filter(|columns| !columns.is_empty()).count() >= 2;
        let mut one = [(0, 0.0); 4];
        for ((columns, (wanted, _, expected)), one) in found.iter().zip(needed).zip(&mut one) {
            *one = match columns.as_slice() {
                [only] => *only,
                [] => {
                    return Err(is_table.then(|| format!("no column is named {expected}; there are {}", self.listed())));
                }
                [first, second, ..] => return Err(is_table.then(|| twice(first.0, second.0, wanted[0]))),
            };
        }
        Ok(one)
    }

    /// Columns and units of the beams, in the order of their numbers; none where the table lacks one.
    ///
    /// # Errors
    /// A beam is there twice.
    fn beams(&self) -> Result<Vec<Option<(usize, f64)>>, String> {
        let mut beams: BTreeMap<u16, (usize, f64)> = BTreeMap::new();
        for (at, name) in self.0.iter().enumerate() {
            let (name, unit) = with_unit(name, &LENGTHS);
            let number = name.strip_prefix('r').and_then(|number| number.parse::<u16>().ok());
            if let Some(number) = number.filter(|number| *number <= BEAMS_MAX)
                && let Some((first, _)) = beams.insert(number, (at, unit))
            {
                return Err(twice(first, at, &format!("r{number}")));
            }
        }
        // Some count from 1.
        let first = u16::from(!beams.contains_key(&0));
        let last = beams.keys().next_back().copied();
        Ok(last.map_or_else(Vec::new, |last| (first..=last).map(|number| beams.get(&number).copied()).collect()))
    }

    /// Columns and units of the sonars, and where they look.
    ///
    /// # Errors
    /// Two look to the same bearing.
    fn sonars(&self) -> Result<Vec<(usize, f64, Pose2)>, String> {
        let mut sonars: Vec<(usize, f64, Pose2)> = Vec::new();
        for (at, name) in self.0.iter().enumerate() {
            let (name, unit) = with_unit(name, &LENGTHS);
            let bearing = name.strip_prefix("sonar_").and_then(|bearing| bearing.parse::<f64>().ok());
            let Some(bearing) = bearing.filter(|bearing| bearing.abs() <= 360.0) else { continue };
            let mount = Pose2::new(0.0, 0.0, bearing.to_radians());
            if let Some((first, ..)) = sonars.iter().find(|(.., other)| *other == mount) {
                return Err(twice(*first, at, name));
            }
            sonars.push((at, unit, mount));
        }
        Ok(sonars)
    }

    /// For people.
    fn listed(&self) -> String {
        let shown: Vec<&str> = self.0.iter().take(NAMES_SHOWN).map(String::as_str).collect();
        let more = if self.0.len() > shown.len() { " …" } else { "" };
        format!("{}{more}", shown.join(", "))
    }
}

/// What is said of two columns of one meaning.
fn twice(first: usize, second: usize, name: &str) -> String {
    format!("columns {} and {} are both {name}: which counts?", first + 1, second + 1)
}

/// The end of a name that says a unit, and what one of it is.
type Unit = (&'static str, f64);

const TIMES: [Unit; 4] = [("_ns", 1.0), ("_us", 1e3), ("_ms", 1e6), ("_s", 1e9)];
const LENGTHS: [Unit; 3] = [("_mm", 0.001), ("_cm", 0.01), ("_m", 1.0)];

fn is_row(line: &str) -> bool {
    !line.trim().is_empty() && !line.trim_start().starts_with('#')
}

/// A name as it is compared: `Theta [deg]` is `theta_deg`.
fn plain_name(name: &str) -> String {
    let name = name.trim().trim_matches('"').trim().to_ascii_lowercase();
    match name.strip_suffix([']', ')']).and_then(|name| name.split_once(['[', '('])) {
        Some((name, unit)) => format!("{}_{}", name.trim(), unit.trim()),
        None => name,
    }
}

/// A name without its unit, and what one of it is.
fn with_unit<'n>(name: &'n str, units: &[Unit]) -> (&'n str, f64) {
    let found = units.iter().find_map(|(unit, one)| name.strip_suffix(unit).map(|name| (name, *one)));
    found.unwrap_or((name, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn messages(text: &str) -> Vec<String> {
        let columns = Columns::of(text.lines()).unwrap();
        let mut found = Vec::new();
        for line in text.lines() {
            let mut take = |message: Message<'_>| {
                found.push(match message {
                    Message::Odometry { odom_from_base: Pose2 { x, y, theta }, stamp_ns, .. } => {
                        format!("odometry {x:.3} {y:.3} {theta:.3} {stamp_ns:?}")
                    }
                    Message::Scan(scan) => format!("{:?} {:?}", scan.kind, scan.ranges),
                    other => format!("{other:?}"),
                });
            };
            if let Err(refusal) = columns.parse(line.as_bytes(), &mut take) {
                found.push(format!("{:?}", refusal.kind));
            }
        }
        found
    }

    #[test]
    fn units_are_in_the_names() {
        let text = "# made by hand\nTime_ms; X_cm;y_cm;Heading_deg;r0_mm;r1_mm;battery\n1500.5;100;-50;90;1000;;7\n";
        assert_eq!(messages(text), ["odometry 1.000 -0.500 1.571 Some(1500500000)", "Front [1.0, NaN]"]);
        let text = "t (ms),x [m],y[cm],theta (deg),r0\n1500;\n1500,1,50,90,2\n";
        assert_eq!(messages(text)[1], "odometry 1.000 0.500 1.571 Some(1500000000)");
        let text = "t,x,y,theta,sonar_-90,sonar_37.5\n0.25,1,2,3,4,5\n0.5,1,2,3,,\n";
        let expected = [
            "odometry 1.000 2.000 3.000 Some(250000000)",
            "Sonar [4.0, 5.0]",
            "odometry 1.000 2.000 3.000 Some(500000000)",
        ];
        assert_eq!(messages(text), expected);
    }

    #[test]
    fn beams_lie_where_their_numbers_say() {
        let text = "t,x,y,theta,r3,r0,r1\n1,2,3,1,0.3,0.0,0.1\n";
        assert_eq!(messages(text)[1], "Front [0.0, 0.1, NaN, 0.3]");
        // Some count from 1.
        assert_eq!(messages("t,x,y,theta,r1,r2\n1,2,3,1,0.1,0.2\n")[1], "Front [0.1, 0.2]");
    }

    #[test]
    fn rows_that_are_wrong() {
        let text = "t,x,y,theta,r0\n1,2,3\n1,2,3,4,5,6\n1,x,3,4,5\n1,nan,3,4,5\n1,1e9,3,4,5\n-1,2,3,1,5\n";
        let expected = ["Truncated", "ExtraWords", "BadNumber", "NotFinite", "AbsurdPose"];
        assert_eq!(messages(text), [&expected[..], &["odometry 2.000 3.000 1.000 None", "Front [5.0]"]].concat());
    }

    #[test]
    fn a_table_without_a_pose_or_ranges_is_none() {
        for (text, expected) in [
            ("", None),
            ("t x y theta r0\n", None),
            ("a, b\n", None),
            ("t,x,y\n", Some("no column is named theta, yaw or heading")),
            ("x,y,theta,r0\n", Some("no column is named t, time, stamp")),
            ("t,x,x,y,theta,r0\n", Some("columns 2 and 3 are both x")),
            ("t,x,y,theta,r0,r1,r1\n", Some("columns 6 and 7 are both r1")),
            ("t,x,y,theta,sonar_90,sonar_90\n", Some("columns 5 and 6 are both sonar_90")),
            ("t,x,y,theta,sonar_front\n", Some("there are t, x, y, theta, sonar_front")),
        ] {
            let wrong = Columns::of(text.lines()).unwrap_err();
            match expected {
                None => assert_eq!(wrong, None, "{text}"),
                Some(expected) => assert!(wrong.as_ref().is_some_and(|wrong| wrong.contains(expected)), "{wrong:?}"),
            }
        }
    }
}
