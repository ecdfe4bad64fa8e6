//! A page in the browser that shows the map as it grows: the robot and how sure it is of its place, the readings and what became of
//! them, how every process is doing; and that saves, pauses, corrects and asks why.
//!
//! The service looks on: no process of the graph waits for it, and its death changes no byte of the map. One thread reads the graph
//! into a scene, one carries out orders, one listens, and each viewer has one that writes to it what changed since it was last
//! written to. `docs/live.md` describes what travels.

pub mod access;
pub mod config;
mod feed;
mod hub;
mod orders;
pub mod protocol;
mod server;
mod trail;
mod viewer;
mod why;

use std::io::{BufRead, Read};
use std::net::{SocketAddr, TcpListener};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_service::lifeline::LIFELINE_VARIABLE;
use echogrid_service::plan::DOMAIN_VARIABLE;
use echogrid_service::signals::Signals;
use echogrid_service::{Declaration, in_words, logging};
use echogrid_topics::Domain;
use nix::sys::signal::Signal;
use serde::Deserialize;

use crate::access::Access;
use crate::config::LiveConfig;
use crate::feed::{Feed, Over};
use crate::hub::Hub;
use crate::orders::Orders;
use crate::server::Server;

/// What it declares of itself.
pub const DECLARATION: Declaration = Declaration { reads: &[], looks_on: &feed::TOPICS, writes: &[], orders: &[] };

/// Where to listen, in the environment: `ADDRESS:PORT`.
pub const LISTEN_VARIABLE: &str = "ECHOGRID_LIVE_LISTEN";
/// The token, likewise.
pub const TOKEN_VARIABLE: &str = "ECHOGRID_LIVE_TOKEN";
/// Names of this machine, likewise, separated by commas.
pub const HOSTS_VARIABLE: &str = "ECHOGRID_LIVE_HOSTS";

/// Viewers are shown the last of it for as long as this.
const LAST_LOOK: Duration = Duration::from_millis(1000);
/// A graph that is made anew is there again within this.
const ANEW_WITHIN: Duration = Duration::from_secs(10);
/// After its launcher is gone this process stays no longer than this.
const LEAVE_WITHIN: Duration = Duration::from_secs(3);

/// Runs it as this process, in the domain that the environment names.
#[must_use]
pub fn main() -> ExitCode {
    let _whose = logging::start("live");
    // What `ps` shows.
    let _ = nix::sys::prctl::set_name(c"echogrid-live");
    let done = from_environment().and_then(|(domain, config)| {
        let is_told = !config.token.is_empty();
        // Who was not told the token must be.
        let tell = |address: &str| if is_told { tracing::info!("{address}") } else { tracing::warn!("{address}") };
        serve(&domain, config, tell)
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("live: {}", in_words(&error));
            ExitCode::FAILURE
        }
    }
}

fn from_environment() -> Result<(Domain, LiveConfig)> {
    let domain = std::env::var(DOMAIN_VARIABLE)
        .with_context(|| format!("{DOMAIN_VARIABLE} is not set: name the domain of a running graph"))?;
    let mut config = LiveConfig::default();
    if let Ok(listen) = std::env::var(LISTEN_VARIABLE) {
        config.listen =
            listen.parse().with_context(|| format!("{LISTEN_VARIABLE} = {listen:?}: expected ADDRESS:PORT"))?;
    }
    config.token = std::env::var(TOKEN_VARIABLE).unwrap_or_default();
    let hosts = std::env::var(HOSTS_VARIABLE).unwrap_or_default();
    config.hosts = hosts.split(',').filter(|host| !host.is_empty()).map(str::to_owned).collect();
    Ok((Domain::named(&domain)?, config))
}

