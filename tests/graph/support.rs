//! What the tests share.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use echogrid::config::{Config, LoadRequest};
use echogrid_core::Robot;
use echogrid_formats::map::Provenance;
use echogrid_publisher::PublisherService;
use tempfile::TempDir;

use crate::drive;

/// The program under test.
pub(crate) const ECHOGRID: &str = env!("CARGO_BIN_EXE_echogrid");

/// The robot that drives in [`drive`].
pub(crate) fn pioneer() -> Robot {
    let request = LoadRequest { robot: Some("pioneer3at".into()), ..LoadRequest::default() };
    Config::load(&request).unwrap().robot().unwrap().clone()
}

/// A folder with a log of `metres` of the project's own drive in it.
pub(crate) struct Drive {
    folder: TempDir,
}

impl Drive {
    pub(crate) fn new(metres: f64) -> Self {
        let drive = Self { folder: tempfile::tempdir().unwrap() };
        std::fs::write(drive.log(), drive::carmen_log(&pioneer(), 1, metres)).unwrap();
        drive
    }

    pub(crate) fn log(&self) -> PathBuf {
        self.folder.path().join("drive.log")
    }

    /// A folder for a map.
    pub(crate) fn out(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `echogrid map` of the drive, arguments first.
    pub(crate) fn map_arguments(&self, out: &str, more: &[&str]) -> Vec<String> {
        let mut arguments = vec!["map".to_owned(), path(&self.log()), "--out".into(), path(&self.out(out))];
        arguments.extend(more.iter().map(|argument| (*argument).to_owned()));
        arguments
    }

    /// Runs `echogrid map` to its end.
    pub(crate) fn map(&self, out: &str, more: &[&str]) -> Output {
        echogrid(self.map_arguments(out, more))
    }

    /// Runs `echogrid map` and gives the bytes of the native map.
    pub(crate) fn native_map(&self, out: &str, more: &[&str]) -> Vec<u8> {
        let output = self.map(out, more);
        assert!(output.status.success(), "{}", said(&output));
        std::fs::read(self.out(out).join("map.echogrid")).unwrap()
    }
}

pub(crate) fn path(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// Runs the program to its end.
pub(crate) fn echogrid<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> Output {
    Command::new(ECHOGRID).args(arguments).output().unwrap()
}

/// What a program said, for a failed test.
pub(crate) fn said(output: &Output) -> String {
    format!(
        "{}\n--- stdout\n{}\n--- stderr\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// The summary of `--json`.
pub(crate) fn summary(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", said(output));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}\n{}", said(output)))
}

/// Where a test that runs in a namespace finds its folder.
const FOLDER: &str = "ECHOGRID_TEST_FOLDER";

/// Runs the ignored test `name` of this program in a mount namespace of its own, after the command `mount`, which finds `folder` as
/// `$1`; where the machine allows no namespace that is said.
pub(crate) fn in_a_namespace(name: &str, mount: &str, folder: &Path) {
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
pub(crate) fn mount_shared_memory(options: &str) {
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs", "/dev/shm"]).status();
    assert!(mount.unwrap().success(), "{options}");
}

/// The folder of a test that runs in a namespace; none where it does not, and has nothing to do.
pub(crate) fn folder_in_a_namespace() -> Option<PathBuf> {
    std::env::var_os(FOLDER).map(PathBuf::from)
}

/// Logs of others, where there are any.
pub(crate) fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("ECHOGRID_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(name);
    if path.exists() {
        return Some(path);
    }
    let _ = writeln!(std::io::stderr(), "skipped: no {}", path.display());
    None
}

/// The native map of a configuration, made in this process.
pub(crate) fn native_map_of(config: &Config, provenance: Provenance, out: &Path) -> Vec<u8> {
    let mut publisher = PublisherService::new(config.publisher.clone(), out.into(), provenance).unwrap();
    echogrid::in_process::run(config, &mut publisher).unwrap();
    std::fs::read(out.join("map.echogrid")).unwrap()
}
