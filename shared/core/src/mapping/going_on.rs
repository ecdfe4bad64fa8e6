//! A second drive goes on with the map of the first.

use super::GridMapper;
use super::recorders::Recorders;
use super::shown::ShownLately;
use crate::config::ConfigError;
use crate::grid::{Grid, Mark, TileIndex};
use crate::summary::RunningSummary;

impl GridMapper {
    /// Goes on with a map as a mapper of the same configuration [showed](GridMapper::shown_tile) it, with the states of its cells: what is
    /// fused from now on is added to it, as if that one had fused it. No fix changes what the map says so far. Nothing is to have been
    /// fused before.
    ///
    /// # Errors
    /// Its cells are of another size.
    pub fn go_on_with(&mut self, mut map: Grid) -> Result<(), ConfigError> {
        let config = self.fuser.config();
        if map.resolution_m() != config.resolution_m {
            let value = config.resolution_m.to_string();
            return Err(ConfigError { key: "resolution_m", value, expected: "that of the map that is gone on with" });
        }
        // What walls around a cell add to what is shown of it would count again each time it is shown.
        let start = config.log_odds_prior as f32;
        let tiles: Vec<TileIndex> = map.tiles().map(|(index, _)| index).collect();
        for index in tiles {
            let fused = self.fuser.along_walls.as_ref().and_then(|along_walls| along_walls.fused(&map, index, start));
            if let Some(fused) = fused {
                map.tile_mut(index).log_odds = fused;
            }
        }
        self.grid = map;
        self.recorders = Recorders::new(config, &mut self.grid);
        (self.taken, self.lately, self.summary) = (Mark::default(), ShownLately::default(), RunningSummary::default());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Filter, MapperConfig, Noise};
    use crate::odometry::Estimate;
    use crate::pose::Pose2;
    use crate::reading::{Echo, Reading};
    use crate::robot::{Robot, Sensor, SensorKind};

    fn robot() -> Robot {
        let sensor = |kind, first_transducer, aperture_rad| Sensor {
            kind,
            base_from_sensor: Pose2::new(0.2, 0.0, 0.4),
            first_transducer,
            transducers: 3,
            first_bearing_rad: -0.5,
            bearing_step_rad: 0.5,
            aperture_rad,
            range_min_m: 0.02,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        };
        Robot {
            sensors: vec![sensor(SensorKind::Sonar, 0, 0.5), sensor(SensorKind::Lidar, 3, 0.01)],
            ..Robot::default()
        }
    }

    fn config() -> MapperConfig {
        // Without what is remembered of readings besides the map.
        MapperConfig { novelty_m: 0.0, oriented_place_m: 0.0, filters: vec![Filter::Range], ..MapperConfig::default() }
    }

    fn mapper(config: &MapperConfig) -> GridMapper {
        GridMapper::new(config, Noise::Sampled, 7, robot()).unwrap()
    }

    /// A drive to the left or the right of a wall.
    fn drive(mapper: &mut GridMapper, first: u64, y: f64) {
        for step in 0..60_u32 {
            let at = Estimate::certain(Pose2::new(0.05 * f64::from(step), y, 0.1 * f64::from(step)));
            let reading = |transducer: u16| {
                let range_m = 1.0 + 0.3 * f64::from(transducer) + 0.01 * f64::from(step);
                (Reading { transducer, echo: Echo::Hit { range_m }, offset_ns: 0 }, Some(at))
            };
            mapper.integrate_scan(first + u64::from(step), &(0..6).map(reading).collect::<Vec<_>>());
        }
    }

    /// The map as it is shown, with the states.
    fn saved(mapper: &GridMapper) -> Grid {
        let mut grid = mapper.grid().clone();
        let tiles: Vec<TileIndex> = grid.tiles().map(|(index, _)| index).collect();
        for index in tiles {
            grid.tile_mut(index).log_odds = mapper.shown_tile(index).unwrap().log_odds.clone();
        }
        grid
    }

    #[test]
    fn two_drives_one_after_the_other_make_the_map_of_one_drive() {
        for oriented_wall_m in [0.0, 2.5] {
            let config = MapperConfig { oriented_wall_m, ..config() };
            let mut whole = mapper(&config);
            drive(&mut whole, 1, 0.0);
            let mut second = mapper(&config);
            second.go_on_with(saved(&whole)).unwrap();
            let tiles = whole.grid().tile_count();
            assert_eq!((second.take_changed().len(), second.summary()), (tiles, whole.summary()));
            drive(&mut second, 61, 3.5);
            drive(&mut whole, 61, 3.5);
            assert!(whole.grid().tile_count() > tiles);
            for (index, _) in whole.grid().tiles() {
                let (one, both) = (whole.shown_tile(index).unwrap(), second.shown_tile(index).unwrap());
                assert!(one.log_odds.iter().zip(both.log_odds.iter()).all(|(a, b)| a.is_nan() == b.is_nan()));
                let off = one.log_odds.iter().zip(both.log_odds.iter()).map(|(a, b)| (a - b).abs());
                // What a limit of the shown map cut off is lost.
                let off: Vec<f32> = off.filter(|off| *off > 1e-3).collect();
                assert!(off.len() < 100 && off.iter().all(|off| *off < 0.3), "{index:?} {oriented_wall_m}: {off:?}");
                assert!(oriented_wall_m > 0.0 || off.is_empty());
            }
        }
    }

    #[test]
    fn cells_of_another_size_are_refused() {
        let error = mapper(&config()).go_on_with(Grid::new(0.1)).unwrap_err();
        assert_eq!((error.key, error.value.as_str()), ("resolution_m", "0.05"));
    }
}
