//! The drive, and the ways in which it is mapped.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use echogrid_config::{Config, LoadRequest};

/// The sonars that the paper keeps: those at the sides, and those nearest to the robot's axis.
pub(super) const SIDE_SONARS: [u16; 8] = [0, 3, 4, 7, 8, 11, 12, 15];

/// A reading that is trusted less than this asks for an absolute localization: metres of wall have faded by then.
const DEGRADED_TRUST: f64 = 0.02;

/// MobileSim's floor of Columbia University, in which the paper's robot drove (Fig. 8).
const COLUMBIA: &str = "columbia.map";
/// Along three of its corridors.
const COLUMBIA_DRIVE: [&str; 2] =
    ["simulator.start=[1.75, 17.0, -90.0]", "simulator.route=[[1.75, -9.2], [12.8, -9.2], [12.8, 18.4]]"];

/// The drive that is mapped: the same for all.
pub(super) struct Drive {
    pub(super) world: PathBuf,
    pub(super) seed: u64,
}

impl Drive {
    pub(super) fn of(world: Option<&Path>, seed: u64) -> Self {
        let columbia = || {
            let data = std::env::var_os("ECHOGRID_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
            Some(data.join("worlds").join(COLUMBIA)).filter(|file| file.is_file())
        };
        let world = world.map(Path::to_path_buf).or_else(columbia).unwrap_or_else(|| "office".into());
        Self { world, seed }
    }

    fn sets(&self) -> Vec<String> {
        let way = if self.world.file_name().is_some_and(|name| name == COLUMBIA) { &COLUMBIA_DRIVE[..] } else { &[] };
        let drawn = [format!("simulator.world={}", self.world.display()), format!("simulator.seed={}", self.seed)];
        drawn.into_iter().chain(way.iter().map(|set| (*set).to_owned())).collect()
    }
}

/// A way of mapping.
pub(super) struct Variant {
    pub(super) name: &'static str,
    /// In words.
    pub(super) about: String,
    pub(super) all_sonars: bool,
    sets: Vec<String>,
}

impl Variant {
    fn new(name: &'static str, about: impl Into<String>, sets: &[&str]) -> Self {
        Self { name, about: about.into(), all_sonars: false, sets: sets.iter().map(|set| (*set).to_owned()).collect() }
    }

    fn with_all_sonars(self, name: &'static str, about: impl Into<String>) -> Self {
        Self { name, about: about.into(), all_sonars: true, ..self }
    }

    /// The robot believes its odometry.
    pub(super) fn ignored() -> Self {
        Self::new("ignored", "odometry error not modelled, no fix", &NO_ERROR)
    }

    /// Eqs 22 and 23, and an absolute localization where the map is degraded.
    pub(super) fn localized() -> Self {
        let trust = format!("localization.degraded_trust={DEGRADED_TRUST}");
        let sets = ["odometry.systematic=carry", "localizer.source=truth", "localization.ask=degraded", &trust];
        Self::new("localized", "eqs 22 and 23, localized absolutely when degraded (Figs 9, 13-15)", &sets)
    }

    /// The configuration of the drive mapped so.
    pub(super) fn config(&self, drive: &Drive, out: &Path) -> Result<Config> {
        let sonars = if self.all_sonars { "\"all\"".to_owned() } else { format!("{SIDE_SONARS:?}") };
        // The paper refuses no reading for being doubtful, gave up the bubble circles, and clears nothing by driving over it or in hindsight.
        let filters = "mapper.filters=[\"range\", \"selection\"]".to_owned();
        let rule = "mapper.fusion=paper".to_owned();
        let as_it_drives = ["mapper.footprint_m=0", "mapper.remap=false"].map(str::to_owned);
        let common = ["mapper.min_trust=0".to_owned(), rule, filters, format!("mapper.sonars={sonars}")];
        let files = ["publisher.formats=[\"png\", \"echogrid\"]".to_owned()];
        let request = LoadRequest {
            sensor: Some("simulator".to_owned()),
            robot: Some("pioneer3at".to_owned()),
            out: Some(out.to_string_lossy().into_owned()),
            sets: drive
                .sets()
                .into_iter()
                .chain(common)
                .chain(as_it_drives)
                .chain(files)
                .chain(self.sets.iter().cloned())
                .collect(),
            ..LoadRequest::default()
        };
        Ok(Config::load(&request)
            .with_context(|| format!("the experiment in {}", drive.world.display()))?
            .into_config())
    }
}

/// Nothing is said to be wrong with the odometry.
const NO_ERROR: [&str; 5] =
    ["odometry.systematic=off", "odometry.k_ll=0", "odometry.k_lt=0", "odometry.k_tt=0", "odometry.k_tl=0"];

/// All of them, where the map that asks for fixes got so many on a way of `way_m`.
pub(super) fn all(fixes: usize, way_m: f64) -> Vec<Variant> {
    let every = format!("localization.every_m={:.3}", (way_m / (fixes as f64 + 0.5)).clamp(0.1, 1e6));
    let corrected = || {
        let about = "systematic error corrected (Fig. 16), as many fixes as localized";
        let asked = ["localizer.source=truth", "localization.ask=schedule", "localization.hold=never", &every];
        let sets = [&["odometry.systematic=correct"][..], &asked].concat();
        Variant::new("corrected", about, &sets)
    };
    let exact = || {
        let scheduled = ["localizer.source=truth", "localization.ask=schedule", "localization.every_m=0.1"];
        Variant::new("exact", "exact poses: a fix every 0.1 m", &[&NO_ERROR[..], &scheduled].concat())
    };
    vec![
        Variant::ignored(),
        Variant::new("carried", "eqs 22 and 23, no fix: the map fades (Figs 11, 12)", &["odometry.systematic=carry"]),
        Variant::localized(),
        Variant::new("corrected-alone", "systematic error corrected, no fix", &["odometry.systematic=correct"]),
        corrected(),
        corrected().with_all_sonars("all-sonars", "as corrected, with all 16 sonars (Fig. 10)"),
        exact(),
        exact().with_all_sonars("exact-all-sonars", "exact poses, all 16 sonars: only the sonars differ (Fig. 10)"),
    ]
}
