//! The tables of a robot file.

use super::super::robot::{RawFootprint, RawLidar, RawSonar, RawSonars, RawTop};
use super::{Key, NOTHING, key};
use super::{Section, Text, defaults, number, probe, text};

/// The top of the file.
pub(crate) static ROBOT: Section = Section {
    name: "",
    about: "a robot",
    keys: &[text("name", Text::Plain, "a name: 1 to 40 letters, digits, blanks, `_`, `-` or `.`", "its name")],
    probe: probe::<RawTop>,
    defaults: defaults::<RawTop>,
    refuses: NOTHING,
};

/// `[footprint]`.
pub(crate) static FOOTPRINT: Section = Section {
    name: "footprint",
    about: "the rectangle that it covers on the floor, centred on its base",
    keys: &[
        number("length_m", "a number of metres from 0 to 10", 0.0..=10.0, "along x"),
        number("width_m", "a number of metres from 0 to 10", 0.0..=10.0, "along y"),
    ],
    probe: probe::<RawFootprint>,
    defaults: defaults::<RawFootprint>,
    refuses: NOTHING,
};

const X: Key = number("x_m", "a number of metres from -10 to 10", -10.0..=10.0, "forward of the base");
const Y: Key = number("y_m", "a number of metres from -10 to 10", -10.0..=10.0, "left of the base");
const HEADING: Key =
    number("heading_deg", "a number of degrees from -360 to 360", -360.0..=360.0, "counter-clockwise from forward");
const RANGE_MIN: Key =
    number("range_min_m", "a number of metres from 0 to 1000", 0.0..=1000.0, "the nearest range it can measure");
const RANGE_MAX: Key =
    number("range_max_m", "a number of metres from 0.01 to 1000", 0.01..=1000.0, "as far as it can see at all");
const RANGE_ERROR: Key =
    number("range_error_ratio", "a share of the range from 0 to 1", 0.0..=1.0, "range error as a share of the range");

/// `[[sonar]]`.
pub(crate) static SONAR: Section = Section {
    name: "sonar",
    about: "where a sonar sits",
    keys: &[X, Y, HEADING],
    probe: probe::<RawSonar>,
    defaults: defaults::<RawSonar>,
    refuses: NOTHING,
};

/// `[sonars]`.
pub(crate) static SONARS: Section = Section {
    name: "sonars",
    about: "what all sonars have in common",
    keys: &[
        number("aperture_deg", "a number of degrees from 0.1 to 180", 0.1..=180.0, "the whole cone"),
        RANGE_MIN,
        RANGE_MAX,
        RANGE_ERROR,
    ],
    probe: probe::<RawSonars>,
    defaults: defaults::<RawSonars>,
    refuses: NOTHING,
};

/// `[lidar]`.
pub(crate) static LIDAR: Section = Section {
    name: "lidar",
    about: "a laser range finder",
    keys: &[
        X,
        Y,
        HEADING,
        Key { within: Some((2.0, 10_000.0)), ..key("beams", "a whole number from 2 to 10000", "beams of a scan") },
        number(
            "first_bearing_deg",
            "a number of degrees from -360 to 360",
            -360.0..=360.0,
            "of the first beam, from the heading of the lidar",
        ),
        number(
            "field_of_view_deg",
            "a number of degrees from 0.01 to 360",
            0.01..=360.0,
            "from the first beam to the last, counter-clockwise",
        ),
        RANGE_MIN,
        RANGE_MAX,
        RANGE_ERROR,
    ],
    probe: probe::<RawLidar>,
    defaults: defaults::<RawLidar>,
    refuses: NOTHING,
};
