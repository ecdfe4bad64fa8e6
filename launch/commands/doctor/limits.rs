//! What one process may have.

use std::fs;
use std::path::{Path, PathBuf};

use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};

use super::finding::{Finding, size};
use super::need::Need;
use crate::limits::files_needed;

/// Memory maps of a process: a graph of five services has 120 at most.
const MAPS: u64 = 1024;
/// What processes need besides shared memory: a large map, and its files in the making.
const PRIVATE_BYTES: u64 = 256 << 20;

/// Addresses that a process reserves besides shared memory: code, stacks of its threads, a large map.
const ADDRESS_BYTES: u64 = 256 << 20;
/// The same for the smallest map. Measured: with a few MiB less processes die of a full stack.
const ADDRESS_BYTES_LEAST: u64 = 32 << 20;
/// The longest file of a large map.
const FILE_BYTES: u64 = 64 << 20;
/// The process and its threads.
const TASKS_PER_SERVICE: u64 = 4;

/// What is allowed.
#[derive(Debug, Default)]
pub(super) struct Facts {
    /// Open files, soft and hard limit.
    files: Option<(u64, u64)>,
    maps: Option<u64>,
    /// What the control groups of this process allow, the least of them.
    memory_bytes: Option<u64>,
    /// What a process may reserve, map or not (`ulimit -v`).
    address_bytes: Option<u64>,
    /// How long a file may become (`ulimit -f`); shared memory, too.
    file_bytes: Option<u64>,
    /// How many processes and threads this user may have (`ulimit -u`); none for root, whom it does not bind.
    tasks: Option<u64>,
}

impl Facts {
    pub(super) fn gather() -> Self {
        Self {
            files: getrlimit(Resource::RLIMIT_NOFILE).ok(),
            maps: number(Path::new("/proc/sys/vm/max_map_count")),
            memory_bytes: memory_limit(),
            address_bytes: soft_limit(Resource::RLIMIT_AS),
            file_bytes: soft_limit(Resource::RLIMIT_FSIZE),
            tasks: soft_limit(Resource::RLIMIT_NPROC).filter(|_| !nix::unistd::geteuid().is_root()),
        }
    }

    pub(super) fn judge(&self, need: &Need) -> Vec<Finding> {
        let tasks = TASKS_PER_SERVICE * (need.services + 1);
        let findings = [
            self.files(need),
            self.maps(),
            self.memory(need),
            self.addresses(need.shared_bytes + ADDRESS_BYTES),
            bytes(
                "file size",
                self.file_bytes,
                need.shared_bytes.max(FILE_BYTES),
                "ulimit -f unlimited, or LimitFSIZE=infinity in the systemd unit",
            ),
            self.tasks(tasks),
        ];
        findings.into_iter().flatten().collect()
    }

    /// Nothing, unless they are so few that no graph can run.
    pub(super) fn too_few_addresses(&self, need: &Need) -> Option<Finding> {
        self.addresses(need.shared_bytes + ADDRESS_BYTES_LEAST)
    }

    fn addresses(&self, needed: u64) -> Option<Finding> {
        let mend = "ulimit -v unlimited, or LimitAS=infinity in the systemd unit";
        bytes("address space", self.address_bytes, needed, mend)
    }

    fn files(&self, need: &Need) -> Option<Finding> {
        let (soft, hard) = self.files?;
        let needed = files_needed(need.services);
        let text = format!("{soft} per process, {needed} may be needed");
        let finding = if soft >= needed {
            Finding::ok("open files", text)
        } else if hard >= needed {
            Finding::ok("open files", format!("{text}: `echogrid up` and `map` allow themselves that many"))
        } else {
            let enough = needed.max(1024);
            let mend = format!(
                "add '* hard nofile {enough}' to /etc/security/limits.conf (docker run --ulimit nofile={enough})"
            );
            Finding::problem("open files", format!("at most {hard} per process, {needed} may be needed"), mend)
        };
        Some(finding.with([("soft", soft), ("hard", hard), ("needed", needed)]))
    }

    fn maps(&self) -> Option<Finding> {
        let maps = self.maps?;
        let text = format!("{maps} per process, {MAPS} may be needed");
        let finding = if maps >= MAPS {
            Finding::ok("memory maps", text)
        } else {
            Finding::problem("memory maps", text, "sudo sysctl -w vm.max_map_count=65530")
        };
        Some(finding.with([("allowed", maps), ("needed", MAPS)]))
    }

    /// Nothing, unless it is too little: who else takes from it is not known.
    fn tasks(&self, needed: u64) -> Option<Finding> {
        let allowed = self.tasks.filter(|allowed| *allowed < needed)?;
        let text = format!("{allowed} processes and threads of this user allowed, a graph alone needs {needed}");
        let mend = format!("ulimit -u {}, or TasksMax= in the systemd unit", needed.max(1024));
        Some(Finding::problem("processes", text, mend).with([("allowed", allowed), ("needed", needed)]))
    }

