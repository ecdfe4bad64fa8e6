//! What goes in, and what comes out or is told.

use echogrid_core::localization::Ask;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use echogrid_core::config::{Limit, LimitWord, SonarSelection, Systematic};
use echogrid_simulator::{Route, Waypoint};
use proptest::prelude::*;

use super::*;

fn shipped(graph: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch/graphs").join(graph)
}

/// A folder with a graph file in it, loaded with `--set`s.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, text).unwrap();
        path
    }

    fn executable(&self, name: &str) -> PathBuf {
        let path = self.write(name, "#!/bin/sh\n");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    fn load(&self, graph: &str, sets: &[&str]) -> Result<Loaded, ConfigError> {
        self.write("g.toml", graph);
        Config::load(&LoadRequest {
            graph: Some("g.toml".into()),
            sets: sets.iter().map(|&set| set.to_owned()).collect(),
            base: Some(self.0.path().to_path_buf()),
            ..LoadRequest::default()
        })
    }
}

fn load(graph: &str, sets: &[&str]) -> Result<Loaded, ConfigError> {
    Folder::new().load(graph, sets)
}

/// The message has a line for each snippet, in any order, and no other line.
fn check_told(told: Result<Loaded, ConfigError>, input: &str, snippets: &[&str]) {
    let message = told.map(|loaded| format!("{loaded:?}")).expect_err(input).to_string();
    for snippet in snippets {
        assert!(message.contains(snippet), "{input}\n  told:   {message}\n  wanted: {snippet}");
    }
    assert_eq!(message.lines().count(), snippets.len(), "{input}\n  told: {message}");
}

