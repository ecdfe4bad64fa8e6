//! `echogrid doctor`: is this machine fit to run a graph?
//!
//! Each check gathers facts, which touches the machine, and judges them, which does not: the tests judge facts that they make up.

mod clock;
mod finding;
mod graphs;
mod limits;
mod logind;
mod memory;
mod need;
mod output;
mod privacy;
mod serial;
mod user;

use anyhow::{Result, bail};
use echogrid_formats::log::LogSurvey;
use serde::Serialize;

use crate::config::{Config, LoadRequest};
use finding::{Finding, Verdict};
use need::Need;

/// What was found.
#[derive(Debug, Serialize)]
struct Report {
    fit: bool,
    findings: Vec<Finding>,
}

/// Looks at the machine for the graph that was asked for, and prints what was found.
///
/// # Errors
/// The configuration is wrong, or the machine is not fit.
pub(super) fn run(asked: LoadRequest, clean: bool, json: bool) -> Result<()> {
    let request = if asked.graph.is_none() && asked.sensor.is_none() { asked.for_demo() } else { asked };
    let config = Config::load(&request)?.into_config();
    let findings = examine(&config, clean);
    let problems: Vec<&str> =
        findings.iter().filter(|finding| finding.verdict == Verdict::Problem).map(|finding| finding.check).collect();
    let said = match problems.len() {
        0 => None,
        1 => Some(format!("not fit: a problem with {}", problems.join(", "))),
        several => Some(format!("not fit: {several} problems ({})", problems.join(", "))),
    };
    let report = Report { fit: said.is_none(), findings };
    super::print(&if json {
        echogrid_instruments::json(&report)?
    } else {
        report.findings.iter().map(ToString::to_string).collect()
    })?;
    said.map_or(Ok(()), |said| bail!(said))
}

/// A process that can't map what it needs may die without a word, so that is looked at before anything is started.
pub(super) fn require_addresses(config: &Config, survey: Option<&LogSurvey>) -> Result<()> {
    let need = Need::for_scans(config.max_readings(survey), config);
    match limits::Facts::gather().too_few_addresses(&need) {
        Some(finding) => bail!("{}: {} (`echogrid doctor` says what mends it)", finding.check, finding.text),
        None => Ok(()),
    }
}

/// What of this machine may be to blame for a graph that failed: shared memory and limits that are less than it can need.
pub(super) fn blame(config: &Config, survey: Option<&LogSurvey>) -> Option<String> {
    let need = Need::for_scans(config.max_readings(survey), config);
    let findings = memory::Facts::gather().judge(&need).into_iter().chain(limits::Facts::gather().judge(&need));
    let problems: Vec<String> = findings
        .filter(|finding| finding.verdict == Verdict::Problem)
        .map(|finding| format!("{}: {}", finding.check, finding.text))
        .collect();
    (!problems.is_empty()).then(|| format!("`echogrid doctor` finds a problem with {}", problems.join("; ")))
}

fn examine(config: &Config, clean: bool) -> Vec<Finding> {
    // Before memory is measured.
    let mut graphs = graphs::Facts::gather(config, clean).judge();
    let need = Need::of(config);
    let mut findings: Vec<Finding> = need.judge().into_iter().collect();
    findings.extend(memory::Facts::gather().judge(&need));
    findings.push(privacy::Facts::gather().judge());
    findings.append(&mut graphs);
    findings.extend(limits::Facts::gather().judge(&need));
    findings.push(logind::Facts::gather().judge());
    findings.push(clock::Facts::gather().judge());
    findings.extend(serial::Facts::gather(config).judge());
    findings.push(output::Facts::gather(&config.run.out).judge());
    findings.push(user::judge(&echogrid_topics::domain::User::current()));
    findings
}
