//! Sensors of other languages: programs that print lines, programs in Python and in C.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use echogrid_harness::{Ended, GraphProcess};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use tempfile::TempDir;

use crate::support::{ECHOGRID, echogrid, path, said};

/// A program as the sensor.
pub(crate) struct Foreign {
    folder: TempDir,
    section: String,
}

impl Foreign {
    /// `keys` are those of its section of the graph file.
    pub(crate) fn new(keys: &str) -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            section: format!("[services.sensor]\nkind = \"sensor\"\n{keys}\n"),
        }
    }

    /// Starts the graph; the map goes to the folder `out`.
    pub(crate) fn start(&self, out: &str, more: &[&str]) -> GraphProcess {
        let file = self.folder.path().join("graph.toml");
        std::fs::write(&file, &self.section).unwrap();
        let (file, out) = (path(&file), path(&self.folder.path().join(out)));
        let arguments = ["up", &file, "--json", "--out", &out];
        GraphProcess::start(ECHOGRID, arguments.iter().chain(more))
    }

    /// The bytes of the map of a run that ended well.
    pub(crate) fn map(&self, out: &str, graph: GraphProcess) -> (Vec<u8>, Ended) {
        let ended = graph.wait();
        assert!(ended.status.success(), "{}", ended.stderr);
        assert_eq!(ended.leftovers(), Vec::<String>::new());
        let file: PathBuf = self.folder.path().join(out).join("map.echogrid");
        (std::fs::read(file).unwrap(), ended)
    }

    /// The map is the same whoever is killed on the way: the sensor, then the mapper.
    pub(crate) fn is_the_same_whoever_dies(&self) {
        let (undisturbed, ended) = self.map("undisturbed", self.start("undisturbed", &[]));
        assert_eq!(ended.restarts(), 0);
        let mut graph = self.start("killed", &["--rate", "20"]);
        graph.wait_for_progress("sensor", 150);
        graph.kill("sensor");
        graph.wait_for("sensor died");
        graph.wait_for_progress("mapper", 300);
        graph.kill("mapper");
        graph.wait_for("mapper died");
        let (killed, ended) = self.map("killed", graph);
        assert_eq!(ended.restarts(), 2, "{}", ended.stderr);
        assert!(killed == undisturbed, "the map differs");
    }
}

/// The program that a process of the graph has started.
fn child_of(pid: u32) -> Pid {
    let children = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children")).unwrap();
    Pid::from_raw(children.split_whitespace().next().unwrap().parse().unwrap())
}

fn square(more: &str) -> Foreign {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/lines/square.sh");
    Foreign::new(&format!("exec = {script:?}\nspeaks = \"carmen\"\n{more}"))
}

/// A listener sees all of a map: it comes while the map is made, and its last line tells as many known cells as the summary.
fn sees_the_map(mut listener: Command) {
    let folder = tempfile::tempdir().unwrap();
    let gate = folder.path().join("gate");
    nix::unistd::mkfifo(&gate, nix::sys::stat::Mode::S_IRWXU).unwrap();
    let program = behind_a_gate(&gate, "replays = true");
    let mut graph = program.start("watched", &[]);
    graph.wait_for_progress("mapper", 600);
    let domain = graph.domain().name().to_owned();
    let mut listening = listener
        .arg(&domain)
        .env("ECHOGRID_DOMAIN", &domain)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(listening.stdout.take().unwrap()).lines();
    let Some(first) = lines.next() else {
        panic!("{}", String::from_utf8_lossy(&listening.wait_with_output().unwrap().stderr));
    };
    drop(std::fs::File::options().write(true).open(&gate).unwrap());
    let last = lines.map(Result::unwrap).last().unwrap_or(first.unwrap());
    let (_, ended) = program.map("watched", graph);
    let listened = listening.wait_with_output().unwrap();
    assert!(listened.status.success(), "{}", String::from_utf8_lossy(&listened.stderr));
    let known = ended.summary()["cells"]["known"].as_u64().unwrap();
    assert!(last.contains(&format!(": {known} known")), "{last}; {known} cells are known");
}

/// The square, by a program that ends when somebody opens the gate: until then its shell waits for `cat`.
fn behind_a_gate(gate: &Path, more: &str) -> Foreign {
    let script = format!("{}/examples/lines/square.sh; cat {}", env!("CARGO_MANIFEST_DIR"), path(gate));
    Foreign::new(&format!("exec = \"/bin/sh\"\nargs = [\"-c\", {script:?}]\nspeaks = \"carmen\"\n{more}"))
}

#[test]
fn a_shell_script_is_a_sensor_and_the_map_is_the_same_whoever_dies() {
    let square = square("replays = true");
    square.is_the_same_whoever_dies();
}

