//! Messages as the processes use them, and their way to and from shared memory.
//!
//! Whatever is read from shared memory is checked here before anyone uses it: a faulty peer gets
//! its messages counted and dropped, not the map.

use echogrid_core::localization::{Fix, Reason};
use echogrid_core::odometry::{Estimate, OdometryErrors};
use echogrid_core::verdict::{Verdict, VerdictCounts};
use echogrid_core::{
    CellIndex, Echo, Footprint, JointCovariance, POSITION_MAX_M, Pose2, Reading, Robot, Scales, Sensor, SensorKind,
    TileIndex,
};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::topic::Topic;
use crate::wire::{
    AckWire, EstimateWire, FixWire, HealthWire, LocalizationRequestWire, MAX_ACKS, MAX_SENSORS, MAX_VERDICTS,
    MapInfoWire, OdometryRawWire, ReadingWire, RobotWire, SensorWire, TILE_CELLS, TileWire, TruePoseWire,
    TrueWorldWire, VerdictWire, bytes_to_text, text_to_bytes,
};

/// Ranges beyond are taken for faults, metres.
const RANGE_LIMIT_M: f64 = 1e5;
/// Flags of an estimate.
const DEGRADED: u32 = 1;
const HOLD: u32 = 2;
/// Flags of the map in numbers.
const FINISHED: u32 = 1;
const MAP_DEGRADED: u32 = 2;
const MAP_HELD: u32 = 4;
/// Layers of tiles.
const LAYER_MAP: u16 = 0;
const LAYER_SONAR: u16 = 1;
const LAYER_DOUBT: u16 = 2;
/// What is known in a fix.
const POSITION: u32 = 1;
const HEADING: u32 = 2;

/// A message that breaks its contract.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{field} = {value}: expected {expected}")]
pub struct Fault {
    /// Which field.
    pub field: &'static str,
    /// What it held.
    pub value: String,
    /// What would have been right.
    pub expected: &'static str,
}

/// A pose as the drive reports it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RawOdometry {
    /// In the odometry frame.
    pub odom_from_base: Pose2,
    /// Forward speed, m/s.
    pub v_mps: f64,
    /// Turn rate, rad/s.
    pub w_radps: f64,
}

/// A pose in the map frame, and how far to trust it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseEstimate {
    /// Pose, covariance, accumulated errors.
    pub estimate: Estimate,
    /// Weight of a nominal reading (2 m), in [0, 1].
    pub trust: f64,
    /// Travelled since the start, metres.
    pub distance_m: f64,
    /// Whether a reading hardly says anything any more, for all that the odometry may be off.
    pub degraded: bool,
    /// Whether nothing is to be mapped from here.
    pub hold: bool,
}

/// Where the robot really is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TruePose {
    /// None: not known at this time.
    pub map_from_base: Option<Pose2>,
}

/// The world that a simulated robot is in.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueWorld {
    /// Name of a world that comes with echogrid, or the path of its file.
    pub name: String,
    /// Lowest and highest x and y of its walls, metres, map frame.
    pub bounds_m: [[f64; 2]; 2],
}

/// An absolute localization is wanted, of the stamp of the message.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LocalizationRequest {
    /// 1, 2, 3 …
    pub id: u64,
    /// Where the robot believes to be.
    pub estimate: PoseEstimate,
    /// Why.
    pub reason: Reason,
}

/// Where the robot was at the stamp of the message.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LocalizationFix {
    /// The request that it answers; 0: nobody asked.
    pub request: u64,
    /// None: that can't be told.
    pub fix: Option<Fix>,
}

/// What a tile is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Layer {
    /// The map.
    Map,
    /// What one sonar alone says: its number.
    Sonar(u16),
    /// How much odometry error the evidence of each cell carried, metres instead of log-odds.
    Doubt,
}

/// One tile of the map, whole.
#[derive(Debug, Clone)]
pub struct TileUpdate {
    /// Of which map.
    pub layer: Layer,
    /// Which tile.
    pub index: TileIndex,
    /// Number of the scan that changed it last.
    pub revision: u64,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Log-odds (of the doubt: metres, 0 or more), row by row; NaN is unknown.
    pub log_odds: Box<[f32; TILE_CELLS]>,
}

