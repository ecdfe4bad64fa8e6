//! The messages as they lie in shared memory.
//!
//! Every type is `#[repr(C)]`, in SI units, of fixed layout, and named `echogrid/<Name>/<version>`;
//! a process in C, C++ or Python that iceoryx2 speaks to can declare the same. `layout.txt` beside
//! this crate lists every field with its offset; a test fails when a layout changes and that file,
//! with the version in it, does not.
//!
//! Enumerations travel as numbers and are checked on arrival: see [`crate::message`].

use iceoryx2::prelude::ZeroCopySend;

/// Cells in a map tile (64 × 64).
pub const TILE_CELLS: usize = 4096;
/// Sensors that a robot description can hold.
pub const MAX_SENSORS: usize = 256;
// A description of every robot that there can be fits.
const _: () = assert!(MAX_SENSORS == echogrid_core::robot::SENSORS_MAX);
/// Inputs that a health message can acknowledge.
pub const MAX_ACKS: usize = 8;
/// Verdict kinds that a map info can count.
pub const MAX_VERDICTS: usize = 16;

/// One field of a wire type: name, type, offset in bytes.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Name.
    pub name: &'static str,
    /// Rust type.
    pub ty: &'static str,
    /// Bytes from the start of the message.
    pub offset: usize,
}

/// A message type with its name, version and layout.
pub trait Wire: ZeroCopySend + core::fmt::Debug + Copy + Default + 'static {
    /// `echogrid/<Name>/<version>`.
    const SCHEMA: &'static str;
    /// Fields in order.
    const FIELDS: &'static [Field];
}

