//! Services that die before they, or those downstream of them, have stored anything.

use echogrid_harness::GraphProcess;

use super::graph_file::NOTHING;
use crate::support::{Drive, ECHOGRID};

/// How far a service is when it is killed; 0: hardly started.
const AT: [u64; 2] = [0, 20];

#[test]
fn whoever_dies_early_is_replaced_and_the_map_is_the_same() {
    let drive = Drive::new(2.0);
    let reference = drive.native_map("reference", &["--fix", "truth"]);
    let die = &|service: &str| {
        for at in AT {
            let out = format!("{service}-{at}");
            let arguments = ["--fix", "truth", "--rate", "10", "--json", "--set", "supervision.backoff_s=0.02"];
            let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments(&out, &arguments));
            if at > 0 {
                graph.wait_for_progress(service, at);
            }
            graph.kill(service);
            let ended = graph.wait();
            let summary = ended.summary();
            assert_eq!(summary["restarts"][service], 1, "{service} at {at}: {}", ended.stderr);
            assert_eq!(summary["lost_messages"], 0, "{service} at {at}: {}", ended.stderr);
            assert_eq!(ended.leftovers(), NOTHING, "{service} at {at}");
            let map = std::fs::read(drive.out(&out).join("map.echogrid")).unwrap();
            assert!(map == reference, "{service} at {at}: the map differs\n{}", ended.stderr);
        }
    };
    std::thread::scope(|scope| {
        let services = ["sensor", "odometry", "localizer", "mapper", "publisher"];
        let deaths = services.map(|service| scope.spawn(move || die(service)));
        deaths.into_iter().for_each(|death| death.join().unwrap());
    });
}
