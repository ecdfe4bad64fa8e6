//! Algorithm 1: occupancy grid mapping.

mod saving;

use crate::config::{ConfigError, MapperConfig, Noise};
use crate::doubt::Doubt;
use crate::driven::Driven;
use crate::filter::{Chain, Channel, channels, range_of};
use crate::fusion::{Fuser, Sounding, Weighed};
use crate::grid::{DirtyTiles, Grid, TileIndex};
use crate::kept::{KeptReading, KeptReadings};
use crate::odometry::Estimate;
use crate::reading::Reading;
use crate::remap::Journal;
use crate::robot::Robot;
use crate::sonar_maps::SonarMaps;
use crate::verdict::Verdict;

pub use saving::RestoreError;

/// Fuses readings into an occupancy grid.
#[derive(Debug, Clone)]
pub struct GridMapper {
    config: MapperConfig,
    /// Of what it is made, in a number.
    settings: u32,
    channels: Vec<Option<Channel>>,
    chain: Chain,
    pub(crate) grid: Grid,
    fuser: Fuser,
    pub(crate) driven: Driven,
    pub(crate) dirty: DirtyTiles,
    /// What a fix may change; none if it may not.
    pub(crate) journal: Option<Journal>,
    /// None: not asked for.
    sonar_maps: Option<SonarMaps>,
    /// None: not asked for.
    pub(crate) doubt: Option<Doubt>,
    /// None: not asked for.
    pub(crate) kept: Option<KeptReadings>,
}

impl GridMapper {
    /// A mapper with an empty grid. `noise` and `seed` are those of the odometry configuration.
    ///
    /// # Errors
    /// When a value is out of range, a sonar is selected that the robot does not have, or a sensor of the robot is
    /// left without a range between its limits.
    pub fn new(mapper: &MapperConfig, noise: Noise, seed: u64, robot: Robot) -> Result<Self, ConfigError> {
        mapper.validate()?;
        let channels = channels(mapper, &robot)?;
        let mut grid = Grid::new(mapper.resolution_m);
        let mut doubt = mapper.doubt.then(|| Doubt::new(mapper.resolution_m, mapper.log_odds_prior));
        Ok(Self {
            config: mapper.clone(),
            settings: saving::settings(mapper, noise, seed, &robot),
            chain: Chain::new(mapper, &channels),
            channels,
            fuser: Fuser::new(mapper, noise, seed),
            driven: Driven::new(mapper, &robot),
            journal: mapper.remap.then(|| Journal::new(mapper.remap_readings_max as usize, &mut grid, doubt.as_mut())),
            grid,
            doubt,
            kept: mapper.keep_readings.then(|| KeptReadings::new(mapper.keep_readings_max as usize)),
            dirty: DirtyTiles::default(),
            sonar_maps: mapper.sonar_maps.then(|| SonarMaps::new(mapper.resolution_m)),
        })
    }

    /// The map so far.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// How much odometry error the evidence of each cell carried, metres: the mean of √(σ_z² − σ_z0²) of its readings, weighted by
    /// how far each moved the cell's log-odds. It changes in the tiles that the map changes in (their revision is the map's). None
    /// unless `doubt` is set.
    #[must_use]
    pub fn doubt(&self) -> Option<&Grid> {
        self.doubt.as_ref().map(Doubt::means)
    }

    /// The readings as they were fused last, with those that were refused though they told a range. None unless `keep_readings` is
    /// set.
    #[must_use]
    pub fn kept_readings(&self) -> Option<&KeptReadings> {
        self.kept.as_ref()
    }

    /// The tiles that changed since the last call, row by row. The revision of a tile is the sequence number of the
    /// ring that changed it last.
    pub fn take_dirty(&mut self) -> Vec<TileIndex> {
        self.dirty.take()
    }

    /// The map of a sonar, by its number: none unless `sonar_maps` is set, and while it heard nothing within its range.
    #[must_use]
    pub fn sonar_grid(&self, sonar: u16) -> Option<&Grid> {
        self.sonar_maps.as_ref()?.get(sonar)
    }

    /// The tiles of sonars' maps that changed since the last call, by sonar, row by row.
    pub fn take_dirty_of_sonars(&mut self) -> Vec<(u16, TileIndex)> {
        self.sonar_maps.as_mut().map(SonarMaps::take_dirty).unwrap_or_default()
    }

