//! What a service may use.

use std::process::Command;

use super::graph_file::{GraphFile, NOTHING};
use crate::support::{Drive, ECHOGRID, path, said};

/// The soft and the hard limit of this name, of a process.
fn limits(pid: u32, name: &str) -> [String; 2] {
    let text = std::fs::read_to_string(format!("/proc/{pid}/limits")).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(name)).unwrap();
    let mut words = line.split_whitespace().map(str::to_owned);
    [words.next().unwrap(), words.next().unwrap()]
}

fn niceness(pid: u32) -> i64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    // Field 19; what is in parentheses may hold spaces.
    let (_, fields) = text.rsplit_once(')').unwrap();
    fields.split_whitespace().nth(16).unwrap().parse().unwrap()
}

#[test]
fn a_service_gets_no_more_than_it_may_use_even_in_its_next_life() {
    let drive = Drive::new(6.0);
    let file = GraphFile::new(&drive, "maps").with(
        "[run]\nrate = 5\n[services.publisher]\nkind = \"publisher\"\nexec = \"builtin:publisher\"\n\
         nice = 5\nmemory_max_mib = 4096\nopen_files_max = 300",
    );
    let mut graph = file.start(&["supervision.backoff_s=0.02"]);
    graph.wait_for_progress("publisher", 10);
    let ours = niceness(std::process::id());
    for life in 1..=2 {
        graph.wait_for_nth("publisher started (process ", life);
        let pid = graph.pid_of("publisher");
        graph.wait_until("it runs", |graph| graph.pid("publisher") == u64::from(pid));
        assert_eq!(limits(pid, "Max open files"), ["300", "300"]);
        assert_eq!(limits(pid, "Max address space"), [(4096_u64 << 20).to_string(), (4096_u64 << 20).to_string()]);
        assert_eq!(niceness(pid), 5, "life {life}");
        let mapper = graph.pid_of("mapper");
        assert_eq!(
            (niceness(mapper), limits(mapper, "Max address space")),
            (ours, ["unlimited", "unlimited"].map(Into::into))
        );
        graph.kill("publisher");
    }
    let ended = graph.wait();
    assert_eq!(ended.restarts(), 2, "{}", ended.stdout);
    assert_eq!(ended.leftovers(), NOTHING);
}

/// The map is far larger than 1 KB, and the limit is one of each process: an error that names the file, no death by SIGXFSZ.
#[test]
fn a_file_that_may_not_grow_is_an_error_with_its_name() {
    let drive = Drive::new(1.0);
    assert!(drive.map("whole", &[]).status.success());
    let refused = |output: std::process::Output, named: &str| {
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(error.contains(named) && error.contains("File too large"), "{error}");
    };
    let convert = [path(&drive.out("whole/map.echogrid")), path(&drive.out("map.npy"))];
    let limited = |arguments: &[String]| {
        let script = "ulimit -f 1 && exec \"$@\"";
        Command::new("sh").args(["-c", script, "sh", ECHOGRID]).args(arguments).output().unwrap()
    };
    refused(limited(&[vec!["convert".to_owned()], convert.to_vec()].concat()), "map.npy");
    let mapped = limited(&drive.map_arguments("maps", &[]));
    assert_eq!(mapped.status.code(), Some(1), "{}", said(&mapped));
    assert!(!mapped.stderr.is_empty());
}
