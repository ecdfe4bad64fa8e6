//! How probable a map held each echo before it took it: by that a sensor model can be learnt from a drive, without any truth.
//!
//! The kept readings are fused once more by the oriented model ([`crate::oriented`]), and each echo is asked of the map first:
//!
//! p(z | an echo between the limits) = (Σ_i a_i S_i L_i(z) + c) / (1 − S_n + c (z_max − z_min)), over the cells between the limits,
//!
//! which sums to 1 over z (but for what σ_z carries over the limits), so that no parameter is favoured for itself. Distances are told
//! apart by a centimetre.

use core::f64::consts::TAU;

use crate::config::{ConfigError, Fusion, MapperConfig, Noise};
use crate::driven::Driven;
use crate::filter::{Channel, channels, range_of};
use crate::fusion::{Fuser, InverseSensorModel, Sounding};
use crate::grid::Grid;
use crate::kept::KeptReading;
use crate::kernel::{OrientedCone, OrientedKernel};
use crate::odometry::Estimate;
use crate::oriented::{DIRECTIONS, Response, STATES};
use crate::robot::Robot;
use crate::sensor_model::Deviations;
use crate::verdict::Verdict;

/// Distances are told apart by so much, metres: a fraction of the least σ_z.
const BIN_M: f64 = 0.01;
/// Directions of rays are told apart by so many in a turn.
const RAYS: usize = 720;
/// Farther off than so many deviations an echo is nobody's, in (Σ a S L).
const FAR: f64 = 6.0;

/// What a map held of an echo before it took it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foretold {
    /// The place of the reading among those that were given.
    pub place: usize,
    /// ln p(z | an echo), of z in metres; nat.
    pub ln_density: f64,
    /// How much of the reading is new, in (0, 1].
    pub news: f64,
}

/// Asks a map of each sonar echo before it takes it: a map that is made anew of `readings` of a robot, but as if that were `tried`, whose
/// sensors are the same up to [`crate::Sensor::range_error_ratio`], by the oriented model with the parameters of `config`. A new map is
/// begun at each place of `begins`, which rise. Only each `every`-th echo (from 1) is asked about; all are taken.
///
/// # Errors
/// The configuration is out of range or does not fit the robot.
pub fn foretell(
    config: &MapperConfig,
    [robot, tried]: [&Robot; 2],
    readings: &[KeptReading],
    begins: &[usize],
    every: usize,
) -> Result<Vec<Foretold>, ConfigError> {
    let config = MapperConfig { fusion: Fusion::Oriented, ..config.clone() };
    config.validate()?;
    let (channels, of_drive) = (channels(&config, tried)?, channels(&config, robot)?);
    // No noise is drawn: the deviations are told.
    let mut fuser = Fuser::new(&config, Noise::OneSigma, 0);
    let driven = Driven::new(&config, robot);
    let expectation = Expectation::new(&config);
    let (mut foretold, mut bins, mut echoes) = (Vec::new(), Vec::new(), 0);
    let mut grid = Grid::new(config.resolution_m);
    let mut begins = begins.iter().copied().peekable();
    for (place, kept) in readings.iter().enumerate() {
        if begins.next_if(|begin| *begin <= place).is_some() {
            grid = Grid::new(config.resolution_m);
        }
        let transducer = usize::from(kept.reading.transducer);
        let [channel, was] = [&channels, &of_drive].map(|all| all.get(transducer).and_then(Option::as_ref));
        let (Some(channel), Some(was)) = (channel, was) else { continue };
        if channel.sonar.is_none() || kept.verdict != Verdict::Accepted {
            continue;
        }
        let estimate = Estimate::certain(kept.pose);
        let range_m = range_of(kept.reading.echo).ok();
        let sounding =
            Sounding { sequence: kept.sequence, reading: &kept.reading, channel, range_m, estimate: &estimate };
        let own_m = |channel| fuser.own_deviation_m(&Sounding { channel, ..sounding });
        let (sigma_m, was_m, own_m) = (kept.deviations.sigma_z_m, own_m(was), own_m(channel));
        let doubt_m2 = (sigma_m * sigma_m - was_m * was_m).max(0.0);
        let deviations = Deviations { sigma_z_m: (own_m * own_m + doubt_m2).sqrt(), ..kept.deviations };
        let model = fuser.inverse_sensor_model(&sounding, deviations, kept.news);
        if let (InverseSensorModel::Oriented(cone), Some(range_m)) = (&model, range_m) {
            echoes += 1;
            if echoes % every.max(1) == 0 {
                let ln_density = expectation.ask(&grid, &sounding, cone, range_m, &mut bins);
                foretold.push(Foretold { place, ln_density, news: kept.news });
            }
        }
        let _ = fuser.add(&mut grid, &sounding, &model);
        driven.clear_disc(&mut grid, [kept.pose.x, kept.pose.y], kept.cleared_m, kept.sequence);
    }
    Ok(foretold)
}

