//! A calibration, and a map that is made with it.

use crate::support::{Drive, echogrid, said};

#[test]
fn what_calibrate_writes_is_what_map_takes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let section = path("odometry.toml");
    let output = echogrid(["calibrate", "--simulate", "--trials", "20", "--out", &section]);
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains(&format!("--config {section}")), "{}", said(&output));
    let checked = echogrid(["check", &section]);
    assert!(checked.status.success() && said(&checked).contains("odometry.toml"), "{}", said(&checked));

    let drive = Drive::new(2.0);
    let plain = drive.native_map("plain", &[]);
    assert!(drive.native_map("calibrated", &["--config", &section]) != plain);
    let missing = drive.map("missing", &["--config", "/nowhere/odometry.toml"]);
    assert_eq!(missing.status.code(), Some(1), "{}", said(&missing));
    // Neither trials nor --simulate: that is wrong usage.
    assert_eq!(echogrid(["calibrate"]).status.code(), Some(2));
}
