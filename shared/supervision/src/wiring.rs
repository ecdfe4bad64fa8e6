//! What each service of a graph reads and writes.

use echogrid_service::Declaration;
use echogrid_topics::Topic;
use serde::{Deserialize, Serialize};

/// What a service reads and writes, by the names of the topics.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Wiring {
    /// Topics whose producers wait for it.
    pub reads: Vec<String>,
    /// Topics that it takes what comes of; nobody waits for it there.
    pub looks_on: Vec<String>,
    /// Topics that it writes.
    pub writes: Vec<String>,
    /// Whether streams begin with it: it is asked first when the graph is to end, and waits for nobody.
    pub source: bool,
}

impl Wiring {
    /// The keys of a service's wiring in a graph file.
    pub const KEYS: [&str; 4] = ["reads", "looks_on", "writes", "source"];
}

impl AsRef<Self> for Wiring {
    fn as_ref(&self) -> &Self {
        self
    }
}

impl From<Declaration> for Wiring {
    fn from(Declaration { reads, looks_on, writes, .. }: Declaration) -> Self {
        let names = |topics: &[Topic]| topics.iter().map(|topic| topic.name().to_owned()).collect();
        Self { reads: names(reads), looks_on: names(looks_on), writes: names(writes), source: false }
    }
}