#[test]
fn a_program_that_is_killed_is_started_again_though_what_it_started_holds_its_output() {
    let folder = tempfile::tempdir().unwrap();
    let gate = folder.path().join("gate");
    nix::unistd::mkfifo(&gate, nix::sys::stat::Mode::S_IRWXU).unwrap();
    let program = behind_a_gate(&gate, "replays = true");
    let run = |out: &str, is_killed: bool| {
        let mut graph = program.start(out, &[]);
        graph.wait_for_progress("sensor", 1000);
        if is_killed {
            kill(child_of(graph.pid_of("sensor")), Signal::SIGKILL).unwrap();
            graph.wait_for("/bin/sh: was killed by signal 9 (SIGKILL)");
            graph.wait_for_nth("sensor started", 2);
            graph.wait_for_progress("sensor", 1000);
        }
        drop(std::fs::File::options().write(true).open(&gate).unwrap());
        program.map(out, graph).0
    };
    assert!(run("killed", true) == run("undisturbed", false), "the map differs");
}

#[test]
fn a_program_that_measures_what_is_now_goes_on_after_it_died() {
    // Without a clock of its own: each line is of the time at which it comes. It never ends by itself.
    let script = format!(
        "{}/examples/lines/square.sh | sed '/^PARAM/!s/ [0-9.]* sh 0$/ 0 sh 0/'; exec tail -f /dev/null",
        env!("CARGO_MANIFEST_DIR")
    );
    let program = Foreign::new(&format!("exec = \"/bin/sh\"\nargs = [\"-c\", {script:?}]\nspeaks = \"carmen\""));
    let mut graph = program.start("live", &["--rate", "1"]);
    // Nobody waits a minute for what is measured now.
    graph.wait_for_progress("mapper", 1200);
    graph.kill("sensor");
    graph.wait_for_nth("sensor started", 2);
    graph.wait_for_progress("mapper", 2400);
    graph.signal(Signal::SIGINT);
    let (_, ended) = program.map("live", graph);
    // All of it a second time: nobody knows that it is the same.
    assert!(ended.summary()["scans"].as_u64().unwrap() >= 1199, "{}", ended.stdout);
    assert_eq!((&ended.summary()["lost_messages"], &ended.summary()["faulty_messages"]), (&0.into(), &0.into()));
}

#[test]
fn lines_that_are_none_are_said_with_their_number_and_a_program_that_cannot_map_is_an_error() {
    let said = |script: &str| {
        let program = Foreign::new(&format!(
            "exec = \"/bin/sh\"\nargs = [\"-c\", {script:?}]\nspeaks = \"carmen\"\nreplays = true"
        ));
        let ended = program.start("out", &[]).wait();
        assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
        ended.stderr
    };
    let no_maximum = said("echo ODOM 0 0 0 0 0 0 1 h 0; echo SONAR 0.5 1 2 0 0 0 1 h 0");
    assert!(no_maximum.contains("sensor: nothing says how far the sensor of SONAR can see; print"), "{no_maximum}");
    let nothing = said("echo ODOM 1 2 x 0 0 0 1 h 0");
    assert!(nothing.contains("sensor: no range readings in it") && nothing.contains("in line 1: \"x\""), "{nothing}");
}

