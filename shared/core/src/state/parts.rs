//! A state as bytes in named parts, so that it can outlive the process that holds it.
//!
//! A state that is saved again gives only the parts that changed: whoever keeps them applies those to what it has.

use core::ops::Bound;
use std::collections::BTreeMap;

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Of the checksum that ends a part.
const CHECKSUM_BYTES: usize = 4;

/// What of a state changed since it was saved last: named parts, each whole.
#[derive(Debug, Default)]
pub struct Parts {
    changed: BTreeMap<String, Option<Vec<u8>>>,
}

impl Parts {
    /// Sets a part to `bytes`.
    pub fn put(&mut self, name: impl Into<String>, bytes: Vec<u8>) {
        self.changed.insert(name.into(), Some(bytes));
    }

    /// Sets a part to `bytes`, which [`Saved::checked`] gives back if they are still the same.
    pub fn put_checked(&mut self, name: impl Into<String>, mut bytes: Vec<u8>) {
        let name = name.into();
        let checksum = checksum(&name, &bytes);
        bytes.extend_from_slice(&checksum);
        self.put(name, bytes);
    }

    /// Sets a part to `value`, which [`Saved::value`] gives back, every bit of it.
    pub fn put_value<T: Serialize>(&mut self, name: impl Into<String>, value: &T) {
        self.put_checked(name, to_bytes(value));
    }

    /// Removes a part.
    pub fn remove(&mut self, name: impl Into<String>) {
        self.changed.insert(name.into(), None);
    }

    /// Every part that changed; none: it is gone.
    #[must_use]
    pub fn into_changes(self) -> BTreeMap<String, Option<Vec<u8>>> {
        self.changed
    }
}

/// A saved state, whole.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Saved {
    parts: BTreeMap<String, Vec<u8>>,
}

/// A saved state that can't be gone on from.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("saved state: {part}: {problem}")]
pub struct SavedError {
    /// The part that is wrong.
    pub part: String,
    /// What is wrong with it.
    pub problem: String,
}

impl SavedError {
    /// An error that names the part and what is wrong with it.
    #[must_use]
    pub fn new(part: impl Into<String>, problem: impl Into<String>) -> Self {
        Self { part: part.into(), problem: problem.into() }
    }
}

impl Saved {
    /// The state of these parts.
    #[must_use]
    pub fn from_parts(parts: BTreeMap<String, Vec<u8>>) -> Self {
        Self { parts }
    }

    /// What it is after these changes.
    pub fn apply(&mut self, changes: BTreeMap<String, Option<Vec<u8>>>) {
        for (name, bytes) in changes {
            match bytes {
                Some(bytes) => self.parts.insert(name, bytes),
                None => self.parts.remove(&name),
            };
        }
    }

    /// A part as it was put.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&[u8]> {
        self.parts.get(name).map(Vec::as_slice)
    }

    /// A part that was put with a checksum.
    ///
    /// # Errors
    /// It is not there, or not what was put.
    pub fn checked(&self, name: &str) -> Result<&[u8], SavedError> {
        let all = self.get(name).ok_or_else(|| SavedError::new(name, "missing"))?;
        let cut = all.len().checked_sub(CHECKSUM_BYTES);
        let (bytes, checksum_then) =
            cut.map(|cut| all.split_at(cut)).ok_or_else(|| SavedError::new(name, "cut short"))?;
        if checksum(name, bytes) == checksum_then {
            Ok(bytes)
        } else {
            Err(SavedError::new(name, "damaged: its checksum does not fit"))
        }
    }

    /// A part that was put as a value.
    ///
    /// # Errors
    /// It is not there, or no such value.
    pub fn value<T: DeserializeOwned>(&self, name: &str) -> Result<T, SavedError> {
        let (value, rest) = take_value(name, self.checked(name)?)?;
        if rest.is_empty() { Ok(value) } else { Err(SavedError::new(name, "longer than what it is to be")) }
    }

    /// The parts whose names begin so, in the order of their names.
    pub fn under(&self, prefix: &str) -> impl Iterator<Item = (&str, &[u8])> {
        let from = self.parts.range::<str, _>((Bound::Included(prefix), Bound::Unbounded));
        from.take_while(move |(name, _)| name.starts_with(prefix))
            .map(|(name, bytes)| (name.as_str(), bytes.as_slice()))
    }
}

