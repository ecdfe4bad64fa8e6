//! What ARIA's `.p` files say of a model of robot.

/// Where a sonar sits, in millimetres and degrees, in the robot's frame: x forward, y left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SonarPlace {
    /// The number of the sonar, as information packets have it.
    pub number: u8,
    /// The place of the sonar along the robot's x axis, forward, mm.
    pub x_mm: f64,
    /// The place of the sonar along the robot's y axis, to the left, mm.
    pub y_mm: f64,
    /// The direction in which the sonar looks, degrees counter-clockwise.
    pub heading_deg: f64,
}

/// A model of robot: what its counts mean, and where its sonars sit.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Class, such as `Pioneer`; empty: not told.
    pub class: String,
    /// Model, such as `p3at-sh`; empty: not told.
    pub subclass: String,
    /// Length, mm; 0: not told.
    pub length_mm: f64,
    /// Width, mm; 0: not told.
    pub width_mm: f64,
    /// Radians of a count of heading (`AngleConvFactor`).
    pub angle_rad_per_count: f64,
    /// Millimetres of a count of position (`DistConvFactor`).
    pub distance_mm_per_count: f64,
    /// mm/s of a count of speed (`VelConvFactor`).
    pub speed_mmps_per_count: f64,
    /// Millimetres of a count of range (`RangeConvFactor`).
    pub range_mm_per_count: f64,
    /// What a difference of wheel speeds in mm/s turns by, rad/s: one over the distance of the wheels in mm, doubled
    /// (`DiffConvFactor`).
    pub turn_per_difference: f64,
    /// Bits per second that the line is to go on with after the session is open; 0: as it is (`SwitchToBaudRate`).
    pub baud: u32,
    /// The fastest that it drives, mm/s; 0: not told.
    pub speed_max_mmps: f64,
    /// The fastest that it turns, degrees per second; 0: not told.
    pub turn_max_degps: f64,
    /// The farthest that its sonars hear, mm; 0: not told (`SonarMaxRange`).
    pub sonar_max_mm: f64,
    /// The sonars of the robot, by number.
    pub sonars: Vec<SonarPlace>,
}

impl Default for Parameters {
    /// What ARIA takes where a file says nothing.
    fn default() -> Self {
        Self {
            class: String::new(),
            subclass: String::new(),
            length_mm: 0.0,
            width_mm: 0.0,
            angle_rad_per_count: COUNT_OF_TURN_RAD,
            distance_mm_per_count: 1.0,
            speed_mmps_per_count: 1.0,
            range_mm_per_count: 1.0,
            turn_per_difference: 0.0056,
            baud: 38_400,
            speed_max_mmps: 0.0,
            turn_max_degps: 0.0,
            sonar_max_mm: 0.0,
            sonars: Vec::new(),
        }
    }
}

/// A turn is 4096 counts.
const COUNT_OF_TURN_RAD: f64 = core::f64::consts::TAU / 4096.0;
/// A file that is this near to it was rounded: taken at its word a full turn would be a degree off.
const ROUNDED: f64 = 0.005;

/// What is wrong with a parameter file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {key}: \"{value}\": expected {expected}")]
pub struct ParameterError {
    /// The line, from 1.
    pub line: usize,
    /// The parameter that is wrong.
    pub key: String,
    /// What stands there.
    pub value: String,
    /// What could have stood there.
    pub expected: &'static str,
}

/// A line of the file: its key and what follows.
struct Line<'a> {
    number: usize,
    key: &'a str,
    values: Vec<&'a str>,
}

impl Line<'_> {
    fn error(&self, expected: &'static str) -> ParameterError {
        let value = self.values.join(" ").chars().take(80).collect();
        ParameterError { line: self.number, key: self.key.to_owned(), value, expected }
    }

    fn number(&self, at: usize, expected: &'static str, is_fit: impl Fn(f64) -> bool) -> Result<f64, ParameterError> {
        let value = self.values.get(at).and_then(|word| word.parse().ok());
        value.filter(|value: &f64| value.is_finite() && is_fit(*value)).ok_or_else(|| self.error(expected))
    }

    fn positive(&self) -> Result<f64, ParameterError> {
        self.number(0, "a number above 0", |value| value > 0.0 && value < 1e9)
    }

    fn not_negative(&self) -> Result<f64, ParameterError> {
        self.number(0, "a number, 0 or more", |value| (0.0..1e9).contains(&value))
    }

    fn sonar(&self) -> Result<SonarPlace, ParameterError> {
        const FOUR: &str = "a sonar's number (0 to 255), x and y in mm within 10 m, heading in degrees within a turn";
        let place = |at| self.number(at, FOUR, |value| value.abs() <= 10_000.0);
        let number = self.values.first().and_then(|word| word.parse().ok()).ok_or_else(|| self.error(FOUR))?;
        let heading_deg = self.number(3, FOUR, |value| value.abs() <= 360.0)?;
        Ok(SonarPlace { number, x_mm: place(1)?, y_mm: place(2)?, heading_deg })
    }
}