/// A word that nobody guesses.
///
/// # Errors
/// The system has no random bytes.
pub fn new_token() -> Result<String> {
    let mut bytes = [0; 16];
    let mut file = std::fs::File::open("/dev/urandom").context("opening /dev/urandom")?;
    file.read_exact(&mut bytes).context("reading /dev/urandom")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The address of the page, for a browser on this machine where it is served to all.
#[must_use]
pub fn address(listen: SocketAddr, token: &str) -> String {
    let mut shown = listen;
    if listen.ip().is_unspecified() {
        shown.set_ip(if listen.is_ipv4() { [127, 0, 0, 1].into() } else { std::net::Ipv6Addr::LOCALHOST.into() });
    }
    format!("http://{shown}/?token={token}")
}

/// Serves the page of the graph that runs in `domain` until it is over, or this process is told to leave. `tell` is told the
/// address.
///
/// # Errors
/// There is no such graph, or the address can't be listened at.
pub fn serve(domain: &Domain, mut config: LiveConfig, tell: impl FnOnce(&str)) -> Result<()> {
    // Before any thread is started: threads inherit what is blocked.
    let signals = Signals::collect(&[Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP])?;
    let hub = Arc::new(Hub::default());
    let mut feed = Feed::enter(domain, &hub)?;
    let listener = TcpListener::bind(config.listen).with_context(|| format!("listening at {}", config.listen))?;
    if config.token.is_empty() {
        config.token = new_token()?;
    }
    let listen = listener.local_addr().context("asking for the address")?;
    let orphaned = watch_launcher(&hub)?;
    let orders = Orders::start(domain.clone(), Arc::clone(&hub))?;
    let server = Arc::new(Server {
        access: Access { token: config.token.clone(), hosts: config.hosts },
        viewers_max: config.viewers_max,
        hub: Arc::clone(&hub),
        orders: orders.clone(),
        domain: domain.name().to_owned(),
        viewers: AtomicUsize::new(0),
        connections: AtomicUsize::new(0),
    });
    Arc::clone(&server).start(listener)?;
    tell(&address(listen, &config.token));
    let is_over = || orphaned.load(Ordering::Relaxed);
    while feed.follow(&hub, &orders, &signals, is_over)? == Over::Graph && !is_over() {
        let Some(anew) = enter_anew(domain, &hub, is_over) else { break };
        feed = anew;
    }
    hub.scene().ended = true;
    let deadline = Instant::now() + LAST_LOOK;
    while server.viewers.load(Ordering::Relaxed) > 0 && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(())
}

/// A launcher that is still there makes its graph anew; a domain without one stays empty.
fn enter_anew(domain: &Domain, hub: &Hub, is_over: impl Fn() -> bool) -> Option<Feed> {
    let deadline = Instant::now() + ANEW_WITHIN;
    while std::env::var_os(LIFELINE_VARIABLE).is_some() && !is_over() && Instant::now() < deadline {
        if let Ok(feed) = Feed::enter(domain, hub) {
            return Some(feed);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    None
}

/// A line of the launcher on standard input.
#[derive(Debug, Deserialize)]
struct Line {
    service: String,
    level: String,
    text: String,
}

/// Where a launcher holds the other end of standard input, it writes there what there is to be read, a JSON object per line, and
/// closes it when all is over.
fn watch_launcher(hub: &Arc<Hub>) -> Result<Arc<AtomicBool>> {
    let orphaned = Arc::new(AtomicBool::new(false));
    if std::env::var(LIFELINE_VARIABLE).as_deref() == Ok("stdin") {
        let (hub, flag) = (Arc::clone(hub), Arc::clone(&orphaned));
        let listen = move || {
            for line in std::io::stdin().lock().lines().map_while(Result::ok) {
                let Ok(Line { service, level, text }) = serde_json::from_str(&line) else { continue };
                let level = ["info", "warn", "error"].into_iter().find(|word| *word == level).unwrap_or("info");
                hub.scene().say(&service, level, &text);
            }
            flag.store(true, Ordering::Relaxed);
            // A deadline for the others, who are leaving by themselves meanwhile.
            std::thread::sleep(LEAVE_WITHIN);
            std::process::exit(1);
        };
        std::thread::Builder::new().name("lifeline".into()).spawn(listen).context("starting a thread")?;
    }
    Ok(orphaned)
}