#[test]
fn bad_graph_files() {
    let check = |graph: &str, snippets: &[&str]| check_told(load(graph, &[]), graph, snippets);
    // Keys.
    check(
        "[mapper]\nresolution = 0.1",
        &["g.toml:2: mapper.resolution: unknown key; did you mean `resolution_m` (in metres)?"],
    );
    check("[mapper]\nresolution_cm = 5", &["did you mean `resolution_m` (in metres)?"]);
    check(
        "[mapper]\n\nresoluton_m = 0.1",
        &["g.toml:3: mapper.resoluton_m: unknown key; did you mean `resolution_m`?"],
    );
    check("[odometry]\nlin_offset_from_turn_deg = 5", &["did you mean `lin_offset_from_turn_rad` (in radians)?"]);
    check(
        "[mapper]\ncolour = 1",
        &["g.toml:2: mapper.colour: unknown key; [mapper] has resolution_m, fusion, log_odds_max"],
    );
    check("[mapper]\nsystematic = \"off\"", &["mapper.systematic: unknown key; it belongs to [odometry]"]);
    check("rate = 1", &["g.toml:1: rate: unknown key; it belongs to [run]"]);
    check("[maper]\nx = 1", &["g.toml:1: maper: unknown key; did you mean `mapper`?"]);
    check(
        "[sonar]",
        &[
            "sonar: unknown key; known are run, replay, simulator, pioneer, lidar, odometry, slam, localization, localizer, mapper, publisher, recorder, supervision, services, topics",
        ],
    );
    check("[robot]", &["a robot is named by `run.robot`"]);
    check("mapper = 3", &["g.toml:1: mapper: expected a table `[mapper]`, found a number"]);
    check("[[mapper]]", &["expected a table `[mapper]`, found a list"]);
    check("[services.sensor]\nexce = \"x\"", &["services.sensor.exce: unknown key; did you mean `exec`?"]);
    check(
        "[services.\"a b\"]\nkind = \"sensor\"",
        &["services.\"a b\": the name of a service is 1 to 20 of a-z, 0-9 and -"],
    );
    // Topics of one's own.
    check(
        "[topics.Goal]\nbytes = 8",
        &["topics.Goal: the name of a topic is at most 64 of a-z, 0-9, -, _ with / between"],
    );
    check("[topics.goal]\nbytes = 0", &["g.toml:2: topics.goal.bytes = 0: expected a whole number from 1 to 1048576"]);
    check("[topics.goal]\nbytes = 8", &["g.toml:1: topics.goal.type: missing; expected 1 to 64 printable characters"]);
    check(
        "[topics.goal]\ntype = \"a b\"\nbytes = 8",
        &["g.toml:2: topics.goal.type = \"a b\": expected 1 to 64 printable"],
    );
    check(
        "[topics.goal]\ntype = \"a\"\nbytes = 8\ndelivery = \"lossless\"",
        &["topics.goal.delivery = \"lossless\": expected latest or droppable"],
    );
    check(
        "[topics.\"map/info\"]\ntype = \"a\"\nbytes = 8",
        &["topics.\"map/info\": this is a topic of echogrid's own; a topic of yours needs another name"],
    );
    // Programs that print lines.
    let sensor = |keys: &str| format!("[services.sensor]\nexec = \"/bin/cat\"\n{keys}");
    check(
        &sensor("speaks = \"carman\""),
        &["g.toml:3: services.sensor.speaks = \"carman\": expected carmen; did you mean \"carmen\"?"],
    );
    check(
        &sensor("replays = true"),
        &["g.toml:3: services.sensor.replays: this is of programs that print lines; expected `speaks`, too"],
    );
    check(
        &sensor("speaks = \"carmen\"\nwrites = [\"map/tiles\"]"),
        &["g.toml:4: services.sensor.writes: a program that prints lines does not write map/tiles; expected some of"],
    );
    check(
        "[services.mapper]\nexec = \"/bin/cat\"\nspeaks = \"carmen\"",
        &["is a sensor, the service is of kind mapper"],
    );
    check("[services.sensor]\nspeaks = \"carmen\"", &["builtin:replay speaks for itself; this is for executables"]);
    // Types and units.
    check(
        "[mapper]\nresolution_m = \"5cm\"",
        &["g.toml:2: mapper.resolution_m = \"5cm\": expected a number of metres; write resolution_m = 0.05"],
    );
    check("[mapper]\nresolution_m = true", &["mapper.resolution_m = true: expected a number of metres"]);
    check("[mapper]\nresolution_m = nan", &["nan is not a finite number"]);
    check("[mapper]\nlog_odds_max = inf", &["inf is not a finite number"]);
    check("[mapper]\nmax_range_m = \"4 m\"", &["expected a number of metres or \"auto\"; write max_range_m = 4"]);
    check("[mapper]\nmax_range_m = \"atuo\"", &["expected a number of metres or \"auto\"; did you mean \"auto\"?"]);
    check(
        "[mapper]\nsonars = [0, -1]",
        &["mapper.sonars = [0, -1]: expected \"all\", \"corridor\" or a list of sonar numbers"],
    );
    check(
        "[mapper]\nfilters = [\"range\", \"bubbel\"]",
        &["expected a list of range, selection, stuck, lone, bubble; did you mean \"bubble\"?"],
    );
    check("[mapper]\nfilters = [\"lone\", \"lone\"]", &["mapper.filters = [lone, lone]: expected each filter once"]);
    check("[odometry]\nseed = -1", &["odometry.seed = -1: expected a whole number"]);
    check("[odometry]\nseed = 99999999999999999999", &["99999999999999999999 is too large"]);
    check("[publisher]\ndraw_path = \"yes\"", &["publisher.draw_path = \"yes\": expected true or false"]);
    check("[replay]\nlog = 7", &["replay.log = 7: expected a path"]);
    check("[run]\nrate = \"fast\"", &["run.rate = \"fast\": expected \"max\" or a number above 0"]);
    check("[run]\nrate = 0", &["run.rate = 0: expected \"max\" or a number above 0"]);
    check("[run]\nrate = -1.5", &["run.rate = -1.5: expected"]);
    check("[run]\nalive_within_s = 0.1", &["run.alive_within_s = 0.1: expected a number of seconds, 1 to 3600"]);
    check("[run]\ndomain = \"My Lab\"", &["run.domain = \"My Lab\": expected \"auto\" or a name"]);
    check("[services.sensor]\nargs = [1]", &["services.sensor.args = [1]: expected a list of strings"]);
    check("[services.sensor]\nenv = { A = 1 }", &["services.sensor.env = { … }: expected a table of strings"]);
    // Words.
    check(
        "[odometry]\nsystematic = \"cary\"",
        &["g.toml:2: odometry.systematic = \"cary\": expected one of carry, correct, off; did you mean \"carry\"?"],
    );
    check("[odometry]\nnoise = \"white\"", &["odometry.noise = \"white\": expected one of sampled, one_sigma"]);
    check(
        "[publisher]\nformats = [\"png\", \"pmg\"]",
        &["expected a list of png, pgm, npy, echogrid; did you mean \"png\"?"],
    );
    check("[services.x]\nkind = \"senser\"", &["services.x.kind = \"senser\": expected one of sensor"]);
    // Ranges.
    check("[mapper]\nresolution_m = 0", &["g.toml:2: mapper.resolution_m = 0: expected "]);
    check("[mapper]\np_free = 0.7", &["g.toml:2: mapper.p_free = 0.7: expected a probability "]);
    check("[publisher]\nformats = [\"png\", \"png\"]", &["expected each format once"]);
    check("[publisher]\nformats = []", &["publisher.formats = []: expected at least one of png, pgm, npy, echogrid"]);
    check("[publisher]\nfree_thresh = 0.649", &["below occupied_thresh, by 0.01 at least"]);
    check(
        "[publisher]\nfree_thresh = 0.9",
        &["publisher.free_thresh = 0.9: expected a probability above 0 and below occ"],
    );
    check(
        "[run]\nrobot = \"pioneer3at\"\n[mapper]\nsonars = [16]",
        &["there is no sonar 16: robot pioneer3at has sonars 0 to 15"],
    );
    // The robot.
    check(
        "[run]\nrobot = \"pioneer3a\"",
        &[
            "g.toml:2: run.robot = \"pioneer3a\": no such robot; expected auto, pioneer3at, pioneer3dx, laser or a file *.toml; did you mean \"pioneer3at\"?",
        ],
    );
    check("[run]\nrobot = \"mine.toml\"", &["mine.toml\": No such file"]);
    // The graph.
    check(
        "[services.a]\nkind = \"mapper\"\n[services.b]\nkind = \"mapper\"",
        &["the graph has 2 services of kind mapper (a, b), expected one"],
    );
    check("[services.sensor]\nkind = \"mapper\"", &["the graph has no sensor"]);
    check("[services.page]", &["g.toml:1: services.page.kind: missing"]);
    check(
        "[services.sensor]\nexec = \"builtin:mapper\"",
        &[
            "g.toml:2: services.sensor.exec = \"builtin:mapper\": this is of kind mapper, the service is of kind sensor; expected builtin:replay",
        ],
    );
    check("[services.sensor]\nexec = \"builtin:repaly\"", &["did you mean \"builtin:replay\"?"]);
    check("[services.sensor]\nexec = \"\"", &["services.sensor.exec = \"\": expected a path or builtin:NAME"]);
    check("[services.sensor]\nexec = \"replay\"", &["folders of PATH; did you mean \"builtin:replay\"?"]);
    check("[services.sensor]\nenv = { \"A B\" = \"1\" }", &["the name of a variable is letters"]);
    check(
        "[services.sensor]\nenv.ECHOGRID_DOMAIN = \"x\"",
        &["services.sensor.env.ECHOGRID_DOMAIN = \"x\": this is set by the launcher"],
    );
    check("[services.sensor]\nargs = [\"a\\u0000\"]", &["an argument has no NUL"]);
    // Not TOML.
    check("[mapper\nresolution_m = 1", &["g.toml:1: "]);
    check("a = 1\na = 2", &["g.toml:2: duplicate key"]);
}

