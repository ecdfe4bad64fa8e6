//! A disk that is full when a map is saved: the map that was there is there still, and the next save succeeds when there is room.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use echogrid::config::{Config, LoadRequest};
use echogrid_formats::map::{Provenance, native};
use echogrid_harness::GraphProcess;
use echogrid_harness::disk::{PAGE, empty, fill};
use echogrid_publisher::PublisherService;
use echogrid_service::{Outbox, Service};
use echogrid_topics::Command;

use crate::support::{Drive, ECHOGRID, echogrid, folder_in_a_namespace, in_a_namespace, said};

/// A disk, and shared memory apart from that of other tests.
const MOUNT: &str = "mount -t tmpfs -o size=4m tmpfs \"$1\" && mount -t tmpfs -o size=256m tmpfs /dev/shm";

type Files = BTreeMap<String, Vec<u8>>;

/// What a publisher saves, in its order.
const ORDER: [&str; 8] =
    ["map.echogrid", "map.png", "map.pgm", "map.yaml", "map.npy", "doubt.npy", "doubt.png", "sonars.png"];
/// What a mapper saves.
const READINGS: &str = "readings.echogrid";
/// Those that lie where `map.yaml` says.
const FRAMED: [&str; 4] = ["map.pgm", "map.yaml", "map.npy", "doubt.npy"];

/// All files of a folder; those in the making, too.
fn files(folder: &Path) -> Files {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap())).collect()
}

/// A publisher with the map of a drive in it, saving all that there is to save.
fn publisher(drive: &Drive, out: &Path) -> PublisherService {
    let sets = ["mapper.doubt=true", "mapper.sonar_maps=true"].map(str::to_owned).to_vec();
    let request = LoadRequest {
        log: Some(drive.log().display().to_string()),
        robot: Some("pioneer3at".into()),
        sets,
        ..LoadRequest::default()
    };
    let config = Config::load(&request).unwrap().into_config();
    let mut publisher = PublisherService::new(config.publisher.clone(), out.into(), Provenance::default()).unwrap();
    echogrid::in_process::run(&config, &mut publisher).unwrap();
    publisher
}

#[test]
fn a_full_disk_costs_no_map() {
    let folder = tempfile::tempdir().unwrap();
    in_a_namespace("disk_full::every_file_of_a_save", MOUNT, folder.path());
}

#[test]
#[ignore = "run in a namespace by the test above"]
fn every_file_of_a_save() {
    let Some(disk) = folder_in_a_namespace() else { return };
    let out = disk.join("maps");
    publisher(&Drive::new(3.0), &out);
    let old = files(&out);
    let mut publisher = publisher(&Drive::new(6.0), &out);
    let new = files(&out);
    assert!(new.keys().map(String::as_str).eq(BTreeSet::from(ORDER)), "{:?}", new.keys());
    assert!(ORDER.iter().all(|name| new[*name] != old[*name]), "nothing new in one of them");
    let mut save_on_a_full_disk = |before: &Files, free: u64| {
        std::fs::remove_dir_all(&out).unwrap();
        std::fs::create_dir(&out).unwrap();
        before.iter().for_each(|(name, bytes)| std::fs::write(out.join(name), bytes).unwrap());
        fill(&disk, free);
        let saved = publisher.command(Command::Save, &mut Outbox::default()).map_err(|error| format!("{error:#}"));
        let there = files(&out);
        for (name, bytes) in &there {
            let whole = new.get(name) == Some(bytes) || before.get(name) == Some(bytes);
            assert!(whole, "{free} bytes free: {name} is damaged, or should not be");
        }
        assert!(before.keys().all(|name| there.contains_key(name)), "{free} bytes free: {:?}", there.keys());
        (saved, there)
    };

    // With every file of the map before there: those in one frame are all old or all new.
    for free in (0..).map(|pages| pages * PAGE) {
        let (saved, there) = save_on_a_full_disk(&old, free);
        assert!(there.keys().eq(new.keys()), "{free} bytes free: {:?}", there.keys());
        let is_new = |name: &str| there[name] == new[name];
        assert!(FRAMED.iter().all(|name| is_new(name) == is_new(FRAMED[0])), "{free} bytes free");
        if saved.is_ok() {
            assert!(ORDER.iter().all(|name| is_new(name)));
            break;
        }
    }
    // What is replaced leaves room. So, for each file, with no other there and with room for those before it only.
    let mut free = 0;
    for name in ORDER {
        let before = Files::from([(name.to_owned(), old[name].clone())]);
        let (saved, there) = save_on_a_full_disk(&before, free);
        let error = saved.unwrap_err();
        assert!(error.contains(&out.join(name).display().to_string()), "{name}: {error}");
        assert!(error.contains("No space left on device"), "{error}");
        assert!(there[name] == old[name], "{name} is not what it was");
        free += (new[name].len() as u64).div_ceil(PAGE) * PAGE;
    }
    let (saved, there) = save_on_a_full_disk(&Files::new(), free);
    assert!(saved.is_ok() && there == new, "{saved:?}");
}

