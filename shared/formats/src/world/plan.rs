//! echogrid's own worlds: `.toml`, metres.
//!
//! ```toml
//! [home]                  # where a robot starts
//! at = [1.0, 6.0]
//! heading_deg = 0         # counter-clockwise from x; may be left out
//!
//! [[wall]]                # seen from both sides
//! from = [0.0, 5.0]
//! to = [22.0, 5.0]
//!
//! [[door]]                # an opening in the wall that it lies on
//! at = [3.0, 5.0]
//! width = 1.2
//!
//! [[box]]                 # four walls; `at` is the corner of lowest x and y
//! at = [0.2, 1.0]
//! size = [0.6, 2.0]
//!
//! [[goal]]
//! name = "Kitchen"
//! at = [4.5, 1.5]         # and heading_deg, if it is part of the goal
//!
//! [[forbidden]]           # a line not to cross, though nothing is there to see
//! from = [0.0, 0.0]
//! to = [1.0, 0.0]
//!
//! [[person]]              # walks to and fro; only a simulator sees them
//! path = [[2.0, 6.0], [20.0, 6.0]]
//! speed_mps = 0.8
//! radius_m = 0.25
//! ```

use echogrid_core::Pose2;
use echogrid_core::world::{Goal, Person, Segment, WorldParts};

use super::TextError;
use crate::tables::{self, Item, PLACE, Schema};

/// A door lies on a wall that is no farther from it than this, metres.
const DOOR_REACH_M: f64 = 0.05;

const SCHEMA: Schema = Schema {
    tables: &[
        ("home", &["at", "heading_deg?"]),
        ("wall", &["from", "to"]),
        ("door", &["at", "width"]),
        ("box", &["at", "size"]),
        ("goal", &["name", "at", "heading_deg?"]),
        ("forbidden", &["from", "to"]),
        ("person", &["path", "speed_mps", "radius_m"]),
    ],
    single: Some("home"),
};

/// Reads a world of echogrid's own.
///
/// # Errors
/// When the text is no TOML, a key is unknown, missing, or has an impossible value.
pub fn parse(text: &str) -> Result<WorldParts, TextError> {
    let document = tables::parse(text)?;
    let items = tables::items(text, &document, &SCHEMA)?;
    let all = |table: &str| items.get(table).map(Vec::as_slice).unwrap_or_default();
    let mut parts = WorldParts::default();
    for home in all("home") {
        parts.places.home = Some(pose(home)?);
    }
    let walls: Vec<Segment> = all("wall").iter().map(segment).collect::<Result<_, _>>()?;
    parts.walls = with_doors(&walls, all("door"))?;
    for item in all("box") {
        let ([x, y], [width, height]) = (item.pair("at", PLACE)?, item.pair("size", SIZE)?);
        if !(width > 0.0 && height > 0.0) {
            return Err(item.wrong("size", SIZE));
        }
        let [a, b, c, d] = [[x, y], [x + width, y], [x + width, y + height], [x, y + height]];
        parts.walls.extend([(a, b), (b, c), (c, d), (d, a)].map(|(from, to)| Segment { from, to }));
    }
    for item in all("goal") {
        let has_heading = item.has("heading_deg");
        parts.places.goals.push(Goal { name: item.text("name")?, pose: pose(item)?, has_heading });
    }
    parts.places.forbidden = all("forbidden").iter().map(segment).collect::<Result<_, _>>()?;
    parts.people = all("person").iter().map(person).collect::<Result<_, _>>()?;
    Ok(parts)
}

const SIZE: &str = "[width, height], metres above 0";
const WIDTH: &str = "metres above 0";
const PATH: &str = "[[x, y], [x, y]], metres, two places or more that are not all the same";
const SPEED: &str = "metres per second from 0 to 10";
const RADIUS: &str = "metres from 0.01 to 2";

