//! What sonars heard on the last metres, along a way whose shape the odometry says but for two scales.

use echogrid_core::{Increment, Pose2, Scales, move_by};

use super::echoes::Echo;

/// A place of the way at which something was heard.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Stop {
    /// What the drive measured from here to the place after it, or to where the robot is now.
    pub step: Increment,
    /// What was heard here, seen from the base here.
    pub echoes: Vec<Echo>,
}

/// The places of the last metres, the latest first.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trail {
    /// From the latest to the oldest.
    pub stops: Vec<Stop>,
    /// What the drive is believed to measure too much.
    pub scales: Scales,
    /// So many of the echoes are of the older half of the way.
    pub older: usize,
}

impl Trail {
    /// How many echoes there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.stops.iter().map(|stop| stop.echoes.len()).sum()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All echoes, the oldest first, seen from where the robot is now, if the drive measures by `more` too much than is believed; of the
    /// echoes every `every`th.
    #[must_use]
    pub fn echoes(&self, more: Scales, every: usize) -> Vec<Echo> {
        let scales = Scales { lin: self.scales.lin + more.lin, ang: self.scales.ang + more.ang };
        let mut now_from_base = Pose2::IDENTITY;
        let mut all = Vec::with_capacity(self.len());
        for stop in &self.stops {
            now_from_base = now_from_base * move_by(Pose2::IDENTITY, scales.correct(stop.step)).inverse();
            let placed =
                |echo: &Echo| Echo { base_from_transducer: now_from_base * echo.base_from_transducer, ..*echo };
            all.extend(stop.echoes.iter().map(placed));
        }
        all.reverse();
        if every > 1 { all.into_iter().step_by(every).collect() } else { all }
    }
}