#[test]
fn a_running_graph_survives_a_full_disk() {
    let folder = tempfile::tempdir().unwrap();
    in_a_namespace("disk_full::a_graph_on_a_small_disk", MOUNT, folder.path());
}

#[test]
#[ignore = "run in a namespace by the test above"]
fn a_graph_on_a_small_disk() {
    let Some(disk) = folder_in_a_namespace() else { return };
    let out = disk.join("maps");
    let log = Drive::new(f64::INFINITY);
    let start = |domain: &str| {
        let log = log.log();
        let arguments: [&str; 9] = [
            "map",
            log.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
            "--rate",
            "1",
            "--set",
            "mapper.keep_readings=true",
            "--quiet",
        ];
        GraphProcess::start_in(domain, ECHOGRID, arguments)
    };
    let save = |domain: &str| echogrid(["save", "--domain", domain]);
    let refused = |output: &std::process::Output, name: &str, before: &Files| {
        let error = String::from_utf8_lossy(&output.stderr);
        let path = out.join(name).display().to_string();
        assert!(!output.status.success() && error.contains(&path), "{}", said(output));
        assert!(error.contains("No space left on device"), "{error}");
        assert_eq!(files(&out).get(name), before.get(name));
        assert!(files(&out).keys().eq(before.keys()), "{:?}", files(&out).keys());
    };

    let mut graph = start("small");
    graph.wait_for("all services ready");
    // Not before there is a map.
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
    let mut saved = save("small");
    while !saved.status.success() && std::time::Instant::now() < deadline {
        saved = save("small");
    }
    assert!(saved.status.success(), "{}", said(&saved));
    let before = files(&out);
    assert!(before.contains_key(READINGS), "{:?}", before.keys());
    fill(&disk, 0);
    refused(&save("small"), "map.echogrid", &before);
    // With room for the map alone, and not for the readings that it is made of.
    let (readings, map): (Files, Files) = before.into_iter().partition(|(name, _)| name == READINGS);
    let pages = |files: &Files| files.values().map(|bytes| (bytes.len() as u64).div_ceil(PAGE)).sum::<u64>();
    let mut free = PAGE * (pages(&map) - 1);
    let error = loop {
        map.keys().for_each(|name| drop(std::fs::remove_file(out.join(name))));
        fill(&disk, free);
        let output = save("small");
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && error.contains("No space left on device"), "{}", said(&output));
        if !error.contains("publisher: ") {
            break error;
        }
        free += PAGE;
    };
    assert!(error.contains(&out.join(READINGS).display().to_string()), "{error}");
    assert!(files(&out)[READINGS] == readings[READINGS]);
    native::read(&out.join("map.echogrid")).unwrap();
    // Its services live on, and save as soon as there is room.
    empty(&disk);
    let saved = save("small");
    assert!(saved.status.success(), "{}", said(&saved));
    native::read(&out.join("map.echogrid")).unwrap();

    // At its end, too: the map that was saved last is there still, and the error names what is not.
    let before = files(&out);
    fill(&disk, 0);
    graph.signal(nix::sys::signal::Signal::SIGINT);
    let ended = graph.wait();
    assert_eq!(ended.status.code(), Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("No space left on device"), "{}", ended.stderr);
    // What the system refuses is said once: another life would be refused the same.
    assert!(!ended.stderr.contains("restarted"), "{}", ended.stderr);
    assert!(ended.stderr.contains(&out.join("map.echogrid").display().to_string()), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
    assert!(files(&out) == before, "the files of the map before are not what they were");
}
