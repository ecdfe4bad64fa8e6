//! A session over a line in virtual time: opened whatever the line was before, kept up, found again, and never left behind.

use std::time::Duration;

use echogrid_arcos::{Baud, Command, Configuration};
use echogrid_core::noise::Draws;
use echogrid_pioneer::emulator::Emulator;
use echogrid_pioneer::{Event, Out, Session, SessionSettings};
use echogrid_simulator::{Motion, Simulator};

use crate::emulator;

const STEP: Duration = Duration::from_millis(10);

/// What the line does to the bytes that go over it.
type Damage<'a> = dyn FnMut(Duration, Vec<u8>) -> Vec<u8> + 'a;

struct Line {
    session: Session,
    robot: Emulator<Simulator>,
    now: Duration,
    events: Vec<Event>,
    bauds: Vec<Baud>,
    sent: Vec<u8>,
}

impl Line {
    fn new(motors: bool) -> Self {
        let bauds = vec![Baud::B9600, Baud::B38400];
        let session = Session::new(SessionSettings { motors, bauds, silence: Duration::from_secs(1) });
        let robot = emulator(vec![Motion::Straight { metres: 2.0 }, Motion::Turn { radians: 1.0 }]);
        let mut line = Self { session, robot, now: Duration::ZERO, events: vec![], bauds: vec![], sent: vec![] };
        line.session.begin(line.now);
        line
    }

    fn run(&mut self, seconds: f64, damage: &mut Damage<'_>) {
        let until = self.now + Duration::from_secs_f64(seconds);
        while self.now < until {
            self.now += STEP;
            let mut sent = Vec::new();
            while let Some(out) = self.session.next_out() {
                match out {
                    Out::Bytes(bytes) => sent.extend(bytes),
                    Out::Baud(baud) => self.bauds.push(baud),
                }
            }
            self.sent.extend(&sent);
            let sent = damage(self.now, sent);
            let answer = self.robot.step(&sent, self.now).unwrap();
            let answer = damage(self.now, answer);
            self.session.take(&answer, self.now);
            self.events.extend(std::iter::from_fn(|| self.session.next_event()));
        }
    }

    fn sips(&self) -> usize {
        self.events.iter().filter(|event| matches!(event, Event::Sip { .. })).count()
    }

    fn opened(&self) -> Vec<bool> {
        let opened = self.events.iter().filter_map(|event| match event {
            Event::Opened { was_open, .. } => Some(*was_open),
            _ => None,
        });
        opened.collect()
    }

    fn told(&self, packet: &echogrid_arcos::Packet) -> bool {
        self.sent.windows(packet.bytes().len()).any(|bytes| bytes == packet.bytes())
    }
}

fn whole(_: Duration, bytes: Vec<u8>) -> Vec<u8> {
    bytes
}

#[test]
fn a_session_is_opened_kept_up_and_closed() {
    let mut line = Line::new(false);
    line.run(10.0, &mut whole);
    assert_eq!(line.opened(), [false]);
    let told = |event: &Event| matches!(event, Event::Configured(Configuration { watchdog_ms: 2000, .. }));
    assert_eq!(line.events.iter().filter(|event| told(event)).count(), 1);
    // None is lost, and none made up.
    assert_eq!(line.sips() as u64, line.robot.sips());
    assert!(line.sips() > 90, "{}", line.sips());
    assert!(line.told(&Command::Enable.with(0)) && !line.told(&Command::Enable.with(1)));
    assert!(line.sent.windows(6).filter(|bytes| *bytes == Command::Pulse.plain().bytes()).count() >= 18);
    line.session.close();
    line.run(0.1, &mut whole);
    assert!(!line.robot.is_open());
    assert!(line.told(&Command::Close.with(1)));
}

#[test]
fn motors_are_turned_on_when_asked() {
    let mut line = Line::new(true);
    line.run(2.0, &mut whole);
    assert!(line.told(&Command::Enable.with(1)));
}