/// The map in numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapInfo {
    /// Number of the last scan in the map.
    pub revision: u64,
    /// Scans integrated.
    pub scans: u64,
    /// Cells that some reading touched.
    pub cells_known: u64,
    /// Cells with p > 0.65.
    pub cells_occupied: u64,
    /// Cells with p < 0.35.
    pub cells_free: u64,
    /// Sum over the known cells, bits.
    pub entropy_bits: f64,
    /// Of the latest estimate used.
    pub trust: f64,
    /// Travelled since the start, metres.
    pub distance_m: f64,
    /// Lowest and highest known cell.
    pub bounds: Option<(CellIndex, CellIndex)>,
    /// What became of the readings: the last verdict, where a fix changed it.
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
    /// Absolute fixes so far.
    pub fixes: u32,
    /// Fixes refused so far, for being too far off.
    pub fixes_refused: u32,
    /// What became of the readings of each sonar, by its number; of at most [`MAX_SENSORS`].
    pub sonars: Vec<VerdictCounts>,
}

/// State of a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum ServiceState {
    /// Not ready yet.
    Starting = 1,
    /// Taking messages.
    Running = 2,
    /// Its inputs have ended; it finishes.
    Draining = 3,
    /// Done, about to leave.
    Finished = 4,
    /// About to leave for an error.
    Failed = 5,
    /// It will not come back, says the launcher: nobody need wait for it.
    Gone = 6,
}

/// How far a consumer has integrated one of its inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ack {
    /// The input.
    pub topic: Topic,
    /// Epoch of the sequence; 0 before the first message.
    pub epoch: u64,
    /// Last sequence that will not be needed again.
    pub sequence: u64,
}

/// How a service is doing.
#[derive(Debug, Clone, PartialEq)]
pub struct Health {
    /// Its name in the graph.
    pub service: String,
    /// Its process.
    pub pid: u32,
    /// What it is doing.
    pub state: ServiceState,
    /// Messages taken in (of a sensor: given out).
    pub progress: u64,
    /// How many there will be in all; 0 unknown.
    pub total: u64,
    /// Stamp of the latest message handled, nanoseconds.
    pub stamp_ns: u64,
    /// Messages refused as faulty.
    pub faults: u64,
    /// Messages known to be lost.
    pub lost: u64,
    /// One per input.
    pub acks: Vec<Ack>,
    /// Empty if there was none.
    pub last_error: String,
}

impl Health {
    /// Of a process that has done nothing yet.
    #[must_use]
    pub fn new(service: impl Into<String>, pid: u32, state: ServiceState) -> Self {
        Self {
            service: service.into(),
            pid,
            state,
            progress: 0,
            total: 0,
            stamp_ns: 0,
            faults: 0,
            lost: 0,
            acks: Vec::new(),
            last_error: String::new(),
        }
    }
}

/// Content of a message of any topic.
#[derive(Debug, Clone)]
pub enum Message {
    /// [`Topic::RobotDescription`].
    Robot(Robot),
    /// [`Topic::OdometryRaw`].
    Odometry(RawOdometry),
    /// [`Topic::RangeScan`].
    Scan(Vec<Reading>),
    /// [`Topic::OdometryEstimate`].
    Estimate(PoseEstimate),
    /// [`Topic::MapTiles`].
    Tile(TileUpdate),
    /// [`Topic::MapInfo`].
    Info(Box<MapInfo>),
    /// [`Topic::RangeVerdict`]: transducer and verdict, in the order of the scan with the same stamp.
    Verdicts(Vec<(u16, Verdict)>),
    /// [`Topic::Health`].
    Health(Health),
    /// [`Topic::TruePose`].
    TruePose(TruePose),
    /// [`Topic::TrueWorld`].
    TrueWorld(TrueWorld),
    /// [`Topic::LocalizationRequest`].
    Request(Box<LocalizationRequest>),
    /// [`Topic::LocalizationFix`].
    Fix(LocalizationFix),
}

impl Message {
    /// The topic that it belongs to.
    #[must_use]
    pub fn topic(&self) -> Topic {
        match self {
            Self::Robot(_) => Topic::RobotDescription,
            Self::Odometry(_) => Topic::OdometryRaw,
            Self::Scan(_) => Topic::RangeScan,
            Self::Estimate(_) => Topic::OdometryEstimate,
            Self::Tile(_) => Topic::MapTiles,
            Self::Info(_) => Topic::MapInfo,
            Self::Verdicts(_) => Topic::RangeVerdict,
            Self::Health(_) => Topic::Health,
            Self::TruePose(_) => Topic::TruePose,
            Self::TrueWorld(_) => Topic::TrueWorld,
            Self::Request(_) => Topic::LocalizationRequest,
            Self::Fix(_) => Topic::LocalizationFix,
        }
    }
}

