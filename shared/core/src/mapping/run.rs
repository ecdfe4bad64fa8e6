//! Beams of a lidar that share a pose are fused in one pass, to the same bits as one after the other.

use std::sync::Arc;

use crate::fusion::{Sounding, Weighed};
use crate::mapping::GridMapper;
use crate::mapping::locate::{channel_of, locate};
use crate::odometry::Estimate;
use crate::reading::Reading;
use crate::verdict::Verdict;

/// A reading that the filters let pass, with how much of it was new if that was told when it was fused before; or why it is refused.
pub(crate) type Judged<'a> = Result<(Sounding<'a>, Option<f64>), Verdict>;

/// So many are fused together at most: what is kept of them meanwhile is small enough for the allocator to have it at hand.
pub(crate) const RUN_MAX: usize = 120;

impl GridMapper {
    /// How many of these readings, from the first on, can be fused together; at least one if there is any.
    pub(super) fn run_of(&self, scan: &[(Reading, Option<Estimate>)]) -> usize {
        let joins = |pair: &[(Reading, Option<Estimate>)]| match pair {
            [a, b] => self.are_together(a.0.transducer, b.0.transducer) && a.1 == b.1,
            _ => false,
        };
        scan.len().min(1) + scan.windows(2).take(RUN_MAX - 1).take_while(|pair| joins(pair)).count()
    }

    /// Whether the beam of one transducer comes after that of another among those that stand side by side.
    pub(crate) fn are_together(&self, before: u16, next: u16) -> bool {
        let channels = &self.channels;
        let fan =
            |transducer| channel_of(channels, transducer).and_then(|channel| self.fuser.fan_of(&channel.transducer));
        fan(before).zip(fan(next)).is_some_and(|(before, next)| before.is_before(next))
    }

    /// As [`GridMapper::integrate_judged`] does, for such readings of a scan; their verdicts.
    pub(super) fn integrate_run(
        &mut self,
        sequence: u64,
        scan: &[(Reading, Option<Estimate>)],
        refusals: &[Option<Verdict>],
    ) -> impl Iterator<Item = Verdict> + use<> {
        self.recorders.begin_readings(&mut self.grid, scan.len());
        let mut cleared_at = self.driven.last;
        let channels = Arc::clone(&self.channels);
        let located = scan.iter().map(|(reading, estimate)| locate(&channels, sequence, reading, estimate.as_ref()));
        let soundings: Vec<Result<Sounding<'_>, Verdict>> = located.collect();
        let judged =
            soundings.iter().zip(refusals).map(|(sounding, refusal)| Ok((refusal.map_or(*sounding, Err)?, None)));
        let fused = self.fuse_run(&judged.collect::<Vec<_>>());
        for (sounding, fused) in soundings.iter().zip(&fused) {
            if let Ok(sounding) = sounding {
                self.recorders.end_reading(sounding, *fused, cleared_at, &mut self.fuser);
            }
            if fused.is_ok_and(|weighed| weighed.cleared_m > 0.0) {
                cleared_at = self.driven.last;
            }
        }
        fused.into_iter().map(|fused| fused.err().unwrap_or(Verdict::Accepted))
    }

    /// As [`GridMapper::fuse`] does, for readings of which each [comes after](Self::are_together) the one before, or for a single one.
    pub(crate) fn fuse_run(&mut self, run: &[Judged<'_>]) -> Vec<Result<Weighed, Verdict>> {
        // What each of them does to the map is to be seen.
        if run.len() < 2 || self.recorders.doubt.is_some() {
            let fuse = |judged: &Judged<'_>| judged.and_then(|(sounding, news)| self.fuse(&sounding, news));
            return run.iter().map(fuse).collect();
        }
        let mut beams = core::mem::take(&mut self.beams);
        beams.clear();
        let mut stand = None;
        let mut weigh = |judged: &Judged<'_>| {
            let (sounding, news) = (*judged)?;
            let stand = stand.get_or_insert_with(|| self.fuser.stand(&sounding));
            let (weighed, beam) = self.fuser.weigh_beam(&sounding, stand, news)?;
            beams.push(beam);
            Ok(weighed)
        };
        let mut fused: Vec<Result<Weighed, Verdict>> = run.iter().map(&mut weigh).collect();
        let first = run.iter().zip(&mut fused).find_map(|(judged, fused)| judged.ok().zip(fused.as_mut().ok()));
        if let Some(((sounding, _), weighed)) = first {
            // The robot clears what it stands on after the first of them.
            let before = if self.driven.is_due(sounding.estimate) { 1 } else { beams.len() };
            let (before, after) = beams.split_at(before);
            self.fuser.add_beams(&mut self.grid, &sounding, before);
            weighed.cleared_m = self.driven.clear(&mut self.grid, sounding.estimate, sounding.sequence);
            self.fuser.add_beams(&mut self.grid, &sounding, after);
        }
        self.beams = beams;
        fused
    }
}
