//! Why a cell is what it is: the kept readings are fused once more, in their order, and the cell is watched.
//!
//! All of them are, not those alone that touch the cell: what `first_echo` makes of a reading depends on the whole cone so far. So
//! what comes out is the cell's log-odds, exactly, if every reading since the map was empty was kept.

use crate::config::{ConfigError, MapperConfig, Noise};
use crate::driven::Driven;
use crate::filter::{channels, range_of};
use crate::fusion::{Fuser, Sounding};
use crate::grid::{CellIndex, Grid};
use crate::kept::KeptReading;
use crate::odometry::Estimate;
use crate::pose::Pose2;
use crate::robot::Robot;
use crate::verdict::Verdict;

/// What one reading said of the cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said {
    /// The reading, where the robot was, and what it was worth.
    pub kept: KeptReading,
    /// The number of its sonar; none: it is another sensor's.
    pub sonar: Option<u16>,
    /// Log-odds of the cell before; none: nobody had spoken of it.
    pub before: Option<f32>,
    /// Log-odds after it; those before, where the reading was refused.
    pub after: Option<f32>,
    /// What it added, from l0 on where nobody had spoken of the cell; 0 where it was refused.
    pub added: f64,
}

/// Why a cell is what it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Why {
    /// Log-odds that the kept readings come to, as the map shows them; none: unknown.
    pub log_odds: Option<f32>,
    /// What the cells along walls added to those of the cell itself.
    pub along_walls_added: f64,
    /// How often the robot drove over the cell, knowing where it was.
    pub driven_over: usize,
    /// Log-odds that this added.
    pub driven_added: f64,
    /// Readings that moved the cell, and those that were refused and spoke of it, in the order in which they were fused.
    pub said: Vec<Said>,
}

/// Fuses `readings` once more, as `config` says, and tells what they said of the cell that holds the point (x, y), metres in the
/// map frame.
///
/// # Errors
/// The configuration is out of range or does not fit the robot.
pub fn why<'a>(
    config: &MapperConfig,
    robot: &Robot,
    readings: impl IntoIterator<Item = &'a KeptReading>,
    [x, y]: [f64; 2],
) -> Result<Why, ConfigError> {
    config.validate()?;
    let channels = channels(config, robot)?;
    // No noise is drawn: the deviations are told.
    let mut fuser = Fuser::new(config, Noise::OneSigma, 0);
    let driven = Driven::new(config, robot);
    let (mut driven_over, mut driven_added) = (0, 0.0);
    let mut grid = Grid::new(config.resolution_m);
    let cell = grid.cell_at(x, y);
    let mut said = Vec::new();
    let of = |log_odds: Option<f32>| log_odds.map_or(config.log_odds_prior, f64::from);
    for kept in readings {
        let Some(Some(channel)) = channels.get(usize::from(kept.reading.transducer)) else { continue };
        let estimate = Estimate::certain(kept.pose);
        let (sequence, reading, range_m) = (kept.sequence, &kept.reading, range_of(kept.reading.echo).ok());
        let sounding = Sounding { sequence, reading, channel, range_m, estimate: &estimate };
        let before = grid.log_odds(cell);
        let is_told = if kept.verdict == Verdict::Accepted {
            let model = fuser.inverse_sensor_model(&sounding, kept.deviations, kept.news);
            let _ = fuser.add(&mut grid, &sounding, &model);
            grid.log_odds(cell).map(f32::to_bits) != before.map(f32::to_bits)
        } else {
            is_spoken_of(&mut fuser, &sounding, kept, cell, config.resolution_m)
        };
        if is_told {
            let after = grid.log_odds(cell);
            said.push(Said { kept: *kept, sonar: channel.sonar, before, after, added: of(after) - of(before) });
        }
        let before = grid.log_odds(cell);
        driven.clear_disc(&mut grid, [kept.pose.x, kept.pose.y], kept.cleared_m, kept.sequence);
        if grid.log_odds(cell) != before {
            driven_over += 1;
            driven_added += of(grid.log_odds(cell)) - of(before);
        }
    }
    let (own, shown) = (grid.log_odds(cell), super::shown::tile(None, &grid, &fuser, cell.tile()));
    let log_odds = shown.map(|tile| tile.log_odds[cell.offset_in_tile()]).filter(|log_odds| !log_odds.is_nan());
    Ok(Why { log_odds, along_walls_added: of(log_odds) - of(own), driven_over, driven_added, said })
}

/// Whether a refused reading would have moved the cell, on a map that knows nothing.
fn is_spoken_of(
    fuser: &mut Fuser,
    sounding: &Sounding<'_>,
    kept: &KeptReading,
    cell: CellIndex,
    resolution_m: f64,
) -> bool {
    // What lies farther off is in no cone.
    let transducer = &sounding.channel.transducer;
    let reach_m = sounding.range_m.unwrap_or(transducer.range_max_m) + 3.0 * kept.deviations.sigma_z_m;
    let mut empty = Grid::new(resolution_m);
    let [x, y] = empty.centre(cell);
    let arm_m = transducer.base_from_transducer.distance_m(Pose2::IDENTITY);
    let off_m = kept.pose.distance_m(Pose2::new(x, y, 0.0));
    // Of deviations that nobody knows nothing is said.
    let is_near = off_m <= reach_m.min(transducer.range_max_m) + arm_m + resolution_m;
    if !is_near {
        return false;
    }
    let model = fuser.inverse_sensor_model(sounding, kept.deviations, 1.0);
    fuser.add(&mut empty, sounding, &model).is_ok() && empty.log_odds(cell).is_some_and(|log_odds| log_odds != 0.0)
}
