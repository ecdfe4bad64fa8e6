//! Settings on the command line: `--set key=value` and its short forms.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::problem::{Origin, Problem};
use super::reading::{self, Findings};
use super::schema::{self, Text};
use super::source::{Source, TEXT_BYTES_MAX};

/// `key=value` as given after `--set`.
pub(crate) fn set(argument: &str, source: &Source) -> Findings {
    match argument.split_once('=') {
        Some((key, value)) => assign(key, value.trim(), source),
        None => refused(source, "expected KEY=VALUE, like mapper.resolution_m=0.1"),
    }
}

/// The value for a dotted key: TOML, or else a text.
pub(crate) fn assign(key: &str, value: &str, source: &Source) -> Findings {
    let path: Vec<&str> = key.split('.').map(str::trim).collect();
    if path.len() > 4 || path.contains(&"") || key.len() + value.len() > TEXT_BYTES_MAX {
        return refused(source, "expected TABLE.KEY=VALUE, like mapper.resolution_m=0.1");
    }
    let is_text = schema::at(&path).is_some_and(|key| key.text != Text::Toml);
    let parsed = DeValue::parse(value).ok().map(Spanned::into_inner);
    let parsed = parsed.filter(|parsed| !is_text || parsed.is_str());
    let text = DeValue::String(value.into());
    let tree = path.iter().rev().fold(parsed.unwrap_or(text), |inner, part| {
        DeValue::Table(DeTable::from_iter([(spanned((*part).into()), spanned(inner))]))
    });
    match tree {
        DeValue::Table(table) => reading::table(&table, source),
        _ => Findings::default(),
    }
}

fn spanned<T>(value: T) -> Spanned<T> {
    Spanned::new(0..0, value)
}

fn refused(source: &Source, message: &str) -> Findings {
    let origin: Option<Origin> = Some(source.origin(&(0..0)));
    let problem = Problem { origin, key: String::new(), value: None, message: message.to_owned() };
    Findings { settings: Vec::new(), problems: vec![problem] }
}
