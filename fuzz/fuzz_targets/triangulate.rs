//! Any sightings of landmarks: a pose with numbers that are finite, or why there is none.
#![no_main]

use echogrid_core::{Pose2, Sighting, triangulate};
use libfuzzer_sys::fuzz_target;

/// Numbers out of bytes: any at all, or hundredths, of which more make a pose.
struct Numbers<'a> {
    bytes: &'a [u8],
    any: bool,
}

impl Numbers<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.bytes.split_first_chunk()?;
        self.bytes = rest;
        Some(*first)
    }

    fn next(&mut self) -> Option<f64> {
        if self.any {
            self.take().map(f64::from_le_bytes)
        } else {
            self.take().map(|two| f64::from(i16::from_le_bytes(two)) / 100.0)
        }
    }

    fn sighting(&mut self) -> Option<Sighting> {
        let [what] = self.take()?;
        let landmark = [self.next()?, self.next()?];
        let range_m = if what & 1 == 0 { None } else { Some(self.next()?) };
        let bearing_rad = if what & 2 == 0 { None } else { Some(self.next()?) };
        Some(Sighting { landmark, range_m, bearing_rad, range_sigma_m: self.next()?, bearing_sigma_rad: self.next()? })
    }
}

fuzz_target!(|bytes: &[u8]| {
    let Some((first, bytes)) = bytes.split_first() else { return };
    let mut numbers = Numbers { bytes, any: first & 1 == 1 };
    let (Some(x), Some(y), Some(theta)) = (numbers.next(), numbers.next(), numbers.next()) else { return };
    let sightings: Vec<Sighting> = core::iter::from_fn(|| numbers.sighting()).collect();
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
