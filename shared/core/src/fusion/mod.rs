//! What a reading makes of the cells of its cone: the rules of fusion. ([`Fusion::of`] never leaves `Auto`.)

mod beams;
mod facing;
pub mod first_echo;
pub mod oriented;
pub mod shares;

use crate::config::{Fusion, MapperConfig, Noise};
use crate::filter::Channel;
use crate::first_echo::FirstEcho;
use crate::grid::Grid;
use crate::heard::Heard;
use crate::kernel::{AlongWalls, EchoCone, FanKernel, FirstEchoKernel, Kernel, OrientedCone, OrientedKernel};
use crate::log_odds::log_odds_of;
use crate::noise::NoiseTerms;
use crate::novelty::Novelty;
use crate::odometry::Estimate;
use crate::oriented::Oriented;
use crate::pose::Pose2;
use crate::reading::Reading;
use crate::robot::Transducer;
use crate::sensor_model::{BAND, Cone, Deviations};
use crate::shares::draw;
use crate::verdict::Verdict;

/// A reading that tells a range, or that nothing came back, and where the robot was when it was taken.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sounding<'a> {
    /// The number of its scan.
    pub(crate) sequence: u64,
    pub(crate) reading: &'a Reading,
    /// Its transducer.
    pub(crate) channel: &'a Channel,
    /// z_t; none: nothing came back.
    pub(crate) range_m: Option<f64>,
    /// x_t, finite.
    pub(crate) estimate: &'a Estimate,
}

impl Sounding<'_> {
    pub(crate) fn map_from_transducer(&self) -> Pose2 {
        self.estimate.pose * self.channel.transducer.base_from_transducer
    }
}

/// What a reading says of every cell of its cone: the inverse sensor model of Algorithm 1, ready for the kernel that adds it.
#[derive(Debug, Clone, Copy)]
pub(crate) enum InverseSensorModel {
    /// A probability of each cell by its place in the cone (eq 21).
    Cone(Cone),
    /// The first of the cells that answers gave the echo.
    FirstEcho(EchoCone),
    /// The same where smooth walls mirror.
    Oriented(OrientedCone),
}

/// How much a reading says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Weighed {
    /// Eqs 22, 23.
    pub(crate) deviations: Deviations,
    /// How much of it is new, in (0, 1].
    pub(crate) news: f64,
    /// √(σ_z² − σ_z0²): the part of the deviation that the odometry is to blame for, metres.
    pub(crate) doubt_m: f64,
    /// Around the robot, where it was then, so much was cleared, metres.
    pub(crate) cleared_m: f64,
}

/// Fuses readings into a grid by the rule of the configuration.
#[derive(Debug, Clone)]
pub(crate) struct Fuser {
    config: MapperConfig,
    noise: Noise,
    seed: u64,
    kernel: Kernel,
    fan: FanKernel,
    first_echo: FirstEchoKernel,
    oriented: OrientedKernel,
    pub(crate) novelty: Novelty,
    pub(crate) heard: Heard,
    /// None: cells are shown as they are.
    pub(crate) along_walls: Option<AlongWalls>,
}

impl Fuser {
    /// By the rule of `config`; `noise` and `seed` are those of the odometry.
    pub(crate) fn new(config: &MapperConfig, noise: Noise, seed: u64) -> Self {
        Self {
            config: config.clone(),
            noise,
            seed,
            kernel: Kernel::new(config.log_odds_prior, config.log_odds_max),
            fan: FanKernel::new(config.log_odds_prior, config.log_odds_max),
            first_echo: FirstEchoKernel::new(config.log_odds_prior, config.log_odds_max),
            oriented: OrientedKernel::new(
                config.log_odds_prior,
                config.log_odds_max,
                config.oriented_diffuse,
                config.oriented_incidence_deg.to_radians(),
            ),
            novelty: Novelty::default(),
            heard: Heard::default(),
            along_walls: (config.oriented_wall_m > 0.0).then(|| {
                AlongWalls::new(
                    config.oriented_wall_m,
                    config.resolution_m,
                    config.oriented_diffuse,
                    config.log_odds_max,
                )
            }),
        }
    }

    /// How far a reading is to be trusted (eqs 22, 23), and how much of it is new: `news`, if that was told when it was fused before.
    ///
    /// # Errors
    /// It is not to be trusted.
    pub(crate) fn weigh(&mut self, sounding: &Sounding<'_>, news: Option<f64>) -> Result<Weighed, Verdict> {
        self.weigh_at(sounding, sounding.map_from_transducer(), news)
    }

    /// Likewise, of one whose transducer is known to be at `map_from_transducer`.
    ///
    /// # Errors
    /// As [`Fuser::weigh`].
    fn weigh_at(
        &mut self,
        sounding: &Sounding<'_>,
        map_from_transducer: Pose2,
        news: Option<f64>,
    ) -> Result<Weighed, Verdict> {
        let deviations = self.deviations(sounding);
        // A trust of 0 or NaN (an error beyond all bounds) can't move a cell either.
        if !(deviations.trust > 0.0 && deviations.trust >= self.config.min_trust) {
            return Err(Verdict::Untrusted);
        }
        let news = news.unwrap_or_else(|| self.news(sounding, map_from_transducer));
        let sigma_z0_m = self.own_deviation_m(sounding);
        let doubt_m2 = deviations.sigma_z_m * deviations.sigma_z_m - sigma_z0_m * sigma_z0_m;
        Ok(Weighed { deviations, news, doubt_m: doubt_m2.max(0.0).sqrt(), cleared_m: 0.0 })
    }

