//! The map: its tiles, and the map in numbers.

use core::fmt::Debug;

use echogrid_core::oriented::STATES;
use echogrid_core::{CellIndex, Incidents, TileIndex, Verdict, VerdictCounts};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::{Value, json};

use super::checks::{Fault, at_least_zero, check, finite};
use super::odometry::IncidentsWire;
use super::robot::MAX_SENSORS;
use crate::content::Content;
use crate::topic::{Qos, Topic};
use crate::wire::{ZeroCopySend, wire};

/// Cells in a map tile (64 × 64).
pub const TILE_CELLS: usize = 4096;
/// Verdict kinds that a map info can count.
pub const MAX_VERDICTS: usize = 16;

/// Flags of the map in numbers.
const FINISHED: u32 = 1;
const MAP_DEGRADED: u32 = 2;
const MAP_HELD: u32 = 4;
const MAP_UNPLACED: u32 = 8;
/// Layers of tiles.
const LAYER_MAP: u16 = 0;
const LAYER_SONAR: u16 = 1;
const LAYER_DOUBT: u16 = 2;
const LAYER_FACING: u16 = 3;
const LAYER_STATE: u16 = 4;

impl Content for TileUpdate {
    const TOPIC: Topic = Topic::MapTiles;
    type Payload = TileWire;

    fn qos(_: usize) -> Qos {
        // Whole tiles, each newer than the last of its place: a history of all would be far larger than the map.
        Qos { history: 0, buffer: 128, window: 64, ..Qos::STREAM }
    }

    fn json(&self) -> Value {
        let mut value = self.brief();
        // What is unknown is null.
        value["log_odds"] = json!(self.log_odds.as_slice());
        value
    }

    fn brief(&self) -> Value {
        let Self { layer, index, revision, resolution_m, log_odds } = self;
        let known = log_odds.iter().filter(|value| !value.is_nan()).count();
        json!({
            "layer": layer, "index": index, "revision": revision, "resolution_m": resolution_m, "cells_known": known
        })
    }
}

impl Content for MapInfo {
    const TOPIC: Topic = Topic::MapInfo;
    type Payload = MapInfoWire;

    fn qos(_: usize) -> Qos {
        Qos::LATEST
    }

    fn json(&self) -> Value {
        json!(self)
    }
}

/// What a tile is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Layer {
    /// The map.
    Map,
    /// What one sonar alone says: its number.
    Sonar(u16),
    /// How much odometry error the evidence of each cell carried, metres instead of log-odds.
    Doubt,
    /// Which way each wall faces: its normal, radians in [0, π) from the x axis of the map, instead of log-odds.
    Facing,
    /// What each cell would be if it is occupied, of the states of `oriented` this one: how much likelier it is than before any reading,
    /// relative to free, instead of log-odds. Told once, when the map is finished.
    State(u16),
}

/// One tile of the map, whole.
#[derive(Debug, Clone)]
pub struct TileUpdate {
    /// The layer that the tile belongs to.
    pub layer: Layer,
    /// The place of the tile in the grid.
    pub index: TileIndex,
    /// Number of the scan that changed it last.
    pub revision: u64,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Log-odds (of the doubt: metres, 0 or more; of facing: radians in [0, π); of a state: a ratio above 0), row by row; NaN is unknown.
    pub log_odds: Box<[f32; TILE_CELLS]>,
}