fn check(ok: bool, field: &'static str, value: impl ToString, expected: &'static str) -> Result<(), Fault> {
    if ok { Ok(()) } else { Err(Fault { field, value: value.to_string(), expected }) }
}

fn finite(field: &'static str, value: f64) -> Result<f64, Fault> {
    check(value.is_finite(), field, value, "a finite number")?;
    Ok(value)
}

fn at_least_zero(field: &'static str, value: f64) -> Result<f64, Fault> {
    check(value.is_finite() && value >= 0.0, field, value, "a finite number, 0 or more")?;
    Ok(value)
}

fn pose(x: f64, y: f64, theta: f64) -> Result<Pose2, Fault> {
    for (field, value) in [("x_m", x), ("y_m", y)] {
        check(value.is_finite() && value.abs() <= POSITION_MAX_M, field, value, "within ±3e7 m")?;
    }
    check(theta.is_finite() && theta.abs() <= 1e6, "theta_rad", theta, "a finite angle")?;
    Ok(Pose2::new(x, y, theta))
}

fn rows(covariance: &Matrix3<f64>) -> [f64; 9] {
    // Columns of the transpose are rows.
    let mut rows = [0.0; 9];
    rows.iter_mut().zip(covariance.transpose().iter()).for_each(|(slot, value)| *slot = *value);
    rows
}

/// Row and column of each number on and above the diagonal.
fn upper() -> impl Iterator<Item = (usize, usize)> {
    (0..5).flat_map(|row| (row..5).map(move |column| (row, column)))
}

/// Symmetric, whatever the numbers.
fn joint_covariance(numbers: &[f64; 15]) -> Result<JointCovariance, Fault> {
    let mut covariance = JointCovariance::zeros();
    for ((row, column), value) in upper().zip(numbers) {
        let checked = if row == column { at_least_zero("covariance", *value) } else { finite("covariance", *value) }?;
        (covariance[(row, column)], covariance[(column, row)]) = (checked, checked);
    }
    Ok(covariance)
}

/// At 1 no step would be left of what the drive measures.
fn scale(field: &'static str, value: f64) -> Result<f64, Fault> {
    check(value.abs() < 1.0, field, value, "between -1 and 1")?;
    Ok(value)
}

/// A description that has more sensors than fit is cut; see [`MAX_SENSORS`].
impl From<&Robot> for RobotWire {
    fn from(robot: &Robot) -> Self {
        let mut wire = Self {
            name: text_to_bytes(&robot.name),
            footprint_length_m: robot.footprint.length_m,
            footprint_width_m: robot.footprint.width_m,
            sensor_count: robot.sensors.len().min(MAX_SENSORS) as u32,
            ..Self::default()
        };
        for (slot, sensor) in wire.sensors.iter_mut().zip(&robot.sensors) {
            *slot = SensorWire {
                kind: match sensor.kind {
                    SensorKind::Sonar => 1,
                    SensorKind::Lidar => 2,
                },
                first_transducer: sensor.first_transducer,
                transducers: sensor.transducers,
                x_m: sensor.base_from_sensor.x,
                y_m: sensor.base_from_sensor.y,
                theta_rad: sensor.base_from_sensor.theta,
                first_bearing_rad: sensor.first_bearing_rad,
                bearing_step_rad: sensor.bearing_step_rad,
                aperture_rad: sensor.aperture_rad,
                range_min_m: sensor.range_min_m,
                range_max_m: sensor.range_max_m,
                range_error_ratio: sensor.range_error_ratio,
            };
        }
        wire
    }
}

impl TryFrom<&RobotWire> for Robot {
    type Error = Fault;

