//! What systemd hears of a graph that it has started.

use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use echogrid_harness::GraphProcess;
use nix::sys::signal::Signal;

use super::graph_file::NOTHING;
use crate::support::{Drive, ECHOGRID, path};

/// A deadlock of the test, not a speed that is asked for.
const PATIENCE: Duration = Duration::from_secs(120);

#[test]
fn systemd_hears_ready_then_alive_then_stopping_from_the_launcher_alone() {
    let drive = Drive::new(60.0);
    let address = drive.out("notify");
    let socket = UnixDatagram::bind(&address).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let next = || {
        let mut said = [0; 256];
        let size = socket.recv(&mut said).unwrap();
        String::from_utf8(said[..size].to_vec()).unwrap().trim().to_owned()
    };
    let environment = [format!("NOTIFY_SOCKET={}", path(&address)), "WATCHDOG_USEC=400000".to_owned()];
    let run =
        [ECHOGRID, "map", &path(&drive.log()), "--rate", "1", "--out", &path(&drive.out("maps"))].map(str::to_owned);
    // `env` becomes the launcher.
    let mut graph = GraphProcess::start("/usr/bin/env", environment.into_iter().chain(run));
    // It is alive while it waits for the services, too.
    let until = |word: &str| -> Vec<String> { core::iter::repeat_with(next).take_while(|said| said != word).collect() };
    assert!(until("READY=1").iter().all(|said| said == "WATCHDOG=1"));
    graph.wait_for("all services ready");
    for _ in 0..3 {
        assert_eq!(next(), "WATCHDOG=1");
    }
    graph.signal(Signal::SIGTERM);
    assert!(until("STOPPING=1").iter().all(|said| said == "WATCHDOG=1"));
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), NOTHING);
}
