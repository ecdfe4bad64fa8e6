//! The fast way to add a reading to a grid.
//!
//! A cone is one stretch of cells per row (`spans.rs`), in which no cell need be asked whether it belongs; the sensor
//! model falls into a factor that depends on the distance and one that depends on the angle, and both are polynomials
//! (`lanes.rs`).
//!
//! **Bound.** Of the cells of the cone, and only of these, each gains what [`Cone::probability`] says, to within
//! [`BOUND`] of log-odds and half a unit in the last place of the stored single-precision sum. Which cells belong is
//! exact but for centres that lie within 1e-9 m or rad of a border. (At 10 000 km from the origin of the map a
//! coordinate itself has no more than that.) A beam so narrow and short that no centre lies in it adds nothing.

mod first_echo;
mod fit;
mod lanes;
mod spans;

use crate::angle::wrap_angle;
use crate::grid::{CellIndex, DirtyTiles, Grid, TILE_SIDE, TileIndex};
use crate::log_odds::log_odds_of;
use crate::pose::Pose2;
use crate::sensor_model::{BAND, Cone};

pub use first_echo::{EchoCone, FirstEchoKernel};
use fit::{Fitter, fit, nodes, shortened};
use lanes::{ANGLE, ARTANH, Common, Profile, TileRow, add_echo, add_free};
use spans::{RowSpan, Sector};

/// How far the increment of a cell may be from that of the reference model, log-odds per reading, for peaks from 0.001
/// to 0.999 (nearer to certainty a last digit of the probability is worth more).
pub const BOUND: f64 = 1e-6;

/// Cells are numbered within ± this; a cone that reaches beyond is refused.
pub const CELL_LIMIT: i32 = 1 << 30;

/// A cone longer than this many cells is refused.
const REACH_LIMIT: f64 = 1_048_576.0;
/// A cone of more than this many cells is refused: no sensor has it, and it would not fit into memory.
const AREA_LIMIT: f64 = 67_108_864.0;

/// Half apertures up to this (30°) go the fast way.
const WIDEST_HALF_APERTURE_RAD: f64 = core::f64::consts::PI / 6.0 + 1e-9;
/// Region I goes through single precision if its peak is at least this far from certain.
const LOWEST_P_FREE_F32: f64 = 0.25;

/// A cone that is not finite, or reaches beyond what a grid can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the cone reaches beyond what a map can hold")]
pub struct OffMap;

/// Adds readings to a grid. Allocates nothing once it has seen a cone as long as any to come and the grid has the tiles.
#[derive(Debug, Clone)]
pub struct Kernel {
    common: Common,
    /// The peak of region I that `common.artanh_f32` is for.
    p_free: f64,
    angle: AngleFactor,
    /// Of the cone at hand, one per row; kept for its memory.
    rows: Vec<RowSpan>,
    /// Whether the processor computes eight cells at once (AVX2).
    #[cfg(target_arch = "x86_64")]
    eight_lanes: bool,
}

impl Kernel {
    /// For cells that start at l0 = `log_odds_prior` and stay within ± `log_odds_max`.
    #[must_use]
    pub fn new(log_odds_prior: f64, log_odds_max: f64) -> Self {
        let decay = fit(|x| libm::exp(-x), 0.5 * BAND * BAND);
        Self {
            common: Common { prior: log_odds_prior, max: log_odds_max as f32, decay, artanh_f32: None },
            p_free: f64::NAN,
            angle: AngleFactor::new(),
            rows: Vec::new(),
            #[cfg(target_arch = "x86_64")]
            eight_lanes: std::arch::is_x86_feature_detected!("avx2"),
        }
    }

    /// Adds ln(p / (1 − p)) − l0 to every cell of the cone of a transducer at `map_from_transducer`. The tiles that
    /// changed get `revision` and are noted in `dirty`.
    ///
    /// # Errors
    /// When the cone or the pose is not finite, or the cone leaves the grid; nothing is changed then.
    pub fn add(
        &mut self,
        grid: &mut Grid,
        dirty: &mut DirtyTiles,
        map_from_transducer: Pose2,
        cone: &Cone,
        revision: u64,
    ) -> Result<(), OffMap> {
        if !is_sound(cone) {
            return Err(OffMap);
        }
        let apex = Apex::of(map_from_transducer, cone.far_m(), cone.aperture_rad, grid.resolution_m())?;
        let half_aperture = 0.5 * cone.aperture_rad;
        if half_aperture > 0.0 && half_aperture <= WIDEST_HALF_APERTURE_RAD {
            self.add_fast(grid, dirty, map_from_transducer, cone, revision, apex);
        } else {
            self.add_by_reference(grid, dirty, map_from_transducer, cone, revision, apex);
        }
        Ok(())
    }