    fn try_from(wire: &RobotWire) -> Result<Self, Fault> {
        check(wire.sensor_count as usize <= MAX_SENSORS, "sensor_count", wire.sensor_count, "at most 256")?;
        let sensors = wire.sensors[..wire.sensor_count as usize]
            .iter()
            .map(|s| {
                let tau = core::f64::consts::TAU;
                check(s.aperture_rad > 0.0 && s.aperture_rad <= tau, "aperture_rad", s.aperture_rad, "in (0, 2π]")?;
                let limits = s.range_min_m >= 0.0 && s.range_max_m > s.range_min_m && s.range_max_m <= RANGE_LIMIT_M;
                check(limits, "range_max_m", s.range_max_m, "0 <= range_min_m < range_max_m <= 1e5")?;
                Ok(Sensor {
                    kind: match s.kind {
                        1 => SensorKind::Sonar,
                        2 => SensorKind::Lidar,
                        other => {
                            return Err(Fault {
                                field: "kind",
                                value: other.to_string(),
                                expected: "1 sonar or 2 lidar",
                            });
                        }
                    },
                    base_from_sensor: pose(s.x_m, s.y_m, s.theta_rad)?,
                    first_transducer: s.first_transducer,
                    transducers: s.transducers,
                    first_bearing_rad: finite("first_bearing_rad", s.first_bearing_rad)?,
                    bearing_step_rad: finite("bearing_step_rad", s.bearing_step_rad)?,
                    aperture_rad: s.aperture_rad,
                    range_min_m: s.range_min_m,
                    range_max_m: s.range_max_m,
                    range_error_ratio: at_least_zero("range_error_ratio", s.range_error_ratio)?,
                })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self {
            name: bytes_to_text(&wire.name),
            footprint: Footprint {
                length_m: at_least_zero("footprint_length_m", wire.footprint_length_m)?,
                width_m: at_least_zero("footprint_width_m", wire.footprint_width_m)?,
            },
            sensors,
        })
    }
}

impl From<&RawOdometry> for OdometryRawWire {
    fn from(raw: &RawOdometry) -> Self {
        Self {
            x_m: raw.odom_from_base.x,
            y_m: raw.odom_from_base.y,
            theta_rad: raw.odom_from_base.theta,
            v_mps: raw.v_mps,
            w_radps: raw.w_radps,
        }
    }
}

impl TryFrom<&OdometryRawWire> for RawOdometry {
    type Error = Fault;

    fn try_from(wire: &OdometryRawWire) -> Result<Self, Fault> {
        Ok(Self {
            odom_from_base: pose(wire.x_m, wire.y_m, wire.theta_rad)?,
            v_mps: finite("v_mps", wire.v_mps)?,
            w_radps: finite("w_radps", wire.w_radps)?,
        })
    }
}

impl From<&Reading> for ReadingWire {
    fn from(reading: &Reading) -> Self {
        let (echo, range_m) = match reading.echo {
            Echo::Hit { range_m } => (0, range_m),
            Echo::NoEcho => (1, 0.0),
            Echo::Invalid => (2, 0.0),
        };
        Self { range_m, offset_ns: reading.offset_ns, transducer: reading.transducer, echo, reserved: 0 }
    }
}

/// A reading that breaks its contract is an invalid reading: its neighbours are not lost with it.
impl From<&ReadingWire> for Reading {
    fn from(wire: &ReadingWire) -> Self {
        let echo = match wire.echo {
            0 if wire.range_m > 0.0 && wire.range_m <= RANGE_LIMIT_M => Echo::Hit { range_m: wire.range_m },
            1 => Echo::NoEcho,
            _ => Echo::Invalid,
        };
        Self { transducer: wire.transducer, echo, offset_ns: wire.offset_ns }
    }
}

impl From<&PoseEstimate> for EstimateWire {
    fn from(message: &PoseEstimate) -> Self {
        let PoseEstimate { estimate, trust, distance_m, degraded, hold } = message;
        let mut covariance = [0.0; 15];
        covariance.iter_mut().zip(upper()).for_each(|(slot, place)| *slot = estimate.covariance[place]);
        Self {
            x_m: estimate.pose.x,
            y_m: estimate.pose.y,
            theta_rad: estimate.pose.theta,
            covariance,
            lin_scale: estimate.scales.lin,
            ang_scale: estimate.scales.ang,
            travel_m: estimate.travel_m,
            turn_rad: estimate.turn_rad,
            e_lin_m: estimate.errors.e_lin_m,
            e_ang_rad: estimate.errors.e_ang_rad,
            eps_lin_m2: estimate.errors.eps_lin_m2,
            eps_ang_rad2: estimate.errors.eps_ang_rad2,
            trust: *trust,
            distance_m: *distance_m,
            fixes: estimate.fixes,
            flags: u32::from(*degraded) * DEGRADED + u32::from(*hold) * HOLD,
            fixes_refused: estimate.refused,
            reserved: 0,
        }
    }
}

impl TryFrom<&EstimateWire> for PoseEstimate {
    type Error = Fault;

