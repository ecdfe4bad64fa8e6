//! Trials of a simulated robot, whose error model is known.

use core::f64::consts::PI;

use anyhow::Result;
use echogrid_core::{Calibration, Pose2, Trial};
use echogrid_simulator::{Drive, Motion, SimulatorConfig};

use super::request::Calibrate;
use super::trials::Found;
use echogrid_config::{Config, LoadRequest};

/// Ways of the first phase, metres: several lengths, as a line is not seen in one.
const STRAIGHT_M: [f64; 2] = [1.0, 5.0];
/// Turns of the second, radians.
const TURN_RAD: [f64; 2] = [0.5 * PI, 1.5 * PI];

/// As many trials of each phase as were asked for.
pub(super) fn trials(request: &Calibrate) -> Result<Found> {
    let sets = std::iter::once(format!("simulator.seed={}", request.seed)).chain(request.sets.iter().cloned());
    let config = Config::load(&LoadRequest {
        sensor: Some("simulator".to_owned()),
        robot: request.robot.clone(),
        sets: sets.collect(),
        ..LoadRequest::default()
    })?
    .into_config();
    let robot = config.robot.map_or_else(String::new, |robot| format!(" {}", robot.name));
    let [translations, rotations] = two_phases(&config.simulator, request.trials);
    let given = expected(&config.simulator, &translations, &rotations);
    let name = format!("a simulated{robot}, seed {}", config.simulator.seed);
    Ok(Found { name, translations, rotations, known: None, given: Some(given) })
}

/// Each trial is a drive of its own, so that none knows of another.
fn two_phases(config: &SimulatorConfig, count: u32) -> [Vec<Trial>; 2] {
    let spread =
        |[low, high]: [f64; 2], index: u32| low + (high - low) * f64::from(index) / f64::from(count.max(2) - 1);
    let straight = |index| Motion::Straight { metres: spread(STRAIGHT_M, index) };
    let turn = |index| Motion::Turn { radians: spread(TURN_RAD, index) };
    let run = |motion: &dyn Fn(u32) -> Motion, first: u32| {
        let trial = |index| {
            // Seeds that follow each other would be those of the next calibration, too.
            let seed = config.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(u64::from(first + index));
            let mut drive = Drive::new(&SimulatorConfig { seed, ..config.clone() }, Pose2::IDENTITY);
            // On its way already: a trial begins anywhere between two ticks of the encoders.
            drive.run(Motion::Turn { radians: 1.0 });
            drive.run(Motion::Straight { metres: 0.5 });
            drive.run(motion(index))
        };
        (0..count).map(trial).collect()
    };
    [run(&straight, 0), run(&turn, count)]
}

/// What trials of these lengths are expected to find: offsets are those of the mean length, and what they drift by from
/// length to length is in the variances, too.
fn expected(config: &SimulatorConfig, translations: &[Trial], rotations: &[Trial]) -> Calibration {
    let model = config.expected_error_model();
    let (straight_m, way_m, spread_m2) = lengths(translations, |trial| (trial.true_m, trial.measured_m));
    let (turn_rad, way_rad, spread_rad2) = lengths(rotations, |trial| (trial.true_rad, trial.measured_rad));
    let mut expected = model.over(straight_m, turn_rad);
    expected.k_tl += model.ang_offset_rad_per_m * model.ang_offset_rad_per_m * spread_m2 / way_m;
    expected.k_lt += model.lin_offset_m_per_rad * model.lin_offset_m_per_rad * spread_rad2 / way_rad;
    expected
}

/// Mean of what was true, mean of what was measured, variance of what was true.
fn lengths(trials: &[Trial], of: impl Fn(&Trial) -> (f64, f64)) -> (f64, f64, f64) {
    let count = trials.len() as f64;
    let (truth, measured) =
        trials.iter().map(&of).fold((0.0, 0.0), |sum, (t, m)| (sum.0 + t / count, sum.1 + m / count));
    let spread = trials.iter().map(|trial| (of(trial).0 - truth) * (of(trial).0 - truth)).sum::<f64>() / count;
    (truth, measured, spread)
}