    fn add_fast(
        &mut self,
        grid: &mut Grid,
        dirty: &mut DirtyTiles,
        map_from_transducer: Pose2,
        cone: &Cone,
        revision: u64,
        apex: Apex,
    ) {
        let resolution_m = grid.resolution_m();
        let sector = Sector::new(
            cone.aperture_rad,
            (cone.near_m(), cone.far_m()),
            map_from_transducer,
            apex.offset_x,
            resolution_m,
        );
        let profile = self.profile(map_from_transducer, cone, resolution_m, apex);

        // One stretch of cells per row
        let (low_y, high_y) = sector.extent_y();
        let first_row = ((low_y + apex.offset_y) / resolution_m).floor() as i32;
        let last_row = ((high_y + apex.offset_y) / resolution_m).ceil() as i32;
        let dy_of = |row: i32| f64::from(row) * resolution_m - apex.offset_y;
        self.rows.clear();
        for row in first_row..=last_row {
            self.rows.push(sector.row(dy_of(row)));
        }

        let placement = Placement { apex, first_row, revision };
        #[cfg(target_arch = "x86_64")]
        if self.eight_lanes {
            // SAFETY: `eight_lanes` says that this processor has AVX2.
            unsafe { add_tiles_avx2(&self.common, &profile, &self.rows, placement, grid, dirty) };
            return;
        }
        add_tiles(&self.common, &profile, &self.rows, placement, grid, dirty);
    }

    /// What the cells of this reading have in common.
    fn profile(&mut self, map_from_transducer: Pose2, cone: &Cone, resolution_m: f64, apex: Apex) -> Profile {
        if self.p_free != cone.p_free {
            self.p_free = cone.p_free;
            self.common.artanh_f32 = artanh_f32(cone.p_free);
        }
        let angle = self.angle.of(cone.aperture_rad, cone.deviations.sigma_theta_rad);
        let (sin, cos) = libm::sincos(map_from_transducer.theta);
        let edge = libm::sin(0.5 * cone.aperture_rad);
        let near_m = cone.near_m();
        Profile {
            resolution_m,
            offset_x: apex.offset_x,
            scaled_sin: sin / edge,
            scaled_cos: cos / edge,
            angle,
            angle_f32: shortened(&angle),
            range_m: cone.range_m,
            steepness: core::f64::consts::FRAC_1_SQRT_2 / cone.deviations.sigma_z_m,
            echo_peak: 2.0 * cone.deviations.trust * (cone.p_occupied - 0.5),
            free_peak: 2.0 * cone.deviations.trust * (0.5 - cone.p_free),
            inverse_near_squared: 1.0 / (near_m * near_m),
        }
    }

    /// Cell by cell: for apertures wider than any sensor's.
    fn add_by_reference(
        &self,
        grid: &mut Grid,
        dirty: &mut DirtyTiles,
        map_from_transducer: Pose2,
        cone: &Cone,
        revision: u64,
        apex: Apex,
    ) {
        let cells: Vec<_> = cells_around(grid, map_from_transducer, apex, cone.far_m()).collect();
        for (cell, distance_m, bearing_rad) in cells {
            let Some(p) = cone.probability(distance_m, bearing_rad) else { continue };
            let tile = grid.tile_mut(cell.tile());
            tile.revision = revision;
            dirty.insert(cell.tile());
            let value = &mut tile.log_odds[cell.offset_in_tile()];
            let before = if value.is_nan() { self.common.prior } else { f64::from(*value) };
            let after = (before + log_odds_of(p) - self.common.prior) as f32;
            *value = after.max(-self.common.max).min(self.common.max);
        }
    }
}

/// Every cell that may be nearer than `far_m` to a transducer: the cell, its distance in metres, its bearing off the axis.
fn cells_around(
    grid: &Grid,
    map_from_transducer: Pose2,
    apex: Apex,
    far_m: f64,
) -> impl Iterator<Item = (CellIndex, f64, f64)> + use<> {
    let resolution_m = grid.resolution_m();
    let reach = (far_m / resolution_m).ceil().max(0.0) as i32 + 1;
    let Apex { cell: CellIndex { i, j }, .. } = apex;
    let cells = (j - reach..=j + reach).flat_map(move |j| (i - reach..=i + reach).map(move |i| CellIndex { i, j }));
    cells.map(move |cell| {
        let dx = (f64::from(cell.i) + 0.5) * resolution_m - map_from_transducer.x;
        let dy = (f64::from(cell.j) + 0.5) * resolution_m - map_from_transducer.y;
        (cell, libm::hypot(dx, dy), wrap_angle(libm::atan2(dy, dx) - map_from_transducer.theta))
    })
}

