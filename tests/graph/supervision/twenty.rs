//! Many graphs at a time.

use super::graph_file::{GraphFile, NOTHING};
use crate::support::Drive;

#[test]
fn twenty_graphs_at_a_time_do_not_meet() {
    let drive = Drive::new(1.0);
    let reference = drive.native_map("reference", &["--rate", "max"]);
    let map = || {
        let own = Drive::of(&drive);
        let file = GraphFile::new(&own, "maps");
        let ended = file.start(&[]).wait();
        let summary = ended.summary();
        assert_eq!((ended.restarts(), &summary["lost_messages"]), (0, &0.into()), "{summary}");
        assert_eq!(ended.leftovers(), NOTHING);
        file.map_bytes()
    };
    let maps: Vec<Vec<u8>> = std::thread::scope(|scope| {
        let graphs = [(); 20].map(|()| scope.spawn(map));
        graphs.map(|graph| graph.join().unwrap()).into()
    });
    assert!(maps.iter().all(|map| *map == reference), "a map differs");
}
