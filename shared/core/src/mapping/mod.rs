//! Algorithm 1 of the paper: occupancy grid mapping.

pub(crate) mod doubt;
pub(crate) mod driven;
pub mod foretell;
mod going_on;
pub mod kept;
mod locate;
mod recorders;
pub mod remap;
mod run;
mod saving;
mod shown;
pub(crate) mod sonar_maps;
pub mod why;

use std::sync::Arc;

use crate::config::{ConfigError, MapperConfig, Noise, OdometryConfig};
use crate::driven::Driven;
use crate::filter::{Chain, Channel, channels};
use crate::fusion::{Fuser, Sounding, Weighed};
use crate::grid::{Grid, Mark, TileIndex};
use crate::kept::KeptReadings;
use crate::odometry::Estimate;
use crate::reading::Reading;
use crate::robot::Robot;
use crate::sensor_model::Cone;
use crate::sonar_maps::SonarMaps;
use crate::summary::RunningSummary;
use crate::verdict::Verdict;
use locate::{channel_of, locate};
use recorders::Recorders;
use shown::ShownLately;

pub use saving::RestoreError;

/// Fuses readings into an occupancy grid.
///
/// ```
/// use echogrid_core::{Echo, Estimate, GridMapper, MapperConfig, Pose2, Reading, Robot, Sensor, SensorKind, Verdict};
///
/// // A robot with one sonar, which looks ahead from 0.2 m before the base.
/// let sonar = Sensor {
///     kind: SensorKind::Sonar,
///     base_from_sensor: Pose2::new(0.2, 0.0, 0.0),
///     first_transducer: 0,
///     transducers: 1,
///     first_bearing_rad: 0.0,
///     bearing_step_rad: 0.0,
///     aperture_rad: 0.52,
///     range_min_m: 0.15,
///     range_max_m: 5.0,
///     range_error_ratio: 0.01,
/// };
/// let robot = Robot { sensors: vec![sonar], ..Robot::default() };
/// let mut mapper = GridMapper::with_defaults_of_odometry(&MapperConfig::default(), robot)?;
///
/// // A wall, 2 m from the sonar, heard from a pose that is known.
/// let reading = Reading { transducer: 0, echo: Echo::Hit { range_m: 2.0 }, offset_ns: 0 };
/// let verdicts = mapper.integrate_scan(1, &[(reading, Some(Estimate::certain(Pose2::IDENTITY)))]);
/// assert_eq!(verdicts, [Verdict::Accepted]);
///
/// let grid = mapper.grid();
/// let log_odds = |x| grid.log_odds(grid.cell_at(x, 0.0));
/// assert!(log_odds(2.2) > log_odds(1.0), "the wall is likelier than the way to it");
/// assert_eq!(log_odds(4.0), None, "behind it nothing is known");
/// # Ok::<(), echogrid_core::ConfigError>(())
/// ```
#[derive(Debug, Clone)]
pub struct GridMapper {
    /// Of what it is made, in a number.
    settings: u32,
    channels: Arc<[Option<Channel>]>,
    chain: Chain,
    pub(crate) fuser: Fuser,
    pub(crate) driven: Driven,
    pub(crate) grid: Grid,
    /// When its changes were taken last.
    taken: Mark,
    summary: RunningSummary,
    lately: ShownLately,
    pub(crate) recorders: Recorders,
    /// Of a scan; kept for its memory.
    beams: Vec<(u16, Cone)>,
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
        Ok(Self {
            settings: saving::settings(mapper, noise, seed, &robot),
            chain: Chain::new(mapper, &channels),
            channels: channels.into(),
            fuser: Fuser::new(mapper, noise, seed),
            driven: Driven::new(mapper, &robot),
            recorders: Recorders::new(mapper, &mut grid),
            beams: Vec::new(),
            grid,
            taken: Mark::default(),
            summary: RunningSummary::default(),
            lately: ShownLately::default(),
        })
    }

    /// A mapper with an empty grid that needs no settings of the odometry: the noise rule and the seed of eqs 22, 23 are the defaults.
    ///
    /// # Errors
    /// As [`GridMapper::new`].
    pub fn with_defaults_of_odometry(mapper: &MapperConfig, robot: Robot) -> Result<Self, ConfigError> {
        let OdometryConfig { noise, seed, .. } = OdometryConfig::default();
        Self::new(mapper, noise, seed, robot)
    }

    /// Algorithm 1 of the paper, for a whole scan, the ring `sequence`: each reading, and where the robot was when it was
    /// taken (the stamp of the scan plus the reading's own offset), if that is known. All filters judge the scan, then what they
    /// left is fused. The verdicts are in the order of the readings.
    pub fn integrate_scan(&mut self, sequence: u64, scan: &[(Reading, Option<Estimate>)]) -> Vec<Verdict> {
        // Judge: which are echoes that can be believed?
        let refusals = self.chain.judge(&self.channels, scan);
        let mut verdicts = Vec::with_capacity(scan.len());
        let (mut scan, mut refusals) = (scan, refusals.as_slice());
        while let ([(reading, estimate), ..], [refusal, ..]) = (scan, refusals) {
            let together = self.run_of(scan).min(refusals.len());
            if together > 1 {
                verdicts.extend(self.integrate_run(sequence, &scan[..together], &refusals[..together]));
            } else {
                verdicts.push(self.integrate_judged(sequence, reading, estimate.as_ref(), *refusal));
            }
            (scan, refusals) = (&scan[together..], &refusals[together..]);
        }
        verdicts
    }

    /// Integrates one reading as [`GridMapper::integrate_scan`] does a scan; it is judged by the filters that need no other.
    pub fn integrate(&mut self, sequence: u64, reading: &Reading, estimate: Option<&Estimate>) -> Verdict {
        let refusal = self.chain.refusal(&self.channels, reading);
        self.integrate_judged(sequence, reading, estimate, refusal)
    }

    /// One judged reading: where the robot was, then what [`GridMapper::fuse`] makes of it; recorders look on.
    fn integrate_judged(
        &mut self,
        sequence: u64,
        reading: &Reading,
        estimate: Option<&Estimate>,
        refusal: Option<Verdict>,
    ) -> Verdict {
        self.recorders.begin_readings(&mut self.grid, 1);
        // Where was the robot when it was taken?
        let channels = Arc::clone(&self.channels);
        let (sounding, cleared_at) = (locate(&channels, sequence, reading, estimate), self.driven.last);
        let fused = refusal.map_or(sounding, Err).and_then(|sounding| self.fuse(&sounding, None));
        if let Ok(sounding) = &sounding {
            self.recorders.end_reading(sounding, fused, cleared_at, &mut self.fuser);
        }
        fused.err().unwrap_or(Verdict::Accepted)
    }

    /// The inner of Algorithm 1, for one reading. `news`: how much of it is new, if that was told when it was fused before.
    ///
    /// # Errors
    /// The verdict on a reading that is not to be trusted or leaves the map; nothing is changed then.
    pub(crate) fn fuse(&mut self, sounding: &Sounding<'_>, news: Option<f64>) -> Result<Weighed, Verdict> {
        // How far is it to be trusted? (Eqs 22, 23)
        let mut weighed = self.fuser.weigh(sounding, news)?;
        // What does it say of each cell of its cone? (Eq 21)
        let model = self.fuser.inverse_sensor_model(sounding, weighed.deviations, weighed.news);
        // Add that. (Eq 20, as log-odds: line 3 of Algorithm 1)
        self.recorders.begin_change(&mut self.grid);
        self.fuser.add(&mut self.grid, sounding, &model)?;
        // Where the robot is, nothing is.
        weighed.cleared_m = self.driven.clear(&mut self.grid, sounding.estimate, sounding.sequence);
        self.recorders.end_change(&mut self.grid, &weighed);
        Ok(weighed)
    }
}

