//! The topics: names, delivery, quality of service.

/// A stream of messages between processes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u32)]
pub enum Topic {
    /// Sensors and footprint of the robot.
    RobotDescription = 1,
    /// Poses as the drive reports them.
    OdometryRaw = 2,
    /// Readings of a sonar ring or lidar scan.
    RangeScan = 3,
    /// Poses in the map frame with their errors.
    OdometryEstimate = 4,
    /// Tiles of the grid that changed.
    MapTiles = 5,
    /// The map in numbers.
    MapInfo = 6,
    /// What became of each reading.
    RangeVerdict = 7,
    /// How each service is doing.
    Health = 8,
    /// Where the robot really is, from a sensor that knows: a simulator, or a log with true poses. Not for odometry or
    /// mapper, which have to do without.
    TruePose = 9,
    /// The odometry asks where the robot is.
    LocalizationRequest = 10,
    /// The answer, and fixes that nobody asked for.
    LocalizationFix = 11,
    /// The world that a simulated robot is in. Not for odometry or mapper either.
    TrueWorld = 12,
}

/// What a topic promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Nothing lost, in order, over the lives of producers and consumers: producers stay within a window of what their
    /// slowest consumer has stored, and a restarted one goes on with the numbering.
    Lossless,
    /// Nothing lost, in order, to who is there: producers stay within a window of what was taken in. Who comes anew gets
    /// what counts once more.
    Relayed,
    /// The latest value counts; a late joiner gets it.
    Latest,
    /// May be dropped when nobody keeps up.
    Droppable,
}

impl Delivery {
    /// Whether producers wait for their consumers, and say that the stream ends.
    #[must_use]
    pub fn is_stream(self) -> bool {
        matches!(self, Self::Lossless | Self::Relayed)
    }
}

/// Room that a topic reserves in shared memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Messages a producer keeps for late or restarted consumers.
    pub history: usize,
    /// Messages that queue in front of one consumer.
    pub buffer: usize,
    /// Messages a producer may be ahead of what its slowest consumer has acknowledged.
    pub window: u64,
    /// Consumers, with room for tools and a leaked one.
    pub subscribers: usize,
    /// Producers, likewise.
    pub publishers: usize,
    /// Largest slice in a message; 1 where the payload is one struct.
    pub slice_len: usize,
    /// Size of one payload element, bytes.
    pub element_size: usize,
}

impl Topic {
    /// Every topic.
    pub const ALL: [Self; 12] = [
        Self::RobotDescription,
        Self::OdometryRaw,
        Self::RangeScan,
        Self::OdometryEstimate,
        Self::MapTiles,
        Self::MapInfo,
        Self::RangeVerdict,
        Self::Health,
        Self::TruePose,
        Self::LocalizationRequest,
        Self::LocalizationFix,
        Self::TrueWorld,
    ];

