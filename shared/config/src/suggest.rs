//! What was meant by a word that nobody knows: "did you mean …?"

use super::service::{BUILTIN_PREFIX, Builtin};

/// The candidate nearest to `word`, if one is near.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Distances are quadratic in the length: no key or word is nearly that long.
    if word.len() > 64 {
        return None;
    }
    let word = word.to_lowercase();
    candidates
        .into_iter()
        .map(|candidate| (strsim::osa_distance(&word, &candidate.to_lowercase()), candidate))
        .filter(|(distance, candidate)| *distance <= (candidate.chars().count() / 3).max(1))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// Endings by which people name units, those that are wrong here included.
const UNITS: &[&str] = &[
    "m", "cm", "mm", "km", "in", "ft", "meter", "meters", "metre", "metres", "rad", "radian", "radians", "deg",
    "degree", "degrees", "s", "ms", "us", "ns", "sec", "secs", "seconds", "min", "hz", "mps", "kmh", "radps", "ratio",
    "percent", "pct", "samples",
];

/// A key without the unit at its end.
fn stem(key: &str) -> &str {
    match key.rsplit_once('_') {
        Some((stem, unit)) if !stem.is_empty() && UNITS.contains(&unit) => stem,
        _ => key,
    }
}

/// The unit that a key ends with, in words.
fn unit(key: &str) -> Option<&'static str> {
    Some(match key.strip_prefix(stem(key))? {
        "_m" => "in metres",
        "_rad" => "in radians",
        "_deg" => "in degrees",
        "_s" => "in seconds",
        "_mps" => "in metres per second",
        "_radps" => "in radians per second",
        "_ratio" => "a share, 0.01 for 1 %",
        "_samples" => "in samples",
        _ => return None,
    })
}

/// Which of `keys` was meant by `given`: with the right unit, or spelled right.
pub(crate) fn key(given: &str, keys: &[&str]) -> Option<String> {
    let other_unit = keys.iter().copied().find(|key| stem(key) == stem(given) && unit(key).is_some());
    let misspelled = || nearest(given, keys.iter().copied());
    let both = || {
        let near = nearest(stem(given), keys.iter().map(|key| stem(key)))?;
        keys.iter().copied().find(|key| stem(key) == near)
    };
    let meant = other_unit.or_else(misspelled).or_else(both)?;
    let unit = if stem(meant) == meant || given.ends_with(&meant[stem(meant).len()..]) { None } else { unit(meant) };
    Some(match unit {
        Some(unit) => format!("did you mean `{meant}` ({unit})?"),
        None => format!("did you mean `{meant}`?"),
    })
}

/// `"5 cm"` as the number that a key of this name wants (0.05 for `…_m`), if that can be told.
pub(crate) fn number_in_unit(key: &str, text: &str) -> Option<f64> {
    let text = text.trim();
    let split = text.find(|c: char| c.is_alphabetic() || c == '°' || c == '%')?;
    let (number, unit) = text.split_at(split);
    let number: f64 = number.trim().parse().ok()?;
    let degree = core::f64::consts::PI / 180.0;
    let factor = match (&key[stem(key).len()..], unit.trim()) {
        ("_m", "m" | "metres" | "meters") | ("_rad", "rad") | ("_deg", "deg" | "°") => 1.0,
        ("_m", "cm") => 0.01,
        ("_m", "mm") => 0.001,
        ("_rad", "deg" | "°") => degree,
        ("_deg", "rad") => 1.0 / degree,
        ("_ratio", "%") => 0.01,
        _ => return None,
    };
    // Twelve digits: 5 cm is 0.05, not 0.05000000000000001.
    format!("{:.12}", number * factor).parse().ok().filter(|n: &f64| n.is_finite())
}

/// The built-in that was meant by `replay` or `builtin:repaly`.
pub(crate) fn builtin(text: &str) -> Option<String> {
    let name = text.strip_prefix(BUILTIN_PREFIX).unwrap_or(text);
    let near = nearest(name, Builtin::ALL.into_iter().map(Builtin::name))?;
    Some(format!("did you mean \"{BUILTIN_PREFIX}{near}\"?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys() {
        let known = [
            "resolution_m",
            "min_range_m",
            "systematic",
            "turn_rad",
            "p_free",
            "range_error_ratio",
            "seed",
            "speed_mps",
        ];
        let check = |given: &str, expected: Option<&str>| {
            assert_eq!(key(given, &known).as_deref(), expected, "{given}");
        };
        check("resolution", Some("did you mean `resolution_m` (in metres)?"));
        check("resolution_cm", Some("did you mean `resolution_m` (in metres)?"));
        check("resoluton_m", Some("did you mean `resolution_m`?"));
        check("resoluton_mm", Some("did you mean `resolution_m` (in metres)?"));
        check("turn_deg", Some("did you mean `turn_rad` (in radians)?"));
        check("range_error_percent", Some("did you mean `range_error_ratio` (a share, 0.01 for 1 %)?"));
        check("speed", Some("did you mean `speed_mps` (in metres per second)?"));
        check("Systematic", Some("did you mean `systematic`?"));
        check("p_fee", Some("did you mean `p_free`?"));
        check("colour", None);
        check("", None);
    }

    #[test]
    fn numbers() {
        let check = |key: &str, text: &str, expected: Option<f64>| assert_eq!(number_in_unit(key, text), expected);
        check("resolution_m", "5cm", Some(0.05));
        check("resolution_m", "5 cm", Some(0.05));
        check("resolution_m", "50 mm", Some(0.05));
        check("heading_deg", "30°", Some(30.0));
        check("range_error_ratio", "1 %", Some(0.01));
        check("resolution_m", "fine", None);
        check("resolution_m", "5 miles", None);
        check("rate", "5 cm", None);
    }
}
