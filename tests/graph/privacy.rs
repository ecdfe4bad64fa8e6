//! What a graph keeps in shared memory is for its user alone; what it saves is the user's, as the user's umask says.

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use echogrid_harness::GraphProcess;
use echogrid_topics::Domain;
use nix::sys::signal::Signal;

use crate::support::{Drive, ECHOGRID, echogrid, said};

fn mode(path: &Path) -> u32 {
    std::fs::symlink_metadata(path).unwrap().mode() & 0o777
}

/// A path and all below it that is there for long enough to be looked at.
fn walk(path: &Path, found: &mut Vec<(PathBuf, u32)>) {
    let Ok(meta) = std::fs::symlink_metadata(path) else { return };
    found.push((path.to_owned(), meta.mode() & 0o777));
    for entry in std::fs::read_dir(path).into_iter().flatten().flatten() {
        walk(&entry.path(), found);
    }
}

#[test]
fn nobody_else_can_get_at_a_running_graph() {
    let drive = Drive::new(f64::INFINITY);
    let name = format!("private-{}", std::process::id());
    let domain = Domain::named(&name).unwrap();
    // A user who hides nothing.
    let mut arguments = ["-c", "umask 0 && exec \"$@\"", "sh", ECHOGRID].map(str::to_owned).to_vec();
    arguments.extend(drive.map_arguments("maps", &["--rate", "10"]));
    let mut graph = GraphProcess::start_in(&name, "sh", arguments);
    graph.wait_for("messages");
    let status = echogrid(["status", "--domain", &name]);
    assert!(status.status.success(), "{}", said(&status));

    let base = domain.dir().parent().unwrap().to_owned();
    assert_eq!(mode(&base), 0o700);
    for private in [domain.iceoryx2_config(), domain.dir().join("plan.toml")] {
        assert_eq!(mode(&private), 0o600, "{}", private.display());
    }
    for lock in ["owner", "members"] {
        assert_eq!(mode(&base.join(format!("{name}.{lock}"))), 0o600, "{lock}");
    }
    let mut inside = Vec::new();
    walk(&domain.dir(), &mut inside);
    assert!(inside.len() > 50, "{inside:?}");
    for (path, mode) in inside {
        // iceoryx2 lets the group look into its folders, which it can't reach.
        let allowed = if path.is_dir() && path != domain.dir() { 0o750 } else { 0o700 };
        assert_eq!(mode & !allowed, 0, "{} has mode {mode:04o}", path.display());
    }
    // These lie where everybody can reach them.
    let mut objects = 0;
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        if entry.file_name().to_string_lossy().starts_with(&domain.prefix()) {
            let Ok(meta) = entry.metadata() else { continue };
            assert_eq!(meta.mode() & 0o077, 0, "{} has mode {:04o}", entry.path().display(), meta.mode() & 0o777);
            objects += 1;
        }
    }
    assert!(objects > 50, "{objects}");

    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(mode(&drive.out("maps/map.png")), 0o666);
}
