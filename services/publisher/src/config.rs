//! `[publisher]`: which files are written, and how they look.

use core::ops::RangeInclusive;

use echogrid_core::config::ConfigError;
use echogrid_formats::map::map_server::{MapMode, Thresholds};
use echogrid_formats::map::{MapFileOptions, MapFormat};
use serde::{Deserialize, Serialize};

/// The `[publisher]` section: which files are written, and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PublisherConfig {
    /// The files that are written.
    pub formats: Vec<MapFormat>,
    /// What the grey levels of the PGM mean.
    pub pgm_mode: MapMode,
    /// A cell is occupied above this probability.
    pub occupied_thresh: f64,
    /// A cell is free below this probability.
    pub free_thresh: f64,
    /// Whether the picture shows where the robot went.
    pub draw_path: bool,
    /// Whether heading, scale bar and a legend go with the picture.
    pub draw_legend: bool,
    /// The map is saved each time that so much of the sensor's time has passed, seconds; 0: at the end, and when told to.
    pub save_every_s: f64,
    /// Most points of the path; a longer way has them farther apart.
    pub path_points_max: usize,
}

/// How often a map may be saved while it grows, seconds.
const SAVE_EVERY_S: RangeInclusive<f64> = 1.0..=86_400.0;
/// How many points of the path there can be at most.
const PATH_POINTS: RangeInclusive<usize> = 16..=10_000_000;

impl Default for PublisherConfig {
    fn default() -> Self {
        let MapFileOptions { formats, mode, thresholds, draw_path, draw_legend } = MapFileOptions::default();
        let Thresholds { occupied, free } = thresholds;
        Self {
            formats,
            pgm_mode: mode,
            occupied_thresh: occupied,
            free_thresh: free,
            draw_path,
            draw_legend,
            save_every_s: 0.0,
            path_points_max: 1 << 16,
        }
    }
}

impl PublisherConfig {
    /// Whether every value is in its range.
    ///
    /// # Errors
    /// The first key that is not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let mut seen = self.formats.clone();
        seen.sort_unstable();
        seen.dedup();
        let in_unit = |p: f64| p > 0.0 && p < 1.0;
        let refuse = |key, value: String, expected| Err(ConfigError { key, value, expected });
        if self.formats.is_empty() {
            return refuse("formats", "[]".into(), "at least one of png, pgm, npy, echogrid");
        }
        if seen.len() != self.formats.len() {
            return refuse("formats", format!("{:?}", self.formats), "each format once");
        }
        if !in_unit(self.occupied_thresh) {
            return refuse("occupied_thresh", self.occupied_thresh.to_string(), "a probability between 0 and 1");
        }
        // Nearer to each other they leave no grey level that a reader would take for unknown.
        let below_occupied = self.free_thresh <= self.occupied_thresh - Thresholds::APART_MIN;
        if !(in_unit(self.free_thresh) && below_occupied) {
            return refuse(
                "free_thresh",
                self.free_thresh.to_string(),
                "a probability above 0 and below occupied_thresh, by 0.01 at least",
            );
        }
        if !(self.save_every_s == 0.0 || SAVE_EVERY_S.contains(&self.save_every_s)) {
            return refuse("save_every_s", self.save_every_s.to_string(), "0, or seconds from 1 to 86400");
        }
        if !PATH_POINTS.contains(&self.path_points_max) {
            return refuse("path_points_max", self.path_points_max.to_string(), "a whole number from 16 to 10000000");
        }
        Ok(())
    }

    /// What it says, for those who write the files.
    #[must_use]
    pub fn map_files(&self) -> MapFileOptions {
        MapFileOptions {
            formats: self.formats.clone(),
            mode: self.pgm_mode,
            thresholds: Thresholds { occupied: self.occupied_thresh, free: self.free_thresh },
            draw_path: self.draw_path,
            draw_legend: self.draw_legend,
        }
    }
}
