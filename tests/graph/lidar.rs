//! A sensor of two services: where the robot drives says one, what a lidar sees the other.

use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use echogrid_harness::GraphProcess;
use echogrid_lidar::codec::ld19::{POINTS, Packet};
use nix::sys::signal::Signal;

use crate::support::{ECHOGRID, echogrid, path, said};

/// A robot with a lidar of 360 beams, and the base that stands still and says so.
const ROBOT: &str = "name = \"cart\"\n[footprint]\nlength_m = 0.4\nwidth_m = 0.3\n[lidar]\nx_m = 0.1\ny_m = 0.0\nheading_deg = 0\n\
                     beams = 360\nfirst_bearing_deg = -180\nfield_of_view_deg = 359\nrange_min_m = 0.05\nrange_max_m = 12\n\
                     range_error_ratio = 0.01\n";
const BASE: &str = "[run]\nrobot = \"cart.toml\"\nout = \"maps\"\n[services.base]\nkind = \"sensor\"\nexec = \"/bin/sh\"\nspeaks = \"carmen\"\n\
                    args = [\"-c\", 'while :; do read up rest < /proc/uptime; echo \"ODOM 0 0 0 0 0 0 $up host $up\"; sleep 0.1; done']\n";

/// A turn of a lidar in the middle of a round room of 2 m.
fn turn() -> Vec<u8> {
    let points = [(2000, 200); POINTS];
    let packet = |n: u16| Packet { speed_degps: 3600, first: n * 900, last: n * 900 + 825, stamp_ms: n, points };
    (0..40).flat_map(|n| packet(n).bytes()).collect()
}

/// Turns ten times a second for whoever connects, until nobody listens.
fn serve(mut stream: TcpStream) {
    while stream.write_all(&turn()).is_ok() {
        std::thread::park_timeout(Duration::from_millis(100));
    }
}

#[test]
fn odometry_of_one_and_scans_of_another_are_one_map_whoever_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            std::thread::spawn(move || serve(stream));
        }
    });
    std::fs::write(folder.path().join("cart.toml"), ROBOT).unwrap();
    let file = folder.path().join("graph.toml");
    let text = format!(
        "{BASE}writes = [\"robot/description\", \"odometry/raw\"]\n[services.lidar]\nexec = \"builtin:lidar\"\n\
         [lidar]\nmodel = \"ld19\"\nport = \"tcp:127.0.0.1:{port}\"\n"
    );
    std::fs::write(&file, text).unwrap();
    let mut graph = GraphProcess::start(ECHOGRID, ["up", &path(&file), "--json"]);
    graph.wait_for_progress("mapper", 60);
    for (kills, service) in ["lidar", "base"].into_iter().enumerate() {
        graph.kill(service);
        graph.wait_for_nth("started (process", 6 + kills);
    }
    let before = std::cell::Cell::new(0);
    graph.wait_until("the mapper is known", |view| {
        before.set(view.progress("mapper"));
        before.get() > 0
    });
    let before = before.get();
    graph.wait_until("both go on", |view| view.progress("mapper") > before + 100);
    graph.signal(Signal::SIGINT);
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    let summary = ended.summary();
    assert!(summary["scans"].as_u64().unwrap() > 30 && summary["lost_messages"] == 0, "{summary}");
    // The round room, of which every beam hits the wall.
    let size = summary["extent_m"].as_array().unwrap().iter().map(|side| side.as_f64().unwrap());
    assert!(size.into_iter().all(|side| (3.9..4.4).contains(&side)), "{summary}");
    // Whoever of the two ends first: beams of the last turn may have no pose.
    let refused = summary["refused"].as_array().unwrap();
    assert!(refused.iter().all(|row| row["reason"] == "no_pose"), "{summary}");
    let count = |key: &str| summary[key].as_u64().unwrap();
    assert!(count("readings") - count("accepted") < 2 * 360, "{summary}");
}

#[test]
fn who_writes_what_is_told_where_it_is_not_said() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cart.toml"), ROBOT).unwrap();
    let file = folder.path().join("graph.toml");
    for (text, wanted) in [
        ("[services.lidar]\nexec = \"builtin:lidar\"\n", "base and lidar all write range/scan"),
        (
            "writes = [\"robot/description\"]\n[services.lidar]\nexec = \"builtin:lidar\"\n",
            "nobody writes odometry/raw",
        ),
        ("writes = [\"map/tiles\"]\n", "does not write map/tiles; expected some of robot/description"),
    ] {
        std::fs::write(&file, [BASE, text].concat()).unwrap();
        let checked = echogrid(["check", &path(&file)]);
        assert!(!checked.status.success() && said(&checked).contains(wanted), "{wanted}: {}", said(&checked));
    }
}
