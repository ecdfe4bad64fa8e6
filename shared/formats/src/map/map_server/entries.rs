//! The keys of a YAML and their values, from the events of a parser.
//!
//! A map's YAML is one mapping of keys to values and lists of values. What lies deeper belongs to keys
//! that a map has no use for, and is passed over without being kept.

use std::collections::BTreeMap;
use std::fmt;
use std::rc::Rc;

use saphyr_parser::{Event, Parser, StrInput};

use super::YamlError;
use crate::text::shortened;

/// A key with its value.
pub(super) struct Entry {
    /// Where the key stands, counted from 1.
    pub(super) line: usize,
    pub(super) key: Rc<str>,
    pub(super) value: Value,
}

/// A value, as far as a map can use it; shared, as aliases may name a long one often.
#[derive(Clone)]
pub(super) enum Value {
    Text(Rc<str>),
    /// None: an item that is no text.
    List(Rc<[Option<Rc<str>>]>),
    Mapping,
}

impl Entry {
    /// Its text, if it is one.
    pub(super) fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Text(text) => Some(text),
            Value::List(_) | Value::Mapping => None,
        }
    }

    /// Its items, if it is a list.
    pub(super) fn items(&self) -> Option<impl Iterator<Item = Option<&str>>> {
        match &self.value {
            Value::List(items) => Some(items.iter().map(Option::as_deref)),
            Value::Text(_) | Value::Mapping => None,
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::Mapping => f.write_str("{…}"),
            Self::List(items) => {
                let items: Vec<&str> = items.iter().map(|item| item.as_deref().unwrap_or("[…]")).collect();
                write!(f, "[{}]", items.join(", "))
            }
        }
    }
}

/// The keys of the first document of a text, which must be a mapping and the only one that says anything.
pub(super) fn entries(text: &str) -> Result<Vec<Entry>, YamlError> {
    let text = &spaced(text.trim_start_matches('\u{feff}'));
    let mut events = Events { text, parser: Parser::new_from_str(text), anchors: BTreeMap::new() };
    let mut entries: Vec<Entry> = Vec::new();
    let mut is_first = true;
    loop {
        let (event, line) = events.next()?;
        let what = match event {
            Event::StreamEnd => return Ok(entries),
            Event::StreamStart | Event::DocumentStart(_) | Event::DocumentEnd | Event::Nothing => continue,
            Event::Scalar(value, ..) if value.is_empty() => continue,
            _ if !is_first => "a second document",
            Event::MappingStart(..) => {
                is_first = false;
                entries = events.mapping()?;
                continue;
            }
            Event::SequenceStart(..) => "a list",
            _ => "one value",
        };
        return Err(events.wrong(line, what));
    }
}

/// The text with a blank for the tab after a key. YAML allows it and map_server reads it; the parser refuses it, as what
/// follows may not begin a mapping of its own.
fn spaced(text: &str) -> String {
    let spaced_line = |line: &str| {
        let is_of_key = |c: char| c.is_ascii_alphanumeric() || "_-\"' ".contains(c);
        match line.split_once(":\t") {
            Some((key, value)) if !key.starts_with([' ', '-']) && key.chars().all(is_of_key) => {
                format!("{key}: {value}")
            }
            _ => line.to_owned(),
        }
    };
    text.split_inclusive('\n').map(spaced_line).collect()
}

struct Events<'a> {
    text: &'a str,
    parser: Parser<'a, StrInput<'a>>,
    anchors: BTreeMap<usize, Value>,
}

impl<'a> Events<'a> {
    /// The next event, with its line.
    fn next(&mut self) -> Result<(Event<'a>, usize), YamlError> {
        match self.parser.next_event() {
            Some(Ok((event, span))) => Ok((event, span.start.line())),
            Some(Err(error)) => {
                // Where a line is no key the parser knows it at the beginning of the next one.
                let at = error.marker();
                let is_over = at.col() == 0 && error.info().starts_with("simple key expect");
                Err(self.wrong(at.line().saturating_sub(usize::from(is_over)), error.info()))
            }
            None => Ok((Event::StreamEnd, 0)),
        }
    }

    fn wrong(&self, line: usize, what: &str) -> YamlError {
        // At the end of the text an error stands one line too far.
        let line = line.clamp(1, self.text.lines().count().max(1));
        let text = shortened(self.text.lines().nth(line - 1).unwrap_or_default());
        YamlError::Line { line, text, what: shortened(what) }
    }

    /// The keys of the mapping that has begun.
    fn mapping(&mut self) -> Result<Vec<Entry>, YamlError> {
        let mut entries: Vec<Entry> = Vec::new();
        loop {
            let (event, line) = self.next()?;
            if matches!(event, Event::MappingEnd | Event::StreamEnd) {
                return Ok(entries);
            }
            let key = match self.value(event)? {
                Value::Text(key) => key,
                Value::List(_) | Value::Mapping => return Err(self.wrong(line, "a key that is no text")),
            };
            if entries.iter().any(|entry| entry.key == key) {
                return Err(YamlError::Twice { line, key: shortened(&key) });
            }
            let (event, _) = self.next()?;
            let value = self.value(event)?;
            entries.push(Entry { line, key, value });
        }
    }

    /// The value that begins with an event.
    fn value(&mut self, event: Event<'a>) -> Result<Value, YamlError> {
        let (value, anchor) = match event {
            Event::Scalar(text, _, anchor, _) => (Value::Text(text.as_ref().into()), anchor),
            Event::SequenceStart(anchor, _) => (self.list()?, anchor),
            Event::MappingStart(anchor, _) => {
                self.pass_over()?;
                (Value::Mapping, anchor)
            }
            // An unknown one is an error of the parser; one that lies deeper is no value of a map.
            Event::Alias(anchor) => (self.anchors.get(&anchor).cloned().unwrap_or(Value::Mapping), 0),
            _ => (Value::Text(Rc::default()), 0),
        };
        if anchor != 0 {
            self.anchors.insert(anchor, value.clone());
        }
        Ok(value)
    }

    fn list(&mut self) -> Result<Value, YamlError> {
        let mut items = Vec::new();
        loop {
            let (event, _) = self.next()?;
            items.push(match event {
                Event::SequenceEnd | Event::StreamEnd => return Ok(Value::List(items.into())),
                Event::SequenceStart(..) | Event::MappingStart(..) => {
                    self.pass_over()?;
                    None
                }
                event => match self.value(event)? {
                    Value::Text(text) => Some(text),
                    Value::List(_) | Value::Mapping => None,
                },
            });
        }
    }

    /// Reads to the end of the list or mapping that has begun.
    fn pass_over(&mut self) -> Result<(), YamlError> {
        let mut depth = 1_usize;
        while depth > 0 {
            match self.next()?.0 {
                Event::SequenceStart(..) | Event::MappingStart(..) => depth += 1,
                Event::SequenceEnd | Event::MappingEnd => depth -= 1,
                Event::StreamEnd => break,
                _ => {}
            }
        }
        Ok(())
    }
}
