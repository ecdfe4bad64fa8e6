//! What each service reads and writes: as it declares, as the graph file says, or as its role does.

use echogrid_service::Declaration;
use echogrid_supervision::Wiring;

use super::service::{Builtin, Exec, Service, ServiceKind, Speech};

/// What a graph file says of it.
#[derive(Debug, Clone, Default)]
pub(super) struct Written {
    pub(super) reads: Option<Vec<String>>,
    pub(super) looks_on: Option<Vec<String>>,
    pub(super) writes: Option<Vec<String>>,
    pub(super) source: Option<bool>,
}

impl Written {
    /// The first key that was said, if any was.
    pub(super) fn key(&self) -> Option<&'static str> {
        let said = [self.reads.is_some(), self.looks_on.is_some(), self.writes.is_some(), self.source.is_some()];
        said.into_iter().zip(Wiring::KEYS).find(|(is_said, _)| *is_said).map(|(_, key)| key)
    }

    /// With what is not said as the role has it. Who says of an input whether it is waited for says it of all.
    pub(super) fn resolve(self, kind: ServiceKind, exec: &Exec, speaks: Option<Speech>) -> Wiring {
        let role = declared(exec, speaks).map_or_else(|| kind.wiring(), Wiring::from);
        let says_inputs = self.reads.is_some() || self.looks_on.is_some();
        let input = |said: Option<Vec<String>>, role| if says_inputs { said.unwrap_or_default() } else { role };
        let is_sensor = kind == ServiceKind::Sensor;
        let reads = input(self.reads, role.reads);
        Wiring {
            looks_on: input(self.looks_on, role.looks_on),
            writes: self.writes.unwrap_or(role.writes),
            source: self.source.unwrap_or(is_sensor),
            reads,
        }
    }
}

impl Service {
    /// What it says itself that it reads and writes; none: its graph file does.
    pub(super) fn declared(&self) -> Option<Wiring> {
        declared(&self.exec, self.speaks).map(Wiring::from)
    }
}

/// What a service of this executable says itself that it reads and writes.
pub(super) fn declared(exec: &Exec, speaks: Option<Speech>) -> Option<Declaration> {
    match (exec, speaks) {
        (Exec::Builtin(builtin), _) => Some(builtin.declaration()),
        (Exec::Path(_), Some(Speech::Carmen)) => Some(echogrid_lines::DECLARATION),
        (Exec::Path(_), None) => None,
    }
}

impl Builtin {
    /// What it declares of itself.
    #[must_use]
    pub fn declaration(self) -> Declaration {
        match self {
            Self::Replay => echogrid_replay::DECLARATION,
            Self::Simulator => echogrid_simulator::DECLARATION,
            Self::Pioneer => echogrid_pioneer::DECLARATION,
            Self::Lidar => echogrid_lidar::DECLARATION,
            Self::Odometry => echogrid_odometry::DECLARATION,
            Self::Slam => echogrid_slam_service::DECLARATION,
            Self::Localizer => echogrid_localizer::DECLARATION,
            Self::Mapper => echogrid_mapper::DECLARATION,
            Self::Publisher => echogrid_publisher::DECLARATION,
            Self::Recorder => echogrid_recorder::DECLARATION,
            Self::Live => echogrid_live::DECLARATION,
        }
    }
}

impl ServiceKind {
    /// What services of this role read and write unless they say otherwise; of no role: nothing.
    fn wiring(self) -> Wiring {
        match self {
            // All that a sensor can say; some say less.
            Self::Sensor => echogrid_simulator::DECLARATION.into(),
            Self::Other => Wiring::default(),
            _ => self.default_builtin().map(Builtin::declaration).map(Wiring::from).unwrap_or_default(),
        }
    }
}
