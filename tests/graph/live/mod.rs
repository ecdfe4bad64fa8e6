//! The live page: what viewers see, who may see it, and that the map is as without it.

mod browser;
mod viewer;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use echogrid_formats::map::{native, picture};
use echogrid_harness::GraphProcess;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::json;

use crate::support::{Drive, ECHOGRID};
use viewer::{Cells, Viewer};

/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(60);

/// A run of the drive with its page, and the address of that.
fn watched(drive: &Drive, out: &str, more: &[&str]) -> (GraphProcess, String) {
    let arguments = [&["--watch=127.0.0.1:0"], more].concat();
    let mut graph = GraphProcess::start(ECHOGRID, drive.map_arguments(out, &arguments));
    let line = graph.wait_for("live page: ");
    let address = line.rsplit(' ').next().unwrap().to_owned();
    graph.wait_for(" started (process ");
    (graph, address)
}

/// Every cell as `map.png` in `folder` shows it, by its place in the map's own raster; none where it is unknown.
fn as_the_picture_shows(folder: &Path) -> Cells {
    let picture = image::open(folder.join("map.png")).unwrap().to_rgb8();
    let grid = native::read(&folder.join("map.echogrid")).unwrap().grid;
    let (low, high) = grid.bounds().unwrap();
    let (columns, rows) = ((high.i - low.i + 1) as u32, (high.j - low.j + 1) as u32);
    let side = picture.width() / columns;
    assert_eq!((picture.width(), picture.height()), (columns * side, rows * side), "the robot is inside of the map");
    let mut cells = Cells::new();
    for column in 0..columns {
        for row in 0..rows {
            let image::Rgb(colour) = *picture.get_pixel(column * side, row * side);
            if colour == picture::ROBOT {
                continue;
            }
            let level = (colour != picture::UNKNOWN).then_some(colour[0]);
            cells.insert([low.i + column as i32, high.j - row as i32], level);
        }
    }
    assert!(cells.values().flatten().count() > 1000, "something was mapped");
    cells
}

/// What does not agree, of the cells that the picture shows.
fn differences(seen: impl Fn([i32; 2]) -> Option<u8>, wanted: &Cells) -> Vec<String> {
    let differs = |(cell, level): (&[i32; 2], &Option<u8>)| {
        let seen = seen(*cell);
        (seen != *level).then(|| format!("{cell:?}: {seen:?} for {level:?}"))
    };
    wanted.iter().filter_map(differs).collect()
}

#[test]
fn a_late_viewer_and_a_late_page_show_the_whole_map_as_the_picture_does() {
    let drive = Drive::new(40.0);
    let (mut graph, address) = watched(&drive, "maps", &["--rate", "40", "--set", "publisher.draw_path=false"]);
    graph.wait_for_progress("mapper", 400);
    let mut viewer = Viewer::connect(&address);
    // A page that nobody had thought of when the graph was started.
    let mut page = Command::new(ECHOGRID)
        .args(["live", "--listen", "127.0.0.1:0", "--domain", graph.domain().name()])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(page.stdout.take().unwrap()), &mut line).unwrap();
    let mut later = Viewer::connect(line.trim());
    viewer.read_until_ended();
    later.read_until_ended();
    assert!(page.wait().unwrap().success(), "a page leaves with its graph");
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    let wanted = as_the_picture_shows(&drive.out("maps"));
    for (which, seen) in [("viewer", &viewer), ("later", &later)] {
        let wrong = differences(|cell| seen.level("occupancy", cell), &wanted);
        assert!(
            wrong.is_empty(),
            "{which}: {} of {} cells: {:?}",
            wrong.len(),
            wanted.len(),
            &wrong[..wrong.len().min(5)]
        );
        // The robot ended where the map's path does, and the trail leads there.
        let last = native::read(&drive.out("maps/map.echogrid")).unwrap().path.last().unwrap().pose;
        assert!((seen.pose["x"].as_f64().unwrap() - last.x).hypot(seen.pose["y"].as_f64().unwrap() - last.y) < 1e-9);
    }
    // The one that was there from the start knows all of the way, in steps.
    let steps = viewer.trail.windows(2).map(|two| (two[1][0] - two[0][0]).hypot(two[1][1] - two[0][1]));
    assert!(viewer.trail.len() > 300 && steps.fold(0.0, f64::max) < 0.5, "{} points", viewer.trail.len());
    assert!(viewer.beams > 0 && viewer.services.len() == 4, "{} scans, {:?}", viewer.beams, viewer.services);
    assert!(viewer.log.iter().any(|line| line.contains("all services ready")), "{:?}", viewer.log);
}

