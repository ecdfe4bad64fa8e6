//! What travels between the service and the page: everything that is sent, and everything that is understood.
//!
//! `docs/live.md` describes it. Numbers that are many go as binary messages, little-endian; all else is JSON, one object per message,
//! told apart by its `type`.

use echogrid_core::{Fix, Pose2, TileIndex};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::trail::TrailPoint;

/// The version of what is described here; the page reloads itself when it is another's.
pub const VERSION: u32 = 1;
/// The longest message of a viewer, bytes.
pub const MESSAGE_MAX: usize = 4 << 10;
/// Cells of a tile.
pub(crate) const CELLS: usize = 64 * 64;

/// First byte of a binary message.
const TILES: u8 = 1;
const TRAIL: u8 = 2;
const BEAMS: u8 = 3;

/// What is drawn of the cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Layer {
    /// How probably each cell is occupied.
    Occupancy,
    /// How much odometry error its evidence carried.
    Doubt,
    /// What one sonar alone says.
    Sonar(u16),
}

impl Layer {
    fn codes(self) -> (u8, u16) {
        match self {
            Self::Occupancy => (0, 0),
            Self::Sonar(sonar) => (1, sonar),
            Self::Doubt => (2, 0),
        }
    }
}

/// The cells of a tile as they are drawn: a level each, and whether it is known.
#[derive(Debug, Clone)]
pub struct Levels {
    known: [u8; CELLS / 8],
    levels: [u8; CELLS],
}

impl Levels {
    /// The cells of a tile from the level of each; none: unknown.
    pub fn of(level: impl Fn(usize) -> Option<u8>) -> Self {
        let mut tile = Self { known: [0; CELLS / 8], levels: [0; CELLS] };
        for cell in 0..CELLS {
            if let Some(level) = level(cell) {
                tile.known[cell / 8] |= 1 << (cell % 8);
                tile.levels[cell] = level;
            }
        }
        tile
    }
}

/// Tiles of one layer, as one message.
#[must_use]
pub fn tiles(layer: Layer, tiles: &[(TileIndex, &Levels)]) -> Vec<u8> {
    let (kind, sonar) = layer.codes();
    let mut bytes = Vec::with_capacity(8 + tiles.len() * (8 + CELLS / 8 + CELLS));
    bytes.extend([TILES, kind]);
    bytes.extend(sonar.to_le_bytes());
    bytes.extend((tiles.len() as u32).to_le_bytes());
    for (index, levels) in tiles {
        bytes.extend(index.x.to_le_bytes());
        bytes.extend(index.y.to_le_bytes());
        bytes.extend(levels.known);
        bytes.extend(levels.levels);
    }
    bytes
}

/// Points of the trail from `start` on, as one message; `generation` differs from the last one where all before is void.
pub(crate) fn trail(generation: u32, start: usize, points: &[TrailPoint]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(12 + points.len() * 24);
    bytes.extend([TRAIL, 0, 0, 0]);
    bytes.extend(generation.to_le_bytes());
    bytes.extend((start as u32).to_le_bytes());
    for TrailPoint { stamp_ns, pose, trust } in points {
        bytes.extend((*stamp_ns as f64 * 1e-9).to_le_bytes());
        for number in [pose.x, pose.y, pose.theta, *trust] {
            bytes.extend((number as f32).to_le_bytes());
        }
    }
    bytes
}

/// A reading as it is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Beam {
    /// The x of the transducer, metres, map frame.
    pub x: f32,
    /// The y of the transducer, metres, map frame.
    pub y: f32,
    /// Where it looked, radians, map frame.
    pub angle_rad: f32,
    /// What it heard, metres; without an echo how far it can hear.
    pub range_m: f32,
    /// The full angle of its cone; 0: a ray.
    pub aperture_rad: f32,
    /// The number of the transducer.
    pub transducer: u16,
    /// What became of it (`echogrid_core::Verdict`).
    pub verdict: u8,
    /// 0 a hit, 1 no echo, 2 invalid.
    pub echo: u8,
}

/// The readings of a scan, as one message.
#[must_use]
pub fn beams(stamp_ns: u64, beams: &[Beam]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(16 + beams.len() * 24);
    bytes.extend([BEAMS, 0, 0, 0]);
    bytes.extend((beams.len() as u32).to_le_bytes());
    bytes.extend((stamp_ns as f64 * 1e-9).to_le_bytes());
    for beam in beams {
        for number in [beam.x, beam.y, beam.angle_rad, beam.range_m, beam.aperture_rad] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(beam.transducer.to_le_bytes());
        bytes.extend([beam.verdict, beam.echo]);
    }
    bytes
}

