//! The fast way to add a reading to a grid.
//!
//! A beam is one stretch of cells per row (`spans.rs`), in which no cell need be asked whether it belongs, and all rules of fusion
//! share that layout (`layout.rs`). The sensor model falls into a factor that depends on the distance and one that depends on the
//! angle, and both are polynomials in single precision, of as many cells at once as the processor can (`lanes.rs`, `wide.rs`).
//!
//! Beams of a lidar that stand side by side are added in one pass (`fan.rs`).
//!
//! **Bound.** Of the cells of the cone, and only of these, each gains what [`Cone::probability`] says, to within
//! [`BOUND`] of log-odds and half a unit in the last place of the stored single-precision sum. Which cells belong is
//! exact but for centres that lie within 1e-9 m or rad of a border. (At 10 000 km from the origin of the map a
//! coordinate itself has no more than that; nothing else is lost there.) The cells that a beam crosses where it
//! [leaves gaps](Cone::leaves_gaps) and is thinner than a cell count as lying on its axis.
//!
//! **Bits.** Every processor gives the same, however many cells it computes at once.

mod along;
mod along_walls;
mod along_walls_pass;
mod chosen;
mod fan;
mod fan_pass;
mod first_echo;
mod fit;
mod functions;
mod fused;
mod geometry;
mod lanes;
mod layout;
mod order;
mod oriented;
mod oriented_answers;
mod oriented_cells;
mod oriented_pass;
mod oriented_settled;
mod paper;
mod spans;
mod tempered;
mod wide;
#[cfg(target_arch = "x86_64")]
mod x86;
#[cfg(target_arch = "x86_64")]
mod x86_chosen;
#[cfg(target_arch = "x86_64")]
mod x86_doubles;

use crate::angle::wrap_angle;
use crate::grid::{CellIndex, Grid, TILE_CELLS, Tile, TileIndex};
use crate::log_odds::log_odds_of;
use crate::pose::Pose2;
use crate::sensor_model::Cone;
use crate::shares::Shares;

pub(crate) use along_walls::AlongWalls;
pub use fan::{FAN_STEP_RAD, FanKernel};
pub use first_echo::{EchoCone, FirstEchoKernel};
use fit::{Fitter, nodes};
use geometry::{ANGLE, Geometry};
use layout::Beam;
pub use oriented::{ORIENTED_BOUND, OrientedCone, OrientedKernel};
use paper::{Adding, Limits, Profile, Scratch};
use wide::Width;

/// How far the increment of a cell may be from that of the reference model, log-odds per reading, for peaks from 0.001
/// to 0.999 (nearer to certainty a last digit of the probability is worth more).
pub const BOUND: f64 = 2e-4;

/// Cells are numbered within ± this; a cone that reaches beyond is refused.
pub const CELL_LIMIT: i32 = 1 << 30;

/// A cone longer than this many cells is refused.
const REACH_LIMIT: f64 = 1_048_576.0;
/// A cone of more than this many cells is refused: no sensor has it, and it would not fit into memory.
const AREA_LIMIT: f64 = 67_108_864.0;

/// Half apertures up to this (30°) go the fast way.
const WIDEST_HALF_APERTURE_RAD: f64 = core::f64::consts::PI / 6.0 + 1e-9;
/// A cone that is not finite, or reaches beyond what a grid can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the cone reaches beyond what a map can hold")]
pub struct OffMap;

/// Adds readings to a grid. Allocates nothing once it has seen a cone as long as any to come and the grid has the tiles.
#[derive(Debug, Clone)]
pub struct Kernel {
    prior: f64,
    limits: Limits,
    /// The peak of region I, and what it takes to compute it.
    free: (f64, Option<[f32; 3]>),
    angle: AngleFactor,
    /// Of the cone at hand; kept for its memory.
    scratch: Scratch,
    width: Width,
}

impl Kernel {
    /// For cells that start at l0 = `log_odds_prior` and stay within ± `log_odds_max`.
    #[must_use]
    pub fn new(log_odds_prior: f64, log_odds_max: f64) -> Self {
        Self {
            prior: log_odds_prior,
            limits: Limits { prior: log_odds_prior as f32, max: log_odds_max as f32 },
            free: (f64::NAN, None),
            angle: AngleFactor::new(),
            scratch: Scratch::default(),
            width: Width::of_this_processor(),
        }
    }

    /// Adds ln(p / (1 − p)) − l0 to every cell of the cone of a transducer at `map_from_transducer`. The tiles that
    /// changed get `revision`.
    ///
    /// # Errors
    /// When the cone or the pose is not finite, or the cone leaves the grid; nothing is changed then.
    pub fn add(
        &mut self,
        grid: &mut Grid,
        map_from_transducer: Pose2,
        cone: &Cone,
        revision: u64,
    ) -> Result<(), OffMap> {
        if !is_sound(cone) {
            return Err(OffMap);
        }
        let resolution_m = grid.resolution_m();
        let apex = Apex::of(map_from_transducer, cone.far_m(), cone.aperture_rad, resolution_m)?;
        let mut place = Place { grid, revision };
        if 0.5 * cone.aperture_rad > WIDEST_HALF_APERTURE_RAD {
            self.add_by_reference(&mut place, map_from_transducer, cone, apex);
            return Ok(());
        }
        if self.free.0 != cone.p_free {
            self.free = (cone.p_free, paper::artanh(cone.p_free));
        }
        let angle = self.angle.of(cone.aperture_rad, cone.deviations.sigma_theta_rad);
        let axis_rad = map_from_transducer.theta;
        let geometry = Geometry::new(resolution_m, &apex, axis_rad, cone.aperture_rad, angle);
        let beam = Beam {
            direction_rad: axis_rad,
            aperture_rad: cone.aperture_rad,
            near_m: cone.near_m(),
            far_m: cone.far_m(),
            leaves_gaps: cone.leaves_gaps,
        };
        let profile = Profile::new(cone, geometry, self.free.1);
        let (scratch, limits) = (&mut self.scratch, self.limits);
        self.width.run(Adding { scratch, profile: &profile, beam, apex, limits, place });
        Ok(())
    }

