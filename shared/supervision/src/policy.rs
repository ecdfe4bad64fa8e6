//! Whether a service that died is started again.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::config::{Restart, SupervisionConfig};

/// What is done about a death.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Decision {
    /// It is started again, after so long, as the restart of this number within the window.
    Restart(Duration, u32),
    /// It is not, and why.
    GiveUp(String),
    /// The graph is ending: nobody needs it any more.
    Leave,
}

/// Decides on a death at `now`, in this order: policy, whether the graph is stopping, window, limit, backoff. `restarts` are
/// those of the service so far; `well` is when it was ready last: while it never becomes so, no restart is long ago, however
/// long each of its lives takes to be found hanging.
pub(crate) fn decide(
    config: &SupervisionConfig,
    restart: Restart,
    is_stopping: bool,
    restarts: &mut VecDeque<Instant>,
    well: Instant,
    now: Instant,
) -> Decision {
    if restart == Restart::Never {
        return if is_stopping { Decision::Leave } else { Decision::GiveUp("restart = \"never\"".into()) };
    }
    if is_stopping {
        return Decision::Leave;
    }
    let window = Duration::from_secs_f64(config.window_s);
    while restarts.front().is_some_and(|then| well.saturating_duration_since(*then) > window) {
        restarts.pop_front();
    }
    if restarts.len() >= config.restarts_max as usize {
        let (count, within) = (restarts.len(), config.window_s);
        if now.saturating_duration_since(well) > window {
            return Decision::GiveUp(format!(
                "it was restarted {count} times and did not become ready (supervision.restarts_max)"
            ));
        }
        return Decision::GiveUp(format!(
            "it was restarted {count} times within {within} s (supervision.restarts_max)"
        ));
    }
    let doublings = restarts.len().min(31) as u32;
    let backoff = config.backoff_s * f64::from(2_u32.saturating_pow(doublings));
    restarts.push_back(now);
    Decision::Restart(Duration::from_secs_f64(backoff.min(config.backoff_max_s)), restarts.len() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backoff_doubles_up_to_a_limit_within_a_window() {
        let config = SupervisionConfig {
            restarts_max: 4,
            window_s: 60.0,
            backoff_s: 0.5,
            backoff_max_s: 1.5,
            ..SupervisionConfig::default()
        };
        let start = Instant::now();
        let mut restarts = VecDeque::new();
        let mut die = |at_s: u64| {
            let now = start + Duration::from_secs(at_s);
            decide(&config, Restart::OnFailure, false, &mut restarts, now, now)
        };
        let after = |millis, number| Decision::Restart(Duration::from_millis(millis), number);
        assert_eq!([die(0), die(1), die(2), die(3)], [after(500, 1), after(1000, 2), after(1500, 3), after(1500, 4)]);
        assert!(matches!(die(4), Decision::GiveUp(why) if why.contains("4 times within 60 s")));
        // What is long ago is forgotten.
        assert_eq!(die(63), after(1000, 2));
        assert_eq!(die(200), after(500, 1));
    }

    #[test]
    fn who_never_becomes_ready_is_given_up_however_long_each_life_takes() {
        let config = SupervisionConfig::default();
        let start = Instant::now();
        let mut restarts = VecDeque::new();
        // Each life is found hanging after 30 s, so that five never fall within the window of 60 s.
        let mut die = |at_s: u64| {
            decide(&config, Restart::OnFailure, false, &mut restarts, start, start + Duration::from_secs(at_s))
        };
        for life in 1..=u64::from(config.restarts_max) {
            assert!(matches!(die(30 * life), Decision::Restart(..)), "life {life}");
        }
        assert!(matches!(die(600), Decision::GiveUp(why) if why.contains("did not become ready")));
    }

    #[test]
    fn policy_comes_first_then_whether_the_graph_stops() {
        let config = SupervisionConfig { restarts_max: 0, ..SupervisionConfig::default() };
        let decide = |restart, is_stopping| {
            decide(&config, restart, is_stopping, &mut VecDeque::new(), Instant::now(), Instant::now())
        };
        assert!(matches!(decide(Restart::Never, false), Decision::GiveUp(why) if why.contains("never")));
        assert_eq!(decide(Restart::Never, true), Decision::Leave);
        assert_eq!(decide(Restart::OnFailure, true), Decision::Leave);
        assert!(matches!(decide(Restart::OnFailure, false), Decision::GiveUp(_)));
    }
}