/// A Python that has what the module needs: the one that `ECHOGRID_PYTHON` names, or a virtual environment that is made for the tests.
pub(crate) fn python() -> Option<PathBuf> {
    let has_all = |python: &PathBuf| {
        let import = Command::new(python).args(["-c", "import iceoryx2, numpy"]).output();
        import.is_ok_and(|output| output.status.success())
    };
    if let Some(named) = std::env::var_os("ECHOGRID_PYTHON").map(PathBuf::from) {
        assert!(has_all(&named), "ECHOGRID_PYTHON={}: has no iceoryx2 and numpy", named.display());
        return Some(named);
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| {
        Command::new(program).args(arguments).output().is_ok_and(|output| output.status.success())
    };
    let install = ["-m", "pip", "install", "--quiet", "iceoryx2==0.10.0", "numpy"];
    let is_there = has_all(&python)
        || (run(Path::new("python3"), &["-m", "venv", &path(&folder)]) && run(&python, &install) && has_all(&python));
    if !is_there {
        eprintln!(
            "skipped: no Python with pip that could install iceoryx2 0.10.0 and numpy; ECHOGRID_PYTHON names one that has them"
        );
    }
    is_there.then_some(python)
}

/// Where the module lies.
pub(crate) const MODULE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/python");

/// A script of the examples as the sensor.
fn python_sensor(python: &Path, script: &str) -> Foreign {
    let script = format!("{}/examples/python/{script}", env!("CARGO_MANIFEST_DIR"));
    Foreign::new(&format!("exec = {python:?}\nargs = [{script:?}]\nenv = {{ PYTHONPATH = {MODULE:?} }}"))
}

#[test]
fn a_python_sensor_makes_the_same_map_whoever_dies_and_a_listener_sees_it() {
    let Some(python) = python() else { return };
    let sensor = python_sensor(&python, "random_walk.py");
    sensor.is_the_same_whoever_dies();
    let mut listener = Command::new(&python);
    listener.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/python/watch_map.py")).env("PYTHONPATH", MODULE);
    sees_the_map(listener);
}

#[test]
fn a_python_sensor_that_fails_says_why_and_one_that_is_stopped_saves_the_map() {
    let Some(python) = python() else { return };
    let of = |body: &str| {
        let script = format!(
            "import echogrid\nwith echogrid.Sensor(echogrid.Robot('one', [echogrid.sonar(0, 0, 0)])) as sensor:\n    \
             for t in range(10**9):\n        sensor.odometry(t * 0.1, t * 0.01, 0, 0)\n        sensor.scan(t * 0.1, [2.0])\n        {body}\n"
        );
        Foreign::new(&format!(
            "exec = {python:?}\nargs = [\"-c\", {script:?}]\nenv = {{ PYTHONPATH = {MODULE:?} }}\nrestart = \"never\""
        ))
    };
    let ended = of("1 / (50 - t)").start("fails", &[]).wait();
    assert_eq!(ended.status.code(), Some(1));
    assert!(ended.stderr.contains("sensor: ZeroDivisionError: division by zero"), "{}", ended.stderr);
    let endless = of("pass");
    let mut graph = endless.start("stopped", &["--rate", "50"]);
    graph.wait_for_progress("mapper", 100);
    graph.signal(Signal::SIGINT);
    let (map, _) = endless.map("stopped", graph);
    assert!(!map.is_empty());
}

/// A program of the examples in C, built against the library of this build; none where there is no compiler.
fn c_program(folder: &Path, name: &str) -> Option<PathBuf> {
    // The library is built for the tests, as one of their dependencies, and lies beside them.
    let beside = std::env::current_exe().unwrap().parent().unwrap().to_path_buf();
    assert!(beside.join("libechogrid_c.so").exists(), "no library beside {}", beside.display());
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (source, program) = (root.join("examples/c").join(name).with_extension("c"), folder.join(name));
    let mut compiler = Command::new("cc");
    compiler
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(root.join("c"))
        .arg(&source)
        .arg("-o")
        .arg(&program);
    compiler.arg("-L").arg(&beside).args(["-lechogrid_c", "-lm"]).arg(format!("-Wl,-rpath,{}", beside.display()));
    let Ok(built) = compiler.output() else {
        eprintln!("skipped: no C compiler (cc)");
        return None;
    };
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    Some(program)
}

#[test]
fn a_c_sensor_makes_the_same_map_whoever_dies_and_a_listener_sees_it() {
    let folder = tempfile::tempdir().unwrap();
    let Some((square, watch)) = c_program(folder.path(), "square").zip(c_program(folder.path(), "watch_map")) else {
        return;
    };
    let sensor = Foreign::new(&format!("exec = {square:?}"));
    sensor.is_the_same_whoever_dies();
    sees_the_map(Command::new(&watch));
}

/// `echogrid new sensor` in this language, and what its own test says.
fn begun(language: &str, environment: &[(&str, &Path)]) {
    let folder = tempfile::tempdir().unwrap();
    let new = folder.path().join("mine");
    let made = echogrid(["new", "sensor", "--lang", language, "--source", env!("CARGO_MANIFEST_DIR"), &path(&new)]);
    assert!(made.status.success(), "{}", said(&made));
    let again = echogrid(["new", "sensor", "--lang", language, &path(&new)]);
    assert!(said(&again).contains("is not empty; expected a new or empty folder"), "{}", said(&again));
    let mut test = Command::new(new.join("test.sh"));
    test.env("ECHOGRID", ECHOGRID).envs(environment.iter().copied());
    let tested = test.output().unwrap();
    assert!(tested.status.success() && said(&tested).contains("ok: the same map twice"), "{}", said(&tested));
}

#[test]
fn a_sensor_that_was_begun_in_lines_or_python_passes_its_own_test() {
    begun("lines", &[]);
    let Some(python) = python() else { return };
    // The script asks for the python3 on PATH, as one in an environment that is active.
    let found = PathBuf::from(format!("{}:{}", path(python.parent().unwrap()), std::env::var("PATH").unwrap()));
    begun("python", &[("PATH", &found)]);
}

/// Where a stand-in for rclpy lies.
const STAND_IN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/graph/stand_in");

#[test]
fn a_node_of_ros_2_is_a_sensor_and_another_publishes_the_map() {
    // No ROS: a stand-in that drives around a room, and prints what is published.
    let Some(python) = python() else { return };
    let of_ros = |name: &str| format!("{}/examples/ros/{name}", env!("CARGO_MANIFEST_DIR"));
    let sensor = Foreign::new(&format!(
        "exec = {python:?}\nargs = [{:?}]\nenv = {{ PYTHONPATH = {STAND_IN:?} }}\nspeaks = \"carmen\"\nreplays = true",
        of_ros("lines_of_ros2.py")
    ));
    let (_, ended) = sensor.map("out", sensor.start("out", &[]));
    assert_eq!(ended.summary()["scans"], 300, "{}", ended.stdout);
    let mut publisher = Command::new(&python);
    publisher.arg(of_ros("map_to_ros2.py")).env("PYTHONPATH", format!("{STAND_IN}:{MODULE}"));
    sees_the_map(publisher);
}
