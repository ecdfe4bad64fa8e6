//! Whether the services make a graph.

use echogrid_core::localization::Ask;

use super::Config;
use super::assemble::Origins;
use super::problem::Problem;
use super::service::{BUILTIN_PREFIX, Exec, Service, ServiceKind};

/// Variables by which a service finds its graph.
const LAUNCHERS_OWN: [&str; 4] = ["ECHOGRID_DOMAIN", "ECHOGRID_SERVICE", "ECHOGRID_LIFELINE", "ECHOGRID_GONE"];

/// What keeps the services from being a graph.
pub(crate) fn problems(config: &Config, origins: &Origins) -> Vec<Problem> {
    let counts = ServiceKind::ALL.into_iter().filter_map(|kind| count(config, kind));
    let unasked = nobody_to_ask(config, origins);
    let each = config.services.iter().flat_map(|(name, service)| service_problems(name, service, origins));
    counts.chain(unasked).chain(each).collect()
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

/// One sensor, one odometry, one mapper; a localizer or none; publishers as many as wanted, but one.
fn count(config: &Config, kind: ServiceKind) -> Option<Problem> {
    let of_kind = config.services.iter().filter(|(_, service)| service.kind == kind);
    let names: Vec<&str> = of_kind.map(|(name, _)| name.as_str()).collect();
    let message = match (kind, names.len()) {
        (_, 1) | (ServiceKind::Publisher, 2..) | (ServiceKind::Localizer, 0) => return None,
        (_, 0) => format!("the graph has no {kind}"),
        (_, n) => format!("the graph has {n} services of kind {kind} ({}), expected one", names.join(", ")),
    };
    Some(Problem { origin: None, key: "services".to_owned(), value: None, message })
}

fn service_problems(name: &str, service: &Service, origins: &Origins) -> Vec<Problem> {
    let mut found = Vec::new();
    let mut add = |key: &str, value: String, message: String| {
        let key = format!("services.{name}.{key}");
        found.push(Problem { origin: origins.get(&key).cloned(), key, value: Some(value), message });
    };
    match &service.exec {
        Exec::Builtin(builtin) if builtin.kind() != service.kind => {
            let wanted = service.kind.default_builtin();
            let message = format!(
                "this is of kind {}, the service is of kind {}; expected {BUILTIN_PREFIX}{} or a path",
                builtin.kind(),
                service.kind,
                wanted.name()
            );
            add("exec", format!("\"{}\"", service.exec), message);
        }
        Exec::Path(path) if path.as_os_str().as_encoded_bytes().contains(&0) => {
            add("exec", format!("{path:?}"), "a path has no NUL".to_owned());
        }
        _ => {}
    }
    if !service.care.required && service.kind != ServiceKind::Publisher {
        add("required", "false".into(), format!("a graph can't go on without its {}", service.kind));
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

fn is_variable(name: &str) -> bool {
    !name.is_empty()
        && !name.starts_with(|c: char| c.is_ascii_digit())
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}
