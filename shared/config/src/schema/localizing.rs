//! `[odometry]`, `[slam]`, `[localization]`, `[localizer]`: where the robot is.

use super::{Section, Text, defaults, key, probe, refused, text, words};
use echogrid_core::config::OdometryConfig;
use echogrid_core::localization::LocalizationConfig;
use echogrid_localizer::config::LocalizerConfig;
use echogrid_slam::SlamConfig;

pub(crate) static ODOMETRY: Section = Section {
    name: "odometry",
    about: "where the odometry begins, and its error model (eqs 1 to 4)",
    keys: &[
        words(
            "start",
            &["auto", "odometry"],
            "\"auto\", \"odometry\" or [x, y, theta] in metres and radians",
            "where in the map it begins: [x, y, theta]; odometry: its frame is the map's; auto: as the first fix says, else odometry",
        ),
        words(
            "poses",
            &["drive", "exact"],
            "one of drive, exact",
            "exact: poses that do not drift (a SLAM's, motion capture): no error, whatever the keys below say",
        ),
        words(
            "systematic",
            &["carry", "correct", "off"],
            "one of carry, correct, off",
            "carry: as doubt into the sensor model; correct: taken out of every increment; off",
        ),
        key("lin_scale", "a number (metres of error per metre)", "a_l, metres of error per metre travelled"),
        key("lin_offset_m", "a number of metres", "sigma, metres, mean linear error that a rotation causes"),
        key("lin_offset_from_turn_rad", "a number of radians", "radians turned from which sigma counts"),
        key("ang_scale", "a number (radians of error per radian)", "a_theta, radians of error per radian turned"),
        key("ang_offset_rad", "a number of radians", "alpha, radians, mean angular error that a translation causes"),
        key("ang_offset_from_travel_m", "a number of metres", "metres travelled from which alpha counts"),
        key("k_ll", "a number (m²/m)", "m²/m, variance of the linear error per metre travelled"),
        key("k_lt", "a number (m²/rad)", "m²/rad, variance of the linear error per radian turned"),
        key("k_tt", "a number (rad²/rad)", "rad²/rad, variance of the angular error per radian turned"),
        key("k_tl", "a number (rad²/m)", "rad²/m, variance of the angular error per metre travelled"),
        words(
            "noise",
            &["sampled", "one_sigma"],
            "one of sampled, one_sigma",
            "sampled: drawn per reading; one_sigma: one standard deviation, no draw",
        ),
        key("seed", "a whole number from 0 to 9223372036854775807", "seed of the draws"),
    ],
    probe: probe::<OdometryConfig>,
    defaults: defaults::<OdometryConfig>,
    refuses: |table| refused(table, OdometryConfig::validate),
};

pub(crate) static SLAM: Section = Section {
    name: "slam",
    about: "what builtin:slam does (--slam): poses corrected where a lidar sees, or sonars hear, the same again",
    keys: &[
        words(
            "odometry",
            &["use", "ignore"],
            "one of use, ignore",
            "use: the odometry says where the next scan lies, as exactly as [odometry] says; ignore: the lidar alone tells the way",
        ),
        key("node_every_m", "a number of metres", "metres of way from scan to scan that is laid on those before it"),
        key("node_every_rad", "a number of radians", "radians of turn, likewise"),
        key("closure_after_m", "a number of metres", "metres of way after which a place counts as visited again"),
        key(
            "closure_every_m",
            "a number of metres",
            "metres of way from search to search for places that were visited before",
        ),
        key(
            "closure_score_min",
            "a number from 0.3 to 1",
            "share of the points that must lie on walls where a place is recognised; three that agree need three quarters of it",
        ),
        key(
            "closure_margin",
            "a number from 0 to 0.5",
            "by how much the next best place must score less; else the place is not told apart, and not taken",
        ),
        key(
            "refine_rounds",
            "a whole number from 0 to 10",
            "rounds in which all scans of one place are laid on each other at the end",
        ),
        key(
            "settle_after_m",
            "a number from 40 to 1e9",
            "lidars: what was driven is settled, but for its later half, when it is this long: no closure changes it any more",
        ),
        key(
            "sonar_evidence_nat",
            "a number from 0.1 to 10",
            "sonars: by how many nat a reading what was heard must fit a place better than nothing",
        ),
        key(
            "sonar_margin_nat",
            "a number from 0 to 10",
            "sonars: by how many nat a reading it must fit worse 0.8 m away; else the place is not told apart, and not taken",
        ),
        key(
            "forbid",
            "a list of pairs of nodes, as [[12, 345]]",
            "closures that are none, as `echogrid closures` names them (--forbid 12,345), with those within 3 m of way at both ends",
        ),
        key(
            "require",
            "a list of pairs of nodes, as [[12, 345]]",
            "closures that are right, whether others agree or not (--require 12,345)",
        ),
    ],
    probe: probe::<SlamConfig>,
    defaults: defaults::<SlamConfig>,
    refuses: |table| refused(table, SlamConfig::validate),
};

