//! A sensor whose functions are of C.

use core::ffi::{CStr, c_char, c_void};
use std::process::ExitCode;

use anyhow::{Result, anyhow, bail, ensure};
use echogrid_core::{Reading, Robot};
use echogrid_service::{Sensor, process};
use echogrid_topics::contract::{OdometryRawWire, ReadingWire, RobotWire};
use echogrid_topics::{Message, RawOdometry, Topic};

const OUTPUTS: &[Topic] = &[Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan];
/// More readings than transducers can be numbered are a mistake.
const READINGS_MAX: usize = 65_535;
/// As in the header.
const OVER: i32 = 0;
const ODOMETRY: i32 = 1;
const SCAN: i32 = 2;
const NOTHING_YET: i32 = 3;

/// What a sensor says in one go (`struct echogrid_said`).
#[derive(Debug)]
#[repr(C)]
pub struct Said {
    /// When it was true, nanoseconds.
    pub stamp_ns: u64,
    /// Where the wheels believe the robot is.
    pub odometry: OdometryRawWire,
    /// What the range sensors hear.
    pub readings: *const ReadingWire,
    /// How many of them.
    pub reading_count: usize,
    /// Why the sensor can't go on; UTF-8 up to the first zero.
    pub error: [c_char; 256],
}

/// A sensor in functions of C (`struct echogrid_driver`).
#[derive(Debug)]
#[repr(C)]
pub struct Driver {
    /// The name of the program, for logs.
    pub name: *const c_char,
    /// The description of the robot.
    pub robot: *const RobotWire,
    /// Handed to the functions.
    pub user: *mut c_void,
    /// What it says next.
    pub next: Option<unsafe extern "C" fn(*mut c_void, *mut Said) -> i32>,
    /// Called once, at the end.
    pub close: Option<unsafe extern "C" fn(*mut c_void)>,
    /// Whether it measures what is now.
    pub is_live: i32,
}

/// A sensor of C as one of the graph.
struct Adapter<'a> {
    of: &'a Driver,
    robot: Option<Robot>,
    said: Box<Said>,
    /// What was said and not yet taken.
    waiting: Option<(u64, Message)>,
    is_over: bool,
    is_closed: bool,
}

impl<'a> Adapter<'a> {
    fn new(of: &'a Driver) -> Result<Self> {
        ensure!(of.next.is_some(), "echogrid_driver.next is null; expected a function");
        // SAFETY: whoever calls keeps what it points to until the sensor has ended.
        let Some(robot) = (unsafe { of.robot.as_ref() }) else {
            bail!("echogrid_driver.robot is null; expected a robot")
        };
        let robot = Robot::try_from(robot).map_err(|fault| anyhow!("echogrid_driver.robot: {fault}"))?;
        let said = Said {
            stamp_ns: 0,
            odometry: OdometryRawWire::default(),
            readings: core::ptr::null(),
            reading_count: 0,
            error: [0; 256],
        };
        let (waiting, is_over, is_closed) = (None, false, false);
        Ok(Self { of, robot: Some(robot), said: Box::new(said), waiting, is_over, is_closed })
    }

    /// Asks for what comes next, if nothing waits.
    fn ask(&mut self) -> Result<()> {
        if self.waiting.is_some() || self.is_over {
            return Ok(());
        }
        if let Some(robot) = self.robot.take() {
            self.waiting = Some((0, Message::Robot(robot)));
            return Ok(());
        }
        let Some(next) = self.of.next else { return Ok(()) };
        (self.said.readings, self.said.reading_count, self.said.error) = (core::ptr::null(), 0, [0; 256]);
        // SAFETY: a function of that signature, as the header says, and a structure of that layout.
        let kind = unsafe { next(self.of.user, &raw mut *self.said) };
        let message = match kind {
            OVER => {
                self.is_over = true;
                return Ok(());
            }
            NOTHING_YET => return Ok(()),
            ODOMETRY => {
                let odometry = RawOdometry::try_from(&self.said.odometry);
                Message::Odometry(odometry.map_err(|fault| anyhow!("echogrid_said.odometry: {fault}"))?)
            }
            SCAN => Message::Scan(self.readings()?),
            // What the outside refuses may go well another time.
            -1 => return Err(std::io::Error::other(self.error()).into()),
            other => {
                bail!("next() gave {other}; expected one of ECHOGRID_OVER, _ODOMETRY, _SCAN, _NOTHING_YET, _FAILED")
            }
        };
        self.waiting = Some((self.said.stamp_ns, message));
        Ok(())
    }

    fn readings(&self) -> Result<Vec<Reading>> {
        let Said { readings, reading_count: count, .. } = *self.said;
        ensure!(count <= READINGS_MAX, "a scan of {count} readings; expected at most {READINGS_MAX}");
        if count == 0 {
            return Ok(Vec::new());
        }
        ensure!(!readings.is_null(), "a scan of {count} readings, and `readings` is null");
        // SAFETY: the sensor says that there are so many, and that they stay until it is asked again.
        let readings = unsafe { core::slice::from_raw_parts(readings, count) };
        Ok(readings.iter().map(Reading::from).collect())
    }

    fn error(&self) -> String {
        let bytes: Vec<u8> = self.said.error.iter().map(|byte| *byte as u8).take_while(|byte| *byte != 0).collect();
        if bytes.is_empty() { "the sensor failed".to_owned() } else { String::from_utf8_lossy(&bytes).into_owned() }
    }
}

impl Sensor for Adapter<'_> {
    fn outputs(&self) -> &'static [Topic] {
        OUTPUTS
    }

    fn is_live(&self) -> bool {
        self.of.is_live != 0
    }

    fn is_ready(&mut self) -> Result<bool> {
        self.ask()?;
        Ok(self.waiting.is_some() || self.is_over)
    }

    fn next(&mut self) -> Result<Option<(u64, Message)>> {
        while self.waiting.is_none() && !self.is_over {
            self.ask()?;
        }
        Ok(self.waiting.take())
    }

    fn close(&mut self) {
        if !core::mem::replace(&mut self.is_closed, true)
            && let Some(close) = self.of.close
        {
            // SAFETY: a function of that signature, as the header says.
            unsafe { close(self.of.user) };
        }
    }
}

impl Drop for Adapter<'_> {
    fn drop(&mut self) {
        self.close();
    }
}

/// Plays a sensor in the graph that started this process, to its end; the exit code.
///
/// # Safety
/// `sensor` points to a structure as the header declares it, whose functions may be called from this thread, and which stays as it is
/// until this returns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn echogrid_run_sensor(sensor: *const Driver) -> i32 {
    // SAFETY: as said above.
    let Some(of) = (unsafe { sensor.as_ref() }) else { return 2 };
    let name = if of.name.is_null() {
        "sensor".to_owned()
    } else {
        // SAFETY: a text with a zero at its end, as the header says.
        unsafe { CStr::from_ptr(of.name) }.to_string_lossy().into_owned()
    };
    let run = || process::run_sensor(&name, OUTPUTS, |_plan| Adapter::new(of));
    // Nothing unwinds into C.
    match std::panic::catch_unwind(core::panic::AssertUnwindSafe(run)) {
        Ok(code) => code_of(code),
        Err(_) => 1,
    }
}

/// An exit code as a number: the type does not tell, but it can be compared.
fn code_of(code: ExitCode) -> i32 {
    (0..=u8::MAX).find(|number| ExitCode::from(*number) == code).map_or(1, i32::from)
}
