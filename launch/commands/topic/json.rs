//! Messages as JSON: one object per line.

use echogrid_core::VerdictCounts;
use echogrid_topics::{Header, Health, Layer, MapInfo, Message, ServiceState, TileUpdate};
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

/// All that a message says.
pub(super) fn value(message: &Message) -> Value {
    match message {
        Message::Robot(robot) => json!(robot),
        Message::Odometry(raw) => json!(raw),
        Message::Scan(readings) => json!(readings),
        Message::Estimate(estimate) => json!(estimate),
        Message::Tile(tile) => {
            let mut value = brief_tile(tile);
            // What is unknown is null.
            value["log_odds"] = json!(tile.log_odds.as_slice());
            value
        }
        Message::Info(info) => map_info(info),
        Message::Verdicts(verdicts) => {
            let named = |(transducer, verdict): &(u16, echogrid_core::Verdict)| json!([transducer, verdict.name()]);
            verdicts.iter().map(named).collect()
        }
        Message::Health(health) => service(health),
        Message::TruePose(pose) => json!(pose),
        Message::TrueWorld(world) => json!({ "name": world.name, "bounds_m": world.bounds_m }),
        Message::Request(request) => json!(request),
        Message::Fix(fix) => json!(fix),
    }
}

/// What of a message fits a line.
pub(super) fn brief(message: &Message) -> Value {
    if let Message::Tile(tile) = message { brief_tile(tile) } else { value(message) }
}

fn brief_tile(tile: &TileUpdate) -> Value {
    let layer = match tile.layer {
        Layer::Map => json!("map"),
        Layer::Sonar(number) => json!({ "sonar": number }),
        Layer::Doubt => json!("doubt"),
    };
    let known = tile.log_odds.iter().filter(|value| !value.is_nan()).count();
    let TileUpdate { index, revision, resolution_m, .. } = tile;
    json!({ "layer": layer, "index": index, "revision": revision, "resolution_m": resolution_m, "cells_known": known })
}

fn map_info(info: &MapInfo) -> Value {
    let verdicts = |counts: &VerdictCounts| -> Value {
        counts
            .iter()
            .map(|(verdict, count)| (verdict.name().to_owned(), json!(count)))
            .collect::<serde_json::Map<_, _>>()
            .into()
    };
    json!({
        "revision": info.revision,
        "scans": info.scans,
        "cells_known": info.cells_known,
        "cells_occupied": info.cells_occupied,
        "cells_free": info.cells_free,
        "entropy_bits": info.entropy_bits,
        "trust": info.trust,
        "distance_m": info.distance_m,
        "bounds": info.bounds.map(|(low, high)| [[low.i, low.j], [high.i, high.j]]),
        "verdicts": verdicts(&info.verdicts),
        "remapped": info.remapped,
        "remap_left": info.remap_left,
        "finished": info.finished,
        "degraded": info.degraded,
        "held": info.held,
        "fixes": info.fixes,
        "fixes_refused": info.fixes_refused,
        "unplaced": info.unplaced,
        "leaps": info.leaps,
        "contradictions": info.contradictions,
        "sonars": info.sonars.iter().map(verdicts).collect::<Vec<_>>(),
    })
}

fn service(health: &Health) -> Value {
    let acks: Vec<Value> = health
        .acks
        .iter()
        .map(|ack| json!({ "topic": ack.topic.name(), "epoch": ack.epoch, "sequence": ack.sequence }))
        .collect();
    json!({
        "service": health.service,
        "pid": health.pid,
        "state": state(health.state),
        "progress": health.progress,
        "total": health.total,
        "stamp_ns": health.stamp_ns,
        "first_stamp_ns": health.first_stamp_ns,
        "faults": health.faults,
        "lost": health.lost,
        "acks": acks,
        "waits_for": health.waits_for.map(echogrid_topics::Topic::name),
        "last_error": health.last_error,
    })
}

/// A state in a word.
pub(in crate::commands) fn state(state: ServiceState) -> &'static str {
    match state {
        ServiceState::Starting => "starting",
        ServiceState::Running => "running",
        ServiceState::Draining => "draining",
        ServiceState::Finished => "finished",
        ServiceState::Failed => "failed",
        ServiceState::Gone => "gone",
    }
}
