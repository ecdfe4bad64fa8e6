//! The state of the service as parts, of which only those are written again that changed: those of [`echogrid_slam::Slam`] and its own.
//!
//! | part | what |
//! |---|---|
//! | `state` | the odometry, and what waits |
//! | `odom/n`, `scans/n`, `path/n` | poses of the odometry and stamps of scans that are not told, poses that are: the n-th 512 |
//! | `sonars`, `driven/n`, `rings/n` | of a robot with sonars: what they heard |

use std::collections::VecDeque;

use anyhow::Result;
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{Incidents, Leaps, Odometry, Robot};
use serde::{Deserialize, Serialize};

use crate::history::{History, HistoryState};
use crate::telling::{Telling, TellingState};
use crate::{Scan, SlamService, State, has_sonars};

const STATE: &str = "state";

/// What is saved besides lists.
#[derive(Debug, Serialize, Deserialize)]
struct Stored {
    robot: Option<Robot>,
    odometry: Odometry,
    leaps: Leaps,
    leapt: Incidents,
    waiting: VecDeque<Scan>,
    history: HistoryState,
    telling: TellingState,
}

impl SlamService {
    /// Puts what changed since this was called last into `parts`; at first all there is.
    pub fn save(&mut self, parts: &mut Parts) {
        let state = &mut self.state;
        let stored = Stored {
            robot: state.robot.clone(),
            odometry: state.odometry.clone(),
            leaps: state.leaps.clone(),
            leapt: state.leapt,
            waiting: state.waiting.clone(),
            history: state.history.save(parts),
            telling: state.telling.save(parts),
        };
        parts.put_value(STATE, &stored);
        self.slam.save(parts);
        self.sonars.save(parts);
    }

    /// Goes on where the one was that was saved; this one is new and of the same configuration.
    ///
    /// # Errors
    /// A part is missing, or damaged.
    pub fn restore(&mut self, saved: &Saved) -> Result<()> {
        let stored: Stored = saved.value(STATE)?;
        self.slam.restore(saved)?;
        self.sonars.restore(saved)?;
        self.state = State {
            robot: stored.robot,
            odometry: stored.odometry,
            leaps: stored.leaps,
            leapt: stored.leapt,
            history: History::restore(saved, stored.history)?,
            waiting: stored.waiting,
            telling: Telling::restore(saved, stored.telling)?,
        };
        if self.state.robot.as_ref().is_some_and(|robot| !has_sonars(robot)) || self.slam.drive.graph.settled > 0 {
            self.sonars.forget();
        }
        Ok(())
    }
}
