//! How a list is saved that grows at its end, loses its oldest entries, and now and then has one replaced: in chunks, of which only
//! those are written again that changed.

use std::collections::{BTreeSet, VecDeque};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::parts::{Parts, Saved, SavedError, append_value, take_value, to_bytes};

/// What of a list is saved. Entries have places, counted from the first that the list ever had.
#[derive(Debug, Clone)]
pub struct Chunks {
    /// Entries of a chunk.
    size: u64,
    /// The first chunk that is saved.
    first: u64,
    /// The place after the last entry that is saved.
    end: u64,
    /// Chunks with entries that were replaced since.
    replaced: BTreeSet<u64>,
}

impl Chunks {
    /// The chunks of a list of which nothing is saved, with so many entries to a chunk.
    #[must_use]
    pub fn new(size: u64) -> Self {
        Self { size: size.max(1), first: 0, end: 0, replaced: BTreeSet::new() }
    }

    /// The entry at `place` is another now.
    pub fn replace(&mut self, place: u64) {
        if place < self.end {
            self.replaced.insert(place / self.size);
        }
    }

    /// Saves what changed of `entries`, the first of which is at `begin`, under names that begin with `prefix`.
    pub fn save<T: Serialize>(&mut self, parts: &mut Parts, prefix: &str, begin: u64, entries: &VecDeque<T>) {
        let end = begin + entries.len() as u64;
        let first = first_chunk(self.size, begin, end);
        let mut changed = std::mem::take(&mut self.replaced);
        if end > self.end {
            changed.extend(self.end.max(begin) / self.size..end.div_ceil(self.size));
        }
        for chunk in self.first..first.min(self.end.div_ceil(self.size)) {
            parts.remove(name(prefix, chunk));
        }
        for chunk in changed.range(first..) {
            let from = begin.max(chunk * self.size);
            let to = end.min((chunk + 1) * self.size);
            let entries = entries.range((from - begin) as usize..(to - begin) as usize);
            parts.put_checked(name(prefix, *chunk), entries.fold(to_bytes(&from), append_value));
        }
        (self.first, self.end) = (first, end);
    }

    /// The entries from `begin` to before `end` of a list that was saved in chunks of this size.
    ///
    /// # Errors
    /// A chunk is missing, or not what it should be.
    pub fn restore<T: DeserializeOwned>(
        size: u64,
        saved: &Saved,
        prefix: &str,
        begin: u64,
        end: u64,
    ) -> Result<(Self, VecDeque<T>), SavedError> {
        let size = size.max(1);
        let mut entries = VecDeque::new();
        let mut place = begin;
        while place < end {
            let chunk = place / size;
            let name = name(prefix, chunk);
            let (from, mut bytes): (u64, _) = take_value(&name, saved.checked(&name)?)?;
            let mut at = from;
            while !bytes.is_empty() {
                let (entry, rest) = take_value(&name, bytes)?;
                if (place..end).contains(&at) {
                    entries.push_back(entry);
                }
                (at, bytes) = (at.saturating_add(1), rest);
            }
            let until = end.min((chunk + 1).saturating_mul(size));
            if from > place || at != until {
                return Err(SavedError::new(name, format!("entries {from} to {at} instead of {place} to {until}")));
            }
            place = until;
        }
        Ok((
            Self { size, first: first_chunk(size, begin, end), end: end.max(begin), replaced: BTreeSet::new() },
            entries,
        ))
    }
}

/// The first chunk that holds an entry; of an empty list none does, not even the one that its end lies in.
fn first_chunk(size: u64, begin: u64, end: u64) -> u64 {
    if begin < end { begin / size } else { begin.div_ceil(size) }
}

fn name(prefix: &str, chunk: u64) -> String {
    format!("{prefix}{chunk}")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SIZE: u64 = 4;

    #[derive(Debug, Clone)]
    enum Deed {
        Push(u16),
        Forget,
        Replace(prop::sample::Index, u16),
        Save,
    }

    fn deeds() -> impl Strategy<Value = Vec<Deed>> {
        let deed = prop_oneof![
            6 => any::<u16>().prop_map(Deed::Push),
            4 => Just(Deed::Forget),
            2 => (any::<prop::sample::Index>(), any::<u16>()).prop_map(|(at, value)| Deed::Replace(at, value)),
            2 => Just(Deed::Save),
        ];
        prop::collection::vec(deed, 0..120)
    }

    proptest! {
        /// Whatever happens between saves, and with a restart at every one of them.
        #[test]
        fn what_is_saved_is_the_list(deeds in deeds(), restarts in any::<bool>()) {
            let (mut list, mut begin, mut chunks) = (VecDeque::<u16>::new(), 0, Chunks::new(SIZE));
            let mut saved = Saved::default();
            for deed in deeds {
                match deed {
                    Deed::Push(value) => list.push_back(value),
                    Deed::Forget => begin += u64::from(list.pop_front().is_some()),
                    Deed::Replace(at, value) => if !list.is_empty() {
                        let at = at.index(list.len());
                        list[at] = value;
                        chunks.replace(begin + at as u64);
                    },
                    Deed::Save => {
                        let mut parts = Parts::default();
                        chunks.save(&mut parts, "list/", begin, &list);
                        saved.apply(parts.into_changes());
                        let end = begin + list.len() as u64;
                        let (restored, back) = Chunks::restore::<u16>(SIZE, &saved, "list/", begin, end).unwrap();
                        prop_assert_eq!(&back, &list);
                        prop_assert!(saved.under("list/").count() as u64 <= end.div_ceil(SIZE) - begin / SIZE + 1);
                        if restarts {
                            chunks = restored;
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn only_what_changed_is_written() {
        let mut chunks = Chunks::new(SIZE);
        let mut list: VecDeque<u8> = (0..10).collect();
        let mut save = |begin: u64, list: &VecDeque<u8>, replaced: Option<u64>| -> Vec<(String, bool)> {
            replaced.into_iter().for_each(|place| chunks.replace(place));
            let mut parts = Parts::default();
            chunks.save(&mut parts, "", begin, list);
            parts.into_changes().into_iter().map(|(name, bytes)| (name, bytes.is_some())).collect()
        };
        let names = |of: &[(&str, bool)]| of.iter().map(|(name, put)| ((*name).to_owned(), *put)).collect::<Vec<_>>();
        assert_eq!(save(0, &list, None), names(&[("0", true), ("1", true), ("2", true)]));
        assert_eq!(save(0, &list, None), []);
        list.push_back(10);
        assert_eq!(save(0, &list, Some(1)), names(&[("0", true), ("2", true)]));
        list.drain(..5);
        assert_eq!(save(5, &list, Some(1)), names(&[("0", false)]));
    }

    #[test]
    fn a_chunk_that_is_not_what_it_should_be_is_named() {
        let mut parts = Parts::default();
        Chunks::new(SIZE).save(&mut parts, "list/", 0, &(0..10_u8).collect());
        let mut saved = Saved::default();
        saved.apply(parts.into_changes());
        let restore = |saved: &Saved, begin, end| Chunks::restore::<u8>(SIZE, saved, "list/", begin, end);
        assert_eq!(restore(&saved, 0, 9).unwrap_err().part, "list/2");
        assert_eq!(restore(&saved, 0, u64::MAX).unwrap_err().part, "list/2");
        assert_eq!(restore(&saved, u64::MAX - 1, u64::MAX).unwrap_err().problem, "missing");
        assert_eq!(restore(&saved, 9, 3).unwrap().1.len(), 0);
    }
}