#[test]
fn all_that_is_wrong_is_told_at_once() {
    let graph = "[mapper]\nresolution = 1\np_free = 2\nmin_trust = 7\n[odometry]\nseed = \"x\"\n[run]\nrate = 0\n";
    check_told(
        load(graph, &["mapper.sonar=all", "run.domain=A"]),
        graph,
        &[
            "g.toml:2: mapper.resolution: unknown",
            "g.toml:3: mapper.p_free = 2:",
            "g.toml:4: mapper.min_trust = 7:",
            "g.toml:6: odometry.seed = \"x\":",
            "g.toml:8: run.rate = 0:",
            "--set mapper.sonar=all: mapper.sonar: unknown key; did you mean `sonars`?",
            "--set run.domain=A: run.domain = \"A\":",
        ],
    );
}

#[test]
fn bad_arguments() {
    let check = |set: &str, snippet: &str| {
        check_told(load("", &[set]), set, &[snippet]);
    };
    check("", "--set : expected KEY=VALUE");
    check("rate", "--set rate: expected KEY=VALUE");
    check("rate=1", "--set rate=1: rate: unknown key; it belongs to [run]");
    check("run..rate=1", "expected TABLE.KEY=VALUE");
    check("run.rate.x=1", "--set run.rate.x=1: run.rate = { … }: expected \"max\" or a number above 0");
    check(
        "odometry.systematic=of",
        "odometry.systematic = \"of\": expected one of carry, correct, off; did you mean \"off\"?",
    );
    check("mapper.resolution_m=5cm", "write resolution_m = 0.05");
    check("replay.log=no-such.log", "no-such.log\": there is no such file");
    check("services.sensor.exec=./no-such", "no-such\": there is no such file, expected an executable");
    check("services.sensor.env.9=1", "services.sensor.env = \"9\": the name of a variable");
}

