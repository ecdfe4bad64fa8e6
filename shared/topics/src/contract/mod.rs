//! The contract between the processes: what each topic says, and how that lies in shared memory.
//!
//! A file per family holds its messages, their layout on the wire, what is checked of them on arrival, and how much room
//! they get. The table in this file gives each topic its number, name, delivery and message; everything else follows.

mod checks;
mod health;
mod localization;
mod map;
mod odometry;
mod range;
mod robot;

#[cfg(test)]
mod testing;
mod truth;

pub use checks::Fault;
use echogrid_core::{Reading, Robot, Verdict};
pub use health::{Ack, AckWire, Health, HealthWire, MAX_ACKS, ServiceState};
pub use localization::{FixWire, LocalizationFix, LocalizationRequest, LocalizationRequestWire};
pub use map::{Layer, MAX_VERDICTS, MapInfo, MapInfoWire, TILE_CELLS, TileUpdate, TileWire};
pub use odometry::{EstimateWire, IncidentsWire, OdometryRawWire, PoseEstimate, RawOdometry};
pub use range::{ReadingWire, VerdictWire};
pub use robot::{MAX_SENSORS, RobotWire, SensorWire};
pub use truth::{TruePose, TruePoseWire, TrueWorld, TrueWorldWire};

use crate::table::topics;

topics! {
    /// Sensors and footprint of the robot.
    1 RobotDescription "robot/description" Latest Robot(Robot);
    /// Poses as the drive reports them.
    2 OdometryRaw "odometry/raw" Lossless Odometry(RawOdometry);
    /// Readings of a sonar ring or lidar scan.
    3 RangeScan "range/scan" Lossless Scan(Vec<Reading>);
    /// Poses in the map frame with their errors.
    4 OdometryEstimate "odometry/estimate" Lossless Estimate(PoseEstimate);
    /// Tiles of the grid that changed; each is newer than the last of its place.
    5 MapTiles "map/tiles" Relayed Tile(TileUpdate);
    /// The map in numbers.
    6 MapInfo "map/info" Latest Info(MapInfo);
    /// What became of each reading: transducer and verdict, in the order of the scan with the same stamp.
    7 RangeVerdict "range/verdict" Droppable Verdicts(Vec<(u16, Verdict)>);
    /// How each service is doing.
    8 Health "health" Latest Health(Health);
    /// Where the robot really is, from a sensor that knows: a simulator, or a log with true poses. Not for odometry or
    /// mapper, which have to do without.
    9 TruePose "truth/pose" Lossless TruePose(TruePose);
    /// The odometry asks where the robot is; it can ask again.
    10 LocalizationRequest "localization/request" Relayed Request(LocalizationRequest);
    /// The answer, and fixes that nobody asked for; who waits for one waits for one at a time.
    11 LocalizationFix "localization/fix" Latest Fix(LocalizationFix);
    /// The world that a simulated robot is in. Not for odometry or mapper either.
    12 TrueWorld "truth/world" Latest TrueWorld(TrueWorld);
}
