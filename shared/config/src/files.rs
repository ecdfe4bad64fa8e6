//! What a configuration names on this machine: executables, the log, files of the localizer.

use std::ffi::OsStr;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use echogrid_core::config::Start;
use echogrid_formats::open_regular;

use super::Config;
use super::assemble::Origins;
use super::problem::Problem;
use super::service::{Builtin, Exec};
use super::suggest;

/// Nobody begins with a larger heading, radians: a turn and a little.
const HEADING_MAX_RAD: f64 = 6.5;

/// Finds every executable (`search_path` is a `PATH`) and looks whether the log and the files of the localizer are there.
pub(crate) fn resolve(config: &mut Config, origins: &Origins, search_path: Option<&OsStr>) -> Vec<Problem> {
    let mut found = Vec::new();
    let mut add = |key: String, value: &Path, message: String| {
        let origin = origins.get(&key).cloned();
        found.push(Problem { origin, key, value: Some(format!("{value:?}")), message });
    };
    for (name, service) in &mut config.services {
        let Exec::Path(path) = &service.exec else { continue };
        match executable(path, search_path) {
            Ok(resolved) => service.exec = Exec::Path(resolved),
            Err(why) => add(format!("services.{name}.exec"), path, why),
        }
    }
    let log = &config.replay.log;
    let plays = config.services.values().any(|service| service.exec == Exec::Builtin(Builtin::Replay));
    if plays && !log.as_os_str().is_empty() {
        // A folder may hold the files of a log.
        if let Err(error) = log.metadata() {
            add("replay.log".to_owned(), log, unreadable(&error));
        }
    }
    for (key, file) in config.localizer.files() {
        if let Err(error) = open_regular(file) {
            add(format!("localizer.{key}"), file, unreadable(&error));
        }
    }
    if config.run.out.as_os_str().is_empty() {
        add("run.out".to_owned(), &config.run.out, "expected a folder; the one here is \".\"".to_owned());
    }
    if let Start::Pose([_, _, heading_rad]) = config.odometry.start
        && heading_rad.abs() > HEADING_MAX_RAD
    {
        let turns = heading_rad.abs() / core::f64::consts::TAU;
        let message =
            format!("a heading of {turns:.1} turns; expected radians (of --start, degrees, too: {heading_rad}deg)");
        add("odometry.start".to_owned(), Path::new(&format!("{heading_rad}")), message);
    }
    if config.run.out.exists() && !config.run.out.is_dir() {
        add("run.out".to_owned(), &config.run.out, "a file, expected a folder".to_owned());
    }
    found
}

fn unreadable(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file".to_owned(),
        _ => error.to_string(),
    }
}

fn executable(path: &Path, search_path: Option<&OsStr>) -> Result<PathBuf, String> {
    if path.as_os_str().as_encoded_bytes().contains(&b'/') {
        return check(path).map(|()| path.to_path_buf());
    }
    let folders = || search_path.into_iter().flat_map(std::env::split_paths);
    let candidates = || folders().filter(|folder| folder.is_absolute()).map(|folder| folder.join(path));
    candidates().find(|candidate| check(candidate).is_ok()).ok_or_else(|| {
        let hint = path.to_str().and_then(suggest::builtin);
        let hint = hint.unwrap_or_else(|| format!("a file beside the graph is \"./{}\"", path.display()));
        format!("no executable of this name in the {} folders of PATH; {hint}", folders().count())
    })
}

fn check(path: &Path) -> Result<(), String> {
    let metadata = path.metadata().map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => "there is no such file, expected an executable".to_owned(),
        _ => error.to_string(),
    })?;
    if !metadata.is_file() {
        return Err("not a file, expected an executable".to_owned());
    }
    if metadata.permissions().mode() & 0o111 == 0 {
        return Err("the file is not executable (chmod +x makes it so)".to_owned());
    }
    Ok(())
}
