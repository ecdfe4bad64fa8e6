//! Whether the services make a graph.

use echogrid_core::localization::Ask;
use echogrid_localizer::config::Source as LocatedBy;
use echogrid_topics::Topic;
use echogrid_topics::contract::MAX_ACKS;

use super::Config;
use super::Wiring;
use super::assemble::Origins;
use super::problem::Problem;
use super::service::{BUILTIN_PREFIX, Builtin, Exec, Service, ServiceKind};

/// Variables by which a service finds its graph.
const LAUNCHERS_OWN: [&str; 4] = ["ECHOGRID_DOMAIN", "ECHOGRID_SERVICE", "ECHOGRID_LIFELINE", "ECHOGRID_GONE"];

/// What keeps the services from being a graph.
pub(crate) fn problems(config: &Config, origins: &Origins) -> Vec<Problem> {
    let counts = ServiceKind::ALL.into_iter().filter_map(|kind| count(config, kind));
    let unasked = nobody_to_ask(config, origins).into_iter().chain(slam_asks_nobody(config));
    let each = config.services.iter().flat_map(|(name, service)| {
        let of_service = service_problems(config, name, service, origins);
        of_service.into_iter().chain(wiring_problems(config, name, service, origins))
    });
    let unasked = unasked.chain(going_on(config, origins));
    let unasked = unasked.chain(two_recorders(config)).chain(composed(config));
    counts.chain(unasked).chain(each).collect()
}

/// There is one recording.
fn two_recorders(config: &Config) -> Option<Problem> {
    let records = |service: &Service| service.exec == Exec::Builtin(Builtin::Recorder);
    let names: Vec<&str> =
        config.services.iter().filter(|(_, service)| records(service)).map(|(name, _)| name.as_str()).collect();
    let message = format!("{} would write to the same file; expected one recorder", names.join(" and "));
    (names.len() > 1).then(|| Problem { origin: None, key: "services".to_owned(), value: None, message })
}

/// What is wrong with sensors that make up one: together they say what one says, each its part.
fn composed(config: &Config) -> Vec<Problem> {
    let sensors = || config.services.iter().filter(|(_, service)| service.kind == ServiceKind::Sensor);
    let mut found = Vec::new();
    let is_none = |service: &Service| matches!(service.exec, Exec::Builtin(builtin) if builtin.kind() != service.kind);
    if sensors().any(|(_, service)| is_none(service)) {
        // That is told, and the rest follows from it.
        return found;
    }
    for topic in [Topic::RobotDescription, Topic::OdometryRaw, Topic::RangeScan, Topic::TruePose] {
        let writes = |service: &Service| service.wiring.writes.iter().any(|name| name == topic.name());
        let writers: Vec<&str> =
            sensors().filter(|(_, service)| writes(service)).map(|(name, _)| name.as_str()).collect();
        let is_missing = topic != Topic::TruePose && !config.services.values().any(writes);
        let message = match writers.as_slice() {
            [] if is_missing && sensors().next().is_some() => {
                let who: Vec<&str> = sensors().map(|(name, _)| name.as_str()).collect();
                format!("nobody writes {}: {} must, or another service of kind sensor", topic.name(), who.join(" or "))
            }
            [_, _, ..] => format!(
                "{} all write {}, and a topic of a sensor has one writer: say what each writes, as in writes = [\"{}\"]",
                writers.join(" and "),
                topic.name(),
                Topic::RangeScan.name()
            ),
            _ => continue,
        };
        found.push(Problem { origin: None, key: "services".to_owned(), value: None, message });
    }
    found
}

/// SLAM finds its own way, and takes no fix.
fn slam_asks_nobody(config: &Config) -> Option<Problem> {
    let message = "SLAM finds its own way and asks nobody where the robot is: leave out either --slam or --fix";
    let both = config.does_slam() && config.has_localizer();
    both.then(|| Problem { origin: None, key: "localizer.source".to_owned(), value: None, message: message.to_owned() })
}

/// What a drive that goes on with a map can't be told.
fn going_on(config: &Config, origins: &Origins) -> Option<Problem> {
    let map = &config.run.r#continue;
    if map.as_os_str().is_empty() {
        return None;
    }
    let of_readings = [
        ("mapper.doubt", config.mapper.doubt),
        ("mapper.sonar_maps", config.mapper.sonar_maps),
        ("mapper.keep_readings", config.mapper.keep_readings),
    ];
    let (key, message) = if config.does_slam() {
        ("run.continue", "SLAM makes a map of one drive: leave out either --slam or --continue")
    } else if config.localizer.source != LocatedBy::Map || config.localizer.map != *map {
        ("localizer.source", "a drive that goes on with a map (--continue) is localized in it; leave this out")
    } else if !config.odometry.start.is_open() {
        (
            "odometry.start",
            "a drive that goes on with a map (--continue) begins where the map shows it to be; leave this out",
        )
    } else if let Some((key, _)) = of_readings.into_iter().find(|(_, is_asked)| *is_asked) {
        (key, "of the drives that are gone on with (--continue) nothing is known but their map; leave this out")
    } else {
        return None;
    };
    let (origin, message) = (origins.get(key).cloned(), message.to_owned());
    Some(Problem { origin, key: key.to_owned(), value: None, message })
}

/// A schedule for localizations that nobody makes.
fn nobody_to_ask(config: &Config, origins: &Origins) -> Option<Problem> {
    let origin = ["ask", "every_m", "every_s"].into_iter().find_map(|key| {
        let key = format!("localization.{key}");
        origins.get(&key).map(|origin| (key, origin.clone()))
    });
    let (key, origin) = origin.filter(|_| {
        let scheduled = matches!(config.localization.ask, Ask::Schedule | Ask::Both);
        scheduled && !config.has_localizer()
    })?;
    let message =
        "who is to be asked? Name one: --fix truth or --fix FILE, or localizer.source, or a service of kind localizer";
    Some(Problem { origin: Some(origin), key, value: None, message: message.to_owned() })
}

