//! CARMEN logs: one message per line, blank-separated, `#` comments; plain or gzipped.
//!
//! | message | becomes |
//! |---|---|
//! | `ODOM` | odometry |
//! | `FLASER`, `RLASER`, `ROBOTLASERk`, `RAWLASERk`, `SONAR` | a scan; without `ODOM` lines its robot pose is the odometry |
//! | `TRUEPOS` | a true pose |
//! | `PARAM` | a parameter: laser offsets, laser maximum, robot size |
//! | others | skipped and counted |
//!
//! The time of a message is its `ipc_timestamp`, the third word from the end.

mod angles;
mod ceiling;
mod fans;
mod kinds;
mod laser_view;
pub(super) mod message;
mod mount;
pub(super) mod origin;
mod read;
mod record;
mod repeats;
mod rings;
mod speeds;
mod stream;
mod survey;
mod units;
mod write;

pub(super) use angles::{cone, plain_fan};
pub(crate) use kinds::CarmenPlan;
pub use read::read;
pub(super) use read::read_recording;
pub use record::LogFile;
pub use stream::{LineStream, PrintedLine, PrintedLines};
pub use survey::{survey, survey_with};
pub(super) use survey::{survey_of, survey_recording};
pub use units::RangeUnit;
pub(crate) use write::CarmenWriter;

/// Ranges beyond this are garbage, metres.
const RANGE_MAX_M: f64 = 1e5;
/// The parameter by which a log written by echogrid says its sonars' maximum, metres: larger ranges
/// are no echo.
pub(crate) const SONAR_MAX_PARAM: &str = "echogrid_sonar_max";

/// The parameter by which such a log says when each sonar fired, nanoseconds after the stamp of its `SONAR` line, one
/// number per sonar with commas between them.
pub(crate) const SONAR_OFFSETS_PARAM: &str = "echogrid_sonar_offsets_ns";

/// Whether a range is a number that a sensor may have written.
fn is_sane(range_m: f64) -> bool {
    range_m.is_finite() && range_m.abs() <= RANGE_MAX_M
}