macro_rules! wire {
    ($(#[$doc:meta])* $schema:literal $name:ident { $($(#[$fdoc:meta])* $field:ident: $ty:ty,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, ZeroCopySend)]
        #[type_name($schema)]
        #[repr(C)]
        pub struct $name { $($(#[$fdoc])* pub $field: $ty,)* }

        impl Default for $name {
            fn default() -> Self { Self { $($field: crate::wire::Zero::ZERO,)* } }
        }
        impl crate::wire::Zero for $name {
            const ZERO: Self = Self { $($field: crate::wire::Zero::ZERO,)* };
        }
        impl Wire for $name {
            const SCHEMA: &'static str = $schema;
            const FIELDS: &'static [Field] = &[$(Field {
                name: stringify!($field),
                ty: stringify!($ty),
                offset: core::mem::offset_of!($name, $field),
            },)*];
        }
    };
}

/// All-zero values, also of arrays longer than `Default` knows.
pub trait Zero {
    /// Zero.
    const ZERO: Self;
}
macro_rules! zero { ($($ty:ty = $zero:expr),*) => { $(impl Zero for $ty { const ZERO: Self = $zero; })* } }
zero!(u8 = 0, u16 = 0, u32 = 0, u64 = 0, i32 = 0, f32 = 0.0, f64 = 0.0);
impl<T: Zero, const N: usize> Zero for [T; N] {
    const ZERO: Self = [T::ZERO; N];
}

wire! {
    /// Goes with every message of every topic.
    "echogrid/Header/2" Header {
        /// Number of this message: 1, 2, 3 …; on a lossless topic within the run, else within the producer's life.
        sequence: u64,
        /// On a lossless topic the run's, as the plan says; else the producer's life.
        epoch: u64,
        /// When the content was true, by the sensor's clock, nanoseconds.
        stamp_ns: u64,
        /// Bit 0: the stream ends here, the payload says nothing.
        flags: u32,
        /// The producer's life: differs after each restart.
        life: u32,
    }
}

wire! {
    /// A range sensor of the robot.
    "echogrid/Sensor/1" SensorWire {
        /// 1 sonar, 2 lidar.
        kind: u32,
        /// Index of its first transducer.
        first_transducer: u16,
        /// How many transducers.
        transducers: u16,
        /// Mount in the robot's base frame (x forward, y left), metres.
        x_m: f64,
        /// Metres.
        y_m: f64,
        /// Radians.
        theta_rad: f64,
        /// Bearing of the first transducer, radians.
        first_bearing_rad: f64,
        /// From one transducer to the next, radians.
        bearing_step_rad: f64,
        /// Full aperture of one transducer's cone, radians.
        aperture_rad: f64,
        /// Nearest measurable range, metres.
        range_min_m: f64,
        /// Range to which it can see at all, metres.
        range_max_m: f64,
        /// Range error as a share of the range.
        range_error_ratio: f64,
    }
}

wire! {
    /// `robot/description`: the sensors and the footprint.
    "echogrid/RobotDescription/2" RobotWire {
        /// UTF-8, padded with zeros.
        name: [u8; 64],
        /// Along x, metres; 0 unknown.
        footprint_length_m: f64,
        /// Along y, metres; 0 unknown.
        footprint_width_m: f64,
        /// How many of `sensors` are in use.
        sensor_count: u32,
        /// Zero.
        reserved: u32,
        /// The sensors in the order of their transducers.
        sensors: [SensorWire; 256],
    }
}

wire! {
    /// `odometry/raw`: what the drive believes, in its own odometry frame.
    "echogrid/OdometryRaw/1" OdometryRawWire {
        /// Metres.
        x_m: f64,
        /// Metres.
        y_m: f64,
        /// Radians, counter-clockwise.
        theta_rad: f64,
        /// Forward speed, m/s.
        v_mps: f64,
        /// Turn rate, rad/s.
        w_radps: f64,
    }
}

wire! {
    /// One reading of a `range/scan` message, whose payload is a slice of these.
    "echogrid/RangeReading/1" ReadingWire {
        /// Metres from the transducer; counts only for a hit.
        range_m: f64,
        /// Nanoseconds after the stamp of the message.
        offset_ns: i32,
        /// Index into the robot's transducers.
        transducer: u16,
        /// 0 hit, 1 no echo, 2 invalid.
        echo: u8,
        /// Zero.
        reserved: u8,
    }
}

wire! {
    /// `odometry/estimate`: where the robot is in the map, and how far to trust that.
    "echogrid/OdometryEstimate/3" EstimateWire {
        /// Metres, map frame.
        x_m: f64,
        /// Metres, map frame.
        y_m: f64,
        /// Radians.
        theta_rad: f64,
        /// Covariance of (x, y, θ, `lin_scale`, `ang_scale`) on and above its diagonal, row by row; m, rad, 1.
        covariance: [f64; 15],
        /// What the drive is believed to measure too much of every translation, as a share of it, and is taken out.
        lin_scale: f64,
        /// Likewise of every rotation.
        ang_scale: f64,
        /// Λ: travelled since the last absolute fix, metres.
        travel_m: f64,
        /// Θ: turned since the last absolute fix, radians.
        turn_rad: f64,
        /// E_lin (eq 1), metres.
        e_lin_m: f64,
        /// E_ang (eq 2), radians.
        e_ang_rad: f64,
        /// ε_lin (eq 3), m².
        eps_lin_m2: f64,
        /// ε_ang (eq 4), rad².
        eps_ang_rad2: f64,
        /// Weight of a nominal reading, in [0, 1].
        trust: f64,
        /// Travelled since the start, metres.
        distance_m: f64,
        /// Absolute fixes so far.
        fixes: u32,
        /// Bit 0: degraded, readings hardly say anything any more; bit 1: mapping is to hold.
        flags: u32,
        /// Fixes refused so far, for being too far off.
        fixes_refused: u32,
        /// Zero.
        reserved: u32,
    }
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
        /// 0 the map; 1 the map of one sonar; 2 doubt: metres instead of log-odds.
        layer: u16,
        /// Number of the sonar, where the layer is one's; else 0.
        sonar: u16,
        /// Zero.
        reserved: u32,
        /// ln(p/(1−p)), of doubt metres; row by row, row 0 at the lowest y; NaN: no reading touched the cell.
        log_odds: [f32; 4096],
    }
}

wire! {
    /// `map/info`: the map in numbers.
    "echogrid/MapInfo/6" MapInfoWire {
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
        /// Bit 0: the map is finished; bit 1: degraded, readings hardly say anything any more; bit 2: mapping holds.
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
    }
}

