//! Robots: the built-in ones are those of the tables, and bad files are told.

use std::f64::consts::PI;

use echogrid_core::config::Systematic;
use echogrid_core::{Pose2, SensorKind};

use super::problem::{ConfigError, Problem};
use super::robot_file::{self, Resolved};

fn builtin(name: &str) -> Resolved {
    robot_file::find(name, None, None).unwrap()
}

/// x, y in millimetres, heading in degrees: ARIA's parameter files.
type Mounts = [(i32, i32, i32); 16];

const PIONEER_3AT: Mounts = [
    (147, 136, 90),
    (193, 119, 50),
    (227, 79, 30),
    (245, 27, 10),
    (245, -27, -10),
    (227, -79, -30),
    (193, -119, -50),
    (147, -136, -90),
    (-144, -136, -90),
    (-189, -119, -130),
    (-223, -79, -150),
    (-241, -27, -170),
    (-241, 27, 170),
    (-223, 79, 150),
    (-189, 119, 130),
    (-144, 136, 90),
];

const PIONEER_3DX: Mounts = [
    (69, 136, 90),
    (114, 119, 50),
    (148, 78, 30),
    (166, 27, 10),
    (166, -27, -10),
    (148, -78, -30),
    (114, -119, -50),
    (69, -136, -90),
    (-157, -136, -90),
    (-203, -119, -130),
    (-237, -78, -150),
    (-255, -27, -170),
    (-255, 27, 170),
    (-237, 78, 150),
    (-203, 119, 130),
    (-157, 136, 90),
];

#[test]
fn sonars_sit_where_the_tables_say() {
    let check = |name: &str, mounts: &Mounts, length_m: f64, width_m: f64| {
        let robot = builtin(name).0.unwrap();
        assert_eq!(robot.name, name);
        assert_eq!((robot.footprint.length_m, robot.footprint.width_m), (length_m, width_m));
        assert_eq!(robot.transducer_count(), 16);
        for (index, &(x, y, heading)) in (0u16..).zip(mounts) {
            let sonar = robot.transducer(index).unwrap();
            let mount = Pose2::new(f64::from(x) / 1000.0, f64::from(y) / 1000.0, f64::from(heading).to_radians());
            assert_eq!(sonar.base_from_transducer, mount, "{name} {index}");
            assert_eq!((sonar.kind, sonar.aperture_rad), (SensorKind::Sonar, 30_f64.to_radians()));
            assert_eq!((sonar.range_min_m, sonar.range_max_m, sonar.range_error_ratio), (0.1, 5.0, 0.01));
        }
    };
    check("pioneer3at", &PIONEER_3AT, 0.626, 0.505);
    check("pioneer3dx", &PIONEER_3DX, 0.511, 0.425);
}

#[test]
fn the_laser_sweeps_from_right_to_left() {
    let robot = builtin("laser").0.unwrap();
    assert_eq!(robot.transducer_count(), 181);
    let bearing = |beam: u16| robot.transducer(beam).unwrap().base_from_transducer.theta;
    for (beam, expected) in [(0, -PI / 2.0), (90, 0.0), (180, PI / 2.0)] {
        assert!((bearing(beam) - expected).abs() < 1e-12, "beam {beam}: {}", bearing(beam));
    }
    assert!((robot.sensors[0].aperture_rad - PI / 180.0).abs() < 1e-15);
    assert_eq!(robot.sensors[0].kind, SensorKind::Lidar);
}

#[test]
fn robots_bring_their_calibration() {
    let odometry = |name: &str| super::assemble::sections(&builtin(name).1).unwrap().odometry;
    let pioneer = odometry("pioneer3at");
    assert_eq!((pioneer.systematic, pioneer.lin_scale, pioneer.ang_scale), (Systematic::Carry, 0.09, 0.095));
    assert_eq!(odometry("laser").systematic, Systematic::Off);
    assert_eq!(odometry("pioneer3dx"), echogrid_core::OdometryConfig::default());
}

#[test]
fn simulated_the_pioneer_errs_as_the_paper_measured() {
    let sections = super::assemble::sections(&builtin("pioneer3at").1).unwrap();
    let expected = sections.simulator.expected_error_model().per_way;
    assert!((expected.lin_scale - sections.odometry.lin_scale).abs() < 1e-4, "{expected:?}");
    assert!((expected.ang_scale - sections.odometry.ang_scale).abs() < 1e-4, "{expected:?}");
    for name in ["pioneer3at", "pioneer3dx"] {
        let simulator = super::assemble::sections(&builtin(name).1).unwrap().simulator;
        simulator.validate().unwrap();
        let mut fired: Vec<u16> = simulator.firing_order.concat();
        fired.sort_unstable();
        assert_eq!(fired, (0..16).collect::<Vec<_>>(), "{name}: every sonar fires once");
    }
}

