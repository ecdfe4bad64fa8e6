//! Lines of JSON, and of text for people: one message each.

use echogrid_topics::Header;
use serde_json::{Value, json};

/// A line: what every message has, and `what` it is.
pub(super) fn line(header: &Header, what: &str, value: Value) -> String {
    let Header { sequence, epoch, stamp_ns, .. } = header;
    json!({ "sequence": sequence, "epoch": epoch, "stamp_ns": stamp_ns, what: value }).to_string()
}

/// Likewise, for people.
pub(super) fn text(header: &Header, what: &str) -> String {
    format!("{:>6}  {:10.3} s  {what}", header.sequence, header.stamp_ns as f64 * 1e-9)
}
