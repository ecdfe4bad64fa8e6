//! What a fix makes of the map: readings since the last one are taken out again and fused where the robot was in hindsight.
//!
//! Evidence can't be subtracted (it is clamped, and fusion may depend on the map so far), so it is taken out by restoring the
//! tiles as they were. They are copied before they change for the first time; the readings since are kept. Both are kept in layers,
//! of which the oldest is given up when there are too many readings: its evidence stays as it is.

mod again;
mod layer;

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::fusion::{Sounding, Weighed};
use crate::grid::Grid;
use crate::mapping::GridMapper;
use crate::odometry::Estimate;
use crate::parts::{Parts, Saved, SavedError};
use crate::smoothing::smooth;
use crate::verdict::Verdict;
use layer::{Kept, Layer};

/// A quarter of what is kept goes at once: all of it would leave a fix nothing to mend.
const LAYERS: usize = 4;

/// What a fix has made of the map.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Remapped {
    /// Readings that were fused again.
    pub readings: u64,
    /// Readings since the last fix that stay as they were: too many for memory, or the fix told of no error of the odometry.
    pub left: u64,
    /// Whose reading it was, the verdict that it had, and the one that it has now, where they differ.
    pub verdicts: Vec<(u16, Verdict, Verdict)>,
}

/// What can be taken out of the map again.
#[derive(Debug, Clone)]
pub(crate) struct Journal {
    readings_max: usize,
    /// Never empty. How the map was before the last one is still with the grid.
    layers: VecDeque<Layer>,
    /// Readings of layers that were given up.
    left: u64,
    /// Number of the first layer: no other is, was or will be called so.
    first: u64,
    /// Layers that are gone, with how many parts each was saved in.
    gone: Vec<(u64, u64)>,
}

/// What is saved of a journal besides its layers.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct JournalState {
    first: u64,
    left: u64,
    /// How many parts each layer is in.
    parts: Vec<u64>,
}

impl Journal {
    /// Of at most so many readings in `grid`.
    pub(crate) fn new(readings_max: usize, grid: &mut Grid) -> Self {
        grid.begin_undo();
        Self { readings_max, layers: VecDeque::from([Layer::default()]), left: 0, first: 0, gone: Vec::new() }
    }

    /// All layers; it begins again with an empty one.
    fn take_layers(&mut self, grid: &mut Grid) -> VecDeque<Layer> {
        if let Some(last) = self.layers.back_mut() {
            last.before = grid.end_undo();
        }
        let layers = std::mem::replace(&mut self.layers, VecDeque::from([Layer::default()]));
        layers.iter().for_each(|layer| self.forget_first(layer));
        self.left = 0;
        layers
    }

    /// The first layer is gone.
    fn forget_first(&mut self, layer: &Layer) {
        if layer.parts() > 0 {
            self.gone.push((self.first, layer.parts()));
        }
        self.first += 1;
    }

    /// Before so many more readings are fused.
    pub(crate) fn make_room(&mut self, grid: &mut Grid, count: usize) {
        let most = (self.readings_max / LAYERS).max(1);
        let full = |layer: &Layer| !layer.readings.is_empty() && layer.readings.len() + count > most;
        if let Some(last) = self.layers.back_mut().filter(|layer| full(layer)) {
            last.before = grid.end_undo();
            self.layers.push_back(Layer::default());
            grid.begin_undo();
        }
        let kept = |layers: &VecDeque<Layer>| layers.iter().map(|layer| layer.readings.len()).sum::<usize>();
        while self.layers.len() > 1 && kept(&self.layers) + count > self.readings_max {
            let oldest = self.layers.pop_front().unwrap_or_default();
            self.left += oldest.readings.len() as u64;
            self.forget_first(&oldest);
        }
    }

    /// After it was: what may be told better by the next fix. `place`: its place among the kept readings.
    pub(crate) fn record(
        &mut self,
        sounding: &Sounding<'_>,
        fused: Result<Weighed, Verdict>,
        place: u64,
        cleared_at: Option<[f64; 2]>,
    ) {
        let Some(layer) = self.layers.back_mut() else { return };
        if matches!(fused, Ok(_) | Err(Verdict::Untrusted)) {
            let Sounding { sequence, reading, estimate, .. } = *sounding;
            if layer.estimates.last() != Some(estimate) {
                layer.estimates.push(*estimate);
            }
            let (at, fused) = (layer.estimates.len() - 1, fused.map(|weighed| weighed.news));
            layer.readings.push(Kept { sequence, reading: *reading, fused, at, place, cleared_at });
        }
    }

