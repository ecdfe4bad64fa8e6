//! A machine of its own for a test: a mount namespace with small disks and a small shared memory.
//!
//! ```no_run
//! # use echogrid_harness::{disk, namespace};
//! #[test]
//! fn a_full_disk() {
//!     let folder = std::env::temp_dir();
//!     namespace::in_a_namespace("my_module::on_a_full_disk", "mount -t tmpfs -o size=4m tmpfs \"$1\"", &folder);
//! }
//!
//! #[test]
//! #[ignore = "run in a namespace by the test above"]
//! fn on_a_full_disk() {
//!     let Some(folder) = namespace::folder_in_a_namespace() else { return };
//!     disk::fill(&folder, 0);
//! }
//! ```

#![allow(clippy::unwrap_used)] // a test that can't be set up has failed

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::said;

/// Where a test that runs in a namespace finds its folder.
const FOLDER: &str = "ECHOGRID_TEST_FOLDER";

/// Runs the ignored test `name` of this program in a mount namespace of its own, after the command `mount`, which finds `folder` as
/// `$1`; where the machine allows no namespace that is said.
///
/// # Panics
/// The test failed, or there is none of this name.
pub fn in_a_namespace(name: &str, mount: &str, folder: &Path) {
    let unshare = |flags: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(flags);
        command
    };
    let allowed = [&["--mount"][..], &["--mount", "--map-root-user"]].into_iter().find(|flags| {
        let mut command = unshare(flags);
        command.args(["sh", "-c", "mount -t tmpfs tmpfs \"$1\"", "sh"]).arg(folder);
        command.output().is_ok_and(|output| output.status.success())
    });
    let Some(flags) = allowed else {
        let _ = writeln!(std::io::stderr(), "skipped: no mount namespace here (unshare --mount)");
        return;
    };
    let script = format!("{mount} && exec \"$2\" {name} --exact --ignored --nocapture");
    let mut command = unshare(flags);
    command.args(["sh", "-c", &script, "sh"]).arg(folder).arg(std::env::current_exe().unwrap()).env(FOLDER, folder);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let passed = String::from_utf8_lossy(&output.stdout).contains("1 passed");
    assert!(passed, "no test {name}: {}", said(&output));
}

/// In a namespace, puts another shared memory in place of the one there was. (In that of a user, none can be remounted.)
///
/// # Panics
/// It can't.
pub fn mount_shared_memory(options: &str) {
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs", "/dev/shm"]).status();
    assert!(mount.unwrap().success(), "{options}");
}

/// The folder of a test that runs in a namespace; none where it does not, and has nothing to do.
#[must_use]
pub fn folder_in_a_namespace() -> Option<PathBuf> {
    std::env::var_os(FOLDER).map(PathBuf::from)
}
