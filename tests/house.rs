//! The rules of the house (docs/style.md), as far as a program can check them.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const LINES_MAX: usize = 500;
const FUNCTION_LINES_MAX: usize = 60;

/// Files that are longer, and why.
const LONG_FILES: &[(&str, &str)] =
    &[("shared/config/src/tests.rs", "one table of wrong graph files and what is said of each")];

/// Functions that are longer, and why.
const LONG_FUNCTIONS: &[(&str, &str, &str)] = &[
    ("examples/beam_pictures.rs", "profiles", "the drawing of one figure"),
    ("shared/instruments/src/calibrate/tests.rs", "errors_name_what_is_wrong", "a table of cases"),
    ("launch/commands/mod.rs", "run", "one arm for each command"),
    ("shared/config/src/robot_tests.rs", "bad_robot_files", "a table of cases"),
    ("shared/config/src/tests.rs", "bad_graph_files", "a table of cases"),
    ("launch/summary.rs", "fmt", "one line of text after the other"),
    ("shared/core/src/config/mapper.rs", "validate", "one check for each key"),
    ("shared/formats/src/log/carmen/survey.rs", "conclude", "one finding after the other"),
    ("shared/formats/src/log/udacity/survey.rs", "survey", "one line format, read in one pass"),
    ("shared/supervision/src/deaths.rs", "buried", "what is decided of a death, in its order"),
    ("tests/graph/disk_full.rs", "a_graph_on_a_small_disk", "one story"),
    ("tests/graph/second_user.rs", "root_neither_joins_nor_harms_the_graph_of_another_user", "one story"),
];

/// What reaches out of a computation, and what makes its result depend on more than its input.
const NOT_IN_CORE: &[(&str, &str)] = &[
    ("std::fs", "files"),
    ("std::io", "input and output"),
    ("std::net", "the network"),
    ("std::env", "the environment"),
    ("std::process", "processes"),
    ("std::thread", "threads"),
    ("std::time", "clocks"),
    ("HashMap", "an order that differs from run to run"),
    ("HashSet", "an order that differs from run to run"),
    ("rand::rng", "random numbers of the system"),
    ("thread_rng", "random numbers of the system"),
    ("from_os_rng", "random numbers of the system"),
    ("getrandom", "random numbers of the system"),
];

struct Source {
    /// From the root of the repository.
    name: String,
    text: String,
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Every file below `folder` with this ending, but for what is built.
fn files(folder: &str, ending: &str) -> Vec<Source> {
    let (mut found, mut folders) = (Vec::new(), vec![root().join(folder)]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let file_name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                folders.extend((file_name != "target" && !file_name.starts_with('.')).then_some(path));
            } else if file_name.ends_with(ending) {
                let name = path.strip_prefix(root()).unwrap().to_string_lossy().into_owned();
                found.push(Source { name, text: std::fs::read_to_string(&path).unwrap() });
            }
        }
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    assert!(!found.is_empty(), "nothing below {folder} ends with {ending}");
    found
}

fn sources() -> Vec<Source> {
    let folders = ["launch", "services", "shared", "tests", "examples"];
    folders.into_iter().flat_map(|folder| files(folder, ".rs")).collect()
}

/// Fails with all of them, if there are any.
fn none(what: &str, wrong: &[String]) {
    assert!(wrong.is_empty(), "{what}:\n{}", wrong.join("\n"));
}

#[test]
fn files_are_short() {
    let mut excused: BTreeSet<String> = LONG_FILES.iter().map(|(name, _)| (*name).to_owned()).collect();
    let mut wrong = Vec::new();
    for Source { name, text } in sources() {
        let lines = text.lines().count();
        if lines > LINES_MAX && !excused.remove(&name) {
            wrong.push(format!("{name}: {lines} lines of at most {LINES_MAX}"));
        }
    }
    wrong.extend(excused.iter().map(|name| format!("{name}: no longer too long, or gone: remove the exception")));
    none("too long", &wrong);
}