    /// Saves what came since the last time.
    pub(crate) fn save(&mut self, parts: &mut Parts, grid: &Grid) -> JournalState {
        for (layer, count) in std::mem::take(&mut self.gone) {
            (0..count).for_each(|part| parts.remove(layer::name(layer, part)));
        }
        let last = self.layers.len() - 1;
        for ((number, layer), at) in (self.first..).zip(&mut self.layers).zip(0..) {
            layer.save(parts, number, (at == last).then_some(grid));
        }
        let counts = self.layers.iter().map(Layer::parts).collect();
        JournalState { first: self.first, left: self.left, parts: counts }
    }

    /// What was saved of a journal of at most so many readings in `grid`.
    ///
    /// # Errors
    /// A part of it is missing, or damaged.
    pub(crate) fn restore(
        readings_max: usize,
        saved: &Saved,
        state: JournalState,
        grid: &mut Grid,
    ) -> Result<Self, SavedError> {
        let layers = (state.first..).zip(state.parts).map(|(number, parts)| Layer::restore(saved, number, parts));
        let mut layers = layers.collect::<Result<VecDeque<_>, _>>()?;
        let last = layers.back_mut().ok_or_else(|| SavedError::new("remap", "no layers"))?;
        grid.resume_undo(std::mem::take(&mut last.before));
        Ok(Self { readings_max, layers, left: state.left, first: state.first, gone: Vec::new() })
    }
}

/// The estimates of all layers in hindsight; those that belong to another stretch between fixes stay as they are.
fn in_hindsight(layers: &mut VecDeque<Layer>, before: &Estimate, after: &Estimate) -> Option<()> {
    let here = |estimate: &&mut Estimate| estimate.fixes == before.fixes;
    let all = || layers.iter().flat_map(|layer| &layer.estimates).filter(|estimate| estimate.fixes == before.fixes);
    let way: Vec<Estimate> = all().copied().collect();
    let smoothed = smooth(&way, before, after)?;
    let slots = layers.iter_mut().flat_map(|layer| &mut layer.estimates).filter(here);
    slots.zip(smoothed).for_each(|(slot, smoothed)| *slot = smoothed);
    Some(())
}

impl GridMapper {
    /// The readings since the last fix are fused again where the robot was in hindsight, now that a fix has made `after` of
    /// the estimate `before`; call it before the first reading that `after` is for. Tiles that change get `revision`, which
    /// is to be higher than any before. A reading that was refused because the odometry was too uncertain has its second chance.
    ///
    /// Without [`crate::MapperConfig::remap`] nothing happens.
    pub fn rectify(&mut self, revision: u64, before: &Estimate, after: &Estimate) -> Remapped {
        let Some(mut journal) = self.recorders.journal.take() else { return Remapped::default() };
        let mut remapped = Remapped { left: journal.left, ..Remapped::default() };
        let mut layers = journal.take_layers(&mut self.grid);
        let kept: usize = layers.iter().map(|layer| layer.readings.len()).sum();
        if in_hindsight(&mut layers, before, after).is_some() {
            remapped.readings = kept as u64;
            self.fuse_again(revision, layers, &mut remapped.verdicts);
        } else {
            remapped.left += kept as u64;
        }
        self.grid.begin_undo();
        self.recorders.journal = Some(journal);
        remapped
    }

    fn fuse_again(&mut self, revision: u64, mut layers: VecDeque<Layer>, verdicts: &mut Vec<(u16, Verdict, Verdict)>) {
        let begun = self.grid.mark();
        // Of a tile that several layers changed the eldest knows how it was before them.
        for (index, tile) in layers.iter_mut().rev().flat_map(|layer| std::mem::take(&mut layer.before)) {
            self.grid.take_back(index, tile);
        }
        let first = layers.iter().flat_map(|layer| &layer.readings).next();
        self.driven.last = first.map_or(self.driven.last, |kept| kept.cleared_at);
        for Layer { estimates, readings, .. } in layers {
            let mut readings = readings.as_slice();
            while !readings.is_empty() {
                let (run, rest) = readings.split_at(self.run_of_kept(readings));
                self.fuse_run_again(run, &estimates, verdicts);
                readings = rest;
            }
        }
        for index in self.grid.changed_since(begun) {
            self.grid.tile_mut(index).revision = revision;
        }
    }
}