    fn try_from(wire: &EstimateWire) -> Result<Self, Fault> {
        check((0.0..=1.0).contains(&wire.trust), "trust", wire.trust, "in [0, 1]")?;
        Ok(Self {
            estimate: Estimate {
                pose: pose(wire.x_m, wire.y_m, wire.theta_rad)?,
                covariance: joint_covariance(&wire.covariance)?,
                scales: Scales { lin: scale("lin_scale", wire.lin_scale)?, ang: scale("ang_scale", wire.ang_scale)? },
                travel_m: at_least_zero("travel_m", wire.travel_m)?,
                turn_rad: at_least_zero("turn_rad", wire.turn_rad)?,
                errors: OdometryErrors {
                    e_lin_m: finite("e_lin_m", wire.e_lin_m)?,
                    e_ang_rad: finite("e_ang_rad", wire.e_ang_rad)?,
                    eps_lin_m2: at_least_zero("eps_lin_m2", wire.eps_lin_m2)?,
                    eps_ang_rad2: at_least_zero("eps_ang_rad2", wire.eps_ang_rad2)?,
                },
                fixes: wire.fixes,
                refused: wire.fixes_refused,
            },
            trust: wire.trust,
            distance_m: at_least_zero("distance_m", wire.distance_m)?,
            degraded: wire.flags & DEGRADED != 0,
            hold: wire.flags & HOLD != 0,
        })
    }
}

impl From<&TruePose> for TruePoseWire {
    fn from(TruePose { map_from_base }: &TruePose) -> Self {
        let Pose2 { x, y, theta } = map_from_base.unwrap_or_default();
        Self { x_m: x, y_m: y, theta_rad: theta, known: u32::from(map_from_base.is_some()), reserved: 0 }
    }
}

impl TryFrom<&TruePoseWire> for TruePose {
    type Error = Fault;

    fn try_from(wire: &TruePoseWire) -> Result<Self, Fault> {
        let known = (wire.known != 0).then(|| pose(wire.x_m, wire.y_m, wire.theta_rad));
        Ok(Self { map_from_base: known.transpose()? })
    }
}

/// A name that is too long is cut.
impl From<&TrueWorld> for TrueWorldWire {
    fn from(TrueWorld { name, bounds_m: [[x_low, y_low], [x_high, y_high]] }: &TrueWorld) -> Self {
        Self { name: text_to_bytes(name), bounds_m: [*x_low, *y_low, *x_high, *y_high] }
    }
}

impl TryFrom<&TrueWorldWire> for TrueWorld {
    type Error = Fault;

    fn try_from(wire: &TrueWorldWire) -> Result<Self, Fault> {
        let [x_low, y_low, x_high, y_high] = wire.bounds_m;
        for value in wire.bounds_m {
            check(value.is_finite() && value.abs() <= POSITION_MAX_M, "bounds_m", value, "within ±3e7 m")?;
        }
        check(x_low <= x_high && y_low <= y_high, "bounds_m", x_high, "the lowest x and y before the highest")?;
        Ok(Self { name: bytes_to_text(&wire.name), bounds_m: [[x_low, y_low], [x_high, y_high]] })
    }
}

impl From<&LocalizationRequest> for LocalizationRequestWire {
    fn from(LocalizationRequest { id, estimate, reason }: &LocalizationRequest) -> Self {
        Self { id: *id, estimate: estimate.into(), reason: *reason as u32, reserved: 0 }
    }
}

impl TryFrom<&LocalizationRequestWire> for LocalizationRequest {
    type Error = Fault;

    fn try_from(wire: &LocalizationRequestWire) -> Result<Self, Fault> {
        let reason = [Reason::Degraded, Reason::Schedule].into_iter().find(|reason| *reason as u32 == wire.reason);
        let reason = reason.ok_or(Fault { field: "reason", value: wire.reason.to_string(), expected: "1 or 2" })?;
        Ok(Self { id: wire.id, estimate: (&wire.estimate).try_into()?, reason })
    }
}

impl From<&LocalizationFix> for FixWire {
    fn from(LocalizationFix { request, fix }: &LocalizationFix) -> Self {
        let Some(Fix { pose, covariance, position_known, heading_known }) = fix else {
            return Self { request: *request, ..Self::default() };
        };
        Self {
            request: *request,
            x_m: pose.x,
            y_m: pose.y,
            theta_rad: pose.theta,
            covariance: rows(covariance),
            known: u32::from(*position_known) * POSITION + u32::from(*heading_known) * HEADING,
            reserved: 0,
        }
    }
}

impl TryFrom<&FixWire> for LocalizationFix {
    type Error = Fault;

