//! Values: what they are, and why one was refused.

use toml::Value;
use toml::de::DeValue;

use super::schema::Key;
use super::suggest;

/// The longest value that a message repeats.
const SHOWN_CHARS_MAX: usize = 60;

/// The value without where it stood; every number in it finite.
pub(crate) fn plain(value: &DeValue<'_>) -> Result<Value, String> {
    Ok(match value {
        DeValue::String(text) => Value::String(text.clone().into_owned()),
        DeValue::Integer(integer) => {
            let parsed = i64::from_str_radix(integer.as_str(), integer.radix());
            Value::Integer(parsed.map_err(|_| format!("{integer} is too large"))?)
        }
        DeValue::Float(float) => {
            let parsed = float.as_str().parse().ok().filter(|f: &f64| f.is_finite());
            Value::Float(parsed.ok_or_else(|| format!("{float} is not a finite number"))?)
        }
        DeValue::Boolean(boolean) => Value::Boolean(*boolean),
        DeValue::Datetime(datetime) => Value::Datetime(*datetime),
        DeValue::Array(items) => {
            Value::Array(items.iter().map(|item| plain(item.get_ref())).collect::<Result<_, _>>()?)
        }
        DeValue::Table(table) => Value::Table(
            table
                .iter()
                .map(|(name, value)| Ok((name.get_ref().clone().into_owned(), plain(value.get_ref())?)))
                .collect::<Result<_, String>>()?,
        ),
    })
}

/// What a value is, in words.
pub(crate) fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a string",
        DeValue::Integer(_) | DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

/// The value as a message repeats it: on one line, shortened.
pub(crate) fn shown(value: &Value) -> String {
    let text = match value {
        Value::String(text) => format!("{text:?}"),
        Value::Table(_) => "{ … }".to_owned(),
        other => other.to_string(),
    };
    let text = text.replace('\n', " ");
    match text.char_indices().nth(SHOWN_CHARS_MAX) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

/// Why this value is not one for this key.
pub(crate) fn refusal(key: &Key, value: &Value) -> String {
    let expected = format!("expected {}", key.expected);
    let texts: Vec<&str> = match value {
        Value::String(text) => vec![text],
        Value::Array(items) => items.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    };
    let unknown = texts.iter().find(|text| !key.words.contains(text));
    if let Some(word) = unknown.and_then(|text| suggest::nearest(text, key.words.iter().copied())) {
        return format!("{expected}; did you mean \"{word}\"?");
    }
    if let Some(number) = texts.first().and_then(|text| suggest::number_in_unit(key.name, text)) {
        return format!("{expected}; write {} = {number}", key.name);
    }
    expected
}

/// Exact up to 2^53, which no limit comes near.
pub(crate) fn to_float(integer: i64) -> f64 {
    integer as f64
}