fn verdict_of<T>(fused: Result<T, Verdict>) -> Verdict {
    fused.err().unwrap_or(Verdict::Accepted)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::config::{Fusion, MapperConfig, Noise, OdometryConfig};
    use crate::gate::Gate;
    use crate::grid::{Plane, Tile, TileIndex};
    use crate::odometry::Odometry;
    use crate::odometry::fix::Fix;
    use crate::pose::Pose2;
    use crate::reading::{Echo, Reading};
    use crate::robot::{Robot, Sensor, SensorKind};
    use crate::verdict::VerdictCounts;

    fn robot() -> Robot {
        let sensor = Sensor {
            kind: SensorKind::Sonar,
            base_from_sensor: Pose2::new(0.2, 0.0, 1.0),
            first_transducer: 0,
            transducers: 2,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.7,
            aperture_rad: 0.5,
            range_min_m: 0.02,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        };
        Robot { sensors: vec![sensor], ..Robot::default() }
    }

    fn mapper(config: &MapperConfig) -> GridMapper {
        GridMapper::new(config, Noise::Sampled, 7, robot()).unwrap()
    }

    fn config(remap: bool) -> MapperConfig {
        // Soon at its bound, where evidence can't be subtracted.
        MapperConfig { remap, log_odds_max: 1.0, min_trust: 0.5, ..MapperConfig::default() }
    }

    /// Each estimate of 4 m straight on, and what the fix at the end makes of the last.
    fn way() -> (Vec<Estimate>, Estimate) {
        let mut odometry = Odometry::new(&OdometryConfig::default());
        let way = (0..=80).map(|step| odometry.step(Pose2::new(0.05 * f64::from(step), 0.0, 0.0))).collect();
        (way, odometry.apply(&Fix::certain(Pose2::new(3.9, 0.1, 0.05)), Gate::open()).unwrap())
    }

    fn hit(transducer: u16) -> Reading {
        Reading { transducer, echo: Echo::Hit { range_m: 1.5 }, offset_ns: 0 }
    }

    fn give(mapper: &mut GridMapper, first: u64, way: &[Estimate]) -> VerdictCounts {
        let mut counts = VerdictCounts::default();
        for (sequence, estimate) in (first..).zip(way) {
            (0..2).for_each(|transducer| counts.add(mapper.integrate(sequence, &hit(transducer), Some(estimate))));
        }
        counts
    }

    /// Every known cell, whatever tiles there are.
    fn cells(mapper: &GridMapper) -> Vec<(TileIndex, usize, u32)> {
        let cells = |(index, tile): (TileIndex, &Tile)| {
            let known = tile.log_odds.iter().enumerate().filter(|(_, value)| !value.is_nan());
            known.map(|(cell, value)| (index, cell, value.to_bits())).collect::<Vec<_>>()
        };
        mapper.grid().tiles().flat_map(cells).collect()
    }

    #[test]
    fn the_map_is_that_of_hindsight() {
        let (way, after) = way();
        let smoothed = smooth(&way, &way[80], &after).unwrap();
        for fusion in [Fusion::Paper, Fusion::Covariance, Fusion::FirstEcho, Fusion::Oriented] {
            let config = MapperConfig { fusion, ..config(true) };
            let mut remapped = mapper(&config);
            // What was there before the stretch stays.
            let elsewhere = vec![Estimate::certain(Pose2::new(2.0, 0.5, 3.0)); 5];
            let anew = Estimate { fixes: 1, ..elsewhere[0] };
            give(&mut remapped, 1, &elsewhere);
            assert_eq!(remapped.rectify(6, &elsewhere[4], &anew).readings, 10);
            let mut counts = give(&mut remapped, 6, &way);
            let mut expected = mapper(&MapperConfig { remap: false, ..config.clone() });
            give(&mut expected, 1, &elsewhere);
            let in_hindsight = give(&mut expected, 6, &smoothed);
            assert_ne!(cells(&remapped), cells(&expected));
            let told = remapped.rectify(1000, &way[80], &after);
            assert_eq!((told.readings, told.left), (162, 0));
            assert!(cells(&remapped) == cells(&expected), "{fusion:?}");
            told.verdicts.iter().for_each(|(_, before, now)| counts.change(*before, *now));
            assert_eq!(counts, in_hindsight);
            assert!(fusion == Fusion::Covariance || !told.verdicts.is_empty(), "nothing had a second chance");
        }
    }

    #[test]
    fn the_doubt_is_that_of_hindsight_and_the_map_none_the_worse() {
        let (way, after) = way();
        let smoothed = smooth(&way, &way[80], &after).unwrap();
        let means = |mapper: &GridMapper| -> Vec<(TileIndex, usize, u32)> {
            let cells = |(index, tile): (TileIndex, &Tile)| {
                let known = tile.plane(Plane::Doubt).unwrap().iter().enumerate().filter(|(_, value)| !value.is_nan());
                known.map(|(cell, value)| (index, cell, value.to_bits())).collect::<Vec<_>>()
            };
            mapper.grid().tiles().flat_map(cells).collect()
        };
        for fusion in [Fusion::Paper, Fusion::Covariance, Fusion::FirstEcho, Fusion::Oriented] {
            // Several layers, too.
            let config = MapperConfig { fusion, doubt: true, remap_readings_max: 400, ..config(true) };
            let elsewhere = vec![Estimate::certain(Pose2::new(2.0, 0.5, 3.0)); 5];
            let mut remapped = mapper(&config);
            give(&mut remapped, 1, &elsewhere);
            let anew = Estimate { fixes: 1, ..elsewhere[0] };
            remapped.rectify(6, &elsewhere[4], &anew);
            give(&mut remapped, 6, &way);
            let mut expected = mapper(&MapperConfig { remap: false, ..config.clone() });
            give(&mut expected, 1, &elsewhere);
            give(&mut expected, 6, &smoothed);
            assert_ne!(means(&remapped), means(&expected));
            assert_eq!(remapped.rectify(1000, &way[80], &after).readings, 162);
            assert!(means(&remapped) == means(&expected) && !means(&expected).is_empty(), "{fusion:?}");
            let mut without = mapper(&MapperConfig { doubt: false, ..config });
            give(&mut without, 1, &elsewhere);
            without.rectify(6, &elsewhere[4], &anew);
            give(&mut without, 6, &way);
            without.rectify(1000, &way[80], &after);
            assert!(cells(&without) == cells(&remapped));
            assert!(without.grid().tiles().all(|(_, tile)| tile.planes().count() == 0));
        }
    }

    #[test]
    fn a_constant_doubt_is_that_constant() {
        for fusion in [Fusion::Covariance, Fusion::FirstEcho, Fusion::Oriented] {
            let mut mapper = mapper(&MapperConfig { fusion, doubt: true, min_trust: 0.0, ..config(false) });
            let mut estimate = Estimate::certain(Pose2::new(2.0, 0.5, 3.0));
            (estimate.covariance[(0, 0)], estimate.covariance[(1, 1)]) = (0.01, 0.01);
            let way: Vec<Estimate> =
                (0..30).map(|n| Estimate { pose: Pose2::new(0.1 * f64::from(n), 0.5, 3.0), ..estimate }).collect();
            give(&mut mapper, 1, &way);
            let doubt = mapper.grid().tiles().flat_map(|(_, tile)| tile.plane(Plane::Doubt).unwrap());
            let cells = doubt.filter(|value| !value.is_nan());
            let (count, wrong) =
                cells.fold((0, 0), |(n, wrong), value| (n + 1, wrong + u32::from((value - 0.1).abs() > 1e-6)));
            assert!(count > 500 && wrong == 0, "{fusion:?}: {wrong} of {count}");
        }
    }

    /// Replayed, the kept readings come to every cell of the map, whatever fused them, and after a fix.
    #[test]
    fn the_kept_readings_tell_why() {
        let (way, after) = way();
        for fusion in [Fusion::Paper, Fusion::Covariance, Fusion::FirstEcho, Fusion::Oriented] {
            let config = MapperConfig { fusion, keep_readings: true, novelty_m: 0.3, ..config(true) };
            let mut mapper = mapper(&config);
            let check = |mapper: &GridMapper| {
                let kept = mapper.kept_readings().unwrap();
                assert_eq!((kept.iter().len(), kept.given_up()), (162, 0));
                let (all, shown) = (cells(mapper), mapper.shown());
                let mut moved = 0;
                for (index, offset, bits) in all.iter().step_by(all.len() / 7) {
                    let shown = shown.tile(*index).unwrap().log_odds[*offset];
                    let first = index.first_cell();
                    let (i, j) = (first.i + (offset % 64) as i32, first.j + (offset / 64) as i32);
                    let place = mapper.grid().centre(crate::grid::CellIndex { i, j });
                    let why = crate::why::why(&config, &robot(), kept.iter(), place).unwrap();
                    assert_eq!(why.log_odds.map(f32::to_bits), Some(shown.to_bits()), "{fusion:?} at {place:?}");
                    let own = f64::from(shown) - why.along_walls_added;
                    assert!((own - f64::from(f32::from_bits(*bits))).abs() < 1e-6, "{fusion:?} at {place:?}");
                    // Each begins where the last one ended, but for what the robot cleared.
                    let is_driven_over = why.driven_over > 0;
                    let mut log_odds = None;
                    for said in &why.said {
                        assert!(is_driven_over || said.before == log_odds);
                        let is_moved = said.after.map(f32::to_bits) != said.before.map(f32::to_bits);
                        assert_eq!(said.kept.verdict == Verdict::Accepted, is_moved);
                        log_odds = said.after;
                        moved += 1;
                    }
                    assert!(is_driven_over || log_odds.map(f32::to_bits) == Some(*bits));
                }
                assert!(moved > 20, "{moved}");
            };
            give(&mut mapper, 1, &way);
            check(&mapper);
            assert_eq!(mapper.rectify(1000, &way[80], &after).readings, 162);
            check(&mapper);
            let nowhere = crate::why::why(&config, &robot(), mapper.kept_readings().unwrap().iter(), [-50.0, 9.0]);
            assert_eq!(
                nowhere.unwrap(),
                crate::why::Why {
                    log_odds: None,
                    along_walls_added: 0.0,
                    driven_over: 0,
                    driven_added: 0.0,
                    said: Vec::new()
                }
            );
        }
    }

    #[test]
    fn whoever_follows_the_tiles_has_the_map() {
        let (way, after) = way();
        let mut mapper = mapper(&config(true));
        let mut copy: BTreeMap<TileIndex, Tile> = BTreeMap::new();
        let bits = |tile: &Tile| tile.log_odds.map(f32::to_bits);
        let is_same = |a: &Tile, b: &Tile| a.revision == b.revision && bits(a) == bits(b);
        let follow = |mapper: &mut GridMapper, copy: &mut BTreeMap<TileIndex, Tile>| {
            for index in mapper.take_changed() {
                let tile = mapper.shown_tile(index).unwrap().into_owned();
                let before = copy.insert(index, tile.clone());
                let is_new = |before: Tile| before.revision < tile.revision || is_same(&before, &tile);
                assert!(before.is_none_or(is_new), "revisions move forward");
            }
        };
        give(&mut mapper, 1, &way[..40]);
        follow(&mut mapper, &mut copy);
        give(&mut mapper, 41, &way[40..]);
        follow(&mut mapper, &mut copy);
        // Far enough for tiles that nothing is left of.
        let away = Estimate { pose: Pose2::new(2.6, 1.2, 0.9), ..after };
        assert_eq!(mapper.rectify(82, &way[80], &away).readings, 162);
        follow(&mut mapper, &mut copy);
        assert_eq!(copy.len(), mapper.grid().tile_count());
        assert!(mapper.shown().tiles().all(|(index, tile)| is_same(&copy[&index], tile)));
        // A second fix right after the first finds nothing to mend.
        assert_eq!(mapper.rectify(83, &after, &after), Remapped::default());
    }

    #[test]
    fn what_is_too_old_stays_and_is_counted() {
        let (way, after) = way();
        let mut bounded = mapper(&MapperConfig { remap_readings_max: 60, ..config(true) });
        give(&mut bounded, 1, &way);
        let told = bounded.rectify(100, &way[80], &after);
        assert_eq!(told.readings + told.left, 162);
        assert!((45..=60).contains(&told.readings), "{told:?}");
        let left = told.left as usize / 2;
        // As if the older ones had been mapped as they were, and the rest in hindsight.
        let smoothed = smooth(&way, &way[80], &after).unwrap();
        let mut expected = mapper(&config(false));
        give(&mut expected, 1, &way[..left]);
        let first = Reading { ..hit(0) };
        let rest = |at: usize| if at * 2 < told.left as usize { &way[at] } else { &smoothed[at] };
        if told.left % 2 == 1 {
            expected.integrate(left as u64 + 1, &first, Some(&way[left]));
            expected.integrate(left as u64 + 1, &hit(1), Some(&smoothed[left]));
        } else {
            give(&mut expected, left as u64 + 1, &[*rest(left)]);
        }
        give(&mut expected, left as u64 + 2, &smoothed[left + 1..]);
        assert!(cells(&bounded) == cells(&expected));
    }

    #[test]
    fn who_was_carried_off_leaves_the_map_alone() {
        let (way, after) = way();
        let mut mapper = mapper(&config(true));
        give(&mut mapper, 1, &way);
        let before = cells(&mapper);
        let elsewhere = Estimate { pose: Pose2::new(90.0, 0.0, 0.0), ..after };
        assert_eq!(mapper.rectify(100, &way[80], &elsewhere), Remapped { left: 162, ..Remapped::default() });
        assert!(before == cells(&mapper));
        // Without the setting nothing is kept, and nothing happens.
        let mut off = super::tests::mapper(&config(false));
        give(&mut off, 1, &way);
        assert_eq!(off.rectify(100, &way[80], &after), Remapped::default());
    }
}
