//! `echogrid new sensor`: a working sensor of one's own to begin with, in any of four languages, with its graph file and its test.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::cli::SensorLanguage;

/// A file of the new sensor.
struct File {
    name: &'static str,
    text: String,
    is_program: bool,
}

impl File {
    fn program(name: &'static str, text: impl Into<String>) -> Self {
        Self { name, text: text.into(), is_program: true }
    }

    fn text(name: &'static str, text: impl Into<String>) -> Self {
        Self { name, text: text.into(), is_program: false }
    }
}

/// Writes a sensor into `folder`, which must be new or empty; `source` is where echogrid's own sources lie, for languages that need them.
pub(super) fn sensor(language: SensorLanguage, folder: &Path, source: Option<&Path>) -> Result<()> {
    let is_empty = match fs::read_dir(folder) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => true,
        Err(error) => return Err(error).with_context(|| folder.display().to_string()),
    };
    ensure!(is_empty, "{}: is not empty; expected a new or empty folder", folder.display());
    let files = files(language, source)?;
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let mut said = String::new();
    for File { name, text, is_program } in files {
        let path = folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
        }
        let mode = if is_program { 0o777 } else { 0o666 };
        let file = OpenOptions::new().write(true).create_new(true).mode(mode).open(&path);
        file.and_then(|mut file| file.write_all(text.as_bytes())).with_context(|| path.display().to_string())?;
        said += &format!("{}\n", path.display());
    }
    said += &format!(
        "\n{}/test.sh makes a map with it; `echogrid up {}/graph.toml` does, too.\n",
        folder.display(),
        folder.display()
    );
    super::print(&said)
}

fn files(language: SensorLanguage, source: Option<&Path>) -> Result<Vec<File>> {
    let root = source.map(root_of).transpose()?;
    let needed = |what: &str| {
        root.as_deref().with_context(|| format!("{what}; --source DIR names the folder of echogrid's sources"))
    };
    Ok(match language {
        SensorLanguage::Lines => lines(),
        SensorLanguage::Python => python(root.as_deref()),
        SensorLanguage::C => c(needed("a sensor in C needs the headers in c/ and libechogrid_c.so")?),
        SensorLanguage::Rust => rust(needed("a sensor in Rust needs crates that are on no registry")?),
    })
}

fn lines() -> Vec<File> {
    let keys =
        "exec = \"./sensor.sh\"\nspeaks = \"carmen\"\nreplays = true # it prints the same whenever it is started\n";
    vec![
        File::program("sensor.sh", include_str!("../../examples/lines/square.sh")),
        File::text("graph.toml", graph(keys)),
        File::program("test.sh", test("")),
    ]
}

fn python(root: Option<&Path>) -> Vec<File> {
    let module = root.map_or_else(String::new, |root| format!("env = {{ PYTHONPATH = {:?} }}\n", root.join("python")));
    let keys = format!("exec = \"./sensor.py\" # its python3 needs the package iceoryx2 0.10.0\n{module}");
    vec![
        File::program("sensor.py", include_str!("../../examples/python/random_walk.py")),
        File::text("graph.toml", graph(&keys)),
        File::program("test.sh", test("python3 -c 'import iceoryx2'\n")),
    ]
}

fn c(root: &Path) -> Vec<File> {
    let make = format!(
        "ECHOGRID = {}\nsensor: sensor.c\n\tcc -std=c11 -O2 -Wall -I$(ECHOGRID)/c sensor.c -L$(ECHOGRID)/target/release -lechogrid_c -lm \
         -Wl,-rpath,$(ECHOGRID)/target/release -o sensor\n",
        root.display()
    );
    vec![
        File::text("sensor.c", include_str!("../../examples/c/square.c")),
        File::text("Makefile", make),
        File::text("graph.toml", graph("exec = \"./sensor\"\n")),
        File::program("test.sh", test("make\n")),
    ]
}

fn rust(root: &Path) -> Vec<File> {
    let dependency = |name: &str, folder: &str| format!("echogrid-{name} = {{ path = {:?} }}\n", root.join(folder));
    let manifest = format!(
        "[package]\nname = \"sensor\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[dependencies]\nanyhow = \"1\"\n{}{}{}\
         rand_chacha = {{ version = \"0.10\", default-features = false }}\n\n# A workspace of its own, wherever it lies.\n[workspace]\n",
        dependency("core", "shared/core"),
        dependency("service", "shared/service"),
        dependency("topics", "shared/topics"),
    );
    vec![
        File::text("Cargo.toml", manifest),
        File::text("src/main.rs", include_str!("../../examples/random_walk.rs")),
        File::text("graph.toml", graph("exec = \"./target/release/sensor\"\n")),
        File::program("test.sh", test("cargo build --release\n")),
    ]
}

/// The folder of echogrid's sources, whole.
fn root_of(source: &Path) -> Result<PathBuf> {
    let root = source.canonicalize().with_context(|| source.display().to_string())?;
    ensure!(root.join("shared/topics").is_dir(), "{}: holds no sources of echogrid (shared/topics)", root.display());
    Ok(root)
}

fn graph(keys: &str) -> String {
    format!(
        "# A graph with a sensor of one's own; `echogrid check graph.toml` prints every setting.\n\n[run]\nrate = \"max\" # 1 for a sensor that \
         measures what is now\n\n[services.sensor]\nkind = \"sensor\"\n{keys}"
    )
}

fn test(build: &str) -> String {
    format!(
        "#!/bin/sh\n# The sensor makes a map, and the same map once more.\nset -eu\ncd \"$(dirname \"$0\")\"\n{build}\
         out=$(mktemp -d)\ntrap 'rm -rf \"$out\"' EXIT\nfor run in first second; do\n    ${{ECHOGRID:-echogrid}} up graph.toml --quiet --out \"$out/$run\"\ndone\n\
         cmp \"$out/first/map.echogrid\" \"$out/second/map.echogrid\"\necho \"ok: the same map twice\"\n"
    )
}
