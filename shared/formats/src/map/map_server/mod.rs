//! Maps of ROS's map_server and Nav2: an image and a YAML file that says how to read it.
//!
//! A pixel's darkness is its occupancy, 0 to 1 (`negate: 1` turns that round); the first row of
//! the image has the highest y. What the darkness means depends on the mode:
//!
//! | mode | read as | written as |
//! |---|---|---|
//! | `trinary` | above `occupied_thresh` occupied (1), below `free_thresh` free (0), else unknown | PGM: 0 occupied, 254 free, 205 unknown; with other [`Thresholds`] than the usual another level may stand for unknown, one that lies between them |
//! | `scale` | not opaque: unknown; else a probability, linear between the thresholds | PNG with transparent unknown cells, always with thresholds 0 and 1: a PGM can't say unknown in this mode |
//! | `raw` | level 0 to 100: percent; else unknown | PGM: 0 to 100, 255 unknown; the thresholds are written, but no reader of this mode asks them |
//!
//! So unknown stays unknown in every mode. `trinary` (the default, which every reader knows) loses
//! the probability: a known cell between the thresholds becomes unknown. `raw` and `scale` keep it
//! to 1 % and 0.4 %.

mod entries;
mod read;
mod write;
mod yaml;

pub use read::{read, read_image};
pub use write::{Thresholds, encode_image, write};
pub(crate) use write::{array_yaml, files, image_name};
pub use yaml::{MapMode, MapYaml, YamlError};

/// Longest side of an image, pixels.
pub const SIDE_MAX: u32 = 32_768;