    /// The number of a transducer among the robot's sonars, if it is one: 0, 1, 2 … in the order of the transducers.
    #[must_use]
    pub fn sonar_of(&self, transducer: u16) -> Option<u16> {
        self.channel(transducer)?.sonar
    }

    /// Algorithm 1 of the paper, for one reading of ring `sequence`, which is judged by the filters that need no other.
    /// `estimate` is where the robot was when the reading was taken (the stamp of its scan plus the reading's own offset),
    /// if that is known.
    pub fn integrate(&mut self, sequence: u64, reading: &Reading, estimate: Option<&Estimate>) -> Verdict {
        let refusal = self.chain.refusal(&self.channels, reading);
        self.take_in(sequence, reading, estimate, refusal)
    }

    /// Algorithm 1 of the paper, for a whole scan, the ring `sequence`: each reading, and where the robot was when it was
    /// taken. All filters judge the scan, then what they left is fused. The verdicts are in the order of the readings.
    pub fn integrate_scan(&mut self, sequence: u64, scan: &[(Reading, Option<Estimate>)]) -> Vec<Verdict> {
        let refusals = self.chain.judge(&self.channels, scan);
        let fuse = |((reading, estimate), refusal): (&(Reading, Option<Estimate>), Option<Verdict>)| {
            self.take_in(sequence, reading, estimate.as_ref(), refusal)
        };
        scan.iter().zip(refusals).map(fuse).collect()
    }

    fn take_in(
        &mut self,
        sequence: u64,
        reading: &Reading,
        estimate: Option<&Estimate>,
        refusal: Option<Verdict>,
    ) -> Verdict {
        if let Some(journal) = &mut self.journal {
            journal.make_room(&mut self.grid, self.doubt.as_mut());
        }
        let cleared_at = self.driven.last;
        let fused = match refusal {
            Some(Verdict::NoEcho) if self.clears(reading) => self.fuse(sequence, reading, estimate, None),
            Some(refusal) => Err(refusal),
            None => self.fuse(sequence, reading, estimate, None),
        };
        if let Some((journal, estimate)) = self.journal.as_mut().zip(estimate) {
            let place = self.kept.as_ref().map_or(0, KeptReadings::next_place);
            journal.keep(sequence, reading, estimate, fused.map(|weighed| weighed.news), place, cleared_at);
        }
        if self.kept.is_some() {
            let kept = estimate.and_then(|estimate| self.as_kept(sequence, reading, estimate, fused));
            if let Some((all, kept)) = self.kept.as_mut().zip(kept) {
                all.push(kept);
            }
        }
        if self.sonar_maps.is_some() && self.chain.in_range(&self.channels, reading) {
            self.add_to_sonar_map(sequence, reading, estimate, fused);
        }
        fused.err().unwrap_or(Verdict::Accepted)
    }

    /// Whether a reading without an echo says something.
    fn clears(&self, reading: &Reading) -> bool {
        let is_told = |channel: Channel| self.config.no_echo.clears(self.config.fusion.of(channel.transducer.kind));
        self.channel(reading.transducer).is_some_and(|channel| channel.selected && is_told(channel))
    }

    /// What a sonar says goes into its own map whatever the filters that came after the range limits thought of it.
    fn add_to_sonar_map(
        &mut self,
        sequence: u64,
        reading: &Reading,
        estimate: Option<&Estimate>,
        fused: Result<Weighed, Verdict>,
    ) {
        let news = match fused {
            Ok(Weighed { news, .. }) => news,
            Err(Verdict::NotSelected | Verdict::Stuck | Verdict::Lone | Verdict::MultipleReflection) => 1.0,
            Err(_) => return,
        };
        let (Some(channel), Some(estimate)) =
            (self.channel(reading.transducer), estimate.filter(|e| e.pose.is_finite()))
        else {
            return;
        };
        let (Some(sonar), Ok(range_m), Some(maps)) = (channel.sonar, range_of(reading.echo), &mut self.sonar_maps)
        else {
            return;
        };
        let (grid, dirty) = maps.of(sonar);
        let (transducer, sensor, news) = (reading.transducer, &channel.transducer, Some(news));
        let sounding = Sounding { sequence, transducer, sensor, range_m: Some(range_m), estimate, news };
        // What is not trusted, or outside of what a map can hold, is so in the other too.
        let _ = self.fuser.add(grid, dirty, &sounding);
    }