/// The map in numbers.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MapInfo {
    /// Number of the last scan in the map.
    pub revision: u64,
    /// The number of scans integrated.
    pub scans: u64,
    /// Cells that some reading touched.
    pub cells_known: u64,
    /// Cells with p > 0.65.
    pub cells_occupied: u64,
    /// Cells with p < 0.35.
    pub cells_free: u64,
    /// Sum over the known cells, bits.
    pub entropy_bits: f64,
    /// The trust of the latest estimate used, in [0, 1].
    pub trust: f64,
    /// Travelled since the start, metres.
    pub distance_m: f64,
    /// Lowest and highest known cell.
    #[serde(serialize_with = "as_numbers")]
    pub bounds: Option<(CellIndex, CellIndex)>,
    /// What became of the readings: the last verdict, where a fix changed it.
    #[serde(serialize_with = "by_name")]
    pub verdicts: VerdictCounts,
    /// How often a reading was fused again after a fix.
    pub remapped: u64,
    /// Readings that a fix could have changed, but for memory, or for being too far off for an error of the odometry.
    pub remap_left: u64,
    /// Whether the map is finished.
    pub finished: bool,
    /// Whether a reading hardly says anything any more.
    pub degraded: bool,
    /// Whether mapping holds, until the next fix or by hand.
    pub held: bool,
    /// Whether nothing has said yet where the map lies, so that nothing is mapped.
    pub unplaced: bool,
    /// Absolute fixes so far.
    pub fixes: u32,
    /// Fixes refused so far, for being too far off.
    pub fixes_refused: u32,
    /// Leaps of the odometry so far.
    pub leaps: Incidents,
    /// Fixes so far that the odometry contradicts, whether they were believed or not.
    pub contradictions: Incidents,
    /// What became of the readings of each sonar, by its number; of at most [`MAX_SENSORS`].
    #[serde(serialize_with = "each_by_name")]
    pub sonars: Vec<VerdictCounts>,
}

wire! {
    /// `map/tiles`: one tile that changed.
    "echogrid/MapTile/2" TileWire {
        /// The tile covers the cells 64 x … 64 x + 63 along x.
        tile_x: i32,
        /// Likewise along y.
        tile_y: i32,
        /// Number of the scan that changed it last.
        revision: u64,
        /// Side of a cell, metres; cell (0, 0) has its lower left corner at the origin of the map frame.
        resolution_m: f64,
        /// 0 the map; 1 the map of one sonar; 2 doubt: metres instead of log-odds; 3 facing: radians; 4 a state: ratios.
        layer: u16,
        /// Number of the sonar, or of the state, where the layer is one's; else 0.
        sonar: u16,
        /// Zero.
        reserved: u32,
        /// ln(p/(1−p)), of doubt metres, of facing radians in [0, π); row by row, row 0 at the lowest y; NaN: no reading touched the
        /// cell, or no wall in it faces one way.
        log_odds: [f32; 4096],
    }
}

wire! {
    /// `map/info`: the map in numbers.
    "echogrid/MapInfo/7" MapInfoWire {
        /// Number of the last scan in the map.
        revision: u64,
        /// Scans integrated.
        scans: u64,
        /// Cells that some reading touched.
        cells_known: u64,
        /// Cells with p > 0.65.
        cells_occupied: u64,
        /// Cells with p < 0.35.
        cells_free: u64,
        /// Sum over the known cells, bits.
        entropy_bits: f64,
        /// Of the latest estimate used.
        trust: f64,
        /// Travelled since the start, metres.
        distance_m: f64,
        /// Lowest cell along x, y, then highest along x, y; all 0 while nothing is known.
        bounds: [i32; 4],
        /// Readings by verdict code: the last verdict, where a fix changed it.
        verdicts: [u64; 16],
        /// How often a reading was fused again after a fix.
        remapped: u64,
        /// Readings that a fix could have changed, but for memory, or for being too far off for an error of the odometry.
        remap_left: u64,
        /// Leaps of the odometry so far: distance and turn of the leap.
        leaps: IncidentsWire,
        /// Fixes so far that the odometry contradicts, believed or not: how far the fix is from where the robot was believed to be.
        contradictions: IncidentsWire,
        /// Bit 0: the map is finished; bit 1: degraded, readings hardly say anything any more; bit 2: mapping holds;
        /// bit 3: nothing has said yet where the map lies, nothing is mapped.
        flags: u32,
        /// Absolute fixes so far.
        fixes: u32,
        /// Fixes refused so far, for being too far off.
        fixes_refused: u32,
        /// How many of `sonar_verdicts` are in use.
        sonar_count: u32,
        /// Zero.
        reserved: u32,
        /// Readings by verdict code, 16 counts for each sonar, by its number; 2^32 − 1: that many or more.
        sonar_verdicts: [u32; 4096],
        /// Zero, too: no byte of the message is left to chance.
        reserved_behind: u32,
    }
}

