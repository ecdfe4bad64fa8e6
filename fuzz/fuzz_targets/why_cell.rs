//! Any kept readings that are asked why a cell is what it is: what is written is read again, and there is an answer.
#![no_main]

use echogrid_core::config::Fusion;
use echogrid_core::kept::KeptReading;
use echogrid_core::sensor_model::Deviations;
use echogrid_core::why::why;
use echogrid_core::{Echo, MapperConfig, Pose2, Reading, Robot, Sensor, SensorKind, Verdict};
use echogrid_formats::map::readings::{ReadingsDocument, decode, encode};
use echogrid_fuzz::Numbers;
use libfuzzer_sys::fuzz_target;

fn reading(numbers: &mut Numbers<'_>, sequence: u64) -> Option<KeptReading> {
    let [what, transducer, code] = numbers.take()?;
    numbers.any = what & 2 != 0;
    let range_m = numbers.hundredths()?;
    let echo = if what & 1 == 0 && range_m > 0.0 { Echo::Hit { range_m } } else { Echo::NoEcho };
    Some(KeptReading {
        sequence,
        reading: Reading { transducer: u16::from(transducer), echo, offset_ns: i32::from(what) },
        pose: Pose2 { x: numbers.next()?, y: numbers.next()?, theta: numbers.next()? },
        deviations: Deviations { sigma_z_m: numbers.next()?, sigma_theta_rad: numbers.next()?, trust: numbers.next()? },
        news: numbers.next()?,
        verdict: Verdict::from_code(code % 16)?,
        cleared_m: numbers.next().filter(|radius_m| (0.0..=2.0).contains(radius_m)).unwrap_or(0.0),
    })
}

/// Two sonars and a lidar of three beams.
fn robot() -> Robot {
    let sensor = |kind, first_transducer, transducers, aperture_rad| Sensor {
        kind,
        base_from_sensor: Pose2::new(0.1, 0.0, 0.5),
        first_transducer,
        transducers,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.1,
        aperture_rad,
        range_min_m: 0.1,
        range_max_m: 30.0,
        range_error_ratio: 0.01,
    };
    Robot {
        sensors: vec![
            sensor(SensorKind::Sonar, 0, 1, 0.5),
            sensor(SensorKind::Sonar, 1, 1, 0.5),
            sensor(SensorKind::Lidar, 2, 3, 0.01),
        ],
        ..Robot::default()
    }
}

fuzz_target!(|bytes: &[u8]| {
    let Some((first, bytes)) = bytes.split_first() else { return };
    let fusion = [Fusion::Auto, Fusion::Paper, Fusion::Covariance, Fusion::FirstEcho, Fusion::Oriented][usize::from(first % 5)];
    // A cell is so large that absurd ranges cost no minutes.
    let mapper = MapperConfig { resolution_m: 1.0, fusion, ..MapperConfig::default() };
    let mut numbers = Numbers { bytes, any: first & 4 != 0 };
    let Some(at) = numbers.next().zip(numbers.next()).map(|(x, y)| [x, y]) else { return };
    let readings = (1..).map_while(|sequence| reading(&mut numbers, sequence)).collect();
    let document = ReadingsDocument { mapper, robot: robot(), scans: Vec::new(), given_up: 0, readings };
    let file = encode(&document).expect("it can be written");
    // What can't be is refused.
    let Ok(document) = decode(&file) else { return };
    assert_eq!(encode(&document), Ok(file));
    let answer = why(&document.mapper, &document.robot, &document.readings, at).expect("its configuration is one");
    assert!(answer.log_odds.is_none_or(|log_odds| log_odds.abs() <= 8.0));
    assert!(answer.said.iter().all(|said| said.added.is_finite()));
});
