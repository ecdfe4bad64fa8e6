//! Scans wait until something has said where the map lies, as many as there is room for; the oldest of more are held.
//!
//! Which those are depends on stamps alone, not on whether scans or estimates happened to come first: of the scans before the first
//! estimate that knows where the map lies the latest are kept, and these are known when all of them have come.

use echogrid_service::Outbox;
use echogrid_topics::PoseEstimate;

use crate::MapperService;

impl MapperService {
    /// Takes in the next estimate.
    pub(crate) fn follow(&mut self, stamp_ns: u64, estimate: PoseEstimate) {
        let was_unplaced = self.trajectory.is_unplaced();
        self.trajectory.push(stamp_ns, estimate);
        if was_unplaced && !self.trajectory.is_unplaced() {
            self.placed_ns = Some(stamp_ns);
        }
    }

    /// Whether scans have to wait for word of where the map lies, or for those that came before it.
    pub(crate) fn waits_for_the_place_of_the_map(&mut self, out: &mut Outbox) -> bool {
        if self.trajectory.is_unplaced() {
            let latest_ns = self.trajectory.latest_ns();
            self.hold_beyond_room(latest_ns, out);
            return true;
        }
        let Some(placed_ns) = self.placed_ns else { return false };
        if self.waiting.back().is_none_or(|scan| scan.end_ns() <= placed_ns) {
            return true;
        }
        self.hold_those_without_room(out);
        false
    }

    /// All scans before the first place have come: those that there was no room for are held.
    pub(crate) fn hold_those_without_room(&mut self, out: &mut Outbox) {
        if let Some(placed_ns) = self.placed_ns.take() {
            self.hold_beyond_room(placed_ns, out);
        }
    }

    /// Of the scans that end until `until_ns` holds the oldest of too many.
    fn hold_beyond_room(&mut self, until_ns: u64, out: &mut Outbox) {
        let counted = self.waiting.iter().take_while(|scan| scan.end_ns() <= until_ns);
        let mut readings: usize = counted.map(|scan| scan.readings.len()).sum();
        while readings > self.config.remap_readings_max as usize {
            readings -= self.waiting.front().map_or(0, |scan| scan.readings.len());
            self.take_oldest(true, out);
        }
    }
}
