//! The graphs that nobody needs to write down: that of `echogrid map`, and the demo.

use std::collections::BTreeMap;

use super::request::LoadRequest;
use super::service::{Care, Exec, Service, ServiceKind};
use super::wiring::Written;

/// What sets the demo apart from `echogrid up launch/graphs/map.toml --sensor simulator --fix truth`: the systematic
/// error of the robot, which is known, taken out (the paper's Fig. 16).
const DEMO: [&str; 2] = ["simulator.world=office", "odometry.systematic=correct"];
/// The graph of `echogrid map`: one service of each kind, named after it; a localizer only where one is wanted.
#[must_use]
pub fn default_services(with_localizer: bool) -> BTreeMap<String, Service> {
    let service = |kind: ServiceKind| {
        let exec = Exec::Builtin(kind.default_builtin()?);
        let wiring = Written::default().resolve(kind, &exec, None);
        let (args, env, care) = (Vec::new(), BTreeMap::new(), Care::default());
        Some((kind.word().to_owned(), Service { kind, exec, args, env, speaks: None, replays: false, wiring, care }))
    };
    let wanted = ServiceKind::ALL.into_iter().filter(|kind| with_localizer || *kind != ServiceKind::Localizer);
    wanted.filter_map(service).collect()
}

impl LoadRequest {
    /// The demo: a simulated robot in the office; what the user set has the last word.
    #[must_use]
    pub fn for_demo(self) -> Self {
        // SLAM is finest with a lidar, and asks nobody where the robot is.
        let (robot, fix) = if self.slam { ("laser", None) } else { ("pioneer3at", Some("truth".to_owned())) };
        Self {
            sensor: Some("simulator".to_owned()),
            robot: self.robot.or_else(|| Some(robot.to_owned())),
            fix: self.fix.or(fix),
            sets: DEMO.map(str::to_owned).into_iter().chain(self.sets).collect(),
            ..self
        }
    }
}