/// What a map expects of echoes.
struct Expectation {
    kernel: OrientedKernel,
    /// g of each state along rays of each direction.
    shares: Vec<[f64; STATES]>,
}

impl Expectation {
    fn new(config: &MapperConfig) -> Self {
        let critical_rad = config.oriented_incidence_deg.to_radians();
        let kernel =
            OrientedKernel::new(config.log_odds_prior, config.log_odds_max, config.oriented_diffuse, critical_rad);
        let response = Response::new(critical_rad, DIRECTIONS);
        let of_ray = |ray: usize| {
            let ray_rad = TAU * ray as f64 / RAYS as f64;
            core::array::from_fn(|state| if state == 0 { 1.0 } else { response.share(state - 1, ray_rad) })
        };
        Self { kernel, shares: (0..RAYS).map(of_ray).collect() }
    }

    /// ln p(z | an echo) of a reading by the map so far. `bins` is room.
    fn ask(&self, grid: &Grid, sounding: &Sounding<'_>, cone: &OrientedCone, range_m: f64, bins: &mut Vec<f64>) -> f64 {
        let Channel { min_range_m, max_range_m, .. } = *sounding.channel;
        let max_range_m = max_range_m.min(cone.reading.range_cap_m);
        self.look(grid, sounding, cone, max_range_m, bins);
        let (sigma_m, clutter) = (cone.reading.sigma_z_m, cone.reading.clutter / cone.reading.range_cap_m);
        let peak = 1.0 / (sigma_m * TAU.sqrt());
        let (mut unanswered, mut answered, mut density) = (1.0, 0.0, clutter);
        for (bin, rest) in bins.iter().enumerate() {
            let (distance_m, echo) = ((bin as f64 + 0.5) * BIN_M, unanswered * (1.0 - rest));
            unanswered *= rest;
            let off = (range_m - distance_m) / sigma_m;
            if off.abs() < FAR {
                density += echo * peak * libm::exp(-0.5 * off * off);
            }
            answered += if distance_m >= min_range_m { echo } else { 0.0 };
        }
        libm::log(density / (answered + clutter * (max_range_m - min_range_m)))
    }

