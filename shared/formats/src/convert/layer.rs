//! A layer of a native map, as a picture or an array.

use std::path::Path;

use super::{ConvertError, ConvertReport, Given, extension, kind_of, refuse_same};
use crate::map::{doubt, facing, native};
use crate::near::near_word;
use crate::whole_file::write_whole;

/// What a map may hold of each cell besides its log-odds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MapLayer {
    /// How much odometry error is in its evidence, metres.
    Doubt,
    /// Which way its wall faces, radians.
    Facing,
}

impl MapLayer {
    /// The name of the layer, which is that of the key of `[mapper]` that keeps it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Doubt => "doubt",
            Self::Facing => "facing",
        }
    }
}

/// Writes a layer of a native map as `.png` or `.npy`, whole or not at all.
///
/// # Errors
/// The input is no native map or lacks the layer, the output is of another kind, or can't be written.
pub fn convert_layer(input: &Path, output: &Path, layer: MapLayer) -> Result<ConvertReport, ConvertError> {
    let (kind, extension) = (kind_of(input)?, extension(output));
    if kind != Given::NativeMap {
        return Err(ConvertError::NoLayers { path: input.to_path_buf(), input: kind.name() });
    }
    refuse_same(input, output)?;
    let document = native::read(input)?;
    let held = match layer {
        MapLayer::Doubt => &document.doubt,
        MapLayer::Facing => &document.facing,
    };
    let Some(held) = held else {
        return Err(ConvertError::LayerMissing { path: input.to_path_buf(), layer: layer.name() });
    };
    let bytes = match (extension.as_str(), layer) {
        ("png", MapLayer::Doubt) => doubt::encode_picture(held, &document.grid)?,
        ("png", MapLayer::Facing) => facing::encode_picture(held, &document.grid)?,
        ("npy", _) => crate::map::layer::encode_array(held, &document.grid)?,
        _ => {
            return Err(ConvertError::Impossible {
                path: input.to_path_buf(),
                input: "a layer of a native map",
                output: output.to_path_buf(),
                possible: ".png, .npy",
                near: near_word(&extension, ["png", "npy"]),
            });
        }
    };
    write_whole(output, &bytes)?;
    Ok(ConvertReport {
        input: format!("the {} of {}", layer.name(), Given::NativeMap.name()),
        written: vec![output.to_path_buf()],
        lost: Vec::new(),
        remarks: Vec::new(),
    })
}
