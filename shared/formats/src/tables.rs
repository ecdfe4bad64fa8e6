//! Tables and keys of TOML files that people write by hand: what is unknown, missing or of the wrong kind is an error with its
//! line and, where there is one, the name that was probably meant.

use std::collections::BTreeMap;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::near::near_word;
use crate::text::{TextError, line_of, quoted, shortened};

/// What an `[x, y]` should be.
pub(crate) const PLACE: &str = "[x, y], metres";

/// The tables that a file may have.
pub(crate) struct Schema {
    /// Tables and their keys; `?` marks a key that may be left out.
    pub(crate) tables: &'static [(&'static str, &'static [&'static str])],
    /// The only table that stands there once.
    pub(crate) single: Option<&'static str>,
}

/// Text as TOML.
pub(crate) fn parse(text: &str) -> Result<Spanned<DeTable<'_>>, TextError> {
    let (document, errors) = DeTable::parse_recoverable(text);
    match errors.first() {
        Some(error) => {
            let found = error.message().replace('\n', " ");
            Err(TextError { line: line_of(text, error.span()), found, expected: "TOML".to_owned() })
        }
        None => Ok(document),
    }
}

/// The tables of a document, by name, each in the order of the file.
pub(crate) fn items<'a>(
    text: &'a str,
    document: &'a Spanned<DeTable<'a>>,
    schema: &'a Schema,
) -> Result<BTreeMap<&'static str, Vec<Item<'a>>>, TextError> {
    let reader = Reader { text, single: schema.single };
    let mut items = BTreeMap::new();
    for (name, value) in document.get_ref() {
        let known = schema.tables.iter().find(|(table, _)| table == name.get_ref());
        let (table, keys) = known.ok_or_else(|| {
            reader.unknown("table", name.get_ref(), &name.span(), schema.tables.iter().map(|(table, _)| *table))
        })?;
        items.insert(*table, reader.items(table, keys, value)?);
    }
    Ok(items)
}

struct Reader<'a> {
    text: &'a str,
    single: Option<&'static str>,
}

/// One table, its keys known.
pub(crate) struct Item<'a> {
    text: &'a str,
    table: &'static str,
    span: Range<usize>,
    fields: BTreeMap<&'a str, &'a Spanned<DeValue<'a>>>,
}

impl<'a> Reader<'a> {
    /// The tables of one name.
    fn items(
        &self,
        table: &'static str,
        keys: &[&'static str],
        value: &'a Spanned<DeValue<'a>>,
    ) -> Result<Vec<Item<'a>>, TextError> {
        match value.get_ref() {
            DeValue::Table(fields) if Some(table) == self.single => {
                Ok(vec![self.item(table, keys, &value.span(), fields)?])
            }
            DeValue::Array(items) if Some(table) != self.single => items
                .iter()
                .map(|item| match item.get_ref() {
                    DeValue::Table(fields) => self.item(table, keys, &item.span(), fields),
                    _ => Err(self.not_tables(table, &item.span())),
                })
                .collect(),
            _ => Err(self.not_tables(table, &value.span())),
        }
    }

    fn item(
        &self,
        table: &'static str,
        keys: &[&'static str],
        span: &Range<usize>,
        fields: &'a DeTable<'a>,
    ) -> Result<Item<'a>, TextError> {
        let mut known = BTreeMap::new();
        for (name, value) in fields {
            if !keys.iter().any(|key| key.trim_end_matches('?') == name.get_ref()) {
                let names = keys.iter().map(|key| key.trim_end_matches('?'));
                return Err(self.unknown("key", name.get_ref(), &name.span(), names));
            }
            known.insert(name.get_ref().as_ref(), value);
        }
        let item = Item { text: self.text, table, span: span.clone(), fields: known };
        match keys.iter().find(|key| !key.ends_with('?') && !item.fields.contains_key(**key)) {
            Some(missing) => Err(TextError {
                line: line_of(self.text, Some(span.clone())),
                found: format!("a {table} without {missing}"),
                expected: format!("{table} with {}", keys.join(", ")),
            }),
            None => Ok(item),
        }
    }

    fn unknown<'k>(
        &self,
        what: &str,
        name: &str,
        span: &Range<usize>,
        known: impl Iterator<Item = &'k str> + Clone,
    ) -> TextError {
        let mut expected = known.clone().collect::<Vec<_>>().join(", ");
        if let Some(near) = near_word(name, known) {
            expected += &format!("; did you mean {near}?");
        }
        TextError {
            line: line_of(self.text, Some(span.clone())),
            found: format!("unknown {what} {}", quoted(name)),
            expected,
        }
    }

    fn not_tables(&self, table: &str, span: &Range<usize>) -> TextError {
        let expected =
            if Some(table) == self.single { format!("one table [{table}]") } else { format!("tables [[{table}]]") };
        TextError { line: line_of(self.text, Some(span.clone())), found: format!("{table} is none"), expected }
    }
}

impl Item<'_> {
    /// Whether a key is there.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.fields.contains_key(key)
    }

    /// The line it begins in, counted from 1.
    pub(crate) fn line(&self) -> usize {
        line_of(self.text, Some(self.span.clone()))
    }

    /// The value of a key, or the table if it has none, is not what it should be.
    pub(crate) fn wrong(&self, key: &str, expected: &str) -> TextError {
        let span = self.fields.get(key).map_or(self.span.clone(), |value| value.span());
        let found =
            format!("{} of {} is {}", key, self.table, shortened(self.text.get(span.clone()).unwrap_or_default()));
        TextError { line: line_of(self.text, Some(span)), found, expected: expected.to_owned() }
    }

    /// Two finite numbers.
    pub(crate) fn pair(&self, key: &str, expected: &'static str) -> Result<[f64; 2], TextError> {
        self.fields.get(key).and_then(|value| pair(value.get_ref())).ok_or_else(|| self.wrong(key, expected))
    }

    /// A list of pairs of finite numbers.
    pub(crate) fn pairs(&self, key: &str, expected: &'static str) -> Result<Vec<[f64; 2]>, TextError> {
        let pairs = match self.fields.get(key).map(|value| value.get_ref()) {
            Some(DeValue::Array(items)) => items.iter().map(|item| pair(item.get_ref())).collect(),
            _ => None,
        };
        pairs.ok_or_else(|| self.wrong(key, expected))
    }

    /// A finite number, if the key is there.
    pub(crate) fn number(&self, key: &str, expected: &'static str) -> Result<Option<f64>, TextError> {
        let value = self.fields.get(key).map(|value| number(value.get_ref()).ok_or_else(|| self.wrong(key, expected)));
        value.transpose()
    }

    /// A text that is not blank.
    pub(crate) fn text(&self, key: &str) -> Result<String, TextError> {
        match self.fields.get(key).map(|value| value.get_ref()) {
            Some(DeValue::String(text)) if !text.trim().is_empty() => Ok(text.to_string()),
            _ => Err(self.wrong(key, "a text in quotes")),
        }
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    let number: f64 = match value {
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix()).ok()? as f64,
        DeValue::Float(float) => float.as_str().parse().ok()?,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

fn pair(value: &DeValue<'_>) -> Option<[f64; 2]> {
    match value {
        DeValue::Array(items) if items.len() == 2 => {
            Some([number(items.first()?.get_ref())?, number(items.get(1)?.get_ref())?])
        }
        _ => None,
    }
}
