//! What every key is for and what it takes, in words.
//!
//! Whether a value is right is decided by the types of the sections; this says why it was not.

mod graph;
mod json;
mod localizing;
mod mapping;
mod range;
mod robot;
mod sensing;

use echogrid_core::config::ConfigError as OutOfRange;
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

pub(crate) use graph::{GRAPH, SERVICE, TOPIC};
pub use json::{graph as json_schema_of_graphs, robot as json_schema_of_robots};
pub(crate) use localizing::ODOMETRY;
pub(crate) use robot::{FOOTPRINT, LIDAR, ROBOT, SONAR, SONARS};
pub(crate) use sensing::SIMULATOR;

/// A table of a file.
pub(crate) struct Section {
    /// As in `[name]`; empty for the top of a file.
    pub(crate) name: &'static str,
    /// What it is about.
    pub(crate) about: &'static str,
    /// Its keys, in the order in which they are shown.
    pub(crate) keys: &'static [Key],
    /// Whether its type takes these keys.
    probe: fn(Table) -> Result<(), toml::de::Error>,
    /// Its defaults, or an empty table.
    defaults: fn() -> Table,
    /// What of these keys is out of its range.
    refuses: fn(Table) -> Option<OutOfRange>,
}

/// A key of a table.
pub(crate) struct Key {
    pub(crate) name: &'static str,
    /// What it takes, as the end of "expected …".
    pub(crate) expected: &'static str,
    /// The words that it takes, if it takes words.
    pub(crate) words: &'static [&'static str],
    /// How its text is understood.
    pub(crate) text: Text,
    /// Least and greatest value, where the type of the section does not say.
    pub(crate) within: Option<(f64, f64)>,
    /// What it is for.
    pub(crate) about: &'static str,
}

/// How the text of a value is understood.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Text {
    /// As TOML, or as a word.
    Toml,
    /// As it stands, also on the command line: `run.domain=007` is a text.
    Plain,
    /// As a path.
    Path,
    /// As a path if it looks like one: with a `/`, or ending in one of these.
    MaybePath(&'static [&'static str]),
}

const fn key(name: &'static str, expected: &'static str, about: &'static str) -> Key {
    Key { name, expected, words: &[], text: Text::Toml, within: None, about }
}

const fn number(
    name: &'static str,
    expected: &'static str,
    within: core::ops::RangeInclusive<f64>,
    about: &'static str,
) -> Key {
    Key { within: Some((*within.start(), *within.end())), ..key(name, expected, about) }
}

const fn text(name: &'static str, text: Text, expected: &'static str, about: &'static str) -> Key {
    Key { text, ..key(name, expected, about) }
}

const fn words(name: &'static str, words: &'static [&'static str], expected: &'static str, about: &'static str) -> Key {
    Key { words, ..key(name, expected, about) }
}

fn probe<T: DeserializeOwned>(table: Table) -> Result<(), toml::de::Error> {
    Value::Table(table).try_into::<T>().map(drop)
}

/// Of a section whose type says all that it takes.
const NOTHING: fn(Table) -> Option<OutOfRange> = |_| None;

fn refused<T: DeserializeOwned>(table: Table, validate: fn(&T) -> Result<(), OutOfRange>) -> Option<OutOfRange> {
    validate(&Value::Table(table).try_into().ok()?).err()
}

fn defaults<T: Default + Serialize>() -> Table {
    Table::try_from(T::default()).unwrap_or_default()
}

impl Section {
    /// Whether the type of the section takes this value for this key.
    pub(crate) fn takes(&self, key: &str, value: &Value) -> Result<(), toml::de::Error> {
        (self.probe)(Table::from_iter([(key.to_owned(), value.clone())]))
    }

    /// What its range has to say of this value for this key, if it is out of that.
    fn refusal(&self, key: &str, value: Value) -> Option<&'static str> {
        let refused = (self.refuses)(Table::from_iter([(key.to_owned(), value)]))?;
        (refused.key == key).then_some(refused.expected)
    }

    pub(crate) fn key(&self, name: &str) -> Option<&'static Key> {
        self.keys.iter().find(|key| key.name == name)
    }

    /// The keys that it knows: the described ones, then what its type has besides.
    pub(crate) fn names(&self) -> Vec<String> {
        let described = self.keys.iter().map(|key| key.name.to_owned());
        let others = (self.defaults)().into_iter().map(|(name, _)| name).filter(|name| self.key(name).is_none());
        described.chain(others).collect()
    }
}

/// What is known of the key at this path of a graph file.
pub(crate) fn at(path: &[impl AsRef<str>]) -> Option<&'static Key> {
    const VARIABLE: Key = text("env", Text::Plain, "a string", "");
    match path {
        [section, key] => GRAPH.iter().find(|s| s.name == section.as_ref())?.key(key.as_ref()),
        [services, _, key] if services.as_ref() == SERVICE.name => SERVICE.key(key.as_ref()),
        [topics, _, key] if topics.as_ref() == TOPIC.name => TOPIC.key(key.as_ref()),
        [services, _, env, _] if services.as_ref() == SERVICE.name && env.as_ref() == "env" => Some(&VARIABLE),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A key that is added to a section has to be described here as well.
    #[test]
    fn every_key_is_described() {
        for section in GRAPH {
            let described: Vec<_> = section.keys.iter().map(|key| key.name.to_owned()).collect();
            assert_eq!(section.names(), described, "[{}]", section.name);
            for key in section.keys {
                assert!(
                    (section.defaults)().contains_key(key.name),
                    "{}.{} is no longer a key",
                    section.name,
                    key.name
                );
            }
        }
    }

    #[test]
    fn every_word_is_taken_and_no_other() {
        for section in GRAPH.iter().copied().chain([&SERVICE, &TOPIC, &ROBOT, &FOOTPRINT, &SONARS, &SONAR, &LIDAR]) {
            for key in section.keys.iter().filter(|key| !key.words.is_empty()) {
                let value = |word: &str| match (section.defaults)().get(key.name) {
                    Some(Value::Array(_)) => Value::Array(vec![Value::from(word)]),
                    _ => Value::from(word),
                };
                for word in key.words {
                    assert!(section.takes(key.name, &value(word)).is_ok(), "{}.{} = {word}", section.name, key.name);
                }
                let refused = section.takes(key.name, &value("no-such-word")).expect_err("a word that is none");
                // Where the type lists its words, it must not know more than the description.
                if let Some(listed) = refused.message().strip_prefix("unknown variant `no-such-word`, ") {
                    let listed: Vec<_> = listed.split('`').skip(1).step_by(2).collect();
                    assert_eq!(listed, key.words, "{}.{}", section.name, key.name);
                }
            }
        }
    }
}