    fn memory(&self, need: &Need) -> Option<Finding> {
        let allowed = self.memory_bytes?;
        let needed = need.shared_bytes + PRIVATE_BYTES;
        let text = format!("{} allowed by the control group, {} may be needed", size(allowed), size(needed));
        let finding = if allowed >= needed {
            Finding::ok("memory limit", text)
        } else {
            let enough = needed.div_ceil(1 << 20);
            let mend = format!("docker run --memory={enough}m, or MemoryMax={enough}M in the systemd unit");
            Finding::warning("memory limit", text, mend)
        };
        Some(finding.with([("allowed_bytes", allowed), ("needed_bytes", needed)]))
    }
}

/// A limit in bytes; nothing, unless there is one that is too little.
fn bytes(check: &'static str, allowed: Option<u64>, needed: u64, mend: &str) -> Option<Finding> {
    let allowed = allowed.filter(|allowed| *allowed < needed)?;
    let text = format!("{} per process allowed, {} may be needed", size(allowed), size(needed));
    Some(Finding::problem(check, text, mend).with([("allowed_bytes", allowed), ("needed_bytes", needed)]))
}

/// The limit that counts, if there is one: nobody raises the soft one.
fn soft_limit(resource: Resource) -> Option<u64> {
    getrlimit(resource).ok().map(|(soft, _)| soft).filter(|limit| *limit < RLIM_INFINITY)
}

fn number(path: &Path) -> Option<u64> {
    fs::read_to_string(path).ok()?.trim().parse().ok()
}

/// The least of the limits from this process's control group up; none if there is none.
fn memory_limit() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    groups
        .lines()
        .filter_map(limit_files)
        .flatten()
        .filter_map(|file| number(&file))
        .filter(|limit| *limit < 1 << 60)
        .min()
}

/// Where the limits of a line of /proc/self/cgroup are, its own and those above it.
fn limit_files(line: &str) -> Option<Vec<PathBuf>> {
    let (controllers, group) = line.split_once(':')?.1.split_once(':')?;
    let (root, file) = match controllers {
        "" => ("/sys/fs/cgroup", "memory.max"),
        "memory" => ("/sys/fs/cgroup/memory", "memory.limit_in_bytes"),
        _ => return None,
    };
    let group = Path::new(root).join(group.trim_start_matches('/'));
    Some(group.ancestors().take_while(|above| above.starts_with(root)).map(|above| above.join(file)).collect())
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    fn judge(facts: &Facts) -> Vec<Finding> {
        facts.judge(&Need::usual())
    }

    #[test]
    fn usual_limits_are_enough() {
        let facts =
            Facts { files: Some((1024, 524_288)), maps: Some(65_530), memory_bytes: Some(1 << 30), ..Facts::default() };
        assert!(judge(&facts).iter().all(|finding| finding.verdict == Verdict::Ok));
        assert!(judge(&Facts::default()).is_empty());
    }

    #[test]
    fn small_ones_are_not() {
        let facts =
            Facts { files: Some((256, 256)), maps: Some(100), memory_bytes: Some(128 << 20), ..Facts::default() };
        let verdicts: Vec<Verdict> = judge(&facts).iter().map(|finding| finding.verdict).collect();
        assert_eq!(verdicts, [Verdict::Problem, Verdict::Problem, Verdict::Warning]);
        assert!(judge(&facts)[0].mend.as_ref().unwrap().contains("limits.conf"));
        let few = Some(1 << 20);
        let more = Facts { address_bytes: few, file_bytes: few, tasks: Some(3), ..Facts::default() };
        let checks: Vec<&str> = judge(&more).iter().map(|finding| finding.check).collect();
        assert_eq!(checks, ["address space", "file size", "processes"]);
        assert!(judge(&more).iter().all(|finding| finding.verdict == Verdict::Problem));
        // What the launcher may raise itself is none.
        let facts = Facts { files: Some((256, 4096)), ..facts };
        assert_eq!(judge(&facts)[0].verdict, Verdict::Ok);
    }

    #[test]
    fn control_groups_are_found_in_both_versions() {
        let files = |line| limit_files(line).unwrap_or_default();
        assert_eq!(
            files("0::/a/b"),
            ["/sys/fs/cgroup/a/b/memory.max", "/sys/fs/cgroup/a/memory.max", "/sys/fs/cgroup/memory.max"]
                .map(PathBuf::from)
        );
        assert_eq!(
            files("4:memory:/a"),
            ["/sys/fs/cgroup/memory/a/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.limit_in_bytes"]
                .map(PathBuf::from)
        );
        assert!(files("9:name=systemd:/").is_empty() && files("nonsense").is_empty());
    }
}