wire! {
    /// One verdict of a `range/verdict` message, whose payload is a slice of these, in the order of the scan with the same stamp.
    "echogrid/RangeVerdict/1" VerdictWire {
        /// Index into the robot's transducers.
        transducer: u16,
        /// Verdict code; 0 is accepted.
        verdict: u8,
        /// Zero.
        reserved: u8,
    }
}

wire! {
    /// How far a consumer has integrated one of its inputs.
    "echogrid/Ack/2" AckWire {
        /// Topic code.
        topic: u32,
        /// Zero.
        reserved: u32,
        /// Epoch that the sequence belongs to; 0 before the first message.
        epoch: u64,
        /// Last sequence that will not be needed again: stored with all that came of it (lossless topics), or taken in.
        sequence: u64,
    }
}

wire! {
    /// `health`: how a service is doing. Sent from its main loop, so it stops when the loop hangs.
    "echogrid/Health/2" HealthWire {
        /// UTF-8, padded with zeros.
        service: [u8; 32],
        /// Process id.
        pid: u32,
        /// 1 starting, 2 running, 3 draining, 4 finished, 5 failed, 6 gone for good (said by the launcher).
        state: u32,
        /// Messages taken in (of a sensor: given out).
        progress: u64,
        /// How many there will be in all; 0 unknown.
        total: u64,
        /// Stamp of the latest message handled, nanoseconds.
        stamp_ns: u64,
        /// Messages refused as faulty.
        faults: u64,
        /// Messages known to be lost (gaps in a sequence).
        lost: u64,
        /// How many of `acks` are in use.
        ack_count: u32,
        /// Zero.
        reserved: u32,
        /// One per input.
        acks: [AckWire; 8],
        /// Last error, UTF-8, padded with zeros.
        last_error: [u8; 512],
    }
}

wire! {
    /// `truth/pose`: where the robot really is; one before each message of `odometry/raw`, of the same stamp.
    "echogrid/TruePose/1" TruePoseWire {
        /// Metres, map frame.
        x_m: f64,
        /// Metres, map frame.
        y_m: f64,
        /// Radians.
        theta_rad: f64,
        /// 1 known; 0 not known at this time, and the pose says nothing.
        known: u32,
        /// Zero.
        reserved: u32,
    }
}

wire! {
    /// `truth/world`: the world that a simulated robot is in.
    "echogrid/TrueWorld/1" TrueWorldWire {
        /// Name of a world that comes with echogrid, or the path of its file; UTF-8, padded with zeros.
        name: [u8; 480],
        /// Lowest x and y, then highest x and y of its walls, metres, map frame.
        bounds_m: [f64; 4],
    }
}

wire! {
    /// `localization/request`: an absolute localization is wanted.
    "echogrid/LocalizationRequest/3" LocalizationRequestWire {
        /// Number of the request: 1, 2, 3 …
        id: u64,
        /// Where the robot believes to be at the stamp of the message.
        estimate: EstimateWire,
        /// 1 degraded, 2 by schedule.
        reason: u32,
        /// Zero.
        reserved: u32,
    }
}

wire! {
    /// `localization/fix`: where the robot was at the stamp of the message, or that this can't be told.
    "echogrid/LocalizationFix/1" FixWire {
        /// Of the request that it answers; 0: nobody asked.
        request: u64,
        /// Metres, map frame.
        x_m: f64,
        /// Metres, map frame.
        y_m: f64,
        /// Radians.
        theta_rad: f64,
        /// Covariance of (x, y, θ), row by row; m², m·rad, rad².
        covariance: [f64; 9],
        /// Bit 0 position known, bit 1 heading known; 0: no fix.
        known: u32,
        /// Zero.
        reserved: u32,
    }
}

wire! {
    /// `control`, request to one service.
    "echogrid/ControlRequest/2" ControlRequestWire {
        /// The same on every repetition: a request is carried out once.
        id: u64,
        /// 1 save, 2 pause, 3 resume, 5 fix, 6 drive.
        command: u32,
        /// Zero.
        reserved: u32,
        /// For a fix: x, y (metres), θ (radians), standard deviations of position (metres) and heading (radians).
        /// For driving: forward speed (m/s), turn rate (rad/s).
        arguments: [f64; 5],
    }
}

