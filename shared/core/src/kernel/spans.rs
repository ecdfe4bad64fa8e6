//! Which cells lie in a cone: one stretch per row.

use crate::pose::Pose2;

/// The cells of one row that lie in a cone, by column counted from the column of the transducer; both ends included.
///
/// The free ones (region I) are one stretch within, since a disc is convex; the rest is region II.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RowSpan {
    pub(super) low: i32,
    pub(super) high: i32,
    /// Empty (`free_high < free_low`) where there is no region I.
    pub(super) free_low: i32,
    pub(super) free_high: i32,
}

impl RowSpan {
    pub(super) const EMPTY: Self = Self { low: 0, high: -1, free_low: 0, free_high: -1 };

    pub(super) fn is_empty(&self) -> bool {
        self.high < self.low
    }
}

/// The lowest and highest column of some rows; none if all are empty.
pub(super) fn columns(spans: &[RowSpan]) -> Option<(i32, i32)> {
    let (mut low, mut high) = (i32::MAX, i32::MIN);
    for span in spans {
        if !span.is_empty() {
            low = low.min(span.low);
            high = high.max(span.high);
        }
    }
    (low <= high).then_some((low, high))
}

/// A cone on the grid whose half aperture is less than a quarter turn: a disc cut by two half planes, so convex.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sector {
    cells_per_m: f64,
    /// Of the transducer, from the centre of its own cell, cells.
    offset: f64,
    left: Edge,
    right: Edge,
    near_m: f64,
    far_m: f64,
}

/// An edge of the cone: on the inner side of it, dx >= slope dy, or <=, or, for an edge along the rows, dy has a sign.
#[derive(Debug, Clone, Copy)]
struct Edge {
    sin: f64,
    cos: f64,
    side: Side,
    slope: f64,
}

#[derive(Debug, Clone, Copy)]
enum Side {
    RightOf,
    LeftOf,
    /// dy times this is at least 0.
    Along(f64),
}

impl Edge {
    /// The left edge has the cone to its right and counts with `sign` 1, the right edge with -1.
    fn new(direction_rad: f64, sign: f64) -> Self {
        let (sin, cos) = libm::sincos(direction_rad);
        let side = if sign * sin > 0.0 {
            Side::RightOf
        } else if sign * sin < 0.0 {
            Side::LeftOf
        } else {
            Side::Along(-sign * cos)
        };
        Self { sin, cos, side, slope: cos / sin }
    }

    /// Narrows the stretch from … to of a row to the inner side.
    #[inline(always)]
    fn cut(&self, dy: f64, from: &mut f64, to: &mut f64) {
        match self.side {
            Side::RightOf => *from = from.max(self.slope * dy),
            Side::LeftOf => *to = to.min(self.slope * dy),
            Side::Along(sign) if dy * sign < 0.0 => *to = f64::NEG_INFINITY,
            Side::Along(_) => {}
        }
    }
}

impl Sector {
    /// Of a cone of full aperture `aperture_rad` whose region II lies from `near_m` to `far_m`.
    pub(super) fn new(
        aperture_rad: f64,
        (near_m, far_m): (f64, f64),
        map_from_transducer: Pose2,
        offset_x: f64,
        resolution_m: f64,
    ) -> Self {
        let half = 0.5 * aperture_rad;
        Self {
            cells_per_m: 1.0 / resolution_m,
            offset: offset_x / resolution_m,
            left: Edge::new(map_from_transducer.theta + half, 1.0),
            right: Edge::new(map_from_transducer.theta - half, -1.0),
            near_m,
            far_m,
        }
    }

    /// Lowest and highest y of the sector from the transducer, metres.
    pub(super) fn extent_y(&self) -> (f64, f64) {
        let (a, b) = (self.far_m * self.left.sin, self.far_m * self.right.sin);
        // The arc rises above its ends where the cone looks straight up, falls below them straight down.
        let up = self.left.cos <= 0.0 && self.right.cos >= 0.0;
        let down = self.left.cos >= 0.0 && self.right.cos <= 0.0;
        let high = if up { self.far_m } else { a.max(b).max(0.0) };
        let low = if down { -self.far_m } else { a.min(b).min(0.0) };
        (low, high)
    }

    /// The cells of the row whose centres lie `dy` metres above the transducer.
    #[inline]
    pub(super) fn row(&self, dy: f64) -> RowSpan {
        let half = self.far_m * self.far_m - dy * dy;
        if half < 0.0 {
            return RowSpan::EMPTY;
        }
        let half = half.sqrt();
        let (mut from, mut to) = (-half, half);
        self.left.cut(dy, &mut from, &mut to);
        self.right.cut(dy, &mut from, &mut to);
        if from > to {
            return RowSpan::EMPTY;
        }
        let (mut low, mut high) = (self.ceil(from), self.floor(to));
        if dy == 0.0 && self.offset == 0.0 {
            // The transducer is on the centre of a cell, and 0 < d leaves that out. It can only be at an end.
            low += i32::from(low == 0);
            high -= i32::from(high == 0);
        }
        if high < low {
            return RowSpan::EMPTY;
        }
        let (free_low, free_high) = self.free_part(dy, low, high).unwrap_or((low, low - 1));
        RowSpan { low, high, free_low, free_high }
    }

    /// The columns from `low` to `high` that are nearer than region II.
    #[inline]
    fn free_part(&self, dy: f64, low: i32, high: i32) -> Option<(i32, i32)> {
        let half = self.near_m * self.near_m - dy * dy;
        if self.near_m <= 0.0 || half <= 0.0 {
            return None;
        }
        let half = half.sqrt();
        let (free_low, free_high) = (self.ceil(-half).max(low), self.floor(half).min(high));
        (free_low <= free_high).then_some((free_low, free_high))
    }

    /// The first column whose centre is not left of `dx`.
    #[inline]
    fn ceil(&self, dx: f64) -> i32 {
        -floor(-dx * self.cells_per_m - self.offset)
    }

    /// The last column whose centre is not right of `dx`.
    #[inline]
    fn floor(&self, dx: f64) -> i32 {
        floor(dx * self.cells_per_m + self.offset)
    }
}

/// `f64::floor` is a call where the processor is not known to have an instruction for it.
#[inline(always)]
fn floor(x: f64) -> i32 {
    let towards_zero = x as i32;
    towards_zero - i32::from(f64::from(towards_zero) > x)
}
