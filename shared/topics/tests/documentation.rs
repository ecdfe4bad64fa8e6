//! docs/topics.md is read by people who write sensors in other languages: what it quotes must be true.

use echogrid_topics::Topic;
use echogrid_topics::wire::layouts;

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
    let rows = DOCUMENTATION.lines().skip_while(|line| !line.starts_with("| topic | code |")).skip(2);
    let rows: Vec<&str> = rows.take_while(|line| line.starts_with('|')).collect();
    assert_eq!(rows.len(), Topic::ALL.len(), "{rows:#?}");
    for (row, topic) in rows.iter().zip(Topic::ALL) {
        let payload = if topic.is_slice() { "slice" } else { "struct" };
        let (name, code, schema, delivery) =
            (topic.name(), topic.code(), topic.layout().schema, topic.delivery().word());
        let expected = format!("| `{name}` | {code} | `{schema}` | {payload} | {delivery} |");
        assert!(row.starts_with(&expected), "{row}\nexpected: {expected} …");
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