/// The first value of `bytes`, which are of this part, and what comes after it.
pub(crate) fn take_value<'a, T: DeserializeOwned>(part: &str, bytes: &'a [u8]) -> Result<(T, &'a [u8]), SavedError> {
    postcard::take_from_bytes(bytes).map_err(|e| SavedError::new(part, e.to_string()))
}

/// One value after the other: see [`take_value`].
pub(crate) fn to_bytes<T: Serialize>(value: &T) -> Vec<u8> {
    append_value(Vec::new(), value)
}

/// `bytes` with a value after them.
pub(crate) fn append_value<T: Serialize>(bytes: Vec<u8>, value: &T) -> Vec<u8> {
    #[expect(clippy::expect_used, reason = "the values of a state are plain data, and a Vec takes any number of bytes")]
    postcard::to_extend(value, bytes).expect("plain data")
}

/// Of a part and its name: neither may be another's.
fn checksum(name: &str, bytes: &[u8]) -> [u8; CHECKSUM_BYTES] {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(name.as_bytes());
    hasher.update(bytes);
    hasher.finalize().to_le_bytes()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn saved(parts: Parts) -> Saved {
        let mut saved = Saved::default();
        saved.apply(parts.into_changes());
        saved
    }

    #[test]
    fn what_is_put_is_there_until_it_is_removed() {
        let mut parts = Parts::default();
        parts.put("b/1", vec![1]);
        parts.put("b/2", vec![2, 3]);
        parts.put("c", Vec::new());
        let mut all = saved(parts);
        assert_eq!(all.under("b/").collect::<Vec<_>>(), [("b/1", &[1_u8][..]), ("b/2", &[2, 3])]);
        let mut parts = Parts::default();
        parts.put("b/1", vec![9]);
        parts.remove("b/2");
        all.apply(parts.into_changes());
        assert_eq!((all.get("b/1"), all.get("b/2"), all.get("c")), (Some(&[9_u8][..]), None, Some(&[][..])));
    }

    #[test]
    fn an_error_names_the_part() {
        assert_eq!(Saved::default().value::<u8>("odometry").unwrap_err().to_string(), "saved state: odometry: missing");
    }

    /// A list that claims to be longer than memory.
    #[test]
    fn a_false_length_is_an_error() {
        let mut parts = Parts::default();
        parts.put_value("list", &u64::MAX);
        let parts = saved(parts);
        assert_eq!(parts.value::<Vec<(f64, u64)>>("list").unwrap_err().part, "list");
        assert_eq!(parts.value::<String>("list").unwrap_err().part, "list");
    }

    proptest! {
        #[test]
        fn values_come_back_bit_by_bit(value in any::<(u64, i32, Option<bool>, String)>(), bits in any::<(u64, u32)>()) {
            let mut parts = Parts::default();
            parts.put_value("value", &(value.clone(), f64::from_bits(bits.0), f32::from_bits(bits.1)));
            let (back, double, single): ((u64, i32, Option<bool>, String), f64, f32) = saved(parts).value("value").unwrap();
            prop_assert_eq!((back, double.to_bits(), single.to_bits()), (value, bits.0, bits.1));
        }

        #[test]
        fn damage_is_noticed(values in prop::collection::vec(any::<f64>(), 0..9), at in any::<prop::sample::Index>(), flip in 1..=255_u8, cut in any::<bool>()) {
            let mut parts = Parts::default();
            parts.put_value("values", &values);
            let mut bytes = parts.into_changes().remove("values").unwrap().unwrap();
            let at = at.index(bytes.len());
            if cut { bytes.truncate(at) } else { bytes[at] ^= flip }
            let damaged = Saved::from_parts([("values".to_owned(), bytes)].into());
            prop_assert_eq!(damaged.value::<Vec<f64>>("values").unwrap_err().part, "values");
        }

        #[test]
        fn one_part_is_not_another(value in any::<u64>()) {
            let mut parts = Parts::default();
            parts.put_value("one", &value);
            let bytes = parts.into_changes().remove("one").unwrap().unwrap();
            let swapped = Saved::from_parts([("other".to_owned(), bytes)].into());
            prop_assert!(swapped.value::<u64>("other").is_err());
        }
    }
}
