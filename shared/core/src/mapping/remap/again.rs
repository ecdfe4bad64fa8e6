//! Readings that are fused again, those of one lidar and one pose together.

use std::sync::Arc;

use super::layer::Kept;
use super::verdict_of;
use crate::kept::KeptReading;
use crate::mapping::GridMapper;
use crate::mapping::locate::locate;
use crate::mapping::run::RUN_MAX;
use crate::odometry::Estimate;
use crate::verdict::Verdict;

impl GridMapper {
    /// How many of these readings, from the first on, can be fused together.
    pub(super) fn run_of_kept(&self, readings: &[Kept]) -> usize {
        let joins = |pair: &[Kept]| match pair {
            [a, b] => {
                let is_same = a.sequence == b.sequence && a.at == b.at;
                is_same && self.are_together(a.reading.transducer, b.reading.transducer)
            }
            _ => false,
        };
        1 + readings.windows(2).take(RUN_MAX - 1).take_while(|pair| joins(pair)).count()
    }

    /// Fuses them again; what came of it where that is something else.
    pub(super) fn fuse_run_again(
        &mut self,
        run: &[Kept],
        estimates: &[Estimate],
        verdicts: &mut Vec<(u16, Verdict, Verdict)>,
    ) {
        let channels = Arc::clone(&self.channels);
        let located = run.iter().map(|kept| locate(&channels, kept.sequence, &kept.reading, estimates.get(kept.at)));
        let soundings: Vec<_> = located.collect();
        let judged = soundings.iter().zip(run).map(|(sounding, kept)| Ok(((*sounding)?, kept.fused.ok())));
        let fused = self.fuse_run(&judged.collect::<Vec<_>>());
        for ((sounding, now), Kept { reading, fused, place, .. }) in soundings.into_iter().zip(fused).zip(run) {
            if let (Some(kept), Ok(sounding)) = (&mut self.recorders.kept, sounding)
                && let Some(reading) = KeptReading::of(&sounding, now, &self.fuser)
            {
                kept.replace(*place, reading);
            }
            let (before, now) = (verdict_of(*fused), verdict_of(now));
            if before != now {
                verdicts.push((reading.transducer, before, now));
            }
        }
    }
}
