//! Who waits for whom in a graph, as its services declare it.

use std::collections::{BTreeMap, BTreeSet};

use echogrid_topics::Topic;

use crate::wiring::Wiring;

/// Which services each topic's producer waits for.
#[must_use]
pub fn consumers(services: &BTreeMap<String, impl AsRef<Wiring>>) -> BTreeMap<String, Vec<String>> {
    by_topic(services, |wiring| &wiring.reads)
}

/// Which services write each topic; all write `health`.
#[must_use]
pub fn writers(services: &BTreeMap<String, impl AsRef<Wiring>>) -> BTreeMap<String, Vec<String>> {
    let mut writers = by_topic(services, |wiring| &wiring.writes);
    writers.insert(Topic::Health.name().into(), services.keys().cloned().collect());
    writers
}

/// Which services take what comes of each topic without being waited for.
#[must_use]
pub fn onlookers(services: &BTreeMap<String, impl AsRef<Wiring>>) -> BTreeMap<String, Vec<String>> {
    by_topic(services, |wiring| &wiring.looks_on)
}

fn by_topic(
    services: &BTreeMap<String, impl AsRef<Wiring>>,
    topics: impl Fn(&Wiring) -> &Vec<String>,
) -> BTreeMap<String, Vec<String>> {
    let mut names: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (name, service) in services {
        for topic in topics(service.as_ref()) {
            names.entry(topic.clone()).or_default().push(name.clone());
        }
    }
    names
}

/// A service's place in the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FlowPosition {
    /// 0 for sources; who reads a stream comes after who writes it.
    pub rank: usize,
    /// Whether the end of a stream reaches it; who is not told is asked to end when the others have.
    pub is_told: bool,
}

/// The place of each service. Streams go round where services command those upstream: a source comes first whatever it reads,
/// and of what else goes round, who comes first by name.
#[must_use]
pub fn places(services: &BTreeMap<String, impl AsRef<Wiring>>) -> BTreeMap<String, FlowPosition> {
    let is_source = |name: &str| services.get(name).is_some_and(|service| service.as_ref().source);
    let mut upstream: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for (name, service) in services {
        let wiring = service.as_ref();
        let streams = || wiring.reads.iter().filter(|topic| is_stream(topic) && !wiring.source);
        let writes = |other: &Wiring| streams().any(|topic| other.writes.contains(topic));
        let producers = services.iter().filter(|(other, of)| *other != name && writes(of.as_ref()));
        upstream.insert(name, producers.map(|(other, _)| other.as_str()).collect());
    }
    let mut told: BTreeSet<&str> = services.keys().map(String::as_str).filter(|name| is_source(name)).collect();
    loop {
        let more =
            upstream.iter().filter(|(name, from)| !told.contains(*name) && from.iter().any(|from| told.contains(from)));
        let more: Vec<&str> = more.map(|(name, _)| *name).collect();
        if more.is_empty() {
            break;
        }
        told.extend(more);
    }
    let mut ranks: BTreeMap<&str, usize> = BTreeMap::new();
    while ranks.len() < services.len() {
        let open = || upstream.iter().filter(|(name, _)| !ranks.contains_key(*name));
        // Those that nobody tells come after all that are told.
        let open_told = open().any(|(name, _)| told.contains(name));
        let candidates = || open().filter(|(name, _)| !open_told || told.contains(*name));
        let ready = candidates()
            .find(|(_, from)| from.iter().all(|from| ranks.contains_key(from) || !told.contains(from) && open_told));
        let Some((name, from)) = ready.or_else(|| candidates().next()) else { break };
        let after = from.iter().filter_map(|from| ranks.get(from)).max().map_or(0, |rank| rank + 1);
        let last = ranks.values().max().map_or(0, |rank| rank + 1);
        let is_first_untold = !told.contains(name) && ranks.keys().all(|ranked| told.contains(ranked));
        let rank = if told.contains(name) || !is_first_untold && after > 0 { after } else { last };
        ranks.insert(name, rank);
    }
    ranks
        .into_iter()
        .map(|(name, rank)| (name.to_owned(), FlowPosition { rank, is_told: told.contains(name) }))
        .collect()
}

fn is_stream(topic: &str) -> bool {
    Topic::ALL.iter().any(|known| known.name() == topic && known.delivery().is_stream())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wiring(reads: &[&str], looks_on: &[&str], writes: &[&str]) -> Wiring {
        let names = |topics: &[&str]| topics.iter().map(|topic| (*topic).to_owned()).collect();
        Wiring { reads: names(reads), looks_on: names(looks_on), writes: names(writes), source: false }
    }

    /// A graph of one service of each kind.
    fn graph() -> BTreeMap<String, Wiring> {
        let sensor = wiring(&[], &[], &["robot/description", "truth/pose", "odometry/raw", "range/scan"]);
        let localizer =
            wiring(&["robot/description", "truth/pose", "localization/request"], &[], &["localization/fix"]);
        let services = [
            ("sensor", Wiring { source: true, ..sensor }),
            (
                "odometry",
                wiring(
                    &["robot/description", "localization/fix", "odometry/raw"],
                    &[],
                    &["localization/request", "odometry/estimate"],
                ),
            ),
            ("localizer", localizer),
            ("mapper", wiring(&["odometry/estimate", "range/scan"], &[], &["map/tiles", "map/info"])),
            ("publisher", wiring(&["odometry/estimate", "map/tiles"], &[], &[])),
        ];
        services.map(|(name, wiring)| (name.to_owned(), wiring)).into()
    }

    fn ranks(services: &BTreeMap<String, Wiring>) -> BTreeMap<String, (usize, bool)> {
        places(services).into_iter().map(|(name, place)| (name, (place.rank, place.is_told))).collect()
    }

    #[test]
    fn streams_go_from_the_sensor_to_the_publisher() {
        let ranks = ranks(&graph());
        let expected = [("localizer", 2), ("mapper", 2), ("odometry", 1), ("publisher", 3), ("sensor", 0)]
            .map(|(n, r)| (n.into(), (r, true)));
        assert_eq!(ranks, BTreeMap::from(expected));
    }

    #[test]
    fn who_is_told_by_no_stream_comes_last() {
        let mut services = graph();
        services.remove("localizer");
        // Commands whoever reads it; looks on; reads the tiles alone.
        services.insert("planner".into(), wiring(&["map/info"], &[], &["localization/request"]));
        services.insert("a-viewer".into(), wiring(&[], &["map/tiles"], &[]));
        services.insert("tiles".into(), wiring(&["map/tiles"], &[], &[]));
        services.entry("sensor".into()).and_modify(|sensor| sensor.reads.push("localization/request".into()));
        let ranks = ranks(&services);
        assert_eq!((ranks["sensor"], ranks["tiles"], ranks["publisher"]), ((0, true), (3, true), (3, true)));
        assert!(!ranks["planner"].1 && !ranks["a-viewer"].1, "{ranks:?}");
        assert!(ranks["planner"].0 > 3 && ranks["a-viewer"].0 > 3, "{ranks:?}");
        assert_eq!(consumers(&services)["map/tiles"], ["publisher", "tiles"]);
        assert_eq!(onlookers(&services)["map/tiles"], ["a-viewer"]);
        assert_eq!(writers(&services)["map/info"], ["mapper"]);
    }
}
