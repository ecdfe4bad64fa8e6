//! Any bytes as what a program prints: events of transducers that there are, in numbers that the mapper takes.
#![no_main]

use echogrid_core::Echo;
use echogrid_formats::log::LogEvent;
use echogrid_formats::log::carmen::{LineStream, PrintedLine, PrintedLines, RangeUnit};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let (is_live, bytes) = bytes.split_first().map_or((false, bytes), |(first, rest)| (first % 2 == 1, rest));
    let mut stream = LineStream::new("fuzz", RangeUnit::Metres, None);
    let Ok(mut lines) = PrintedLines::new(bytes) else { return };
    let check = |stream: &mut LineStream| {
        while let Some(event) = stream.pop() {
            let robot = stream.robot().expect("events are of a robot");
            match event {
                LogEvent::Odometry { odom_from_base, .. } => assert!(odom_from_base.is_finite()),
                LogEvent::TruePose { map_from_base, .. } => assert!(map_from_base.is_finite()),
                LogEvent::Scan { readings, .. } => {
                    assert!(readings.iter().all(|reading| robot.transducer(reading.transducer).is_some()));
                    let is_sane = |echo| !matches!(echo, Echo::Hit { range_m } if !(0.0..=1e5).contains(&range_m));
                    assert!(readings.iter().all(|reading| is_sane(reading.echo)));
                }
            }
        }
    };
    while let Ok(Some(line)) = lines.next_line() {
        let arrived_ns = is_live.then_some(line.number * 1_000_000);
        if stream.push(PrintedLine { arrived_ns, ..line }).is_err() {
            return;
        }
        check(&mut stream);
    }
    let _ = stream.finish();
    check(&mut stream);
});