#[test]
fn good_arguments() {
    let config = |sets: &[&str]| load("", sets).unwrap().into_config();
    assert_eq!(config(&["odometry.systematic=off"]).odometry.systematic, Systematic::Off);
    assert_eq!(config(&["odometry.systematic=\"correct\""]).odometry.systematic, Systematic::Correct);
    assert_eq!(config(&["mapper.sonars=[0,7,8,15]"]).mapper.sonars, SonarSelection::Numbers(vec![0, 7, 8, 15]));
    assert_eq!(config(&["mapper.max_range_m=3"]).mapper.max_range_m, Limit::Metres(3.0));
    assert_eq!(config(&["mapper.max_range_m=auto"]).mapper.max_range_m, Limit::Word(LimitWord::Auto));
    assert_eq!(config(&["run.rate=2"]).run.rate, Rate::Times(2.0));
    assert_eq!(config(&["run.rate=2", "run.rate=max"]).run.rate, Rate::Max);
    assert_eq!(config(&["run.domain=007"]).run.domain, Domain::Named("007".to_owned()));
    assert_eq!(config(&["odometry={seed=9}"]).odometry.seed, 9);
    let service = config(&["services.sensor.env.LEVEL=1", "services.sensor.args=[\"a b\"]"]).services["sensor"].clone();
    assert_eq!(service.env["LEVEL"], "1");
    assert_eq!(service.args, ["a b"]);
}

#[test]
fn flags_of_their_own() {
    let request = LoadRequest {
        robot: Some("laser".to_owned()),
        rate: Some("0.5".to_owned()),
        out: Some("here".to_owned()),
        domain: Some("lab".to_owned()),
        sensor: Some("replay".to_owned()),
        sets: vec!["run.rate=3".to_owned()],
        base: Some("/".into()),
        ..LoadRequest::default()
    };
    let loaded = Config::load(&request).unwrap();
    assert_eq!(loaded.robot().unwrap().name, "laser");
    assert_eq!(loaded.config().run.rate, Rate::Times(3.0), "--set has the last word");
    assert_eq!(loaded.config().run.out, Path::new("/here"));
    assert_eq!(loaded.origin("run.domain").unwrap().to_string(), "--domain lab");
    let told = Config::load(&LoadRequest { sensor: Some("./none".to_owned()), ..request });
    check_told(told, "--sensor", &["--sensor ./none: services.sensor.exec = \"/none\": there is no such file"]);
}

#[test]
fn what_is_simulated_is_a_pioneer_unless_another_robot_is_named() {
    let robot = |graph: &str, sensor: &str| {
        let folder = Folder::new();
        folder.write("g.toml", graph);
        let loaded = Config::load(&LoadRequest {
            graph: Some("g.toml".into()),
            sensor: Some(sensor.to_owned()),
            base: Some(folder.0.path().to_path_buf()),
            ..LoadRequest::default()
        });
        let config = loaded.unwrap().into_config();
        (config.robot.map(|robot| robot.name), config.simulator.axle_m)
    };
    assert_eq!(robot("", "simulator"), (Some("pioneer3at".to_owned()), 0.588));
    assert_eq!(robot("[services.robby]\nkind = \"sensor\"\n", "simulator").0.as_deref(), Some("pioneer3at"));
    assert_eq!(robot("[simulator]\naxle_m = 0.7\n", "simulator").1, 0.7);
    assert_eq!(robot("[run]\nrobot = \"laser\"\n", "simulator").0.as_deref(), Some("laser"));
    assert_eq!(robot("[services.sensor]\nexec = \"builtin:simulator\"\n", "replay").0, None);
    let named = load("[simulator]\nroute = [\"Kitchen\", [1, 2.5]]\nworld = \"floor.map\"\n", &[]).unwrap();
    let simulator = &named.config().simulator;
    let places = vec![Waypoint::Goal("Kitchen".to_owned()), Waypoint::Point([1.0, 2.5])];
    assert_eq!(simulator.route, Route::Places(places));
    assert!(simulator.world.starts_with('/') && simulator.world.ends_with("/floor.map"), "{}", simulator.world);
}

