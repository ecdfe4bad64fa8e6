//! Any sightings of landmarks: a pose with numbers that are finite, or why there is none.
#![no_main]

use echogrid_core::{Pose2, Sighting, triangulate};
use echogrid_fuzz::Numbers;
use libfuzzer_sys::fuzz_target;

fn sighting(numbers: &mut Numbers<'_>) -> Option<Sighting> {
    let [what] = numbers.take()?;
    let landmark = [numbers.next()?, numbers.next()?];
    let range_m = if what & 1 == 0 { None } else { Some(numbers.next()?) };
    let bearing_rad = if what & 2 == 0 { None } else { Some(numbers.next()?) };
    Some(Sighting {
        landmark,
        range_m,
        bearing_rad,
        range_sigma_m: numbers.next()?,
        bearing_sigma_rad: numbers.next()?,
    })
}

fuzz_target!(|bytes: &[u8]| {
    let Some((first, bytes)) = bytes.split_first() else { return };
    let mut numbers = Numbers { bytes, any: first & 1 == 1 };
    let (Some(x), Some(y), Some(theta)) = (numbers.next(), numbers.next(), numbers.next()) else { return };
    let sightings: Vec<Sighting> = core::iter::from_fn(|| sighting(&mut numbers)).collect();
    match triangulate(&sightings, Pose2 { x, y, theta }) {
        Ok(fix) => {
            assert!(fix.pose.is_finite() && fix.chi2.is_finite());
            assert!(fix.covariance.iter().all(|value| value.is_finite()));
            assert_eq!(fix.covariance, fix.covariance.transpose());
            assert!(fix.covariance.diagonal().iter().all(|variance| *variance > 0.0));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
