//! Where to start looking: positions of which one at least leads down to each pose that fits.

use core::f64::consts::TAU;

use super::fit::Problem;
use super::sighting::Sighting;

/// Landmarks that starts are made from.
const LANDMARKS: usize = 6;
/// Starts on the circle that one range says.
const ON_CIRCLE: usize = 16;
/// Starts in directions around the landmarks.
const AROUND: usize = 8;

/// Positions to start from, in the frame of the problem.
pub(super) fn starts(problem: &Problem, guess: [f64; 2], spread_m: f64) -> Vec<[f64; 2]> {
    let ranged = far_apart(problem.sightings.iter().filter(|sighting| sighting.range_m.is_some()));
    let seen = far_apart(problem.sightings.iter().filter(|sighting| sighting.bearing_rad.is_some()));
    let mut starts = vec![guess, [0.0, 0.0]];
    for (index, a) in ranged.iter().enumerate() {
        for b in &ranged[index + 1..] {
            starts.extend(from_two_ranges(a, b));
        }
    }
    if problem.with_heading {
        for sighting in ranged.iter().take(3) {
            starts.extend(circle(sighting.landmark, sighting.range_m.unwrap_or_default(), ON_CIRCLE));
        }
    }
    for (index, a) in seen.iter().enumerate() {
        for (next, b) in seen.iter().enumerate().skip(index + 1) {
            starts.extend(seen[next + 1..].iter().filter_map(|c| from_three_bearings(a, b, c)));
        }
    }
    for radius_m in [0.7 * spread_m, 2.0 * spread_m] {
        starts.extend(circle([0.0, 0.0], radius_m, AROUND));
    }
    starts.retain(|[x, y]| libm::hypot(*x, *y) <= problem.reach_m);
    starts
}

/// A few sightings whose landmarks are far from each other: each the farthest from those before it.
fn far_apart<'a>(sightings: impl Iterator<Item = &'a Sighting>) -> Vec<&'a Sighting> {
    let mut left: Vec<(f64, &Sighting)> = sightings.map(|sighting| (f64::MAX, sighting)).collect();
    let mut chosen: Vec<&Sighting> = Vec::new();
    while chosen.len() < LANDMARKS {
        // The first of equals: the order of sightings decides, not chance.
        let farthest = left.iter().rev().max_by(|a, b| a.0.total_cmp(&b.0)).copied();
        let Some((_, next)) = farthest.filter(|(distance, _)| *distance > 0.0) else { break };
        chosen.push(next);
        for (distance, sighting) in &mut left {
            let [dx, dy] = difference(sighting.landmark, next.landmark);
            *distance = distance.min(libm::hypot(dx, dy));
        }
    }
    chosen
}

fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn circle([x, y]: [f64; 2], radius_m: f64, points: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..points).map(move |point| {
        // Not along the axes, where landmarks like to be in line.
        let (s, c) = libm::sincos(TAU * (point as f64 + 0.3) / points as f64);
        [x + radius_m * c, y + radius_m * s]
    })
}

/// Where two circles meet; where they come nearest to each other, and a little off it to both sides, if they do not meet.
fn from_two_ranges(a: &Sighting, b: &Sighting) -> [[f64; 2]; 2] {
    let [dx, dy] = difference(b.landmark, a.landmark);
    let distance = libm::hypot(dx, dy);
    let (range_a, range_b) = (a.range_m.unwrap_or_default(), b.range_m.unwrap_or_default());
    let along = (0.5 * (distance + (range_a - range_b) * ((range_a + range_b) / distance))).clamp(-range_a, range_a);
    let across = (range_a * range_a - along * along).max(1e-4 * distance * distance).sqrt();
    let (ux, uy) = (dx / distance, dy / distance);
    let [x, y] = [a.landmark[0] + along * ux, a.landmark[1] + along * uy];
    [[x - across * uy, y + across * ux], [x + across * uy, y - across * ux]]
}

/// Where three landmarks are seen under the angles between their bearings: the algorithm ToTal of V. Pierlot and M. Van
/// Droogenbroeck, "A new three object triangulation algorithm for mobile robot positioning", IEEE Transactions on Robotics 30
/// (2014). None where the three circles that it cuts are one.
fn from_three_bearings(a: &Sighting, b: &Sighting, c: &Sighting) -> Option<[f64; 2]> {
    let cotangent = |from: &Sighting, to: &Sighting| {
        let (s, c) = libm::sincos(to.bearing_rad.unwrap_or_default() - from.bearing_rad.unwrap_or_default());
        // In line: a circle of no end, here of a very large radius.
        c / if s.abs() < 1e-9 { 1e-9_f64.copysign(s) } else { s }
    };
    let [x1, y1] = difference(a.landmark, b.landmark);
    let [x3, y3] = difference(c.landmark, b.landmark);
    let (t12, t23) = (cotangent(a, b), cotangent(b, c));
    let t31 = (1.0 - t12 * t23) / (t12 + t23);
    let (x12, y12) = (x1 + t12 * y1, y1 - t12 * x1);
    let (x23, y23) = (x3 - t23 * y3, y3 + t23 * x3);
    let (x31, y31) = ((x3 + x1) + t31 * (y3 - y1), (y3 + y1) - t31 * (x3 - x1));
    let k31 = x1 * x3 + y1 * y3 + t31 * (x1 * y3 - x3 * y1);
    let d = (x12 - x23) * (y23 - y31) - (y12 - y23) * (x23 - x31);
    let place = [b.landmark[0] + k31 * (y12 - y23) / d, b.landmark[1] + k31 * (x23 - x12) / d];
    place.iter().all(|value| value.is_finite()).then_some(place)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sighting(landmark: [f64; 2], range_m: Option<f64>, bearing_rad: Option<f64>) -> Sighting {
        Sighting { landmark, range_m, bearing_rad, range_sigma_m: 0.1, bearing_sigma_rad: 0.1 }
    }

    #[test]
    fn circles_meet_twice() {
        let [a, b] = from_two_ranges(&sighting([0.0, 0.0], Some(5.0), None), &sighting([6.0, 0.0], Some(5.0), None));
        for (place, expected) in [(a, [3.0, 4.0]), (b, [3.0, -4.0])] {
            assert!((place[0] - expected[0]).abs() < 1e-12 && (place[1] - expected[1]).abs() < 1e-12, "{place:?}");
        }
    }

    #[test]
    fn three_bearings_make_a_place() {
        let (x, y, theta) = (1.0, 2.0, 0.4);
        let see = |at: [f64; 2]| sighting(at, None, Some(libm::atan2(at[1] - y, at[0] - x) - theta));
        let place = from_three_bearings(&see([5.0, 1.0]), &see([-2.0, 7.0]), &see([0.0, -4.0])).unwrap();
        assert!((place[0] - x).abs() < 1e-12 && (place[1] - y).abs() < 1e-12, "{place:?}");
    }

    #[test]
    fn landmarks_far_apart_come_first_and_none_twice() {
        let all: Vec<_> =
            [[0.0, 0.0], [0.1, 0.0], [0.0, 0.0], [9.0, 0.0], [4.0, 5.0]].map(|at| sighting(at, None, None)).into();
        let places: Vec<_> = far_apart(all.iter()).iter().map(|sighting| sighting.landmark).collect();
        assert_eq!(places, [[0.0, 0.0], [9.0, 0.0], [4.0, 5.0], [0.1, 0.0]]);
    }
}
