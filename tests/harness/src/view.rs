//! What the services of a graph say of themselves.

use std::collections::BTreeMap;
use std::fmt;

use serde_json::Value;

/// What each service of a graph said of itself last; of one that has not been heard of: nothing, 0.
#[derive(Debug, Default)]
pub struct View {
    services: BTreeMap<String, Value>,
}

impl View {
    /// Takes note of a message of the topic `health`.
    pub(crate) fn note(&mut self, line: &Value) {
        let health = &line["message"];
        // That a service has left is the launcher's word, and says nothing of how far it came.
        let (Some(service), false) = (health["service"].as_str(), health["state"] == "gone") else { return };
        self.services.insert(service.to_owned(), health.clone());
    }

    /// All that a service said, as `echogrid topic echo health --json` has it.
    #[must_use]
    pub fn service(&self, service: &str) -> Option<&Value> {
        self.services.get(service)
    }

    fn number(&self, service: &str, key: &str) -> u64 {
        self.services.get(service).and_then(|health| health[key].as_u64()).unwrap_or(0)
    }

    /// `starting`, `running`, `draining`, `finished` or `failed`.
    #[must_use]
    pub fn state(&self, service: &str) -> &str {
        self.services.get(service).and_then(|health| health["state"].as_str()).unwrap_or("")
    }

    /// Messages that a service has taken in (a sensor: given out).
    #[must_use]
    pub fn progress(&self, service: &str) -> u64 {
        self.number(service, "progress")
    }

    /// Messages that it refused.
    #[must_use]
    pub fn faults(&self, service: &str) -> u64 {
        self.number(service, "faults")
    }

    /// Messages that never reached it.
    #[must_use]
    pub fn lost(&self, service: &str) -> u64 {
        self.number(service, "lost")
    }

    /// The number of the service's process.
    #[must_use]
    pub fn pid(&self, service: &str) -> u64 {
        self.number(service, "pid")
    }
}

impl fmt::Display for View {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for name in self.services.keys() {
            let (state, progress) = (self.state(name), self.progress(name));
            write!(f, "{name} {state}, {progress} messages, {} faulty, {} lost; ", self.faults(name), self.lost(name))?;
        }
        Ok(())
    }
}
