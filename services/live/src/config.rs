//! Where the page is served, and to whom.

use std::net::{Ipv4Addr, SocketAddr};

/// Where it is served unless something else is said.
pub const DEFAULT_PORT: u16 = 8750;

/// Where the page is served, and to whom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveConfig {
    /// Port 0: any that is free.
    pub listen: SocketAddr,
    /// The word that a request must know; empty: one is made up.
    pub token: String,
    /// Names of this machine by which viewers may call it, besides its addresses and `localhost`.
    pub hosts: Vec<String>,
    /// The most viewers at a time.
    pub viewers_max: usize,
}

impl Default for LiveConfig {
    fn default() -> Self {
        let listen = SocketAddr::from((Ipv4Addr::LOCALHOST, DEFAULT_PORT));
        Self { listen, token: String::new(), hosts: Vec::new(), viewers_max: 32 }
    }
}
