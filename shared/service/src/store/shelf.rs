//! What a store lies on: tables of bytes by bytes, changed together or not at all.

use anyhow::Result;

/// A table of a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Table {
    /// One entry: the run that the store is of.
    Run,
    /// Generation → a snapshot.
    Snapshots,
    /// Number → what took effect and can't be read once more.
    Journal,
    /// The parts of the latest state.
    Parts,
    /// Generation and name of a part → what the part was before, where older states may be gone back to.
    Undo,
    /// Number → a message of a sensor that can't give it again.
    Spool,
    /// Code of a topic → the last of its messages that is not in the spool any more.
    Trimmed,
}

impl Table {
    /// Every table of the shelf.
    pub const ALL: [Self; 7] =
        [Self::Run, Self::Snapshots, Self::Journal, Self::Parts, Self::Undo, Self::Spool, Self::Trimmed];

    /// The name of the table on the shelf.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Snapshots => "snapshots",
            Self::Journal => "journal",
            Self::Parts => "parts",
            Self::Undo => "undo",
            Self::Spool => "spool",
            Self::Trimmed => "trimmed",
        }
    }
}

/// A value that is put, or removed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// The table that is changed.
    pub table: Table,
    /// The key of the value in the table.
    pub key: Vec<u8>,
    /// The value that is put; none: it is removed.
    pub value: Option<Vec<u8>>,
}

impl Change {
    /// A change that puts a value.
    #[must_use]
    pub fn put(table: Table, key: Vec<u8>, value: Vec<u8>) -> Self {
        Self { table, key, value: Some(value) }
    }

    /// A change that removes a value.
    #[must_use]
    pub fn remove(table: Table, key: Vec<u8>) -> Self {
        Self { table, key, value: None }
    }
}

/// What a store lies on.
pub trait Shelf: core::fmt::Debug {
    /// The value under a key.
    ///
    /// # Errors
    /// The store is broken.
    fn get(&self, table: Table, key: &[u8]) -> Result<Option<Vec<u8>>>;

    /// Keys and values from a key on, in order.
    ///
    /// # Errors
    /// The store is broken.
    fn range(&self, table: Table, from: &[u8]) -> Result<Vec<(Vec<u8>, Vec<u8>)>>;

    /// The last key.
    ///
    /// # Errors
    /// The store is broken.
    fn last(&self, table: Table) -> Result<Option<Vec<u8>>>;

    /// Changes all of this, or nothing.
    ///
    /// # Errors
    /// The disk is full, or the store is broken: what was stored before is intact.
    fn commit(&mut self, changes: Vec<Change>) -> Result<()>;
}
