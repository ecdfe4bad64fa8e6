//! Where the robot was, known from elsewhere.

use anyhow::{Context, Result};
use echogrid_core::Fix;
use echogrid_formats::localization::ReferencePath;

use crate::answer::{Answer, nanoseconds};
use crate::config::LocalizerConfig;

/// A reference path.
#[derive(Debug)]
pub(crate) struct Reference {
    path: ReferencePath,
    gap_ns: u64,
    position_sigma_m: f64,
    heading_sigma_rad: f64,
}

impl Reference {
    pub(crate) fn read(config: &LocalizerConfig) -> Result<Self> {
        let path = ReferencePath::read(&config.reference).context("localizer.reference")?;
        if path.moved() > 0 {
            tracing::info!(rows = path.moved(), "rows of the reference were out of order");
        }
        let LocalizerConfig { position_sigma_m, heading_sigma_rad, .. } = *config;
        Ok(Self { path, gap_ns: nanoseconds(config.reference_gap_s), position_sigma_m, heading_sigma_rad })
    }

    pub(crate) fn answer(&self, stamp_ns: u64) -> Answer {
        match self.path.at(stamp_ns, self.gap_ns) {
            Some(pose) => Answer::Fix(Fix::about(pose, self.position_sigma_m, self.heading_sigma_rad)),
            None => Answer::Unknown(self.why(stamp_ns)),
        }
    }

    /// Why there is no pose for a stamp.
    fn why(&self, stamp_ns: u64) -> String {
        let poses = self.path.poses();
        let seconds = |stamp_ns: u64| stamp_ns as f64 / 1e9;
        match (poses.first(), poses.last()) {
            (Some((first_ns, _)), Some((last_ns, _))) if !(*first_ns..=*last_ns).contains(&stamp_ns) => format!(
                "the reference is of {:.3} s to {:.3} s, not of {:.3} s",
                seconds(*first_ns),
                seconds(*last_ns),
                seconds(stamp_ns)
            ),
            _ => format!(
                "the poses of the reference around {:.3} s are more than {} s apart (localizer.reference_gap_s)",
                seconds(stamp_ns),
                seconds(self.gap_ns)
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::Pose2;

    use super::*;

    const SECOND: u64 = 1_000_000_000;

    #[test]
    fn as_well_as_it_is_known_but_not_over_gaps() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.txt");
        std::fs::write(&file, "1 0 0 0\n2 1 2 0.5\n4.5 3 2 0\n").unwrap();
        let config = LocalizerConfig {
            reference: file,
            reference_gap_s: 2.0,
            position_sigma_m: 0.1,
            heading_sigma_rad: 0.02,
            ..LocalizerConfig::default()
        };
        let reference = Reference::read(&config).unwrap();
        let about = |x, y, theta| Answer::Fix(Fix::about(Pose2::new(x, y, theta), 0.1, 0.02));
        assert_eq!(reference.answer(2 * SECOND), about(1.0, 2.0, 0.5));
        assert_eq!(reference.answer(SECOND + SECOND / 2), about(0.5, 1.0, 0.25));
        let why = |stamp_ns| match reference.answer(stamp_ns) {
            Answer::Unknown(why) => why,
            other => panic!("{other:?}"),
        };
        assert!(why(3 * SECOND).contains("around 3.000 s are more than 2 s apart"), "{}", why(3 * SECOND));
        assert!(why(0).contains("of 1.000 s to 4.500 s, not of 0.000 s"), "{}", why(0));
        let patient = Reference::read(&LocalizerConfig { reference_gap_s: 2.5, ..config }).unwrap();
        assert!(matches!(patient.answer(3 * SECOND), Answer::Fix(_)));
    }
}