    /// How much of a reading is new, in (0, 1].
    fn news(&mut self, sounding: &Sounding<'_>, map_from_transducer: Pose2) -> f64 {
        let news = self.novelty.of(sounding.reading.transducer, map_from_transducer, self.config.novelty_m);
        match self.config.fusion.of(sounding.channel.transducer.kind) {
            Fusion::Oriented => {
                self.heard.count(sounding.estimate.pose, map_from_transducer, self.config.oriented_place_m, news)
            }
            Fusion::Auto | Fusion::Paper | Fusion::Covariance | Fusion::FirstEcho => news,
        }
    }

    /// What a reading of these deviations, so much of which is new, says of every cell of its cone, by the rule of fusion.
    pub(crate) fn inverse_sensor_model(
        &self,
        sounding: &Sounding<'_>,
        deviations: Deviations,
        news: f64,
    ) -> InverseSensorModel {
        match self.config.fusion.of(sounding.channel.transducer.kind) {
            Fusion::Auto | Fusion::Paper | Fusion::Covariance => {
                InverseSensorModel::Cone(self.cone(sounding, deviations, news))
            }
            Fusion::FirstEcho => InverseSensorModel::FirstEcho(self.echo_cone(sounding, deviations, news)),
            Fusion::Oriented => InverseSensorModel::Oriented(self.oriented_cone(sounding, deviations, news)),
        }
    }

    /// Adds what a reading says to every cell of its cone (eq 20, as log-odds: line 3 of Algorithm 1).
    ///
    /// # Errors
    /// It leaves the map; nothing is changed then.
    pub(crate) fn add(
        &mut self,
        grid: &mut Grid,
        sounding: &Sounding<'_>,
        model: &InverseSensorModel,
    ) -> Result<(), Verdict> {
        let (map_from_transducer, revision) = (sounding.map_from_transducer(), sounding.sequence);
        let added = match model {
            InverseSensorModel::Cone(cone) => match sounding.channel.transducer.fan {
                Some(fan) => {
                    let map_from_first = sounding.estimate.pose * fan.base_from_first;
                    self.fan.add(grid, map_from_first, fan.step_rad, &[(fan.beam, *cone)], revision)
                }
                None => self.kernel.add(grid, map_from_transducer, cone, revision),
            },
            InverseSensorModel::FirstEcho(cone) => self.first_echo.add(grid, map_from_transducer, cone, revision),
            InverseSensorModel::Oriented(cone) => self.oriented.add(grid, map_from_transducer, cone, revision),
        };
        added.map_err(|_| Verdict::OffMap)
    }

    /// All of it: weighs a reading, and adds what it says.
    ///
    /// # Errors
    /// It is not to be trusted, or leaves the map; nothing is changed then.
    pub(crate) fn fuse(&mut self, grid: &mut Grid, sounding: &Sounding<'_>, news: f64) -> Result<(), Verdict> {
        let Weighed { deviations, news, .. } = self.weigh(sounding, Some(news))?;
        let model = self.inverse_sensor_model(sounding, deviations, news);
        self.add(grid, sounding, &model)
    }

    /// What it was made of.
    pub(crate) fn config(&self) -> &MapperConfig {
        &self.config
    }

    /// Of what is occupied, the share that is no smooth wall before any reading.
    pub(crate) fn diffuse(&self) -> f64 {
        self.config.oriented_diffuse
    }

    /// σ_z without odometry error, metres.
    pub(crate) fn own_deviation_m(&self, sounding: &Sounding<'_>) -> f64 {
        let Transducer { range_max_m, range_error_ratio, .. } = sounding.channel.transducer;
        let range_m = sounding.range_m.unwrap_or(range_max_m);
        (range_error_ratio * range_m).max(0.5 * self.config.resolution_m)
    }

    /// σ_z, σ_θ and the trust of a reading (eqs 22, 23), or their likenesses from the covariance of the pose.
    pub(crate) fn deviations(&self, sounding: &Sounding<'_>) -> Deviations {
        let Sounding { sequence, reading, channel: Channel { transducer: sensor, .. }, estimate, .. } = *sounding;
        let (aperture_rad, ratio, resolution_m) =
            (sensor.aperture_rad, sensor.range_error_ratio, self.config.resolution_m);
        let range_m = sounding.range_m.unwrap_or(sensor.range_max_m);
        match self.config.fusion.of(sensor.kind) {
            Fusion::Auto | Fusion::Paper => {
                let noise = NoiseTerms::of(self.noise, &estimate.errors, self.seed, sequence, reading.transducer);
                Deviations::of(range_m, aperture_rad, ratio, resolution_m, &estimate.errors, noise)
            }
            Fusion::Covariance | Fusion::FirstEcho | Fusion::Oriented => {
                let covariance = estimate.covariance_of(sensor.base_from_transducer);
                let bearing_rad = estimate.pose.theta + sensor.base_from_transducer.theta;
                Deviations::of_covariance(range_m, bearing_rad, aperture_rad, ratio, resolution_m, &covariance)
            }
        }
    }

