//! The page in a browser: Chromium without a window, driven over its DevTools protocol. Skipped, and said, where there is none.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use nix::sys::signal::Signal;
use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket, connect};

use super::viewer::Cells;
use super::{PATIENCE, as_the_picture_shows, differences, until, watched};
use crate::support::{Drive, path};

/// Names under which it is installed; `ECHOGRID_CHROMIUM` names another.
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// A page in a browser of its own.
struct Browser {
    child: Child,
    socket: WebSocket<MaybeTlsStream<TcpStream>>,
    calls: u64,
    _profile: TempDir,
}

impl Browser {
    /// None, and said so: there is no browser.
    fn open(address: &str, width: u32, height: u32) -> Option<Self> {
        let named = std::env::var("ECHOGRID_CHROMIUM").ok();
        let profile = tempfile::tempdir().unwrap();
        let start = |name: &str| {
            Command::new(name)
                .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"])
                .args(["--disable-component-update", "--disable-sync", "--disable-dev-shm-usage", "--hide-scrollbars"])
                .args(["--remote-debugging-port=0", &format!("--window-size={width},{height}")])
                .arg(format!("--user-data-dir={}", profile.path().display()))
                .arg("about:blank")
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(Stdio::piped())
                .spawn()
                .ok()
        };
        let Some(mut child) = named.iter().map(String::as_str).chain(NAMES).find_map(start) else {
            let _ =
                writeln!(std::io::stderr(), "skipped: no Chromium (install chromium, or name it in ECHOGRID_CHROMIUM)");
            return None;
        };
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
        let line = lines.find(|line| line.contains("DevTools listening on ws://")).unwrap();
        // Read on, or it would stop when the pipe is full.
        std::thread::spawn(move || lines.for_each(drop));
        let authority = line.split("ws://").nth(1).unwrap().split('/').next().unwrap().to_owned();
        let target = until("a page of the browser", || page_target(&authority));
        let (socket, _) = connect(&target).unwrap();
        if let MaybeTlsStream::Plain(stream) = socket.get_ref() {
            stream.set_read_timeout(Some(PATIENCE)).unwrap();
        }
        let mut browser = Self { child, socket, calls: 0, _profile: profile };
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            &json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false }),
        );
        browser.call("Page.navigate", &json!({ "url": address }));
        Some(browser)
    }

    fn call(&mut self, method: &str, params: &Value) -> Value {
        self.calls += 1;
        let id = self.calls;
        self.socket.send(Message::text(json!({ "id": id, "method": method, "params": params }).to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let answer: Value = serde_json::from_str(&text).unwrap();
            if answer["id"] == id {
                assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return answer["result"].clone();
            }
        }
    }

    /// The value of an expression in the page.
    fn value(&mut self, expression: &str) -> Value {
        let told = self.call(
            "Runtime.evaluate",
            &json!({ "expression": expression, "awaitPromise": true, "returnByValue": true }),
        );
        assert!(told["exceptionDetails"].is_null(), "{expression}: {}", told["exceptionDetails"]);
        told["result"]["value"].clone()
    }

    /// Until an expression of the page is true; while it is loaded there is none.
    fn wait_for(&mut self, expression: &str) {
        let deadline = Instant::now() + PATIENCE;
        let safe = format!("(() => {{ try {{ return Boolean({expression}) }} catch {{ return false }} }})()");
        while self.value(&safe) != true {
            assert!(Instant::now() < deadline, "not in time: {expression}; scene: {}", self.value("typeof scene === 'undefined' ? location.href : JSON.stringify([scene.pose, scene.map, scene.ended])"));
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) {
        let buttons = u8::from(kind != "mouseReleased");
        self.call(
            "Input.dispatchMouseEvent",
            &json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1 }),
        );
    }

    /// Every cell that is painted: its level where it is known.
    fn cells(&mut self) -> Cells {
        let script = "(() => { const cells = []; const side = CHUNK * CELLS;
            for (const { cx, cy, pen } of chunks.get('occupancy').values()) {
              const { data } = pen.getImageData(0, 0, side, side);
              for (let at = 0; at < side * side; at++) if (data[4 * at + 3]) {
                if (data[4 * at] !== data[4 * at + 1] || data[4 * at] !== data[4 * at + 2]) throw 'no grey';
                cells.push(cx * side + at % side, cy * side + side - 1 - (at / side | 0), data[4 * at]);
              }
            } return cells; })()";
        let numbers: Vec<i32> = serde_json::from_value(self.value(script)).unwrap();
        numbers.chunks_exact(3).map(|cell| ([cell[0], cell[1]], Some(cell[2] as u8))).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The DevTools address of the first page.
