//! What the tests of the families share.

use core::f64::consts::PI;
use core::fmt::Debug;

use echogrid_core::{Incidents, Pose2};
use proptest::prelude::*;

use super::Fault;
use crate::wire::Wire;

pub(crate) fn pose() -> impl Strategy<Value = Pose2> {
    (-3e7..=3e7, -3e7..=3e7, -PI..=PI).prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
}

pub(crate) fn number() -> impl Strategy<Value = f64> {
    prop::num::f64::NORMAL | prop::num::f64::ZERO | prop::num::f64::SUBNORMAL
}

pub(crate) fn amount() -> impl Strategy<Value = f64> {
    number().prop_map(f64::abs)
}

pub(crate) fn incidents() -> impl Strategy<Value = Incidents> {
    (any::<(u32, u64)>(), amount(), amount()).prop_map(|((count, first_ns), largest_m, largest_rad)| Incidents {
        count,
        first_ns,
        largest_m,
        largest_rad,
    })
}

/// Sent and received; a message that was refused has failed the test.
pub(crate) fn sent<W, M>(message: &M) -> M
where
    W: for<'a> From<&'a M>,
    M: for<'a> TryFrom<&'a W>,
    for<'a> <M as TryFrom<&'a W>>::Error: Debug,
{
    M::try_from(&W::from(message)).unwrap()
}

/// A wire type of these bytes, as shared memory would hold it; too few are taken again.
fn wire_of<W: Wire>(bytes: &[u8]) -> W {
    let mut wire = W::default();
    for (i, byte) in bytes.iter().cycle().take(size_of::<W>()).enumerate() {
        // SAFETY: in bounds; wire types are `repr(C)` of numbers and arrays of them, which any bits are.
        unsafe { (&raw mut wire).cast::<u8>().add(i).write(*byte) };
    }
    wire
}

/// Whatever arrives is taken or refused; and what is taken goes out as something that is taken, too.
pub(crate) fn survives<W, M>(bytes: &[u8])
where
    W: Wire + for<'a> From<&'a M>,
    M: for<'a> TryFrom<&'a W>,
    for<'a> <M as TryFrom<&'a W>>::Error: Debug,
{
    if let Ok(message) = M::try_from(&wire_of::<W>(bytes)) {
        sent::<W, M>(&message);
    }
}

/// Bytes as a faulty peer might leave them: many are 0 or 1.
pub(crate) fn any_bytes() -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(prop_oneof![Just(0_u8), Just(1), any::<u8>()], 1..700)
}

/// A good message with one wrong value is refused, and the fault names that field.
pub(crate) fn refused<W, M>(good: W, field: &str, spoil: impl FnOnce(&mut W))
where
    W: Wire,
    M: Debug + for<'a> TryFrom<&'a W, Error = Fault>,
{
    let mut wire = good;
    spoil(&mut wire);
    let fault = M::try_from(&wire).unwrap_err();
    assert_eq!(fault.field, field, "{fault}");
    assert!(fault.to_string().starts_with(&format!("{field} = ")) && !fault.expected.is_empty(), "{fault}");
}
