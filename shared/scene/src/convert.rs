//! echogrid's values as messages of Foxglove's well-known schemas.

use echogrid_core::{CellIndex, Pose2, Verdict};
use echogrid_formats::map::picture;
use echogrid_service::placed::Placed;
use foxglove::messages::line_primitive::Type as LineType;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    Color, Grid, LinePrimitive, PackedElementField, Point3, Pose, Quaternion, Timestamp, Vector2, Vector3,
};

/// The frames.
pub(crate) const MAP: &str = "map";
pub(crate) const BASE: &str = "base";

/// Bytes of a cell: red, green, blue, alpha; probability as f32.
const CELL: u32 = 8;

pub(crate) fn timestamp(stamp_ns: u64) -> Option<Timestamp> {
    let seconds = u32::try_from(stamp_ns / 1_000_000_000).ok()?;
    Timestamp::new_checked(seconds, (stamp_ns % 1_000_000_000) as u32)
}

pub(crate) fn pose(pose: Pose2) -> Pose {
    let half = 0.5 * pose.theta;
    Pose {
        position: Some(Vector3 { x: pose.x, y: pose.y, z: 0.0 }),
        orientation: Some(Quaternion { x: 0.0, y: 0.0, z: half.sin(), w: half.cos() }),
    }
}

/// A rectangle of cells, its lowest one `low`; `log_odds(column, row)`, NaN: unknown, which is transparent and has no probability.
pub(crate) fn grid(
    stamp_ns: u64,
    resolution_m: f64,
    low: CellIndex,
    [columns, rows]: [u32; 2],
    log_odds: impl Fn(u32, u32) -> f32,
) -> Grid {
    let mut data = Vec::with_capacity((columns * rows * CELL) as usize);
    for row in 0..rows {
        for column in 0..columns {
            let log_odds = log_odds(column, row);
            let colour = picture::level(log_odds).map_or([0; 4], |level| [level, level, level, 255]);
            data.extend(colour);
            data.extend((1.0 / (1.0 + (-log_odds).exp())).to_le_bytes());
        }
    }
    let field = |name: &str, offset, numeric_type: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: numeric_type as i32,
    };
    let corner = Pose2::new(f64::from(low.i) * resolution_m, f64::from(low.j) * resolution_m, 0.0);
    Grid {
        timestamp: timestamp(stamp_ns),
        frame_id: MAP.to_owned(),
        pose: Some(pose(corner)),
        column_count: columns,
        cell_size: Some(Vector2 { x: resolution_m, y: resolution_m }),
        row_stride: columns * CELL,
        cell_stride: CELL,
        fields: vec![
            field("red", 0, NumericType::Uint8),
            field("green", 1, NumericType::Uint8),
            field("blue", 2, NumericType::Uint8),
            field("alpha", 3, NumericType::Uint8),
            field("probability", 4, NumericType::Float32),
        ],
        data: data.into(),
    }
}

pub(crate) fn colour([r, g, b]: [u8; 3], a: f64) -> Option<Color> {
    let of = |byte| f64::from(byte) / 255.0;
    Some(Color { r: of(r), g: of(g), b: of(b), a })
}

pub(crate) fn point([x, y]: [f64; 2], z: f64) -> Point3 {
    Point3 { x, y, z }
}

pub(crate) fn line(kind: LineType, thickness: f64, points: Vec<Point3>, colour: Option<Color>) -> LinePrimitive {
    LinePrimitive {
        r#type: kind as i32,
        pose: Some(pose(Pose2::default())),
        thickness,
        scale_invariant: false,
        points,
        color: colour,
        colors: Vec::new(),
        indices: Vec::new(),
    }
}

/// A ray, or the outline of a cone, where it was heard.
pub(crate) fn outline(placed: &Placed) -> Vec<[f64; 2]> {
    let Pose2 { x, y, theta } = placed.map_from_transducer;
    let end =
        |bearing: f64| [x + placed.range_m * (theta + bearing).cos(), y + placed.range_m * (theta + bearing).sin()];
    if placed.aperture_rad < 0.04 {
        return vec![[x, y], end(0.0)];
    }
    let arc = (0..=8).map(|step| end(placed.aperture_rad * (f64::from(step) / 8.0 - 0.5)));
    [[x, y]].into_iter().chain(arc).chain([[x, y]]).collect()
}

/// As on the live page.
pub(crate) fn colour_of(verdict: Verdict) -> [u8; 3] {
    match verdict {
        Verdict::Accepted => [11, 154, 104],
        Verdict::NoEcho => [77, 157, 224],
        Verdict::Untrusted => [215, 154, 0],
        Verdict::Held => [146, 119, 230],
        Verdict::Stuck | Verdict::Lone => [224, 100, 30],
        Verdict::MultipleReflection => [224, 49, 49],
        _ => [143, 160, 179],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_has_a_colour_and_a_probability_per_cell_and_nothing_where_it_knows_nothing() {
        let grid =
            grid(
                1_500_000_000,
                0.05,
                CellIndex { i: -20, j: 40 },
                [2, 1],
                |column, _| if column == 0 { 0.0 } else { f32::NAN },
            );
        assert_eq!((grid.column_count, grid.row_stride, grid.data.len()), (2, 16, 16));
        assert_eq!(grid.data[..4], [128, 128, 128, 255]);
        assert_eq!(grid.data[4..8], 0.5_f32.to_le_bytes());
        assert_eq!(grid.data[8..12], [0; 4]);
        assert!(f32::from_le_bytes(grid.data[12..16].try_into().unwrap()).is_nan());
        let corner = grid.pose.unwrap().position.unwrap();
        assert!((corner.x + 1.0).abs() < 1e-12 && (corner.y - 2.0).abs() < 1e-12);
    }
}