/// What came of it.
impl GridMapper {
    /// The map so far, as it was fused; [`GridMapper::shown`] is what it shows. With [`MapperConfig::doubt`] each tile has the plane [`crate::grid::Plane::Doubt`]: how much odometry error
    /// the evidence of each cell carried, metres, the mean of √(σ_z² − σ_z0²) of its readings, weighted by how far each moved the
    /// cell's log-odds.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The readings as they were fused last, with those that were refused though they told a range. None unless `keep_readings` is
    /// set.
    #[must_use]
    pub fn kept_readings(&self) -> Option<&KeptReadings> {
        self.recorders.kept.as_ref()
    }

    /// The map of a sonar, by its number: none unless `sonar_maps` is set, and while it heard nothing within its range.
    #[must_use]
    pub fn sonar_grid(&self, sonar: u16) -> Option<&Grid> {
        self.recorders.sonar_maps.as_ref()?.get(sonar)
    }

    /// The tiles of sonars' maps that changed since the last call, by sonar, row by row.
    pub fn take_changed_of_sonars(&mut self) -> Vec<(u16, TileIndex)> {
        self.recorders.sonar_maps.as_mut().map(SonarMaps::take_changed).unwrap_or_default()
    }

    /// The number of a transducer among the robot's sonars, if it is one: 0, 1, 2 … in the order of the transducers.
    #[must_use]
    pub fn sonar_of(&self, transducer: u16) -> Option<u16> {
        channel_of(&self.channels, transducer)?.sonar
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
        assert_eq!(!mapper.take_changed().is_empty(), expected == Verdict::Accepted, "{reading:?}");
    }

    #[test]
    fn each_verdict() {
        let echo = |echo| Reading { echo, ..hit(0, 1.0) };
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
    fn changed_tiles_and_revisions_follow_the_rings() {
        let mut mapper = mapper(|_| {}).unwrap();
        mapper.integrate(3, &hit(0, 2.0), Some(&here()));
        let first = mapper.take_changed();
        assert!(!first.is_empty() && first.is_sorted());
        mapper.integrate(4, &hit(5, 2.0), Some(&here()));
        let second = mapper.take_changed();
        for (index, tile) in mapper.grid().tiles() {
            assert_eq!(tile.revision, if second.contains(&index) { 4 } else { 3 });
            assert!(first.contains(&index) || second.contains(&index));
        }
        assert!(mapper.take_changed().is_empty());
    }

    #[test]
    fn the_same_readings_give_the_same_bytes() {
        let map = |seed: u64| {
            let mut mapper = GridMapper::new(&papers(), Noise::Sampled, seed, robot()).unwrap();
            let errors = OdometryErrors { eps_lin_m2: 1e-3, eps_ang_rad2: 1e-3, ..OdometryErrors::default() };
            for sequence in 0..20 {
                let pose = Pose2::new(0.03 * sequence as f64, 0.0, 0.05 * sequence as f64);
                for transducer in 0..6 {
                    let estimate = Estimate { errors, ..Estimate::certain(pose) };
                    mapper.integrate(sequence, &hit(transducer, 1.7), Some(&estimate));
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
        // What is nearer may have been in the way of what is far, and unknown.
        assert!(at(2.0).unwrap() < 0.0, "{:?}", at(2.0));
        assert!(at(3.6).unwrap() <= 0.0 && at(3.8).is_none(), "{:?} {:?}", at(3.6), at(3.8));
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
                    let most = (first - 0.5).abs().max(0.02);
                    assert!((last - first).abs() <= most + 1e-6, "{fusion:?}: {first} {last}");
                }
            }
        }
    }
}
