//! Who waits for whom in a graph, as its services declare it.

use std::collections::{BTreeMap, BTreeSet};

use echogrid_topics::Topic;

use crate::config::Service;

/// Which services each topic's producer waits for.
#[must_use]
pub fn consumers(services: &BTreeMap<String, Service>) -> BTreeMap<String, Vec<String>> {
    by_topic(services, |service| &service.wiring.reads)
}

/// Which services write each topic; all write `health`.
#[must_use]
pub fn writers(services: &BTreeMap<String, Service>) -> BTreeMap<String, Vec<String>> {
    let mut writers = by_topic(services, |service| &service.wiring.writes);
    writers.insert(Topic::Health.name().into(), services.keys().cloned().collect());
    writers
}

/// Which services take what comes of each topic without being waited for.
#[must_use]
pub fn onlookers(services: &BTreeMap<String, Service>) -> BTreeMap<String, Vec<String>> {
    by_topic(services, |service| &service.wiring.looks_on)
}

fn by_topic(
    services: &BTreeMap<String, Service>,
    topics: impl Fn(&Service) -> &Vec<String>,
) -> BTreeMap<String, Vec<String>> {
    let mut names: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (name, service) in services {
        for topic in topics(service) {
            names.entry(topic.clone()).or_default().push(name.clone());
        }
    }
    names
}

/// A service's place in the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// 0 for sources; who reads a stream comes after who writes it.
    pub rank: usize,
    /// Whether the end of a stream reaches it; who is not told is asked to end when the others have.
    pub is_told: bool,
}

/// The place of each service. Streams go round where services command those upstream: a source comes first whatever it reads,
/// and of what else goes round, who comes first by name.
#[must_use]
pub fn places(services: &BTreeMap<String, Service>) -> BTreeMap<String, Place> {
    let is_source = |name: &str| services.get(name).is_some_and(|service| service.wiring.source);
    let mut upstream: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for (name, service) in services {
        let streams = || service.wiring.reads.iter().filter(|topic| is_stream(topic) && !service.wiring.source);
        let writes = |other: &Service| streams().any(|topic| other.wiring.writes.contains(topic));
        let producers = services.iter().filter(|(other, of)| *other != name && writes(of));
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
    ranks.into_iter().map(|(name, rank)| (name.to_owned(), Place { rank, is_told: told.contains(name) })).collect()
}

fn is_stream(topic: &str) -> bool {
    Topic::ALL.iter().any(|known| known.name() == topic && known.delivery().is_stream())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Exec, ServiceKind, Wiring, default_services};

    fn service(reads: &[&str], looks_on: &[&str], writes: &[&str]) -> Service {
        let names = |topics: &[&str]| topics.iter().map(|topic| (*topic).to_owned()).collect();
        let wiring = Wiring { reads: names(reads), looks_on: names(looks_on), writes: names(writes), source: false };
        let of = default_services(false).remove("publisher").unwrap();
        Service { kind: ServiceKind::Other, exec: Exec::Path("x".into()), wiring, ..of }
    }

    fn ranks(services: &BTreeMap<String, Service>) -> BTreeMap<String, (usize, bool)> {
        places(services).into_iter().map(|(name, place)| (name, (place.rank, place.is_told))).collect()
    }

    #[test]
    fn streams_go_from_the_sensor_to_the_publisher() {
        let ranks = ranks(&default_services(true));
        let expected = [("localizer", 2), ("mapper", 2), ("odometry", 1), ("publisher", 3), ("sensor", 0)]
            .map(|(n, r)| (n.into(), (r, true)));
        assert_eq!(ranks, BTreeMap::from(expected));
    }

    #[test]
    fn who_is_told_by_no_stream_comes_last() {
        let mut services = default_services(false);
        // Commands whoever reads it; looks on; reads the tiles alone.
        services.insert("planner".into(), service(&["map/info"], &[], &["localization/request"]));
        services.insert("a-viewer".into(), service(&[], &["map/tiles"], &[]));
        services.insert("tiles".into(), service(&["map/tiles"], &[], &[]));
        services.get_mut("sensor").unwrap().wiring.reads.push("localization/request".into());
        let ranks = ranks(&services);
        assert_eq!((ranks["sensor"], ranks["tiles"], ranks["publisher"]), ((0, true), (3, true), (3, true)));
        assert!(!ranks["planner"].1 && !ranks["a-viewer"].1, "{ranks:?}");
        assert!(ranks["planner"].0 > 3 && ranks["a-viewer"].0 > 3, "{ranks:?}");
        assert_eq!(consumers(&services)["map/tiles"], ["publisher", "tiles"]);
        assert_eq!(onlookers(&services)["map/tiles"], ["a-viewer"]);
        assert_eq!(writers(&services)["map/info"], ["mapper"]);
    }
}
