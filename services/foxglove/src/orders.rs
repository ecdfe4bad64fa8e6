//! Orders as services that Foxglove can call: save, pause, resume, fix; JSON in, JSON out.

use std::time::Duration;

use anyhow::{Context, Result, ensure};
use echogrid_core::{Fix, Pose2};
use echogrid_service::in_words;
use echogrid_service::onlooker::Operator;
use echogrid_topics::{Command, Domain};
use foxglove::Schema;
use foxglove::websocket::service::{Service, ServiceSchema};
use serde::Deserialize;
use serde_json::json;

/// Writing a large map to a slow disk takes its time.
const SAVED_WITHIN: Duration = Duration::from_secs(60);
/// Between two steps of a service.
pub(crate) const DONE_WITHIN: Duration = Duration::from_secs(10);

/// A fix as it is called with.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FixCall {
    x: f64,
    y: f64,
    theta: f64,
    sigma_m: f64,
    sigma_rad: f64,
}

/// The services of a graph.
pub(crate) fn services(domain: &Domain) -> Vec<Service> {
    let plain = |word: &str, kind: &'static str, command: Command, within: Duration| {
        let domain = domain.clone();
        let call = move |_| answer(order(&domain, kind, command, within));
        Service::builder(format!("/{word}"), schema(word, &json!({ "type": "object" }))).blocking_handler_fn(call)
    };
    let numbers = ["x", "y", "theta", "sigma_m", "sigma_rad"];
    let properties: serde_json::Map<_, _> =
        numbers.iter().map(|name| ((*name).to_owned(), json!({ "type": "number" }))).collect();
    let of_fix = json!({ "type": "object", "properties": properties, "required": numbers });
    let fixed = domain.clone();
    let fix = Service::builder("/fix", schema("fix", &of_fix)).blocking_handler_fn(
        move |request: foxglove::websocket::service::Request| {
            answer(fix_of(request.payload()).and_then(|fix| order(&fixed, "odometry", Command::Fix(fix), DONE_WITHIN)))
        },
    );
    vec![
        plain("save", "publisher", Command::Save, SAVED_WITHIN),
        plain("pause", "mapper", Command::Pause, DONE_WITHIN),
        plain("resume", "mapper", Command::Resume, DONE_WITHIN),
        fix,
    ]
}

fn schema(word: &str, request: &serde_json::Value) -> ServiceSchema {
    let of =
        |name: String, schema: &serde_json::Value| Schema::new(name, "jsonschema", schema.to_string().into_bytes());
    let response = json!({ "type": "object", "properties": { "text": { "type": "string" } } });
    ServiceSchema::new(format!("echogrid/{word}"))
        .with_request("json", of(format!("echogrid/{word}/request"), request))
        .with_response("json", of("echogrid/answer".to_owned(), &response))
}

fn fix_of(payload: &[u8]) -> Result<Fix> {
    let FixCall { x, y, theta, sigma_m, sigma_rad } = serde_json::from_slice(payload).context("this is no fix")?;
    // Squared, a sign would be lost.
    ensure!(sigma_m >= 0.0 && sigma_rad >= 0.0, "sigma_m = {sigma_m}, sigma_rad = {sigma_rad}: expected 0 or more");
    let fix = Fix::about(Pose2 { x, y, theta }, sigma_m, sigma_rad);
    fix.validate().context("a robot can't be there")?;
    Ok(fix)
}

fn order(domain: &Domain, kind: &str, command: Command, within: Duration) -> Result<String> {
    Operator::enter(domain, "echogrid-foxglove orders")?.order(kind, command, within)
}

fn answer(done: Result<String>) -> Result<Vec<u8>, String> {
    done.map(|text| json!({ "text": text }).to_string().into_bytes()).map_err(|error| in_words(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fix_is_checked() {
        assert!(fix_of(br#"{"x":1,"y":2,"theta":0.5,"sigma_m":0.1,"sigma_rad":0}"#).is_ok());
        for wrong in [
            &b""[..],
            b"{}",
            br#"{"x":1,"y":2,"theta":0,"sigma_m":-1,"sigma_rad":0}"#,
            br#"{"x":1e30,"y":2,"theta":0,"sigma_m":1,"sigma_rad":0}"#,
        ] {
            assert!(fix_of(wrong).is_err(), "{}", String::from_utf8_lossy(wrong));
        }
    }
}