/// What is told as JSON.
#[derive(Debug, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Told<'a> {
    /// First of all, and again when the graph was made anew: all before is void.
    Hello {
        /// [`VERSION`].
        protocol: u32,
        /// The domain of the graph.
        domain: &'a str,
        /// What the run is about.
        facts: &'a Value,
    },
    /// The robot, as the odometry says last.
    Pose(&'a Value),
    /// The map in numbers, as the mapper says last.
    Map(&'a Value),
    /// How every process is doing.
    Health(&'a Value),
    /// Lines that were logged since the last such message.
    Log {
        /// In the order in which they came.
        lines: &'a [LogLine],
    },
    /// Which layers there are.
    Layers {
        /// Whether the doubt is kept.
        doubt: bool,
        /// The sonars that have a map of their own.
        sonars: &'a [u16],
    },
    /// The answer to an order of this viewer.
    Answer {
        /// The order's own number.
        id: u64,
        /// Whether it was carried out.
        ok: bool,
        /// What was done, or why not.
        text: &'a str,
        /// What is known of the cell, where the order was `why`.
        #[serde(skip_serializing_if = "Option::is_none")]
        why: Option<&'a Value>,
    },
    /// The graph is over; nothing more will come.
    Ended,
}

impl Told<'_> {
    /// The message as it travels, JSON.
    #[must_use]
    pub fn text(&self) -> String {
        // Values and plain fields: nothing in it can fail.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// A line of the log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LogLine {
    /// The number of the line: 1, 2, 3 …
    pub id: u64,
    /// Seconds since 1970.
    pub time_s: f64,
    /// The service that says it.
    pub service: String,
    /// `info`, `warn` or `error`.
    pub level: &'static str,
    /// What the service says.
    pub text: String,
}

/// What a viewer can say.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Said {
    /// Save the map now.
    Save {
        /// Names the order in its answer.
        id: u64,
    },
    /// Map nothing until told to resume.
    Pause {
        /// Names the order in its answer.
        id: u64,
    },
    /// Go on mapping.
    Resume {
        /// Names the order in its answer.
        id: u64,
    },
    /// The robot is here now.
    Fix {
        /// Names the order in its answer.
        id: u64,
        /// Metres, map frame.
        x: f64,
        /// Metres, map frame.
        y: f64,
        /// Heading, radians.
        theta: f64,
        /// Standard deviation along each axis, metres.
        sigma_m: f64,
        /// Standard deviation of the heading, radians.
        sigma_rad: f64,
    },
    /// Why is the cell at this place what it is?
    Why {
        /// Names the order in its answer.
        id: u64,
        /// Metres, map frame.
        x: f64,
        /// Metres, map frame.
        y: f64,
    },
    /// This layer is shown now.
    Layer {
        /// `occupancy`, `doubt` or `sonar`.
        layer: LayerWord,
        /// Which sonar.
        #[serde(default)]
        sonar: u16,
    },
}

/// A layer as it is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LayerWord {
    /// [`Layer::Occupancy`].
    Occupancy,
    /// [`Layer::Doubt`].
    Doubt,
    /// [`Layer::Sonar`].
    Sonar,
}

impl Said {
    /// What a message of a viewer says.
    ///
    /// # Errors
    /// Why it is not understood, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let said: Self = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let numbers = match said {
            Self::Fix { x, y, theta, sigma_m, sigma_rad, .. } => {
                // Squared, a sign would be lost.
                if !(sigma_m >= 0.0 && sigma_rad >= 0.0) {
                    return Err(format!("sigma_m = {sigma_m}, sigma_rad = {sigma_rad}: expected 0 or more"));
                }
                let fix = Fix::about(Pose2 { x, y, theta }, sigma_m, sigma_rad);
                return fix.validate().map(|()| said).map_err(|error| format!("a robot can't be there: {error}"));
            }
            Self::Why { x, y, .. } => [x, y],
            _ => [0.0; 2],
        };
        let is_place = numbers.iter().all(|number| number.abs() <= echogrid_core::POSITION_MAX_M);
        if is_place { Ok(said) } else { Err(format!("({}, {}) is no place: expected metres", numbers[0], numbers[1])) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_hold_a_bit_for_whether_and_a_byte_for_how_much() {
        let levels = Levels::of(|cell| (cell % 3 == 0).then_some(cell as u8));
        let bytes = tiles(Layer::Sonar(0x0102), &[(TileIndex { x: -1, y: 2 }, &levels)]);
        assert_eq!(bytes.len(), 8 + 8 + 512 + 4096);
        assert_eq!(bytes[..16], [1, 1, 2, 1, 1, 0, 0, 0, 255, 255, 255, 255, 2, 0, 0, 0]);
        assert_eq!(bytes[16], 0b0100_1001);
        assert_eq!(bytes[16 + 512..][..7], [0, 0, 0, 3, 0, 0, 6]);
    }

    #[test]
    fn orders_are_understood_and_what_is_none_is_told() {
        assert_eq!(Said::parse(r#"{"do":"save","id":7}"#), Ok(Said::Save { id: 7 }));
        let layer = Said::Layer { layer: LayerWord::Sonar, sonar: 3 };
        assert_eq!(Said::parse(r#"{"do":"layer","layer":"sonar","sonar":3}"#), Ok(layer));
        let fix = r#"{"do":"fix","id":1,"x":1,"y":2,"theta":0.5,"sigma_m":0.2,"sigma_rad":0.1}"#;
        assert!(matches!(Said::parse(fix), Ok(Said::Fix { id: 1, .. })));
        for wrong in ["", "{}", r#"{"do":"halt","id":1}"#, r#"{"do":"save"}"#, r#"{"do":"save","id":1,"x":2}"#, "[]"] {
            assert!(Said::parse(wrong).is_err(), "{wrong}");
        }
        for nowhere in
            [r#"{"do":"why","id":1,"x":1e9,"y":0}"#, &fix.replace("0.2", "-0.2"), &fix.replace("\"x\":1", "\"x\":1e40")]
        {
            assert!(Said::parse(nowhere).is_err(), "{nowhere}");
        }
    }
}
