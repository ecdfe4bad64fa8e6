//! Programs that print lines, as sensors.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use echogrid_lines::{Binder, Called, Lines};
use echogrid_service::{Sensor, conformance};
use echogrid_topics::Message;

/// Ten seconds of a robot that drives towards a wall, in shell.
const DRIVE: &str = r#"
echo "PARAM echogrid_sonar_max 5 h 0"
i=0
while [ $i -lt 100 ]; do
    echo "ODOM $((i / 50)).$((i % 50 * 2 / 10))$((i % 50 * 2 % 10)) 0 0 0.2 0 0 $((i / 10)).$((i % 10)) h 0"
    echo "SONAR 0.5 1 2.5 0.2 0 0 $((i / 10)).$((i % 10)) h 0"
    i=$((i + 1))
done
"#;

fn lines(script: &str, replays: bool) -> Lines {
    let binder = Binder { program: env!("CARGO_BIN_EXE_echogrid-lines").into(), arguments: &[] };
    let called = Called { program: "/bin/sh".into(), arguments: ["-c", script].map(Into::into).into() };
    Lines::start("sensor", replays, None, &binder, &called).unwrap()
}

#[test]
fn a_shell_script_keeps_what_every_sensor_promises() {
    let given = conformance::check(|| Ok(lines(DRIVE, true))).unwrap();
    assert_eq!((given.odometry, given.scans), (100, 100));
}

#[test]
fn a_script_that_fails_says_how() {
    let error = |script: &str| {
        let mut lines = lines(script, true);
        loop {
            match lines.next() {
                Ok(Some(_)) => {}
                Ok(None) => panic!("ended well"),
                Err(error) => return format!("{error:#}"),
            }
        }
    };
    assert_eq!(error("exit 3"), "/bin/sh: ended with exit code 3");
    assert_eq!(error("kill -9 $$"), "/bin/sh: was killed by signal 9 (SIGKILL)");
    assert!(error("echo Hello").starts_with("sensor: no range readings in it"), "{}", error("echo Hello"));
}

#[test]
fn a_program_that_goes_on_printing_ends_when_it_is_told_to() {
    let mut lines = lines(&format!("{DRIVE} while :; do echo \"# still here\"; done"), false);
    for _ in 0..50 {
        assert!(lines.next().unwrap().is_some());
    }
    lines.close();
    while lines.next().unwrap().is_some() {}
}

#[test]
fn what_is_measured_now_is_stamped_by_the_clock_of_the_machine() {
    let mut lines = lines(DRIVE, false);
    let mut stamps = Vec::new();
    while let Some((stamp_ns, message)) = lines.next().unwrap() {
        stamps.extend(matches!(message, Message::Odometry(_)).then_some(stamp_ns));
    }
    // As far apart as the program says, but not from its zero.
    assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] == 100_000_000), "{stamps:?}");
    assert!(stamps[0] > 0);
}
