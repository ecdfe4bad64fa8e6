//! Users on one machine: their graphs don't meet, root's included.

use std::fs::Permissions;
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::Path;
use std::process::{Command, Output};

use echogrid_formats::map::native;
use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;
use nix::unistd::Uid;

use crate::support::{Drive, ECHOGRID, echogrid, path, said};

/// Another user.
const NOBODY: u32 = 65_534;
const AS_NOBODY: [&str; 3] = ["--reuid=65534", "--regid=65534", "--clear-groups"];

/// What runs as another user; none, with the reason said, where that is not possible.
fn other_user() -> Option<()> {
    let works = || Command::new("setpriv").args(AS_NOBODY).arg("true").status().is_ok_and(|status| status.success());
    let why = match Uid::current().is_root() {
        false => "not root, who alone can run a graph as another user",
        true if !works() => "no setpriv here, or it may not change users",
        true => return Some(()),
    };
    eprintln!("skipped: {why}");
    None
}

fn open_to_all(path: &Path) {
    std::fs::set_permissions(path, Permissions::from_mode(0o755)).unwrap();
}

fn objects_of_nobody(prefix: &str) -> usize {
    let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let theirs = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    theirs.filter(|entry| entry.metadata().is_ok_and(|meta| meta.uid() == NOBODY)).count()
}

#[test]
fn root_neither_joins_nor_harms_the_graph_of_another_user() {
    if other_user().is_none() {
        return;
    }
    let drive = Drive::new(f64::INFINITY);
    let folder = drive.log().parent().unwrap().to_owned();
    let (program, out) = (folder.join("echogrid"), folder.join("theirs"));
    std::fs::copy(ECHOGRID, &program).unwrap();
    std::fs::create_dir(&out).unwrap();
    chown(&out, Some(NOBODY), Some(NOBODY)).unwrap();
    for shared in [&folder, &program, &drive.log()] {
        open_to_all(shared);
    }
    let name = format!("two-{}", std::process::id());
    let prefix = format!("eg{NOBODY}_{name}_");
    let mut arguments = AS_NOBODY.map(str::to_owned).to_vec();
    arguments.push(path(&program));
    arguments.extend(drive.map_arguments("theirs", &["--rate", "10"]));
    let mut theirs = GraphProcess::start_in(&name, "setpriv", arguments);
    theirs.wait_for("messages");
    let as_nobody = |words: &[&str]| -> Output {
        Command::new("setpriv").args(AS_NOBODY).arg(&program).args(words).output().unwrap()
    };

    // Root is told whose it is, however it names it.
    let refused = |output: &Output| {
        let error = String::from_utf8_lossy(&output.stderr);
        let whose = format!("domain \"{name}\" belongs to user {NOBODY}");
        assert!(!output.status.success() && error.contains(&whose) && error.contains("sudo -u"), "{}", said(output));
    };
    for command in ["status", "save", "pause"] {
        refused(&echogrid([command, "--domain", &name]));
    }
    refused(&echogrid(["why", "1", "1", "--domain", &name]));
    let service = Command::new(ECHOGRID)
        .args(["service", "mapper"])
        .envs([("ECHOGRID_DOMAIN", name.as_str()), ("ECHOGRID_SERVICE", "mapper")])
        .output()
        .unwrap();
    refused(&service);

    // Root's own graph in a domain of the same name, its sweep, and its cleaning leave theirs alone.
    let before = objects_of_nobody(&prefix);
    assert!(before > 50, "{before}");
    let ours = drive.map("ours", &["--domain", &name, "-q"]);
    assert!(ours.status.success(), "{}", said(&ours));
    let doctor = echogrid(["doctor", "--clean"]);
    assert!(String::from_utf8_lossy(&doctor.stdout).contains(&format!("user {NOBODY}")), "{}", said(&doctor));
    assert!(objects_of_nobody(&prefix) > 50);
    let status = as_nobody(&["status", "--domain", &name]);
    let text = String::from_utf8_lossy(&status.stdout);
    for service in ["sensor", "odometry", "mapper", "publisher"] {
        let line = text.lines().find(|line| line.starts_with(service)).unwrap_or_else(|| panic!("{}", said(&status)));
        assert!(line.contains("running") && line.contains(", 0 lost"), "{line}");
    }
    let saved = as_nobody(&["save", "--domain", &name]);
    assert!(saved.status.success(), "{}", said(&saved));

    theirs.signal(Signal::SIGINT);
    let ended = theirs.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert!(native::read(&out.join("map.echogrid")).unwrap().path.len() > 10);
    assert_eq!(objects_of_nobody(&prefix), 0);
}
