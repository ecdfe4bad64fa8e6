//! Where the programs are.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Output;

/// The program under test: what `ECHOGRID` names; else the one that lies where cargo builds beside this test; else that on
/// `PATH`. (In the package of the program itself, `env!("CARGO_BIN_EXE_echogrid")` is better: cargo has it built then.)
#[must_use]
pub fn echogrid() -> PathBuf {
    let named = std::env::var_os("ECHOGRID").filter(|path| !path.is_empty()).map(PathBuf::from);
    named.or_else(|| beside("echogrid")).unwrap_or_else(|| "echogrid".into())
}

/// An example of the package under test, which cargo builds with its tests.
///
/// # Panics
/// It was not built.
#[must_use]
#[allow(clippy::panic)] // a test without its program has failed
pub fn example(name: &str) -> PathBuf {
    beside(&format!("examples/{name}")).unwrap_or_else(|| panic!("{name} is not there: cargo build --examples"))
}

/// The service that misbehaves ([`crate::fault`]): what `ECHOGRID_FAULT` names, or `echogrid-fault` as cargo built it.
///
/// # Panics
/// It was not built.
#[must_use]
#[allow(clippy::panic)] // a test without its program has failed
pub fn fault_program() -> PathBuf {
    let named = std::env::var_os("ECHOGRID_FAULT").filter(|path| !path.is_empty()).map(PathBuf::from);
    let built = || beside("examples/echogrid-fault").or_else(|| beside("echogrid-fault"));
    named.or_else(built).unwrap_or_else(|| {
        panic!("echogrid-fault is not there: cargo build --example echogrid-fault, or name it in ECHOGRID_FAULT")
    })
}

/// A file where cargo put the programs that belong to this test: `target/debug`, beside `deps`.
fn beside(name: &str) -> Option<PathBuf> {
    let test = std::env::current_exe().ok()?;
    test.ancestors().skip(1).take(2).map(|folder| folder.join(name)).find(|path| path.is_file())
}

/// What a program said, for a failed test.
#[must_use]
pub fn said(output: &Output) -> String {
    format!(
        "{}\n--- stdout\n{}\n--- stderr\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// What to do when the program under test can't be started.
pub(crate) fn cannot_start(program: &Path, error: &std::io::Error) -> String {
    let program = program.display();
    format!(
        "the program under test can't be started: {program}: {error}; build it (cargo build --bin echogrid), or name it in ECHOGRID"
    )
}

/// Arguments, owned.
pub(crate) fn owned<I>(arguments: I) -> Vec<OsString>
where
    I: IntoIterator,
    I::Item: AsRef<std::ffi::OsStr>,
{
    arguments.into_iter().map(|argument| argument.as_ref().to_owned()).collect()
}
