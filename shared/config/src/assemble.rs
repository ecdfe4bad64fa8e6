//! From settings to a configuration: later settings over earlier ones over the defaults.

use std::collections::{BTreeMap, BTreeSet};

use echogrid_core::localization::Ask;
use echogrid_localizer::config::Source as LocatedBy;
use echogrid_topics::velocity::{DRIVE_COMMAND, Velocity};
use echogrid_topics::{DeclaredTopic, Topic};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::Config;
use super::problem::{Origin, Problem};
use super::reading::{Setting, dotted};
use super::schema::TOPIC;
use super::service::{BUILTIN_PREFIX, Builtin, Exec, Service, ServiceKind, Speech};
use super::standard::default_services;
use super::suggest;
use super::wiring::{Written, declared};

/// Where each key was set.
pub(crate) type Origins = BTreeMap<String, Origin>;

/// The origin of each key that was set; the last setting counts.
pub(crate) fn origins(settings: &[Setting]) -> Origins {
    settings.iter().map(|setting| (dotted(&setting.path), setting.origin.clone())).collect()
}

/// The configuration, but for `[services]`.
pub(crate) fn sections(settings: &[Setting]) -> Result<Config, Problem> {
    let mut config = Config::default();
    config.run = section("run", &config.run, settings)?;
    config.replay = section("replay", &config.replay, settings)?;
    config.simulator = section("simulator", &config.simulator, settings)?;
    config.pioneer = section("pioneer", &config.pioneer, settings)?;
    config.lidar = section("lidar", &config.lidar, settings)?;
    config.odometry = section("odometry", &config.odometry, settings)?;
    config.slam = section("slam", &config.slam, settings)?;
    config.localization = section("localization", &config.localization, settings)?;
    config.localizer = section("localizer", &config.localizer, settings)?;
    config.mapper = section("mapper", &config.mapper, settings)?;
    config.publisher = section("publisher", &config.publisher, settings)?;
    config.recorder = section("recorder", &config.recorder, settings)?;
    config.supervision = section("supervision", &config.supervision, settings)?;
    Ok(config)
}

/// A drive that goes on with a map is localized in it, unless it is said who does that.
pub(crate) fn localize_to_go_on(config: &mut Config, origins: &Origins) {
    let map = &config.run.r#continue;
    if !map.as_os_str().is_empty() && !origins.contains_key("localizer.source") {
        (config.localizer.source, config.localizer.map) = (LocatedBy::Map, map.clone());
    }
}

/// Where a robot is localized in a map, which costs nothing but time, it is asked for by way, too, unless it is said when.
pub(crate) fn ask_by_way(config: &mut Config, origins: &Origins) {
    const EVERY_M: f64 = 2.0;
    let is_said = ["ask", "every_m", "every_s"].iter().any(|key| origins.contains_key(&format!("localization.{key}")));
    if config.localizer.source == LocatedBy::Map && !is_said {
        (config.localization.ask, config.localization.every_m) = (Ask::Both, EVERY_M);
    }
}

/// Who localizes in a map reads what the sensors hear and see.
pub(crate) fn wire_localizer(config: &mut Config) {
    let is_of_map = config.localizer.source == LocatedBy::Map;
    let localizers = config.services.values_mut().filter(|service| service.exec == Exec::Builtin(Builtin::Localizer));
    for service in localizers.filter(|_| is_of_map) {
        service.wiring = echogrid_localizer::MAP_DECLARATION.into();
    }
}

fn section<T: Serialize + DeserializeOwned>(name: &str, defaults: &T, settings: &[Setting]) -> Result<T, Problem> {
    let failed = |message: String| Problem {
        origin: None,
        key: name.to_owned(),
        value: None,
        message: message.replace('\n', " "),
    };
    let mut table = Table::try_from(defaults).map_err(|error| failed(error.to_string()))?;
    for setting in settings {
        if let [section, key] = setting.path.as_slice()
            && section == name
        {
            table.insert(key.clone(), setting.value.clone());
        }
    }
    Value::Table(table).try_into().map_err(|error: toml::de::Error| failed(error.message().to_owned()))
}

