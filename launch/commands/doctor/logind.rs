//! systemd-logind removes the shared memory of a user who logs out (`RemoveIPC`), under a graph that still runs.

use std::fs;
use std::path::{Path, PathBuf};

use echogrid_topics::domain::User;

use super::finding::Finding;

const CHECK: &str = "log-out";
/// Users below are the system's; logind leaves them alone.
const FIRST_USER: u32 = 1000;

/// What logind would do.
#[derive(Debug)]
pub(super) struct Facts {
    user: User,
    systemd_runs: bool,
    removes: bool,
    /// Whether the user counts as logged in for ever.
    lingers: bool,
}

impl Facts {
    pub(super) fn gather() -> Self {
        let user = User::current();
        let linger = user.name.as_ref().map(|name| Path::new("/var/lib/systemd/linger").join(name));
        Self {
            systemd_runs: Path::new("/run/systemd/system").exists(),
            removes: removes(configuration().iter().filter_map(|file| fs::read_to_string(file).ok())),
            lingers: linger.is_some_and(|path| path.exists()),
            user,
        }
    }

    pub(super) fn judge(&self) -> Finding {
        let Self { user, systemd_runs, removes, lingers } = self;
        if !systemd_runs {
            return Finding::ok(CHECK, "systemd does not run: nobody removes shared memory");
        }
        if user.uid < FIRST_USER || !removes || *lingers {
            return Finding::ok(CHECK, format!("logging out leaves the shared memory of {user} alone"));
        }
        let name = user.name.as_deref().unwrap_or("$USER");
        Finding::warning(
            CHECK,
            format!("when {user} logs out, systemd-logind removes the shared memory of running graphs (RemoveIPC=yes)"),
            format!("sudo loginctl enable-linger {name}, or RemoveIPC=no in /etc/systemd/logind.conf"),
        )
    }
}

/// logind's files, the one that has the last word last.
fn configuration() -> Vec<PathBuf> {
    let mut drop_ins: Vec<PathBuf> = ["/usr/lib/systemd", "/run/systemd", "/etc/systemd"]
        .iter()
        .flat_map(|folder| fs::read_dir(Path::new(folder).join("logind.conf.d")).into_iter().flatten().flatten())
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "conf"))
        .collect();
    drop_ins.sort_by(|a, b| a.file_name().cmp(&b.file_name()));
    drop_ins.insert(0, "/etc/systemd/logind.conf".into());
    drop_ins
}

/// The last `RemoveIPC`; it is on where nobody says.
fn removes(files: impl Iterator<Item = String>) -> bool {
    let says = |line: &str| {
        let (key, value) = line.split_once('=')?;
        (key.trim() == "RemoveIPC").then(|| value.trim().to_ascii_lowercase())
    };
    let last = files.filter_map(|text| text.lines().filter_map(says).next_back()).last();
    last.is_none_or(|value| !["no", "false", "off", "0", "n", "f"].contains(&value.as_str()))
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn the_last_word_counts() {
        let check = |files: &[&str], expected| {
            assert_eq!(removes(files.iter().map(|text| (*text).to_owned())), expected, "{files:?}");
        };
        check(&[], true);
        check(&["[Login]\n#RemoveIPC=no\n"], true);
        check(&["[Login]\nRemoveIPC=no\n"], false);
        check(&["[Login]\nRemoveIPC=no\n", "[Login]\nKillUserProcesses=no\n"], false);
        check(&["[Login]\nRemoveIPC=no\nRemoveIPC = yes\n"], true);
    }

    #[test]
    fn only_who_logs_out_is_warned() {
        let judge = |uid, systemd_runs, removes, lingers| {
            let user = User { uid, name: Some("robot".into()) };
            Facts { user, systemd_runs, removes, lingers }.judge()
        };
        let warned = judge(1000, true, true, false);
        assert_eq!(warned.verdict, Verdict::Warning);
        assert!(warned.mend.as_ref().unwrap().contains("enable-linger robot"), "{warned}");
        for fine in
            [(0, true, true, false), (1000, false, true, false), (1000, true, false, false), (1000, true, true, true)]
        {
            assert_eq!(judge(fine.0, fine.1, fine.2, fine.3).verdict, Verdict::Ok, "{fine:?}");
        }
    }
}
