//! The kinds of runs that a storm rages over.

use crate::support::{Drive, data, path};

/// A kind of run, and how long a drive it is made for.
pub(super) struct Kind {
    pub(super) name: &'static str,
    source: Source,
    more: &'static [&'static str],
    /// Times real time, to draw from: so fast that it is soon over, and slow enough to be hit.
    pub(super) rates: &'static [&'static str],
}

enum Source {
    /// The recording, where there is one, or else the project's own drive.
    Recording(&'static str),
    /// The project's own drive, whose true poses are known.
    Drive,
    /// A simulated robot of this name, for so many seconds.
    Simulator(&'static str, u32),
}

const TRUTH: [&str; 4] = ["--fix", "truth", "--fix-every", "3m"];

pub(super) const KINDS: [Kind; 11] = [
    Kind::new("sonar", Source::Recording("sonar/columbia-sonar.log.gz"), &[], &["300", "600", "max"]),
    Kind::new("laser", Source::Simulator("laser", 20), &[], &["10", "20", "max"]),
    Kind::new("simulator-fixes", Source::Simulator("pioneer3at", 40), &TRUTH, &["20", "40", "max"]),
    Kind::new("remap", Source::Drive, &[TRUTH[0], TRUTH[1], TRUTH[2], TRUTH[3], "--set", "mapper.remap=true"], FAST),
    Kind::new(
        "layers",
        Source::Drive,
        &["--set", "mapper.doubt=true", "--set", "mapper.keep_readings=true", "--set", "mapper.sonar_maps=true"],
        FAST,
    ),
    Kind::new("oriented", Source::Drive, &["--set", "mapper.fusion=oriented"], FAST),
    Kind::new("saves", Source::Drive, &["--set", "publisher.save_every_s=5", "--fix", "truth"], FAST),
    Kind::new("slam", Source::Simulator("laser", 16), &["--slam"], &["10", "20", "max"]),
    Kind::new(
        "slam-settling",
        Source::Simulator("laser", 150),
        &["--slam", "--set", "slam.settle_after_m=40"],
        &["60", "max"],
    ),
    Kind::new(
        "slam-sonars",
        Source::Simulator("pioneer3at", 200),
        &["--slam", "--set", "odometry.systematic=correct"],
        &["40", "80", "max"],
    ),
    Kind::new("slam-recording", Source::Recording("carmen/freiburg-101-raw.log.gz"), &["--slam"], &["300", "max"]),
];

const FAST: &[&str] = &["20", "60", "max"];

impl Kind {
    const fn new(
        name: &'static str,
        source: Source,
        more: &'static [&'static str],
        rates: &'static [&'static str],
    ) -> Self {
        Self { name, source, more, rates }
    }

    /// The arguments of such a run, but for where and how fast; none where there is no recording that it needs.
    pub(super) fn arguments(&self, drive: &Drive) -> Option<Vec<String>> {
        let mut arguments = match &self.source {
            Source::Recording(name) => {
                let recorded = data(name);
                if recorded.is_none() && self.more.contains(&"--slam") {
                    return None;
                }
                vec!["map".to_owned(), path(&recorded.unwrap_or_else(|| drive.log()))]
            }
            Source::Drive => vec!["map".to_owned(), path(&drive.log())],
            Source::Simulator(robot, seconds) => {
                let file = drive.out(&format!("{}.toml", self.name));
                let sensor = "[services.sensor]\nkind = \"sensor\"\nexec = \"builtin:simulator\"";
                let text =
                    format!("{sensor}\n[run]\nrobot = {robot:?}\n[simulator]\nduration_s = {seconds}\nseed = 3\n");
                std::fs::write(&file, text).unwrap();
                vec!["up".to_owned(), path(&file)]
            }
        };
        arguments.extend(self.more.iter().map(|word| (*word).to_owned()));
        Some(arguments)
    }
}