wire! {
    /// `control`, reply.
    "echogrid/ControlReply/1" ControlReplyWire {
        /// Of the request.
        id: u64,
        /// 1 done, 0 refused.
        done: u32,
        /// Zero.
        reserved: u32,
        /// What was done, or why not; UTF-8, padded with zeros.
        text: [u8; 480],
    }
}

/// The layouts of all message types as text: `layout.txt` of this crate.
#[must_use]
pub fn layouts() -> String {
    fn one<W: Wire>(text: &mut String) {
        use core::fmt::Write as _;
        let _ = writeln!(text, "{} size {} align {}", W::SCHEMA, size_of::<W>(), align_of::<W>());
        for field in W::FIELDS {
            let _ = writeln!(text, "  {:>5} {}: {}", field.offset, field.name, field.ty);
        }
    }
    let mut text = String::new();
    one::<Header>(&mut text);
    one::<SensorWire>(&mut text);
    one::<RobotWire>(&mut text);
    one::<OdometryRawWire>(&mut text);
    one::<ReadingWire>(&mut text);
    one::<EstimateWire>(&mut text);
    one::<TileWire>(&mut text);
    one::<MapInfoWire>(&mut text);
    one::<VerdictWire>(&mut text);
    one::<AckWire>(&mut text);
    one::<HealthWire>(&mut text);
    one::<TruePoseWire>(&mut text);
    one::<TrueWorldWire>(&mut text);
    one::<LocalizationRequestWire>(&mut text);
    one::<FixWire>(&mut text);
    one::<ControlRequestWire>(&mut text);
    one::<ControlReplyWire>(&mut text);
    text
}

/// Text padded with zeros; cut at a character where it is too long.
pub(crate) fn text_to_bytes<const N: usize>(text: &str) -> [u8; N] {
    let mut end = text.len().min(N);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let mut bytes = [0; N];
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
    bytes
}

/// The text before the first zero; bytes that are not UTF-8 are replaced.
pub(crate) fn bytes_to_text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A layout may change only together with the version in its name: then write the new
    /// `layout.txt` with `ECHOGRID_WRITE_LAYOUT=1 cargo test -p echogrid-topics layouts`.
    #[test]
    fn layouts_change_only_with_their_version() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/layout.txt");
        if std::env::var_os("ECHOGRID_WRITE_LAYOUT").is_some() {
            let before = std::fs::read_to_string(path).unwrap_or_default();
            for block in blocks(&before) {
                let name = block.split(' ').next().unwrap();
                if let Some(now) = blocks(&layouts()).iter().find(|b| b.split(' ').next() == Some(name)) {
                    assert_eq!(now, &block, "{name} changed: raise its version first");
                }
            }
            std::fs::write(path, layouts()).unwrap();
        }
        assert_eq!(std::fs::read_to_string(path).unwrap(), layouts());
    }

    fn blocks(text: &str) -> Vec<String> {
        let mut blocks: Vec<String> = Vec::new();
        for line in text.lines() {
            match blocks.last_mut() {
                Some(block) if line.starts_with(' ') => *block += &format!("\n{line}"),
                _ => blocks.push(line.into()),
            }
        }
        blocks
    }

    #[test]
    fn no_message_holds_padding() {
        // Padding would carry whatever bytes the sender's memory held.
        for block in blocks(&layouts()) {
            let size: usize = block.split(' ').nth(2).unwrap().parse().unwrap();
            assert_eq!(size % 2, 0, "{block}");
        }
        assert_eq!(size_of::<ReadingWire>(), 8 + 4 + 2 + 1 + 1);
        assert_eq!(size_of::<EstimateWire>(), 28 * 8 + 16);
        assert_eq!(size_of::<TileWire>(), 4 + 4 + 8 + 8 + 2 + 2 + 4 + 4 * 4096);
    }

    #[test]
    fn text_survives_and_is_cut_at_characters() {
        assert_eq!(bytes_to_text(&text_to_bytes::<8>("mapper")), "mapper");
        assert_eq!(bytes_to_text(&text_to_bytes::<5>("Größe")), "Grö");
    }
}