    /// Cell by cell: for apertures wider than any sensor's.
    fn add_by_reference(&self, place: &mut Place<'_>, map_from_transducer: Pose2, cone: &Cone, apex: Apex) {
        for (cell, distance_m, bearing_rad) in cells_around(place.grid, map_from_transducer, apex, cone.far_m()) {
            let Some(p) = cone.probability(distance_m, bearing_rad) else { continue };
            let value = &mut place.tile(cell.tile()).log_odds[cell.offset_in_tile()];
            let before = if value.is_nan() { self.prior } else { f64::from(*value) };
            let after = (before + log_odds_of(p) - self.prior) as f32;
            *value = after.max(-self.limits.max).min(self.limits.max);
        }
    }
}

/// What is written to.
struct Place<'a> {
    grid: &'a mut Grid,
    revision: u64,
}

impl Place<'_> {
    /// A tile that changes.
    fn tile(&mut self, index: TileIndex) -> &mut Tile {
        let tile = self.grid.tile_mut(index);
        tile.revision = self.revision;
        tile
    }

    /// The states of the cells of a tile that changes, and their log-odds, which are written to as the states say.
    fn states(&mut self, index: TileIndex) -> (&mut Shares, &mut [f32; TILE_CELLS]) {
        self.grid.states_mut(index, self.revision)
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
    let Cone { range_m, aperture_rad, range_cap_m, deviations, p_occupied, p_free, .. } = *cone;
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
    /// The last one, and its σ_θ.
    last: (f64, [f32; ANGLE]),
    /// φ² at the nodes.
    bearings_squared: [f64; ANGLE],
}

impl AngleFactor {
    fn new() -> Self {
        Self {
            fitter: Fitter::new(),
            aperture_rad: f64::NAN,
            last: (f64::NAN, [0.0; ANGLE]),
            bearings_squared: [0.0; ANGLE],
        }
    }

    fn of(&mut self, aperture_rad: f64, sigma_theta_rad: f64) -> [f32; ANGLE] {
        if self.aperture_rad != aperture_rad {
            self.aperture_rad = aperture_rad;
            self.last.0 = f64::NAN;
            let edge = libm::sin(0.5 * aperture_rad);
            self.bearings_squared = nodes().map(|node: f64| {
                let bearing = libm::asin(node.sqrt() * edge);
                bearing * bearing
            });
        }
        if self.last.0 != sigma_theta_rad {
            let scale = -0.5 / (sigma_theta_rad * sigma_theta_rad);
            let values = self.bearings_squared.map(|square| libm::exp(scale * square));
            self.last = (sigma_theta_rad, self.fitter.through(&values).map(|c| c as f32));
        }
        self.last.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::NoiseTerms;
    use crate::odometry::OdometryErrors;
    use crate::sensor_model::Deviations;

    /// All that this processor can do, on a drive of cones of all kinds, thin and wide.
    #[test]
    fn all_processors_give_the_same_bytes() {
        let maps = Width::all().into_iter().map(|width| {
            let mut grid = Grid::new(0.05);
            let mut kernel = Kernel { width, ..Kernel::new(0.0, 8.0) };
            for k in 0..500u32 {
                let errors = OdometryErrors { e_lin_m: 0.001 * f64::from(k % 100), ..OdometryErrors::default() };
                let range_m = 0.3 + 0.01 * f64::from(k);
                let aperture_rad = if k % 3 == 0 { 0.003 } else { 0.02 + 0.002 * f64::from(k) };
                let cone = Cone {
                    range_m,
                    aperture_rad,
                    range_cap_m: 5.0,
                    deviations: Deviations::of(range_m, aperture_rad, 0.01, 0.05, &errors, NoiseTerms::default()),
                    p_occupied: 0.85,
                    p_free: if k % 5 == 0 { 0.1 } else { 0.3 },
                    leaves_gaps: k % 3 == 0,
                };
                let pose = Pose2::new(0.013 * f64::from(k), -0.007 * f64::from(k), 0.1 * f64::from(k));
                assert!(kernel.add(&mut grid, pose, &cone, 1).is_ok());
            }
            grid
        });
        assert_alike(&maps.collect::<Vec<_>>());
    }

    pub(super) fn assert_alike(maps: &[Grid]) {
        let bits = |grid: &Grid| grid.tiles().map(|(index, tile)| (index, tile.log_odds.map(f32::to_bits))).collect();
        let all: Vec<Vec<_>> = maps.iter().map(bits).collect();
        assert!(all[0].len() > 1 && all.windows(2).all(|pair| pair[0] == pair[1]));
    }
}