    /// Of each distance, how probably nothing there answers, in `bins`.
    fn look(&self, grid: &Grid, sounding: &Sounding<'_>, cone: &OrientedCone, far_m: f64, bins: &mut Vec<f64>) {
        bins.clear();
        bins.resize((far_m / BIN_M).ceil() as usize, 1.0);
        let from = sounding.map_from_transducer();
        let resolution_m = grid.resolution_m();
        let half_rad = 0.5 * cone.aperture_rad;
        // Corners of the sector, and where it meets an axis of the grid
        let quarters = (0..4).map(|quarter| f64::from(quarter) * 0.25 * TAU);
        let edges = quarters.filter(|ray| crate::wrap_angle(ray - from.theta).abs() <= half_rad);
        let corners = edges.chain([from.theta - half_rad, from.theta + half_rad]);
        let [mut low, mut high] = [[from.x, from.y]; 2];
        for ray_rad in corners {
            let (sin, cos) = libm::sincos(ray_rad);
            for (axis, along) in [cos, sin].into_iter().enumerate() {
                let at = [from.x, from.y][axis] + far_m * along;
                (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
            }
        }
        let (first, last) = (grid.cell_at(low[0], low[1]), grid.cell_at(high[0], high[1]));
        let (ahead, is_narrow, edge) = (libm::sincos(from.theta), half_rad < 0.2 * TAU, libm::tan(half_rad) + 1e-9);
        for j in first.j..=last.j {
            for i in first.i..=last.i {
                let cell = crate::CellIndex { i, j };
                let [dx, dy] = {
                    let [x, y] = grid.centre(cell);
                    [x - from.x, y - from.y]
                };
                let (along, aside) = (dx * ahead.1 + dy * ahead.0, dy * ahead.1 - dx * ahead.0);
                if is_narrow && aside.abs() > edge * along {
                    continue;
                }
                let distance_m = libm::sqrt(dx * dx + dy * dy);
                let Some(bin) = bins.get_mut((distance_m / BIN_M) as usize) else { continue };
                let ray_rad = libm::atan2(dy, dx);
                if crate::wrap_angle(ray_rad - from.theta).abs() > half_rad || distance_m <= 0.5 * resolution_m {
                    continue;
                }
                let turns = ray_rad / TAU;
                let ray = ((turns - turns.floor()) * RAYS as f64).round() as usize % RAYS;
                let answers = self.kernel.answers(grid, cell, cone, &self.shares[ray]);
                *bin *= 1.0 - answers;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Pose2;
    use crate::reading::{Echo, Reading};
    use crate::robot::{Sensor, SensorKind};
    use crate::{GridMapper, MapperConfig};

    fn robot(range_error_ratio: f64) -> Robot {
        let sonar = Sensor {
            kind: SensorKind::Sonar,
            base_from_sensor: Pose2::new(0.2, 0.0, 0.0),
            first_transducer: 0,
            transducers: 1,
            first_bearing_rad: 0.0,
            bearing_step_rad: 0.0,
            aperture_rad: 0.5,
            range_min_m: 0.15,
            range_max_m: 5.0,
            range_error_ratio,
        };
        Robot { sensors: vec![sonar], ..Robot::default() }
    }

    /// What a mapper keeps of these ranges, each from a place of its own a little farther along a wall ahead.
    fn kept(ranges_m: &[f64]) -> Vec<KeptReading> {
        let config = MapperConfig { keep_readings: true, ..MapperConfig::default() };
        let mut mapper = GridMapper::with_defaults_of_odometry(&config, robot(0.03)).unwrap();
        for (step, range_m) in ranges_m.iter().enumerate() {
            let reading = Reading { transducer: 0, echo: Echo::Hit { range_m: *range_m }, offset_ns: 0 };
            let estimate = Estimate::certain(Pose2::new(0.0, 0.1 * step as f64, 0.0));
            assert_eq!(mapper.integrate(step as u64 + 1, &reading, Some(&estimate)), Verdict::Accepted);
        }
        mapper.kept_readings().unwrap().iter().copied().collect()
    }

    /// ln p of the last of these ranges.
    fn last(ranges_m: &[f64], config: &MapperConfig, ratio: f64) -> f64 {
        let readings = kept(ranges_m);
        let foretold = foretell(config, [&robot(0.03), &robot(ratio)], &readings, &[], 1).unwrap();
        assert_eq!(foretold.len(), ranges_m.len());
        foretold.last().unwrap().ln_density
    }

    #[test]
    fn over_all_ranges_it_sums_to_one() {
        let wall = [2.0; 8];
        for known in [&wall[..0], &wall[..1], &wall[..]] {
            let step_m = 0.02;
            let ranges = (0..).map(|k| 0.15 + step_m * (f64::from(k) + 0.5)).take_while(|range_m| *range_m < 5.0);
            let density = |range_m: f64| {
                let ranges: Vec<f64> = known.iter().copied().chain([range_m]).collect();
                libm::exp(last(&ranges, &MapperConfig::default(), 0.03))
            };
            let sum: f64 = ranges.map(|range_m| step_m * density(range_m)).sum();
            // σ_z grows with z, so that of echoes from beyond the limit some is before it, and the other way round.
            assert!((sum - 1.0).abs() < 0.05, "{} readings before: {sum}", known.len());
        }
    }

    #[test]
    fn a_wall_that_is_known_is_expected() {
        let config = MapperConfig::default();
        let at = |range_m: f64| last(&[2.0, 2.0, 2.0, 2.0, 2.0, 2.0, range_m], &config, 0.03);
        assert!(at(2.0) > at(1.0) + 2.0 && at(2.0) > at(3.5) + 2.0, "{} {} {}", at(1.0), at(2.0), at(3.5));
        assert!(at(2.0) > last(&[2.0], &config, 0.03) + 1.0, "nothing was known");
    }

    #[test]
    fn the_error_that_ranges_have_is_the_likeliest() {
        // 3 %, evenly spread in quantiles
        let off = [-1.5, -0.9, -0.5, -0.2, 0.2, 0.5, 0.9, 1.5];
        let ranges: Vec<f64> = (0..40).map(|step| 2.0 + 0.06 * off[step * 3 % 8]).collect();
        let sum = |ratio: f64| -> f64 {
            let foretold =
                foretell(&MapperConfig::default(), [&robot(0.03), &robot(ratio)], &kept(&ranges), &[], 1).unwrap();
            foretold.iter().skip(8).map(|foretold| foretold.ln_density).sum()
        };
        assert!(sum(0.03) > sum(0.01) && sum(0.03) > sum(0.1), "{} {} {}", sum(0.01), sum(0.03), sum(0.1));
    }

    #[test]
    fn a_new_map_knows_nothing() {
        let (readings, config) = (kept(&[2.0; 8]), MapperConfig::default());
        let of = |begins: &[usize]| foretell(&config, [&robot(0.03), &robot(0.03)], &readings, begins, 1).unwrap();
        let (whole, parts) = (of(&[]), of(&[4]));
        assert_eq!(whole[..4], parts[..4]);
        assert!(
            (parts[4].ln_density - parts[0].ln_density).abs() < 0.2 && whole[4].ln_density > parts[4].ln_density + 1.0
        );
        assert_eq!(foretell(&config, [&robot(0.03), &robot(0.03)], &readings, &[], 3).unwrap().len(), 2);
    }
}
