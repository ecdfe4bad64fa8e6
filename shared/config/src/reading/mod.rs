//! From a text to settings: every key known, every value of the right type.

mod robot;

use std::ops::Range;

use echogrid_topics::DeclaredTopic;
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use super::problem::{Origin, Problem};
use super::schema::{self, GRAPH, SERVICE, Section, TOPIC};
use super::source::{Source, TEXT_BYTES_MAX};
use super::suggest;
use super::value;

/// Problems beyond are not told: they follow from the first.
const PROBLEMS_MAX: usize = 20;

/// One key that was set; also one for each service and each topic, with an empty table: that it was named.
#[derive(Debug, Clone)]
pub(crate) struct Setting {
    pub(crate) path: Vec<String>,
    pub(crate) value: Value,
    pub(crate) origin: Origin,
}

/// What was read.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    pub(crate) settings: Vec<Setting>,
    pub(crate) problems: Vec<Problem>,
}

impl Findings {
    pub(crate) fn add(&mut self, other: Self) {
        self.settings.extend(other.settings);
        self.problems.extend(other.problems);
    }
}

/// A graph file.
pub(crate) fn graph(text: &str, source: &Source) -> Findings {
    document(text, source, |reader, table| reader.graph(table))
}

/// A robot file. Items of `[[sonar]]` have their number as a part of the path.
pub(crate) fn robot(text: &str, source: &Source) -> Findings {
    document(text, source, |reader, table| reader.robot(table))
}

/// A table made of an argument of the command line.
pub(crate) fn table(table: &DeTable<'_>, source: &Source) -> Findings {
    let mut reader = Reader { source, found: Findings::default() };
    reader.graph(table);
    reader.found
}

fn document(text: &str, source: &Source, read: impl FnOnce(&mut Reader<'_>, &DeTable<'_>)) -> Findings {
    let mut reader = Reader { source, found: Findings::default() };
    if text.len() > TEXT_BYTES_MAX {
        reader.problem(&[], &(0..0), None, "longer than 1 MiB: this is not a configuration".to_owned());
        return reader.found;
    }
    let (table, errors) = DeTable::parse_recoverable(text);
    if errors.is_empty() {
        read(&mut reader, table.get_ref());
    }
    for error in errors {
        let message = error.message().replace('\n', " ");
        reader.problem(&[], &error.span().unwrap_or(0..0), None, message);
    }
    reader.found.problems.truncate(PROBLEMS_MAX);
    reader.found
}

struct Reader<'a> {
    source: &'a Source,
    found: Findings,
}

