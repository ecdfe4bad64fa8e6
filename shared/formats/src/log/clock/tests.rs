use super::*;
use crate::log::timeline::Rank;

/// The stamps in seconds that lines get, by their order; `(source, stamp)`, none for a line without.
fn stamps(lines: &[(u16, Option<f64>)]) -> (Vec<f64>, ClockReport) {
    let mut clock = Clock::default();
    for (number, (source, stamp)) in (1..).zip(lines) {
        clock.push(TimedLine {
            number,
            source: Source(*source),
            rank: Rank::Odometry,
            stamp_ns: stamp.map(|seconds| (seconds * 1e9).round() as u64),
            pose: None,
            weight: 1,
            restates: false,
            payload: (),
        });
    }
    clock.finish();
    let report = clock.report().clone();
    (std::iter::from_fn(|| clock.pop()).map(|line| line.stamp_ns as f64 * 1e-9).collect(), report)
}

fn odometry(stamps: impl IntoIterator<Item = f64>) -> Vec<(u16, Option<f64>)> {
    stamps.into_iter().map(|stamp| (0, Some(stamp))).collect()
}

fn tenths(from: u32, to: u32) -> impl Iterator<Item = f64> {
    (from..to).map(|tenth| f64::from(tenth) / 10.0)
}

fn near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

#[test]
fn good_stamps_stay() {
    let (found, report) = stamps(&odometry(tenths(0, 50)));
    near(&found, &tenths(0, 50).collect::<Vec<_>>());
    assert_eq!(report, ClockReport { lines: 50, ..ClockReport::default() });
}

#[test]
fn a_clock_set_back_goes_on() {
    for back in [2, 5, 15, 80, 100] {
        let lines = odometry(tenths(100, 200).chain(tenths(200 - back, 300)));
        let (found, report) = stamps(&lines);
        near(&found, &tenths(100, 300 + back).collect::<Vec<_>>());
        let [step] = report.steps.as_slice() else { panic!("{back}: {report:?}") };
        assert_eq!((step.line, step.kind), (101, StepKind::SetBack));
        assert!((step.by_s - f64::from(back) / 10.0).abs() < 1e-6);
    }
}

#[test]
fn a_clock_set_back_where_the_log_ends() {
    let (found, report) = stamps(&odometry(tenths(0, 100).chain(tenths(85, 89))));
    near(&found, &tenths(0, 104).collect::<Vec<_>>());
    assert_eq!(report.step_count, 1);
}

#[test]
fn lines_out_of_place_keep_their_stamps() {
    for disorder in [vec![1.0, 1.1, 1.3, 1.2, 1.4, 1.5], vec![1.0, 1.1, 1.4, 1.5, 1.2, 1.3, 1.6, 1.7]] {
        let (found, report) = stamps(&odometry(disorder.iter().copied()));
        near(&found, &disorder);
        assert!(report.step_count == 0 && report.reordered > 0, "{report:?}");
    }
    // Blocks of another source, late as a whole.
    let mut lines = odometry(tenths(0, 10));
    lines.extend(tenths(0, 10).map(|stamp| (7, Some(stamp))));
    lines.extend(odometry(tenths(10, 20)));
    let (found, report) = stamps(&lines);
    near(&found, &lines.iter().map(|(_, stamp)| stamp.unwrap()).collect::<Vec<_>>());
    assert_eq!(report.step_count, 0);
}

#[test]
fn strays_stay_beside_their_neighbours() {
    for stray in [1e-3, 700.0, 9e8, 4.0] {
        let mut lines = odometry(tenths(100, 200));
        lines.insert(50, (0, Some(stray)));
        lines.insert(50, (3, Some(stray)));
        let (found, report) = stamps(&lines);
        assert!((found[50] - 14.9).abs() < 1e-6 && (found[51] - 14.9).abs() < 1e-6, "{stray}: {}", found[50]);
        assert_eq!((report.strays, report.step_count), (2, 0), "{stray}");
    }
}

#[test]
fn a_source_of_another_clock_stays_beside_its_neighbours() {
    let mut lines = Vec::new();
    for stamp in tenths(1000, 1100) {
        lines.extend([(0, Some(stamp)), (4, Some(stamp - 30.0))]);
    }
    let (found, report) = stamps(&lines);
    assert!(found.chunks(2).all(|pair| pair[0] == pair[1]));
    assert_eq!(report.strays, 100);
}

#[test]
fn lines_without_stamps_stay_beside_their_neighbours() {
    let mut lines = odometry(tenths(100, 104));
    lines.insert(2, (0, None));
    lines.insert(4, (0, Some(0.0)));
    lines.insert(0, (1, None));
    let (found, report) = stamps(&lines);
    near(&found, &[10.0, 10.0, 10.1, 10.1, 10.2, 10.2, 10.3]);
    assert_eq!(report.unstamped, 3);
}

#[test]
fn zero_is_a_stamp_where_the_clock_begins() {
    let lines = [(0, Some(0.0)), (1, Some(0.0)), (0, Some(0.1)), (1, Some(0.1))];
    let (found, report) = stamps(&lines);
    near(&found, &[0.0, 0.0, 0.1, 0.1]);
    assert_eq!(report.unstamped, 0);
    // And none where it does not.
    let (found, report) = stamps(&[(0, Some(0.0)), (1, Some(0.0)), (0, Some(1.7e9)), (1, Some(1.7e9))]);
    near(&found, &[1.7e9; 4]);
    assert_eq!((report.unstamped, report.step_count), (2, 0));
}

#[test]
fn leaps_ahead_are_pauses_or_the_clock_being_set() {
    let (found, report) = stamps(&odometry(tenths(0, 20).chain(tenths(36_000, 36_020))));
    near(&found, &tenths(0, 20).chain(tenths(36_000, 36_020)).collect::<Vec<_>>());
    assert_eq!(report.steps[0].kind, StepKind::Pause);
    let (found, report) = stamps(&odometry(tenths(0, 20).chain(tenths(0, 20).map(|stamp| 1.7e9 + stamp))));
    near(&found, &tenths(0, 40).collect::<Vec<_>>());
    assert_eq!((report.steps[0].kind, report.steps[0].line), (StepKind::SetAhead, 21));
}

#[test]
fn a_clock_that_comes_back_is_what_it_was() {
    let there = tenths(0, 20).map(|stamp| 1.7e9 + stamp);
    let (found, report) = stamps(&odometry(tenths(0, 20).chain(there).chain(tenths(45, 60))));
    assert!((found[54] - 5.9).abs() < 1e-6, "{found:?}");
    assert_eq!(report.step_count, 2);
}
