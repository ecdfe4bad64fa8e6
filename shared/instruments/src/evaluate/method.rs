//! What is compared: ways of mapping, and how often the robot is told where it is.

use anyhow::{Result, bail};

use echogrid_config::nearest;

/// A way of mapping.
#[derive(Debug, Clone, Copy)]
pub(super) struct Method {
    pub(super) name: &'static str,
    pub(super) sets: &'static [&'static str],
}

/// As readings come, but for limits and selection.
const RAW: &str = "mapper.filters=[\"range\", \"selection\"]";
/// What rules need that do not know that walls mirror.
const BUBBLE: &str = "mapper.filters=[\"range\", \"selection\", \"stuck\", \"bubble\"]";
const LONE: &str = "mapper.filters=[\"range\", \"selection\", \"stuck\", \"lone\", \"bubble\"]";
/// The paper's choice of sonars.
const CORRIDOR: &str = "mapper.sonars=corridor";
const REMAP: &str = "mapper.remap=true";
/// As the robot drives, never in hindsight.
const ONLINE: &str = "mapper.remap=false";
const PAPER: &str = "mapper.fusion=paper";
const COVARIANCE: &str = "mapper.fusion=covariance";
const FIRST_ECHO: &str = "mapper.fusion=first_echo";
const ORIENTED: &str = "mapper.fusion=oriented";
/// The odometry is believed.
const SYSTEMATIC: &str = "odometry.systematic=off";
const K_LL: &str = "odometry.k_ll=0";
const K_LT: &str = "odometry.k_lt=0";
const K_TT: &str = "odometry.k_tt=0";
const K_TL: &str = "odometry.k_tl=0";

/// Every rule of fusion with every filter, and what a fix can do besides.
const METHODS: &[Method] = &[
    Method { name: "fixed σ, no filter", sets: &[PAPER, SYSTEMATIC, K_LL, K_LT, K_TT, K_TL, RAW, ONLINE] },
    Method { name: "fixed σ", sets: &[PAPER, SYSTEMATIC, K_LL, K_LT, K_TT, K_TL, BUBBLE, ONLINE] },
    Method { name: "paper, no filter", sets: &[PAPER, RAW, ONLINE] },
    Method { name: "paper", sets: &[PAPER, BUBBLE, ONLINE] },
    Method { name: "paper, lone", sets: &[PAPER, LONE, ONLINE] },
    Method { name: "paper, 8 sonars", sets: &[PAPER, CORRIDOR, BUBBLE, ONLINE] },
    Method { name: "paper, remap", sets: &[PAPER, BUBBLE, REMAP] },
    Method { name: "covariance, no filter", sets: &[COVARIANCE, RAW, ONLINE] },
    Method { name: "covariance", sets: &[COVARIANCE, BUBBLE, ONLINE] },
    Method { name: "covariance, lone", sets: &[COVARIANCE, LONE, ONLINE] },
    Method { name: "covariance, 8 sonars", sets: &[COVARIANCE, CORRIDOR, BUBBLE, ONLINE] },
    Method { name: "covariance, remap", sets: &[COVARIANCE, BUBBLE, REMAP] },
    Method { name: "first_echo, no filter", sets: &[FIRST_ECHO, RAW, ONLINE] },
    Method { name: "first_echo", sets: &[FIRST_ECHO, BUBBLE, ONLINE] },
    Method { name: "first_echo, lone", sets: &[FIRST_ECHO, LONE, ONLINE] },
    Method { name: "first_echo, 8 sonars", sets: &[FIRST_ECHO, CORRIDOR, BUBBLE, ONLINE] },
    Method { name: "first_echo, remap", sets: &[FIRST_ECHO, BUBBLE, REMAP] },
    Method { name: "first_echo, lone, remap", sets: &[FIRST_ECHO, LONE, REMAP] },
    Method { name: "first_echo, 8 sonars, remap", sets: &[FIRST_ECHO, CORRIDOR, BUBBLE, REMAP] },
    Method { name: "oriented, no remap", sets: &[ORIENTED, ONLINE] },
    Method { name: "oriented, bubble", sets: &[ORIENTED, BUBBLE] },
    Method { name: "oriented, 8 sonars", sets: &[ORIENTED, CORRIDOR] },
    Method { name: "as it comes", sets: &[] },
];

impl Method {
    /// The rule that evidence is fused by.
    pub(super) fn fusion(&self) -> Option<&'static str> {
        self.sets.iter().find_map(|set| set.strip_prefix("mapper.fusion="))
    }
}

/// How often the robot is told where it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Schedule {
    pub(super) name: &'static str,
    pub(super) sets: &'static [&'static str],
}

const TRUTH: &str = "localizer.source=truth";
const BY_SCHEDULE: &str = "localization.ask=schedule";

const SCHEDULES: [Schedule; 4] = [
    Schedule { name: "exact", sets: &[TRUTH, BY_SCHEDULE, "localization.every_m=0.01"] },
    Schedule { name: "5 m", sets: &[TRUTH, BY_SCHEDULE, "localization.every_m=5"] },
    Schedule { name: "15 m", sets: &[TRUTH, BY_SCHEDULE, "localization.every_m=15"] },
    Schedule { name: "never", sets: &["localization.ask=never"] },
];

/// The methods of these names, or all where none is named.
pub(super) fn methods(names: &[String]) -> Result<Vec<Method>> {
    chosen("--method", names, METHODS, |method| method.name)
}

/// The schedules of these names, or all where none is named.
pub(super) fn schedules(names: &[String]) -> Result<Vec<Schedule>> {
    chosen("--fix", names, &SCHEDULES, |schedule| schedule.name)
}

/// Those of these names, in the order of `all`.
fn chosen<T: Copy>(option: &str, names: &[String], all: &[T], name_of: impl Fn(&T) -> &'static str) -> Result<Vec<T>> {
    for name in names {
        if !all.iter().any(|each| name_of(each) == name) {
            let near = nearest(name, all.iter().map(&name_of));
            let near = near.map_or_else(String::new, |near| format!("; did you mean \"{near}\"?"));
            let known = all.iter().map(|each| format!("\"{}\"", name_of(each))).collect::<Vec<_>>().join(", ");
            bail!("{option} \"{name}\": expected one of {known}{near}");
        }
    }
    let is_chosen = |each: &&T| names.is_empty() || names.iter().any(|name| name == name_of(each));
    Ok(all.iter().filter(is_chosen).copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_that_are_named_in_the_order_of_the_table() {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let chosen = methods(&names(&["first_echo", "paper"])).unwrap();
        assert_eq!(chosen.iter().map(|method| method.name).collect::<Vec<_>>(), ["paper", "first_echo"]);
        assert_eq!(chosen[1].fusion(), Some("first_echo"));
        assert_eq!(schedules(&[]).unwrap().len(), SCHEDULES.len());
        let refused = methods(&names(&["first echo"])).unwrap_err().to_string();
        assert!(refused.contains("--method \"first echo\": expected one of"), "{refused}");
        assert!(refused.ends_with("did you mean \"first_echo\"?"), "{refused}");
        assert!(schedules(&names(&["often"])).unwrap_err().to_string().contains("\"15 m\""));
    }
}
