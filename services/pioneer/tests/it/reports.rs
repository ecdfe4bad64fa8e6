//! What the robot tells, as what every sensor promises; and as what is true.

use std::time::Duration;

use anyhow::Result;
use echogrid_arcos::{Command, Decoder, Parameters, Sip};
use echogrid_core::{Echo, Reading};
use echogrid_pioneer::{OUTPUTS, Reports};
use echogrid_service::{Sensor, conformance};
use echogrid_simulator::Motion;
use echogrid_topics::{Message, Topic};

use crate::{emulator, robot, simulator};

/// Packets as they came once.
struct Recording(std::collections::VecDeque<(u64, Message)>);

impl Recording {
    fn new(parameters: &Parameters, sips: &[(u64, Sip)]) -> Self {
        let mut reports = Reports::new(parameters.clone(), robot());
        let mut messages = std::collections::VecDeque::from([(0, Message::Robot(robot()))]);
        for (stamp_ns, sip) in sips {
            messages.extend(reports.sip(*stamp_ns, sip).unwrap());
        }
        Self(messages)
    }
}

impl Sensor for Recording {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        Ok(self.0.pop_front())
    }
}

/// What an emulated robot tells within this time.
fn sips(motions: Vec<Motion>, seconds: u64) -> (Vec<(u64, Sip)>, Parameters) {
    let mut robot = emulator(motions);
    let mut decoder = Decoder::default();
    let mut sips = Vec::new();
    let mut opening =
        [Command::sync(0), Command::sync(1), Command::sync(2), Command::Open.with(1), Command::Sonar.with(1)];
    opening.iter_mut().for_each(|packet| drop(robot.step(packet.bytes(), Duration::ZERO).unwrap()));
    for millis in (0..seconds * 1000).step_by(100) {
        let bytes = robot.step(Command::Pulse.plain().bytes(), Duration::from_millis(millis)).unwrap();
        decoder.push(&bytes);
        let found = std::iter::from_fn(|| decoder.next_packet());
        sips.extend(found.map(|found| (millis * 1_000_000, Sip::read(&found.packet).unwrap())));
    }
    (sips, echogrid_pioneer::emulator::Who::of("p3at-sh", 40).unwrap().parameters)
}

fn motions() -> Vec<Motion> {
    vec![Motion::Straight { metres: 1.5 }, Motion::Turn { radians: -2.5 }, Motion::Straight { metres: 1.0 }]
}

#[test]
fn it_keeps_what_every_sensor_promises() {
    let (sips, parameters) = sips(motions(), 10);
    let given = conformance::check(|| Ok(Recording::new(&parameters, &sips))).unwrap();
    println!("{given:?}");
    assert_eq!(given.odometry, 99);
    // A ring of sixteen takes 0.32 s.
    assert!((29..=32).contains(&given.scans) && given.readings > 460, "{given:?}");
}

