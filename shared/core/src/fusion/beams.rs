//! Beams of one lidar that stand side by side, weighed and added together.

use super::{Fuser, Sounding, Weighed};
use crate::config::Fusion;
use crate::grid::Grid;
use crate::kernel::FanKernel;
use crate::pose::Pose2;
use crate::robot::{Fan, Transducer};
use crate::sensor_model::Cone;
use crate::verdict::Verdict;

/// Where the beams of one lidar begin, for one pose of the robot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stand {
    /// Of the robot.
    heading_rad: f64,
    /// `map_from_transducer` of one of them.
    map_from_transducer: Pose2,
    /// Whether all that the lidar can see is within the map.
    is_within: bool,
}

impl Fuser {
    /// Where a transducer is among beams that stand side by side, if the rule of fusion can add them together.
    pub(crate) fn fan_of<'a>(&self, transducer: &'a Transducer) -> Option<&'a Fan> {
        match self.config.fusion.of(transducer.kind) {
            Fusion::Auto | Fusion::Paper | Fusion::Covariance => transducer.fan.as_ref(),
            Fusion::FirstEcho | Fusion::Oriented => None,
        }
    }

    /// Where the lidar of `sounding` stands.
    pub(crate) fn stand(&self, sounding: &Sounding<'_>) -> Stand {
        let Transducer { range_max_m, aperture_rad, .. } = sounding.channel.transducer;
        let map_from_transducer = sounding.map_from_transducer();
        let is_within = FanKernel::reaches(self.config.resolution_m, map_from_transducer, range_max_m, aperture_rad);
        Stand { heading_rad: sounding.estimate.pose.theta, map_from_transducer, is_within }
    }

    /// How far a beam of a lidar that stands there is to be trusted, how much of it is new, and what it says, with its number.
    ///
    /// # Errors
    /// It is not to be trusted, or leaves the map.
    pub(crate) fn weigh_beam(
        &mut self,
        sounding: &Sounding<'_>,
        stand: &Stand,
        news: Option<f64>,
    ) -> Result<(Weighed, (u16, Cone)), Verdict> {
        let transducer = &sounding.channel.transducer;
        let Pose2 { x, y, .. } = stand.map_from_transducer;
        // The same product of poses, without its sine and cosine
        let map_from_transducer = Pose2::new(x, y, stand.heading_rad + transducer.base_from_transducer.theta);
        let weighed = self.weigh_at(sounding, map_from_transducer, news)?;
        let cone = self.cone(sounding, weighed.deviations, weighed.news);
        let is_taken = if stand.is_within {
            FanKernel::is_sound(&cone)
        } else {
            FanKernel::takes(self.config.resolution_m, map_from_transducer, &cone)
        };
        let fan = transducer.fan.filter(|_| is_taken).ok_or(Verdict::OffMap)?;
        Ok((weighed, (fan.beam, cone)))
    }

    /// Adds what such beams say, in the order of their numbers; one of them is that of `sounding`.
    pub(crate) fn add_beams(&mut self, grid: &mut Grid, sounding: &Sounding<'_>, beams: &[(u16, Cone)]) {
        if let Some(fan) = sounding.channel.transducer.fan {
            let map_from_first = sounding.estimate.pose * fan.base_from_first;
            let added = self.fan.add_taken(grid, map_from_first, fan.step_rad, beams, sounding.sequence);
            debug_assert!(added.is_ok(), "each was asked");
        }
    }
}
