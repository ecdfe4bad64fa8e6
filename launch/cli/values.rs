//! Words of the command line that are numbers, or stand for something.

use core::f64::consts::TAU;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use echogrid_live::config::DEFAULT_PORT;
use echogrid_replay::config::LogUnit;

/// Nobody means more radians: a turn and a little.
const RADIANS_MAX: f64 = 6.5;

/// A coordinate or an angle: a number, or degrees where it says so.
pub(super) fn place(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(number) if number.abs() <= 1e6 => Ok(number),
        _ => angle(text),
    }
}

/// An angle in radians, or in degrees where it says so.
pub(super) fn angle(text: &str) -> Result<f64, String> {
    let (number, scale) = match text.strip_suffix("deg") {
        Some(degrees) => (degrees.trim(), core::f64::consts::PI / 180.0),
        None => (text.trim(), 1.0),
    };
    let number = number.parse::<f64>().ok().filter(|number| number.abs() <= 1e6);
    let number = number.ok_or_else(|| "expected radians, or degrees as in 90deg".to_owned())?;
    if scale == 1.0 && number.abs() > RADIANS_MAX {
        return Err(format!(
            "{number} radians are {:.1} turns; expected radians, or degrees: {number}deg?",
            number.abs() / TAU
        ));
    }
    Ok(number * scale)
}

/// An address and a port, or either.
pub(super) fn listen(text: &str) -> Result<SocketAddr, String> {
    let address = text.parse().or_else(|_| text.parse::<IpAddr>().map(|ip| SocketAddr::from((ip, DEFAULT_PORT))));
    address
        .or_else(|_| text.parse::<u16>().map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port))))
        .map_err(|_| "expected an address and a port, or either, as in 127.0.0.1:8750, 0.0.0.0 or 8750".to_owned())
}

/// The unit of a log's ranges.
pub(super) fn range_unit(text: &str) -> Result<LogUnit, String> {
    match text {
        "auto" => Ok(LogUnit::Auto),
        "m" => Ok(LogUnit::M),
        "cm" => Ok(LogUnit::Cm),
        "mm" => Ok(LogUnit::Mm),
        _ => Err("expected auto, m, cm or mm".to_owned()),
    }
}

/// Metres, as far as a wall may reach.
pub(super) fn reach(text: &str) -> Result<f64, String> {
    let metres = text.trim().parse::<f64>().ok().filter(|metres| (0.001..=10.0).contains(metres));
    metres.ok_or_else(|| "expected metres, from 0.001 to 10".to_owned())
}

pub(super) fn window(text: &str) -> Result<f64, String> {
    let good = text.parse().ok().filter(|seconds: &f64| (0.1..=3600.0).contains(seconds));
    good.ok_or_else(|| "expected seconds, 0.1 to 3600".to_owned())
}

/// Seconds, above 0.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.trim().parse::<f64>().ok().filter(|seconds| *seconds > 0.0 && *seconds <= 86_400.0);
    seconds.ok_or_else(|| "expected seconds, above 0 and at most a day".to_owned())
}

/// Metres, 0 or more.
pub(super) fn deviation(text: &str) -> Result<f64, String> {
    let metres = text.trim().parse::<f64>().ok().filter(|metres| metres.is_finite() && *metres >= 0.0);
    metres.ok_or_else(|| "expected metres, 0 or more".to_owned())
}

/// Two numbers of nodes.
pub(super) fn pair(text: &str) -> Result<[u32; 2], String> {
    let expected = || "two numbers, as `echogrid closures` prints them: 12,345".to_owned();
    let (from, to) = text.split_once(',').ok_or_else(expected)?;
    Ok([from.trim().parse().map_err(|_| expected())?, to.trim().parse().map_err(|_| expected())?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_have_units() {
        assert_eq!(angle("1.5"), Ok(1.5));
        assert!((angle("-90deg").unwrap() + core::f64::consts::FRAC_PI_2).abs() < 1e-12);
        for wrong in ["", "deg", "nan", "inf", "1e9", "90°", "north"] {
            assert!(angle(wrong).is_err(), "{wrong}");
        }
        assert!(deviation("0.1").is_ok() && deviation("-0.1").is_err() && deviation("nan").is_err());
    }
}