/// Names and lengths of the functions of a formatted file: a function ends where a brace closes at its own depth.
fn functions(text: &str) -> Vec<(String, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let mut found = Vec::new();
    for (at, line) in lines.iter().enumerate() {
        let depth = line.len() - line.trim_start().len();
        let Some((before, after)) = line.trim_start().split_once("fn ") else { continue };
        let is_declared = before.split_whitespace().all(|word| {
            matches!(word, "pub" | "const" | "async" | "unsafe" | "extern" | "\"C\"")
                || word.starts_with("pub(")
                || word.ends_with(')')
        });
        let name: String = after.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        if !is_declared || name.is_empty() || line.ends_with('}') || line.ends_with(';') {
            continue;
        }
        let ends = |line: &&str| {
            line.len() - line.trim_start().len() == depth && (line.trim_start() == "}" || line.ends_with(");"))
        };
        let length = lines[at + 1..].iter().position(ends).map_or(1, |end| end + 2);
        found.push((name, length));
    }
    found
}

#[test]
fn functions_are_short() {
    let mut excused: BTreeSet<(String, String)> =
        LONG_FUNCTIONS.iter().map(|(file, function, _)| ((*file).to_owned(), (*function).to_owned())).collect();
    let mut wrong = Vec::new();
    for Source { name, text } in sources() {
        for (function, length) in functions(&text) {
            if length > FUNCTION_LINES_MAX && !excused.remove(&(name.clone(), function.clone())) {
                wrong.push(format!("{name}: {function} has {length} lines of at most {FUNCTION_LINES_MAX}"));
            }
        }
    }
    let stale =
        |(file, function): &(String, String)| format!("{file}: {function} is no longer too long, or gone: remove it");
    wrong.extend(excused.iter().map(stale));
    none("too long", &wrong);
}

#[test]
fn functions_are_measured() {
    let text = "pub(crate) const fn one(\n    a: u8,\n) -> u8 {\n    a\n}\n\nimpl X {\n    fn two(&self) -> u8 {\n        if a {\n        }\n    }\n    fn three() {}\n}\n";
    assert_eq!(functions(text), [("one".to_owned(), 5), ("two".to_owned(), 4)]);
}

#[test]
fn every_module_begins_with_a_sentence() {
    let mut wrong = Vec::new();
    for Source { name, text } in sources().into_iter().filter(|source| !source.name.ends_with("tests.rs")) {
        let doc: Vec<&str> = text.lines().map_while(|line| line.strip_prefix("//!")).map(str::trim).collect();
        let first = doc.split(|line| line.is_empty()).next().unwrap_or_default().join(" ");
        if !first.contains(['.', ':']) {
            wrong.push(format!("{name}: begins with {first:?}"));
        }
    }
    none("a module says first what it is", &wrong);
}

/// Words by which a line leans on the one before: such a line says nothing in an index or an editor.
const LEANING: &[&str] = &["Of", "As", "Its", "Their", "Likewise", "And", "Or", "But", "Also", "Same"];

/// First lines of the documentation of what is public: `pub` itself, or within a public enum or trait.
fn first_lines(text: &str) -> Vec<(usize, &str)> {
    let (mut found, mut first, mut is_open) = (Vec::new(), None, false);
    for (at, line) in text.lines().enumerate() {
        is_open = line.starts_with("pub enum ") || line.starts_with("pub trait ") || is_open && !line.starts_with('}');
        match line.trim_start() {
            doc if doc.starts_with("///") => first = first.or(Some((at + 1, doc[3..].trim()))),
            attribute if attribute.starts_with("#[") => {}
            item => found.extend(first.take().filter(|_| is_open || item.starts_with("pub "))),
        }
    }
    found
}

#[test]
fn documentation_stands_alone() {
    let mut wrong = Vec::new();
    for Source { name, text } in sources() {
        let leans = |line: &str| LEANING.contains(&line.split(|c: char| !c.is_alphabetic()).next().unwrap_or_default());
        let found = first_lines(&text).into_iter().filter(|(_, line)| leans(line));
        wrong.extend(found.map(|(number, line)| format!("{name}:{number}: {line}")));
    }
    none("the first line on a public item is a whole phrase", &wrong);
}

#[test]
fn first_lines_are_found() {
    let text = "/// One.\n/// Two.\n#[must_use]\npub fn a() {}\n/// Three.\nfn b() {}\npub enum C {\n    /// Four.\n    D,\n}\n";
    assert_eq!(first_lines(text), [(1, "One."), (8, "Four.")]);
}

#[test]
fn the_core_depends_on_its_input_alone() {
    let mut wrong = Vec::new();
    for Source { name, text } in
        ["core", "judge", "slam"].iter().flat_map(|room| files(&format!("shared/{room}/src"), ".rs"))
    {
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
            let found = NOT_IN_CORE.iter().filter(|(word, _)| line.contains(word));
            wrong.extend(found.map(|(word, what)| format!("{name}:{}: {word} ({what})", number + 1)));
        }
    }
    none("the core takes values and gives values", &wrong);
}

