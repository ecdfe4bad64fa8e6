//! What is said where a robot was to be localized in a map, and was not.

use std::path::Path;

use anyhow::{Result, ensure};
use echogrid_core::Verdict;
use echogrid_localizer::config::{LocalizerConfig, Source};
use echogrid_topics::MapInfo;

use crate::config::{Config, MAP_FILE, ServiceKind};
use crate::supervisor::Outcome;

/// Why nothing is known of where the drive begins.
pub(super) fn nobody_could_tell(localizer: &LocalizerConfig) -> String {
    let LocalizerConfig { source, map, map_window_m, .. } = localizer;
    match source {
        Source::Map => format!(
            "the robot was not recognised in {}: is it of this place, and was the robot driven for more than {} m? Where in the map \
             the drive begins is not known",
            map.display(),
            1.5 * map_window_m
        ),
        _ => "nobody could tell where in the map the drive begins".to_owned(),
    }
}

/// What is worth knowing of a map that was made without one recognition, or of an operator who said nothing.
pub(super) fn remark(localizer: &LocalizerConfig, map: Option<&MapInfo>) -> Option<String> {
    if localizer.source == Source::Operator
        && let Some(map) = map.filter(|map| map.fixes == 0)
    {
        let (held, all) = (map.verdicts.get(Verdict::Held), map.verdicts.total());
        let share = 100 * held / all.max(1);
        return Some(format!(
            "--fix operator: nobody said where the robot was (`echogrid fix X Y THETA`), so {held} of {all} readings ({share} %) were held and are not in \
             the map; without --fix they are mapped where the odometry says"
        ));
    }
    let never = localizer.source == Source::Map && map.is_some_and(|map| map.fixes == 0);
    never.then(|| {
        let file = localizer.map.display();
        format!("{file}: the robot was not recognised in it once, and is mapped where its odometry says; is it of this place?")
    })
}

/// What localizers say of what they could not tell, for the summary.
pub(super) fn notes(config: &Config, outcome: &Outcome) -> Vec<String> {
    let localizers = config.services.iter().filter(|(_, service)| service.kind == ServiceKind::Localizer);
    let notes = localizers.filter_map(|(name, _)| Some((name, outcome.health.get(name)?.note.as_str())));
    notes.filter(|(_, note)| !note.is_empty()).map(|(name, note)| format!("{name}: {note}")).collect()
}

/// Refuses a map to localize in that this run would replace.
///
/// # Errors
/// The map of the run goes to the same file.
pub(super) fn check(localizer: &LocalizerConfig, out: &Path) -> Result<()> {
    let replaced = out.join(MAP_FILE);
    let same = || replaced.canonicalize().ok() == localizer.map.canonicalize().ok() && replaced.exists();
    ensure!(
        localizer.source != Source::Map || !same(),
        "localizer.map: {} is what this run would save its own map as; name another folder with --out",
        localizer.map.display()
    );
    Ok(())
}