pub(crate) static LOCALIZATION: Section = Section {
    name: "localization",
    about: "when an absolute localization is asked for, and what happens until it comes",
    keys: &[
        words(
            "ask",
            &["degraded", "schedule", "both", "never"],
            "one of degraded, schedule, both, never",
            "degraded: when readings can hardly decide a cell any more; schedule: every_m, every_s; both; never",
        ),
        key("every_m", "a number of metres", "metres by odometry from fix to fix; 0: not by way"),
        key("every_s", "a number of seconds", "seconds by the sensor's clock from fix to fix; 0: not by time"),
        key("retry_s", "a number of seconds", "seconds until it is asked again after an answer without a fix"),
        key(
            "gate_sigmas",
            "a number of standard deviations",
            "standard deviations from where the robot should be beyond which a fix is refused; 0: none is",
        ),
        key(
            "degraded_trust",
            "a number from 0 to 1",
            "degraded while a reading of 2 m is trusted less; 0.43: where one reading can't make a cell occupied",
        ),
        words(
            "hold",
            &["auto", "always", "never"],
            "one of auto, always, never",
            "whether mapping holds while degraded; auto: if somebody is asked then where the robot is",
        ),
        words(
            "wait",
            &["auto", "always", "never"],
            "one of auto, always, never",
            "whether odometry waits for the answer; auto: behind a log or a simulator, not behind a robot",
        ),
    ],
    probe: probe::<LocalizationConfig>,
    defaults: defaults::<LocalizationConfig>,
    refuses: |table| refused(table, LocalizationConfig::validate),
};

pub(crate) static LOCALIZER: Section = Section {
    name: "localizer",
    about: "who says where the robot is, and how well",
    keys: &[
        words(
            "source",
            &["none", "operator", "truth", "reference", "landmarks", "map"],
            "one of none, operator, truth, reference, landmarks, map",
            "none; operator: `echogrid fix`; truth: the sensor, if it is a simulator or a log with true poses; reference, \
             landmarks and map: the files of these keys",
        ),
        key(
            "position_sigma_m",
            "a number of metres",
            "metres along each axis, standard deviation of the position that truth (drawn) or reference tell",
        ),
        key("heading_sigma_rad", "a number of radians", "radians, standard deviation of the heading that these tell"),
        key("seed", "a whole number from 0 to 9223372036854775807", "seed of all that is drawn"),
        text(
            "reference",
            Text::Path,
            "a path",
            "where the robot was: a file with lines `t x y theta`; empty: not named",
        ),
        key(
            "reference_gap_s",
            "a number of seconds",
            "seconds from pose to pose of the reference beyond which it is a gap",
        ),
        text("landmarks", Text::Path, "a path", "surveyed landmarks: a file with [[landmark]]; empty: not named"),
        text(
            "sightings",
            Text::Path,
            "a path",
            "what was measured of them: a file with lines `t landmark range bearing`; empty: measured from the true pose",
        ),
        key("sightings_within_s", "a number of seconds", "seconds before or after a request in which sightings count"),
        key("sight_m", "a number of metres", "metres to which landmarks are measured from the true pose"),
        words(
            "measure",
            &["both", "range", "bearing"],
            "one of both, range, bearing",
            "what is measured of a landmark: both; range: tells no heading; bearing",
        ),
        key("range_sigma_m", "a number of metres", "metres, standard deviation of a range to a landmark"),
        key("bearing_sigma_rad", "a number of radians", "radians, standard deviation of a bearing of a landmark"),
        text("map", Text::Path, "a path", "a map.echogrid in which the robot is localized; empty: not named"),
        key(
            "map_window_m",
            "a number of metres from 1 to 12",
            "metres of way whose sonar readings are laid on the map as one piece; half more while nothing is known",
        ),
        key(
            "map_evidence_nat",
            "a number of nat",
            "nat a reading by which sonars must fit the map better than nothing",
        ),
        key("map_margin_nat", "a number of nat", "nat a reading by which the next best place must be worse"),
    ],
    probe: probe::<LocalizerConfig>,
    defaults: defaults::<LocalizerConfig>,
    refuses: |table| refused(table, LocalizerConfig::validate),
};