/// Targets of the links of a Markdown text, without those that lead elsewhere.
fn links(text: &str) -> Vec<String> {
    let after = text.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target);
    after.filter(|target| !target.contains("://") && !target.is_empty()).map(str::to_owned).collect()
}

/// The anchor of a heading, as GitHub makes it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    kept.chars()
        .filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c))
        .map(|c| if c == ' ' { '-' } else { c })
        .collect()
}

fn has_anchor(text: &str, wanted: &str) -> bool {
    text.lines().filter(|line| line.starts_with('#')).any(|line| anchor(line.trim_start_matches('#')) == wanted)
}

fn documents() -> Vec<Source> {
    let read = |name: &str| Source { name: name.into(), text: std::fs::read_to_string(root().join(name)).unwrap() };
    let at_the_root = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md"].map(read);
    at_the_root.into_iter().chain(files("docs", ".md")).collect()
}

#[test]
fn links_of_documents_resolve() {
    let mut wrong = Vec::new();
    for Source { name, text } in documents() {
        let folder = root().join(Path::new(&name).parent().unwrap());
        for link in links(&text) {
            let (file, section) = link.split_once('#').unwrap_or((&link, ""));
            let target = if file.is_empty() { root().join(&name) } else { folder.join(file) };
            let there = target.exists()
                && (section.is_empty()
                    || std::fs::read_to_string(&target).is_ok_and(|text| has_anchor(&text, section)));
            if !there {
                wrong.push(format!("{name}: {link}"));
            }
        }
    }
    none("links that lead nowhere", &wrong);
}

/// Each equation of the paper leads to a function that says so.
#[test]
fn each_equation_has_its_function() {
    let text = std::fs::read_to_string(root().join("docs/model.md")).unwrap();
    let table = text.split("## The paper's equations").nth(1).unwrap().split("\n## ").next().unwrap();
    let (mut equations, mut wrong) = (Vec::new(), Vec::new());
    for row in table.lines().filter(|line| line.starts_with("| ")).skip(1) {
        let columns: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
        let [equation, _, function] = columns[..] else { panic!("a row of three columns: {row}") };
        let (name, rest) = function.trim_start_matches("[`").split_once("`](").unwrap();
        let file = rest.trim_end_matches(')').trim_start_matches("../");
        let name = name.rsplit("::").next().unwrap();
        let source = std::fs::read_to_string(root().join(file)).unwrap_or_default();
        // Its documentation: the lines of comments and attributes right above it.
        let lines: Vec<&str> = source.lines().collect();
        let declared = lines.iter().enumerate().filter(|(_, line)| line.contains(&format!("fn {name}(")));
        let says = |(at, _): (usize, &&str)| {
            let above = lines[..at].iter().rev().map(|line| line.trim_start());
            above
                .take_while(|line| line.starts_with("///") || line.starts_with("#["))
                .any(|line| line.contains(equation))
        };
        if !declared.clone().any(says) {
            wrong.push(format!("{equation}: {name} of {file} does not say that it is that"));
        }
        equations.push(equation);
    }
    none("equations without their function", &wrong);
    for wanted in ["1–4", "5–8", "9, 10", "13", "14", "20", "21", "22, 23", "Algorithm 1"] {
        assert!(equations.contains(&wanted), "{wanted} is not in the table");
    }
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    assert!(readme.contains("docs/model.md#the-papers-equations"));
}

/// Foxglove's server brings an asynchronous runtime; what `echogrid` takes of Foxglove must not.
#[test]
fn echogrid_has_no_asynchronous_runtime() {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let arguments = ["tree", "--locked", "--offline", "--package", "echogrid", "--edges", "normal", "--prefix", "none"];
    let output = std::process::Command::new(cargo).args(arguments).current_dir(root()).output().unwrap();
    let tree = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && tree.contains("foxglove v"), "{}", String::from_utf8_lossy(&output.stderr));
    let runtimes = ["tokio v", "async-std v", "smol v", "hyper v"];
    let is_one = |line: &&str| runtimes.iter().any(|name| line.starts_with(name));
    let found: Vec<String> = tree.lines().filter(is_one).map(str::to_owned).collect();
    none("asynchronous runtimes in echogrid", &found);
}
