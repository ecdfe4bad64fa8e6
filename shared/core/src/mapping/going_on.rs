//! A second drive goes on with the map of the first.

use super::GridMapper;
use super::recorders::Recorders;
use crate::config::ConfigError;
use crate::grid::{Grid, Mark};
use crate::summary::RunningSummary;

impl GridMapper {
    /// Goes on with a map that a mapper of the same configuration made: what is fused from now on is added to it, as if that one had
    /// fused it. No fix changes what the map says so far. Nothing is to have been fused before.
    ///
    /// # Errors
    /// Its cells are of another size.
    pub fn go_on_with(&mut self, map: Grid) -> Result<(), ConfigError> {
        let config = self.fuser.config();
        if map.resolution_m() != config.resolution_m {
            let value = config.resolution_m.to_string();
            return Err(ConfigError { key: "resolution_m", value, expected: "that of the map that is gone on with" });
        }
        self.grid = map;
        self.recorders = Recorders::new(config, &mut self.grid);
        (self.taken, self.summary) = (Mark::default(), RunningSummary::default());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Filter, MapperConfig, Noise};
    use crate::odometry::Estimate;
    use crate::parts::{Parts, Saved};
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

    fn bytes(mapper: &mut GridMapper) -> Vec<(String, Vec<u8>)> {
        let mut parts = Parts::default();
        mapper.save(&mut parts);
        let mut saved = Saved::default();
        saved.apply(parts.into_changes());
        saved.under("map/").map(|(name, bytes)| (name.to_owned(), bytes.to_vec())).collect()
    }

    #[test]
    fn two_drives_one_after_the_other_make_the_map_of_one_drive() {
        let mut whole = mapper(&config());
        drive(&mut whole, 1, 0.0);
        let mut second = mapper(&config());
        second.go_on_with(whole.grid().clone()).unwrap();
        let tiles = whole.grid().tile_count();
        assert_eq!((second.take_changed().len(), second.summary()), (tiles, whole.summary()));
        drive(&mut second, 61, 3.5);
        drive(&mut whole, 61, 3.5);
        assert!(whole.grid().tile_count() > tiles && second.summary() == whole.summary());
        assert!(bytes(&mut second) == bytes(&mut whole));
    }

    #[test]
    fn cells_of_another_size_are_refused() {
        let error = mapper(&config()).go_on_with(Grid::new(0.1)).unwrap_err();
        assert_eq!((error.key, error.value.as_str()), ("resolution_m", "0.05"));
    }
}
