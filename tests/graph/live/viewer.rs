//! A viewer of the page without a browser: a plain WebSocket, and what came over it.

use std::collections::BTreeMap;
use std::net::TcpStream;
use std::time::Instant;

use serde_json::{Value, json};
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket, connect};

use super::{PATIENCE, until};

/// Levels by cell; none: unknown.
pub(super) type Cells = BTreeMap<[i32; 2], Option<u8>>;

/// Tiles by their place: a bit for each cell that is known, and the levels.
type Tiles = BTreeMap<[i32; 2], (Vec<u8>, Vec<u8>)>;

/// All that a viewer was sent.
pub(super) struct Viewer {
    socket: WebSocket<MaybeTlsStream<TcpStream>>,
    layers: BTreeMap<String, Tiles>,
    pub(super) facts: Value,
    pub(super) pose: Value,
    pub(super) trail: Vec<[f64; 2]>,
    pub(super) beams: usize,
    pub(super) services: Vec<String>,
    pub(super) log: Vec<String>,
    answers: Vec<Value>,
    ended: bool,
    orders: u64,
}

impl Viewer {
    /// At the address that was printed, as soon as the page is there.
    pub(super) fn connect(address: &str) -> Self {
        let address = address.replacen("http://", "ws://", 1).replacen("/?", "/socket?", 1);
        let (socket, _) = until("the page", || connect(&address).ok());
        if let MaybeTlsStream::Plain(stream) = socket.get_ref() {
            stream.set_read_timeout(Some(PATIENCE)).unwrap();
        }
        Self {
            socket,
            layers: BTreeMap::new(),
            facts: Value::Null,
            pose: Value::Null,
            trail: Vec::new(),
            beams: 0,
            services: Vec::new(),
            log: Vec::new(),
            answers: Vec::new(),
            ended: false,
            orders: 0,
        }
    }

    /// Reads until it has seen what is wanted.
    pub(super) fn read_until(&mut self, what: &str, condition: impl Fn(&Self) -> bool) {
        let deadline = Instant::now() + PATIENCE;
        while !condition(self) {
            assert!(Instant::now() < deadline, "not in time: {what}");
            let message = self.socket.read().unwrap_or_else(|error| panic!("waiting for {what}: {error}"));
            self.take(message);
        }
    }

    pub(super) fn read_until_ended(&mut self) {
        self.read_until("the end", |seen| seen.ended);
    }

    pub(super) fn read_until_dropped(&mut self) {
        let deadline = Instant::now() + PATIENCE;
        while let Ok(message) = self.socket.read() {
            assert!(Instant::now() < deadline, "it is still there");
            self.take(message);
        }
    }

    pub(super) fn say(&mut self, what: &Value) {
        // Who is dropped meanwhile reads that.
        let _ = self.socket.send(Message::text(what.to_string()));
    }

    /// Tells the page to do something, and waits for the answer.
    pub(super) fn order(&mut self, what: &Value) -> Value {
        self.orders += 1;
        let id = self.orders;
        let mut what = what.clone();
        what["id"] = json!(id);
        self.say(&what);
        // What is not understood is answered without a number.
        self.read_until("an answer", |seen| seen.answers.iter().any(|answer| answer["id"] == id || answer["id"] == 0));
        self.answers.pop().unwrap()
    }

    /// Tiles of the map that it has.
    pub(super) fn tiles(&self) -> usize {
        self.layers.get("occupancy").map_or(0, BTreeMap::len)
    }

    /// The level of a cell; none where it is unknown.
    pub(super) fn level(&self, layer: &str, [i, j]: [i32; 2]) -> Option<u8> {
        let (known, levels) = self.layers.get(layer)?.get(&[i.div_euclid(64), j.div_euclid(64)])?;
        let cell = (j.rem_euclid(64) * 64 + i.rem_euclid(64)) as usize;
        (known[cell / 8] >> (cell % 8) & 1 == 1).then(|| levels[cell])
    }

    fn take(&mut self, message: Message) {
        match message {
            Message::Text(text) => self.take_text(&serde_json::from_str(&text).unwrap()),
            Message::Binary(bytes) => self.take_bytes(&bytes),
            _ => {}
        }
    }

    fn take_text(&mut self, told: &Value) {
        match told["type"].as_str().unwrap() {
            "hello" => {
                self.facts = told["facts"].clone();
                (self.layers, self.trail) = (BTreeMap::new(), Vec::new());
            }
            "pose" => self.pose = told.clone(),
            "health" => {
                let services = told["services"].as_array().unwrap();
                self.services = services.iter().map(|service| service["name"].as_str().unwrap().to_owned()).collect();
            }
            "log" => self
                .log
                .extend(told["lines"].as_array().unwrap().iter().map(|line| line["text"].as_str().unwrap().to_owned())),
            "answer" => self.answers.push(told.clone()),
            "ended" => self.ended = true,
            "map" | "layers" => {}
            other => panic!("{other}: {told}"),
        }
    }

    fn take_bytes(&mut self, bytes: &[u8]) {
        let number = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        match bytes[0] {
            1 => {
                let layer = match bytes[1] {
                    0 => "occupancy".to_owned(),
                    2 => "doubt".to_owned(),
                    _ => format!("sonar {}", u16::from_le_bytes([bytes[2], bytes[3]])),
                };
                let tiles = self.layers.entry(layer).or_default();
                for tile in bytes[8..].chunks_exact(8 + 512 + 4096) {
                    let number = |at: usize| i32::from_le_bytes(tile[at..at + 4].try_into().unwrap());
                    tiles.insert([number(0), number(4)], (tile[8..520].to_vec(), tile[520..].to_vec()));
                }
            }
            2 => {
                self.trail.truncate(number(8) as usize);
                let f32_at = |at: usize| f64::from(f32::from_bits(number(at) as u32));
                self.trail.extend((12..bytes.len()).step_by(24).map(|at| [f32_at(at + 8), f32_at(at + 12)]));
            }
            3 => self.beams += 1,
            other => panic!("a message of kind {other}"),
        }
    }
}