#[test]
fn what_measures_what_is_now_is_known() {
    let of = |sensor: &str| load("", &[&format!("services.sensor.exec=builtin:{sensor}")]).unwrap().into_config();
    let is_now = ["replay", "simulator", "pioneer"].map(|sensor| of(sensor).measures_what_is_now());
    assert_eq!(is_now, [false, false, true]);
    let of_program = |replays| {
        let mut config = of("replay");
        let sensor = config.services.get_mut("sensor").unwrap();
        (sensor.exec, sensor.speaks, sensor.replays) = (Exec::Path("a.sh".into()), Some(Speech::Carmen), replays);
        config.measures_what_is_now()
    };
    assert_eq!([true, false].map(of_program), [false, true]);
}

#[test]
fn later_sources_win() {
    let folder = Folder::new();
    let robot = super::robot::BUILTIN.iter().find(|(name, _)| *name == "pioneer3at").unwrap().1;
    folder.write("mine.toml", &robot.replace("lin_scale = 0.09", "lin_scale = 0.05\nk_ll = 0.1\nseed = 5"));
    let graph = "[run]\nrobot = \"mine.toml\"\n[odometry]\nk_ll = 0.2\nseed = 6\n";
    let loaded = folder.load(graph, &["odometry.seed=7"]).unwrap();
    let odometry = &loaded.config().odometry;
    assert_eq!((odometry.lin_scale, odometry.k_ll, odometry.seed), (0.05, 0.2, 7));
    assert_eq!(odometry.systematic, Systematic::Carry);
    let origin = |key: &str| loaded.origin(key).map(ToString::to_string);
    assert_eq!(origin("odometry.lin_scale").as_deref(), Some("mine.toml:13"));
    assert_eq!(origin("odometry.k_ll").as_deref(), Some("g.toml:4"));
    assert_eq!(origin("odometry.seed").as_deref(), Some("--set odometry.seed=7"));
    assert_eq!(origin("odometry.k_tt"), None);
}

#[test]
fn paths_are_relative_to_where_they_were_written() {
    let folder = Folder::new();
    fs::create_dir(folder.0.path().join("sub")).unwrap();
    folder.write("sub/a.log", "");
    folder.write("b.log", "");
    folder.write("sub/g.toml", "[replay]\nlog = \"a.log\"\n[run]\nout = \"maps\"\n");
    let request = LoadRequest {
        graph: Some("sub/g.toml".into()),
        base: Some(folder.0.path().to_path_buf()),
        ..LoadRequest::default()
    };
    let config = Config::load(&request).unwrap().into_config();
    assert_eq!(config.replay.log, folder.0.path().join("sub/a.log"));
    assert_eq!(config.run.out, folder.0.path().join("sub/maps"));
    folder.write("sub/g.toml", "[run]\nout = \"./../maps\"\n");
    assert_eq!(Config::load(&request).unwrap().config().run.out, folder.0.path().canonicalize().unwrap().join("maps"));
    let request = LoadRequest { log: Some("b.log".to_owned()), ..request };
    assert_eq!(Config::load(&request).unwrap().config().replay.log, folder.0.path().join("b.log"));
    let request = LoadRequest { graph: Some("sub/none.toml".into()), ..request };
    assert!(Config::load(&request).unwrap_err().to_string().starts_with("sub/none.toml: No such file"));
}