/// Walls with openings where doors are.
fn with_doors(walls: &[Segment], doors: &[Item<'_>]) -> Result<Vec<Segment>, TextError> {
    // From where to where along each wall.
    let mut openings: Vec<Vec<(f64, f64)>> = vec![Vec::new(); walls.len()];
    for door in doors {
        let at = door.pair("at", PLACE)?;
        let width =
            door.number("width", WIDTH)?.filter(|width| *width > 0.0).ok_or_else(|| door.wrong("width", WIDTH))?;
        let places = walls.iter().enumerate().filter_map(|(index, wall)| {
            let (along, length, aside) = place_on(*wall, at)?;
            // Room for the door, but for rounding.
            let room = along - width / 2.0 >= -1e-9 && along + width / 2.0 <= length + 1e-9;
            (aside <= DOOR_REACH_M && room).then_some((aside, index, along))
        });
        let nearest = places.min_by(|a, b| a.0.total_cmp(&b.0));
        let (_, index, along) = nearest.ok_or_else(|| door.wrong("at", "a place on a wall with room for the door"))?;
        openings[index].push((along - width / 2.0, along + width / 2.0));
    }
    let mut pieces = Vec::with_capacity(walls.len() + doors.len());
    for (wall, mut openings) in walls.iter().zip(openings) {
        openings.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (dx, dy) = (wall.to[0] - wall.from[0], wall.to[1] - wall.from[1]);
        let length = libm::hypot(dx, dy);
        let at = |along: f64| [wall.from[0] + dx / length * along, wall.from[1] + dy / length * along];
        let mut from = (0.0, wall.from);
        for (start, end) in openings {
            if start > from.0 {
                pieces.push(Segment { from: from.1, to: at(start) });
            }
            if end > from.0 {
                from = (end, at(end));
            }
        }
        if from.0 < length || length == 0.0 {
            pieces.push(Segment { from: from.1, to: wall.to });
        }
    }
    Ok(pieces)
}

/// How far along a wall a point is, how long the wall, how far off it the point; none for a wall of no length.
fn place_on(Segment { from, to }: Segment, at: [f64; 2]) -> Option<(f64, f64, f64)> {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length = libm::hypot(dx, dy);
    let (x, y) = (at[0] - from[0], at[1] - from[1]);
    (length > 0.0).then(|| ((x * dx + y * dy) / length, length, ((x * dy - y * dx) / length).abs()))
}

fn segment(item: &Item<'_>) -> Result<Segment, TextError> {
    Ok(Segment { from: item.pair("from", PLACE)?, to: item.pair("to", PLACE)? })
}

fn pose(item: &Item<'_>) -> Result<Pose2, TextError> {
    let [x, y] = item.pair("at", PLACE)?;
    let degrees = item.number("heading_deg", "degrees")?.unwrap_or(0.0);
    Ok(Pose2::new(x, y, degrees * core::f64::consts::PI / 180.0))
}

fn person(item: &Item<'_>) -> Result<Person, TextError> {
    let within = |key: &str, least: f64, most: f64, expected: &'static str| {
        let value = item.number(key, expected)?.filter(|value| (least..=most).contains(value));
        value.ok_or_else(|| item.wrong(key, expected))
    };
    let path = item.pairs("path", PATH)?;
    if path.len() < 2 || path.iter().all(|place| *place == path[0]) {
        return Err(item.wrong("path", PATH));
    }
    let speed_mps = within("speed_mps", 0.0, 10.0, SPEED)?;
    Ok(Person { path, speed_mps, radius_m: within("radius_m", 0.01, 2.0, RADIUS)? })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WORLD: &str = "[home]\nat = [1.0, 6]\nheading_deg = 90\n\n[[wall]]\nfrom = [0.0, 5.0]\nto = [22.0, 5.0]\n\n\
        [[door]]\nat = [10.0, 5.0]\nwidth = 1.2\n\n[[door]]\nat = [3.0, 5.0]\nwidth = 1.2\n\n\
        [[box]]\nat = [1.0, 1.0]\nsize = [2.0, 0.5]\n\n[[goal]]\nname = \"Kitchen\"\nat = [4.5, 1.5]\n\n\
        [[forbidden]]\nfrom = [0, 0]\nto = [1, 0]\n\n\
        [[person]]\npath = [[2, 6], [20, 6.5]]\nspeed_mps = 0.8\nradius_m = 0.25\n";

    #[test]
    fn all_of_it() {
        let parts = parse(WORLD).unwrap();
        let line = |x1, y1, x2, y2| Segment { from: [x1, y1], to: [x2, y2] };
        assert_eq!(parts.walls[..3], [line(0.0, 5.0, 2.4, 5.0), line(3.6, 5.0, 9.4, 5.0), line(10.6, 5.0, 22.0, 5.0)]);
        assert_eq!(parts.walls[3], line(1.0, 1.0, 3.0, 1.0));
        assert_eq!(parts.walls.len(), 7);
        assert_eq!(parts.places.home, Some(Pose2::new(1.0, 6.0, core::f64::consts::FRAC_PI_2)));
        assert_eq!((parts.places.goals[0].name.as_str(), parts.places.goals[0].has_heading), ("Kitchen", false));
        assert_eq!(parts.places.forbidden, [line(0.0, 0.0, 1.0, 0.0)]);
        let person = Person { path: vec![[2.0, 6.0], [20.0, 6.5]], speed_mps: 0.8, radius_m: 0.25 };
        assert_eq!(parts.people, [person]);
    }

    #[test]
    fn errors_name_line_value_and_expectation() {
        let check = |from: &str, to: &str, expected: &str| {
            let error = parse(&WORLD.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        check(
            "[[wall]]",
            "[[wal]]",
            "line 5: unknown table \"wal\"; expected home, wall, door, box, goal, forbidden, person; did you mean wall?",
        );
        check("from =", "form =", "line 6: unknown key \"form\"; expected from, to; did you mean from?");
        check("to = [22.0, 5.0]", "to = [22.0]", "line 7: to of wall is [22.0]; expected [x, y], metres");
        check("to = [22.0, 5.0]", "to = [22.0, nan]", "line 7");
        check("to = [22.0, 5.0]", "to = \"right\"", "line 7: to of wall is \"right\"");
        check("to = [22.0, 5.0]", "", "line 5: a wall without to; expected wall with from, to");
        check("at = [10.0, 5.0]", "at = [10.0, 6.0]", "line 10: at of door is [10.0, 6.0]; expected a place on a wall");
        check("at = [10.0, 5.0]", "at = [0.1, 5.0]", "room for the door");
        check("width = 1.2", "width = 0", "line 11: width of door is 0; expected metres above 0");
        check("size = [2.0, 0.5]", "size = [2.0, -0.5]", "line 19: size of box is [2.0, -0.5]");
        check("\"Kitchen\"", "7", "a text in quotes");
        check("[home]", "[[home]]", "expected one table [home]");
        check("[[wall]]", "[wall]", "expected tables [[wall]]");
        check("[[wall]]", "[[wall]", "expected TOML");
        check("path = [[2, 6], [20, 6.5]]", "path = [[2, 6]]", "path of person is [[2, 6]]; expected [[x, y], [x, y]]");
        check("[20, 6.5]", "[2, 6]", "two places or more that are not all the same");
        check("[20, 6.5]", "[20, inf]", "path of person is");
        check(
            "speed_mps = 0.8",
            "speed_mps = -1",
            "speed_mps of person is -1; expected metres per second from 0 to 10",
        );
        check("radius_m = 0.25", "radius_m = \"big\"", "radius_m of person is \"big\"; expected metres from 0.01 to 2");
        check("radius_m = 0.25", "", "a person without radius_m");
        check("heading_deg = 90", "heading_deg = true", "line 3: heading_deg of home is true; expected degrees");
    }

    #[test]
    fn doors_may_meet_and_overlap() {
        let doors = |places: &[(f64, f64)]| {
            let doors: String =
                places.iter().map(|(x, width)| format!("[[door]]\nat = [{x}, 0]\nwidth = {width}\n")).collect();
            parse(&format!("[[wall]]\nfrom = [0, 0]\nto = [4, 0]\n{doors}")).unwrap().walls.len()
        };
        assert_eq!(doors(&[]), 1);
        assert_eq!(doors(&[(0.5, 1.0)]), 1);
        assert_eq!(doors(&[(2.0, 4.0)]), 0);
        assert_eq!(doors(&[(1.0, 1.0), (1.2, 1.0), (3.0, 0.5)]), 3);
    }

    proptest! {
        #[test]
        fn any_text_is_survived(text in "(\\[\\[wall\\]\\]|\\[home\\]|\\[\\[door\\]\\]|from|to|at|width| = |\\[|\\]|,|\"|-?[0-9]{1,3}|\n|\\PC){0,60}") {
            let _ = parse(&text);
        }
    }
}
