//! `echogrid live`: a page that shows a running graph; and `--watch`, which starts it beside a graph.

mod watch;

use echogrid_live::config::LiveConfig;
use echogrid_topics::Domain;

use super::talk;
pub(super) use watch::{Watch, Watched};

/// What is asked.
pub(super) struct Request {
    pub(super) domain: Option<String>,
    pub(super) listen: std::net::SocketAddr,
    pub(super) hosts: Vec<String>,
}

/// Serves the page until the graph is over.
pub(super) fn run(request: Request) -> anyhow::Result<()> {
    let Request { domain, listen, hosts } = request;
    let domain: Domain = talk::choose(domain.as_deref())?;
    let config = LiveConfig { listen, hosts, ..LiveConfig::default() };
    echogrid_live::serve(&domain, config, |address| {
        // Where standard output is closed, nobody wants to know.
        let _ = super::print(&format!("{address}\n"));
    })
}