#[test]
fn roles_left_out_are_filled_in() {
    let folder = Folder::new();
    let executable = folder.executable("my-sensor");
    let graph = "[services.sonars]\nkind = \"sensor\"\nexec = \"./my-sensor\"\n";
    let config = folder.load(graph, &[]).unwrap().into_config();
    assert_eq!(config.services.keys().collect::<Vec<_>>(), ["mapper", "odometry", "publisher", "sonars"]);
    assert_eq!(config.services["sonars"].exec, Exec::Path(executable.clone()));
    // Two publishers are fine.
    let config = folder.load("[services.publisher]\n[services.page]\nkind = \"publisher\"\n", &[]).unwrap();
    assert_eq!(config.config().services.len(), 5);
    // What is there but can't be run.
    fs::set_permissions(&executable, fs::Permissions::from_mode(0o644)).unwrap();
    check_told(folder.load(graph, &[]), graph, &["g.toml:3: services.sonars.exec"]);
    let message = folder.load(graph, &[]).unwrap_err().to_string();
    assert!(message.contains("my-sensor\": the file is not executable"), "{message}");
}

#[test]
fn programs_are_found_on_the_path() {
    let folder = Folder::new();
    let executable = folder.executable("my-sensor");
    folder.write("not-executable", "");
    let find = |name: &str| {
        let mut config = Config::default();
        config.services.get_mut("sensor").unwrap().exec = Exec::Path(name.into());
        let problems = files::resolve(&mut config, &assemble::Origins::new(), Some(folder.0.path().as_os_str()));
        (config.services["sensor"].exec.clone(), problems)
    };
    assert_eq!(find("my-sensor"), (Exec::Path(executable), vec![]));
    for name in ["not-executable", "none"] {
        let problem = find(name).1[0].to_string();
        assert!(problem.contains("no executable of this name in the 1 folders of PATH"), "{problem}");
        assert!(problem.contains(&format!("a file beside the graph is \"./{name}\"")), "{problem}");
    }
}

#[test]
fn shipped_graphs_load() {
    let load = |graph: PathBuf| Config::load(&LoadRequest { graph: Some(graph), ..LoadRequest::default() });
    let loaded = load(shipped("map.toml")).unwrap();
    let mut config = loaded.config().clone();
    config.run.out = Config::default().run.out;
    assert_eq!(config, Config::default(), "it sets what would be anyway");
    let told = loaded.require_runnable().unwrap_err().to_string();
    assert_eq!(told, "replay.log: which log? Name one: --set replay.log=FILE");

    let folder = Folder::new();
    folder.executable("my-sensor");
    let graph = folder.write("custom.toml", &fs::read_to_string(shipped("custom-sensor.toml")).unwrap());
    let loaded = load(graph).unwrap();
    assert_eq!(loaded.robot().unwrap().name, "pioneer3at");
    assert_eq!(loaded.config().services.len(), 4);
    loaded.require_runnable().unwrap();
}

#[test]
fn what_is_shown_loads_again() {
    let folder = Folder::new();
    folder.executable("my-sensor");
    folder.write("a\nb.log", "");
    let check = |graph: &str, sets: &[&str]| {
        let loaded = folder.load(graph, sets).unwrap();
        let shown = render(&loaded);
        let again = folder.load(&shown, &[]).unwrap_or_else(|error| panic!("{error}\n{shown}"));
        assert_eq!(again.config(), loaded.config(), "{shown}");
        assert_eq!(Config::from_toml(&loaded.config().to_toml().unwrap()).unwrap(), *loaded.config());
        shown
    };
    check("", &[]);
    check(&fs::read_to_string(shipped("custom-sensor.toml")).unwrap(), &["run.robot=laser", "mapper.sonars=all"]);
    check(
        "[services.page]\nkind='publisher'\nexec='my-sensor'\nenv={A='''x\n\"''', B=''}\nargs=['\t','\u{1f980}']",
        &["services.page.exec=./my-sensor"],
    );
    check("", &["replay.log=a\nb.log", "run.rate=0.1"]);
    let shown = check("[run]\nrobot = 'pioneer3at'\n", &["odometry.seed=3"]);
    for line in [
        "rate = \"max\"                     # times real time, or \"max\": as fast as the slowest process takes it",
        "systematic = \"carry\"             # carry: as doubt into the sensor model; correct: taken out of every increment; off <- robot pioneer3at:12",
        "seed = 3                         # seed of the draws <- --set odometry.seed=3",
        "#     0 sonar 30.0 deg at x +0.147 m, y +0.136 m, heading +90.0 deg, 0.1 to 5 m",
    ] {
        assert!(shown.lines().any(|shown| shown == line), "{line}\n{shown}");
    }
}