/// Poses and rings are those of the simulator itself, but for whole counts and for when exactly a sonar fired.
#[test]
fn it_tells_what_the_simulator_tells() {
    let (sips, parameters) = sips(motions(), 10);
    let told = Recording::new(&parameters, &sips).0;
    let mut itself = simulator(motions());
    let (mut poses, mut rings) = (Vec::new(), Vec::new());
    while let Some((stamp_ns, message)) = itself.next().unwrap() {
        match message {
            Message::Odometry(odometry) => poses.push((stamp_ns, odometry)),
            Message::Scan(readings) => rings.push((stamp_ns, readings)),
            _ => {}
        }
    }
    let origin = poses[0].1.odom_from_base;
    let truths: Vec<_> = rings
        .iter()
        .flat_map(|(stamp_ns, readings)| readings.iter().map(|reading| (at_ns(*stamp_ns, reading), *reading)))
        .collect();
    let (mut seen, mut heard) = (0, 0);
    for (stamp_ns, message) in told {
        match message {
            Message::Odometry(told) => {
                let Some((_, truth)) = poses.iter().find(|(at_ns, _)| *at_ns == stamp_ns) else { continue };
                let truth_from_start = origin.inverse() * truth.odom_from_base;
                let off = truth_from_start.inverse() * told.odom_from_base;
                assert!(off.x.hypot(off.y) < 0.002 && off.theta.abs() < 0.0016, "{stamp_ns}: {off:?}");
                assert!((told.v_mps - truth.v_mps).abs() < 0.002 && (told.w_radps - truth.w_radps).abs() < 0.01);
                seen += 1;
            }
            Message::Scan(readings) => {
                for told in readings {
                    let told_ns = at_ns(stamp_ns, &told);
                    let same = truths.iter().filter(|(_, truth)| truth.transducer == told.transducer);
                    let (true_ns, truth) = same.min_by_key(|(true_ns, _)| true_ns.abs_diff(told_ns)).unwrap();
                    let late_ns = told_ns - true_ns;
                    assert!(late_ns.abs() <= 25_000_000, "sonar {} is {late_ns} ns late", told.transducer);
                    match (told.echo, truth.echo) {
                        (Echo::Hit { range_m }, Echo::Hit { range_m: truth_m }) => {
                            assert!((range_m - truth_m).abs() < 6e-4);
                        }
                        (Echo::NoEcho, Echo::Hit { range_m }) => assert!(range_m > 4.999),
                        (told, truth) => assert_eq!(told, truth),
                    }
                    heard += 1;
                }
            }
            _ => {}
        }
    }
    // Sixteen in 0.32 s.
    assert!(seen > 80 && heard > 460, "{seen} {heard} {}", truths.len());
}

fn at_ns(stamp_ns: u64, reading: &Reading) -> i64 {
    stamp_ns as i64 + i64::from(reading.offset_ns)
}

#[test]
fn what_cannot_be_is_left_out() {
    let (_, parameters) = sips(vec![], 0);
    let mut reports = Reports::new(parameters, robot());
    let sip = |x: u16, speed: i16| Sip { x, left_speed: speed, right_speed: speed, ..Sip::default() };
    assert!(reports.sip(0, &sip(0, 0)).is_some());
    assert!(reports.sip(100_000_000, &sip(50, 500)).is_some());
    // Twelve metres in a tenth of a second; 30 m/s.
    assert!(reports.sip(200_000_000, &sip(12_050, 500)).is_none());
    assert!(reports.sip(200_000_000, &sip(100, 30_000)).is_none());
    let after = reports.sip(300_000_000, &sip(150, 500)).unwrap();
    assert!(matches!(&after[0], (_, Message::Odometry(told)) if (told.odom_from_base.x - 0.15).abs() < 1e-9));
    // A robot that counts anew has not moved.
    reports.begin_anew();
    let anew = reports.sip(400_000_000, &sip(20_000, 0)).unwrap();
    assert!(matches!(&anew[0], (_, Message::Odometry(told)) if (told.odom_from_base.x - 0.15).abs() < 1e-9));
    let on = reports.sip(500_000_000, &sip(20_010, 0)).unwrap();
    assert!(matches!(&on[0], (_, Message::Odometry(told)) if (told.odom_from_base.x - 0.16).abs() < 1e-9));
}

/// A sonar that is broken keeps no ring from being given out; one that the robot does not have is nobody's.
#[test]
fn a_ring_that_is_never_whole_goes_out() {
    let (_, parameters) = sips(vec![], 0);
    let mut reports = Reports::new(parameters, robot());
    let mut scans = Vec::new();
    for number in 0..40_u64 {
        let sonars = [number % 7, 99].map(|number| echogrid_arcos::SonarRange { number: number as u8, range: 1000 });
        let sip = Sip { sonars: sonars.to_vec(), ..Sip::default() };
        for (stamp_ns, message) in reports.sip(number * 100_000_000, &sip).unwrap() {
            if let Message::Scan(readings) = message {
                assert!(readings.iter().all(|reading| reading.transducer < 7 && reading.offset_ns <= 0));
                scans.push((stamp_ns, readings.len()));
            }
        }
    }
    assert!(scans.len() >= 5, "{scans:?}");
}
