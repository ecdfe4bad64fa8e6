//! The range of a number, found by trying: what the check of a section refuses is out of it.

use serde_json::{Value as Json, json};
use toml::Value;

use super::{Key, Section};

/// Beyond the range of every key.
const FAR: f64 = 1e300;
/// Values within a range that are tried, too.
const TRIED: u32 = 24;
/// Whole numbers beyond this are bounded by their types alone.
const MOST_INTEGER: f64 = 2_147_483_646.0;

/// The bounds of a key, as a schema has them; none where it takes all numbers on that side, some below others, or where what it
/// takes depends on another key.
pub(super) fn of(section: &Section, key: &Key, default: Option<&Value>, is_number: bool) -> Vec<(String, Json)> {
    if let Some((least, most)) = key.within {
        return vec![("minimum".to_owned(), json!(least)), ("maximum".to_owned(), json!(most))];
    }
    let tried = Tried { section, key, is_number };
    let default = default.and_then(|default| default.as_float().or_else(|| default.as_integer().map(|n| n as f64)));
    let candidates = default.into_iter().chain([1.0, 0.5, 10.0, 0.1]);
    let Some(inside) = candidates.into_iter().find(|number| tried.takes(*number)) else { return Vec::new() };
    let bound = |outside: f64, names: [&str; 2]| {
        let (last, first_out) = tried.border(inside, outside)?;
        let (number, name) = if is_short(last) { (last, names[0]) } else { (first_out, names[1]) };
        Some((name.to_owned(), if is_number { json!(number) } else { json!(number as i64) }))
    };
    let bounds = [bound(-FAR, ["minimum", "exclusiveMinimum"]), bound(FAR, ["maximum", "exclusiveMaximum"])];
    // A few values, of which this is one.
    let is_one = bounds[0].as_ref().zip(bounds[1].as_ref()).is_some_and(|(least, most)| least.1 == most.1);
    bounds.into_iter().flatten().filter(|_| !is_one).collect()
}

/// A key that values are tried on.
struct Tried<'a> {
    section: &'a Section,
    key: &'a Key,
    is_number: bool,
}

impl Tried<'_> {
    fn value(&self, number: f64) -> Value {
        if self.is_number { Value::Float(number) } else { Value::Integer(number as i64) }
    }

    fn takes(&self, number: f64) -> bool {
        let value = self.value(number);
        self.section.takes(self.key.name, &value).is_ok() && self.section.refusal(self.key.name, value).is_none()
    }

    /// The last value that is taken on the way from `inside` to `outside`, and the first that is not.
    fn border(&self, inside: f64, outside: f64) -> Option<(f64, f64)> {
        let [mut taken, mut refused] = [inside, outside].map(|number| self.order(number));
        if self.takes(self.number(refused)) {
            return None;
        }
        while taken.abs_diff(refused) > 1 {
            let middle = taken.midpoint(refused);
            if self.takes(self.number(middle)) { taken = middle } else { refused = middle }
        }
        let (last, first_out) = (self.number(taken), self.number(refused));
        // The last value itself was taken.
        let part = |part: u32| self.number(self.order(inside + (last - inside) * f64::from(part) / f64::from(TRIED)));
        let is_whole = (0..TRIED).all(|n| self.takes(part(n)));
        let of_its_own = self.section.refusal(self.key.name, self.value(first_out)).is_none_or(|expected| {
            let others =
                self.section.keys.iter().filter(|other| other.name != self.key.name && other.name.contains('_'));
            others.into_iter().all(|other| !expected.contains(other.name))
        });
        // Such as 0, or from 1 on.
        let is_beyond = |number: &f64| (number - last).signum() == (outside - inside).signum() && number != &last;
        let decades = (-6..10).flat_map(|power| [1.0, 3.0].map(|digit: f64| digit * 10_f64.powi(power)));
        let goes_on = decades.flat_map(|number| [number, -number]).filter(is_beyond).any(|number| self.takes(number));
        let is_bounded = self.is_number || last.abs() < MOST_INTEGER;
        (is_bounded && of_its_own && !goes_on && is_whole).then_some((last, first_out))
    }

    /// A number's place among those that the key may take: neighbours are 1 apart.
    fn order(&self, number: f64) -> i64 {
        if !self.is_number {
            return number as i64;
        }
        let bits = number.to_bits() as i64;
        if bits < 0 { i64::MIN.wrapping_sub(bits) } else { bits }
    }

    fn number(&self, order: i64) -> f64 {
        if !self.is_number {
            return order as f64;
        }
        f64::from_bits(if order < 0 { i64::MIN.wrapping_sub(order) } else { order } as u64)
    }
}

/// Whether somebody would write a number so.
fn is_short(number: f64) -> bool {
    number == 0.0
        || number.abs() > 1e-100 && format!("{number:e}").split('e').next().is_some_and(|digits| digits.len() < 10)
}

#[cfg(test)]
mod tests {
    use super::super::json_schema_of_graphs;

    #[test]
    fn a_range_is_what_the_check_does() {
        let schema = json_schema_of_graphs();
        let of = |section: &str, key: &str| {
            let forms = schema["properties"][section]["properties"][key]["anyOf"].as_array().unwrap();
            let number = forms.iter().find(|form| form["type"] == "number" || form["type"] == "integer").unwrap();
            ["minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum"].map(|bound| number[bound].as_f64())
        };
        assert_eq!(of("mapper", "oriented_incidence_deg"), [Some(5.0), None, Some(90.0), None]);
        assert_eq!(of("mapper", "p_occupied"), [None, Some(0.5), None, Some(1.0)]);
        assert_eq!(of("simulator", "rays"), [Some(1.0), None, Some(1001.0), None]);
        assert_eq!(of("odometry", "k_ll"), [Some(0.0), None, None, None]);
        assert_eq!(of("mapper", "resolution_m"), [Some(0.001), None, Some(10.0), None]);
        // Some numbers of no range.
        assert_eq!(of("pioneer", "baud"), [None; 4]);
        // Each is bounded by the other.
        assert_eq!(of("publisher", "free_thresh")[2..], [None, None]);
        // 0, or from 1 on.
        assert_eq!(of("publisher", "save_every_s"), [Some(0.0), None, None, None]);
    }
}