/// One odometry, one mapper; a localizer or none; publishers and sensors as many as wanted, but one.
fn count(config: &Config, kind: ServiceKind) -> Option<Problem> {
    let of_kind = config.services.iter().filter(|(_, service)| service.kind == kind);
    let names: Vec<&str> = of_kind.map(|(name, _)| name.as_str()).collect();
    let message = match (kind, names.len()) {
        (_, 1) | (ServiceKind::Publisher | ServiceKind::Sensor, 2..) | (ServiceKind::Localizer, 0) => return None,
        (_, 0) => format!("the graph has no {kind}"),
        (_, n) => format!("the graph has {n} services of kind {kind} ({}), expected one", names.join(", ")),
    };
    Some(Problem { origin: None, key: "services".to_owned(), value: None, message })
}

fn service_problems(config: &Config, name: &str, service: &Service, origins: &Origins) -> Vec<Problem> {
    let mut found = Vec::new();
    let mut add = |key: &str, value: String, message: String| {
        let key = format!("services.{name}.{key}");
        found.push(Problem { origin: origins.get(&key).cloned(), key, value: Some(value), message });
    };
    match &service.exec {
        Exec::Builtin(builtin) if builtin.kind() != service.kind => {
            let wanted = service.kind.default_builtin();
            let wanted = wanted.map_or(String::new(), |wanted| format!("{BUILTIN_PREFIX}{} or ", wanted.name()));
            let message = format!(
                "this is of kind {}, the service is of kind {}; expected {wanted}a path",
                builtin.kind(),
                service.kind,
            );
            add("exec", format!("\"{}\"", service.exec), message);
        }
        Exec::Path(path) if path.as_os_str().as_encoded_bytes().contains(&0) => {
            add("exec", format!("{path:?}"), "a path has no NUL".to_owned());
        }
        _ => {}
    }
    let needs = |other: &Service| service.wiring.writes.iter().any(|topic| other.wiring.reads.contains(topic));
    if !service.care.required && (service.wiring.source || config.services.values().any(needs)) {
        let who = if service.kind == ServiceKind::Other { name } else { service.kind.word() };
        add("required", "false".into(), format!("a graph can't go on without its {who}"));
    }
    if service.args.iter().any(|argument| argument.contains('\0')) {
        add("args", format!("{:?}", service.args), "an argument has no NUL".to_owned());
    }
    for (variable, value) in &service.env {
        if !is_variable(variable) {
            let message = "the name of a variable is letters, digits and _, not a digit first".to_owned();
            add("env", format!("{variable:?}"), message);
        }
        if LAUNCHERS_OWN.contains(&variable.as_str()) {
            add(&format!("env.{variable}"), format!("{value:?}"), "this is set by the launcher".to_owned());
        }
        if value.contains('\0') {
            add(&format!("env.{variable}"), format!("{value:?}"), "a variable has no NUL".to_owned());
        }
    }
    found
}

/// Topics that there are not, or that it can't be waited for on.
fn wiring_problems(config: &Config, name: &str, service: &Service, origins: &Origins) -> Vec<Problem> {
    let mut found = Vec::new();
    let is_said = |key: &str| origins.get(&format!("services.{name}.{key}")).is_some();
    if matches!(service.exec, Exec::Builtin(_)) && !is_said("reads") {
        return found;
    }
    let Wiring { reads, looks_on, writes, .. } = &service.wiring;
    let mut add = |key: &str, value: &str, message: String| {
        let key = format!("services.{name}.{key}");
        found.push(Problem { origin: origins.get(&key).cloned(), key, value: Some(format!("{value:?}")), message });
    };
    for (key, topics) in [("reads", reads), ("looks_on", looks_on), ("writes", writes)] {
        for (index, topic) in topics.iter().enumerate() {
            if topics[..index].contains(topic) {
                add(key, topic, "this is said twice".to_owned());
            } else if !config.topic_names().any(|known| known == topic) {
                let known = config.topic_names().collect::<Vec<_>>().join(", ");
                add(key, topic, format!("there is no such topic; expected one of {known}"));
            }
        }
    }
    if let Some(topic) = reads.iter().find(|topic| looks_on.contains(topic)) {
        add("looks_on", topic, "it is among what the service reads; expected one of the two".to_owned());
    }
    if reads.len() > MAX_ACKS {
        add("reads", &reads.join(", "), format!("these are {} topics; expected at most {MAX_ACKS}", reads.len()));
    }
    for topic in reads.iter().filter(|_| is_said("reads")) {
        if !config.services.values().any(|other| other.wiring.writes.contains(topic)) {
            add("reads", topic, "nobody in the graph writes it, so that it would be waited for in vain".to_owned());
        }
    }
    let others = config.services.iter().filter(|(other, _)| other.as_str() != name);
    for topic in writes.iter().filter(|_| is_said("writes")) {
        let is_stream = Topic::ALL.iter().any(|known| known.name() == topic && known.delivery().is_stream());
        let mut writers = others.clone().filter(|(_, other)| other.wiring.writes.contains(topic));
        if let Some((other, _)) = writers.next().filter(|_| is_stream) {
            add("writes", topic, format!("{other} writes it, too; a stream has one writer"));
        }
    }
    found
}

fn is_variable(name: &str) -> bool {
    !name.is_empty()
        && !name.starts_with(|c: char| c.is_ascii_digit())
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}
