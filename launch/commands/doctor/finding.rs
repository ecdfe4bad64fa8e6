//! What a check found.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Verdict {
    /// As it should be.
    Ok,
    /// A graph runs; something may surprise.
    Warning,
    /// A graph would fail.
    Problem,
}

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Finding {
    pub(super) check: &'static str,
    pub(super) verdict: Verdict,
    pub(super) text: String,
    /// The command that mends it, or what else to do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mend: Option<String>,
    /// What was measured and what was asked for; units are in the names.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) figures: BTreeMap<&'static str, u64>,
}

impl Finding {
    fn new(check: &'static str, verdict: Verdict, text: String, mend: Option<String>) -> Self {
        Self { check, verdict, text, mend, figures: BTreeMap::new() }
    }

    pub(super) fn ok(check: &'static str, text: impl Into<String>) -> Self {
        Self::new(check, Verdict::Ok, text.into(), None)
    }

    pub(super) fn warning(check: &'static str, text: impl Into<String>, mend: impl Into<String>) -> Self {
        Self::new(check, Verdict::Warning, text.into(), Some(mend.into()))
    }

    pub(super) fn problem(check: &'static str, text: impl Into<String>, mend: impl Into<String>) -> Self {
        Self::new(check, Verdict::Problem, text.into(), Some(mend.into()))
    }

    pub(super) fn with(mut self, figures: impl IntoIterator<Item = (&'static str, u64)>) -> Self {
        self.figures.extend(figures);
        self
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match self.verdict {
            Verdict::Ok => "ok",
            Verdict::Warning => "warning",
            Verdict::Problem => "PROBLEM",
        };
        writeln!(f, "{verdict:<8} {:<14} {}", self.check, self.text)?;
        self.mend.as_ref().map_or(Ok(()), |mend| writeln!(f, "{:<8} mend:          {mend}", ""))
    }
}

/// Bytes as people read them: KiB below one MiB, whole MiB above.
pub(super) fn size(bytes: u64) -> String {
    if bytes < 1 << 20 { format!("{} KiB", bytes >> 10) } else { format!("{} MiB", bytes >> 20) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finding_says_what_mends_it() {
        let text = Finding::problem("disk", "3 MiB free", "free some").to_string();
        assert_eq!(text, "PROBLEM  disk           3 MiB free\n         mend:          free some\n");
        assert_eq!(Finding::ok("disk", "fine").to_string(), "ok       disk           fine\n");
    }
}