    /// One reading that no filter refused. `news`: how much of it is new, if that was told before, which is what it tells.
    pub(crate) fn fuse(
        &mut self,
        sequence: u64,
        reading: &Reading,
        estimate: Option<&Estimate>,
        news: Option<f64>,
    ) -> Result<Weighed, Verdict> {
        // Is it an echo at all?
        let channel = self.channel(reading.transducer).ok_or(Verdict::Invalid)?;
        let clears = self.config.no_echo.clears(self.config.fusion.of(channel.transducer.kind));
        let range_m = match range_of(reading.echo) {
            Err(Verdict::NoEcho) if clears => None,
            heard => Some(heard?),
        };
        // Where was the robot then?
        let estimate = estimate.filter(|e| e.pose.is_finite()).ok_or(Verdict::NoPose)?;
        // How far to trust it, and what it says of every cell of its cone
        let (transducer, sensor) = (reading.transducer, &channel.transducer);
        let sounding = Sounding { sequence, transducer, sensor, range_m, estimate, news };
        let Self { grid, driven, .. } = self;
        let mut touched = DirtyTiles::default();
        let into = if self.doubt.is_some() { &mut touched } else { &mut self.dirty };
        let mut weighed = self.fuser.add(grid, into, &sounding)?;
        // Where the robot is, nothing is
        weighed.cleared_m = driven.radius_m(estimate);
        driven.clear(grid, into, [estimate.pose.x, estimate.pose.y], weighed.cleared_m, sequence);
        let Some(doubt) = &mut self.doubt else { return Ok(weighed) };
        for index in touched.take() {
            if let Some(tile) = self.grid.tile(index) {
                doubt.gather(index, tile, weighed.doubt_m);
            }
            self.dirty.insert(index);
        }
        Ok(weighed)
    }

    /// A reading as it was fused, or as it would have been if it was refused for what it tells.
    pub(crate) fn as_kept(
        &self,
        sequence: u64,
        reading: &Reading,
        estimate: &Estimate,
        fused: Result<Weighed, Verdict>,
    ) -> Option<KeptReading> {
        let (pose, reading) = (estimate.pose, *reading);
        match fused {
            Ok(Weighed { deviations, news, cleared_m, .. }) => {
                let verdict = Verdict::Accepted;
                Some(KeptReading { sequence, reading, pose, deviations, news, verdict, cleared_m })
            }
            Err(Verdict::Accepted | Verdict::Invalid | Verdict::NoEcho | Verdict::NoPose | Verdict::Held) => None,
            Err(verdict) => {
                let channel = self.channel(reading.transducer).filter(|_| pose.is_finite())?;
                let (transducer, sensor) = (reading.transducer, &channel.transducer);
                let range_m = range_of(reading.echo).ok();
                let sounding = Sounding { sequence, transducer, sensor, range_m, estimate, news: None };
                let deviations = self.fuser.deviations(&sounding);
                Some(KeptReading { sequence, reading, pose, deviations, news: 0.0, verdict, cleared_m: 0.0 })
            }
        }
    }

    fn channel(&self, transducer: u16) -> Option<Channel> {
        self.channels.get(usize::from(transducer)).copied().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Fusion, Limit, LimitWord, NoEcho, SonarSelection};
    use crate::grid::CellIndex;
    use crate::odometry::OdometryErrors;
    use crate::pose::Pose2;
    use crate::reading::Echo;
    use crate::robot::{Sensor, SensorKind};

    fn sensor(kind: SensorKind, first_transducer: u16, transducers: u16, mount: Pose2) -> Sensor {
        Sensor {
            kind,
            base_from_sensor: mount,
            first_transducer,
            transducers,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.01,
            aperture_rad: if kind == SensorKind::Sonar { core::f64::consts::PI / 6.0 } else { 0.01 },
            range_min_m: 0.02,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
        }
    }

