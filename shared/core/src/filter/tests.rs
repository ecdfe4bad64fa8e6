//! Each filter alone, and the chain.

use core::f64::consts::PI;

use proptest::prelude::*;

use super::*;
use crate::config::{Limit, Noise, SonarSelection};
use crate::mapping::GridMapper;
use crate::pose::Pose2;
use crate::reading::Echo;
use crate::robot::{Robot, Sensor};
use crate::verdict::VerdictCounts;

/// Bearings of a Pioneer's sonars, degrees; they sit 0.2 m from the middle.
const BEARINGS_DEG: [f64; 16] =
    [90.0, 50.0, 30.0, 10.0, -10.0, -30.0, -50.0, -90.0, -90.0, -130.0, -150.0, -170.0, 170.0, 150.0, 130.0, 90.0];
const BETA_RAD: f64 = PI / 6.0;

fn robot() -> Robot {
    let sensor = |(number, bearing_deg): (u16, f64)| Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.0, 0.0, bearing_deg.to_radians()) * Pose2::new(0.2, 0.0, 0.0),
        first_transducer: number,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: BETA_RAD,
        range_min_m: 0.1,
        range_max_m: 5.0,
        range_error_ratio: 0.01,
    };
    Robot { sensors: (0..).zip(BEARINGS_DEG).map(sensor).collect(), ..Robot::default() }
}

/// What a sonar hears in a room from (0, 0) to `room`: the nearest wall in its cone.
fn heard_m(room: [f64; 2], pose: Pose2, sonar: usize) -> f64 {
    let at = pose * robot().sensors[sonar].base_from_sensor;
    let along = |position: f64, direction: f64, end: f64| match direction {
        d if d > 1e-12 => (end - position) / d,
        d if d < -1e-12 => -position / d,
        _ => f64::INFINITY,
    };
    let ray = |step: i32| {
        let (sin, cos) = libm::sincos(at.theta + BETA_RAD * f64::from(step) / 20.0);
        along(at.x, cos, room[0]).min(along(at.y, sin, room[1]))
    };
    (-10..=10).map(ray).fold(f64::INFINITY, f64::min)
}

fn hit(transducer: usize, range_m: f64) -> Reading {
    Reading { transducer: transducer as u16, echo: Echo::Hit { range_m }, offset_ns: 0 }
}

fn config(filters: &[Filter]) -> MapperConfig {
    MapperConfig { filters: filters.to_vec(), bubble_rings: 10, ..MapperConfig::default() }
}

struct Judge {
    channels: Vec<Option<Channel>>,
    chain: Chain,
}

impl Judge {
    fn new(config: &MapperConfig) -> Self {
        config.validate().unwrap();
        let channels = channels(config, &robot()).unwrap();
        Self { chain: Chain::new(config, &channels), channels }
    }

    /// A ring heard from one pose.
    fn ring(&mut self, pose: Pose2, ranges_m: &[(usize, f64)]) -> Vec<Option<Verdict>> {
        let estimate = Some(Estimate::certain(pose));
        let scan: Vec<_> = ranges_m.iter().map(|(sonar, range_m)| (hit(*sonar, *range_m), estimate)).collect();
        self.chain.judge(&self.channels, &scan)
    }
}

/// A drive of 20 m along a room of 20 × 3 m and back, with a swing; what each sonar's readings came to.
fn drive(filters: &[Filter], fault: impl Fn(usize, usize, f64) -> f64) -> Vec<VerdictCounts> {
    let room = [20.0, 3.0];
    let mut judge = Judge::new(&config(filters));
    let mut counts = vec![VerdictCounts::default(); 16];
    for ring in 0..300 {
        let way = if ring < 150 { 1.0 + 0.1 * ring as f64 } else { 16.0 - 0.1 * (ring - 150) as f64 };
        let back = if ring < 150 { 0.0 } else { PI };
        let pose = Pose2::new(way, 1.4 + 0.3 * libm::sin(way / 2.0), back + 0.15 * libm::cos(way / 2.0));
        let ranges: Vec<_> = (0..16).map(|sonar| (sonar, fault(ring, sonar, heard_m(room, pose, sonar)))).collect();
        for (sonar, verdict) in judge.ring(pose, &ranges).into_iter().enumerate() {
            counts[sonar].add(verdict.unwrap_or(Verdict::Accepted));
        }
    }
    counts
}

const ALL: [Filter; 5] = [Filter::Range, Filter::Selection, Filter::Stuck, Filter::Lone, Filter::Bubble];
/// Without the bubbles, which mistake for reflections what sonars hear that look at a wall at an angle: the echo comes from
/// the rim of their cone, their end point lies before the wall, in the bubble of the sonar beside.
const CALM: [Filter; 4] = [Filter::Range, Filter::Selection, Filter::Stuck, Filter::Lone];

