//! What the launcher tells the processes of a graph: one file in the domain's directory.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use echogrid_topics::{Domain, Topic};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Name of the domain, in the environment of every process of a graph.
pub const DOMAIN_VARIABLE: &str = "ECHOGRID_DOMAIN";
/// Name of the service in the graph, likewise.
pub const SERVICE_VARIABLE: &str = "ECHOGRID_SERVICE";
/// Services that have left for good when this one was started, separated by commas, likewise.
pub const GONE_VARIABLE: &str = "ECHOGRID_GONE";

/// The plan of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// How many times real time the sensor plays; none: as fast as the slowest process takes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// Readings in the largest scan.
    pub max_readings: usize,
    /// The run: in the header of every message of a lossless topic. Never 0.
    pub epoch: u64,
    /// The folder in which services store what they need to go on after a restart; none: nobody restarts them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state: Option<PathBuf>,
    /// Whether what they store there is to outlive the machine.
    #[serde(default)]
    pub synced: bool,
    /// Which services read which topic: whom its producer waits for.
    pub consumers: BTreeMap<String, Vec<String>>,
    /// The sections of the effective configuration.
    pub config: toml::Table,
}

impl Plan {
    /// The key of the configuration for the settings that decide a map, as the text of a graph file: what a recording carries.
    pub const SETTINGS: &str = "settings";

    /// Writes the plan for the processes of `domain`.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn write(&self, domain: &Domain) -> Result<()> {
        let path = domain.dir().join("plan.toml");
        let text = toml::to_string(self).context("writing the plan of the run")?;
        // It may tell of what only its user may know.
        echogrid_topics::domain::write_private(&path, text.as_bytes()).context("writing the plan of the run")
    }

    /// Reads the plan of `domain`.
    ///
    /// # Errors
    /// There is none, or it is broken.
    pub fn read(domain: &Domain) -> Result<Self> {
        Self::read_file(&domain.dir().join("plan.toml"))
    }

    fn read_file(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
        toml::from_str(&text).with_context(|| format!("in {}", path.display()))
    }

    /// One section of the configuration.
    ///
    /// # Errors
    /// It is missing or broken.
    pub fn section<T: DeserializeOwned>(&self, name: &str) -> Result<T> {
        let section = self.config.get(name).with_context(|| format!("the plan has no section [{name}]"))?;
        section.clone().try_into().with_context(|| format!("in section [{name}] of the plan"))
    }

    /// Whether a service writes a topic that it could write: where several are the sensor, each writes its part.
    #[must_use]
    pub fn writes(&self, service: &str, topic: Topic) -> bool {
        let of_service = self.config.get("services").and_then(|services| services.get(service));
        let said = of_service.and_then(|service| service.get("writes")).and_then(toml::Value::as_array);
        said.is_none_or(|said| said.iter().any(|name| name.as_str() == Some(topic.name())))
    }

    /// Whether a service takes a topic that it could take: what a built-in takes may be a matter of its configuration.
    #[must_use]
    pub fn takes(&self, service: &str, topic: Topic) -> bool {
        let of_service = self.config.get("services").and_then(|services| services.get(service));
        let exec = of_service.and_then(|service| service.get("exec")).and_then(toml::Value::as_str);
        let said = |key| of_service.and_then(|service| service.get(key)).and_then(toml::Value::as_array);
        let all = || ["reads", "looks_on"].into_iter().filter_map(said).flatten();
        let is_builtin = exec.is_some_and(|exec| exec.starts_with("builtin:"));
        !is_builtin || all().count() == 0 || all().any(|name| name.as_str() == Some(topic.name()))
    }

    /// Whether a service reads the topic of this name, as the graph file says.
    pub(crate) fn reads(&self, service: &str, topic: &str) -> bool {
        let of_service = self.config.get("services").and_then(|services| services.get(service));
        let said = of_service.and_then(|service| service.get("reads")).and_then(toml::Value::as_array);
        said.into_iter().flatten().any(|name| name.as_str() == Some(topic))
    }

    /// Whom the producer of `topic` waits for.
    #[must_use]
    pub fn consumers_of(&self, topic: Topic) -> &[String] {
        self.consumers.get(topic.name()).map_or(&[], Vec::as_slice)
    }
}
