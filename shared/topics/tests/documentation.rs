//! docs/topics.md is read by people who write sensors in other languages: what it quotes must be true.

use echogrid_topics::wire::layouts;
use echogrid_topics::{Delivery, Topic};

const DOCUMENTATION: &str = include_str!("../../../docs/topics.md");

/// The layout of one type: its line in `layout.txt` and those of its fields.
fn layout(name: &str) -> Option<String> {
    let all = layouts();
    let mut lines = all.lines().skip_while(|line| line.split(' ').next() != Some(name));
    let first = lines.next()?.to_owned();
    Some(lines.take_while(|line| line.starts_with(' ')).fold(first, |text, line| text + "\n" + line))
}

#[test]
fn quoted_layouts_are_those_of_the_code() {
    let quoted: Vec<&str> =
        DOCUMENTATION.split("```layout\n").skip(1).map(|rest| rest.split("\n```").next().unwrap()).collect();
    assert!(quoted.len() >= 7, "{quoted:?}");
    for block in quoted {
        assert_eq!(Some(block.to_owned()), layout(block.split(' ').next().unwrap()));
    }
}

#[test]
fn every_topic_has_its_row() {
    for topic in Topic::ALL {
        let delivery = match topic.delivery() {
            Delivery::Lossless => "lossless",
            Delivery::Relayed => "relayed",
            Delivery::Latest => "latest",
            Delivery::Droppable => "droppable",
        };
        let row = format!("| `{}` | {} | `echogrid/", topic.name(), topic as u32);
        let row = DOCUMENTATION.lines().find(|line| line.starts_with(&row)).unwrap_or_else(|| panic!("no row {row}"));
        assert_eq!(row.split('|').nth(5).unwrap().trim(), delivery, "{row}");
    }
}

#[test]
fn quality_of_service_is_as_told() {
    let mut rows = 0;
    for topic in Topic::ALL.into_iter().filter(|topic| *topic != Topic::RangeScan) {
        let qos = topic.qos(16);
        let window = if qos.window == u64::MAX { "none".to_owned() } else { qos.window.to_string() };
        let numbers =
            format!("| {} | {} | {window} | {} | {} |", qos.history, qos.buffer, qos.subscribers, qos.publishers);
        let name = format!("`{}`", topic.name());
        rows += DOCUMENTATION.lines().filter(|line| line.contains(&name) && line.ends_with(&numbers)).count();
    }
    assert_eq!(rows, Topic::ALL.len() - 1);
}

#[test]
fn the_window_of_scans_is_as_told() {
    for max_readings in [1, 8, 16, 181, 361, 1024, 5000] {
        let history = ((2 << 20) / (16 * max_readings)).clamp(64, 2048);
        let qos = Topic::RangeScan.qos(max_readings);
        assert_eq!((qos.history, qos.buffer, qos.window), (history, 2 * history, history as u64 / 2));
    }
}
