//! `--fix-every`: a way or a time, with its unit.

use std::fmt;
use std::str::FromStr;

use super::run::NotA;

/// From one absolute localization to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Interval {
    /// By way.
    Metres(f64),
    /// By time, the sensor's clock.
    Seconds(f64),
}

impl Interval {
    /// Where it is set.
    pub(crate) fn key(self) -> &'static str {
        match self {
            Self::Metres(_) => "localization.every_m",
            Self::Seconds(_) => "localization.every_s",
        }
    }

    pub(crate) fn amount(self) -> f64 {
        match self {
            Self::Metres(amount) | Self::Seconds(amount) => amount,
        }
    }
}

impl fmt::Display for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Metres(amount) => write!(f, "{amount}m"),
            Self::Seconds(amount) => write!(f, "{amount}s"),
        }
    }
}

impl FromStr for Interval {
    type Err = NotA;

    fn from_str(text: &str) -> Result<Self, NotA> {
        const EXPECTED: NotA = NotA("a way or a time with its unit, like 5m or 10s");
        // The longer unit first: every number of minutes ends with an `n`.
        let units = [("min", 60.0), ("m", 1.0), ("s", 1.0)];
        let (number, unit, scale) = units
            .into_iter()
            .find_map(|(unit, scale)| text.trim().strip_suffix(unit).map(|number| (number, unit, scale)))
            .ok_or(EXPECTED)?;
        let amount: f64 = number.trim().parse().map_err(|_| EXPECTED)?;
        let amount = scale * amount;
        if !amount.is_finite() || amount <= 0.0 {
            return Err(EXPECTED);
        }
        Ok(if unit == "m" { Self::Metres(amount) } else { Self::Seconds(amount) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_and_its_unit() {
        let read = |text: &str| text.parse::<Interval>().ok();
        assert_eq!(read("5m"), Some(Interval::Metres(5.0)));
        assert_eq!(read(" 2.5 m"), Some(Interval::Metres(2.5)));
        assert_eq!(read("10s"), Some(Interval::Seconds(10.0)));
        assert_eq!(read("2min"), Some(Interval::Seconds(120.0)));
        for wrong in ["", "5", "m", "0m", "-1s", "nanm", "infs", "5km", "1e400m", "five m"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
