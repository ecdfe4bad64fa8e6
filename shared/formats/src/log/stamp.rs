//! Stamps: decimal text to nanoseconds.

/// Stamps from here on are no seconds since 1970, nanoseconds.
const STAMP_END_NS: u64 = 10_000_000_000 * 1_000_000_000;
/// More digits than these change no nanosecond.
const DIGITS: u32 = 34;

/// Seconds as decimal text (`976052857.337530`, `1.01893e+09`) as nanoseconds, exactly as far as
/// the text goes, rounded half up below a nanosecond.
///
/// None if it is no decimal number, negative, or beyond the year 2286.
pub(crate) fn parse_stamp_ns(text: &str) -> Option<u64> {
    let text = text.strip_prefix('+').unwrap_or(text);
    let (mantissa, exponent) = match text.find(['e', 'E']) {
        Some(at) => (text.get(..at)?, text.get(at + 1..)?.parse::<i32>().ok()?),
        None => (text, 0),
    };
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    if whole.is_empty() && fraction.is_empty() {
        return None;
    }
    let (mut value, mut digits) = (0_u128, 0_u32);
    let mut scale = i64::from(exponent) + 9;
    for (is_fraction, byte) in whole.bytes().map(|b| (false, b)).chain(fraction.bytes().map(|b| (true, b))) {
        if !byte.is_ascii_digit() {
            return None;
        }
        if digits == DIGITS {
            scale += i64::from(!is_fraction);
            continue;
        }
        value = value * 10 + u128::from(byte - b'0');
        digits += u32::from(value != 0);
        scale -= i64::from(is_fraction);
    }
    let nanoseconds = if value == 0 {
        0
    } else if scale >= 0 {
        value.checked_mul(10_u128.checked_pow(u32::try_from(scale).ok()?)?)?
    } else {
        match 10_u128.checked_pow(u32::try_from(-scale).ok()?) {
            Some(divisor) => (value + divisor / 2) / divisor,
            None => 0,
        }
    };
    u64::try_from(nanoseconds).ok().filter(|stamp| *stamp < STAMP_END_NS)
}

/// Nanoseconds as seconds with nine decimals: [`parse_stamp_ns`] gives the same number back.
pub(crate) fn format_stamp(stamp_ns: u64) -> String {
    format!("{}.{:09}", stamp_ns / 1_000_000_000, stamp_ns % 1_000_000_000)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn text_to_nanoseconds() {
        let check = |text: &str, expected: Option<u64>| assert_eq!(parse_stamp_ns(text), expected, "{text}");
        check("0", Some(0));
        check("976052857.337530", Some(976_052_857_337_530_000));
        check("976052857.3375304321", Some(976_052_857_337_530_432));
        check("1.01893e+09", Some(1_018_930_000_000_000_000));
        check("156.315", Some(156_315_000_000));
        check("1e-9", Some(1));
        check("1e-900", Some(0));
        check("0.00000000049", Some(0));
        check("0.0000000005", Some(1));
        check(".5", Some(500_000_000));
        check("5.", Some(5_000_000_000));
        check("+1", Some(1_000_000_000));
        check("0e400", Some(0));
        check("00000000000000000000000000000000000000000000000000001", Some(1_000_000_000));
        for bad in ["", ".", "-1", "nan", "inf", "1e", "1e400", "1e10", "12x", "1.2.3", "e5", "--1", "１"] {
            check(bad, None);
        }
    }

    proptest! {
        #[test]
        fn there_and_back(stamp_ns in 0..STAMP_END_NS) {
            prop_assert_eq!(parse_stamp_ns(&format_stamp(stamp_ns)), Some(stamp_ns));
        }

        #[test]
        fn any_text_is_survived(text in "\\PC*") {
            let _ = parse_stamp_ns(&text);
        }
    }
}