/// Where the rows of a cone lie on the grid.
#[derive(Debug, Clone, Copy)]
struct Placement {
    apex: Apex,
    /// Counted from the row of the transducer.
    first_row: i32,
    revision: u64,
}

/// [`add_tiles`] in the instructions of a processor that computes eight cells at once. They are the same operations
/// in the same order (a product and a sum are never fused), so the bytes are the same.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn add_tiles_avx2(
    common: &Common,
    profile: &Profile,
    rows: &[RowSpan],
    placement: Placement,
    grid: &mut Grid,
    dirty: &mut DirtyTiles,
) {
    add_tiles(common, profile, rows, placement, grid, dirty);
}

/// Adds a cone, tile by tile.
#[inline(always)]
fn add_tiles(
    common: &Common,
    profile: &Profile,
    rows: &[RowSpan],
    placement: Placement,
    grid: &mut Grid,
    dirty: &mut DirtyTiles,
) {
    const SIDE: i32 = TILE_SIDE as i32;
    let Placement { apex, first_row, revision } = placement;
    let mut from = 0;
    while from < rows.len() {
        // The rows that lie in the same row of tiles
        let row = apex.cell.j + first_row + from as i32;
        let row_in_tile = row.rem_euclid(SIDE) as usize;
        let to = rows.len().min(from + TILE_SIDE - row_in_tile);
        let spans = &rows[from..to];
        let first_dy_row = first_row + from as i32;
        from = to;
        let Some((low, high)) = spans::columns(spans) else { continue };
        for tile_x in (apex.cell.i + low).div_euclid(SIDE)..=(apex.cell.i + high).div_euclid(SIDE) {
            // The columns of this tile, counted from the transducer's
            let first_column = tile_x * SIDE - apex.cell.i;
            let meets =
                |span: &RowSpan| !span.is_empty() && span.low < first_column + SIDE && span.high >= first_column;
            if !spans.iter().any(meets) {
                continue;
            }
            let index = TileIndex { x: tile_x, y: row.div_euclid(SIDE) };
            dirty.insert(index);
            let tile = grid.tile_mut(index);
            tile.revision = revision;
            let (tile_rows, _) = tile.log_odds.as_chunks_mut::<TILE_SIDE>();
            let dy_of = |n: usize| f64::from(first_dy_row + n as i32) * profile.resolution_m - apex.offset_y;
            // One region after the other: cells just written are slow to read again.
            for (n, (cells, span)) in tile_rows[row_in_tile..].iter_mut().zip(spans).enumerate() {
                let mut row = TileRow { cells, first_column, dy: dy_of(n) };
                add_free(common, profile, &mut row, span.free_low, span.free_high);
            }
            for (n, (cells, span)) in tile_rows[row_in_tile..].iter_mut().zip(spans).enumerate() {
                let mut row = TileRow { cells, first_column, dy: dy_of(n) };
                add_echo(common, profile, &mut row, span.low, span.free_low - 1);
                add_echo(common, profile, &mut row, span.free_high + 1, span.high);
            }
        }
    }
}

/// Where the point of a cone lies on the grid.
#[derive(Debug, Clone, Copy)]
struct Apex {
    cell: CellIndex,
    /// From the centre of that cell, metres.
    offset_x: f64,
    offset_y: f64,
}

impl Apex {
    /// Refuses what is not finite, leaves the grid or is too large.
    fn of(map_from_transducer: Pose2, far_m: f64, aperture_rad: f64, resolution_m: f64) -> Result<Self, OffMap> {
        let Pose2 { x, y, .. } = map_from_transducer;
        let reach = far_m / resolution_m;
        let (column, row) = ((x / resolution_m).floor(), (y / resolution_m).floor());
        let limit = f64::from(CELL_LIMIT) - reach - 2.0;
        let fits = map_from_transducer.is_finite()
            && reach < REACH_LIMIT
            && 0.5 * aperture_rad.min(core::f64::consts::TAU) * reach * reach < AREA_LIMIT
            && column.abs() < limit
            && row.abs() < limit;
        if !fits {
            return Err(OffMap);
        }
        Ok(Self {
            cell: CellIndex { i: column as i32, j: row as i32 },
            offset_x: x - (column + 0.5) * resolution_m,
            offset_y: y - (row + 0.5) * resolution_m,
        })
    }
}

