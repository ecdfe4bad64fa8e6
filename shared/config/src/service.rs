//! `[services.<name>]`: the processes of the graph.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::run::NotA;
use super::{Restart, Wiring};

/// One process of the graph.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Service {
    /// The role of the service.
    pub kind: ServiceKind,
    /// What is started.
    pub exec: Exec,
    /// Arguments after those of the launcher.
    #[serde(default)]
    pub args: Vec<String>,
    /// Added to the environment.
    #[serde(default)]
    pub env: BTreeMap<String, String>,
    /// How an executable that knows nothing of topics is understood.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speaks: Option<Speech>,
    /// Whether a program that speaks says the same whenever it is started.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub replays: bool,
    /// What it reads and writes.
    #[serde(flatten)]
    pub wiring: Wiring,
    /// What happens when it dies, and what it may use.
    #[serde(flatten)]
    pub care: Care,
}

impl AsRef<Wiring> for Service {
    fn as_ref(&self) -> &Wiring {
        &self.wiring
    }
}

/// What a program prints on its standard output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Speech {
    /// Lines as in a CARMEN log.
    Carmen,
}

/// What happens when a service dies, and what it may use.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Care {
    /// Whether it is started again.
    pub restart: Restart,
    /// Whether the graph ends when it is given up; else the others go on without it.
    pub required: bool,
    /// The niceness of the service, -20 to 19: below 0 takes a privilege.
    pub nice: i32,
    /// The most address space that it may have, MiB; 0: no limit.
    pub memory_max_mib: u64,
    /// The most files that it may have open; 0: the launcher's limit.
    pub open_files_max: u64,
}

impl Default for Care {
    fn default() -> Self {
        Self { restart: Restart::OnFailure, required: true, nice: 0, memory_max_mib: 0, open_files_max: 0 }
    }
}

/// The role of a service in the graph, upstream to downstream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServiceKind {
    /// Says where the robot drove and what it heard.
    Sensor,
    /// Says where the robot is, and how far that can be trusted.
    Odometry,
    /// Answers when the odometry asks where the robot is. After the odometry, as it is needed until that has ended.
    Localizer,
    /// Makes the grid.
    Mapper,
    /// Gives the grid to people and programs.
    Publisher,
    /// None of these: it does what the graph file says, or only looks on.
    Other,
}

impl ServiceKind {
    /// All that a graph is made of, upstream to downstream.
    pub const ALL: [Self; 5] = [Self::Sensor, Self::Odometry, Self::Localizer, Self::Mapper, Self::Publisher];

    /// The role as it is written; also the name of the default service of this kind.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Sensor => "sensor",
            Self::Odometry => "odometry",
            Self::Localizer => "localizer",
            Self::Mapper => "mapper",
            Self::Publisher => "publisher",
            Self::Other => "other",
        }
    }

    /// The service that plays this role unless another is named.
    #[must_use]
    pub fn default_builtin(self) -> Option<Builtin> {
        Some(match self {
            Self::Sensor => Builtin::Replay,
            Self::Odometry => Builtin::Odometry,
            Self::Localizer => Builtin::Localizer,
            Self::Mapper => Builtin::Mapper,
            Self::Publisher => Builtin::Publisher,
            Self::Other => return None,
        })
    }

    /// The kind that is written so.
    pub(crate) fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().chain([Self::Other]).find(|kind| kind.word() == word)
    }
}

impl fmt::Display for ServiceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// What is started for a service.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "RawExec")]
pub enum Exec {
    /// A service that echogrid carries.
    Builtin(Builtin),
    /// An executable.
    Path(PathBuf),
}

/// What [`Exec`] is written as: a path that is not Unicode can't be.
#[derive(Serialize)]
#[serde(transparent)]
struct RawExec(PathBuf);

/// What a built-in is written with.
pub(crate) const BUILTIN_PREFIX: &str = "builtin:";

/// A service that echogrid carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Builtin {
    /// Plays a log.
    Replay,
    /// Drives a simulated robot.
    Simulator,
    /// Drives a Pioneer, or listens to one that is driven.
    Pioneer,
    /// The scans of a lidar.
    Lidar,
    /// Dead reckoning and its error.
    Odometry,
    /// Poses that are corrected where a lidar sees the same again.
    Slam,
    /// Absolute localizations.
    Localizer,
    /// The grid.
    Mapper,
    /// Files for people and programs.
    Publisher,
    /// The run in a file.
    Recorder,
    /// A page that shows the graph in a browser.
    Live,
}

impl Builtin {
    /// Whether what it gives is what is now: nobody can ask it to wait, or to give it again.
    #[must_use]
    pub fn is_live(self) -> bool {
        matches!(self, Self::Pioneer | Self::Lidar)
    }

    /// Whether the graph loses nothing but it when it is gone: then it goes on without, unless its file says otherwise.
    #[must_use]
    pub fn is_beside(self) -> bool {
        matches!(self, Self::Recorder | Self::Live)
    }

    /// Every built-in service.
    pub const ALL: [Self; 11] = [
        Self::Replay,
        Self::Simulator,
        Self::Pioneer,
        Self::Lidar,
        Self::Odometry,
        Self::Slam,
        Self::Localizer,
        Self::Mapper,
        Self::Publisher,
        Self::Recorder,
        Self::Live,
    ];

    /// The name: what follows `builtin:`, and `echogrid service`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Replay => "replay",
            Self::Simulator => "simulator",
            Self::Pioneer => "pioneer",
            Self::Lidar => "lidar",
            Self::Odometry => "odometry",
            Self::Slam => "slam",
            Self::Localizer => "localizer",
            Self::Mapper => "mapper",
            Self::Publisher => "publisher",
            Self::Recorder => "recorder",
            Self::Live => "live",
        }
    }

    /// The role that it plays.
    #[must_use]
    pub fn kind(self) -> ServiceKind {
        match self {
            Self::Replay | Self::Simulator | Self::Pioneer | Self::Lidar => ServiceKind::Sensor,
            Self::Odometry | Self::Slam => ServiceKind::Odometry,
            Self::Localizer => ServiceKind::Localizer,
            Self::Mapper => ServiceKind::Mapper,
            Self::Publisher => ServiceKind::Publisher,
            Self::Recorder | Self::Live => ServiceKind::Other,
        }
    }

    /// The built-in of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|builtin| builtin.name() == name)
    }
}

impl TryFrom<String> for Exec {
    type Error = NotA;

    fn try_from(text: String) -> Result<Self, NotA> {
        match text.strip_prefix(BUILTIN_PREFIX) {
            Some(name) => Builtin::from_name(name).map(Self::Builtin).ok_or(NotA(
                "builtin:replay, builtin:simulator, builtin:pioneer, builtin:lidar, builtin:odometry, builtin:slam, builtin:localizer, builtin:mapper, \
                 builtin:publisher, builtin:recorder or builtin:live",
            )),
            None if text.is_empty() => Err(NotA("a path or builtin:NAME")),
            None => Ok(Self::Path(text.into())),
        }
    }
}

impl From<Exec> for RawExec {
    fn from(exec: Exec) -> Self {
        match exec {
            Exec::Builtin(builtin) => Self(format!("{BUILTIN_PREFIX}{}", builtin.name()).into()),
            Exec::Path(path) => Self(path),
        }
    }
}

impl fmt::Display for Exec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Builtin(builtin) => write!(f, "{BUILTIN_PREFIX}{}", builtin.name()),
            Self::Path(path) => path.display().fmt(f),
        }
    }
}
