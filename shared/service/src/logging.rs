//! Logs: to standard error, as text or JSON.

use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::FmtSpan;

/// What is logged (`warn`, `debug`, `echogrid_mapper=trace` …).
pub const FILTER_VARIABLE: &str = "ECHOGRID_LOG";
/// `text` or `json`.
pub const FORMAT_VARIABLE: &str = "ECHOGRID_LOG_FORMAT";

/// Starts logging as the environment says: warnings as text by default.
pub fn start() {
    let filter = EnvFilter::try_from_env(FILTER_VARIABLE).unwrap_or_else(|_| EnvFilter::new("warn"));
    let builder = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_span_events(FmtSpan::NONE)
        // A launcher that died takes the other end of standard error with it.
        .log_internal_errors(false);
    // Fails only if logging was started before, which is as good.
    let _ = match std::env::var(FORMAT_VARIABLE).as_deref() {
        Ok("json") => builder.json().try_init(),
        _ => builder.with_target(false).with_ansi(false).try_init(),
    };
}
