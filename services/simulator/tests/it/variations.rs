//! Robots and floors that nobody chose the mapper's defaults on.

use echogrid_core::config::{Filter, Fusion};
use echogrid_core::{GridMapper, MapperConfig};
use echogrid_simulator::SimulatorConfig;

use crate::mapped::Drive;
use crate::support::{named, pioneer, pioneer_config};

/// What a sonar is like, and what a map of a drawn floor comes to at most, bits.
struct Variation {
    /// A wall mirrors beyond this from its normal, degrees. The mapper is not told.
    mirrors_deg: f64,
    /// Full aperture of a sonar, degrees.
    beam_deg: f64,
    /// A share of the range.
    noise: f64,
    bits_max: f64,
}

const USUAL: Variation = Variation { mirrors_deg: 20.0, beam_deg: 30.0, noise: 0.01, bits_max: 0.33 };
const VARIATIONS: [Variation; 8] = [
    Variation { mirrors_deg: 15.0, ..USUAL },
    Variation { mirrors_deg: 25.0, ..USUAL },
    Variation { mirrors_deg: 30.0, ..USUAL },
    Variation { mirrors_deg: 35.0, ..USUAL },
    Variation { beam_deg: 15.0, ..USUAL },
    Variation { beam_deg: 40.0, ..USUAL },
    Variation { noise: 0.03, ..USUAL },
    Variation { mirrors_deg: 30.0, beam_deg: 20.0, noise: 0.02, ..USUAL },
];

#[test]
fn other_mirrors_beams_and_noise_are_mapped_too() {
    let first_echo = MapperConfig {
        fusion: Fusion::FirstEcho,
        filters: vec![Filter::Range, Filter::Selection, Filter::Stuck, Filter::Bubble],
        ..MapperConfig::default()
    };
    for (number, variation) in (103..).zip(VARIATIONS) {
        let Variation { mirrors_deg, beam_deg, noise, bits_max } = variation;
        let name = format!("floor-{number}");
        let world = named(&name);
        let config = SimulatorConfig { critical_incidence_deg: mirrors_deg, ..pioneer_config(&name) };
        let mut robot = pioneer();
        for sonar in &mut robot.sensors {
            (sonar.aperture_rad, sonar.range_error_ratio) = (beam_deg.to_radians(), noise);
        }
        let goals = &world.parts().places.goals;
        let drive = Drive::of(&config, &world, robot, goals.last().unwrap().pose);
        let bits_of = |config: &MapperConfig| {
            let mut mapper = GridMapper::with_defaults_of_odometry(config, drive.robot.clone()).unwrap();
            for (sequence, scan) in (1..).zip(&drive.scans) {
                mapper.integrate_scan(sequence, scan);
            }
            drive.judge(&mapper, drive.whole()).bits
        };
        let (bits, plain) = (bits_of(&MapperConfig::default()), bits_of(&first_echo));
        assert!(bits <= bits_max && bits < plain, "{name}, {mirrors_deg}°, {beam_deg}°, {noise}: {bits} {plain}");
    }
}
