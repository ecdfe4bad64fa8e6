//! What a tile may hold of each cell besides its log-odds, in planes: what undoes, saves or publishes tiles carries them without
//! knowing what they mean.

/// A quantity that a tile may hold of each cell, as single-precision numbers; NaN where nothing is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Plane {
    /// The mean odometry error of the cell's evidence, metres.
    Doubt,
    /// How far readings moved the cell's log-odds in all, which the mean is weighted by.
    DoubtWeight,
    /// The cell's log-odds before the reading at hand. Between readings it is a copy of them, so it is not saved.
    LogOddsBefore,
}

impl Plane {
    /// Every plane, in the order in which tiles hold and save them.
    pub const ALL: [Self; 3] = [Self::Doubt, Self::DoubtWeight, Self::LogOddsBefore];

    /// How many numbers of each cell it holds, one after another.
    #[must_use]
    pub fn numbers_per_cell(self) -> usize {
        match self {
            Self::Doubt | Self::DoubtWeight | Self::LogOddsBefore => 1,
        }
    }

    /// Whether it is a copy of the log-odds whenever tiles are saved.
    pub(super) fn is_copy(self) -> bool {
        self == Self::LogOddsBefore
    }

    /// Its place among all planes.
    pub(super) fn index(self) -> usize {
        self as usize
    }
}
