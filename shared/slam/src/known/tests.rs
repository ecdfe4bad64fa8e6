use core::f64::consts::PI;

use echogrid_core::{CellIndex, Echo as Answered, Grid, Increment, Pose2, Reading, Robot, Scales, Sensor, SensorKind};

use super::*;
use crate::scan::Points;

const GATES: Gates = Gates { evidence_min: 1.2, margin_min: 0.6 };
const SHARES: Gates = Gates { evidence_min: 0.62, margin_min: 0.05 };

/// Walls as a grid of 5 cm knows them, and the floor between them.
struct Plan {
    walls: Vec<[f64; 4]>,
    floors: Vec<[f64; 4]>,
}

impl Plan {
    /// A room with a niche, a pillar and a part that juts out: nothing about it is symmetric.
    fn room(x: f64, y: f64) -> Self {
        let walls = [
            [0.0, 0.0, 6.0, 0.0],
            [6.0, 0.0, 6.0, 2.5],
            [6.0, 2.5, 7.5, 2.5],
            [7.5, 2.5, 7.5, 4.0],
            [7.5, 4.0, 2.0, 4.0],
            [2.0, 4.0, 2.0, 3.2],
            [2.0, 3.2, 0.0, 3.2],
            [0.0, 3.2, 0.0, 0.0],
            [4.0, 1.9, 4.4, 1.9],
            [4.4, 1.9, 4.4, 2.3],
            [4.4, 2.3, 4.0, 2.3],
            [4.0, 2.3, 4.0, 1.9],
        ];
        let floors = [[0.0, 0.0, 6.0, 3.2], [2.0, 2.5, 7.5, 4.0]];
        let moved = |line: [f64; 4]| [line[0] + x, line[1] + y, line[2] + x, line[3] + y];
        Self { walls: walls.map(moved).to_vec(), floors: floors.map(moved).to_vec() }
    }

    /// A room of the same size, of which nothing else is the same.
    fn hall() -> Self {
        let walls = vec![
            [0.0, 0.0, 9.0, 1.5],
            [9.0, 1.5, 7.0, 7.0],
            [7.0, 7.0, 3.0, 5.0],
            [3.0, 5.0, -1.0, 6.0],
            [-1.0, 6.0, 0.0, 0.0],
        ];
        Self { walls, floors: vec![[0.0, 1.5, 7.0, 5.0]] }
    }

    fn and(mut self, other: Self) -> Self {
        self.walls.extend(other.walls);
        self.floors.extend(other.floors);
        self
    }

    fn grid(&self) -> Grid {
        let mut grid = Grid::new(0.05);
        let mut set = |x: f64, y: f64, log_odds: f32| {
            let cell: CellIndex = grid.cell_at(x, y);
            grid.tile_mut(cell.tile()).log_odds[cell.offset_in_tile()] = log_odds;
        };
        let steps = |from: f64, to: f64| (0..=((to - from) / 0.025) as i32).map(move |i| from + 0.025 * f64::from(i));
        for [left, low, right, high] in &self.floors {
            steps(*left, *right).for_each(|x| steps(*low, *high).for_each(|y| set(x, y, -3.0)));
        }
        for [ax, ay, bx, by] in &self.walls {
            let count = (libm::hypot(bx - ax, by - ay) / 0.02).ceil() as i32;
            (0..=count).map(|i| f64::from(i) / f64::from(count)).for_each(|t| {
                set(ax + t * (bx - ax), ay + t * (by - ay), 7.5);
            });
        }
        grid
    }

    fn ground(&self) -> Ground {
        Ground::of(&self.grid(), MapModel { prior: 0.004 }).unwrap()
    }

