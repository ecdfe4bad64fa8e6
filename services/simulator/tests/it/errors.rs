//! What is wrong with a world, a route or a robot is told before anything moves, with what to do about it.

use echogrid_core::Robot;
use echogrid_simulator::{Route, Simulator, SimulatorConfig, Waypoint, world_of};

use crate::support::{line, named, pioneer, pioneer_config, sonars, world};

fn told(config: &SimulatorConfig, robot: Robot) -> String {
    Simulator::check(config, robot).unwrap_err().to_string()
}

fn to(goal: &str) -> Route {
    Route::Places(vec![Waypoint::Goal(goal.to_owned())])
}

#[test]
fn every_problem_names_its_key_and_what_was_expected() {
    let check = |config: SimulatorConfig, snippets: &[&str]| {
        let told = told(&config, pioneer());
        assert!(snippets.iter().all(|snippet| told.contains(snippet)), "{told}");
    };
    let office = || pioneer_config("office");
    check(SimulatorConfig { world: "ofice".into(), ..office() }, &["simulator.world: ofice", "did you mean office?"]);
    check(SimulatorConfig { world: "/nowhere/a.toml".into(), ..office() }, &["/nowhere/a.toml: no such file"]);
    check(
        SimulatorConfig { start: vec![1.0, 5.2], ..office() },
        &[
            "simulator.start: at (1, 5.2) in office the nearest wall is 0.20 m",
            "its radius is 0.40 m",
            "expected a place",
        ],
    );
    check(
        SimulatorConfig { route: to("End of corridor"), ..office() },
        &["office has no goal \"End of corridor\"", "one of \"Room with", "did you mean \"End of the corridor\"?"],
    );
    check(
        SimulatorConfig { route: Route::Places(vec![Waypoint::Point([30.0, 6.0])]), ..office() },
        &["place [30, 6] of office can't be reached from (1.00, 6.00)", "keeps 0.45 m from walls"],
    );
    check(
        SimulatorConfig { route: to("Long room"), margin_m: 0.3, ..office() },
        &["goal \"Long room\"", "simulator.margin_m = 0.3"],
    );
    check(
        SimulatorConfig { firing_order: vec![vec![16]], ..office() },
        &["no sonar 16", "pioneer3at has sonars 0 to 15"],
    );
    check(SimulatorConfig { rays: 0, ..office() }, &["simulator.rays = 0: expected a whole number"]);
    let told = told(&office(), Robot { sensors: Vec::new(), ..pioneer() });
    assert!(told.contains("robot pioneer3at has no sensor"), "{told}");
}

#[test]
fn a_world_needs_somewhere_to_start_and_somewhere_to_go() {
    let bare = || world(&[line(0.0, 0.0, 9.0, 0.0), line(0.0, 3.0, 9.0, 3.0)]);
    let told = |config: &SimulatorConfig| Simulator::new(config, bare(), sonars(&[0.0])).unwrap_err().to_string();
    let config = SimulatorConfig { world: "bare.toml".into(), ..SimulatorConfig::default() };
    assert!(told(&config).contains("bare.toml has no home; expected simulator.start = [x, y, heading_deg]"));
    let config = SimulatorConfig { start: vec![1.0, 1.5], ..config };
    assert!(told(&config).contains("bare.toml has no goal that the robot can reach"));
    let config = SimulatorConfig { route: to("Kitchen"), ..config };
    assert!(told(&config).contains("expected [x, y] places: it has no goals"));
}

#[test]
fn files_of_worlds_that_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let check = |name: &str, text: &str, snippets: &[&str]| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let config = SimulatorConfig { world: path.to_str().unwrap().into(), ..SimulatorConfig::default() };
        let told = world_of(&config).unwrap_err().to_string();
        assert!(told.contains(name) && snippets.iter().all(|snippet| told.contains(snippet)), "{told}");
    };
    check("empty.toml", "[home]\nat = [1, 1]\n", &["there is no wall in it"]);
    check("nan.toml", "[[wall]]\nfrom = [nan, 0]\nto = [1, 0]\n", &["line 2"]);
    check("people.toml", "[[person]]\npath = [[0, 0]]\nspeed_mps = 1\nradius_m = 0.2\n", &["line 2: path of person"]);
    let yaml =
        "image: gone.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n";
    let path = folder.path().join("a.yaml");
    std::fs::write(&path, yaml).unwrap();
    let config = SimulatorConfig { world: path.to_str().unwrap().into(), ..SimulatorConfig::default() };
    assert!(world_of(&config).unwrap_err().to_string().contains("gone.pgm"));
    let huge = folder.path().join("huge.map");
    std::fs::File::create(&huge).unwrap().set_len(2 << 30).unwrap();
    let config = SimulatorConfig { world: huge.to_str().unwrap().into(), ..config };
    assert!(world_of(&config).unwrap_err().to_string().contains("2147483648 bytes; expected at most"));
}

#[test]
fn a_tour_leaves_out_what_can_not_be_reached() {
    let mut parts = named("room").parts().clone();
    // A wall between the left half and the right one.
    parts.walls.push(line(2.5, 0.0, 2.5, 4.0));
    let world = echogrid_core::World::new(parts).unwrap();
    let simulator = Simulator::new(&pioneer_config("halves"), world, pioneer());
    assert!(simulator.is_ok(), "the goals on the left are a tour");
}
