//! What is compared: ways of mapping, and how often the robot is told where it is.

/// A way of mapping.
#[derive(Debug, Clone, Copy)]
pub(super) struct Method {
    pub(super) name: &'static str,
    pub(super) sets: &'static [&'static str],
}

/// As readings come, but for limits and selection.
const RAW: &str = "mapper.filters=[\"range\", \"selection\"]";
/// The paper's choice of sonars.
const CORRIDOR: &str = "mapper.sonars=corridor";
const LONE: &str = "mapper.filters=[\"range\", \"selection\", \"stuck\", \"lone\", \"bubble\"]";
const REMAP: &str = "mapper.remap=true";
const PAPER: &str = "mapper.fusion=paper";
const COVARIANCE: &str = "mapper.fusion=covariance";
const FIRST_ECHO: &str = "mapper.fusion=first_echo";
/// The odometry is believed.
const SYSTEMATIC: &str = "odometry.systematic=off";
const K_LL: &str = "odometry.k_ll=0";
const K_LT: &str = "odometry.k_lt=0";
const K_TT: &str = "odometry.k_tt=0";
const K_TL: &str = "odometry.k_tl=0";

/// Every rule of fusion with every filter, and what a fix can do besides.
pub(super) const METHODS: &[Method] = &[
    Method { name: "fixed σ, no filter", sets: &[PAPER, SYSTEMATIC, K_LL, K_LT, K_TT, K_TL, RAW] },
    Method { name: "fixed σ", sets: &[PAPER, SYSTEMATIC, K_LL, K_LT, K_TT, K_TL] },
    Method { name: "paper, no filter", sets: &[PAPER, RAW] },
    Method { name: "paper", sets: &[PAPER] },
    Method { name: "paper, lone", sets: &[PAPER, LONE] },
    Method { name: "paper, 8 sonars", sets: &[PAPER, CORRIDOR] },
    Method { name: "paper, remap", sets: &[PAPER, REMAP] },
    Method { name: "covariance, no filter", sets: &[COVARIANCE, RAW] },
    Method { name: "covariance", sets: &[COVARIANCE] },
    Method { name: "covariance, lone", sets: &[COVARIANCE, LONE] },
    Method { name: "covariance, 8 sonars", sets: &[COVARIANCE, CORRIDOR] },
    Method { name: "covariance, remap", sets: &[COVARIANCE, REMAP] },
    Method { name: "first_echo, no filter", sets: &[FIRST_ECHO, RAW] },
    Method { name: "first_echo", sets: &[FIRST_ECHO] },
    Method { name: "first_echo, lone", sets: &[FIRST_ECHO, LONE] },
    Method { name: "first_echo, 8 sonars", sets: &[FIRST_ECHO, CORRIDOR] },
    Method { name: "first_echo, remap", sets: &[FIRST_ECHO, REMAP] },
    Method { name: "first_echo, lone, remap", sets: &[FIRST_ECHO, LONE, REMAP] },
    Method { name: "first_echo, 8 sonars, remap", sets: &[FIRST_ECHO, CORRIDOR, REMAP] },
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