#[test]
fn the_first_filter_that_refuses_names_the_reason() {
    let verdicts = |filters: &[Filter]| {
        let selected = MapperConfig { sonars: SonarSelection::Numbers(vec![0]), ..config(filters) };
        Judge::new(&selected).ring(Pose2::IDENTITY, &[(1, 6.5), (1, 2.0), (0, 0.1), (99, 2.0)])
    };
    let (below, above, other, no) =
        (Some(Verdict::BelowMinimum), Some(Verdict::AboveMaximum), Some(Verdict::NotSelected), Some(Verdict::Invalid));
    assert_eq!(verdicts(&[Filter::Range, Filter::Selection]), [above, other, below, no]);
    assert_eq!(verdicts(&[Filter::Selection, Filter::Range]), [other, other, below, no]);
    assert_eq!(verdicts(&[Filter::Selection]), [other, other, None, no]);
    assert_eq!(verdicts(&[Filter::Range, Filter::Bubble, Filter::Selection]), [above, other, below, no]);
}

#[test]
fn what_no_other_sonar_hears_is_lone() {
    let mut judge = Judge::new(&config(&[Filter::Lone]));
    let ring = judge.ring(Pose2::IDENTITY, &[(3, 2.0), (4, 2.0), (7, 1.0)]);
    assert_eq!(ring, [None, None, Some(Verdict::Lone)]);
    // The sonar behind it comes by, and confirms what was heard there; not by saying the same again.
    assert_eq!(judge.ring(Pose2::IDENTITY, &[(7, 1.0)]), [Some(Verdict::Lone)]);
    assert_eq!(judge.ring(Pose2::new(0.1, 0.0, 0.0), &[(8, 1.0)]), [None]);
    // Ten rings later that is forgotten.
    for _ in 0..10 {
        judge.ring(Pose2::IDENTITY, &[(3, 2.0), (4, 2.0)]);
    }
    assert_eq!(judge.ring(Pose2::IDENTITY, &[(7, 1.0)]), [Some(Verdict::Lone)]);
}

#[test]
fn too_few_sonars_to_support_each_other_are_not_lone() {
    let one = MapperConfig { sonars: SonarSelection::Numbers(vec![7]), ..config(&ALL) };
    assert_eq!(Judge::new(&one).ring(Pose2::IDENTITY, &[(7, 1.0)]), [None]);
    let late = [Filter::Lone, Filter::Selection];
    let one = MapperConfig { sonars: SonarSelection::Numbers(vec![7]), ..config(&late) };
    assert_eq!(
        Judge::new(&one).ring(Pose2::IDENTITY, &[(7, 1.0)]),
        [Some(Verdict::Lone)],
        "the others are asked first"
    );
}

#[test]
fn a_bubble_is_invaded_by_what_two_sonars_say() {
    let ring = |ranges: &[(usize, f64)]| Judge::new(&config(&[Filter::Bubble])).ring(Pose2::IDENTITY, ranges);
    // Sonar 3 hears through the wall that 2 and 4 hear at 1.5 m; bubbles are narrow, so they must reach into it.
    let through = Some(Verdict::MultipleReflection);
    assert_eq!(ring(&[(2, 1.5), (3, 3.0), (4, 1.5)])[1], None, "their end points are outside of its bubble");
    let mut judge = Judge::new(&config(&[Filter::Bubble]));
    judge.ring(Pose2::new(0.0, 0.0, 0.2), &[(3, 2.3), (4, 2.3)]);
    assert_eq!(judge.ring(Pose2::IDENTITY, &[(3, 3.0)]), [through]);
    // What a single sonar said counts for nothing.
    let mut judge = Judge::new(&config(&[Filter::Bubble]));
    judge.ring(Pose2::new(0.0, 0.0, 0.2), &[(4, 2.3)]);
    assert_eq!(judge.ring(Pose2::IDENTITY, &[(3, 3.0)]), [None]);
    // The tolerance: 2.3 m lies inside the bubble of 3 m by less than a metre.
    let wide = MapperConfig { bubble_tolerance_m: 1.0, ..config(&[Filter::Bubble]) };
    let mut judge = Judge::new(&wide);
    judge.ring(Pose2::new(0.0, 0.0, 0.2), &[(3, 2.3), (4, 2.3)]);
    assert_eq!(judge.ring(Pose2::IDENTITY, &[(3, 3.0)]), [None]);
}

