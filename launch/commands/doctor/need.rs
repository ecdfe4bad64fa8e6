//! What the graph will need.

use echogrid_formats::log;
use echogrid_topics::domain::states_bytes;
use echogrid_topics::topic::memory_budget_bytes;

use super::finding::Finding;
use crate::config::Config;

/// What the graph will need.
#[derive(Debug, Clone)]
pub(super) struct Need {
    pub(super) services: u64,
    pub(super) max_readings: usize,
    /// Shared memory, in the worst case.
    pub(super) shared_bytes: u64,
    /// What services store of themselves, in the worst case.
    pub(super) states_bytes: u64,
    /// Why its log can't be read.
    log: Option<String>,
}

impl Need {
    pub(super) fn of(config: &Config) -> Self {
        let log = &config.replay.log;
        let survey = (config.plays_log() && !log.as_os_str().is_empty())
            .then(|| log::survey_with(log, config.replay.survey_options()))
            .transpose();
        let (survey, log) = match survey {
            Ok(survey) => (survey, None),
            Err(error) => (None, Some(error.to_string())),
        };
        Self { log, ..Self::for_scans(config.max_readings(survey.as_ref()), config) }
    }

    pub(super) fn for_scans(max_readings: usize, config: &Config) -> Self {
        let services = config.services.len() as u64;
        let (shared_bytes, states_bytes) =
            (memory_budget_bytes(max_readings, services), states_bytes(config.mapper.kept_bytes_max()));
        Self { services, max_readings, shared_bytes, states_bytes, log: None }
    }

    /// That of a standard graph with 16 sonars.
    #[cfg(test)]
    pub(super) fn usual() -> Self {
        Self::for_scans(16, &Config { services: crate::config::default_services(true), ..Config::default() })
    }

    pub(super) fn judge(&self) -> Option<Finding> {
        let error = self.log.as_ref()?;
        Some(Finding::problem("log", error, "name one that can be read: --set replay.log=FILE"))
    }
}
