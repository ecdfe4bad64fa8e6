//! A running graph in Foxglove, over the WebSocket server of its SDK.
//!
//! A program of its own: the server brings an asynchronous runtime, which nothing else of echogrid needs. It looks on: no process of the
//! graph waits for it.

mod channels;
mod orders;

use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use echogrid_scene::Show;
use echogrid_service::lifeline::Lifeline;
use echogrid_service::onlooker::{Onlooker, Operator};
use echogrid_service::plan::DOMAIN_VARIABLE;
use echogrid_service::signals::Signals;
use echogrid_service::{in_words, logging};
use echogrid_topics::{Command, Domain, Topic};
use foxglove::websocket::{Capability, ChannelView, Client, ServerListener};
use foxglove::{WebSocketServer, WebSocketServerHandle};
use nix::sys::signal::Signal;

use crate::channels::Channels;

/// What this process calls itself.
const NAME: &str = "echogrid-foxglove";
/// The whole map goes out at most this often.
const MAP_EVERY: Duration = Duration::from_secs(1);
/// What is looked at.
const TOPICS: [Topic; 7] = [
    Topic::RobotDescription,
    Topic::OdometryEstimate,
    Topic::RangeScan,
    Topic::RangeVerdict,
    Topic::MapTiles,
    Topic::MapInfo,
    Topic::Health,
];

/// What is asked.
#[derive(Debug)]
pub struct Request {
    /// The graph; none: the one that the environment names, or the only one that runs.
    pub domain: Option<String>,
    /// Where Foxglove connects to.
    pub listen: SocketAddr,
    /// Whether who connects may give orders.
    pub orders: bool,
}

/// Runs it as this process.
#[must_use]
pub fn main(request: &Request) -> ExitCode {
    let _whose = logging::start(NAME);
    match run(request) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{}", in_words(&error));
            ExitCode::FAILURE
        }
    }
}

/// Somebody subscribed: what counts is to be sent once more.
struct Newcomers(AtomicBool);

impl ServerListener for Newcomers {
    fn on_subscribe(&self, _client: Client, _channel: ChannelView) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn run(request: &Request) -> Result<()> {
    // Before any thread is started: threads inherit what is blocked.
    let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP])?;
    // As a service of a graph it never outlives its launcher.
    let lifeline = Lifeline::attach();
    let domain = choose(request.domain.as_deref())?;
    let mut onlooker = Onlooker::enter(&domain, NAME, &TOPICS)?;
    let mut channels = Channels::new()?;
    let newcomers = Arc::new(Newcomers(AtomicBool::new(false)));
    let server = listen(request, &domain, &newcomers)?;
    let mut show = Show::new(MAP_EVERY);
    loop {
        let is_over = signals.next()?.is_some();
        let was_there = onlooker.take_in(|stamp_ns, message| show.take(stamp_ns, message, &mut channels))?;
        if newcomers.0.swap(false, Ordering::Relaxed) {
            show.tell_all(&mut channels);
        }
        show.tell_what_is_due(!was_there || is_over, &mut channels);
        if is_over || !was_there {
            break;
        }
        if onlooker.misses_tiles() {
            ask_for_the_map(&domain);
        }
        onlooker.wait(&signals)?;
        if lifeline.as_ref().is_some_and(Lifeline::is_cut) {
            break;
        }
    }
    server.stop().wait_blocking();
    Ok(())
}

/// Opens the door, and says where it is.
fn listen(request: &Request, domain: &Domain, newcomers: &Arc<Newcomers>) -> Result<WebSocketServerHandle> {
    let mut server = WebSocketServer::new()
        .name(format!("echogrid {}", domain.name()))
        .bind(request.listen.ip().to_string(), request.listen.port())
        .listener(Arc::clone(newcomers) as Arc<dyn ServerListener>);
    if request.orders {
        server = server
            .capabilities([Capability::Services])
            .supported_encodings(["json"])
            .services(orders::services(domain));
    }
    let server = server.start_blocking().with_context(|| format!("listening at {}", request.listen))?;
    let shown = SocketAddr::new(request.listen.ip(), server.port());
    say(&format!("ws://{shown}"))?;
    Ok(server)
}

/// It is asked for again as long as tiles are missing.
fn ask_for_the_map(domain: &Domain) {
    let operator = Operator::enter(domain, NAME);
    let asked = operator.and_then(|operator| operator.order("mapper", Command::Tiles, orders::DONE_WITHIN));
    if let Err(error) = asked {
        tracing::debug!("asking for the whole map: {}", in_words(&error));
    }
}

fn choose(named: Option<&str>) -> Result<Domain> {
    let told = std::env::var(DOMAIN_VARIABLE).ok();
    if let Some(name) = named.or(told.as_deref()) {
        return Ok(Domain::named(name)?);
    }
    match echogrid_topics::domain::running().as_slice() {
        [] => bail!("no graph runs"),
        [only] => Ok(Domain::named(only)?),
        several => bail!("several graphs run: choose one with --domain ({})", several.join(", ")),
    }
}

/// Where it listens, for whoever starts it.
fn say(line: &str) -> Result<()> {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{line}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).context("printing"),
        _ => Ok(()),
    }
}
