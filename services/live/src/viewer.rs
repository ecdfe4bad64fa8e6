//! One viewer: a thread that writes what changed, as fast as the viewer takes it and no faster, and hears what it says.

use std::io;
use std::net::TcpStream;
use std::os::fd::AsFd;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use tungstenite::protocol::{CloseFrame, Role, WebSocketConfig, frame::coding::CloseCode};
use tungstenite::{Bytes, Error, Message, WebSocket};

use crate::hub::{Hub, Scene};
use crate::orders::{Answer, Orders};
use crate::protocol::{self, Layer, LayerWord, MESSAGE_MAX, Said, Told, VERSION};

/// A picture at most this often.
const FRAME: Duration = Duration::from_millis(50);
/// Tiles in one message: some 150 kB, so that the robot still moves while a late viewer gets the map over a slow link.
const TILES_MAX: usize = 32;
/// A viewer that says nothing is asked after this …
const PING_AFTER: Duration = Duration::from_secs(10);
/// … and given up after that.
const SILENT_MAX: Duration = Duration::from_secs(30);

type Socket = WebSocket<TcpStream>;

/// What a viewer has been sent.
#[derive(Debug)]
struct Seen {
    epoch: u64,
    /// Version of the last tile, of the map and of the layer that is shown besides.
    tiles: [u64; 2],
    layers: u64,
    generation: u32,
    points: usize,
    beams: u64,
    pose: u64,
    map: u64,
    health: u64,
    line: u64,
    ended: bool,
}

impl Seen {
    fn nothing() -> Self {
        // No generation is so high: the first trail begins a new one.
        let generation = u32::MAX;
        Self {
            epoch: 0,
            tiles: [0; 2],
            layers: 0,
            generation,
            points: 0,
            beams: 0,
            pose: 0,
            map: 0,
            health: 0,
            line: 0,
            ended: false,
        }
    }

    /// What changed since then, in the order in which it makes sense.
    fn catch_up(&mut self, scene: &Scene, domain: &str, layer: Layer, out: &mut Vec<Message>) {
        if scene.epoch == 0 {
            return;
        }
        let tell = |out: &mut Vec<Message>, told: &Told<'_>| out.push(Message::text(told.text()));
        if self.epoch != scene.epoch {
            *self = Self { epoch: scene.epoch, line: self.line, ..Self::nothing() };
            tell(out, &Told::Hello { protocol: VERSION, domain, facts: &scene.facts });
        }
        for (seen, now, told) in [
            (&mut self.pose, &scene.pose, Told::Pose as fn(_) -> _),
            (&mut self.map, &scene.map, Told::Map),
            (&mut self.health, &scene.health, Told::Health),
        ] {
            if *seen < now.version {
                *seen = now.version;
                tell(out, &told(&now.value));
            }
        }
        let lines: Vec<_> = scene.log.iter().filter(|line| line.id > self.line).cloned().collect();
        if let Some(last) = lines.last() {
            self.line = last.id;
            tell(out, &Told::Log { lines: &lines });
        }
        if self.layers < scene.layers_version {
            self.layers = scene.layers_version;
            tell(out, &Told::Layers { doubt: scene.layers.contains_key(&Layer::Doubt), sonars: &scene.sonars() });
        }
        self.trail(scene, out);
        if self.beams < scene.beams.version {
            self.beams = scene.beams.version;
            let (stamp_ns, beams) = &scene.beams.value;
            out.push(binary(protocol::beams(*stamp_ns, beams)));
        }
        let more = Some(layer).filter(|layer| *layer != Layer::Occupancy);
        let complete = [Some(Layer::Occupancy), more]
            .into_iter()
            .zip(&mut self.tiles)
            .fold(true, |complete, (layer, seen)| complete & layer.is_none_or(|layer| tiles(scene, layer, seen, out)));
        if scene.ended && complete && !self.ended {
            self.ended = true;
            tell(out, &Told::Ended);
        }
    }

    fn trail(&mut self, scene: &Scene, out: &mut Vec<Message>) {
        let (generation, points) = (scene.trail.generation(), scene.trail.points());
        if self.generation != generation {
            (self.generation, self.points) = (generation, 0);
        }
        if self.points < points.len() {
            out.push(binary(protocol::trail(generation, self.points, &points[self.points..])));
            self.points = points.len();
        }
    }
}