    fn try_from(wire: &FixWire) -> Result<Self, Fault> {
        let (position_known, heading_known) = (wire.known & POSITION != 0, wire.known & HEADING != 0);
        if !position_known && !heading_known {
            return Ok(Self { request: wire.request, fix: None });
        }
        let fix = Fix {
            pose: pose(wire.x_m, wire.y_m, wire.theta_rad)?,
            covariance: Matrix3::from_row_slice(&wire.covariance),
            position_known,
            heading_known,
        };
        fix.validate().map_err(|error| Fault { field: error.field, value: error.value, expected: error.expected })?;
        Ok(Self { request: wire.request, fix: Some(fix) })
    }
}

impl From<&TileUpdate> for TileWire {
    fn from(tile: &TileUpdate) -> Self {
        let (layer, sonar) = match tile.layer {
            Layer::Map => (LAYER_MAP, 0),
            Layer::Sonar(number) => (LAYER_SONAR, number),
            Layer::Doubt => (LAYER_DOUBT, 0),
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
            other => {
                return Err(Fault { field: "layer", value: other.to_string(), expected: "0 map, 1 sonar or 2 doubt" });
            }
        };
        if let Some(value) = wire.log_odds.iter().find(|value| layer == Layer::Doubt && **value < 0.0) {
            check(false, "log_odds", value, "metres, 0 or more, where the layer is doubt")?;
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
                + u32::from(info.held) * MAP_HELD,
            fixes: info.fixes,
            fixes_refused: info.fixes_refused,
            sonar_count: info.sonars.len().min(MAX_SENSORS) as u32,
            reserved: 0,
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
            fixes: wire.fixes,
            fixes_refused: wire.fixes_refused,
            sonars,
        })
    }
}

impl From<&(u16, Verdict)> for VerdictWire {
    fn from((transducer, verdict): &(u16, Verdict)) -> Self {
        Self { transducer: *transducer, verdict: *verdict as u8, reserved: 0 }
    }
}

impl TryFrom<&VerdictWire> for (u16, Verdict) {
    type Error = Fault;

    fn try_from(wire: &VerdictWire) -> Result<Self, Fault> {
        let verdict = Verdict::ALL.into_iter().find(|verdict| *verdict as u8 == wire.verdict).ok_or(Fault {
            field: "verdict",
            value: wire.verdict.to_string(),
            expected: "a known verdict code",
        })?;
        Ok((wire.transducer, verdict))
    }
}

impl From<&Health> for HealthWire {
    fn from(health: &Health) -> Self {
        let mut acks = [AckWire::default(); MAX_ACKS];
        for (slot, ack) in acks.iter_mut().zip(&health.acks) {
            *slot = AckWire { topic: ack.topic as u32, reserved: 0, epoch: ack.epoch, sequence: ack.sequence };
        }
        Self {
            service: text_to_bytes(&health.service),
            pid: health.pid,
            state: health.state as u32,
            progress: health.progress,
            total: health.total,
            stamp_ns: health.stamp_ns,
            faults: health.faults,
            lost: health.lost,
            ack_count: health.acks.len().min(MAX_ACKS) as u32,
            reserved: 0,
            acks,
            last_error: text_to_bytes(&health.last_error),
        }
    }
}

impl TryFrom<&HealthWire> for Health {
    type Error = Fault;

    fn try_from(wire: &HealthWire) -> Result<Self, Fault> {
        use ServiceState::{Draining, Failed, Finished, Gone, Running, Starting};
        let state = [Starting, Running, Draining, Finished, Failed, Gone]
            .into_iter()
            .find(|state| *state as u32 == wire.state)
            .ok_or(Fault { field: "state", value: wire.state.to_string(), expected: "1 to 6" })?;
        check(wire.ack_count as usize <= MAX_ACKS, "ack_count", wire.ack_count, "at most 8")?;
        let acks = wire.acks[..wire.ack_count as usize]
            .iter()
            .map(|ack| {
                let topic = Topic::from_code(ack.topic).ok_or(Fault {
                    field: "acks.topic",
                    value: ack.topic.to_string(),
                    expected: "a topic code",
                })?;
                Ok(Ack { topic, epoch: ack.epoch, sequence: ack.sequence })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self {
            service: bytes_to_text(&wire.service),
            pid: wire.pid,
            state,
            progress: wire.progress,
            total: wire.total,
            stamp_ns: wire.stamp_ns,
            faults: wire.faults,
            lost: wire.lost,
            acks,
            last_error: bytes_to_text(&wire.last_error),
        })
    }
}
