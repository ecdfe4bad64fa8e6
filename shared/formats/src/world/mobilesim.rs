//! Worlds of ActivMedia, MobileSim and ARIA: `.map`.
//!
//! A first line `2D-Map`, `Key: value` lines, then sections of whole numbers in millimetres: `LINES` (x1 y1 x2 y2) and
//! `DATA` (x y), or the same of one sensor, `<Sensor>_LINES` and `<Sensor>_DATA`. `Cairn:` lines are places. The counts and
//! bounds that such a file states are often wrong, and are not looked at.

use echogrid_core::Pose2;
use echogrid_core::world::{Goal, Segment, WorldParts};

use super::TextError;

/// A point is a square of this side where the file does not say, millimetres.
const RESOLUTION_MM: f64 = 20.0;

const LINE: &str = "four numbers x1 y1 x2 y2, millimetres";
const POINT: &str = "two numbers x y, millimetres";
const CAIRN: &str = "`Cairn: Type x y theta \"\" ICON \"label\"`, millimetres and degrees";
const CORNERS: &str = "a cairn of this type with x1 y1 x2 y2 after its label, millimetres";

/// What the lines from here on are.
#[derive(Clone, Copy, PartialEq)]
enum Section {
    Header,
    Lines,
    Data,
}

/// Reads a world of MobileSim.
///
/// # Errors
/// When a line is none of the expected.
pub fn parse(text: &str) -> Result<WorldParts, TextError> {
    let mut lines =
        text.trim_start_matches('\u{feff}').lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
    match lines.by_ref().find(|(_, line)| !line.is_empty()) {
        Some((_, first)) if first.starts_with("2D-Map") => {}
        first => {
            let (line, found) = first.unwrap_or((1, ""));
            return Err(error(line, found, "2D-Map, the first line of a MobileSim world"));
        }
    }
    let mut parts = WorldParts { point_radius_m: 0.5e-3 * RESOLUTION_MM, ..WorldParts::default() };
    let mut section = Section::Header;
    for (number, line) in lines.filter(|(_, line)| !line.is_empty()) {
        if let Some(next) = section_of(line) {
            section = next;
            continue;
        }
        let wrong = |expected| error(number, line, expected);
        match section {
            Section::Header => header(line, &mut parts).map_err(wrong)?,
            Section::Lines => {
                let [x1, y1, x2, y2] = metres(line).ok_or_else(|| wrong(LINE))?;
                parts.walls.push(Segment { from: [x1, y1], to: [x2, y2] });
            }
            Section::Data => parts.points.push(metres(line).ok_or_else(|| wrong(POINT))?),
        }
    }
    Ok(parts)
}

fn section_of(line: &str) -> Option<Section> {
    if line == "LINES" || line.ends_with("_LINES") {
        Some(Section::Lines)
    } else if line == "DATA" || line.ends_with("_DATA") {
        Some(Section::Data)
    } else {
        None
    }
}

fn header(line: &str, parts: &mut WorldParts) -> Result<(), &'static str> {
    let (key, value) = line.split_once(':').ok_or("`Key: value`, LINES or DATA")?;
    match key {
        "Cairn" => cairn(value, parts),
        "Resolution" => {
            let resolution_mm = number(value.trim()).filter(|mm| (1.0..=1000.0).contains(mm));
            parts.point_radius_m = 0.5e-3 * resolution_mm.ok_or("Resolution: millimetres, from 1 to 1000")?;
            Ok(())
        }
        // What is in the file is counted, not believed; the rest is for people.
        _ => Ok(()),
    }
}

fn cairn(value: &str, parts: &mut WorldParts) -> Result<(), &'static str> {
    let words = words(value);
    let [kind, x, y, theta, rest @ ..] = words.as_slice() else { return Err(CAIRN) };
    let [x, y, theta] = [x, y, theta].map(|word| number(word));
    let (Some(x), Some(y), Some(theta_deg)) = (x, y, theta) else { return Err(CAIRN) };
    let theta = theta_deg * core::f64::consts::PI / 180.0;
    let pose = Pose2::new(x / 1e3, y / 1e3, theta);
    // "internal" ICON "label", then what belongs to the type.
    let label = rest.get(2).cloned().unwrap_or_default();
    let corners = || -> Result<[f64; 4], &'static str> {
        let numbers =
            rest.get(3..7).and_then(|words| words.iter().map(|word| number(word)).collect::<Option<Vec<_>>>());
        let corners: [f64; 4] = numbers.and_then(|numbers| numbers.try_into().ok()).ok_or(CORNERS)?;
        Ok(corners.map(|mm| mm / 1e3))
    };
    match kind.as_str() {
        "RobotHome" => parts.places.home = parts.places.home.or(Some(pose)),
        "Goal" | "GoalWithHeading" | "Dock" => {
            parts.places.goals.push(Goal { name: label, pose, has_heading: kind != "Goal" });
        }
        "ForbiddenLine" => {
            let [x1, y1, x2, y2] = corners()?;
            parts.places.forbidden.push(Segment { from: [x1, y1], to: [x2, y2] });
        }
        "ForbiddenArea" => parts.places.forbidden.extend(rectangle(theta, corners()?)),
        "Sim.BoxObstacle" => parts.walls.extend(rectangle(theta, corners()?)),
        _ => {}
    }
    Ok(())
}