impl Reader<'_> {
    fn problem(&mut self, path: &[&str], span: &Range<usize>, value: Option<&Value>, message: String) {
        let origin = Some(self.source.origin(span));
        self.found.problems.push(Problem { origin, key: dotted(path), value: value.map(value::shown), message });
    }

    fn graph(&mut self, table: &DeTable<'_>) {
        for (name, value) in table {
            let path = [name.get_ref().as_ref()];
            if path[0] == SERVICE.name {
                let named = (
                    "the name of a service is 1 to 20 of a-z, 0-9 and -",
                    super::run::is_short_name as fn(&str) -> bool,
                );
                self.each_table(&path, value, named, |reader, path, table| reader.section(&SERVICE, path, table));
            } else if path[0] == TOPIC.name {
                let named = (
                    "the name of a topic is at most 64 of a-z, 0-9, -, _ with / between its parts, and does not begin with control/",
                    DeclaredTopic::is_name as fn(&str) -> bool,
                );
                self.each_table(&path, value, named, |reader, path, table| reader.section(&TOPIC, path, table));
            } else if let Some(section) = GRAPH.iter().find(|section| section.name == path[0]) {
                self.one_table(&path, value, |reader, path, table| reader.section(section, path, table));
            } else {
                let sections = GRAPH.iter().map(|section| section.name).chain([SERVICE.name, TOPIC.name]);
                let hint = match path[0] {
                    "robot" => "a robot is named by `run.robot` and described in a file of its own".to_owned(),
                    _ => stray(path[0], &sections.collect::<Vec<_>>(), None),
                };
                self.problem(&path, &name.span(), None, format!("unknown key; {hint}"));
            }
        }
    }

    fn one_table(
        &mut self,
        path: &[&str],
        value: &toml::Spanned<DeValue<'_>>,
        read: impl FnOnce(&mut Self, &[&str], &DeTable<'_>),
    ) {
        match value.get_ref() {
            DeValue::Table(table) => read(self, path, table),
            other => {
                let message = format!("expected a table `[{}]`, found {}", dotted(path), value::kind(other));
                self.problem(path, &value.span(), None, message);
            }
        }
    }

    fn each_table(
        &mut self,
        path: &[&str],
        value: &toml::Spanned<DeValue<'_>>,
        (expected, is_name): (&str, fn(&str) -> bool),
        mut read: impl FnMut(&mut Self, &[&str], &DeTable<'_>),
    ) {
        self.one_table(path, value, |reader, path, table| {
            for (name, value) in table {
                let path = [path[0], name.get_ref().as_ref()];
                if is_name(path[1]) {
                    let origin = reader.source.origin(&name.span());
                    let setting = Setting { path: path.map(str::to_owned).into(), value: Table::new().into(), origin };
                    reader.found.settings.push(setting);
                    reader.one_table(&path, value, &mut read);
                } else {
                    reader.problem(&path, &name.span(), None, expected.to_owned());
                }
            }
        });
    }

    fn section(&mut self, section: &Section, path: &[&str], table: &DeTable<'_>) {
        let known = section.names();
        for (name, value) in table {
            let path = [path, &[name.get_ref().as_ref()]].concat();
            if known.iter().any(|known| known == name.get_ref()) {
                self.key(section, &path, name.span(), value.get_ref(), &value.span());
            } else {
                let known: Vec<_> = known.iter().map(String::as_str).collect();
                let hint = stray(name.get_ref(), &known, Some(section));
                self.problem(&path, &name.span(), None, format!("unknown key; {hint}"));
            }
        }
    }

    /// A known key.
    fn key(
        &mut self,
        section: &Section,
        path: &[&str],
        at: Range<usize>,
        given: &DeValue<'_>,
        value_at: &Range<usize>,
    ) {
        let name = path.last().copied().unwrap_or_default();
        let plain = match value::plain(given) {
            Ok(plain) => plain,
            Err(why) => return self.problem(path, value_at, None, why),
        };
        let key = section.key(name);
        if let Err(why) = section.takes(name, &plain) {
            let message = key.map_or_else(|| why.message().replace('\n', " "), |key| value::refusal(key, &plain));
            return self.problem(path, value_at, Some(&plain), message);
        }
        if let Some((least, most)) = key.and_then(|key| key.within) {
            let number = plain.as_float().or_else(|| plain.as_integer().map(value::to_float));
            if !number.is_some_and(|number| (least..=most).contains(&number)) {
                let expected = key.map_or("", |key| key.expected);
                return self.problem(path, value_at, Some(&plain), format!("expected {expected}"));
            }
        }
        let Some(plain) = self.with_absolute_path(key, plain) else {
            return self.problem(path, value_at, None, "the path is not Unicode".to_owned());
        };
        let origin = self.source.origin(&at);
        let path: Vec<String> = path.iter().map(|&part| part.to_owned()).collect();
        match plain {
            // Variables of the environment are set one by one.
            Value::Table(variables) => {
                for (variable, value) in variables {
                    let path = path.iter().cloned().chain([variable]).collect();
                    self.found.settings.push(Setting { path, value, origin: origin.clone() });
                }
            }
            value => self.found.settings.push(Setting { path, value, origin }),
        }
    }

    fn with_absolute_path(&self, key: Option<&schema::Key>, value: Value) -> Option<Value> {
        let is_path = |text: &str| match key.map(|key| key.text) {
            Some(schema::Text::Path) => !text.is_empty(),
            Some(schema::Text::MaybePath(endings)) => {
                (text.contains('/') || endings.iter().any(|ending| text.ends_with(ending)))
                    && !text.starts_with(super::service::BUILTIN_PREFIX)
            }
            _ => false,
        };
        match value {
            Value::String(text) if is_path(&text) => self.source.absolute(&text).map(Value::String),
            other => Some(other),
        }
    }
}

/// What to do with a key that is not known here.
fn stray(name: &str, known: &[&str], section: Option<&Section>) -> String {
    let elsewhere = || {
        let other = GRAPH.iter().copied().chain([&SERVICE, &TOPIC]).find(|other| other.key(name).is_some())?;
        let many = if [SERVICE.name, TOPIC.name].contains(&other.name) { ".NAME" } else { "" };
        Some(format!("it belongs to [{}{many}]", other.name))
    };
    elsewhere().or_else(|| suggest::key(name, known)).unwrap_or_else(|| match section {
        Some(section) => format!("[{}] has {}", section.name, known.join(", ")),
        None => format!("known are {}", known.join(", ")),
    })
}

/// A path as one key, quoted where TOML wants it.
pub(crate) fn dotted(path: &[impl AsRef<str>]) -> String {
    let bare =
        |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
    let quote = |part: &str| if bare(part) { part.to_owned() } else { format!("{part:?}") };
    path.iter().map(|part| quote(part.as_ref())).collect::<Vec<_>>().join(".")
}