/// Whoever was connected before left the session open: it is gone on with where the robot says who it is.
#[test]
fn an_open_session_is_gone_on_with() {
    let mut line = Line::new(false);
    line.run(2.0, &mut whole);
    let mut other = Line::new(false);
    std::mem::swap(&mut other.robot, &mut line.robot);
    other.now = line.now;
    other.session.begin(other.now);
    other.run(2.0, &mut whole);
    assert_eq!(other.opened(), [true]);
    assert!(other.sips() > 10 && !other.told(&Command::Close.with(1)));
    // One that never says who it is, is closed and opened anew.
    let mut third = Line::new(false);
    std::mem::swap(&mut third.robot, &mut other.robot);
    third.now = other.now;
    third.session.begin(third.now);
    let config = Command::Config.with(1);
    third.run(5.0, &mut |_, mut bytes| {
        while let Some(at) = bytes.windows(9).position(|bytes| bytes == config.bytes()) {
            bytes.drain(at..at + 9);
        }
        bytes
    });
    assert_eq!(third.opened(), [false]);
    assert!(third.told(&Command::Close.with(1)) && third.sips() > 10);
}

#[test]
fn a_line_that_is_cut_is_found_again_and_the_robot_counts_on() {
    let mut line = Line::new(false);
    let mut cut = |now: Duration, bytes: Vec<u8>| if (3..6).contains(&now.as_secs()) { vec![] } else { bytes };
    line.run(4.0, &mut cut);
    assert!(line.events.contains(&Event::Silent));
    let before = line.sips();
    line.run(6.0, &mut cut);
    assert!(line.sips() > before + 20);
    // Opened anew here, as it is called while it may not hear; a port that was closed meanwhile is listened to first.
    assert!(line.opened().len() >= 2);
    line.session.begin(line.now);
    line.events.clear();
    line.run(1.0, &mut cut);
    assert_eq!(line.opened(), [true]);
}

#[test]
fn noise_and_silence_before_the_first_word_are_survived() {
    let mut draws = Draws::new(3, "noise");
    let mut line = Line::new(false);
    line.run(8.0, &mut |now, bytes| match now.as_secs() {
        0..2 => (0..20).map(|_| (draws.uniform() * 256.0) as u8).collect(),
        2..4 => vec![],
        _ => bytes,
    });
    assert_eq!(line.opened(), [false]);
    assert!(line.sips() > 10);
}

/// Bytes dropped, flipped and merged, both ways, two of a hundred; then none: nothing is left of it.
#[test]
fn a_bad_line_is_worked_over() {
    let mut draws = Draws::new(5, "faults");
    let mut line = Line::new(false);
    line.run(30.0, &mut |_, bytes| {
        let mut out = Vec::new();
        for byte in bytes {
            match (draws.uniform() * 300.0) as u32 {
                0 => {}
                1 => out.push(byte ^ (1 << ((draws.uniform() * 8.0) as u32))),
                2 => out.extend([byte, byte]),
                _ => out.push(byte),
            }
        }
        out
    });
    assert!(line.sips() > 60, "{}", line.sips());
    let before = line.robot.sips();
    line.events.clear();
    line.run(3.0, &mut whole);
    assert!(line.sips() as u64 + 2 >= line.robot.sips() - before && line.sips() >= 28, "{}", line.sips());
}

#[test]
fn the_speed_of_the_line_is_changed_and_changed_back_where_nobody_follows() {
    let mut line = Line::new(false);
    line.session.switch_to(Baud::B38400);
    line.run(3.0, &mut whole);
    assert_eq!((line.bauds.clone(), line.session.baud()), (vec![Baud::B38400], Baud::B38400));
    assert!(line.sips() > 15);

    let mut deaf = Line::new(false);
    deaf.session.switch_to(Baud::B38400);
    let mut opened = None;
    deaf.run(5.0, &mut |now, bytes| {
        if bytes.windows(2).any(|pair| pair == [0x32, 0x3B]) {
            opened = Some(now);
        }
        // It changed its speed in vain, and is not understood at the new one.
        if opened.is_some_and(|at| now < at + Duration::from_millis(900)) { vec![] } else { bytes }
    });
    assert_eq!(deaf.bauds, [Baud::B38400, Baud::B9600]);
    assert!(deaf.sips() > 10, "{}", deaf.sips());
}

/// It is where it was after all that: no call is left unanswered for ever.
#[test]
fn a_robot_at_another_speed_is_found() {
    let mut line = Line::new(false);
    let mut heard = false;
    line.run(4.0, &mut |_, bytes| {
        heard |= !bytes.is_empty();
        vec![]
    });
    assert!(heard && line.bauds.contains(&Baud::B38400));
    line.run(3.0, &mut whole);
    assert_eq!(line.opened(), [false]);
}
