//! Which way walls face, of a robot that drives along one.

#![allow(clippy::unwrap_used)]

use echogrid_core::config::{Fusion, Noise};
use echogrid_core::{
    CellIndex, Echo, Estimate, GridMapper, MapperConfig, Pose2, Reading, Robot, Sensor, SensorKind, TileIndex,
};

/// A robot with a sonar that looks to its left, and one ahead and one behind of it that look there obliquely.
fn robot() -> Robot {
    let sonar = |first_transducer: u16, bearing_deg: f64| Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.0, 0.2, bearing_deg.to_radians()),
        first_transducer,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: 0.52,
        range_min_m: 0.15,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    Robot { sensors: vec![sonar(0, 90.0), sonar(1, 45.0), sonar(2, 135.0)], ..Robot::default() }
}

/// 3 m along a wall that is 1.3 m to the left, in a direction.
fn drive(fusion: Fusion, heading_rad: f64) -> GridMapper {
    let config = MapperConfig { fusion, ..MapperConfig::default() };
    let mut mapper = GridMapper::new(&config, Noise::Sampled, 1, robot()).unwrap();
    for step in 0..60_u32 {
        let pose = Pose2::new(0.0, 0.0, heading_rad) * Pose2::new(0.05 * f64::from(step), 0.0, 0.0);
        // What meets the wall obliquely is mirrored, and hears something farther on.
        for (transducer, range_m) in [(0, 1.1), (1, 3.5), (2, 3.5)] {
            let reading = Reading { transducer, echo: Echo::Hit { range_m }, offset_ns: 0 };
            mapper.integrate(u64::from(step) + 1, &reading, Some(&Estimate::certain(pose)));
        }
    }
    mapper
}

#[test]
fn a_wall_beside_the_way_faces_across_it() {
    for heading_deg in [0.0, 22.5, 45.0, 67.5, 90.0, 112.5, 180.0, -67.5] {
        let heading_rad = f64::to_radians(heading_deg);
        let mapper = drive(Fusion::Oriented, heading_rad);
        let along_m = [0.8, 1.0, 1.2, 1.4, 1.6, 1.8];
        // Of the cells across the wall the one that is surest.
        let facing_at = |along_m: f64| {
            let cells = [1.24, 1.27, 1.3, 1.33, 1.36].map(|across_m| {
                let at = Pose2::new(0.0, 0.0, heading_rad) * Pose2::new(along_m, across_m, 0.0);
                mapper.grid().cell_at(at.x, at.y)
            });
            let sure = |cell: &CellIndex| mapper.grid().log_odds(*cell).unwrap_or(f32::MIN);
            let cell = cells.into_iter().max_by(|a, b| sure(a).total_cmp(&sure(b))).unwrap();
            f64::from(mapper.facings(cell.tile()).unwrap()[cell.offset_in_tile()])
        };
        let facings: Vec<f64> = along_m.into_iter().map(facing_at).filter(|facing| !facing.is_nan()).collect();
        assert!(facings.len() >= 3, "{heading_deg}: {facings:?}");
        let across_rad = (heading_rad + core::f64::consts::FRAC_PI_2).rem_euclid(core::f64::consts::PI);
        for facing in facings {
            let off = (facing - across_rad).abs();
            assert!(off.min(core::f64::consts::PI - off) < 0.3, "{heading_deg}: {facing} of {across_rad}");
        }
    }
}

#[test]
fn a_rule_that_knows_of_no_directions_tells_none() {
    let mapper = drive(Fusion::FirstEcho, 0.0);
    assert!(mapper.grid().tiles().all(|(index, _)| mapper.facings(index).is_none()));
    assert!(mapper.facings(TileIndex { x: 99, y: 0 }).is_none());
}
