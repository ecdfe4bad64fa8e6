//! Any messages of a sensor that keep the contract, however absurd: odometry, localizer and mapper take them, and the mapper tells
//! nothing that would be refused.
#![no_main]

use anyhow::Result;
use echogrid_core::config::NoEcho;
use echogrid_core::localization::{Ask, LocalizationConfig};
use echogrid_core::parts::{Parts, Saved};
use echogrid_core::{MapperConfig, OdometryConfig, Reading, Robot};
use echogrid_fuzz::Numbers;
use echogrid_localizer::LocalizerService;
use echogrid_localizer::config::{LocalizerConfig, Source};
use echogrid_mapper::MapperService;
use echogrid_odometry::OdometryService;
use echogrid_service::{Input, Outbox, Sensor, Service, local};
use echogrid_topics::contract::{
    MapInfoWire, OdometryRawWire, ReadingWire, RobotWire, SensorWire, TileWire, TruePoseWire, VerdictWire,
};
use echogrid_topics::{MapInfo, Message, RawOdometry, TileUpdate, Topic, TruePose};
use libfuzzer_sys::fuzz_target;

/// A cell is so large that a sensor which sees through a wide angle costs no minutes.
const RESOLUTION_M: f64 = 10.0;

/// Says what the bytes say.
struct Fuzzed<'a> {
    numbers: Numbers<'a>,
    stamp_ns: u64,
    described: bool,
}

impl Fuzzed<'_> {
    fn sensor(&mut self) -> Option<SensorWire> {
        let [kind, first_transducer, transducers] = self.numbers.take()?;
        Some(SensorWire {
            kind: u32::from(kind),
            first_transducer: u16::from(first_transducer),
            transducers: u16::from(transducers),
            x_m: self.numbers.next()?,
            y_m: self.numbers.next()?,
            theta_rad: self.numbers.next()?,
            first_bearing_rad: self.numbers.next()?,
            bearing_step_rad: self.numbers.next()?,
            aperture_rad: self.numbers.next()?,
            range_min_m: self.numbers.next()?,
            range_max_m: self.numbers.hundredths()?,
            range_error_ratio: self.numbers.next()?,
        })
    }

    fn robot(&mut self) -> Option<Message> {
        let [sensors] = self.numbers.take()?;
        let mut wire = RobotWire { sensor_count: u32::from(sensors % 8), ..RobotWire::default() };
        for slot in wire.sensors.iter_mut().take(usize::from(sensors % 8)) {
            *slot = self.sensor()?;
        }
        Robot::try_from(&wire).ok().map(Message::Robot)
    }

    fn reading(&mut self) -> Option<Reading> {
        let [transducer, echo] = self.numbers.take()?;
        let range_m = self.numbers.hundredths()?;
        let offset_ns = i32::from_le_bytes(self.numbers.take()?);
        Some((&ReadingWire { range_m, offset_ns, transducer: u16::from(transducer), echo, reserved: 0 }).into())
    }

    /// A message that is not refused.
    fn message(&mut self) -> Option<Message> {
        loop {
            let [what, later] = self.numbers.take()?;
            self.numbers.any = what & 0x80 != 0;
            self.stamp_ns = if what & 0x40 != 0 {
                u64::from_le_bytes(self.numbers.take()?)
            } else {
                self.stamp_ns.saturating_add(u64::from(later) * 10_000_000)
            };
            let message = match what % 4 {
                0 | 1 => {
                    let (x_m, y_m, theta_rad) = (self.numbers.next()?, self.numbers.next()?, self.numbers.next()?);
                    let wire = OdometryRawWire { x_m, y_m, theta_rad, ..OdometryRawWire::default() };
                    RawOdometry::try_from(&wire).map(Message::Odometry)
                }
                2 => {
                    let [count] = self.numbers.take()?;
                    let readings: Vec<Reading> = (0..count % 32).map_while(|_| self.reading()).collect();
                    Ok(Message::Scan(readings))
                }
                _ => {
                    let [known] = self.numbers.take()?;
                    let (x_m, y_m, theta_rad) = (self.numbers.next()?, self.numbers.next()?, self.numbers.next()?);
                    let wire = TruePoseWire { x_m, y_m, theta_rad, known: u32::from(known & 1), reserved: 0 };
                    TruePose::try_from(&wire).map(Message::TruePose)
                }
            };
            if let Ok(message) = message {
                return Some(message);
            }
        }
    }
}

impl Sensor for Fuzzed<'_> {
    fn outputs(&self) -> &'static [Topic] {
        &[Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan, Topic::TruePose]
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        let message = if self.described { self.message() } else { self.robot() };
        self.described = true;
        Ok(message.map(|message| (self.stamp_ns, message)))
    }
}

/// Receives what the mapper tells, as a process would.
struct Receiver;

impl Service for Receiver {
    fn inputs(&self) -> &'static [Topic] {
        &[Topic::MapTiles, Topic::MapInfo, Topic::RangeVerdict]
    }

    fn outputs(&self) -> &'static [Topic] {
        &[]
    }

    fn save(&mut self, _parts: &mut Parts) {}

    fn restore(&mut self, _saved: &Saved) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, input: Input, _out: &mut Outbox) -> Result<()> {
        let Input::Message { message, .. } = input else { return Ok(()) };
        match message {
            Message::Tile(tile) => drop(TileUpdate::try_from(&TileWire::from(&tile))?),
            Message::Info(info) => assert_eq!(MapInfo::try_from(&MapInfoWire::from(&info))?, info),
            Message::Verdicts(verdicts) => {
                for verdict in &verdicts {
                    assert_eq!(&<(u16, _)>::try_from(&VerdictWire::from(verdict))?, verdict);
                }
            }
            other => panic!("not asked for: {other:?}"),
        }
        Ok(())
    }
}

fuzz_target!(|bytes: &[u8]| {
    let Some((first, bytes)) = bytes.split_first() else { return };
    let mut sensor = Fuzzed { numbers: Numbers { bytes, any: first & 1 != 0 }, stamp_ns: 0, described: false };
    let localization =
        LocalizationConfig { ask: Ask::Both, every_m: 10.0, every_s: 1.0, ..LocalizationConfig::default() };
    let localizer = LocalizerConfig {
        source: Source::Truth,
        position_sigma_m: if first & 2 == 0 { 0.0 } else { 0.1 },
        heading_sigma_rad: 0.01,
        ..LocalizerConfig::default()
    };
    let mapper = MapperConfig {
        resolution_m: RESOLUTION_M,
        remap: first & 4 != 0,
        doubt: first & 8 != 0,
        sonar_maps: first & 16 != 0,
        keep_readings: first & 32 != 0,
        no_echo: if first & 64 == 0 { NoEcho::Ignore } else { NoEcho::Clear },
        ..MapperConfig::default()
    };
    let odometry = OdometryConfig::default();
    let mut odometry_service =
        OdometryService::new(&odometry, RESOLUTION_M, &localization, true).expect("its configuration is one");
    let mut localizer = LocalizerService::new(&localizer).expect("its configuration is one");
    let mut mapper = MapperService::new(&mapper, &odometry).expect("its configuration is one");
    // A robot that no map can be made with is an error and no panic.
    if let Err(error) =
        local::run(&mut sensor, &mut [&mut odometry_service, &mut localizer, &mut mapper, &mut Receiver])
    {
        let error = format!("{error:#}");
        assert!(error.contains("[mapper]"), "{error}");
    }
});
