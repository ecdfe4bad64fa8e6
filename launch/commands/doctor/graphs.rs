//! The graphs of this machine: those that run, those that died and left something, those of other users.

use std::collections::{BTreeMap, BTreeSet};

use echogrid_topics::domain::{self, Leftover, Running, User};

use super::finding::{Finding, size};
use crate::config::{self, Config};

/// What there is.
#[derive(Debug, Default)]
pub(super) struct Facts {
    running: Vec<Running>,
    left: Vec<Leftover>,
    /// What was just removed.
    cleaned: Vec<Leftover>,
    others: BTreeMap<User, BTreeSet<String>>,
    /// The domain that the graph is to run in, if it was named.
    wanted: Option<String>,
}

impl Facts {
    pub(super) fn gather(config: &Config, clean: bool) -> Self {
        let cleaned = if clean { domain::clean() } else { Vec::new() };
        let wanted = match &config.run.domain {
            config::Domain::Auto => None,
            config::Domain::Named(name) => Some(name.clone()),
        };
        Self { cleaned, running: domain::graphs(), left: domain::leftovers(), others: domain::others(), wanted }
    }

    pub(super) fn judge(&self) -> Vec<Finding> {
        [Some(self.running()), Some(self.left()), self.others()].into_iter().flatten().collect()
    }

    fn running(&self) -> Finding {
        let names: Vec<String> = self.running.iter().map(with_launcher).collect();
        let figures = [("running", self.running.len() as u64)];
        let wanted = self.running.iter().find(|graph| Some(&graph.name) == self.wanted.as_ref());
        if let Some(graph) = wanted {
            let text = format!("{} runs already: no other can start in that domain", with_launcher(graph));
            let stop = graph.launcher.map(|pid| format!("kill -INT {pid}, or ")).unwrap_or_default();
            return Finding::warning("running", text, format!("{stop}choose another --domain")).with(figures);
        }
        let text = if names.is_empty() { "no graph of this user".into() } else { names.join(", ") };
        Finding::ok("running", text).with(figures)
    }

    fn left(&self) -> Finding {
        let figures = [("domains", self.left.len() as u64), ("bytes", self.left.iter().map(|left| left.bytes).sum())];
        let finding = if self.left.is_empty() {
            let done = if self.cleaned.is_empty() { "of dead graphs: nothing".into() } else { removed(&self.cleaned) };
            Finding::ok("leftovers", done)
        } else {
            let text = format!("of dead graphs: {} (the next start removes them)", listed(&self.left));
            Finding::warning("leftovers", text, "echogrid doctor --clean")
        };
        finding.with(figures)
    }

    fn others(&self) -> Option<Finding> {
        let users: Vec<String> = self
            .others
            .iter()
            .map(|(user, domains)| format!("{} of {user}", domains.iter().cloned().collect::<Vec<_>>().join(", ")))
            .collect();
        let text = format!("{}: theirs alone, apart from yours", users.join("; "));
        (!users.is_empty()).then(|| Finding::ok("other users", text).with([("users", users.len() as u64)]))
    }
}

fn with_launcher(graph: &Running) -> String {
    graph.launcher.map_or_else(|| graph.name.clone(), |pid| format!("{} (launcher: process {pid})", graph.name))
}

fn removed(cleaned: &[Leftover]) -> String {
    format!("removed {}", listed(cleaned))
}

fn listed(left: &[Leftover]) -> String {
    let each = |left: &Leftover| format!("{} ({} files, {})", left.name, left.files, size(left.bytes));
    left.iter().map(each).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    fn lab() -> Leftover {
        Leftover { name: "lab".into(), files: 390, bytes: 1600 << 10 }
    }

    #[test]
    fn an_empty_machine_is_fine() {
        let findings = Facts::default().judge();
        assert!(findings.iter().all(|finding| finding.verdict == Verdict::Ok));
        assert_eq!(findings.len(), 2);
    }

    #[test]
    fn leftovers_are_listed_until_they_are_removed() {
        let finding = Facts { left: vec![lab()], ..Facts::default() }.left();
        assert_eq!(finding.verdict, Verdict::Warning);
        assert!(finding.text.contains("lab (390 files, 1 MiB)"), "{finding}");
        let finding = Facts { cleaned: vec![lab()], ..Facts::default() }.left();
        assert_eq!(finding.verdict, Verdict::Ok);
        assert!(finding.text.starts_with("removed lab"), "{finding}");
    }

    #[test]
    fn a_graph_that_runs_is_in_the_way_only_of_its_own_domain() {
        let running = vec![Running { name: "lab".into(), launcher: Some(17) }];
        let facts = Facts { running, ..Facts::default() };
        assert_eq!(facts.running().verdict, Verdict::Ok);
        let finding = Facts { wanted: Some("lab".into()), ..facts }.running();
        assert_eq!(finding.verdict, Verdict::Warning);
        assert!(finding.mend.as_ref().unwrap().contains("kill -INT 17"), "{finding}");
    }

    #[test]
    fn other_users_are_named() {
        let user = User { uid: 1001, name: Some("ann".into()) };
        let others = BTreeMap::from([(user, BTreeSet::from(["lab".to_owned(), "yard".to_owned()]))]);
        let finding = Facts { others, ..Facts::default() }.others().unwrap();
        assert!(finding.text.contains("lab, yard of user 1001 (ann)"), "{finding}");
    }
}