/// Whether its numbers are such that every cell gets a probability within (0, 1).
fn is_sound(cone: &Cone) -> bool {
    let Cone { range_m, aperture_rad, range_cap_m, deviations, p_occupied, p_free } = *cone;
    let positive = |x: f64| x > 0.0 && x.is_finite();
    positive(range_m)
        && positive(aperture_rad)
        && positive(range_cap_m)
        && positive(deviations.sigma_z_m)
        && deviations.sigma_theta_rad >= 0.5 * aperture_rad
        && deviations.sigma_theta_rad.is_finite()
        && (0.0..=1.0).contains(&deviations.trust)
        && (0.5..1.0).contains(&p_occupied)
        && p_free > 0.0
        && p_free <= 0.5
}

/// exp(−½ (φ/σ_θ)²) as a polynomial in (sin φ / sin ½β)².
#[derive(Debug, Clone)]
struct AngleFactor {
    fitter: Fitter<ANGLE>,
    /// β that the squares are for.
    aperture_rad: f64,
    /// φ² at the nodes.
    bearings_squared: [f64; ANGLE],
}

impl AngleFactor {
    fn new() -> Self {
        Self { fitter: Fitter::new(), aperture_rad: f64::NAN, bearings_squared: [0.0; ANGLE] }
    }

    fn of(&mut self, aperture_rad: f64, sigma_theta_rad: f64) -> [f64; ANGLE] {
        if self.aperture_rad != aperture_rad {
            self.aperture_rad = aperture_rad;
            let edge = libm::sin(0.5 * aperture_rad);
            self.bearings_squared = nodes().map(|node: f64| {
                let bearing = libm::asin(node.sqrt() * edge);
                bearing * bearing
            });
        }
        let scale = -0.5 / (sigma_theta_rad * sigma_theta_rad);
        self.fitter.through(&self.bearings_squared.map(|square| libm::exp(scale * square)))
    }
}

/// 2 artanh(y)/y = ln((1 + y)/(1 − y))/y as a polynomial in y², for all y that region I can have.
fn artanh_f32(p_free: f64) -> Option<[f32; ARTANH]> {
    if !(LOWEST_P_FREE_F32..0.5).contains(&p_free) {
        return None;
    }
    let most = 1.0 - 2.0 * p_free;
    let coefficients: [f64; ARTANH] = fit(
        |square| {
            let y = square.sqrt();
            (libm::log1p(y) - libm::log1p(-y)) / y
        },
        most * most,
    );
    Some(coefficients.map(|c| c as f32))
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::noise::NoiseTerms;
    use crate::odometry::OdometryErrors;
    use crate::sensor_model::Deviations;

    #[test]
    fn wide_and_narrow_processors_give_the_same_bytes() {
        let (mut narrow_grid, mut wide_grid) = (Grid::new(0.05), Grid::new(0.05));
        let mut dirty = DirtyTiles::default();
        let mut wide = Kernel::new(0.0, 8.0);
        let mut narrow = Kernel { eight_lanes: false, ..wide.clone() };
        for k in 0..500u32 {
            let errors = OdometryErrors { e_lin_m: 0.001 * f64::from(k % 100), ..OdometryErrors::default() };
            let range_m = 0.3 + 0.01 * f64::from(k);
            let aperture_rad = 0.02 + 0.002 * f64::from(k);
            let cone = Cone {
                range_m,
                aperture_rad,
                range_cap_m: 5.0,
                deviations: Deviations::of(range_m, aperture_rad, 0.01, 0.05, &errors, NoiseTerms::default()),
                p_occupied: 0.85,
                p_free: if k % 5 == 0 { 0.1 } else { 0.3 },
            };
            let pose = Pose2::new(0.013 * f64::from(k), -0.007 * f64::from(k), 0.1 * f64::from(k));
            assert!(narrow.add(&mut narrow_grid, &mut dirty, pose, &cone, 1).is_ok());
            assert!(wide.add(&mut wide_grid, &mut dirty, pose, &cone, 1).is_ok());
        }
        assert_eq!(narrow_grid.tile_count(), wide_grid.tile_count());
        for ((index, a), (_, b)) in narrow_grid.tiles().zip(wide_grid.tiles()) {
            let bits = |tile: &crate::grid::Tile| tile.log_odds.map(f32::to_bits);
            assert!(bits(a) == bits(b), "{index:?}");
        }
    }
}
