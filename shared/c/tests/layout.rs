//! The structures of `c/echogrid.h` lie as those of the library.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use core::mem::offset_of;
use std::path::Path;
use std::process::Command;

use echogrid_c::{Driver, Grid, Said};

/// The numbers that a C compiler gives for these expressions; none where there is no compiler.
fn of_c(expressions: &[&str]) -> Option<Vec<usize>> {
    let folder = tempfile::tempdir().unwrap();
    let (source, program) = (folder.path().join("layout.c"), folder.path().join("layout"));
    let prints: String = expressions.iter().map(|one| format!("    printf(\"%zu\\n\", (size_t)({one}));\n")).collect();
    let text = format!("#include <stdio.h>\n#include \"echogrid.h\"\nint main(void) {{\n{prints}    return 0;\n}}\n");
    std::fs::write(&source, text).unwrap();
    let headers = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../c");
    let compiled = Command::new("cc")
        .arg("-Wall")
        .arg("-Werror")
        .arg("-I")
        .args([&headers, &source])
        .arg("-o")
        .arg(&program)
        .output();
    let Ok(compiled) = compiled else {
        eprintln!("skipped: no C compiler (cc)");
        return None;
    };
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let printed = String::from_utf8(Command::new(&program).output().unwrap().stdout).unwrap();
    Some(printed.lines().map(|line| line.parse().unwrap()).collect())
}

#[test]
fn structures_of_the_header_lie_as_those_of_the_library() {
    let expressions = [
        "sizeof(struct echogrid_said)",
        "offsetof(struct echogrid_said, odometry)",
        "offsetof(struct echogrid_said, readings)",
        "offsetof(struct echogrid_said, reading_count)",
        "offsetof(struct echogrid_said, error)",
        "sizeof(struct echogrid_driver)",
        "offsetof(struct echogrid_driver, robot)",
        "offsetof(struct echogrid_driver, user)",
        "offsetof(struct echogrid_driver, next)",
        "offsetof(struct echogrid_driver, close)",
        "offsetof(struct echogrid_driver, is_live)",
        "sizeof(struct echogrid_grid)",
        "offsetof(struct echogrid_grid, resolution_m)",
        "offsetof(struct echogrid_grid, log_odds)",
    ];
    let of_rust = [
        size_of::<Said>(),
        offset_of!(Said, odometry),
        offset_of!(Said, readings),
        offset_of!(Said, reading_count),
        offset_of!(Said, error),
        size_of::<Driver>(),
        offset_of!(Driver, robot),
        offset_of!(Driver, user),
        offset_of!(Driver, next),
        offset_of!(Driver, close),
        offset_of!(Driver, is_live),
        size_of::<Grid>(),
        offset_of!(Grid, resolution_m),
        offset_of!(Grid, log_odds),
    ];
    if let Some(of_c) = of_c(&expressions) {
        assert_eq!(of_c, of_rust);
    }
}
