//! Over what angle the beams of a laser lie whose format does not say it (`FLASER`, `RLASER`, tables).

use core::f64::consts::TAU;

use echogrid_core::Sensor;

use super::angles::plain_fan;
use super::fans::aperture_rad;

/// Numbers of beams that lasers have which look over half a turn.
const USUAL: [u16; 3] = [180, 181, 361];

/// Lays the beams of a laser over `view_rad`, their middle ahead, unless the log `is_stated` to say where they lie; without a view as
/// the format has it. What is to be said of that.
pub(super) fn lay(name: &str, sensors: &mut [Sensor], view_rad: Option<f64>, is_stated: bool) -> Option<String> {
    let is_plain = |sensor: &&mut Sensor| {
        let (first_rad, step_rad) = plain_fan(usize::from(sensor.transducers));
        !is_stated
            && sensor.transducers > 1
            && (sensor.first_bearing_rad - first_rad).abs() < 1e-9
            && (sensor.bearing_step_rad - step_rad).abs() < 1e-9
    };
    // Beams that lie in many ways were rounded to a circle.
    if view_rad.is_some() && !sensors.iter_mut().any(|sensor| is_plain(&sensor)) {
        return Some(format!(
            "{name}: replay.laser_view_deg is not used: its beams lie where the log says, or their number changes too often"
        ));
    }
    let mut said = None;
    for sensor in sensors.iter_mut().filter(is_plain) {
        let beams = sensor.transducers;
        match view_rad {
            Some(view_rad) => {
                // All around, the last beam lies beside the first, not on it.
                let gaps = if view_rad >= TAU { beams } else { beams - 1 };
                sensor.bearing_step_rad = view_rad / f64::from(gaps);
                sensor.first_bearing_rad = -view_rad / 2.0;
                sensor.aperture_rad = aperture_rad(sensor.bearing_step_rad);
            }
            None if !USUAL.contains(&beams) => {
                said.get_or_insert_with(|| {
                    format!(
                        "{name}: {beams} beams, laid over 180° as the format has it, which does not say it; of a laser that sees more: \
                         --set replay.laser_view_deg=270 (or 360, all around)"
                    )
                });
            }
            None => {}
        }
    }
    said
}

#[cfg(test)]
mod tests {
    use echogrid_core::{Pose2, SensorKind};

    use super::*;

    fn laser(beams: u16) -> Sensor {
        let (first_bearing_rad, bearing_step_rad) = plain_fan(usize::from(beams));
        Sensor {
            kind: SensorKind::Lidar,
            base_from_sensor: Pose2::default(),
            first_transducer: 0,
            transducers: beams,
            first_bearing_rad,
            bearing_step_rad,
            aperture_rad: 0.01,
            range_min_m: 0.02,
            range_max_m: 30.0,
            range_error_ratio: 0.002,
        }
    }

    #[test]
    fn what_the_user_says_counts() {
        let mut sensors = [laser(360), laser(541)];
        assert_eq!(lay("FLASER", &mut sensors[..1], Some(TAU), false), None);
        assert!((sensors[0].bearing_step_rad - 1_f64.to_radians()).abs() < 1e-12);
        assert!((sensors[0].first_bearing_rad + TAU / 2.0).abs() < 1e-12);
        lay("FLASER", &mut sensors[1..], Some(270_f64.to_radians()), false);
        assert!((sensors[1].bearing_step_rad - 0.5_f64.to_radians()).abs() < 1e-12);
    }

    #[test]
    fn what_is_taken_for_granted_is_said_where_it_may_be_wrong() {
        for (beams, is_said) in [(180, false), (181, false), (361, false), (360, true), (541, true), (90, true)] {
            let mut sensors = [laser(beams)];
            assert_eq!(lay("FLASER", &mut sensors, None, false).is_some(), is_said, "{beams}");
            assert_eq!(sensors, [laser(beams)]);
        }
        // What states its angles needs no word, unless the user says other ones.
        let mut stated = [laser(360)];
        assert_eq!(lay("RAWLASER1", &mut stated, None, true), None);
        assert!(lay("RAWLASER1", &mut stated, Some(TAU), true).is_some_and(|said| said.contains("is not used")));
        let mut rounded = [Sensor { bearing_step_rad: 0.01, ..laser(360) }];
        assert!(lay("FLASER", &mut rounded, Some(TAU), false).is_some_and(|said| said.contains("is not used")));
        assert_eq!((&stated[0], rounded[0].bearing_step_rad), (&laser(360), 0.01));
    }
}