impl From<&TileUpdate> for TileWire {
    fn from(tile: &TileUpdate) -> Self {
        let (layer, sonar) = match tile.layer {
            Layer::Map => (LAYER_MAP, 0),
            Layer::Sonar(number) => (LAYER_SONAR, number),
            Layer::Doubt => (LAYER_DOUBT, 0),
            Layer::Facing => (LAYER_FACING, 0),
            Layer::State(number) => (LAYER_STATE, number),
        };
        Self {
            layer,
            sonar,
            reserved: 0,
            tile_x: tile.index.x,
            tile_y: tile.index.y,
            revision: tile.revision,
            resolution_m: tile.resolution_m,
            log_odds: *tile.log_odds,
        }
    }
}

impl TryFrom<&TileWire> for TileUpdate {
    type Error = Fault;

    fn try_from(wire: &TileWire) -> Result<Self, Fault> {
        // As in files: of what is beyond no map could be saved.
        let is_resolution = (1e-6..=1e6).contains(&wire.resolution_m);
        check(is_resolution, "resolution_m", wire.resolution_m, "metres from 1e-6 to 1e6")?;
        for (field, value) in [("tile_x", wire.tile_x), ("tile_y", wire.tile_y)] {
            check(value.unsigned_abs() <= 1 << 24, field, value, "within ±2^24")?;
        }
        if let Some(value) = wire.log_odds.iter().find(|value| value.is_infinite()) {
            check(false, "log_odds", value, "finite, or NaN for unknown")?;
        }
        let layer = match wire.layer {
            LAYER_MAP => Layer::Map,
            LAYER_SONAR => Layer::Sonar(wire.sonar),
            LAYER_DOUBT => Layer::Doubt,
            LAYER_FACING => Layer::Facing,
            LAYER_STATE => Layer::State(wire.sonar),
            other => {
                let expected = "0 map, 1 sonar, 2 doubt, 3 facing or 4 a state";
                return Err(Fault { field: "layer", value: other.to_string(), expected });
            }
        };
        if let Some(value) = wire.log_odds.iter().find(|value| layer == Layer::Doubt && **value < 0.0) {
            check(false, "log_odds", value, "metres, 0 or more, where the layer is doubt")?;
        }
        let is_normal = |value: &f32| value.is_nan() || (0.0..core::f32::consts::PI).contains(value);
        if let Some(value) = wire.log_odds.iter().find(|value| layer == Layer::Facing && !is_normal(value)) {
            check(false, "log_odds", value, "radians from 0 to below π, where the layer is facing")?;
        }
        if let Layer::State(number) = layer {
            check(usize::from(number) < STATES, "sonar", number, "the number of a state, 0 to 8")?;
            if let Some(value) = wire.log_odds.iter().find(|value| value.is_nan() || **value <= 0.0) {
                check(false, "log_odds", value, "a ratio above 0, where the layer is a state")?;
            }
        }
        Ok(Self {
            layer,
            index: TileIndex { x: wire.tile_x, y: wire.tile_y },
            revision: wire.revision,
            resolution_m: wire.resolution_m,
            log_odds: Box::new(wire.log_odds),
        })
    }
}

