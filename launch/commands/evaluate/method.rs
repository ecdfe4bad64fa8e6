//! What is compared: ways of mapping, and how often the robot is told where it is.

/// A way of mapping.
#[derive(Debug, Clone, Copy)]
pub(super) struct Method {
    pub(super) name: &'static str,
    pub(super) sets: &'static [&'static str],
}

/// The sonars that the paper keeps in corridors.
const CORRIDOR_SONARS: &str = "mapper.sonars=[0, 3, 4, 7, 8, 11, 12, 15]";
/// The odometry is believed.
const SYSTEMATIC: &str = "odometry.systematic=off";
const K_LL: &str = "odometry.k_ll=0";
const K_LT: &str = "odometry.k_lt=0";
const K_TT: &str = "odometry.k_tt=0";
const K_TL: &str = "odometry.k_tl=0";

/// All of them; the name of the configuration as it comes is the last one's.
pub(super) const METHODS: [Method; 8] = [
    Method { name: "fixed σ", sets: &["mapper.fusion=paper", SYSTEMATIC, K_LL, K_LT, K_TT, K_TL] },
    Method {
        name: "fixed σ, 8 sonars",
        sets: &["mapper.fusion=paper", SYSTEMATIC, K_LL, K_LT, K_TT, K_TL, CORRIDOR_SONARS],
    },
    Method { name: "paper", sets: &["mapper.fusion=paper"] },
    Method { name: "paper, 8 sonars", sets: &["mapper.fusion=paper", CORRIDOR_SONARS] },
    Method { name: "covariance", sets: &["mapper.fusion=covariance"] },
    Method { name: "covariance, 8 sonars", sets: &["mapper.fusion=covariance", CORRIDOR_SONARS] },
    Method { name: "first_echo", sets: &["mapper.fusion=first_echo"] },
    Method { name: "first_echo, 8 sonars", sets: &["mapper.fusion=first_echo", CORRIDOR_SONARS] },
];

/// How often the robot is told where it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Schedule {
    pub(super) name: &'static str,
    pub(super) sets: &'static [&'static str],
}

const TRUTH: &str = "localizer.source=truth";
const BY_SCHEDULE: &str = "localization.ask=schedule";

pub(super) const SCHEDULES: [Schedule; 4] = [
    Schedule { name: "exact", sets: &[TRUTH, BY_SCHEDULE, "localization.every_m=0.01"] },
    Schedule { name: "5 m", sets: &[TRUTH, BY_SCHEDULE, "localization.every_m=5"] },
    Schedule { name: "15 m", sets: &[TRUTH, BY_SCHEDULE, "localization.every_m=15"] },
    Schedule { name: "never", sets: &["localization.ask=never"] },
];