impl Parameters {
    /// Reads a `.p` file. Keys that mean nothing here are left alone, comments begin with `;`.
    ///
    /// # Errors
    /// A value that is none, or not possible.
    pub fn read(text: &str) -> Result<Self, ParameterError> {
        let mut found = Self::default();
        let mut section = String::new();
        for (index, line) in text.lines().enumerate() {
            let mut words = line.split(';').next().unwrap_or_default().split_whitespace();
            let Some(key) = words.next() else { continue };
            let line = Line { number: index + 1, key, values: words.collect() };
            if key.eq_ignore_ascii_case("section") {
                section = line.values.join(" ").to_ascii_lowercase();
            } else {
                found.take(&section, &line)?;
            }
        }
        found.sonars.sort_by_key(|sonar| sonar.number);
        Ok(found)
    }

    fn take(&mut self, section: &str, line: &Line<'_>) -> Result<(), ParameterError> {
        let first = || line.values.first().map(|word| (*word).to_owned()).unwrap_or_default();
        match line.key.to_ascii_lowercase().as_str() {
            "class" => self.class = first(),
            "subclass" => self.subclass = first(),
            "robotlength" => self.length_mm = line.not_negative()?,
            "robotwidth" => self.width_mm = line.not_negative()?,
            "angleconvfactor" => {
                let told = line.positive()?;
                let is_rounded = (told / COUNT_OF_TURN_RAD - 1.0).abs() < ROUNDED;
                self.angle_rad_per_count = if is_rounded { COUNT_OF_TURN_RAD } else { told };
            }
            "distconvfactor" => self.distance_mm_per_count = line.positive()?,
            "velconvfactor" => self.speed_mmps_per_count = line.positive()?,
            "rangeconvfactor" => self.range_mm_per_count = line.positive()?,
            "diffconvfactor" => self.turn_per_difference = line.positive()?,
            "switchtobaudrate" => self.baud = line.not_negative()? as u32,
            "maxvelocity" => self.speed_max_mmps = line.not_negative()?,
            "maxrvelocity" => self.turn_max_degps = line.not_negative()?,
            "sonarmaxrange" if section.starts_with("sonarboard") && self.sonar_max_mm == 0.0 => {
                self.sonar_max_mm = line.not_negative()?;
            }
            "sonarunit" => {
                let sonar = line.sonar()?;
                if self.sonars.iter().any(|other| other.number == sonar.number) {
                    return Err(line.error("each sonar once"));
                }
                self.sonars.push(sonar);
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_counts_is_read_and_the_rest_left_alone() {
        let text = "ConfigVersion 2.0\nSection General settings\nSubclass p3at-sh ; model\nRobotWidth 505.0\n\
                    AngleConvFactor 0.00153 ; radians per count\nDistConvFactor 0.465\nSonarUnit 1 10 -20 -90 0 0\nSonarUnit 0 1 2 3\n";
        let found = Parameters::read(text).unwrap();
        assert_eq!((found.subclass.as_str(), found.width_mm, found.distance_mm_per_count), ("p3at-sh", 505.0, 0.465));
        assert_eq!(found.angle_rad_per_count, COUNT_OF_TURN_RAD);
        assert_eq!(found.sonars[1], SonarPlace { number: 1, x_mm: 10.0, y_mm: -20.0, heading_deg: -90.0 });
        assert_eq!(found.sonars[0].number, 0);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let told = |text: &str| Parameters::read(text).unwrap_err().to_string();
        assert_eq!(told("\nDistConvFactor zero"), "line 2: DistConvFactor: \"zero\": expected a number above 0");
        assert_eq!(told("DistConvFactor"), "line 1: DistConvFactor: \"\": expected a number above 0");
        assert!(told("SonarUnit 1 2 3").starts_with("line 1: SonarUnit: \"1 2 3\": expected a sonar's number"));
        assert!(told("SonarUnit 256 2 3 4").contains("0 to 255"));
        assert!(told("SonarUnit 1 2 3 4\nSonarUnit 1 2 3 4").ends_with("expected each sonar once"));
        assert!(told("RobotLength inf").contains("0 or more"));
    }
}