#[test]
fn a_file_says_where_the_robot_is() {
    let folder = tempfile::tempdir().unwrap();
    let of = |fix: &str, sets: &[&str]| {
        let sets = sets.iter().map(|set| (*set).to_owned()).collect();
        let base = Some(folder.path().to_path_buf());
        Config::load(&LoadRequest { fix: Some(fix.into()), sets, base, ..LoadRequest::default() })
    };
    for (file, key) in
        [("marks.toml", "landmarks"), ("path.txt", "reference"), ("of.laser", "reference"), ("a.echogrid", "map")]
    {
        let error = of(file, &[]).unwrap_err().to_string();
        let expected = format!("localizer.{key} = {:?}: there is no such file", folder.path().join(file));
        assert!(error.contains(&expected) && error.contains(&format!("--fix {file}")), "{error}");
        std::fs::write(folder.path().join(file), "").unwrap();
        let config = of(file, &[]).unwrap().into_config();
        assert_eq!(config.localizer.files(), [(key, folder.path().join(file).as_path())]);
        assert!(config.has_localizer());
    }
    // A map is known by what it holds, its folder by what is in it.
    std::fs::write(folder.path().join("saved.bin"), b"\x89EGM\r\n\x1a\n...").unwrap();
    std::fs::create_dir(folder.path().join("office")).unwrap();
    std::fs::write(folder.path().join("office/map.echogrid"), "").unwrap();
    for (named, file) in [("saved.bin", "saved.bin"), ("office", "office/map.echogrid")] {
        assert_eq!(
            of(named, &[]).unwrap().into_config().localizer.files(),
            [("map", folder.path().join(file).as_path())]
        );
    }
    // In a map it is asked for by way, too, unless it is said when; and what the sensors hear is read.
    let in_map = of("a.echogrid", &[]).unwrap().into_config();
    assert_eq!((in_map.localization.ask, in_map.localization.every_m), (Ask::Both, 2.0));
    assert!(in_map.services["localizer"].wiring.reads.contains(&"range/scan".to_owned()));
    assert!(in_map.resolved_odometry().start.is_open());
    let said = of("a.echogrid", &["localization.ask=degraded"]).unwrap().into_config();
    assert_eq!((said.localization.ask, said.localization.every_m), (Ask::Degraded, 0.0));
    for (fix, set, expected) in [
        ("reference", "run.rate=1", "localizer.reference = \"\": expected a file with lines `t x y theta`"),
        ("landmarks", "run.rate=1", "localizer.landmarks = \"\": expected a file with tables [[landmark]]"),
        ("map", "run.rate=1", "localizer.map = \"\": expected a map.echogrid, in which"),
        ("a.echogrid", "localizer.map_window_m=20", "localizer.map_window_m = 20: expected metres, from 1 to 12"),
        ("marks.toml", "localizer.sightings=none", "none\": there is no such file"),
        ("marks.toml", "localizer.measure=ranges", "did you mean \"range\"?"),
        ("marks.toml", "localizer.range_sigma_m=0", "localizer.range_sigma_m = 0: expected metres, from 1e-9"),
        ("./", "run.rate=1", "map.echogrid\": there is no such file"),
        ("map.png", "run.rate=1", "localizer.map = "),
        ("referense", "run.rate=1", "did you mean \"reference\"?"),
    ] {
        let error = of(fix, &[set]).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn provenance_is_what_decides_the_map() {
    let of = |sets: &[&str]| load("", sets).unwrap().config().provenance_toml(None).unwrap();
    let plain = of(&[]);
    assert_eq!(plain, of(&["run.rate=1", "run.out=elsewhere", "run.domain=x", "publisher.draw_path=false"]));
    assert_ne!(plain, of(&["odometry.seed=2"]));
    assert_ne!(plain, of(&["mapper.resolution_m=0.1"]));
    assert!(plain.starts_with("[odometry]\n") && plain.contains("\n[mapper]\n") && !plain.contains("[robot"));
    let on_pioneer = of(&["run.robot=pioneer3dx"]);
    assert!(on_pioneer.contains("[robot]\nname = \"pioneer3dx\"\n"), "{on_pioneer}");
    // Where files lie decides nothing, what is done with them does.
    let by_reference = |keys: &str| {
        let graph = parse_graph(&format!("[localizer]\nsource = 'reference'\n{keys}\n")).unwrap();
        graph.provenance_toml(None).unwrap()
    };
    let by_a = by_reference("reference = 'a.txt'");
    assert_eq!(by_a, by_reference("reference = 'b/c.txt'"));
    assert_ne!(by_a, by_reference("reference = 'a.txt'\nreference_gap_s = 3"));
    assert!(!by_a.contains("a.txt"), "{by_a}");
    // A simulated drive is what the simulator was set to.
    let simulated = |more: &[&str]| of(&[&["services.sensor.exec=builtin:simulator"][..], more].concat());
    assert!(!plain.contains("[simulator]"), "{plain}");
    assert!(["[simulator]\n", "world = \"office\"\n"].iter().all(|line| simulated(&[]).contains(line)));
    assert_eq!(simulated(&[]), simulated(&["simulator.record=drive.log"]));
    assert_ne!(simulated(&[]), simulated(&["simulator.seed=9"]));
    assert!(!simulated(&["simulator.world=here/floor.toml"]).contains("floor.toml"));
    // Named by the log or by the user, the same robot gives the same bytes.
    let robot = load("", &["run.robot=pioneer3dx"]).unwrap().robot().cloned();
    assert_eq!(on_pioneer, Config::default().provenance_toml(robot.as_ref()).unwrap());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn no_text_is_too_much(text in "\\PC{0,200}") {
        let _ = parse_graph(&text);
        let _ = parse_robot(&text);
        let _ = load("", &[&text]);
    }

    #[test]
    fn no_robot_is_too_much(
        lines in proptest::collection::vec(
            "(\\[(sonars|lidar|footprint|odometry)\\]|\\[\\[sonar\\]\\]|(name|x_m|y_m|heading_deg|beams|range_max_m|sonar|lidar) = (-?[0-9]{1,9}|'[a-z]{0,5}'|\\[\\{\\}\\]))",
            0..12,
        )
    ) {
        let _ = parse_robot(&lines.join("\n"));
    }

    #[test]
    fn nothing_that_looks_like_a_graph_is_too_much(
        lines in proptest::collection::vec(
            (
                "(run|mapper|odometry|replay|publisher|services\\.[a-z]{1,9}|services|robot)",
                "(rate|robot|kind|exec|args|env|sonars|systematic|resolution_m|max_range_m|formats|log|[a-z_.\"]{1,9})",
                "(-?[0-9]{1,22}(\\.[0-9]{1,3})?|\"\\PC{0,9}\"|\\[.{0,9}\\]|\\{[a-z]=1\\}|'(laser|max|all|mapper|builtin:[a-z]{1,8})')",
            ),
            0..8,
        )
    ) {
        let text: String = lines.iter().map(|(table, key, value)| format!("[{table}]\n{key} = {value}\n")).collect();
        let _ = parse_graph(&text);
        for (table, key, value) in &lines {
            let _ = parse_graph(&format!("[{table}]\n{key} = {value}\n"));
            let _ = load("", &[&format!("{table}.{key}={value}")]);
        }
    }
}

#[test]
fn deep_and_long_texts() {
    for text in [
        "[".repeat(100_000),
        format!("a = {}", "[".repeat(100_000)),
        format!("a = {}", "{a=".repeat(100_000)),
        format!("{}a = 1", "a.".repeat(100_000)),
        format!("[{}a]", "a.".repeat(100_000)),
        format!("a = {}1{}", "[".repeat(100_000), "]".repeat(100_000)),
        "[a]\n".repeat(100_000),
        "#".repeat(3_000_000),
    ] {
        let message = parse_graph(&text).unwrap_err().to_string();
        assert!(message.lines().count() <= 21, "{} lines", message.lines().count());
        let _ = load("", &[&format!("mapper.sonars={text}")]);
        let _ = load("", &[&text]);
    }
}
