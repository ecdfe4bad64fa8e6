//! When each tile was written to: the one way of knowing what changed, for whoever publishes, saves, sums up or undoes.

use std::collections::BTreeSet;

use super::{Tile, TileIndex};

/// A moment in the life of a grid ([`super::Grid::mark`]). The first one, which is the default, is before all others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Mark(u64);

/// The tiles of a grid by the moment in which they were written to last.
#[derive(Debug, Clone, Default)]
pub(super) struct Changes {
    now: Mark,
    written: BTreeSet<(Mark, TileIndex)>,
}

impl Changes {
    /// The moment that goes on until the next mark.
    pub(super) fn now(&self) -> Mark {
        self.now
    }

    /// Begins another moment.
    pub(super) fn mark(&mut self) -> Mark {
        self.now.0 += 1;
        self.now
    }

    /// A tile that was written to at `last`, if ever, is written to now.
    pub(super) fn note(&mut self, index: TileIndex, last: Option<Mark>) {
        if let Some(last) = last {
            self.written.remove(&(last, index));
        }
        self.written.insert((self.now, index));
    }

    /// The tiles that were written to at `mark` or later, row by row.
    pub(super) fn since(&self, mark: Mark) -> Vec<TileIndex> {
        let mut changed: Vec<TileIndex> = self.written.range((mark, LOWEST)..).map(|(_, index)| *index).collect();
        changed.sort_unstable();
        changed
    }

    /// Whether no tile was written to at `mark` or later.
    pub(super) fn are_none_since(&self, mark: Mark) -> bool {
        self.written.range((mark, LOWEST)..).next().is_none()
    }
}

/// Before all others.
const LOWEST: TileIndex = TileIndex { x: i32::MIN, y: i32::MIN };

/// Tiles as they had been at a moment, in the order in which they were written to first after it; none: there was none.
pub(crate) type TilesBefore = Vec<(TileIndex, Option<Tile>)>;

/// What a grid can be taken back to.
#[derive(Debug, Clone, Default)]
pub(super) struct Undo {
    pub(super) before: TilesBefore,
    /// Whose they are.
    kept: BTreeSet<TileIndex>,
}

impl Undo {
    /// Of which so much is known already.
    pub(super) fn new(before: TilesBefore) -> Self {
        Self { kept: before.iter().map(|(index, _)| *index).collect(), before }
    }

    /// Keeps a tile before it is written to, unless an older one is kept already.
    pub(super) fn keep(&mut self, index: TileIndex, tile: Option<&Tile>) {
        if self.kept.insert(index) {
            self.before.push((index, tile.cloned()));
        }
    }
}
