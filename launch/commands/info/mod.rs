//! `echogrid info`: what a file is, and what is in it.

mod log;
mod maps;
mod texts;

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result, bail};
use echogrid_formats::kind::{Kind, kind_of};
use echogrid_formats::log::LogError;
use serde_json::{Map, Value, json};

/// What is told of a file: for people a line each, for programs by key.
#[derive(Default)]
struct Facts {
    /// What it is, in words.
    what: String,
    lines: Vec<(&'static str, String)>,
    values: Map<String, Value>,
}

impl Facts {
    fn new(what: impl Into<String>, kind: &str) -> Self {
        let mut facts = Self { what: what.into(), ..Self::default() };
        facts.value("kind", kind);
        facts
    }

    fn line(&mut self, name: &'static str, text: impl Into<String>) {
        self.lines.push((name, text.into()));
    }

    fn value(&mut self, key: &str, value: impl Into<Value>) {
        self.values.insert(key.to_owned(), value.into());
    }
}

/// Tells what a file is.
pub(super) fn run(file: &Path, as_json: bool) -> Result<()> {
    let mut facts = facts(file)?;
    if as_json {
        facts.value("file", json!(file));
        facts.value("bytes", file.metadata().map_or(0, |metadata| metadata.len()));
        let text = serde_json::to_string_pretty(&facts.values).context("the facts as JSON")?;
        return super::print(&(text + "\n"));
    }
    let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
    let mut text = format!("{name}: {}\n", facts.what);
    let mut before = "";
    for (name, line) in &facts.lines {
        let shown = if *name == before { "" } else { name };
        let _ = writeln!(text, "{shown:<11}{line}");
        before = name;
    }
    super::print(&text)
}

fn facts(file: &Path) -> Result<Facts> {
    match kind_of(file) {
        Ok(Kind::Log(_)) => log::facts(file),
        Ok(Kind::NativeMap) => maps::native(file),
        Ok(Kind::KeptReadings) => maps::readings(file),
        Ok(Kind::MapServer) => maps::map_server(file),
        Ok(Kind::MobileSimWorld) => texts::world(file, "world of MobileSim", "mobilesim-world"),
        Ok(Kind::Toml) => texts::toml(file),
        Ok(Kind::Foreign(foreign)) => {
            let mut facts = Facts::new(format!("{}, which echogrid does not read", foreign.name), "foreign");
            facts.line("to use it", foreign.advice);
            facts.value("name", foreign.name);
            facts.value("advice", foreign.advice);
            Ok(facts)
        }
        Ok(_) => bail!("{}: of a kind that nothing is told of", file.display()),
        Err(error @ (LogError::UnknownFormat { .. } | LogError::MissingPair { .. })) => {
            texts::other(file).map_or_else(|| Err(error.into()), Ok)
        }
        Err(error) => Err(error.into()),
    }
}

/// Nanoseconds since 1970 as a date and time, UTC.
fn date(stamp_ns: u64) -> String {
    let seconds = stamp_ns / 1_000_000_000;
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    // Years of 366 or 365 days from 1 March on, in eras of 400 years (H. Hinnant, chrono-compatible date algorithms).
    let day = days + 719_468;
    let (era, of_era) = (day / 146_097, day % 146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let of_month = of_year - (153 * month + 2) / 5 + 1;
    let (month, carry) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    let year = era * 400 + year + carry;
    format!("{year:04}-{month:02}-{of_month:02} {:02}:{:02}:{:02} UTC", rest / 3600, rest / 60 % 60, rest % 60)
}

/// A span of time for people.
fn span(seconds: f64) -> String {
    if seconds >= 120.0 {
        format!("{:.0} min {:02.0} s", (seconds / 60.0).floor(), seconds % 60.0)
    } else {
        format!("{seconds:.1} s")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_of_stamps() {
        let check = |seconds: u64, expected: &str| assert_eq!(date(seconds * 1_000_000_000), expected);
        check(0, "1970-01-01 00:00:00 UTC");
        check(951_782_399, "2000-02-28 23:59:59 UTC");
        check(951_868_800, "2000-03-01 00:00:00 UTC");
        check(1_709_164_800, "2024-02-29 00:00:00 UTC");
        check(1_735_689_599, "2024-12-31 23:59:59 UTC");
    }
}
