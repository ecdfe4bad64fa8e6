//! `echogrid topic`: what goes through the topics of a running graph.

mod json;
mod reader;

use echogrid_instruments::json;
use std::collections::BTreeMap;
use std::io::Write;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use echogrid_topics::{Delivery, Received, Topic, languages, wire};
use reader::{Next, Reader};
use serde_json::{Value, json};

use super::talk;
use crate::cli::{LayoutLanguage, TopicCommand};

/// Carries out `echogrid topic …`.
pub(super) fn run(command: &TopicCommand) -> Result<()> {
    match command {
        TopicCommand::Layout { lang } => super::print(&match lang {
            LayoutLanguage::Text => wire::layouts(),
            LayoutLanguage::Python => languages::python(),
            LayoutLanguage::C => languages::c_header(),
        }),
        TopicCommand::List { domain, json } => list(domain.as_deref(), *json),
        TopicCommand::Echo { name, domain, count, json } => echo(named(name)?, domain.as_deref(), *count, *json),
        TopicCommand::Hz { name, domain, count, window, json } => {
            hz(named(name)?, domain.as_deref(), *count, Duration::from_secs_f64(*window), *json)
        }
    }
}

fn named(name: &str) -> Result<Topic> {
    let found = Topic::ALL.into_iter().find(|topic| topic.name() == name);
    found.with_context(|| format!("there is no topic {name:?}; there are: {}", Topic::ALL.map(Topic::name).join(", ")))
}

/// Who writes and who reads each topic, by the roles in the graph.
fn list(domain: Option<&str>, as_json: bool) -> Result<()> {
    let (_, _, config) = talk::running(domain, "echogrid topic")?;
    let readers = echogrid_supervision::consumers(&config.services);
    let writers = echogrid_supervision::writers(&config.services);
    let onlookers = echogrid_supervision::onlookers(&config.services);
    let topics = config.topic_names().map(|topic| {
        let of = |names: &BTreeMap<String, Vec<String>>| names.get(topic).cloned().unwrap_or_default();
        let readers = [of(&readers), of(&onlookers)].concat();
        (topic, config.delivery(topic).map_or("", Delivery::word), of(&writers), readers)
    });
    if as_json {
        let topics: Vec<Value> = topics
            .map(|(name, delivery, writers, readers)| {
                json!({ "topic": name, "delivery": delivery, "writers": writers, "readers": readers })
            })
            .collect();
        return super::print(&json(&topics)?);
    }
    let lines = topics.map(|(name, delivery, writers, readers)| {
        format!("{name:<21} {delivery:<10} {} → {}\n", writers.join(", "), readers.join(", "))
    });
    super::print(&lines.collect::<String>())
}

/// Prints messages until the stream or the graph ends, or there were enough.
fn echo(topic: Topic, domain: Option<&str>, count: Option<u64>, as_json: bool) -> Result<()> {
    let mut reader = Reader::open(domain, topic)?;
    let mut left = count.unwrap_or(u64::MAX);
    while left > 0 {
        let received = match reader.next(None)? {
            Next::Received(received) => received,
            Next::Over | Next::Nothing => break,
        };
        let line = match &received {
            Received::Message(header, message) if as_json => json::line(header, "message", message.json()),
            Received::End(header) if as_json => json::line(header, "end", Value::Bool(true)),
            Received::Told(header, pid) if as_json => json::line(header, "told", Value::from(*pid)),
            Received::Faulty(header, fault) if as_json => json::line(header, "fault", Value::String(fault.to_string())),
            Received::Message(header, message) => json::text(header, &message.brief().to_string()),
            Received::End(header) => json::text(header, "the stream ends"),
            Received::Told(header, pid) => json::text(header, &format!("process {pid} has been told all that counts")),
            Received::Faulty(header, fault) => json::text(header, &format!("faulty: {fault}")),
        };
        if !say(&line)? {
            break;
        }
        left -= 1;
    }
    Ok(())
}

/// Prints how many messages come in a second, of the clock on the wall and of the sensor's.
fn hz(topic: Topic, domain: Option<&str>, count: Option<u64>, window: Duration, as_json: bool) -> Result<()> {
    let mut reader = Reader::open(domain, topic)?;
    // What was kept for whoever comes late says nothing of the rate.
    while let Next::Received(_) = reader.next(Some(Instant::now()))? {}
    for _ in 0..count.unwrap_or(u64::MAX) {
        let (start, lost_before) = (Instant::now(), reader.lost());
        let (mut messages, mut stamps) = (0_u64, None);
        let over = loop {
            match reader.next(Some(start + window))? {
                Next::Received(Received::Message(header, _)) => {
                    messages += 1;
                    let (first_ns, _) = stamps.unwrap_or((header.stamp_ns, 0));
                    stamps = Some((first_ns, header.stamp_ns));
                }
                Next::Received(_) => {}
                Next::Nothing => break false,
                Next::Over => break true,
            }
        };
        let per_second = messages as f64 / start.elapsed().as_secs_f64();
        let sensor_s = stamps.map_or(0.0, |(first_ns, last_ns)| last_ns.saturating_sub(first_ns) as f64 * 1e-9);
        // From stamp to stamp there is one fewer than there are messages.
        let by_stamps = (sensor_s > 0.0).then(|| messages.saturating_sub(1) as f64 / sensor_s);
        let missed = reader.lost() - lost_before;
        let line = if as_json {
            json!({ "topic": topic.name(), "messages": messages, "hz": per_second, "hz_by_stamps": by_stamps, "missed": missed })
                .to_string()
        } else {
            let by_stamps = by_stamps.map_or(String::new(), |hz| format!(", {hz:.2} /s by their stamps"));
            let missed = if missed > 0 { format!(", {missed} missed here") } else { String::new() };
            format!("{}: {per_second:.2} /s{by_stamps}{missed}", topic.name())
        };
        if !say(&line)? || over {
            break;
        }
    }
    Ok(())
}

/// Prints a line at once; whether anybody still listens.
fn say(line: &str) -> Result<bool> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{line}").and_then(|()| out.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(false),
        Err(error) => bail!("printing: {error}"),
    }
}