fn page_target(authority: &str) -> Option<String> {
    let mut stream = TcpStream::connect(authority).ok()?;
    write!(stream, "GET /json/list HTTP/1.1\r\nHost: {authority}\r\nConnection: close\r\n\r\n").ok()?;
    stream.set_read_timeout(Some(PATIENCE)).ok()?;
    // It keeps the connection, whatever it is told.
    let (mut answer, mut piece) = (Vec::new(), [0; 4096]);
    let targets: Value = loop {
        let read = stream.read(&mut piece).ok().filter(|read| *read > 0)?;
        answer.extend_from_slice(&piece[..read]);
        let body = answer.windows(4).position(|four| four == b"\r\n\r\n").map(|at| &answer[at + 4..]);
        if let Some(targets) = body.and_then(|body| serde_json::from_slice(body).ok()) {
            break targets;
        }
    };
    let page = targets.as_array()?.iter().find(|target| target["type"] == "page")?;
    page["webSocketDebuggerUrl"].as_str().map(str::to_owned)
}

#[test]
fn in_a_browser_the_map_grows_and_is_what_the_picture_shows() {
    let drive = Drive::new(40.0);
    let (mut graph, address) = watched(&drive, "maps", &["--rate", "20", "--set", "publisher.draw_path=false"]);
    // However long a browser takes to open: the map grows when it is there.
    graph.wait_for_progress("mapper", 100);
    graph.stop("sensor");
    let Some(mut browser) = Browser::open(&address, 1280, 800) else { return };
    browser.wait_for("scene.map");
    let before = browser.value("scene.map.cells_known").as_u64().unwrap();
    graph.go_on("sensor");
    browser.wait_for(&format!("scene.map.cells_known > {}", (before + 500) * 3 / 2));
    browser.wait_for("scene.ended");
    assert!(graph.wait().status.success());
    let (seen, wanted) = (browser.cells(), as_the_picture_shows(&drive.out("maps")));
    let wrong = differences(|cell| seen.get(&cell).copied().flatten(), &wanted);
    assert!(wrong.is_empty(), "{} of {} cells: {:?}", wrong.len(), wanted.len(), &wrong[..wrong.len().min(5)]);
    // No step of the path is longer than the thinning makes it, and it leads to the robot, which is in the picture.
    let step = browser.value("Math.max(...scene.trail.points.slice(1).map((p, i) => Math.hypot(p.x - scene.trail.points[i].x, p.y - scene.trail.points[i].y)))");
    assert!(step.as_f64().unwrap() < 0.5, "{step}");
    let last = browser.value("(() => { const end = scene.trail.points.at(-1); return Math.hypot(end.x - scene.pose.x, end.y - scene.pose.y) })()");
    assert!(last.as_f64().unwrap() < 0.2, "{last}");
    let inside = browser.value("(() => { const [x, y] = toScreen(scene.pose.x, scene.pose.y), a = openArea(); return x > a.left && x < a.right && y > a.top && y < a.bottom })()");
    assert_eq!(inside, true);
}

#[test]
fn in_a_browser_save_writes_files_and_a_dragged_fix_moves_the_robot() {
    let drive = Drive::new(f64::INFINITY);
    let (mut graph, address) = watched(&drive, "maps", &["--rate", "10"]);
    let Some(mut browser) = Browser::open(&address, 1280, 800) else { return };
    browser.wait_for("scene.map && scene.map.cells_known > 500");
    // It stands still, so that it is known where it must be.
    graph.stop("sensor");
    browser.value("document.getElementById('save').click()");
    browser.wait_for("document.getElementById('toasts').textContent.includes('saved in')");
    assert!(
        drive.out("maps/map.png").exists() && drive.out("maps/map.echogrid").exists(),
        "{}",
        path(&drive.out("maps"))
    );
    browser.value("document.getElementById('fix').click(); document.getElementById('fix-sigma').value = 0; document.getElementById('fix-heading').value = 0");
    // One metre to the left of it, looking up.
    let from: [f64; 2] = serde_json::from_value(browser.value("toScreen(scene.pose.x - 1, scene.pose.y)")).unwrap();
    let wanted: [f64; 2] = serde_json::from_value(browser.value("[scene.pose.x - 1, scene.pose.y]")).unwrap();
    browser.mouse("mousePressed", from);
    browser.mouse("mouseMoved", [from[0], from[1] - 60.0]);
    browser.mouse("mouseReleased", [from[0], from[1] - 60.0]);
    browser.value("document.getElementById('fix-send').click()");
    let [x, y] = wanted;
    browser.wait_for(&format!(
        "Math.hypot(scene.pose.x - {x}, scene.pose.y - {y}) < 0.05 && Math.abs(scene.pose.theta - Math.PI / 2) < 0.01"
    ));
    graph.go_on("sensor");
    graph.signal(Signal::SIGINT);
    assert!(graph.wait().status.success());
}
