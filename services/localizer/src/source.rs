//! Whoever knows where the robot was.

use anyhow::Result;
use echogrid_core::{Fix, Pose2};
use echogrid_topics::LocalizationRequest;

use crate::answer::{Answer, NO_TRUTH, draws};
use crate::config::{self, LocalizerConfig};
use crate::drive::Drive;
use crate::landmarks::Landmarks;
use crate::reference::Reference;
use crate::saved_map::SavedMap;
use crate::truth::{Known, Truth};

/// Whoever knows where the robot was.
#[derive(Debug)]
pub(crate) enum Source {
    /// Nobody, or the user, who is not asked here.
    Nobody,
    /// The sensor.
    Truth(Told),
    /// A file of poses.
    Reference(Reference),
    /// Surveyed landmarks.
    Landmarks(Box<Landmarks>),
    /// A map that was saved before.
    Map(Box<SavedMap>),
}

impl Source {
    /// The source of a configuration, its files read.
    pub(crate) fn new(config: &LocalizerConfig) -> Result<Self> {
        Ok(match config.source {
            config::Source::None | config::Source::Operator => Self::Nobody,
            config::Source::Truth => Self::Truth(Told::new(config)),
            config::Source::Reference => Self::Reference(Reference::read(config)?),
            config::Source::Landmarks => Self::Landmarks(Box::new(Landmarks::read(config)?)),
            config::Source::Map => Self::Map(Box::new(SavedMap::read(config)?)),
        })
    }

    /// The key that names its files.
    pub(crate) fn key(&self) -> &'static str {
        match self {
            Self::Nobody | Self::Truth(_) => "source",
            Self::Reference(_) => "reference",
            Self::Landmarks(_) => "landmarks",
            Self::Map(_) => "map",
        }
    }

    /// Where the robot was at `stamp_ns`. Depends on the request and the stamps alone.
    pub(crate) fn answer(
        &mut self,
        stamp_ns: u64,
        request: &LocalizationRequest,
        truth: &Truth,
        drive: &Drive,
    ) -> Answer {
        match self {
            Self::Nobody => Answer::Unknown("localizer.source names nobody who would know".to_owned()),
            Self::Truth(told) => match truth.at(stamp_ns) {
                Known::NotYet => Answer::NotYet,
                Known::Never => Answer::Unknown(NO_TRUTH.to_owned()),
                Known::Pose(pose) => Answer::Fix(told.about(pose, request.id)),
            },
            Self::Reference(reference) => reference.answer(stamp_ns),
            Self::Landmarks(landmarks) => landmarks.answer(stamp_ns, request, truth),
            Self::Map(map) => map.answer(stamp_ns, request, drive),
        }
    }
}

/// How the truth is told.
#[derive(Debug)]
pub(crate) struct Told {
    position_sigma_m: f64,
    heading_sigma_rad: f64,
    seed: u64,
}

impl Told {
    fn new(config: &LocalizerConfig) -> Self {
        let LocalizerConfig { position_sigma_m, heading_sigma_rad, seed, .. } = *config;
        Self { position_sigma_m, heading_sigma_rad, seed }
    }

    /// The pose with the error that the source is configured to have; the same request draws the same error.
    fn about(&self, exact: Pose2, request: u64) -> Fix {
        let (x, y) = draws(self.seed, request, 0);
        let (theta, _) = draws(self.seed, request, 1);
        let pose = Pose2::new(
            exact.x + self.position_sigma_m * x,
            exact.y + self.position_sigma_m * y,
            exact.theta + self.heading_sigma_rad * theta,
        );
        Fix::about(pose, self.position_sigma_m, self.heading_sigma_rad)
    }
}
