//! The listening end: reads a request, judges it, and answers it, a thread per connection.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use tungstenite::handshake::derive_accept_key;

use crate::access::{Access, HEAD_MAX, Refusal, Route, TOO_LARGE, TOO_MANY, TOO_SLOW};
use crate::hub::Hub;
use crate::orders::Orders;
use crate::viewer;

/// Files of the page.
const PAGE: &str = include_str!("../page/live.html");
const STYLE: &str = include_str!("../page/live.css");
/// One script of several parts, so that it is one request.
const SCRIPT: &str = concat!(
    include_str!("../page/scene.js"),
    include_str!("../page/palette.js"),
    include_str!("../page/draw.js"),
    include_str!("../page/panel.js"),
    include_str!("../page/hands.js"),
    include_str!("../page/talk.js"),
);

/// A request has to come within this.
const REQUEST_WITHIN: Duration = Duration::from_secs(5);
/// Connections beside those of viewers: each is short.
const REQUESTS_MAX: usize = 16;
/// An answer is taken within this, or not at all.
const TAKEN_WITHIN: Duration = Duration::from_secs(10);

/// What all connections share.
#[derive(Debug)]
pub(crate) struct Server {
    pub(crate) access: Access,
    pub(crate) viewers_max: usize,
    pub(crate) hub: Arc<Hub>,
    pub(crate) orders: Orders,
    pub(crate) domain: String,
    pub(crate) viewers: AtomicUsize,
    pub(crate) connections: AtomicUsize,
}

/// One more, as long as it lives.
struct Counted<'a>(&'a AtomicUsize);

impl<'a> Counted<'a> {
    /// One more, where there are fewer than `most`.
    fn new(count: &'a AtomicUsize, most: usize) -> Option<Self> {
        let one = Self(count);
        (count.fetch_add(1, Ordering::Relaxed) < most).then_some(one)
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Server {
    /// Answers whoever comes to `listener`, in threads of its own.
    pub(crate) fn start(self: Arc<Self>, listener: TcpListener) -> Result<()> {
        let accept = move || {
            for stream in listener.incoming() {
                match stream {
                    Ok(stream) => self.clone().admit(stream),
                    // Out of files: others leave, and then there is one.
                    Err(_) => std::thread::sleep(Duration::from_millis(50)),
                }
            }
        };
        std::thread::Builder::new().name("listener".into()).spawn(accept).context("starting a thread")?;
        Ok(())
    }

    fn admit(self: Arc<Self>, stream: TcpStream) {
        let answer = move || {
            let Some(_one) = Counted::new(&self.connections, self.viewers_max + REQUESTS_MAX) else {
                refuse(&stream, &TOO_MANY);
                return;
            };
            if let Err(error) = self.answer(stream) {
                tracing::debug!("a viewer left: {error}");
            }
        };
        // Where no thread can be had the connection is closed.
        let _ = std::thread::Builder::new().name("viewer".into()).spawn(answer);
    }

    fn answer(&self, mut stream: TcpStream) -> Result<()> {
        stream.set_write_timeout(Some(TAKEN_WITHIN))?;
        let judged = read_head(&mut stream).and_then(|(head, beyond)| Ok((self.access.judge(&head)?, beyond)));
        let (route, beyond) = match judged {
            Ok(judged) => judged,
            Err(refusal) => {
                refuse(&stream, &refusal);
                return Ok(());
            }
        };
        match route {
            Route::Page => give(&mut stream, "text/html", PAGE),
            Route::Style => give(&mut stream, "text/css", STYLE),
            Route::Script => give(&mut stream, "text/javascript", SCRIPT),
            Route::Socket(key) => {
                let Some(_one) = Counted::new(&self.viewers, self.viewers_max) else {
                    refuse(&stream, &TOO_MANY);
                    return Ok(());
                };
                let accept = derive_accept_key(key.as_bytes());
                write!(
                    stream,
                    "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n\r\n"
                )?;
                Ok(viewer::show(stream, beyond, &self.hub, &self.orders, &self.domain)?)
            }
        }
    }
}

/// The head of a request, its empty line included, and what came after it.
fn read_head(stream: &mut TcpStream) -> Result<(Vec<u8>, Vec<u8>), Refusal> {
    let deadline = Instant::now() + REQUEST_WITHIN;
    let mut head = Vec::new();
    let mut piece = [0; 2048];
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
            return Err(TOO_SLOW);
        }
        let read = match stream.read(&mut piece) {
            Ok(read) => read,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(_) => return Err(TOO_SLOW),
        };
        let searched = head.len().saturating_sub(3);
        head.extend_from_slice(&piece[..read]);
        if let Some(at) = head[searched..].windows(4).position(|four| four == b"\r\n\r\n") {
            let beyond = head.split_off(searched + at + 4);
            return if head.len() > HEAD_MAX { Err(TOO_LARGE) } else { Ok((head, beyond)) };
        }
        if head.len() > HEAD_MAX {
            return Err(TOO_LARGE);
        }
        if read == 0 {
            return Err(TOO_SLOW);
        }
    }
}

fn give(stream: &mut TcpStream, kind: &str, text: &str) -> Result<()> {
    // Nothing of elsewhere is loaded, nobody frames the page, and its address, which holds the token, is told to nobody.
    let answer = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {}\r\nConnection: close\r\nCache-Control: no-store\r\n\
         Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
         X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\n\r\n{text}",
        text.len()
    );
    stream.write_all(answer.as_bytes())?;
    linger(stream);
    Ok(())
}

fn refuse(mut stream: &TcpStream, refusal: &Refusal) {
    let Refusal { status, text } = refusal;
    let answer = format!(
        "HTTP/1.1 {status} {}\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{text}\n",
        refusal.reason(),
        text.len() + 1
    );
    // Who has left already can't be told.
    if stream.write_all(answer.as_bytes()).is_ok() {
        linger(stream);
    }
}

/// Closes so that the answer arrives: what was not read yet would have the system reset the connection.
fn linger(mut stream: &TcpStream) {
    let _ = stream.shutdown(Shutdown::Write);
    let _ = stream.set_read_timeout(Some(Duration::from_millis(200)));
    let mut rest = [0; 2048];
    let mut patience = 64;
    while patience > 0 && matches!(stream.read(&mut rest), Ok(read) if read > 0) {
        patience -= 1;
    }
}
