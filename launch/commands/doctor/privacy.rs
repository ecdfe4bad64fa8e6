//! What graphs of this user keep in shared memory is for this user alone.

use echogrid_topics::domain::{Exposed, User, base_of, exposed};

use super::finding::Finding;

const CHECK: &str = "privacy";

/// What others can get at.
pub(super) struct Facts {
    me: User,
    exposed: Vec<Exposed>,
}

impl Facts {
    pub(super) fn gather() -> Self {
        let me = User::current();
        Self { exposed: exposed(me.uid), me }
    }

    pub(super) fn judge(&self) -> Finding {
        let base = base_of(self.me.uid);
        let count = self.exposed.len() as u64;
        let finding = if let Some(foreign) = self.exposed.iter().find(|exposed| exposed.owner != self.me.uid) {
            // No graph of ours could start there, or it would write where another reads.
            let path = foreign.path.display();
            let text = format!("{path} is named like ours and belongs to {}", User::of(foreign.owner));
            Finding::problem(CHECK, text, format!("sudo rm -r {path}"))
        } else if let Some(first) = self.exposed.first() {
            let more = if count > 1 { format!(" and {} more", count - 1) } else { String::new() };
            let path = first.path.display();
            let text = format!("others can get at {path}{more} (mode {:04o})", first.mode);
            let paths: Vec<String> = self.exposed.iter().map(|exposed| exposed.path.display().to_string()).collect();
            Finding::warning(CHECK, text, format!("chmod go= {}", paths.join(" ")))
        } else {
            Finding::ok(CHECK, format!("only {} can get at {} and its shared memory", self.me, base.display()))
        };
        finding.with([("exposed", count)])
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn what_others_can_get_at() {
        let judge =
            |exposed: Vec<Exposed>| Facts { me: User { uid: 1000, name: Some("robot".into()) }, exposed }.judge();
        assert_eq!(judge(Vec::new()).verdict, Verdict::Ok);
        let open = Exposed { path: "/dev/shm/eg1000_lab_x.data".into(), owner: 1000, mode: 0o666 };
        let finding = judge(vec![open.clone()]);
        assert_eq!(finding.verdict, Verdict::Warning);
        assert_eq!(finding.mend.as_deref(), Some("chmod go= /dev/shm/eg1000_lab_x.data"));
        assert!(finding.text.contains("0666"), "{finding}");
        let foreign = Exposed { path: "/dev/shm/echogrid-1000".into(), owner: 1001, mode: 0o700 };
        assert_eq!(judge(vec![open, foreign]).verdict, Verdict::Problem);
    }
}
