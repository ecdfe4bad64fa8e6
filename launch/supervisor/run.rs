//! What is run, what is seen of it, and what it comes to.

use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::{Result, bail};
use echogrid_service::Plan;
use echogrid_supervision::Event;
use echogrid_topics::{DeclaredTopic, Domain, Health, MapInfo, TrueWorld};

use crate::config::{Service, SupervisionConfig};

/// What is to be run.
#[derive(Debug)]
pub struct Graph<'a> {
    /// The domain of the graph.
    pub domain: Domain,
    /// The services of the graph, by name.
    pub services: &'a BTreeMap<String, Service>,
    /// The topics that they have besides echogrid's own, by name.
    pub topics: &'a BTreeMap<String, DeclaredTopic>,
    /// What they are told.
    pub plan: Plan,
    /// The most bytes that they store of themselves besides maps.
    pub kept_bytes: u64,
    /// What they log (`ECHOGRID_LOG`); none: as the environment says.
    pub log_filter: Option<&'a str>,
    /// Whether they log as JSON.
    pub log_json: bool,
    /// The longest time from one sign of life to the next. Writing a large map to a slow disk is one step.
    pub alive_within: Duration,
    /// A service that has not become ready for so long hangs.
    pub ready_within: Duration,
    /// What happens when a service dies or hangs.
    pub supervision: &'a SupervisionConfig,
}

/// How the run is doing.
#[derive(Debug)]
pub struct Progress<'a> {
    /// The sensor's health, once heard.
    pub sensor: Option<&'a Health>,
    /// How many services are ready, and of how many.
    pub ready: (usize, usize),
    /// The services that are still there when the sensor has no more to give, farthest downstream first.
    pub finishing: Vec<&'a str>,
}

/// What people see of a run while it lasts.
pub trait Observer {
    /// Called as things happen.
    fn event(&mut self, event: &Event<'_>);
    /// Called about ten times a second.
    fn progress(&mut self, progress: &Progress<'_>);
    /// A line that the service `name` logged.
    fn line(&mut self, name: &str, line: &str);
}

/// How a run ended.
#[derive(Debug, Default)]
pub struct Outcome {
    /// The map in numbers, as the mapper last told.
    pub map: Option<MapInfo>,
    /// The world, if the sensor is a simulator that tells.
    pub world: Option<TrueWorld>,
    /// The last health of each service.
    pub health: BTreeMap<String, Health>,
    /// Whether the user stopped it.
    pub stopped: bool,
    /// Whether the user did so twice: nobody was waited for.
    pub abandoned: bool,
    /// The first stamp of the sensor's streams, nanoseconds.
    pub first_ns: Option<u64>,
    /// Start to all services ready.
    pub startup: Duration,
    /// All services ready to all services gone.
    pub elapsed: Duration,
    /// The services that failed and how; the first is the cause.
    pub failures: Vec<String>,
    /// Services that had to be killed.
    pub killed: Vec<String>,
    /// How often each service was started again, of those that were.
    pub restarts: BTreeMap<String, u32>,
    /// Services that were given up while the others went on, and why.
    pub given_up: Vec<String>,
}

impl Outcome {
    /// The error that the run ended with, if it did.
    ///
    /// # Errors
    /// One clear error: the cause, and who had to be killed.
    pub fn check(&self) -> Result<()> {
        if self.failures.is_empty() && self.killed.is_empty() {
            return Ok(());
        }
        let lost = match &self.map {
            Some(map) if self.abandoned => {
                format!(
                    "; stopped at once, as you asked twice: of {} scans in the map, what was not saved is lost",
                    map.scans
                )
            }
            _ if self.abandoned => "; stopped at once, as you asked twice".to_owned(),
            _ => String::new(),
        };
        let killed = if self.killed.is_empty() {
            lost
        } else {
            format!(" (would not leave and was killed: {}{lost})", self.killed.join(", "))
        };
        match self.failures.first() {
            Some(cause) => bail!("{cause}{killed}"),
            None => bail!("the graph did not end in time{killed}"),
        }
    }
}
