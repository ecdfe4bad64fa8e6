//! Shared memory: enough of it, and where it should be.

use echogrid_topics::domain::{SHM, SharedMemory, files_needed};

use super::finding::{Finding, size};
use super::need::Need;

/// What is known of it.
pub(super) struct Facts(Result<SharedMemory, String>);

impl Facts {
    pub(super) fn gather() -> Self {
        Self(SharedMemory::look().map_err(|error| error.to_string()))
    }

    pub(super) fn judge(&self, need: &Need) -> Vec<Finding> {
        let memory = match &self.0 {
            Ok(memory) => memory,
            Err(error) => {
                let mend = format!("mount -t tmpfs -o mode=1777 tmpfs {SHM}");
                return vec![Finding::problem("shared memory", error, mend)];
            }
        };
        let mut findings = vec![room(memory, need)];
        findings.push(states(memory, need));
        findings.extend(files(memory, files_needed(need.services)));
        findings.extend(kind(memory));
        findings
    }
}

fn room(memory: &SharedMemory, need: &Need) -> Finding {
    let SharedMemory { total_bytes, free_bytes, promised_bytes, .. } = *memory;
    let needed = need.shared_bytes;
    let mut text = format!(
        "{} free in {SHM}, at most {} MiB needed (scans of {} readings, {} services)",
        size(free_bytes),
        needed.div_ceil(1 << 20),
        need.max_readings,
        need.services
    );
    let mend = |enough_mib: u64| {
        format!("mount -o remount,size={enough_mib}m {SHM} (for a container: docker run --shm-size={enough_mib}m)")
    };
    let finding = if free_bytes < needed {
        Finding::problem("shared memory", text, mend(memory.enough_mib(needed)))
    } else if free_bytes - needed < promised_bytes {
        text += &format!("; running graphs may come to need {} of it", size(promised_bytes));
        Finding::warning("shared memory", text, mend(memory.enough_mib(needed + promised_bytes)))
    } else {
        Finding::ok("shared memory", text)
    };
    finding.with([
        ("total_bytes", total_bytes),
        ("free_bytes", free_bytes),
        ("needed_bytes", needed),
        ("promised_bytes", promised_bytes),
    ])
}

/// Where services will store their states, beside the topics.
fn states(memory: &SharedMemory, need: &Need) -> Finding {
    let states = need.states_bytes;
    let room = memory.free_bytes.saturating_sub(need.shared_bytes);
    let place = if room < states {
        format!("in {}, as there is too little room in {SHM} beside the topics", std::env::temp_dir().display())
    } else {
        format!("in {SHM}")
    };
    let text =
        format!("what services store of themselves lies {place} ({} MiB are asked for)", states.div_ceil(1 << 20));
    Finding::ok("states", text).with([("needed_bytes", states), ("room_bytes", room)])
}

fn files(memory: &SharedMemory, needed: u64) -> Option<Finding> {
    let free = memory.free_inodes?;
    let text = format!("{free} files can be made in {SHM}, {needed} may be needed");
    let finding = if free < needed {
        Finding::problem("inodes", text, format!("mount -o remount,nr_inodes=64k {SHM}"))
    } else {
        Finding::ok("inodes", text)
    };
    Some(finding.with([("free", free), ("needed", needed)]))
}

/// Nothing, unless it is not what it should be.
fn kind(memory: &SharedMemory) -> Vec<Finding> {
    let mut findings = Vec::new();
    if !memory.is_tmpfs {
        findings.push(Finding::warning(
            "tmpfs",
            format!("{SHM} does not lie in memory: processes wait for its disk"),
            format!("mount -t tmpfs -o mode=1777 tmpfs {SHM}"),
        ));
    }
    if !memory.is_writable {
        let mend = format!("chmod 1777 {SHM}, or mount -o remount,rw {SHM}");
        findings.push(Finding::problem("tmpfs", format!("{SHM} can't be written by this user"), mend));
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    const GOOD: SharedMemory = SharedMemory {
        total_bytes: 64 << 20,
        free_bytes: 64 << 20,
        promised_bytes: 0,
        free_inodes: Some(100_000),
        is_tmpfs: true,
        is_writable: true,
    };

    fn verdicts(memory: SharedMemory) -> Vec<(&'static str, Verdict)> {
        let need = Need::usual();
        Facts(Ok(memory)).judge(&need).iter().map(|finding| (finding.check, finding.verdict)).collect()
    }

    #[test]
    fn a_container_is_large_enough() {
        assert_eq!(verdicts(GOOD), [("shared memory", Verdict::Ok), ("states", Verdict::Ok), ("inodes", Verdict::Ok)]);
    }

    #[test]
    fn states_lie_where_there_is_room() {
        let mut need = Need::usual();
        let place = |need: &Need, memory| states(memory, need).text;
        assert!(place(&need, &GOOD).contains("as there is too little room"));
        let large = SharedMemory { total_bytes: 2 << 30, free_bytes: 2 << 30, ..GOOD };
        assert!(place(&need, &large).contains("lies in /dev/shm ("));
        need.states_bytes = 4 << 30;
        assert!(
            place(&need, &large).contains("(4096 MiB are asked for)")
                && place(&need, &large).contains("as there is too little room")
        );
    }

    #[test]
    fn too_little_is_a_problem_with_the_size_that_mends_it() {
        let need = Need::usual();
        let small = SharedMemory { total_bytes: 16 << 20, free_bytes: 8 << 20, ..GOOD };
        let finding = room(&small, &need);
        assert_eq!(finding.verdict, Verdict::Problem);
        let enough = (8 + need.shared_bytes.div_ceil(1 << 20)).to_string();
        assert!(finding.mend.as_ref().unwrap().contains(&format!("--shm-size={enough}m")), "{finding}");
        assert_eq!(finding.figures["needed_bytes"], need.shared_bytes);
    }

    #[test]
    fn what_running_graphs_may_take_is_counted() {
        assert_eq!(verdicts(SharedMemory { promised_bytes: 60 << 20, ..GOOD })[0].1, Verdict::Warning);
    }

    #[test]
    fn files_disks_and_permissions() {
        assert_eq!(verdicts(SharedMemory { free_inodes: Some(10), ..GOOD })[2], ("inodes", Verdict::Problem));
        assert_eq!(verdicts(SharedMemory { free_inodes: None, ..GOOD }).len(), 2);
        assert_eq!(verdicts(SharedMemory { is_tmpfs: false, ..GOOD })[3], ("tmpfs", Verdict::Warning));
        assert_eq!(verdicts(SharedMemory { is_writable: false, ..GOOD })[3], ("tmpfs", Verdict::Problem));
        let none = Facts(Err("/dev/shm: No such file or directory".into()));
        assert_eq!(none.judge(&Need::usual())[0].verdict, Verdict::Problem);
    }
}
