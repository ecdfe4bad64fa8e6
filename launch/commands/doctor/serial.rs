//! Serial ports: those that the graph names, and those that there are. None is opened: opening can reset what is behind it.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

use nix::unistd::{AccessFlags, Gid, Group, access};

use super::finding::Finding;
use crate::config::Config;

const CHECK: &str = "serial ports";

/// A port.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Port {
    path: PathBuf,
    /// Whether the graph asks for it.
    named: bool,
    state: State,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum State {
    Missing,
    NoDevice,
    /// The group that may open it.
    Closed(String),
    Open,
}

/// What there is.
pub(super) struct Facts(Vec<Port>);

impl Facts {
    pub(super) fn gather(config: &Config) -> Self {
        let services = config.services.values();
        let words = services.flat_map(|service| service.args.iter().chain(service.env.values()));
        let named: BTreeSet<PathBuf> = words.filter_map(|word| device(word)).collect();
        let robot = config.drives_pioneer().then(|| device(&config.pioneer.port)).flatten();
        let named: BTreeSet<PathBuf> = named.into_iter().chain(robot).collect();
        let found = fs::read_dir("/dev").into_iter().flatten().flatten().map(|entry| entry.path());
        let found: BTreeSet<PathBuf> = found.filter(|path| is_serial(path) && !named.contains(path)).collect();
        let port = |path: PathBuf, named| Port { state: look(&path), path, named };
        let named = named.into_iter().map(|path| port(path, true));
        Self(named.chain(found.into_iter().map(|path| port(path, false))).collect())
    }

    pub(super) fn judge(&self) -> Vec<Finding> {
        let (named, found): (Vec<&Port>, Vec<&Port>) = self.0.iter().partition(|port| port.named);
        let mut findings: Vec<Finding> = named.iter().map(|port| port.judge()).collect();
        let seen: Vec<String> = found.iter().map(|port| port.describe()).collect();
        if !seen.is_empty() {
            findings.push(Finding::ok(CHECK, seen.join(", ")).with([("found", seen.len() as u64)]));
        } else if named.is_empty() {
            findings.push(Finding::ok(CHECK, "none, and the graph names none"));
        }
        findings
    }
}

impl Port {
    /// Of one that the graph asks for.
    fn judge(&self) -> Finding {
        let path = self.path.display();
        let text = format!("{path}, which the graph names, {}", self.state.describe());
        match &self.state {
            State::Open => Finding::ok(CHECK, text),
            State::Missing => Finding::problem(CHECK, text, "plug it in, or name another: ls /dev/serial/by-id"),
            State::NoDevice => Finding::problem(CHECK, text, "name another: ls /dev/serial/by-id"),
            State::Closed(group) if group == "root" => {
                Finding::problem(CHECK, text, format!("sudo chgrp dialout {path}"))
            }
            State::Closed(group) => {
                Finding::problem(CHECK, text, format!("sudo usermod -aG {group} $USER, then log in again"))
            }
        }
    }

    fn describe(&self) -> String {
        format!("{} {}", self.path.display(), self.state.describe())
    }
}

impl State {
    fn describe(&self) -> String {
        match self {
            Self::Missing => "is not there".into(),
            Self::NoDevice => "is no character device".into(),
            Self::Closed(group) => format!("may be opened by group {group} only"),
            Self::Open => "may be opened".into(),
        }
    }
}

/// A device in an argument of a service: `/dev/ttyUSB0`, `--port=/dev/ttyUSB0`.
fn device(word: &str) -> Option<PathBuf> {
    let path = Path::new(&word[word.find("/dev/")?..]);
    let is_port = is_serial(path) || path.starts_with("/dev/serial");
    is_port.then(|| path.to_owned())
}

/// Whether it is called like a serial port, and is more than a number in the kernel's table.
fn is_serial(path: &Path) -> bool {
    let Some(name) = path.file_name().and_then(|name| name.to_str()) else { return false };
    let numbered = |prefix| {
        let number = name.strip_prefix(prefix);
        number.is_some_and(|number: &str| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
    };
    // Type 0: nothing is behind it.
    let is_there = || fs::read_to_string(format!("/sys/class/tty/{name}/type")).is_ok_and(|kind| kind.trim() != "0");
    numbered("ttyUSB") || numbered("ttyACM") || (numbered("ttyS") && is_there())
}

fn look(path: &Path) -> State {
    match fs::metadata(path) {
        Err(_) => State::Missing,
        Ok(meta) if !meta.file_type().is_char_device() => State::NoDevice,
        Ok(_) if access(path, AccessFlags::R_OK | AccessFlags::W_OK).is_ok() => State::Open,
        Ok(meta) => {
            let group = Group::from_gid(Gid::from_raw(meta.gid())).ok().flatten();
            State::Closed(group.map_or_else(|| meta.gid().to_string(), |group| group.name))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    fn port(named: bool, state: State) -> Port {
        Port { path: "/dev/ttyUSB0".into(), named, state }
    }

    #[test]
    fn ports_are_found_in_arguments() {
        assert_eq!(device("/dev/ttyUSB0"), Some("/dev/ttyUSB0".into()));
        assert_eq!(device("--port=/dev/ttyACM1"), Some("/dev/ttyACM1".into()));
        assert_eq!(device("/dev/serial/by-id/usb-x"), Some("/dev/serial/by-id/usb-x".into()));
        for other in ["", "/dev/null", "ttyUSB0", "/dev/ttyUSB", "/dev/ttyUSBx"] {
            assert_eq!(device(other), None, "{other}");
        }
    }

    #[test]
    fn a_port_that_the_graph_names_must_open() {
        let check = |state, expected, word: &str| {
            let finding = Facts(vec![port(true, state)]).judge().remove(0);
            assert_eq!(finding.verdict, expected, "{finding}");
            assert!(finding.to_string().contains(word), "no {word:?} in {finding}");
        };
        check(State::Open, Verdict::Ok, "may be opened");
        check(State::Missing, Verdict::Problem, "plug it in");
        check(State::NoDevice, Verdict::Problem, "character device");
        check(State::Closed("dialout".into()), Verdict::Problem, "sudo usermod -aG dialout $USER");
    }

    #[test]
    fn others_are_listed() {
        let findings = Facts(vec![port(false, State::Closed("dialout".into()))]).judge();
        assert_eq!(findings[0].verdict, Verdict::Ok);
        assert!(findings[0].text.contains("/dev/ttyUSB0 may be opened by group dialout only"), "{}", findings[0]);
        assert_eq!(Facts(Vec::new()).judge().len(), 1);
    }

    #[test]
    fn what_is_at_a_path() {
        assert_eq!(look(Path::new("/dev/null")), State::Open);
        assert_eq!(look(Path::new("/dev")), State::NoDevice);
        assert_eq!(look(Path::new("/dev/ttyUSB999")), State::Missing);
    }
}
