//! What the map shows of the evidence: what lies along walls counts, where the rule of fusion knows of them.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use super::GridMapper;
use crate::fusion::Fuser;
use crate::grid::{Grid, Mark, Tile, TileIndex};
use crate::summary::GridSummary;

/// What is kept that was not asked for so many times that changes were taken, and most that are kept.
const KEPT_FOR: u64 = 16;
const KEPT_MOST: usize = 256;

/// What is shown of the tiles that changed lately, so that of one that changes again only the cells are looked at that see a change.
#[derive(Debug, Clone, Default)]
pub(super) struct ShownLately {
    /// When each changed last.
    tiles: BTreeMap<TileIndex, (u64, Tile)>,
    times: u64,
}

impl ShownLately {
    /// Keeps what is shown of some tiles, all that changed since `mark` and those around them.
    fn keep(&mut self, grid: &mut Grid, fuser: &Fuser, changed: &[TileIndex], mark: Mark) {
        let Some(along_walls) = &fuser.along_walls else { return };
        let written = grid.changed_since(mark).into_iter();
        let touched: BTreeMap<_, _> = written.map(|index| (index, grid.take_touched(index))).collect();
        self.times += 1;
        if changed.len() > KEPT_MOST {
            self.tiles.clear();
            return;
        }
        for index in changed {
            let mut near = around(*index).map(|near| near.and_then(|near| touched.get(&near).copied()).unwrap_or(0));
            let touched = core::array::from_fn(|_| core::array::from_fn(|_| near.next().unwrap_or(0)));
            let shown = match self.tiles.remove(index) {
                Some((_, Tile { mut log_odds, .. })) => {
                    along_walls.show_again(grid, *index, &touched, &mut log_odds).then_some(log_odds)
                }
                None => along_walls.shown(grid, *index),
            };
            if let Some(shown) = shown {
                self.tiles.insert(*index, (self.times, Tile::new(revision(grid, *index), shown)));
            }
        }
        let times = self.times;
        self.tiles.retain(|_, (changed, _)| *changed + KEPT_FOR > times);
    }
}

impl GridMapper {
    /// What is shown of a tile: its log-odds, without planes. Its revision is the sequence number of the ring that changed it, or
    /// what lies around it, last.
    #[must_use]
    pub fn shown_tile(&self, index: TileIndex) -> Option<Cow<'_, Tile>> {
        tile(self.grid.is_as_at(self.taken).then_some(&self.lately), &self.grid, &self.fuser, index)
    }

    /// The map as it is shown; without planes where it is not the one that was fused.
    #[must_use]
    pub fn shown(&self) -> Cow<'_, Grid> {
        let is_shown = |(_, tile): (TileIndex, &Tile)| tile.shares.is_none();
        if self.fuser.along_walls.is_none() || self.grid.tiles().all(is_shown) {
            return Cow::Borrowed(&self.grid);
        }
        let mut shown = Grid::new(self.grid.resolution_m());
        for (index, _) in self.grid.tiles() {
            if let Some(tile) = self.shown_tile(index) {
                *shown.tile_mut(index) = tile.into_owned();
            }
        }
        Cow::Owned(shown)
    }

    /// The map so far in numbers: only tiles that changed since the last call are looked at again.
    pub fn summary(&mut self) -> GridSummary {
        let is_lately = self.grid.is_as_at(self.taken);
        let (changed, mark) = (changed_since(&self.grid, self.summary.looked()), self.grid.mark());
        let Self { summary, grid, fuser, lately, .. } = self;
        let lately = is_lately.then_some(&*lately);
        summary.of(&changed, |index| tile(lately, grid, fuser, index), mark)
    }

    /// The tiles of which something else is shown than at the last call, row by row.
    pub fn take_changed(&mut self) -> Vec<TileIndex> {
        let changed = changed_since(&self.grid, self.taken);
        self.lately.keep(&mut self.grid, &self.fuser, &changed, self.taken);
        self.taken = self.grid.mark();
        changed
    }
}

/// What is shown of a tile; `lately`, if that is still so.
pub(super) fn tile<'a>(
    lately: Option<&'a ShownLately>,
    grid: &'a Grid,
    fuser: &Fuser,
    index: TileIndex,
) -> Option<Cow<'a, Tile>> {
    if let Some((_, tile)) = lately.and_then(|lately| lately.tiles.get(&index)) {
        return Some(Cow::Borrowed(tile));
    }
    let shown = fuser.along_walls.as_ref().and_then(|along_walls| along_walls.shown(grid, index));
    let Some(shown) = shown else { return grid.tile(index).map(Cow::Borrowed) };
    Some(Cow::Owned(Tile::new(revision(grid, index), shown)))
}

/// The number of the ring that changed what is shown of a tile last.
fn revision(grid: &Grid, index: TileIndex) -> u64 {
    around(index).flatten().filter_map(|near| Some(grid.tile(near)?.revision)).max().unwrap_or_default()
}

/// The tiles of which something else may be shown than at `mark`, row by row: also those around one that changed.
pub(super) fn changed_since(grid: &Grid, mark: Mark) -> Vec<TileIndex> {
    let has_states = |index: &TileIndex| grid.tile(*index).is_some_and(|tile| tile.shares.is_some());
    let mut changed = BTreeSet::new();
    for index in grid.changed_since(mark) {
        changed.insert(index);
        changed.extend(around(index).flatten().filter(has_states));
    }
    changed.into_iter().collect()
}

