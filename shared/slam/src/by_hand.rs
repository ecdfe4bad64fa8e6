//! Closures that somebody forbids or requires, by the numbers of their nodes.

use crate::closures::Standing;
use crate::config::SlamConfig;

/// What is forbidden with a closure: those whose two ends lie within so much way of its ends, metres. They would say the same.
const WITH_IT_M: f64 = 3.0;
/// So many that were found are named where one was not.
const NEAREST: usize = 3;

/// What was found, as it is named by hand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// Its nodes.
    pub(crate) nodes: [u32; 2],
    pub(crate) standing: Standing,
}

/// What somebody says of the closure of these nodes; none: nothing. `way_m`: until a node.
pub(crate) fn said_of(config: &SlamConfig, nodes: [u32; 2], way_m: impl Fn(u32) -> Option<f64>) -> Option<Standing> {
    if config.require.contains(&nodes) {
        return Some(Standing::Required);
    }
    let is_near = |a: u32, b: u32| way_m(a).zip(way_m(b)).is_some_and(|(a, b)| (a - b).abs() <= WITH_IT_M);
    let is_forbidden =
        |[from, to]: &[u32; 2]| [*from, *to] == nodes || is_near(*from, nodes[0]) && is_near(*to, nodes[1]);
    config.forbid.iter().any(is_forbidden).then_some(Standing::Forbidden)
}

/// What is wrong with what somebody said, once all was found: a closure that was not; in words, with those that are nearest.
pub(crate) fn unknown(config: &SlamConfig, found: &[Found], way_m: impl Fn(u32) -> Option<f64>) -> Option<String> {
    let near = |[from, to]: [u32; 2], other: &Found| {
        let apart = |a: u32, b: u32| way_m(a).zip(way_m(b)).map_or(f64::from(a.abs_diff(b)), |(a, b)| (a - b).abs());
        apart(from, other.nodes[0]) + apart(to, other.nodes[1])
    };
    let is_known = |key: &str, pair: [u32; 2]| {
        found.iter().any(|found| {
            found.nodes == pair
                || key == "forbid"
                    && found.standing == Standing::Forbidden
                    && said_of(&SlamConfig { forbid: vec![pair], ..SlamConfig::default() }, found.nodes, &way_m)
                        .is_some()
        })
    };
    let named =
        config.forbid.iter().map(|pair| ("forbid", *pair)).chain(config.require.iter().map(|pair| ("require", *pair)));
    let (key, pair) = named.into_iter().find(|(key, pair)| !is_known(key, *pair))?;
    let mut nearest: Vec<&Found> = found.iter().collect();
    nearest.sort_by(|a, b| near(pair, a).total_cmp(&near(pair, b)).then(a.nodes.cmp(&b.nodes)));
    let nearest: Vec<String> =
        nearest.iter().take(NEAREST).map(|found| format!("{},{}", found.nodes[0], found.nodes[1])).collect();
    let nearest = if nearest.is_empty() {
        "none was found".to_owned()
    } else {
        format!("the nearest are {}", nearest.join("; "))
    };
    Some(format!("--{key} {},{} (slam.{key}): no such closure was found; {nearest}", pair[0], pair[1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(forbid: &[[u32; 2]], require: &[[u32; 2]]) -> SlamConfig {
        SlamConfig { forbid: forbid.to_vec(), require: require.to_vec(), ..SlamConfig::default() }
    }

    /// A node each half metre, and no more than a hundred.
    fn way_m(node: u32) -> Option<f64> {
        (node < 100).then(|| 0.5 * f64::from(node))
    }

    #[test]
    fn what_is_next_to_a_forbidden_closure_is_forbidden_with_it() {
        let config = config(&[[10, 80]], &[[12, 81]]);
        let said = |nodes| said_of(&config, nodes, way_m);
        assert_eq!([said([10, 80]), said([16, 74]), said([4, 86])], [Some(Standing::Forbidden); 3]);
        assert_eq!([said([17, 80]), said([10, 87]), said([30, 60])], [None; 3]);
        assert_eq!(said([12, 81]), Some(Standing::Required));
    }

    #[test]
    fn what_was_not_found_is_told_with_what_was() {
        let found = |nodes, standing| Found { nodes, standing };
        let all = [
            found([12, 80], Standing::Forbidden),
            found([3, 50], Standing::Applied),
            found([40, 99], Standing::Alone),
            found([1, 99], Standing::Alone),
        ];
        let told = |forbid: &[[u32; 2]], require: &[[u32; 2]]| unknown(&config(forbid, require), &all, way_m);
        assert_eq!(told(&[[10, 80]], &[[3, 50]]), None);
        assert_eq!(
            told(&[], &[[4, 51]]).unwrap(),
            "--require 4,51 (slam.require): no such closure was found; the nearest are 3,50; 12,80; 1,99"
        );
        assert!(told(&[[4, 51]], &[]).unwrap().starts_with("--forbid 4,51"), "it stands as it is");
        assert!(unknown(&config(&[[1, 2000]], &[]), &[], way_m).unwrap().ends_with("none was found"));
    }

    #[test]
    fn pairs_that_can_not_be() {
        let key = |config: SlamConfig| config.validate().unwrap_err().key;
        assert_eq!([key(config(&[[5, 5]], &[])), key(config(&[], &[[9, 1]]))], ["forbid", "require"]);
        assert_eq!(key(config(&[[1, 9]], &[[1, 9]])), "require");
        assert!(config(&[[1, 9]], &[[1, 8]]).validate().is_ok());
    }
}
