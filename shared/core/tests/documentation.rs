//! docs/model.md is read by people who set parameters: its tables must have every key, with the defaults of the code.

#![allow(clippy::unwrap_used, clippy::panic)] // a test that can not go on has failed

use std::collections::BTreeMap;

use echogrid_core::{LocalizationConfig, MapperConfig, OdometryConfig};
use serde::Serialize;
use toml::Value;

const DOCUMENTATION: &str = include_str!("../../../docs/model.md");

/// Unit and default of every key in the table of a section, and what it says of its effect.
fn documented(section: &str) -> BTreeMap<String, [String; 3]> {
    let heading = format!("### `[{section}]`\n");
    let table = DOCUMENTATION.split(&heading).nth(1).unwrap_or_else(|| panic!("no {heading}"));
    let rows = table.lines().skip_while(|line| !line.starts_with("| `")).take_while(|line| line.starts_with("| `"));
    rows.map(|row| {
        let columns: Vec<&str> = row.trim_matches('|').splitn(4, '|').map(str::trim).collect();
        let [key, unit, default, effect] = columns.as_slice() else { panic!("{row}") };
        (key.trim_matches('`').to_owned(), [*unit, default.trim_matches('`'), *effect].map(str::to_owned))
    })
    .collect()
}

/// Written with fewer digits, a number is still the same.
fn same(told: &Value, real: &Value) -> bool {
    match (told, real) {
        (Value::Float(told), Value::Float(real)) => (told - real).abs() <= 1e-3 * real.abs(),
        _ => told == real,
    }
}

fn check(section: &str, defaults: impl Serialize) {
    let mut documented = documented(section);
    let Value::Table(defaults) = Value::try_from(defaults).unwrap() else { panic!("{section} is no table") };
    for (key, real) in defaults {
        let row = documented.remove(&key);
        let [unit, default, effect] = row.unwrap_or_else(|| panic!("docs/model.md: no row of {section}.{key}"));
        let told = toml::from_str::<toml::Table>(&format!("v = {default}"));
        let told = told.unwrap_or_else(|error| panic!("docs/model.md: {section}.{key}: {error}"));
        assert!(same(&told["v"], &real), "docs/model.md: {section}.{key} = {default}: the default is {real}");
        let suffix = ["m", "rad", "s"].into_iter().find(|unit| key.ends_with(&format!("_{unit}")));
        assert!(suffix.is_none_or(|suffix| suffix == unit), "docs/model.md: {section}.{key}: unit {unit}");
        assert!(!effect.is_empty(), "docs/model.md: {section}.{key}: no effect");
    }
    assert!(documented.is_empty(), "docs/model.md: {section} has no {:?}", documented.keys());
}

#[test]
fn every_key_has_its_row_with_its_unit_and_default() {
    check("odometry", OdometryConfig::default());
    check("localization", LocalizationConfig::default());
    check("mapper", MapperConfig::default());
}

#[test]
fn pictures_are_there() {
    let pictures: Vec<&str> =
        DOCUMENTATION.split("](images/").skip(1).filter_map(|rest| rest.split(')').next()).collect();
    assert!(pictures.len() >= 3, "{pictures:?}");
    for picture in pictures {
        let file = format!("{}/../../docs/images/{picture}", env!("CARGO_MANIFEST_DIR"));
        assert!(std::fs::read(&file).is_ok_and(|bytes| bytes.starts_with(b"\x89PNG")), "{file}");
    }
}
