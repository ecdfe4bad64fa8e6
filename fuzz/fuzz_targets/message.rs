//! Any bytes as a message in shared memory: what is taken holds finite numbers alone, and goes out as something that is taken
//! again and is the same. The first byte says which message; what the others leave open is zero.
#![no_main]

use core::fmt::Debug;

use echogrid_core::{Reading, Robot, Verdict};
use echogrid_topics::contract::{
    EstimateWire, FixWire, HealthWire, IncidentsWire, LocalizationRequestWire, MapInfoWire,
    OdometryRawWire, ReadingWire, RobotWire, SensorWire, TileWire, TruePoseWire, TrueWorldWire, VerdictWire,
};
use echogrid_topics::control::ControlRequestWire;
use echogrid_topics::wire::{Field, Wire};
use echogrid_topics::{
    Command, Health, LocalizationFix, LocalizationRequest, MapInfo, PoseEstimate, RawOdometry, TileUpdate, TruePose,
    TrueWorld,
};
use libfuzzer_sys::fuzz_target;

/// These bytes as shared memory would hold them.
fn wire_of<W: Wire>(bytes: &[u8]) -> W {
    let mut wire = W::default();
    let length = bytes.len().min(size_of::<W>());
    // SAFETY: in bounds; wire types are `repr(C)` of numbers and arrays of them, which any bits are.
    unsafe { (&raw mut wire).cast::<u8>().copy_from_nonoverlapping(bytes.as_ptr(), length) };
    wire
}

fn bytes_of<W: Wire>(wire: &W) -> &[u8] {
    // SAFETY: in bounds; wire types hold no padding (a test of theirs says so).
    unsafe { core::slice::from_raw_parts((&raw const *wire).cast(), size_of::<W>()) }
}

/// Every number of these fields must be finite; a cell of a tile may be unknown.
fn check_numbers(fields: &[Field], bytes: &[u8]) {
    for Field { name, ty, offset, .. } in fields {
        let (ty, count) = ty.trim_matches(['[', ']']).split_once("; ").unwrap_or((ty, "1"));
        let count: usize = count.parse().expect("a length");
        let at = &bytes[*offset..];
        match ty {
            "f64" => {
                let numbers = at.chunks_exact(8).take(count);
                let numbers = numbers.map(|bytes| f64::from_le_bytes(bytes.try_into().expect("eight bytes")));
                numbers.for_each(|number| assert!(number.is_finite(), "{name}"));
            }
            "f32" => {
                let numbers = at.chunks_exact(4).take(count);
                let numbers = numbers.map(|bytes| f32::from_le_bytes(bytes.try_into().expect("four bytes")));
                numbers.for_each(|number| assert!(!number.is_infinite(), "{name}"));
            }
            "SensorWire" => {
                let sensors = at.chunks_exact(size_of::<SensorWire>()).take(count);
                sensors.for_each(|bytes| check_numbers(SensorWire::LAYOUT.fields, bytes));
            }
            "IncidentsWire" => check_numbers(IncidentsWire::LAYOUT.fields, at),
            "EstimateWire" => check_numbers(EstimateWire::LAYOUT.fields, at),
            "u8" | "u16" | "u32" | "u64" | "i32" | "AckWire" => {}
            other => panic!("{name} is of a type that nobody checks: {other}"),
        }
    }
}

fn check<W, M>(bytes: &[u8])
where
    W: Wire + for<'a> From<&'a M>,
    M: for<'a> TryFrom<&'a W>,
    for<'a> <M as TryFrom<&'a W>>::Error: Debug,
{
    let Ok(message) = M::try_from(&wire_of::<W>(bytes)) else { return };
    let sent = W::from(&message);
    check_numbers(W::LAYOUT.fields, bytes_of(&sent));
    let again = W::from(&M::try_from(&sent).expect("what was taken can be sent"));
    // As bytes: a cell that is unknown equals nothing.
    assert_eq!(bytes_of(&again), bytes_of(&sent));
}

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    match kind % 13 {
        0 => check::<RobotWire, Robot>(bytes),
        1 => check::<OdometryRawWire, RawOdometry>(bytes),
        2 => check::<ReadingWire, Reading>(bytes),
        3 => check::<EstimateWire, PoseEstimate>(bytes),
        4 => check::<TileWire, TileUpdate>(bytes),
        5 => check::<MapInfoWire, MapInfo>(bytes),
        6 => check::<VerdictWire, (u16, Verdict)>(bytes),
        7 => check::<HealthWire, Health>(bytes),
        8 => check::<TruePoseWire, TruePose>(bytes),
        9 => check::<TrueWorldWire, TrueWorld>(bytes),
        10 => check::<LocalizationRequestWire, LocalizationRequest>(bytes),
        11 => check::<FixWire, LocalizationFix>(bytes),
        _ => {
            let request: ControlRequestWire = wire_of(bytes);
            if let Some(Command::Fix(fix)) = Command::of(&request)
                && fix.validate().is_ok()
            {
                assert!(fix.pose.is_finite() && fix.covariance.iter().all(|value| value.is_finite()));
            }
        }
    }
});