#[test]
fn bad_robot_files() {
    const GOOD: &str = "name = \"r\"\n[sonars]\naperture_deg = 30\nrange_min_m = 0.1\nrange_max_m = 5\nrange_error_ratio = 0.01\n[[sonar]]\nx_m = 0\ny_m = 0\nheading_deg = 0\n";
    let folder = tempfile::tempdir().unwrap();
    let load = |text: &str| {
        std::fs::write(folder.path().join("r.toml"), text).unwrap();
        robot_file::find("r.toml", None, Some(folder.path()))
    };
    assert_eq!(load(GOOD).unwrap().0.unwrap().transducer_count(), 1);
    let check = |from: &str, to: &str, snippets: &[&str]| {
        assert!(GOOD.contains(from));
        let text = GOOD.replacen(from, to, 1);
        let told = load(&text).expect_err(&text);
        assert!(matches!(told, ConfigError::Invalid(_)), "{told}");
        let told: Vec<String> = told.problems().iter().map(Problem::to_string).collect();
        assert_eq!(told.len(), snippets.len(), "{told:#?}");
        for (told, snippet) in told.iter().zip(snippets) {
            assert!(told.contains(snippet), "{text}\n  told:   {told}\n  wanted: {snippet}");
        }
    };
    check("x_m = 0", "x_m = 147", &["r.toml:8: sonar.0.x_m = 147: expected a number of metres from -10 to 10"]);
    check(
        "x_m = 0",
        "x_mm = 147",
        &["sonar.0.x_mm: unknown key; did you mean `x_m` (in metres)?", "r.toml:7: sonar.0.x_m: missing"],
    );
    check("x_m = 0", "", &["r.toml:7: sonar.0.x_m: missing; expected a number of metres"]);
    check("heading_deg = 0", "heading_deg = \"1 rad\"", &["write heading_deg = 57.2957795130"]);
    check(
        "heading_deg = 0",
        "heading_rad = 0",
        &["did you mean `heading_deg` (in degrees)?", "sonar.0.heading_deg: missing"],
    );
    check("range_min_m = 0.1", "range_min_m = 5", &["sonars: range_min_m must be below range_max_m"]);
    check("range_error_ratio = 0.01", "range_error_ratio = \"1%\"", &["write range_error_ratio = 0.01"]);
    check("name = \"r\"", "", &["a robot file needs `name"]);
    check("name = \"r\"", "name = \"\"", &["name: expected 1 to 40 letters"]);
    check("name = \"r\"", "name = \"auto\"", &["not \"auto\""]);
    check("name = \"r\"", "nam = \"r\"", &["r.toml:1: nam: unknown key; did you mean `name`?", "a robot file needs"]);
    check(
        "name = \"r\"",
        "name = \"r\"\n[odometry]\nk_lll = 1",
        &["r.toml:3: odometry.k_lll: unknown key; did you mean `k_ll`?"],
    );
    check(
        "name = \"r\"",
        "name = \"r\"\n[mapper]\nfusion = 1",
        &["mapper: unknown key; known are name, sonar, footprint, sonars, lidar, odometry"],
    );
    check("name = \"r\"", "name = \"r\"\nsonar = 3", &["r.toml:8"]);
    check("[[sonar]]", "[sonar]", &["sonar: expected one table `[[sonar]]` per sonar"]);
    check("[sonars]", "[sonar]", &["duplicate key"]);
    check(
        "name = \"r\"",
        "name = \"r\"\n[lidar]\nbeams = 1",
        &[
            "lidar.beams = 1: expected a whole number from 2 to 10000",
            "lidar.x_m: missing",
            "lidar.y_m: missing",
            "lidar.heading_deg: missing",
            "lidar.first_bearing_deg: missing",
            "lidar.field_of_view_deg: missing",
            "lidar.range_min_m: missing",
            "lidar.range_max_m: missing",
            "lidar.range_error_ratio: missing",
        ],
    );
    let told = load("name = \"r\"\n").unwrap_err().to_string();
    assert!(told.contains("a robot needs a `[[sonar]]` or a `[lidar]`"), "{told}");
    let many = format!("{GOOD}{}", "[[sonar]]\nx_m = 0\ny_m = 0\nheading_deg = 0\n".repeat(256));
    assert_eq!(load(&many).unwrap_err().to_string(), "r.toml:1: a robot has 1 to 256 sonars and lidars");
}