#[test]
fn healthy_sonars_are_hardly_touched() {
    for (number, counts) in drive(&CALM, |_, _, range_m| range_m).iter().enumerate() {
        assert_eq!(counts.get(Verdict::Stuck), 0, "sonar {number}");
        // Sonars that look at the walls at an angle hear them at the rim of their cones, where no other does.
        if [0, 7, 8, 15].contains(&number) {
            let seen = counts.total() - counts.get(Verdict::AboveMaximum);
            assert!(counts.get(Verdict::Accepted) * 100 >= seen * 85, "sonar {number}: {counts:?}");
        }
    }
}

#[test]
fn a_sonar_that_lies_is_found_out_and_its_neighbours_are_not() {
    for (number, lie) in [(0, 0.5), (2, 0.4), (7, 0.7), (13, 0.5), (0, 2.6), (15, 3.5)] {
        let counts = drive(&CALM, |ring, sonar, range_m| if sonar == number && ring >= 50 { lie } else { range_m });
        let found_out = counts[number].get(Verdict::Stuck) + counts[number].get(Verdict::Lone);
        // Of one that sees too far the walls are the only witnesses: it is lone at least.
        let stuck = counts[number].get(Verdict::Stuck);
        assert!(stuck > 75 || lie > 1.0, "sonar {number} at {lie} m: {:?}", counts[number]);
        assert!(found_out > 200, "sonar {number} at {lie} m: {:?}", counts[number]);
        for other in (0..16).filter(|other| *other != number) {
            assert_eq!(counts[other].get(Verdict::Stuck), 0, "sonar {other}, with {number} at {lie} m");
        }
    }
}

/// The neighbours of a sonar that is blocked are not thrown out for what it says, even where nothing but bubbles are looked at.
#[test]
fn a_blocked_sonar_bursts_no_bubble() {
    let healthy = drive(&[Filter::Bubble], |_, _, range_m| range_m);
    let blocked = drive(&[Filter::Bubble], |_, sonar, range_m| if sonar == 1 { 0.3 } else { range_m });
    for other in (0..16).filter(|other| *other != 1) {
        let used = |counts: &[VerdictCounts]| counts[other].get(Verdict::Accepted);
        assert!(used(&blocked) >= used(&healthy), "sonar {other}: {} of {}", used(&blocked), used(&healthy));
    }
}

#[test]
fn a_sonar_that_was_cured_is_heard_again() {
    let counts = drive(&CALM, |ring, sonar, range_m| if sonar == 0 && ring < 100 { 0.4 } else { range_m });
    assert!(counts[0].get(Verdict::Stuck) > 50, "{:?}", counts[0]);
    assert!(counts[0].get(Verdict::Accepted) > 120, "{:?}", counts[0]);
}

#[test]
fn a_fix_that_moves_the_map_makes_the_past_forgotten() {
    let mut judge = Judge::new(&config(&[Filter::Lone]));
    judge.ring(Pose2::IDENTITY, &[(8, 1.0)]);
    let fixed = |sigma_m: f64| {
        let mut judge = Judge::new(&config(&[Filter::Lone]));
        let mut estimate = Estimate::certain(Pose2::IDENTITY);
        estimate.covariance[(0, 0)] = sigma_m * sigma_m;
        judge.chain.judge(&judge.channels, &[(hit(8, 1.0), Some(estimate))]);
        let fixed = Estimate { fixes: 1, ..Estimate::certain(Pose2::IDENTITY) };
        judge.chain.judge(&judge.channels, &[(hit(7, 1.0), Some(fixed))])
    };
    assert_eq!(fixed(0.01), [None]);
    assert_eq!(fixed(0.5), [Some(Verdict::Lone)]);
}

#[test]
fn a_mapper_fuses_what_the_chain_leaves() {
    let scan: Vec<_> = [(3, 2.0), (4, 2.0), (7, 1.0), (5, 9.0)]
        .map(|(sonar, range_m)| (hit(sonar, range_m), Some(Estimate::certain(Pose2::IDENTITY))))
        .into();
    let map = |filters: &[Filter], scan: &[(Reading, Option<Estimate>)]| {
        let mut mapper = GridMapper::new(&config(filters), Noise::Sampled, 1, robot()).unwrap();
        let verdicts = mapper.integrate_scan(1, scan);
        let cells: Vec<_> = mapper.grid().tiles().flat_map(|(_, tile)| tile.log_odds.map(f32::to_bits)).collect();
        (verdicts, cells)
    };
    let (verdicts, filtered) = map(&[Filter::Range, Filter::Lone], &scan);
    assert_eq!(verdicts, [Verdict::Accepted, Verdict::Accepted, Verdict::Lone, Verdict::AboveMaximum]);
    assert_eq!(filtered, map(&[Filter::Range], &scan[..2]).1);
}

