//! Worlds: what a map is judged by, and what a simulated robot drives in.
//!
//! | file | what it holds | module |
//! |---|---|---|
//! | `.map` | ActivMedia and MobileSim worlds: lines, points, goals, home, forbidden lines and areas | [`mobilesim`] |
//! | `.toml` | echogrid's own: walls with doors, boxes, goals, home | [`plan`] |
//! | `.yaml` | a map_server map: what is occupied is solid | [`crate::map::map_server`] |
//!
//! Whatever the file: metres, in the map frame. Two worlds come along, and go by their names: [`find`]; so do floors that are drawn by
//! lot, `floor-1`, `floor-2` …

mod error;
mod floor;
pub mod mobilesim;
pub mod plan;

use std::path::Path;

use echogrid_core::log_odds::OCCUPIED_ABOVE;
use echogrid_core::world::{Solid, World, WorldParts};

pub use error::WorldFileError;

use crate::map::OccupancyMap;
use crate::map::map_server::{self, MapYaml};
pub use crate::text::TextError;
use crate::text::{TextFileError, read_text};

/// Longest `.map`, bytes.
pub const MAP_BYTES_MAX: u64 = 64 << 20;
/// Longest world of our own, bytes: every door is sought on every wall.
pub const PLAN_BYTES_MAX: u64 = 1 << 20;

/// The worlds that come along: name, and the text of a world of our own.
const BUILTIN: [(&str, &str); 2] =
    [("office", include_str!("../../worlds/office.toml")), ("room", include_str!("../../worlds/room.toml"))];

/// The names of the worlds that come along.
pub fn builtin_worlds() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

/// A world that comes along, by its name, or that of a file.
///
/// # Errors
/// As [`read`].
pub fn find(name: &Path) -> Result<World, WorldFileError> {
    let builtin = BUILTIN.iter().find(|(builtin, _)| Path::new(builtin) == name);
    let drawn = || name.to_str().and_then(floor::number).map(floor::plan);
    let Some(text) = builtin.map(|(_, text)| (*text).to_owned()).or_else(drawn) else { return read(name) };
    let parts = plan::parse(&text).map_err(|source| TextFileError::Text { path: name.to_path_buf(), source })?;
    World::new(parts).map_err(|source| WorldFileError::World { path: name.to_path_buf(), source })
}

/// Reads a world; its ending says which kind.
///
/// # Errors
/// When the file can't be read, is too long, is of no known kind, or makes no world.
pub fn read(path: &Path) -> Result<World, WorldFileError> {
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
    let parts = match ending.as_str() {
        "map" => read_text(path, MAP_BYTES_MAX, mobilesim::parse)?,
        "toml" => read_text(path, PLAN_BYTES_MAX, plan::parse)?,
        "yaml" | "yml" => {
            let (yaml, map) = map_server::read(path)?;
            parts_of_map(&yaml, &map)
        }
        _ => return Err(WorldFileError::ending(path)),
    };
    World::new(parts).map_err(|source| WorldFileError::World { path: path.to_path_buf(), source })
}

/// A map as a world: what is occupied is solid.
#[must_use]
pub fn parts_of_map(yaml: &MapYaml, map: &OccupancyMap) -> WorldParts {
    let solid = map.probability.iter().map(|p| f64::from(*p) > OCCUPIED_ABOVE).collect();
    let solid = Solid::new(map.map_from_corner, yaml.resolution_m, map.width, solid);
    WorldParts { solid, ..WorldParts::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(name: &str, content: &[u8], expected: &str) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(expected), "{error}");
    }

    #[test]
    fn errors_name_the_file_and_what_was_expected() {
        check("a.map", b"", "expected 2D-Map");
        check("a.map", b"2D-Map\nLINES\n", "there is no wall in it");
        check("a.map", b"2D-Map\nLINES\n0 0 1 x\n", "line 3: \"0 0 1 x\"; expected");
        check("a.toml", b"[[wall]]\nfrom = [0, 0]\nto = [1e9, 0]\n", "a coordinate of wall 1 is 1000000000");
        check("a.txt", b"", ".map (MobileSim)");
        check("a.yaml", b"image: none.pgm\nresolution: 0.05\n", "there is no origin");
        let error = read(Path::new("/nowhere/office.toml")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/office.toml: no such file"), "{error}");
    }

    #[test]
    fn worlds_that_come_along_go_by_their_names() {
        for name in builtin_worlds() {
            let world = find(Path::new(name)).unwrap();
            assert!(world.parts().places.home.is_some() && !world.parts().places.goals.is_empty(), "{name}");
        }
        let told = find(Path::new("ofice")).unwrap_err().to_string();
        assert!(
            told.contains("office, room (which come along), floor-1") && told.ends_with("did you mean office?"),
            "{told}"
        );
    }

    #[test]
    fn a_near_name_is_suggested() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("office.map"), "").unwrap();
        let error = read(&folder.path().join("ofice.map")).unwrap_err().to_string();
        assert!(error.contains("did you mean") && error.contains("office.map"), "{error}");
    }

    #[test]
    fn two_gigabytes_are_refused_unread() {
        let folder = tempfile::tempdir().unwrap();
        let sparse = |name: &str| {
            let path = folder.path().join(name);
            std::fs::File::create(&path).unwrap().set_len(2 << 30).unwrap();
            path
        };
        for name in ["a.map", "a.toml", "a.yaml"] {
            let error = read(&sparse(name)).unwrap_err().to_string();
            assert!(error.contains("2147483648 bytes; expected at most"), "{error}");
        }
        sparse("a.pgm");
        let yaml = folder.path().join("b.yaml");
        std::fs::write(
            &yaml,
            "image: a.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n",
        )
        .unwrap();
        let error = read(&yaml).unwrap_err().to_string();
        assert!(error.contains("a.pgm") && error.contains("2147483648 bytes; expected at most"), "{error}");
    }

    #[test]
    fn what_is_occupied_is_solid() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.pgm"), b"P5\n3 2\n255\n\xfe\xfe\x00\xcd\xfe\x00").unwrap();
        let yaml = folder.path().join("a.yaml");
        std::fs::write(
            &yaml,
            "image: a.pgm\nresolution: 0.5\norigin: [1, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.19\n",
        )
        .unwrap();
        let world = read(&yaml).unwrap();
        assert_eq!(world.bounds_m(), [[2.0, 0.0], [2.5, 1.0]]);
        let hit = world.cast([1.1, 0.5], 0.0, 5.0).unwrap();
        assert!((hit.distance_m - 0.9).abs() < 1e-12);
    }
}
