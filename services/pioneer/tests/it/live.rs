//! The driver and the emulator in real time: over a pseudo-terminal whose cable is pulled, and over TCP.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use echogrid_core::Robot;
use echogrid_pioneer::emulator::{Door, serve};
use echogrid_pioneer::{Pioneer, PioneerConfig};
use echogrid_service::Sensor;
use echogrid_simulator::Motion;
use echogrid_topics::{Command, Message};

use crate::{driven, emulator, robot};

const PATIENCE: Duration = Duration::from_secs(60);

fn driver(port: String, motors: bool) -> Pioneer {
    let config = PioneerConfig { port, motors, dead_man_s: 0.3, ..PioneerConfig::default() };
    let known: Vec<(String, Robot)> = vec![("pioneer3at".into(), robot())];
    Pioneer::new(config, None, known).unwrap()
}

/// Messages until `done` says so.
fn until(pioneer: &mut Pioneer, mut done: impl FnMut(&Pioneer, &Message) -> bool) -> Vec<(u64, Message)> {
    let deadline = Instant::now() + PATIENCE;
    let mut messages = Vec::new();
    loop {
        assert!(Instant::now() < deadline, "{}", pioneer.note());
        if !pioneer.is_ready().unwrap() {
            continue;
        }
        let (stamp_ns, message) = pioneer.next().unwrap().unwrap();
        let is_done = done(pioneer, &message);
        messages.push((stamp_ns, message));
        if is_done {
            return messages;
        }
    }
}

/// Whoever serves goes when the test does, however it ends.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::SeqCst);
    }
}

fn is_scan(message: &Message) -> bool {
    matches!(message, Message::Scan(_))
}

fn terminal(link: Option<&Path>) -> Option<Door> {
    match Door::terminal(link) {
        Ok(door) => Some(door),
        Err(error) => {
            println!("skipped: no pseudo-terminal: {error:#}");
            None
        }
    }
}

#[test]
fn over_tcp_no_packet_is_lost_and_the_session_is_closed() {
    let mut door = Door::tcp("127.0.0.1:0".parse().unwrap()).unwrap();
    let (port, sent, is_open) = (door.name(), AtomicU64::new(0), AtomicBool::new(true));
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut robot = emulator(vec![Motion::Straight { metres: 1.0 }]);
            let mut was_open = false;
            serve(&mut robot, &mut door, |robot| {
                was_open |= robot.is_open();
                sent.store(robot.sips(), Ordering::SeqCst);
                was_open && !robot.is_open()
            })
            .unwrap();
            is_open.store(false, Ordering::SeqCst);
        });
        let mut pioneer = driver(port, false);
        assert!(
            pioneer.command(Command::Drive { v_mps: 0.1, w_radps: 0.0 }).unwrap_err().to_string().contains("motors")
        );
        let messages = until(&mut pioneer, |pioneer, _| pioneer.packets() == 30);
        assert!(matches!(messages[0].1, Message::Robot(_)));
        assert!(messages.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        assert!(messages.iter().filter(|(_, message)| is_scan(message)).count() >= 7);
        assert!(pioneer.note().contains("emulated (p3at-sh), battery 12.9 V"), "{}", pioneer.note());
        let packets = pioneer.packets();
        pioneer.close();
        assert_eq!(pioneer.next().unwrap().map(|_| ()), None);
        // Those that came after the last look are nobody's.
        let begun = Instant::now();
        while is_open.load(Ordering::SeqCst) {
            assert!(begun.elapsed() < PATIENCE, "the session was left open");
            thread::yield_now();
        }
        assert!(sent.load(Ordering::SeqCst) <= packets + 2);
    });
}

/// The cable is pulled, and comes back under another name; the robot counts on.
#[test]
fn a_cable_that_is_pulled_and_comes_back_elsewhere_is_found() {
    let folder = std::env::temp_dir().join(format!("echogrid-pioneer-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let link = |number: u32| -> PathBuf { folder.join(format!("ttyUSB{number}")) };
    let Some(mut door) = terminal(Some(&link(0))) else { return };
    let port = link(0).display().to_string();
    let mut robot = emulator(vec![Motion::Straight { metres: 2.0 }]);
    let mut pioneer = driver(port, false);
    let pulled = AtomicBool::new(false);
    let mut last = thread::scope(|scope| {
        scope.spawn(|| serve(&mut robot, &mut door, |_| pulled.load(Ordering::SeqCst)).unwrap());
        let _ends = Ends(&pulled);
        let messages = until(&mut pioneer, |pioneer, message| pioneer.packets() >= 15 && is_scan(message));
        messages.last().unwrap().0
    });
    drop(door);
    let begun = Instant::now();
    while !pioneer.note().contains("ttyUSB0") {
        if pioneer.is_ready().unwrap() {
            last = pioneer.next().unwrap().unwrap().0;
        }
        assert!(begun.elapsed() < PATIENCE, "{}", pioneer.note());
    }
    let mut door = terminal(Some(&link(1))).unwrap();
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| serve(&mut robot, &mut door, |_| over.load(Ordering::SeqCst)).unwrap());
        let _ends = Ends(&over);
        let before = pioneer.packets();
        let messages = until(&mut pioneer, |pioneer, message| pioneer.packets() >= before + 10 && is_scan(message));
        assert!(messages[0].0 >= last && messages.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        assert!(messages.iter().all(|(_, message)| !matches!(message, Message::Robot(_))));
    });
    drop((pioneer, door));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Whoever drives must go on to say so.
#[test]
fn a_command_to_drive_counts_for_a_moment() {
    let Some(mut door) = terminal(None) else { return };
    let over = AtomicBool::new(false);
    let port = door.name();
    thread::scope(|scope| {
        scope.spawn(|| serve(&mut driven(), &mut door, |_| over.load(Ordering::SeqCst)).unwrap());
        let _ends = Ends(&over);
        let mut pioneer = driver(port, true);
        until(&mut pioneer, |pioneer, _| pioneer.packets() >= 5);
        let told = pioneer.command(Command::Drive { v_mps: 0.2, w_radps: 0.0 }).unwrap();
        assert_eq!(told, "drives at 0.2 m/s and 0 rad/s for 0.3 s");
        let too_fast = pioneer.command(Command::Drive { v_mps: 3.0, w_radps: 0.0 }).unwrap_err().to_string();
        assert_eq!(too_fast, "speed 3 m/s: expected at most 0.75 m/s either way");
        let moves = |message: &Message| matches!(message, Message::Odometry(odometry) if odometry.v_mps > 0.02);
        until(&mut pioneer, |_, message| moves(message));
        until(&mut pioneer, |_, message| matches!(message, Message::Odometry(odometry) if odometry.v_mps == 0.0));
    });
}