/// The tiles of a layer that changed after `seen`, the oldest change first, as far as one message goes; whether that was all.
fn tiles(scene: &Scene, layer: Layer, seen: &mut u64, out: &mut Vec<Message>) -> bool {
    let Some(all) = scene.layers.get(&layer) else { return true };
    let mut changed: Vec<_> = all.iter().filter(|(_, tile)| tile.version > *seen).collect();
    if changed.is_empty() {
        return true;
    }
    changed.sort_unstable_by_key(|(_, tile)| tile.version);
    let complete = changed.len() <= TILES_MAX;
    changed.truncate(TILES_MAX);
    *seen = changed.last().map_or(*seen, |(_, tile)| tile.version);
    let tiles: Vec<_> = changed.into_iter().map(|(index, tile)| (*index, &*tile.levels)).collect();
    out.push(binary(protocol::tiles(layer, &tiles)));
    complete
}

fn binary(bytes: Vec<u8>) -> Message {
    Message::Binary(Bytes::from(bytes))
}

/// Shows the scene to whoever is at the other end, until either has enough.
pub(crate) fn show(stream: TcpStream, beyond: Vec<u8>, hub: &Hub, orders: &Orders, domain: &str) -> Result<(), Error> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    let config = WebSocketConfig::default().max_message_size(Some(MESSAGE_MAX)).max_frame_size(Some(MESSAGE_MAX));
    let mut socket = WebSocket::from_partially_read(stream, beyond, Role::Server, Some(config));
    let (answers, mailbox) = channel();
    let (mut seen, mut layer) = (Seen::nothing(), Layer::Occupancy);
    let (mut heard, mut pinged) = (Instant::now(), Instant::now());
    let mut flushed = true;
    loop {
        while let Some(message) = unless_blocked(socket.read())? {
            heard = Instant::now();
            let Message::Text(text) = message else { continue };
            match Said::parse(&text) {
                Ok(Said::Layer { layer: word, sonar }) => {
                    layer = layer_of(word, sonar);
                    seen.tiles[1] = 0;
                }
                Ok(said) => orders.give(said, &answers),
                Err(why) => {
                    let _ = answers.send(Answer { id: 0, ok: false, text: why, why: None });
                }
            }
        }
        if flushed {
            let mut out = Vec::new();
            seen.catch_up(&hub.scene(), domain, layer, &mut out);
            out.extend(letters(&mailbox));
            if pinged.elapsed() > PING_AFTER {
                pinged = Instant::now();
                out.push(Message::Ping(Bytes::new()));
            }
            if out.is_empty() && seen.ended {
                return goodbye(&mut socket);
            }
            // What can't be written at once is kept by the socket.
            out.into_iter().try_for_each(|message| unless_blocked(socket.write(message)).map(drop))?;
        }
        flushed = unless_blocked(socket.flush())?.is_some();
        if heard.elapsed() > SILENT_MAX {
            return Ok(());
        }
        wait(&socket, flushed)?;
    }
}

fn layer_of(word: LayerWord, sonar: u16) -> Layer {
    match word {
        LayerWord::Occupancy => Layer::Occupancy,
        LayerWord::Doubt => Layer::Doubt,
        LayerWord::Sonar => Layer::Sonar(sonar),
    }
}

fn letters(mailbox: &Receiver<Answer>) -> Vec<Message> {
    let text = |answer: Answer| {
        let Answer { id, ok, text, why } = answer;
        Message::text(Told::Answer { id, ok, text: &text, why: why.as_ref() }.text())
    };
    mailbox.try_iter().map(text).collect()
}

/// All was seen, and the graph is over.
fn goodbye(socket: &mut Socket) -> Result<(), Error> {
    socket.get_ref().set_nonblocking(false)?;
    socket.get_ref().set_write_timeout(Some(FRAME))?;
    socket.close(Some(CloseFrame { code: CloseCode::Normal, reason: "the graph is over".into() }))?;
    socket.flush()
}

/// Until the viewer says something or takes something, or the next picture is due.
fn wait(socket: &Socket, flushed: bool) -> io::Result<()> {
    let (wanted, patience) =
        if flushed { (PollFlags::POLLIN, FRAME) } else { (PollFlags::POLLIN | PollFlags::POLLOUT, PING_AFTER) };
    let mut fds = [PollFd::new(socket.get_ref().as_fd(), wanted)];
    match poll(&mut fds, PollTimeout::from(patience.as_millis() as u16)) {
        Ok(_) | Err(nix::errno::Errno::EINTR) => Ok(()),
        Err(errno) => Err(errno.into()),
    }
}

/// None: it would block.
fn unless_blocked<T>(result: Result<T, Error>) -> Result<Option<T>, Error> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(Error::Io(error)) if error.kind() == io::ErrorKind::WouldBlock => Ok(None),
        Err(error) => Err(error),
    }
}