proptest! {
    /// Whatever is heard, every reading gets a verdict, and filters that look at one reading judge a scan as they judge its
    /// readings.
    #[test]
    fn every_reading_gets_a_verdict(
        rings in prop::collection::vec(prop::collection::vec((0u16..20, any::<f64>(), 0.0..6.0f64, 0u8..8), 0..40), 1..8),
        poses in prop::collection::vec((-3.0..3.0f64, any::<f64>(), any::<u32>()), 8),
    ) {
        let mut all = Judge::new(&MapperConfig { max_range_m: Limit::Metres(5.0), ..config(&ALL) });
        let alone = Judge::new(&config(&ALL[..2]));
        for (ring, (x, theta, fixes)) in rings.iter().zip(poses) {
            let scan: Vec<_> = ring.iter().map(|(transducer, odd, range_m, kind)| {
                let echo = match kind {
                    0 => Echo::NoEcho,
                    1 => Echo::Invalid,
                    2 => Echo::Hit { range_m: *odd },
                    _ => Echo::Hit { range_m: *range_m },
                };
                let pose = if *kind == 7 { Pose2 { x: *odd, y: x, theta } } else { Pose2::new(x, 0.0, 1.0) };
                let estimate = Estimate { fixes, ..Estimate::certain(pose) };
                (Reading { transducer: *transducer, echo, offset_ns: 0 }, (*kind != 6).then_some(estimate))
            }).collect();
            prop_assert_eq!(all.chain.judge(&all.channels, &scan).len(), scan.len());
            for ((reading, _), verdict) in scan.iter().zip(alone.chain.clone().judge(&alone.channels, &scan)) {
                prop_assert_eq!(alone.chain.refusal(&alone.channels, reading), verdict);
            }
        }
    }
}

proptest! {
    /// Where nothing clamps, the maps of the sonars add up to the map of all.
    #[test]
    fn sonar_maps_add_up_to_the_map(
        rings in prop::collection::vec((prop::array::uniform16(0.1..4.5f64), -1.0..1.0f64, -3.0..3.0f64), 1..6),
    ) {
        let additive = MapperConfig { fusion: crate::config::Fusion::Paper, ..config(&ALL[..2]) };
        let config = MapperConfig { sonar_maps: true, log_odds_max: 100.0, footprint_m: Limit::Metres(0.0), ..additive };
        let mut mapper = GridMapper::new(&config, Noise::Sampled, 1, robot()).unwrap();
        for (sequence, (ranges, x, theta)) in (1..).zip(&rings) {
            let estimate = Some(Estimate::certain(Pose2::new(*x, 0.0, *theta)));
            let scan: Vec<_> = ranges.iter().enumerate().map(|(sonar, range_m)| (hit(sonar, *range_m), estimate)).collect();
            mapper.integrate_scan(sequence, &scan);
        }
        let mut known = 0;
        for (index, tile) in mapper.grid().tiles() {
            for (offset, log_odds) in tile.log_odds.iter().enumerate() {
                let told: Vec<f32> = (0..16)
                    .filter_map(|sonar| mapper.sonar_grid(sonar)?.tile(index))
                    .map(|tile| tile.log_odds[offset])
                    .filter(|log_odds| !log_odds.is_nan())
                    .collect();
                prop_assert_eq!(told.is_empty(), log_odds.is_nan());
                prop_assert!(told.is_empty() || (told.iter().sum::<f32>() - log_odds).abs() < 1e-4);
                known += told.len();
            }
        }
        prop_assert_eq!(known > 0, !mapper.take_changed_of_sonars().is_empty());
    }
}

#[test]
fn a_sonar_that_is_refused_has_a_map_all_the_same() {
    let config = MapperConfig { sonar_maps: true, sonars: SonarSelection::Numbers(vec![3]), ..config(&ALL) };
    let mut mapper = GridMapper::new(&config, Noise::Sampled, 1, robot()).unwrap();
    let here = Some(Estimate::certain(Pose2::IDENTITY));
    let verdicts = mapper.integrate_scan(1, &[(hit(3, 9.0), here), (hit(7, 1.0), here), (hit(5, 1.0), None)]);
    assert_eq!(verdicts, [Verdict::AboveMaximum, Verdict::NotSelected, Verdict::NotSelected]);
    assert_eq!(mapper.grid().tile_count(), 0);
    let maps: Vec<u16> = (0..16).filter(|sonar| mapper.sonar_grid(*sonar).is_some()).collect();
    assert_eq!(maps, [7]);
    assert!(mapper.take_changed_of_sonars().iter().all(|(sonar, _)| *sonar == 7));
    assert!(mapper.take_changed_of_sonars().is_empty());
}