impl From<&MapInfo> for MapInfoWire {
    fn from(info: &MapInfo) -> Self {
        let mut verdicts = [0; MAX_VERDICTS];
        for verdict in Verdict::ALL {
            verdicts[verdict as usize] = info.verdicts.get(verdict);
        }
        let mut sonar_verdicts = [0; MAX_VERDICTS * MAX_SENSORS];
        for (slots, counts) in sonar_verdicts.chunks_exact_mut(MAX_VERDICTS).zip(&info.sonars) {
            for (verdict, count) in counts.iter() {
                slots[verdict as usize] = u32::try_from(count).unwrap_or(u32::MAX);
            }
        }
        Self {
            revision: info.revision,
            scans: info.scans,
            cells_known: info.cells_known,
            cells_occupied: info.cells_occupied,
            cells_free: info.cells_free,
            entropy_bits: info.entropy_bits,
            trust: info.trust,
            distance_m: info.distance_m,
            bounds: info.bounds.map_or([0; 4], |(low, high)| [low.i, low.j, high.i, high.j]),
            verdicts,
            remapped: info.remapped,
            remap_left: info.remap_left,
            flags: u32::from(info.finished) * FINISHED
                + u32::from(info.degraded) * MAP_DEGRADED
                + u32::from(info.held) * MAP_HELD
                + u32::from(info.unplaced) * MAP_UNPLACED,
            fixes: info.fixes,
            fixes_refused: info.fixes_refused,
            leaps: (&info.leaps).into(),
            contradictions: (&info.contradictions).into(),
            sonar_count: info.sonars.len().min(MAX_SENSORS) as u32,
            reserved: 0,
            reserved_behind: 0,
            sonar_verdicts,
        }
    }
}

impl TryFrom<&MapInfoWire> for MapInfo {
    type Error = Fault;

    fn try_from(wire: &MapInfoWire) -> Result<Self, Fault> {
        let mut verdicts = VerdictCounts::default();
        for verdict in Verdict::ALL {
            verdicts.add_many(verdict, wire.verdicts[verdict as usize]);
        }
        check(wire.sonar_count as usize <= MAX_SENSORS, "sonar_count", wire.sonar_count, "at most 256")?;
        let of_sonar = |slots: &[u32]| {
            let mut counts = VerdictCounts::default();
            Verdict::ALL.into_iter().zip(slots).for_each(|(verdict, count)| counts.add_many(verdict, (*count).into()));
            counts
        };
        let sonars =
            wire.sonar_verdicts.chunks_exact(MAX_VERDICTS).take(wire.sonar_count as usize).map(of_sonar).collect();
        let [i_low, j_low, i_high, j_high] = wire.bounds;
        Ok(Self {
            revision: wire.revision,
            scans: wire.scans,
            cells_known: wire.cells_known,
            cells_occupied: wire.cells_occupied,
            cells_free: wire.cells_free,
            entropy_bits: at_least_zero("entropy_bits", wire.entropy_bits)?,
            trust: finite("trust", wire.trust)?,
            distance_m: at_least_zero("distance_m", wire.distance_m)?,
            bounds: (wire.cells_known > 0)
                .then_some((CellIndex { i: i_low, j: j_low }, CellIndex { i: i_high, j: j_high })),
            verdicts,
            remapped: wire.remapped,
            remap_left: wire.remap_left,
            finished: wire.flags & FINISHED != 0,
            degraded: wire.flags & MAP_DEGRADED != 0,
            held: wire.flags & MAP_HELD != 0,
            unplaced: wire.flags & MAP_UNPLACED != 0,
            fixes: wire.fixes,
            fixes_refused: wire.fixes_refused,
            leaps: (&wire.leaps).try_into()?,
            contradictions: (&wire.contradictions).try_into()?,
            sonars,
        })
    }
}

fn as_numbers<S: Serializer>(bounds: &Option<(CellIndex, CellIndex)>, serializer: S) -> Result<S::Ok, S::Error> {
    bounds.map(|(low, high)| [[low.i, low.j], [high.i, high.j]]).serialize(serializer)
}

/// Counts of readings as a table by the name of the verdict.
struct ByName<'a>(&'a VerdictCounts);

impl Serialize for ByName<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        self.0.iter().try_for_each(|(verdict, count)| map.serialize_entry(verdict.name(), &count))?;
        map.end()
    }
}

fn by_name<S: Serializer>(counts: &VerdictCounts, serializer: S) -> Result<S::Ok, S::Error> {
    ByName(counts).serialize(serializer)
}

fn each_by_name<S: Serializer>(sonars: &[VerdictCounts], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(sonars.iter().map(ByName))
}

#[cfg(test)]
mod tests;