    /// Its name among the services of a domain.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::RobotDescription => "robot/description",
            Self::OdometryRaw => "odometry/raw",
            Self::RangeScan => "range/scan",
            Self::OdometryEstimate => "odometry/estimate",
            Self::MapTiles => "map/tiles",
            Self::MapInfo => "map/info",
            Self::RangeVerdict => "range/verdict",
            Self::Health => "health",
            Self::TruePose => "truth/pose",
            Self::LocalizationRequest => "localization/request",
            Self::LocalizationFix => "localization/fix",
            Self::TrueWorld => "truth/world",
        }
    }

    /// The topic with this code on the wire.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| *topic as u32 == code)
    }

    /// What it promises.
    #[must_use]
    pub fn delivery(self) -> Delivery {
        match self {
            Self::OdometryRaw | Self::RangeScan | Self::OdometryEstimate | Self::TruePose => Delivery::Lossless,
            // A tile is newer than the last of its place, and a request can be made again.
            Self::MapTiles | Self::LocalizationRequest => Delivery::Relayed,
            // Who waits for a fix waits for one at a time.
            Self::RobotDescription | Self::MapInfo | Self::Health | Self::LocalizationFix | Self::TrueWorld => {
                Delivery::Latest
            }
            Self::RangeVerdict => Delivery::Droppable,
        }
    }

    /// Whether its numbering goes on over the lives of its producers.
    #[must_use]
    pub fn resumes(self) -> bool {
        self.delivery() == Delivery::Lossless
    }

    /// Quality of service where scans hold at most `max_readings` readings.
    ///
    /// Histories outlast the longest outage that is to be survived (20 s of odometry at 100 Hz);
    /// for large scans they are limited by memory instead.
    #[must_use]
    pub fn qos(self, max_readings: usize) -> Qos {
        use crate::wire::{
            EstimateWire, FixWire, HealthWire, LocalizationRequestWire, MapInfoWire, OdometryRawWire, ReadingWire,
            RobotWire, TileWire, TruePoseWire, TrueWorldWire, VerdictWire,
        };
        let stream = Qos {
            history: 2048,
            buffer: 4096,
            window: 1024,
            subscribers: 5,
            publishers: 2,
            slice_len: 1,
            element_size: 0,
        };
        let latest = Qos { history: 1, buffer: 1, window: u64::MAX, subscribers: 8, ..stream };
        match self {
            Self::OdometryRaw => Qos { element_size: size_of::<OdometryRawWire>(), ..stream },
            Self::OdometryEstimate => Qos { element_size: size_of::<EstimateWire>(), ..stream },
            Self::RangeScan => {
                let scan_bytes = max_readings.max(1) * size_of::<ReadingWire>();
                let history = ((2 << 20) / scan_bytes).clamp(64, 2048);
                Qos {
                    history,
                    buffer: 2 * history,
                    window: (history / 2) as u64,
                    slice_len: max_readings.max(1),
                    element_size: size_of::<ReadingWire>(),
                    ..stream
                }
            }
            Self::MapTiles => {
                // Whole tiles, each newer than the last of its place: a history of all would be far larger than the map.
                Qos { history: 0, buffer: 128, window: 64, element_size: size_of::<TileWire>(), ..stream }
            }
            Self::RobotDescription => Qos { element_size: size_of::<RobotWire>(), ..latest },
            Self::TrueWorld => Qos { element_size: size_of::<TrueWorldWire>(), ..latest },
            Self::MapInfo => Qos { element_size: size_of::<MapInfoWire>(), ..latest },
            Self::Health => {
                Qos { buffer: 4, publishers: 16, subscribers: 16, element_size: size_of::<HealthWire>(), ..latest }
            }
            Self::TruePose => Qos { element_size: size_of::<TruePoseWire>(), ..stream },
            // One at a time is on its way.
            Self::LocalizationRequest => Qos {
                history: 16,
                buffer: 32,
                window: 16,
                element_size: size_of::<LocalizationRequestWire>(),
                ..stream
            },
            Self::LocalizationFix => Qos { buffer: 16, element_size: size_of::<FixWire>(), ..latest },
            Self::RangeVerdict => Qos {
                history: 0,
                buffer: 16,
                window: u64::MAX,
                slice_len: max_readings.max(1),
                element_size: size_of::<VerdictWire>(),
                ..stream
            },
        }
    }
}

impl Qos {
    /// Bytes that one producer reserves for its messages (header 32 B, iceoryx2's own 64 B at most).
    #[must_use]
    pub fn segment_bytes(&self) -> u64 {
        let chunks = self.subscribers * (self.buffer + 3) + self.history + 2;
        (chunks * (self.slice_len * self.element_size + 96)) as u64
    }
}

/// Shared memory that a whole graph can come to need at most, bytes.
#[must_use]
pub fn memory_budget_bytes(max_readings: usize, services: u64) -> u64 {
    let streams: u64 = Topic::ALL
        .into_iter()
        .map(|topic| {
            let producers = if topic == Topic::Health { services } else { 1 };
            producers * topic.qos(max_readings).segment_bytes()
        })
        .sum();
    // Connections, service tables, node files.
    streams + (8 << 20)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_whole_graph_fits_the_64_mib_that_containers_get() {
        for max_readings in [8, 16, 181, 361] {
            let bytes = memory_budget_bytes(max_readings, 4);
            assert!(bytes < 64 << 20, "{max_readings} readings: {} MiB", bytes >> 20);
        }
    }

    #[test]
    fn windows_fit_the_buffers_so_that_overflow_never_happens_under_back_pressure() {
        for topic in Topic::ALL {
            let qos = topic.qos(181);
            if topic.delivery().is_stream() {
                assert!(qos.window as usize <= qos.buffer / 2, "{topic:?} {qos:?}");
            }
        }
    }

    #[test]
    fn codes_find_their_topics() {
        for topic in Topic::ALL {
            assert_eq!(Topic::from_code(topic as u32), Some(topic));
        }
        assert_eq!(Topic::from_code(0), None);
    }
}