/// The sides of a rectangle that its heading turns about the origin of the map.
fn rectangle(theta: f64, [x1, y1, x2, y2]: [f64; 4]) -> [Segment; 4] {
    let turn = Pose2::new(0.0, 0.0, theta);
    let corners = [[x1, y1], [x2, y1], [x2, y2], [x1, y2]].map(|corner| turn.transform(corner));
    let [a, b, c, d] = corners;
    [(a, b), (b, c), (c, d), (d, a)].map(|(from, to)| Segment { from, to })
}

/// Words, or quoted strings.
fn words(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        let (word, after) = match rest.strip_prefix('"') {
            Some(quoted) => quoted.split_once('"').unwrap_or((quoted, "")),
            None => rest.split_once(char::is_whitespace).unwrap_or((rest, "")),
        };
        words.push(word.to_owned());
        rest = after.trim_start();
    }
    words
}

fn number(word: &str) -> Option<f64> {
    word.parse().ok().filter(|number: &f64| number.is_finite())
}

/// Exactly so many numbers of millimetres.
fn metres<const N: usize>(line: &str) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    let mut words = line.split_ascii_whitespace();
    for place in &mut numbers {
        *place = number(words.next()?)? / 1e3;
    }
    words.next().is_none().then_some(numbers)
}

fn error(line: usize, found: &str, expected: &str) -> TextError {
    TextError { line, found: crate::text::quoted(found), expected: expected.to_owned() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WORLD: &str = "2D-Map-Ex2\nMinPos: 9 9\nNumLines: 900\nMapInfo: GoalType Name=Goal \"Label=a: b\"\nResolution: 50\n\
        Cairn: RobotHome 1000 -500 90 \"\" ICON \"Home\"\n\
        Cairn: Goal 1 2 0 \"\" ICON \"Goal 1\"\nCairn: GoalWithHeading 1 2 180.0 \"\" ICON \"A door\"\n\
        Cairn: ForbiddenLine 0 0 0 \"\" ICON \"\" 1000 2000 3000 4000\n\
        Cairn: ForbiddenArea 0 0 90 \"\" ICON \"\" 0 0 2000 1000\nCairn: Label 1 2 0 \"\" ICON \"x\"\n\n\
        LINES\n0 0 1000 0\n\n-20 5 30 40\nDATA\n7 8\nLMS_LINES\n1 1 2 2\nLMS_DATA\r\n3000 4000\r\n";

    #[test]
    fn all_of_it() {
        let parts = parse(WORLD).unwrap();
        let line = |x1, y1, x2, y2| Segment { from: [x1, y1], to: [x2, y2] };
        assert_eq!(
            parts.walls,
            [line(0.0, 0.0, 1.0, 0.0), line(-0.02, 0.005, 0.03, 0.04), line(0.001, 0.001, 0.002, 0.002)]
        );
        assert_eq!(parts.points, [[0.007, 0.008], [3.0, 4.0]]);
        assert_eq!(parts.point_radius_m, 0.025);
        let places = &parts.places;
        assert_eq!(places.home, Some(Pose2::new(1.0, -0.5, core::f64::consts::FRAC_PI_2)));
        let goals: Vec<_> = places.goals.iter().map(|goal| (goal.name.as_str(), goal.has_heading)).collect();
        assert_eq!(goals, [("Goal 1", false), ("A door", true)]);
        assert_eq!(places.forbidden.len(), 5);
        assert_eq!(places.forbidden[0], line(1.0, 2.0, 3.0, 4.0));
        // Turned by a quarter about the origin.
        let far = places.forbidden[2].to;
        assert!((far[0] + 1.0).abs() < 1e-12 && (far[1] - 2.0).abs() < 1e-12, "{far:?}");
    }

    #[test]
    fn errors_name_line_value_and_expectation() {
        let check = |from: &str, to: &str, expected: &str| {
            let error = parse(&WORLD.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check("2D-Map-Ex2", "3D-Map", "line 1: \"3D-Map\"; expected 2D-Map");
        check("0 0 1000 0\n", "0 0 1000\n", "line 14: \"0 0 1000\"; expected four numbers");
        check("0 0 1000 0\n", "0 0 1000 0 0\n", "line 14");
        check("0 0 1000 0\n", "0 0 1000 inf\n", "line 14");
        check("7 8", "7", "line 18: \"7\"; expected two numbers x y, millimetres");
        check("1000 2000 3000 4000", "1000 2000 3000", "line 9");
        check("RobotHome 1000", "RobotHome", "expected `Cairn: Type x y theta");
        check("MinPos: 9 9", "MinPos 9 9", "line 2: \"MinPos 9 9\"; expected `Key: value`");
        check("Resolution: 50", "Resolution: -1", "from 1 to 1000");
        assert_eq!(parse("").unwrap_err().line, 1);
    }

    proptest! {
        #[test]
        fn any_text_is_survived(text in "(2D-Map|LINES|DATA|Cairn: |ForbiddenArea|ICON|\"|:| |-?[0-9]{1,3}|\n|\\PC){0,60}") {
            let _ = parse(&text);
            let _ = parse(&format!("2D-Map\n{text}"));
        }
    }
}