/// The status of the answer to a request.
fn status_of(address: &str, path: &str, host: Option<&str>, headers: &str) -> u16 {
    let (_, rest) = address.split_once("//").unwrap();
    let (authority, _) = rest.split_once('/').unwrap();
    let mut stream = TcpStream::connect(authority).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let host = host.unwrap_or(authority);
    // What is too large is answered before all of it was sent.
    let _ = write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n{headers}\r\n");
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    let text = String::from_utf8_lossy(&answer).into_owned();
    text.split(' ').nth(1).unwrap_or_else(|| panic!("no answer to {path}: {text:?}")).parse().unwrap()
}

#[test]
fn who_has_no_business_here_is_refused() {
    let drive = Drive::new(f64::INFINITY);
    let (graph, address) = watched(&drive, "maps", &["--rate", "5"]);
    let mut viewer = Viewer::connect(&address);
    viewer.read_until("a greeting", |seen| !seen.facts.is_null());
    let path = address.split_once("//").unwrap().1.split_once('/').unwrap().1;
    let (page, socket) = (format!("/{path}"), format!("/socket{path}"));
    let upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let origin = |origin: &str| format!("{upgrade}Origin: {origin}\r\n");
    assert_eq!(status_of(&address, &page, None, ""), 200);
    for (what, answer) in [
        ("no token", status_of(&address, "/", None, "")),
        ("another token", status_of(&address, "/?token=00112233445566778899aabbccddeeff", None, "")),
        ("a socket without a token", status_of(&address, "/socket", None, upgrade)),
        ("another host", status_of(&address, &page, Some("evil.example"), "")),
        ("a socket of another host", status_of(&address, &socket, Some("evil.example:80"), upgrade)),
        ("another origin", status_of(&address, &socket, None, &origin("http://evil.example"))),
        ("no origin of a page", status_of(&address, &socket, None, &origin("null"))),
    ] {
        assert_eq!(answer, 403, "{what}");
    }
    let long = format!("X-Long: {}\r\n", "x".repeat(64 << 10));
    assert_eq!(status_of(&address, &page, None, &long), 431);
    // One that talks too much is dropped, the other goes on.
    let mut loud = Viewer::connect(&address);
    loud.say(&json!({ "do": "save", "id": 1, "padding": "x".repeat(64 << 10) }));
    loud.read_until_dropped();
    let mut crowd: Vec<Viewer> = (0..31).map(|_| Viewer::connect(&address)).collect();
    crowd.iter_mut().for_each(|viewer| viewer.read_until("a greeting", |seen| !seen.facts.is_null()));
    assert_eq!(status_of(&address, &socket, None, upgrade), 503);
    drop(crowd);
    graph.signal(Signal::SIGINT);
    viewer.read_until_ended();
    assert!(graph.wait().status.success());
}

/// The process of the page: of its latest life.
fn page_of(graph: &GraphProcess) -> Option<Pid> {
    let of_any = std::fs::read_dir(format!("/proc/{}/task", graph.pid())).unwrap().filter_map(Result::ok);
    let children = of_any.filter_map(|task| std::fs::read_to_string(task.path().join("children")).ok());
    let children: Vec<i32> =
        children.flat_map(|text| text.split_whitespace().map(|pid| pid.parse().unwrap()).collect::<Vec<_>>()).collect();
    let is_page = |pid: &i32| {
        std::fs::read_to_string(format!("/proc/{pid}/comm")).is_ok_and(|name| name.trim() == "echogrid-live")
    };
    children.into_iter().find(is_page).map(Pid::from_raw)
}

