//! `echogrid walls`.

use std::fmt;
use std::path::Path;

use anyhow::Result;
use echogrid_formats::map::{native, picture};
use echogrid_judge::Walls;
use serde::Serialize;

/// What was found.
#[derive(Debug, Serialize)]
struct Found<'a> {
    map: &'a Path,
    #[serde(flatten)]
    walls: &'a Walls,
    share: f64,
    share_beside: f64,
    /// None unless there are two.
    angle_rad: Option<f64>,
    /// None unless there are two.
    distance_m: Option<f64>,
    picture: Option<&'a Path>,
}

/// Tells how straight the walls of a map are.
pub(super) fn run(map: &Path, within_m: f64, json: bool, picture: Option<&Path>) -> Result<()> {
    let grid = native::read(map)?.grid;
    let walls = Walls::of(&grid, within_m);
    if let Some(file) = picture {
        picture::write_walls(file, &grid, &walls.walls)?;
    }
    let found = Found {
        map,
        share: walls.share(),
        share_beside: walls.share_beside(),
        angle_rad: walls.angle_rad(),
        distance_m: walls.distance_m(),
        walls: &walls,
        picture,
    };
    super::print_found(&found, json)
}

impl fmt::Display for Found<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Walls { walls, within_m, occupied, near, beside } = self.walls;
        let name = self.map.file_name().unwrap_or(self.map.as_os_str()).to_string_lossy();
        writeln!(f, "{name}: {occupied} occupied cells")?;
        for wall in walls {
            let ([x, y], [to_x, to_y]) = (wall.from, wall.to);
            writeln!(
                f,
                "wall         ({x:.2}, {y:.2}) to ({to_x:.2}, {to_y:.2}): {:.2} m, {:.2} m of it occupied; {} cells, {:.3} m off (rms)",
                wall.length_m(),
                wall.covered_m,
                wall.cells,
                wall.rms_m
            )?;
        }
        if walls.is_empty() {
            writeln!(f, "walls        none that is straight for a metre")?;
        }
        if let (Some(distance_m), Some(angle_rad)) = (self.distance_m, self.angle_rad) {
            writeln!(f, "corridor     {distance_m:.2} m wide; its walls differ by {:.2}°", angle_rad.to_degrees())?;
        }
        writeln!(
            f,
            "share        {:.1} % of the occupied cells within {within_m} m of a wall; {:.1} % of the {beside} beside the walls ({near} are near)",
            100.0 * self.share,
            100.0 * self.share_beside
        )?;
        self.picture.map_or(Ok(()), |picture| writeln!(f, "picture      {}", picture.display()))
    }
}
