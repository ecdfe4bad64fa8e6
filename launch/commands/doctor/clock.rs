//! Clocks: sensors stamp what they read with one that never jumps; the wall clock dates files.

use std::fs;
use std::time::{Duration, Instant, SystemTime};

use nix::libc;

use super::finding::Finding;

const CHECK: &str = "clock";
/// 2025 began. No machine that runs this was set before it.
const BUILT_AFTER_S: u64 = 1_735_689_600;
/// Sources that a process reads without asking the kernel.
const FAST: [&str; 4] = ["tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"];
const SOURCES: &str = "/sys/devices/system/clocksource/clocksource0";

/// What the clocks say.
#[derive(Debug, Clone)]
pub(super) struct Facts {
    /// None before 1970.
    wall: Option<Duration>,
    goes_backwards: bool,
    source: Option<String>,
    available: String,
    /// None where the kernel does not tell.
    synchronised: Option<bool>,
}

impl Facts {
    pub(super) fn gather() -> Self {
        let read = |name| fs::read_to_string(format!("{SOURCES}/{name}")).ok().map(|text| text.trim().to_owned());
        let stamps: Vec<Instant> = (0..1000).map(|_| Instant::now()).collect();
        Self {
            wall: SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).ok(),
            goes_backwards: !stamps.is_sorted(),
            source: read("current_clocksource"),
            available: read("available_clocksource").unwrap_or_default(),
            synchronised: synchronised(),
        }
    }

    pub(super) fn judge(&self) -> Finding {
        if self.goes_backwards {
            let mend = format!("choose another clock source: cat {SOURCES}/available_clocksource");
            return Finding::problem(CHECK, "the monotonic clock runs backwards", mend);
        }
        let set = self.wall.is_some_and(|wall| wall.as_secs() >= BUILT_AFTER_S);
        if !set {
            let text = "the wall clock says that it is before 2025: files would be dated wrong";
            return Finding::problem(CHECK, text, "sudo timedatectl set-ntp true, or sudo date -s 'YYYY-MM-DD HH:MM'");
        }
        let synchronised = match self.synchronised {
            Some(true) => ", synchronised",
            // Stamps are the sensor's; only the dates of files depend on it.
            Some(false) => ", not synchronised (which only dates files)",
            None => "",
        };
        match self.source.as_deref() {
            Some(slow) if !FAST.contains(&slow) => {
                let fast = FAST.into_iter().find(|fast| self.available.split_whitespace().any(|name| name == *fast));
                let text = format!("source {slow}, which is slow to read{synchronised}");
                match fast {
                    Some(fast) => {
                        Finding::warning(CHECK, text, format!("echo {fast} | sudo tee {SOURCES}/current_clocksource"))
                    }
                    None => Finding::ok(CHECK, format!("{text}; the machine has no faster one")),
                }
            }
            Some(source) => Finding::ok(CHECK, format!("source {source}{synchronised}")),
            None => Finding::ok(CHECK, format!("set{synchronised}")),
        }
    }
}

/// Whether something keeps the wall clock right, as the kernel knows.
fn synchronised() -> Option<bool> {
    // SAFETY: numbers and padding only; all zero asks for nothing to be changed.
    let mut state: libc::timex = unsafe { core::mem::zeroed() };
    // SAFETY: the kernel writes into the structure that it is given.
    let code = unsafe { libc::adjtimex(&raw mut state) };
    (code >= 0).then_some(state.status & libc::STA_UNSYNC == 0)
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    fn good() -> Facts {
        Facts {
            wall: Some(Duration::from_secs(2 * BUILT_AFTER_S)),
            goes_backwards: false,
            source: Some("tsc".into()),
            available: "tsc hpet acpi_pm".into(),
            synchronised: Some(true),
        }
    }

    #[test]
    fn clocks() {
        let check = |facts: Facts, expected, word: &str| {
            let finding = facts.judge();
            assert_eq!(finding.verdict, expected, "{finding}");
            assert!(finding.to_string().contains(word), "no {word:?} in {finding}");
        };
        check(good(), Verdict::Ok, "source tsc, synchronised");
        check(Facts { synchronised: Some(false), ..good() }, Verdict::Ok, "not synchronised");
        check(Facts { synchronised: None, source: None, ..good() }, Verdict::Ok, "set\n");
        check(Facts { source: Some("hpet".into()), ..good() }, Verdict::Warning, "echo tsc");
        check(Facts { source: Some("hpet".into()), available: "hpet".into(), ..good() }, Verdict::Ok, "hpet");
        check(Facts { wall: Some(Duration::from_secs(86_400)), ..good() }, Verdict::Problem, "before 2025");
        check(Facts { wall: None, ..good() }, Verdict::Problem, "before 2025");
        check(Facts { goes_backwards: true, ..good() }, Verdict::Problem, "backwards");
    }
}
