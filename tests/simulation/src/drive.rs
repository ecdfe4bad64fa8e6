//! The drives that are mapped: small, and with whatever makes services remember something.

use std::collections::VecDeque;

use anyhow::Result;
use echogrid_core::config::{Filter, Fusion};
use echogrid_core::{
    Echo, Increment, LocalizationConfig, MapperConfig, OdometryConfig, Pose2, Reading, Robot, Sensor as Sonar,
    SensorKind, move_by,
};
use echogrid_localizer::LocalizerService;
use echogrid_localizer::config::{LocalizerConfig, Source};
use echogrid_mapper::MapperService;
use echogrid_odometry::OdometryService;
use echogrid_service::Sensor;
use echogrid_topics::{Message, RawOdometry, Topic, TruePose};

/// What the sensor writes.
pub(crate) const OUTPUTS: &[Topic] = &[Topic::RobotDescription, Topic::TruePose, Topic::OdometryRaw, Topic::RangeScan];
const SONARS: u16 = 2;
const STEP_NS: u64 = 100_000_000;

/// A drive and how it is mapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drive {
    /// Odometry alone.
    Plain,
    /// Somebody is asked where the robot is, and the map is rectified.
    Fixes,
    /// Every layer that a mapper may keep.
    Layers,
    /// A robot that measures what is now.
    Live,
}

impl Drive {
    pub(crate) const ALL: [Self; 4] = [Self::Plain, Self::Fixes, Self::Layers, Self::Live];

    pub(crate) fn has_localizer(self) -> bool {
        self == Self::Fixes
    }

    pub(crate) fn is_live(self) -> bool {
        self == Self::Live
    }

    /// The services but the sensor, upstream to downstream.
    pub(crate) fn services(self) -> &'static [&'static str] {
        if self.has_localizer() {
            &["odometry", "localizer", "mapper", "publisher"]
        } else {
            &["odometry", "mapper", "publisher"]
        }
    }

    fn steps(self) -> u64 {
        match self {
            Self::Plain => 20,
            Self::Fixes | Self::Live => 16,
            Self::Layers => 12,
        }
    }

    /// All that the sensor gives.
    pub(crate) fn messages(self) -> Vec<(u64, Message)> {
        let mut all = vec![(0, Message::Robot(robot()))];
        let mut truth = Pose2::new(0.1 * f64::from(self as u8), 0.0, 0.0);
        let mut drive = truth;
        for step in 1..=self.steps() {
            let stamp_ns = step * STEP_NS;
            let moved = Increment { forward_m: 0.1, turn_rad: 0.05, lateral_m: 0.0 };
            truth = move_by(truth, moved);
            drive = move_by(drive, Increment { turn_rad: 0.06, ..moved });
            if self == Self::Fixes {
                all.push((stamp_ns, Message::TruePose(TruePose { map_from_base: Some(truth) })));
            }
            let raw = RawOdometry { odom_from_base: drive, v_mps: 1.0, w_radps: 0.5 };
            all.push((stamp_ns, Message::Odometry(raw)));
            let hit = |transducer| {
                let range_m = 0.6 + 0.1 * ((step + u64::from(transducer)) % 5) as f64;
                Reading { transducer, echo: Echo::Hit { range_m }, offset_ns: i32::from(transducer) * 4_000_000 }
            };
            all.push((stamp_ns + 1, Message::Scan((0..SONARS).map(hit).collect())));
        }
        all
    }

    pub(crate) fn odometry(self) -> Result<OdometryService> {
        let localization = LocalizationConfig { every_m: 0.4, every_s: 0.0, ..LocalizationConfig::default() };
        OdometryService::new(&OdometryConfig::default(), RESOLUTION_M, &localization, self.has_localizer())
    }

    pub(crate) fn localizer(self) -> Result<LocalizerService> {
        LocalizerService::new(&LocalizerConfig { source: Source::Truth, ..LocalizerConfig::default() })
    }

    pub(crate) fn mapper(self) -> Result<MapperService> {
        let has_layers = self == Self::Layers;
        let config = MapperConfig {
            resolution_m: RESOLUTION_M,
            filters: vec![Filter::Range, Filter::Stuck],
            remap: self.has_localizer(),
            doubt: has_layers,
            sonar_maps: has_layers,
            keep_readings: has_layers,
            // Mostly without states of cells: they are so many messages that the end of the stream hardly ever comes soon after the map.
            fusion: if self == Self::Live { Fusion::Auto } else { Fusion::FirstEcho },
            ..MapperConfig::default()
        };
        MapperService::new(&config, &OdometryConfig::default())
    }
}

/// Coarse: few tiles.
const RESOLUTION_M: f64 = 0.1;

fn robot() -> Robot {
    let sonars = Sonar {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.1, 0.0, 0.0),
        first_transducer: 0,
        transducers: SONARS,
        first_bearing_rad: 0.0,
        bearing_step_rad: 1.5,
        aperture_rad: 0.5,
        range_min_m: 0.1,
        range_max_m: 2.0,
        range_error_ratio: 0.01,
    };
    Robot { name: "small".into(), sensors: vec![sonars], ..Robot::default() }
}

/// A drive as a sensor gives it, from some message on.
#[derive(Debug)]
pub(crate) struct Recording {
    messages: VecDeque<(u64, Message)>,
    total: u64,
    is_live: bool,
}

impl Recording {
    /// Of a drive whose first so many messages nobody will measure any more.
    pub(crate) fn new(messages: &[(u64, Message)], is_live: bool, measured: u64) -> Self {
        let messages: VecDeque<_> = messages.iter().skip(measured as usize).cloned().collect();
        Self { total: messages.len() as u64, messages, is_live }
    }
}

impl Sensor for Recording {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        Ok(self.messages.pop_front())
    }

    fn is_live(&self) -> bool {
        self.is_live
    }

    fn total(&self) -> Option<u64> {
        Some(self.total)
    }
}