    /// Sonar 0 (front), a lidar of three beams (1, 2, 3), sonars 4 (left) and 5 (rear).
    fn robot() -> Robot {
        let mount = |bearing: f64| Pose2::new(0.0, 0.0, bearing) * Pose2::new(0.2, 0.0, 0.0);
        let quarter = core::f64::consts::FRAC_PI_2;
        Robot {
            sensors: vec![
                sensor(SensorKind::Sonar, 0, 1, mount(0.0)),
                sensor(SensorKind::Lidar, 1, 3, Pose2::IDENTITY),
                sensor(SensorKind::Sonar, 4, 1, mount(quarter)),
                sensor(SensorKind::Sonar, 5, 1, mount(2.0 * quarter)),
            ],
            ..Robot::default()
        }
    }

    /// The paper's rule, which depends on the seed.
    fn papers() -> MapperConfig {
        MapperConfig { fusion: Fusion::Paper, ..MapperConfig::default() }
    }

    fn mapper(change: impl FnOnce(&mut MapperConfig)) -> Result<GridMapper, ConfigError> {
        let mut config = papers();
        change(&mut config);
        GridMapper::new(&config, Noise::Sampled, 7, robot())
    }

    fn hit(transducer: u16, range_m: f64) -> Reading {
        Reading { transducer, echo: Echo::Hit { range_m }, offset_ns: 0 }
    }

    fn here() -> Estimate {
        Estimate::certain(Pose2::IDENTITY)
    }

    fn lost() -> Estimate {
        let errors = OdometryErrors { eps_lin_m2: 100.0, eps_ang_rad2: 100.0, ..OdometryErrors::default() };
        Estimate { errors, ..here() }
    }

    /// The verdict on one reading by a fresh mapper; whatever is refused must leave the grid alone.
    fn check(change: impl FnOnce(&mut MapperConfig), reading: Reading, estimate: Option<Estimate>, expected: Verdict) {
        let mut mapper = mapper(change).unwrap();
        assert_eq!(mapper.integrate(1, &reading, estimate.as_ref()), expected, "{reading:?}");
        assert_eq!(mapper.grid().tile_count() > 0, expected == Verdict::Accepted, "{reading:?}");
        assert_eq!(!mapper.take_dirty().is_empty(), expected == Verdict::Accepted, "{reading:?}");
    }