/// A tile and those around it, row by row, as far as there can be such.
fn around(index: TileIndex) -> impl Iterator<Item = Option<TileIndex>> {
    let near = move |(dx, dy)| Some(TileIndex { x: index.x.checked_add(dx)?, y: index.y.checked_add(dy)? });
    (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).map(near)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::MapperConfig;
    use crate::grid::CellIndex;
    use crate::odometry::Estimate;
    use crate::pose::Pose2;
    use crate::reading::{Echo, Reading};
    use crate::robot::{Robot, Sensor, SensorKind};

    fn mapper() -> GridMapper {
        let sensor = |(kind, bearing_rad, first_transducer, aperture_rad)| Sensor {
            kind,
            base_from_sensor: Pose2::new(0.1, 0.0, bearing_rad),
            first_transducer,
            transducers: 1,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.0,
            aperture_rad,
            range_min_m: 0.1,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        };
        let sensors = [
            (SensorKind::Sonar, 0.0, 0, 0.5),
            (SensorKind::Sonar, 1.5, 1, 0.5),
            (SensorKind::Sonar, -1.5, 2, 0.5),
            (SensorKind::Lidar, 0.3, 3, 0.01),
        ];
        let robot = Robot { sensors: sensors.into_iter().map(sensor).collect(), ..Robot::default() };
        let config = MapperConfig { filters: Vec::new(), ..MapperConfig::default() };
        GridMapper::with_defaults_of_odometry(&config, robot).unwrap()
    }

    /// A ring that is heard driving to and fro, with the walls of a corridor.
    fn give(mapper: &mut GridMapper, sequence: u64) {
        let along = 0.1 * (sequence % 120) as f64;
        let estimate = Estimate::certain(Pose2::new(along.min(12.0 - along), 0.7, 0.02 * sequence as f64));
        let echo = |transducer: u16| match (sequence + u64::from(transducer)) % 4 {
            0 => Echo::NoEcho,
            n => Echo::Hit { range_m: 0.8 + 0.6 * n as f64 },
        };
        let reading = |transducer| (Reading { transducer, echo: echo(transducer), offset_ns: 0 }, Some(estimate));
        mapper.integrate_scan(sequence, &[0, 1, 2, 3].map(reading));
    }

    fn bits(tile: &Tile) -> (u64, Vec<u32>) {
        (tile.revision, tile.log_odds.iter().map(|log_odds| log_odds.to_bits()).collect())
    }

    /// However often changes are taken, and whoever writes meanwhile.
    #[test]
    fn what_is_shown_lately_is_what_is_shown() {
        let mut mapper = mapper();
        let mut kept = 0;
        for sequence in 1..=240 {
            give(&mut mapper, sequence);
            let place = CellIndex { i: (sequence * 7 % 200) as i32, j: (sequence * 5 % 60) as i32 - 20 };
            match sequence {
                50 => mapper.grid.begin_undo(),
                // A cell that somebody else moves, a tile that is written to, one that is unknown again, and some taken back.
                60 | 61 if mapper.grid.log_odds(place).is_some() => *mapper.grid.log_odds_mut(place, sequence) += 0.5,
                70 => mapper.grid.tile_mut(place.tile()).log_odds.fill(0.7),
                80 => mapper.grid.take_back(place.tile(), None),
                90 => {
                    let before = mapper.grid.end_undo();
                    before.into_iter().for_each(|(index, tile)| mapper.grid.take_back(index, tile));
                }
                _ => {}
            }
            if sequence % 5 > 2 {
                continue;
            }
            let changed = mapper.take_changed();
            assert!(!changed.is_empty());
            for index in &changed {
                let fresh = tile(None, &mapper.grid, &mapper.fuser, *index).unwrap();
                assert!(bits(&mapper.shown_tile(*index).unwrap()) == bits(&fresh), "{index:?} after {sequence} rings");
            }
            // What did not change is as it was.
            for (index, (_, tile)) in &mapper.lately.tiles {
                let fresh = super::tile(None, &mapper.grid, &mapper.fuser, *index).unwrap();
                assert!(bits(tile).1 == bits(&fresh).1, "{index:?} after {sequence} rings");
                kept += usize::from(!changed.contains(index));
            }
            assert_eq!(mapper.summary(), GridSummary::of(&mapper.shown()));
        }
        assert!(kept > 20, "{kept}");
    }

    #[test]
    fn what_is_written_after_changes_were_taken_is_shown() {
        let mut mapper = mapper();
        give(&mut mapper, 1);
        let changed = mapper.take_changed();
        give(&mut mapper, 2);
        for index in changed {
            let fresh = tile(None, &mapper.grid, &mapper.fuser, index).unwrap();
            assert_eq!(bits(&mapper.shown_tile(index).unwrap()), bits(&fresh));
        }
    }

    #[test]
    fn tiles_are_not_kept_forever() {
        let mut mapper = mapper();
        for sequence in 1..=3 * KEPT_FOR {
            // Ever farther off
            let estimate = Estimate::certain(Pose2::new(5.0 * sequence as f64, 0.0, 0.0));
            let reading = Reading { transducer: 0, echo: Echo::Hit { range_m: 2.0 }, offset_ns: 0 };
            mapper.integrate_scan(sequence, &[(reading, Some(estimate))]);
            mapper.take_changed();
        }
        assert!(mapper.grid.tile_count() > mapper.lately.tiles.len() && !mapper.lately.tiles.is_empty());
    }
}