    /// Of the models that add up. What is not new is trusted less; a cone without an echo is free to its end, as far as echoes are
    /// not lost.
    fn cone(&self, sounding: &Sounding<'_>, deviations: Deviations, news: f64) -> Cone {
        let Transducer { aperture_rad, range_max_m: range_cap_m, .. } = sounding.channel.transducer;
        let found = if sounding.range_m.is_some() { 1.0 } else { 1.0 - self.config.echo_lost };
        Cone {
            range_m: sounding.range_m.unwrap_or(range_cap_m + BAND * deviations.sigma_z_m),
            aperture_rad,
            range_cap_m,
            deviations: Deviations { trust: deviations.trust * news * found, ..deviations },
            p_occupied: self.config.p_occupied,
            p_free: self.config.p_free,
            leaves_gaps: sounding.channel.transducer.leaves_gaps,
        }
    }

    fn echo_cone(&self, sounding: &Sounding<'_>, deviations: Deviations, news: f64) -> EchoCone {
        let Transducer { aperture_rad, range_max_m: range_cap_m, .. } = sounding.channel.transducer;
        let Deviations { sigma_z_m, sigma_theta_rad, .. } = deviations;
        let sigma_z0_m = self.own_deviation_m(sounding);
        EchoCone {
            reading: FirstEcho {
                range_m: sounding.range_m,
                sigma_z_m,
                sigma_theta_rad,
                detection: self.config.echo_detection,
                clutter: self.config.echo_clutter,
                range_cap_m,
                lost: self.config.echo_lost,
            },
            aperture_rad,
            prior_log_odds: log_odds_of(self.config.echo_prior),
            weight: news * libm::pow(sigma_z0_m / sigma_z_m, self.config.tempering),
            leaves_gaps: sounding.channel.transducer.leaves_gaps,
        }
    }
}

impl Fuser {
    fn oriented_cone(&self, sounding: &Sounding<'_>, deviations: Deviations, news: f64) -> OrientedCone {
        let Transducer { aperture_rad, range_max_m: range_cap_m, .. } = sounding.channel.transducer;
        let sigma_z_m = deviations.sigma_z_m;
        OrientedCone {
            reading: Oriented {
                range_m: sounding.range_m,
                sigma_z_m,
                clutter: self.config.oriented_clutter,
                range_cap_m,
                lost: self.config.oriented_lost,
            },
            detection: self.config.oriented_detection,
            clear_m: self.config.oriented_clear_m,
            aperture_rad,
            prior_log_odds: log_odds_of(self.config.oriented_prior),
            weight: news * libm::pow(self.own_deviation_m(sounding) / sigma_z_m, self.config.oriented_tempering),
            looks: if self.config.oriented_looks > 0.0 { self.config.oriented_looks } else { f64::INFINITY },
            leaves_gaps: sounding.channel.transducer.leaves_gaps,
            draw: draw(sounding.sequence, sounding.reading.transducer),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reading::Echo;
    use crate::robot::SensorKind;

    #[test]
    fn who_lost_the_way_along_a_corridor_still_knows_its_walls() {
        let config = MapperConfig { fusion: Fusion::Covariance, ..MapperConfig::default() };
        let fuser = Fuser::new(&config, Noise::Sampled, 1);
        let transducer = Transducer {
            kind: SensorKind::Sonar,
            base_from_transducer: Pose2::new(0.2, 0.0, 0.0),
            aperture_rad: core::f64::consts::FRAC_PI_6,
            range_min_m: 0.02,
            range_max_m: 5.0,
            range_error_ratio: 0.01,
            leaves_gaps: false,
            fan: None,
        };
        // A metre of doubt along x, none across it.
        let deviations = |heading_rad: f64| {
            let mut estimate = Estimate::certain(Pose2::new(0.0, 0.0, heading_rad));
            estimate.covariance[(0, 0)] = 1.0;
            let reading = Reading { transducer: 0, echo: Echo::Hit { range_m: 2.0 }, offset_ns: 0 };
            let channel = Channel { transducer, sonar: Some(0), selected: true, min_range_m: 0.15, max_range_m: 4.0 };
            let range_m = Some(2.0);
            fuser.deviations(&Sounding {
                sequence: 1,
                reading: &reading,
                channel: &channel,
                range_m,
                estimate: &estimate,
            })
        };
        let (along, across) = (deviations(0.0), deviations(core::f64::consts::FRAC_PI_2));
        assert!((along.sigma_z_m - libm::hypot(1.0, 0.025)).abs() < 1e-9, "{along:?}");
        assert!((across.sigma_z_m - 0.025).abs() < 1e-9, "{across:?}");
    }
}