/// `[topics]`: those that were declared.
pub(crate) fn topics(settings: &[Setting], origins: &Origins) -> Result<BTreeMap<String, DeclaredTopic>, Vec<Problem>> {
    let mut tables: BTreeMap<&str, (Table, &Origin)> = BTreeMap::new();
    for setting in settings {
        let [topics, name, key @ ..] = setting.path.as_slice() else { continue };
        if topics == TOPIC.name {
            let (table, _) = tables.entry(name).or_insert_with(|| (Table::new(), &setting.origin));
            table.extend(key.first().map(|key| (key.clone(), setting.value.clone())));
        }
    }
    let (mut topics, mut problems) = (BTreeMap::new(), Vec::new());
    for (name, (table, named_at)) in tables {
        let path = |key: &str| dotted(&[TOPIC.name, name, key]);
        let mut add = |key: &str, value: Option<String>, message: String| {
            let key = if key.is_empty() { dotted(&[TOPIC.name, name]) } else { path(key) };
            let origin = Some(origins.get(&key).unwrap_or(named_at).clone());
            problems.push(Problem { origin, key, value, message });
        };
        if Topic::ALL.iter().any(|known| known.name() == name) {
            add("", None, "this is a topic of echogrid's own; a topic of yours needs another name".to_owned());
        }
        for key in ["type", "bytes"].into_iter().filter(|key| !table.contains_key(*key)) {
            add(key, None, format!("missing; expected {}", TOPIC.key(key).map_or("", |key| key.expected)));
        }
        if let Some(text) = table.get("type").and_then(Value::as_str).filter(|text| !DeclaredTopic::is_type_name(text))
        {
            let expected = TOPIC.key("type").map_or("", |key| key.expected);
            add("type", Some(format!("{text:?}")), format!("expected {expected}"));
        }
        match Value::Table(table).try_into::<DeclaredTopic>() {
            Ok(topic) => drop(topics.insert(name.to_owned(), topic)),
            Err(error) => add("", None, error.message().replace('\n', " ")),
        }
    }
    let is_mentioned = |setting: &Setting| {
        matches!(setting.path.as_slice(), [services, _, _] if services == "services")
            && setting.value.as_array().is_some_and(|all| all.iter().any(|one| one.as_str() == Some(DRIVE_COMMAND)))
    };
    match topics.get(DRIVE_COMMAND) {
        None if settings.iter().any(is_mentioned) => drop(topics.insert(DRIVE_COMMAND.to_owned(), Velocity::topic())),
        Some(declared) if *declared != Velocity::topic() => {
            let key = dotted(&[TOPIC.name, DRIVE_COMMAND]);
            let message = format!(
                "sensors that drive read this topic as {}; leave it out, or call yours otherwise",
                Velocity::topic().type_name
            );
            problems.push(Problem { origin: origins.get(&key).cloned(), key, value: None, message });
        }
        _ => {}
    }
    if problems.is_empty() { Ok(topics) } else { Err(problems) }
}

/// A service as far as it was written.
#[derive(Default)]
struct Draft {
    kind: Option<ServiceKind>,
    exec: Option<String>,
    args: Vec<String>,
    env: BTreeMap<String, String>,
    speaks: Option<Speech>,
    replays: bool,
    wiring: Written,
    care: Table,
    origin: Option<Origin>,
}

/// `[services]`: what was written, and the default service for every role that nobody was given.
pub(crate) fn services(
    settings: &[Setting],
    origins: &Origins,
    with_localizer: bool,
) -> Result<BTreeMap<String, Service>, Vec<Problem>> {
    let mut drafts: BTreeMap<&str, Draft> = BTreeMap::new();
    for setting in settings {
        let [services, name, key @ ..] = setting.path.as_slice() else { continue };
        if services != "services" {
            continue;
        }
        let draft = drafts.entry(name).or_default();
        draft.origin.get_or_insert_with(|| setting.origin.clone());
        let text = || setting.value.as_str().map(str::to_owned);
        match key {
            [key] if key == "kind" => draft.kind = text().and_then(|word| ServiceKind::from_word(&word)),
            [key] if key == "exec" => draft.exec = text(),
            [key] if key == "args" => draft.args = texts(&setting.value),
            [key] if key == "speaks" => draft.speaks = setting.value.clone().try_into().ok(),
            [key] if key == "replays" => draft.replays = setting.value.as_bool().unwrap_or_default(),
            [key] if key == "reads" => draft.wiring.reads = Some(texts(&setting.value)),
            [key] if key == "looks_on" => draft.wiring.looks_on = Some(texts(&setting.value)),
            [key] if key == "writes" => draft.wiring.writes = Some(texts(&setting.value)),
            [key] if key == "source" => draft.wiring.source = setting.value.as_bool(),
            [key, variable] if key == "env" => {
                draft.env.insert(variable.clone(), text().unwrap_or_default());
            }
            [key] => drop(draft.care.insert(key.clone(), setting.value.clone())),
            _ => {}
        }
    }
    let mut problems = Vec::new();
    let mut services = BTreeMap::new();
    for (name, draft) in drafts {
        match resolve(name, draft, origins) {
            Ok(service) => drop(services.insert(name.to_owned(), service)),
            Err(problem) => problems.push(problem),
        }
    }
    if !problems.is_empty() {
        return Err(problems);
    }
    let played: BTreeSet<ServiceKind> = services.values().map(|service| service.kind).collect();
    for (name, service) in default_services(with_localizer) {
        // A name that is taken for another role leaves this one empty, which is told later.
        if !played.contains(&service.kind) {
            services.entry(name).or_insert(service);
        }
    }
    Ok(services)
}