#[test]
fn neither_ten_viewers_nor_one_that_sleeps_nor_the_death_of_the_page_change_the_map() {
    let drive = Drive::new(40.0);
    let undisturbed = drive.native_map("undisturbed", &["--rate", "40"]);
    let (mut graph, address) = watched(&drive, "watched", &["--rate", "40"]);
    // It is connected, and never reads.
    let _asleep = Viewer::connect(&address);
    let mut viewers: Vec<Viewer> = (0..10).map(|_| Viewer::connect(&address)).collect();
    viewers.iter_mut().for_each(|viewer| viewer.read_until("tiles", |seen| seen.tiles() > 0));
    graph.wait_for_progress("mapper", 300);
    let page = page_of(&graph).unwrap();
    kill(page, Signal::SIGKILL).unwrap();
    viewers.iter_mut().for_each(Viewer::read_until_dropped);
    // It is there again, at the same address.
    let mut again = Viewer::connect(&address);
    assert_ne!(page_of(&graph), Some(page));
    again.read_until_ended();
    let ended = graph.wait();
    assert!(ended.status.success(), "{}", ended.stderr);
    assert_eq!(ended.leftovers(), Vec::<String>::new());
    assert!(std::fs::read(drive.out("watched/map.echogrid")).unwrap() == undisturbed, "the map differs");
    let grid = native::read(&drive.out("watched/map.echogrid")).unwrap().grid;
    let known = grid.tiles().filter(|(_, tile)| tile.log_odds.iter().any(|cell| !cell.is_nan()));
    assert_eq!(again.tiles(), known.count(), "who comes after the death sees the whole map");
}

#[test]
fn orders_are_carried_out_and_answered() {
    let drive = Drive::new(f64::INFINITY);
    let (graph, address) = watched(&drive, "maps", &["--rate", "10", "--set", "mapper.keep_readings=true"]);
    let mut viewer = Viewer::connect(&address);
    viewer.read_until("tiles", |seen| seen.tiles() > 0);
    let saved = viewer.order(&json!({ "do": "save" }));
    assert!(saved["ok"] == true && saved["text"].as_str().unwrap().contains("publisher: saved in "), "{saved}");
    assert!(drive.out("maps/map.png").exists() && drive.out("maps/readings.echogrid").exists());
    let paused = viewer.order(&json!({ "do": "pause" }));
    assert_eq!((paused["ok"].as_bool(), paused["text"].as_str()), (Some(true), Some("mapper: mapping pauses")));
    let resumed = viewer.order(&json!({ "do": "resume" }));
    assert_eq!((resumed["ok"].as_bool(), resumed["text"].as_str()), (Some(true), Some("mapper: mapping goes on")));
    // Of the cell that is most surely a wall of the saved map.
    let document = native::read(&drive.out("maps/map.echogrid")).unwrap();
    let most = document
        .grid
        .tiles()
        .flat_map(|(index, tile)| tile.log_odds.iter().enumerate().map(move |(at, log_odds)| (index, at, *log_odds)));
    let (index, at, _) = most.filter(|(.., log_odds)| !log_odds.is_nan()).max_by(|a, b| a.2.total_cmp(&b.2)).unwrap();
    let first = index.first_cell();
    let cell = echogrid_core::CellIndex { i: first.i + (at % 64) as i32, j: first.j + (at / 64) as i32 };
    let [x, y] = document.grid.centre(cell);
    let why = viewer.order(&json!({ "do": "why", "x": x, "y": y }));
    let probability = why["why"]["probability"].as_f64().unwrap_or_default();
    assert!(why["ok"] == true && probability > 0.65, "{why}");
    assert!(
        why["why"]["readings"].as_array().unwrap().iter().any(|reading| reading["added"].as_f64().unwrap() > 0.0),
        "{why}"
    );
    let nowhere = viewer.order(&json!({ "do": "fix", "x": 1e9, "y": 0, "theta": 0, "sigma_m": 0, "sigma_rad": 0 }));
    assert!(nowhere["ok"] == false, "{nowhere}");
    graph.signal(Signal::SIGINT);
    assert!(graph.wait().status.success());
}

/// Polls until there is something.
fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < deadline, "not in time: {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