    /// How far it is along a ray, and the angle from the normal at which it ends.
    fn ray(&self, from: Pose2) -> Option<(f64, f64)> {
        let (s, c) = libm::sincos(from.theta);
        let hit = |[ax, ay, bx, by]: &[f64; 4]| {
            let (dx, dy) = (bx - ax, by - ay);
            let cross = c * dy - s * dx;
            let along = ((ax - from.x) * dy - (ay - from.y) * dx) / cross;
            let at = ((ax - from.x) * s - (ay - from.y) * c) / cross;
            let sine = cross.abs() / libm::hypot(dx, dy);
            (along > 0.0 && (0.0..=1.0).contains(&at)).then(|| (along, libm::acos(sine.min(1.0))))
        };
        self.walls.iter().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// What a sonar hears: of all rays the nearest wall that is met within 20° of its normal.
    fn hears(&self, map_from_transducer: Pose2) -> Option<f64> {
        let rays = (-6..=6).map(|ray| map_from_transducer * Pose2::new(0.0, 0.0, f64::from(ray) * PI / 72.0));
        let answers = rays.filter_map(|ray| self.ray(ray)).filter(|(_, off)| *off < 20.0 * PI / 180.0);
        answers.map(|(along, _)| along).min_by(f64::total_cmp).filter(|range_m| *range_m < 5.0)
    }
}

/// A way through the room, place by place.
fn way() -> Vec<Pose2> {
    let legs = [([1.0, 1.0], 0.0), ([3.0, 1.0], 0.5), ([5.2, 1.4], 1.9), ([5.0, 3.2], 3.1), ([3.0, 3.1], -2.4)];
    let mut poses = Vec::new();
    for pair in legs.windows(2) {
        let ([ax, ay], a) = pair[0];
        let ([bx, by], b) = pair[1];
        poses.extend((0..8).map(|i| {
            let t = f64::from(i) / 8.0;
            Pose2::new(ax + t * (bx - ax), ay + t * (by - ay), a + t * (b - a))
        }));
    }
    poses
}

/// What a ring of eight sonars hears on the way; the drive measures `wrong` too much.
fn trail(plan: &Plan, way: &[Pose2], wrong: f64) -> Trail {
    let mut stops = Vec::new();
    let mut later = way[way.len() - 1];
    for pose in way.iter().rev() {
        let sonar = |index: i32| Pose2::new(0.0, 0.0, f64::from(index) * PI / 4.0) * Pose2::new(0.15, 0.0, 0.0);
        let echo = |index: i32| {
            Some(Echo {
                base_from_transducer: sonar(index),
                range_m: plan.hears(*pose * sonar(index))?,
                range_error_ratio: 0.01,
                aperture_rad: PI / 6.0,
                range_cap_m: 5.0,
            })
        };
        let true_step = Increment::between(*pose, later);
        stops.push(Stop { step: true_step.corrected(-wrong, -wrong), echoes: (0..8).filter_map(echo).collect() });
        later = *pose;
    }
    let older = stops.iter().skip(stops.len() / 2).map(|stop| stop.echoes.len()).sum();
    Trail { stops, scales: Scales::default(), older }
}

fn off(found: Pose2, truth: Pose2) -> (f64, f64) {
    (found.distance_m(truth), echogrid_core::wrap_angle(found.theta - truth.theta).abs())
}

fn about(pose: Pose2, metres: f64, radians: f64) -> Prior {
    let covariance = matrix::diagonal([metres * metres, metres * metres, radians * radians]);
    Prior { pose, covariance }
}

#[test]
fn sonars_find_the_robot_near_where_it_was_believed_to_be() {
    let (plan, way) = (Plan::room(0.0, 0.0), way());
    let mut map = EchoMap::new(plan.ground());
    let truth = way[way.len() - 1];
    for wrong in [0.0, 0.04] {
        let believed = Pose2::new(truth.x + 0.15, truth.y - 0.1, truth.theta + 0.06);
        let prior = about(believed, 0.15, 0.08);
        let found = map.track(&trail(&plan, &way, wrong), &prior, &GATES).unwrap();
        let (metres, radians) = off(found.pose, truth);
        assert!(metres < 0.08 && radians < 0.06, "{wrong}: {metres} m, {radians} rad");
        // What is claimed is not less than what it is off by, within three standard deviations.
        let sigma = |axis: usize| found.covariance[axis][axis].sqrt();
        assert!(metres < 3.0 * sigma(0).max(sigma(1)) && radians < 3.0 * sigma(2), "{found:?}");
    }
}

#[test]
fn sonars_find_the_robot_anywhere_and_the_map_may_lie_anywhere() {
    for (x, y) in [(0.0, 0.0), (-40.0, 13.3)] {
        let plan = Plan::room(x, y);
        let way: Vec<Pose2> = way().into_iter().map(|pose| Pose2::new(pose.x + x, pose.y + y, pose.theta)).collect();
        let found = EchoMap::new(plan.ground()).find(&trail(&plan, &way, 0.02), &GATES).unwrap();
        let (metres, radians) = off(found.pose, way[way.len() - 1]);
        assert!(metres < 0.1 && radians < 3.0 * found.covariance[2][2].sqrt(), "{metres} m, {radians} rad");
    }
}

#[test]
fn of_two_rooms_alike_neither_is_told() {
    let (plan, way) = (Plan::room(0.0, 0.0), way());
    let two = Plan::room(0.0, 0.0).and(Plan::room(12.0, 0.0));
    let found = EchoMap::new(two.ground()).find(&trail(&plan, &way, 0.0), &GATES);
    assert!(matches!(found, Err(Unlocated::Ambiguous { .. })), "{found:?}");
}

#[test]
fn another_building_is_none() {
    let (plan, way) = (Plan::room(0.0, 0.0), way());
    let found = EchoMap::new(Plan::hall().ground()).find(&trail(&plan, &way, 0.0), &GATES);
    assert!(found.is_err(), "{found:?}");
    let few = EchoMap::new(plan.ground()).find(&trail(&plan, &way[..3], 0.0), &GATES);
    assert!(matches!(few, Err(Unlocated::TooFew { .. })), "{few:?}");
}

#[test]
fn an_echo_says_where_the_wall_is_that_faces_it() {
    let plan = Plan::room(0.0, 0.0);
    let map = EchoMap::new(plan.ground());
    let echo = |range_m: f64| Echo {
        base_from_transducer: Pose2::IDENTITY,
        range_m,
        range_error_ratio: 0.01,
        aperture_rad: PI / 6.0,
        range_cap_m: 5.0,
    };
    // 1 m before the wall at y = 0, looking at it, and along it.
    let at = |theta: f64, range_m: f64| map.evidence_of(Pose2::new(1.2, 1.0, theta), &echo(range_m));
    assert!(at(-PI / 2.0, 1.0) > 2.5 && at(-PI / 2.0, 0.6) < 0.3 && at(-PI / 2.0, 1.6) < 0.3);
    // Met obliquely, it mirrors the sound away.
    let (oblique, straight) = (at(-0.5, 1.0 / libm::sin(0.5)), at(-PI / 2.0, 1.0));
    assert!(oblique < straight - 0.8, "{oblique} {straight}");
    // Outside of the map nothing answers.
    assert!(map.evidence_of(Pose2::new(90.0, 0.0, 0.0), &echo(1.0)).abs() < 1e-12);
}

/// What a lidar of 180 beams sees all around.
fn sees(plan: &Plan, from: Pose2, base_from_scan: Pose2) -> Points {
    let sensor = Sensor {
        kind: SensorKind::Lidar,
        base_from_sensor: Pose2::IDENTITY,
        first_transducer: 0,
        transducers: 180,
        first_bearing_rad: -PI,
        bearing_step_rad: PI / 90.0,
        aperture_rad: PI / 90.0,
        range_min_m: 0.05,
        range_max_m: 20.0,
        range_error_ratio: 0.01,
    };
    let robot = Robot { sensors: vec![sensor], ..Robot::default() };
    let reading = |transducer: u16| {
        let beam = robot.transducer(transducer)?.base_from_transducer;
        let range_m = plan.ray(from * beam)?.0;
        Some(Reading { transducer, echo: Answered::Hit { range_m }, offset_ns: 0 })
    };
    let readings: Vec<Reading> = (0..180).filter_map(reading).collect();
    let mut points = Points::default();
    let turn = Pose2::new(0.0, 0.0, base_from_scan.theta);
    for (at, normal) in Points::of(&robot, &readings, |_| Pose2::IDENTITY).iter() {
        points.push(base_from_scan.transform(at), turn.transform(normal));
    }
    points
}

#[test]
fn a_lidar_finds_the_robot_near_and_anywhere() {
    let plan = Plan::room(0.0, 0.0).and(Plan { walls: vec![[12.0, 0.0, 15.0, 0.0]], floors: Vec::new() });
    let (truth, before) = (Pose2::new(3.0, 1.2, 0.7), Pose2::new(5.3, 1.1, 0.2));
    let map = OutlineMap::new(&plan.ground());
    let (seen, earlier) = (sees(&plan, truth, Pose2::IDENTITY), sees(&plan, before, truth.inverse() * before));
    let prior = about(Pose2::new(3.2, 1.05, 0.8), 0.2, 0.1);
    for found in [map.track(&seen, &prior, &SHARES).unwrap(), map.find(&seen, &earlier, &SHARES).unwrap()] {
        let (metres, radians) = off(found.pose, truth);
        assert!(metres < 0.04 && radians < 0.02, "{found:?}");
    }
    let elsewhere = OutlineMap::new(&Plan::hall().ground()).find(&seen, &earlier, &SHARES);
    assert!(elsewhere.is_err(), "{elsewhere:?}");
}

#[test]
fn what_is_no_map_to_localize_in_is_told() {
    let error = |grid: &Grid| Ground::of(grid, MapModel { prior: 0.004 }).unwrap_err().to_string();
    assert!(error(&Grid::new(0.05)).contains("0.0 m of wall"));
    assert!(error(&Grid::new(0.5)).contains("cells of 0.5 m"));
    let mut wide = Plan::room(0.0, 0.0).grid();
    let far = CellIndex { i: 20_000_000, j: 20_000_000 };
    wide.tile_mut(far.tile()).log_odds[far.offset_in_tile()] = 1.0;
    assert!(error(&wide).contains("expected at most"));
}