fn resolve(name: &str, draft: Draft, origins: &Origins) -> Result<Service, Problem> {
    // An executable need not have a role.
    let is_foreign = draft.exec.as_ref().is_some_and(|exec| !exec.starts_with(BUILTIN_PREFIX));
    let builtin = draft.exec.as_deref().and_then(|exec| exec.strip_prefix(BUILTIN_PREFIX)).and_then(Builtin::from_name);
    let other = || if is_foreign { Some(ServiceKind::Other) } else { builtin.map(Builtin::kind) };
    let named = draft.kind.or_else(|| ServiceKind::from_word(name)).or_else(other);
    let Some(kind) = named else {
        let message = "missing; expected one of sensor, odometry, localizer, mapper, publisher, other".to_owned();
        return Err(Problem { origin: draft.origin, key: format!("services.{name}.kind"), value: None, message });
    };
    let exec = match &draft.exec {
        None => Exec::Builtin(kind.default_builtin().ok_or_else(|| Problem {
            origin: draft.origin.clone(),
            key: format!("services.{name}.exec"),
            value: None,
            message: "missing; expected the executable of a service of no role".to_owned(),
        })?),
        Some(text) => Exec::try_from(text.clone()).map_err(|why| {
            let key = format!("services.{name}.exec");
            let hint = suggest::builtin(text).map_or_else(String::new, |hint| format!("; {hint}"));
            Problem {
                origin: origins.get(&key).cloned(),
                key,
                value: Some(format!("{text:?}")),
                message: format!("{why}{hint}"),
            }
        })?,
    };
    if let Some((key, message)) = miswired(&draft, &exec) {
        let key = format!("services.{name}.{key}");
        return Err(Problem { origin: origins.get(&key).cloned(), key, value: None, message });
    }
    if let Some((key, message)) = misspoken(&draft, kind, &exec) {
        let key = format!("services.{name}.{key}");
        return Err(Problem { origin: origins.get(&key).cloned(), key, value: None, message });
    }
    let wiring = draft.wiring.resolve(kind, &exec, draft.speaks);
    let mut care = draft.care;
    if builtin.is_some_and(Builtin::is_beside) {
        care.entry("required").or_insert(Value::Boolean(false));
    }
    let care = Value::Table(care).try_into().map_err(|error: toml::de::Error| Problem {
        origin: draft.origin,
        key: format!("services.{name}"),
        value: None,
        message: error.message().replace('\n', " "),
    })?;
    let Draft { speaks, replays, .. } = draft;
    Ok(Service { kind, exec, args: draft.args, env: draft.env, speaks, replays, wiring, care })
}

/// What is wrong with what a built-in, or a program that prints lines, is said to read and write, and the key that says it. A sensor
/// may write a part of what it could: others write the rest.
fn miswired(draft: &Draft, exec: &Exec) -> Option<(&'static str, String)> {
    let declaration = declared(exec, draft.speaks)?;
    let who = if draft.speaks.is_some() { "a program that prints lines".to_owned() } else { exec.to_string() };
    let could: Vec<&str> = declaration.writes.iter().map(|topic| topic.name()).collect();
    let is_sensor = could.contains(&Topic::RangeScan.name());
    let is_driven = declaration.orders.contains(&"drive") && draft.wiring.looks_on.is_none();
    let key = match &draft.wiring.reads {
        Some(reads) if is_driven && reads.iter().all(|topic| topic == DRIVE_COMMAND) => {
            draft.wiring.writes.is_some().then_some("writes").or(draft.wiring.source.is_some().then_some("source"))
        }
        _ => draft.wiring.key(),
    };
    match (key?, &draft.wiring.writes) {
        ("writes", Some(writes)) if is_sensor && !writes.is_empty() && draft.wiring.source.is_none() => {
            let stray = writes.iter().find(|topic| !could.contains(&topic.as_str()))?;
            Some(("writes", format!("{who} does not write {stray}; expected some of {}", could.join(", "))))
        }
        ("reads", _) if is_driven => Some(("reads", format!("{who} reads {DRIVE_COMMAND}, or nothing"))),
        (key, _) => Some((key, format!("{who} says itself what it reads and writes; this is for executables"))),
    }
}

/// What is wrong with what is said of a program that speaks, and the key that says it.
fn misspoken(draft: &Draft, kind: ServiceKind, exec: &Exec) -> Option<(&'static str, String)> {
    match (draft.speaks, exec) {
        (None, _) => draft
            .replays
            .then(|| ("replays", "this is of programs that print lines; expected `speaks`, too".to_owned())),
        (Some(_), Exec::Builtin(_)) => Some(("speaks", format!("{exec} speaks for itself; this is for executables"))),
        (Some(_), _) if kind != ServiceKind::Sensor => {
            Some(("speaks", format!("a program that prints lines is a sensor, the service is of kind {kind}")))
        }
        (Some(_), _) => None,
    }
}

fn texts(value: &Value) -> Vec<String> {
    value.as_array().into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
}
