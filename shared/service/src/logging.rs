//! Logs: to standard error, as text or JSON.

use std::sync::atomic::{AtomicBool, Ordering};

use tracing::Level;
use tracing::level_filters::LevelFilter;
use tracing::span::EnteredSpan;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::FmtSpan;

/// What is logged (`warn`, `debug`, `echogrid_mapper=trace` …).
pub const FILTER_VARIABLE: &str = "ECHOGRID_LOG";
/// `text` or `json`.
pub const FORMAT_VARIABLE: &str = "ECHOGRID_LOG_FORMAT";
/// What is logged where nothing is said.
const BY_DEFAULT: &str = "warn";

static JSON: AtomicBool = AtomicBool::new(false);

/// Starts the logging of the service `name`, as the environment says: warnings as text by default. What is given back is to
/// be kept for as long as lines are to tell whose they are.
pub fn start(name: &str) -> EnteredSpan {
    let is_json = std::env::var(FORMAT_VARIABLE).as_deref() == Ok("json");
    begin(EnvFilter::try_from_env(FILTER_VARIABLE).unwrap_or_else(|_| EnvFilter::new(BY_DEFAULT)), is_json);
    // Of the level that is never filtered away.
    tracing::error_span!("process", service = name).entered()
}

/// Starts the logging of the launcher as JSON; who says what is for it to decide. What is given back is to be kept as that of
/// [`start`] is.
pub fn start_json(name: &str) -> EnteredSpan {
    begin(EnvFilter::new("info"), true);
    JSON.store(true, Ordering::Relaxed);
    tracing::error_span!("process", service = name).entered()
}

/// Whether [`start_json`] was called.
#[must_use]
pub fn is_json() -> bool {
    JSON.load(Ordering::Relaxed)
}

/// Whether lines of this level are among those that `filter` (none: the environment, or the default) lets through.
#[must_use]
pub fn is_told(level: Level, filter: Option<&str>) -> bool {
    let asked =
        filter.map_or_else(|| EnvFilter::try_from_env(FILTER_VARIABLE).ok(), |text| EnvFilter::try_new(text).ok());
    let filter = asked.unwrap_or_else(|| EnvFilter::new(BY_DEFAULT));
    filter.max_level_hint().is_none_or(|most| most >= LevelFilter::from_level(level))
}

fn begin(filter: EnvFilter, is_json: bool) {
    let builder = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_span_events(FmtSpan::NONE)
        // A launcher that died takes the other end of standard error with it.
        .log_internal_errors(false);
    // Fails only if logging was started before, which is as good.
    let _ = if is_json {
        builder.json().flatten_event(true).with_current_span(true).with_span_list(false).try_init()
    } else {
        builder.with_target(false).with_ansi(false).try_init()
    };
}

/// Lets a line through now and then that may come thousands of times.
#[derive(Debug, Clone, Default)]
pub struct Sparing {
    last_ns: Option<u64>,
    withheld: u64,
}

impl Sparing {
    /// Between two lines, by the sensor's clock.
    const EVERY_NS: u64 = 10_000_000_000;

    /// Whether a line is due at `stamp_ns`; if so, how many were withheld since the last.
    pub fn is_due(&mut self, stamp_ns: u64) -> Option<u64> {
        // A clock that was set back starts anew.
        let waited = |last: u64| stamp_ns < last || stamp_ns - last >= Self::EVERY_NS;
        if self.last_ns.is_none_or(waited) {
            self.last_ns = Some(stamp_ns);
            return Some(std::mem::take(&mut self.withheld));
        }
        self.withheld += 1;
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_often_is_said_now_and_then() {
        let mut sparing = Sparing::default();
        let said: Vec<_> = (0..=25).filter_map(|second| sparing.is_due(second * 1_000_000_000)).collect();
        assert_eq!(said, [0, 9, 9]);
        assert_eq!(sparing.is_due(1), Some(5));
    }

    #[test]
    fn levels_are_told_of_any_filter() {
        for (filter, info) in [("warn", false), ("info", true), ("debug", true), ("warn,echogrid_mapper=info", true)] {
            assert_eq!(is_told(Level::INFO, Some(filter)), info, "{filter}");
        }
    }
}
