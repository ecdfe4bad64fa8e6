//! Files that are gone on with, and files that end anywhere.

use super::super::container::{Container as _, Entry};
use super::super::mcap::Mcap;
use super::*;

fn channel(topic: &str) -> McapChannel {
    McapChannel {
        topic: topic.to_owned(),
        encoding: "echogrid".to_owned(),
        schema_name: format!("type of {topic}"),
        schema_encoding: String::new(),
        schema: vec![1, 2, 3],
    }
}

/// Topic, stamp and first byte of each message, and how often something was damaged.
fn read(bytes: &[u8]) -> (Vec<(String, u64, u8)>, usize) {
    let (mut messages, mut damaged) = (Vec::new(), 0);
    let mut reader = Mcap::new(bytes).unwrap();
    let mut take = |entry: Entry<'_>| match entry {
        Entry::Message { channel, log_ns, data } => messages.push((channel.topic.clone(), log_ns, data[0])),
        Entry::Damage(_) => damaged += 1,
    };
    while reader.advance(&mut take).unwrap() {}
    (messages, damaged)
}

fn add(writer: &mut McapWriter, from: u8, to: u8) {
    for number in from..to {
        let topic = channel(if number % 3 == 0 { "a" } else { "b" });
        let channel = writer.channel(&topic).unwrap();
        writer.message(channel, number.into(), u64::from(number) * 10, &[number; 100]).unwrap();
    }
}

fn expected(to: u8) -> Vec<(String, u64, u8)> {
    let topic = |number| (if number % 3 == 0 { "a" } else { "b" }).to_owned();
    (0..to).map(|number| (topic(number), u64::from(number) * 10, number)).collect()
}

#[test]
fn what_was_flushed_is_read_wherever_the_file_ends() {
    let mut file = tempfile::tempfile().unwrap();
    let mut writer = McapWriter::new(file.try_clone().unwrap(), "test", &RunWords::new()).unwrap();
    add(&mut writer, 0, 10);
    let flushed = writer.flush().unwrap() as usize;
    add(&mut writer, 10, 20);
    writer.finish("echogrid", &BTreeMap::from([("missed".to_owned(), "0".to_owned())])).unwrap();
    file.rewind().unwrap();
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).unwrap();
    assert_eq!(read(&bytes), (expected(20), 0));
    for end in MAGIC.len()..bytes.len() {
        let (messages, damaged) = read(&bytes[..end]);
        assert_eq!(damaged, 1, "cut at {end}");
        assert!(messages.len() <= 20 && messages[..] == expected(20)[..messages.len()], "cut at {end}");
        assert!(end < flushed || messages.len() >= 10, "cut at {end}");
    }
}

#[test]
fn a_file_that_is_gone_on_with_is_the_file_that_was_never_left() {
    let write = |resumes_at: Option<(u8, i64)>| {
        let mut file = tempfile::tempfile().unwrap();
        let mut writer = McapWriter::new(file.try_clone().unwrap(), "test", &RunWords::new()).unwrap();
        add(&mut writer, 0, 10);
        let length = writer.flush().unwrap();
        if let Some((beyond, cut)) = resumes_at {
            // What was recorded after the last word about it, and is recorded once more.
            add(&mut writer, 10, beyond);
            writer.flush().unwrap();
            file.set_len(file.metadata().unwrap().len().saturating_add_signed(-cut)).unwrap();
            writer = McapWriter::resume(file.try_clone().unwrap(), length).unwrap();
        }
        add(&mut writer, 10, 20);
        writer.finish("echogrid", &BTreeMap::new()).unwrap();
        file.rewind().unwrap();
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).unwrap();
        bytes
    };
    let whole = write(None);
    for resumes_at in [(10, 0), (15, 0), (15, 3)] {
        assert_eq!(write(Some(resumes_at)), whole);
    }
}

#[test]
fn only_what_is_whole_is_gone_on_with() {
    let file = tempfile::tempfile().unwrap();
    let mut writer = McapWriter::new(file.try_clone().unwrap(), "test", &RunWords::new()).unwrap();
    add(&mut writer, 0, 10);
    let length = writer.flush().unwrap();
    // A power cut took what the disk had not been told to keep.
    file.set_len(length - 200).unwrap();
    let writer = McapWriter::resume(file.try_clone().unwrap(), length).unwrap();
    assert!(writer.length < length - 200 && writer.chunks.len() <= 1, "{writer:?}");
    let no_file = McapWriter::resume(tempfile::tempfile().unwrap(), 10).unwrap_err();
    assert!(no_file.to_string().contains("too few"), "{no_file}");
}