    #[test]
    fn each_verdict() {
        let echo = |echo| Reading { transducer: 0, echo, offset_ns: 0 };
        let off_map = Estimate::certain(Pose2::new(1e12, 0.0, 0.0));
        let nowhere = Estimate::certain(Pose2 { x: f64::NAN, y: 0.0, theta: 0.0 });
        check(|_| {}, hit(0, 2.0), Some(here()), Verdict::Accepted);
        check(|_| {}, echo(Echo::NoEcho), Some(here()), Verdict::NoEcho);
        check(|_| {}, echo(Echo::Invalid), Some(here()), Verdict::Invalid);
        for no_range in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            check(|_| {}, hit(0, no_range), Some(here()), Verdict::Invalid);
        }
        check(|_| {}, hit(6, 2.0), Some(here()), Verdict::Invalid);
        check(|_| {}, hit(u16::MAX, 2.0), Some(here()), Verdict::Invalid);
        check(|_| {}, hit(0, 2.0), None, Verdict::NoPose);
        check(|_| {}, hit(0, 2.0), Some(nowhere), Verdict::NoPose);
        check(|_| {}, hit(0, 2.0), Some(off_map), Verdict::OffMap);
    }

    #[test]
    fn range_limits_of_a_sonar_are_the_papers() {
        check(|_| {}, hit(0, 0.149), Some(here()), Verdict::BelowMinimum);
        check(|_| {}, hit(0, 0.15), Some(here()), Verdict::Accepted);
        check(|_| {}, hit(0, 4.0), Some(here()), Verdict::Accepted);
        check(|_| {}, hit(0, 4.001), Some(here()), Verdict::AboveMaximum);
    }

    #[test]
    fn range_limits_of_a_lidar_are_its_own() {
        check(|_| {}, hit(2, 0.019), Some(here()), Verdict::BelowMinimum);
        check(|_| {}, hit(2, 5.0), Some(here()), Verdict::Accepted);
        check(|_| {}, hit(2, 5.001), Some(here()), Verdict::AboveMaximum);
    }

    #[test]
    fn range_limits_in_metres_hold_for_all() {
        let limits = |c: &mut MapperConfig| {
            c.min_range_m = Limit::Metres(1.0);
            c.max_range_m = Limit::Metres(3.0);
        };
        for transducer in [0, 2] {
            check(limits, hit(transducer, 0.9), Some(here()), Verdict::BelowMinimum);
            check(limits, hit(transducer, 3.1), Some(here()), Verdict::AboveMaximum);
            check(limits, hit(transducer, 2.0), Some(here()), Verdict::Accepted);
        }
    }

    #[test]
    fn limits_that_leave_no_range_are_refused() {
        let wrong = mapper(|c| {
            c.min_range_m = Limit::Metres(4.5);
            c.max_range_m = Limit::Word(LimitWord::Auto);
        });
        assert_eq!(wrong.unwrap_err().key, "min_range_m");
    }

    #[test]
    fn selection_counts_sonars_and_spares_lidars() {
        let first_and_last = |c: &mut MapperConfig| c.sonars = SonarSelection::Numbers(vec![0, 2]);
        check(first_and_last, hit(0, 2.0), Some(here()), Verdict::Accepted);
        check(first_and_last, hit(2, 2.0), Some(here()), Verdict::Accepted);
        check(first_and_last, hit(4, 2.0), Some(here()), Verdict::NotSelected);
        check(first_and_last, hit(5, 2.0), Some(here()), Verdict::Accepted);
        let wrong = mapper(|c| c.sonars = SonarSelection::Numbers(vec![0, 3])).unwrap_err();
        assert_eq!((wrong.key, wrong.value.as_str()), ("sonars", "3"));
    }

    #[test]
    fn a_wrong_value_is_refused() {
        assert_eq!(mapper(|c| c.p_free = 0.9).unwrap_err().key, "p_free");
    }

    #[test]
    fn a_lost_robot_maps_nothing() {
        check(|c| c.min_trust = 0.02, hit(0, 2.0), Some(lost()), Verdict::Untrusted);
        let errors = OdometryErrors { eps_lin_m2: f64::INFINITY, ..OdometryErrors::default() };
        check(|c| c.min_trust = 0.0, hit(0, 2.0), Some(Estimate { errors, ..here() }), Verdict::Untrusted);
        let errors = OdometryErrors { eps_lin_m2: f64::NAN, ..OdometryErrors::default() };
        check(|c| c.min_trust = 0.0, hit(0, 2.0), Some(Estimate { errors, ..here() }), Verdict::Untrusted);
    }

    #[test]
    fn a_wall_ahead_is_found_and_the_way_to_it_is_free() {
        let mut mapper = mapper(|_| {}).unwrap();
        for sequence in 1..=5 {
            assert_eq!(mapper.integrate(sequence, &hit(0, 2.0), Some(&here())), Verdict::Accepted);
        }
        let at = |x: f64, y: f64| mapper.grid().log_odds(mapper.grid().cell_at(x, y));
        assert!(at(2.21, 0.01).unwrap() > 2.0, "the sonar sits 0.2 m ahead of the base");
        assert!(at(1.0, 0.01).unwrap() < -1.0);
        assert_eq!(at(2.5, 0.01), None);
        assert_eq!(at(-0.5, 0.01), None);
    }

    #[test]
    fn dirty_tiles_and_revisions_follow_the_rings() {
        let mut mapper = mapper(|_| {}).unwrap();
        mapper.integrate(3, &hit(0, 2.0), Some(&here()));
        let first = mapper.take_dirty();
        assert!(!first.is_empty() && first.is_sorted());
        mapper.integrate(4, &hit(5, 2.0), Some(&here()));
        let second = mapper.take_dirty();
        for (index, tile) in mapper.grid().tiles() {
            assert_eq!(tile.revision, if second.contains(&index) { 4 } else { 3 });
            assert!(first.contains(&index) || second.contains(&index));
        }
        assert!(mapper.take_dirty().is_empty());
    }

    #[test]
    fn the_same_readings_give_the_same_bytes() {
        let map = |seed: u64| {
            let mut mapper = GridMapper::new(&papers(), Noise::Sampled, seed, robot()).unwrap();
            let errors = OdometryErrors { eps_lin_m2: 1e-3, eps_ang_rad2: 1e-3, ..OdometryErrors::default() };
            for sequence in 0..20 {
                let pose = Pose2::new(0.03 * sequence as f64, 0.0, 0.05 * sequence as f64);
                for transducer in 0..6 {
                    mapper.integrate(
                        sequence,
                        &hit(transducer, 1.7),
                        Some(&Estimate { errors, ..Estimate::certain(pose) }),
                    );
                }
            }
            let mut bytes = Vec::new();
            for (_, tile) in mapper.grid().tiles() {
                bytes.extend(tile.log_odds.iter().flat_map(|value| value.to_le_bytes()));
            }
            bytes
        };
        assert!(map(1) == map(1));
        assert!(map(1) != map(2));
    }

    #[test]
    fn one_sigma_does_not_depend_on_the_seed() {
        let map = |seed: u64| {
            let mut mapper = GridMapper::new(&papers(), Noise::OneSigma, seed, robot()).unwrap();
            let errors = OdometryErrors { eps_lin_m2: 1e-3, eps_ang_rad2: 1e-3, ..OdometryErrors::default() };
            mapper.integrate(1, &hit(0, 2.0), Some(&Estimate { errors, ..here() }));
            mapper.grid().log_odds(CellIndex { i: 44, j: 0 })
        };
        assert!(map(1).is_some());
        assert_eq!(map(1), map(2));
    }

    /// Nothing came back: whoever asks for it learns that the cone is rather empty, out to its end and no farther.
    #[test]
    fn no_echo_may_clear() {
        for fusion in [Fusion::Paper, Fusion::Covariance, Fusion::FirstEcho] {
            let mut mapper = mapper(|config| (config.fusion, config.no_echo) = (fusion, NoEcho::Clear)).unwrap();
            let nothing = Reading { echo: Echo::NoEcho, ..hit(0, 1.0) };
            assert_eq!(mapper.integrate(1, &nothing, Some(&here())), Verdict::Accepted, "{fusion:?}");
            let at = |x: f64| mapper.grid().log_odds(mapper.grid().cell_at(x, 0.01));
            assert!(at(1.0).unwrap() < 0.0 && at(1.0).unwrap() > -0.1, "{fusion:?}: a weak word: {:?}", at(1.0));
            assert!(at(5.1).unwrap() <= 0.0 && at(5.3).is_none(), "{fusion:?}");
            assert!(
                mapper.grid().tiles().all(|(_, tile)| tile.log_odds.iter().all(|cell| cell.is_nan() || *cell <= 0.0))
            );
        }
    }

    /// Where walls that mirror are part of the rule, nothing came back says it by itself, and not to the end.
    #[test]
    fn no_echo_clears_where_walls_mirror() {
        let config = MapperConfig { fusion: Fusion::Oriented, ..MapperConfig::default() };
        let mut mapper = GridMapper::new(&config, Noise::Sampled, 7, robot()).unwrap();
        let nothing = Reading { echo: Echo::NoEcho, ..hit(0, 1.0) };
        assert_eq!(mapper.integrate(1, &nothing, Some(&here())), Verdict::Accepted);
        let at = |x: f64| mapper.grid().log_odds(mapper.grid().cell_at(x, 0.01));
        assert!(at(1.0).unwrap() < 0.0, "{:?}", at(1.0));
        assert!(at(2.6).unwrap() < 0.0 && at(2.8).is_none(), "{:?} {:?}", at(2.6), at(2.8));
    }

    /// Ten minutes at 25 Hz change no cell more than their first second did.
    #[test]
    fn standing_still_adds_no_certainty() {
        for fusion in [Fusion::Paper, Fusion::Covariance, Fusion::FirstEcho, Fusion::Oriented] {
            let mut mapper = mapper(|config| config.fusion = fusion).unwrap();
            let mut stand = |rings: core::ops::Range<u64>| {
                rings.for_each(|ring| {
                    assert_eq!(mapper.integrate(ring, &hit(0, 2.0), Some(&here())), Verdict::Accepted)
                });
                mapper.grid().clone()
            };
            let (second, minutes) = (stand(1..26), stand(26..15_001));
            let probability = |cell: f32| crate::log_odds::probability_of(f64::from(cell));
            for ((_, first), (_, last)) in second.tiles().zip(minutes.tiles()) {
                for (first, last) in first.log_odds.iter().zip(last.log_odds.iter()).filter(|(f, _)| !f.is_nan()) {
                    let (first, last) = (probability(*first), probability(*last));
                    assert!((last - first).abs() <= (first - 0.5).abs() + 1e-6, "{fusion:?}: {first} {last}");
                }
            }
        }
    }
}
