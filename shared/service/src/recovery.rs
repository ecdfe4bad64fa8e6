//! How a service goes on where an earlier process of it was: what it stores, when, and where it goes back to.
//!
//! A producer may have written more than its consumers have stored when both die. So a state counts as stored only when
//! all that had been written by then is stored downstream; until then older ones are kept, and what was read is not
//! acknowledged. Gone back to an older state, a service reads the same and writes the same again, and who has it already
//! skips it.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_core::parts::{Parts, Saved};
use echogrid_topics::{Command, Delivery, Message, Topic};

use crate::runtime::Runtime;
use crate::store::{Entry, Measured, Moment, Read, Spooled, Unrepeatable};
use crate::{Outbox, Service};

/// A service that has nothing to do stores what it has taken in this long after it stored last …
const STORE_AFTER: Duration = Duration::from_millis(500);
/// … or at once when that is this share of what its producer may be ahead: it may be waiting for it.
const SOON: u64 = 8;
/// A service that is busy stores when that is this share.
const LATE: u64 = 2;
/// How long a service waits for the next word of its consumers.
const WORD_WITHIN: Duration = Duration::from_secs(1);

impl Runtime {
    /// Waits until every consumer has said how far it has come; whether the service may begin.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn meet_consumers(&mut self) -> Result<bool> {
        while self.stop().is_none() {
            if self.sinks.iter().all(|sink| !sink.port.topic().resumes() || sink.port.is_met()) {
                self.set_waits_for(None);
                return Ok(true);
            }
            self.set_waits_for(self.awaited_output());
            self.attend(WORD_WITHIN)?;
        }
        Ok(false)
    }

    /// Brings `service` to where an earlier process of it was, as far as its consumers know.
    ///
    /// # Errors
    /// What was stored is broken, or of another version.
    pub fn recover(&mut self, service: &mut impl Service) -> Result<()> {
        if !self.meet_consumers()? {
            return Ok(());
        }
        let acknowledged: Vec<(u32, u64)> =
            self.sinks.iter().map(|sink| (sink.port.topic() as u32, sink.port.acknowledged())).collect();
        let known =
            |code: u32| acknowledged.iter().find(|(topic, _)| *topic == code).map_or(0, |(_, sequence)| *sequence);
        let Some(store) = &self.store else {
            self.sinks.iter_mut().filter(|sink| sink.port.topic().resumes()).for_each(|sink| sink.port.resume(0));
            return Ok(());
        };
        let moments = store.moments().with_context(|| store.file().display().to_string())?;
        let had_moments = !moments.is_empty();
        let latest = moments.into_iter().filter(|(_, moment)| moment.is_behind(known)).max_by_key(|(_, m)| m.progress);
        anyhow::ensure!(
            latest.is_some() || !had_moments,
            "{}: no state stored there is as old as that of those downstream; begin a new run, in another folder",
            store.file().display()
        );
        let moment = latest.as_ref().map(|(_, moment)| moment.clone()).unwrap_or_default();
        self.replaying = store.journal(moment.journal)?.into();
        if let Some((generation, _)) = &latest {
            let state = store.state(*generation)?;
            service.restore(&Saved::from_parts(state)).with_context(|| {
                format!("{}: going on with what an earlier process had stored", store.file().display())
            })?;
            tracing::info!(
                messages = moment.progress,
                orders = self.replaying.len(),
                "restarted: goes on where an earlier process was"
            );
        }
        self.go_to(&moment);
        self.generations.extend(latest);
        if self.generations.is_empty() && self.replaying.is_empty() {
            // The beginning is gone back to as well, while those downstream have stored nothing.
            self.store_now(service)?;
        }
        Ok(())
    }

    fn go_to(&mut self, moment: &Moment) {
        let epoch = self.plan.epoch;
        for read in &moment.read {
            let source = self.sources.iter_mut().find(|source| source.port.topic() as u32 == read.topic);
            let Some(source) = source else { continue };
            source.port.resume(epoch, read.sequence, read.stamp_ns);
            (source.ended, source.lost_before) = (read.ended, read.lost);
        }
        for source in self.sources.iter_mut().filter(|source| moment.progress > 0 && !source.ended) {
            source.seen = true;
        }
        for sink in self.sinks.iter_mut().filter(|sink| sink.port.topic().resumes()) {
            let code = sink.port.topic() as u32;
            sink.port
                .resume(moment.written.iter().find(|(topic, _)| *topic == code).map_or(0, |(_, sequence)| *sequence));
        }
        (self.progress, self.stamp_ns, self.faults) = (moment.progress, moment.stamp_ns, moment.faults);
        self.first_stamp_ns = moment.first_stamp_ns;
    }

    /// Waits for the consumers of a sensor, to send what they have not stored. Of a sensor that `is_live`, what an earlier
    /// process of it had measured and is not stored by all.
    ///
    /// # Errors
    /// What was stored is broken, or of another version.
    pub fn begin(&mut self, is_live: bool) -> Result<VecDeque<(u64, Message)>> {
        self.meet_consumers()?;
        let (mut again, mut sent) = (VecDeque::new(), BTreeMap::new());
        if let Some(store) = &self.store {
            self.replaying = store.journal(0)?.into();
            if is_live {
                let (messages, next, trimmed) = store.spooled()?;
                (self.spooled, sent) = (next, trimmed);
                again.extend(messages.into_iter().map(|spooled| (spooled.stamp_ns, spooled.message.into())));
                // What was ordered is in what was measured.
                self.replaying.clear();
            }
        }
        for sink in self.sinks.iter_mut().filter(|sink| sink.port.topic().resumes()) {
            sink.port.resume(sent.get(&(sink.port.topic() as u32)).copied().unwrap_or(0));
        }
        Ok(again)
    }

    /// Keeps what a live sensor has measured, before anybody hears of it.
    ///
    /// # Errors
    /// The disk is full.
    pub fn spool(&mut self, stamp_ns: u64, message: &Message) -> Result<()> {
        let Some((store, measured)) = self.store.as_mut().zip(Measured::of(message)) else { return Ok(()) };
        let sink = self.sinks.iter().find(|sink| sink.port.topic() == message.topic());
        let sequence = sink.map_or(0, |sink| sink.port.sequence()) + 1;
        let spooled = Spooled { topic: message.topic() as u32, sequence, stamp_ns, message: measured };
        let is_stored = |topic: u32, sequence: u64| {
            let sink = self.sinks.iter().find(|sink| sink.port.topic() as u32 == topic && sink.port.topic().resumes());
            sink.is_some_and(|sink| sequence <= sink.port.acknowledged())
        };
        store
            .spool(self.spooled, &spooled, is_stored)
            .with_context(|| format!("spooling what was measured in {}", store.file().display()))?;
        self.spooled += 1;
        Ok(())
    }

    /// Whether some consumer already has what is sent next.
    #[must_use]
    pub fn is_catching_up(&self) -> bool {
        self.sinks.iter().any(|sink| sink.port.is_known())
    }

    /// An order that a sensor of an earlier life carried out when it had made so many messages.
    pub fn order_at(&mut self, made: u64) -> Option<Command> {
        let is_due = self.replaying.front().is_some_and(|next| next.at.first().is_none_or(|at| *at <= made));
        if !is_due {
            return None;
        }
        match self.replaying.pop_front()?.what {
            Unrepeatable::Command(command) => Some(command),
            Unrepeatable::Robot(_) | Unrepeatable::Fix(_) => None,
        }
    }

    /// Last sequence taken of each lossless input, in their order.
    pub(crate) fn position(&self) -> Vec<u64> {
        self.sources.iter().filter(|source| source.resumes()).map(|source| source.port.taken().sequence).collect()
    }

    /// Whether an input may be read now: what took effect in an earlier life does so at the same place again.
    pub(crate) fn may_read(&self, index: usize) -> bool {
        let Some(next) = self.replaying.front() else { return true };
        let source = &self.sources[index];
        if !source.resumes() {
            return !is_written_down(source.port.topic());
        }
        let place = self.sources[..index].iter().filter(|source| source.resumes()).count();
        next.at.get(place).is_none_or(|until| source.port.taken().sequence < *until)
    }

    /// What takes effect here again, if something does.
    pub(crate) fn replay(&mut self) -> Option<Entry> {
        let next = self.replaying.front()?;
        let here = self.position().iter().zip(&next.at).all(|(taken, at)| taken >= at);
        if here { self.replaying.pop_front() } else { None }
    }

    /// Writes down what will not come again, before it takes effect.
    pub(crate) fn write_down(&mut self, stamp_ns: u64, message: &Message) -> Result<()> {
        let what = match message {
            Message::Robot(robot) => Unrepeatable::Robot(robot.clone()),
            Message::Fix(fix) => Unrepeatable::Fix(*fix),
            _ => return Ok(()),
        };
        let at = self.position();
        self.store.as_mut().map_or(Ok(()), |store| store.write_down(&Entry { at, stamp_ns, what }))
    }

    /// Stores the state of the service if it is time to; everything that it wrote must be on its way. `idle`: there is
    /// nothing else to do. When it will be time at the latest.
    ///
    /// # Errors
    /// The disk is full: what was stored before is intact.
    pub fn store_if_due(&mut self, service: &mut impl Service, idle: bool) -> Result<Duration> {
        if self.store.is_none() || !self.replaying.is_empty() {
            return Ok(Duration::MAX);
        }
        // What was taken in since, at most, of a share of the window.
        let last = self.generations.back().map(|(_, moment)| moment);
        let mut ahead = false;
        let mut anything = false;
        for (place, source) in self.sources.iter().filter(|source| source.resumes()).enumerate() {
            let stored = last.and_then(|moment| moment.read.get(place)).map_or(0, |read| read.sequence);
            let taken = source.port.taken().sequence.saturating_sub(stored);
            let window = source.port.topic().qos(self.plan.max_readings).window;
            ahead |= taken >= window / if idle { SOON } else { LATE };
            anything |= taken > 0;
        }
        let waited = self.stored_at.elapsed();
        let due = ahead || (anything && waited >= STORE_AFTER);
        if !due {
            return Ok(if anything { STORE_AFTER - waited } else { Duration::MAX });
        }
        self.store_now(service)?;
        Ok(Duration::MAX)
    }

    fn store_now(&mut self, service: &mut impl Service) -> Result<()> {
        let moment = Moment {
            read: self
                .sources
                .iter()
                .filter(|source| source.resumes())
                .map(|source| Read {
                    topic: source.port.topic() as u32,
                    sequence: source.port.taken().sequence,
                    stamp_ns: source.port.stamp_ns(),
                    lost: source.lost_before + source.port.lost(),
                    ended: source.ended,
                })
                .collect(),
            written: self
                .sinks
                .iter()
                .filter(|sink| sink.port.topic().resumes())
                .map(|sink| (sink.port.topic() as u32, sink.port.sequence()))
                .collect(),
            journal: 0,
            progress: self.progress,
            stamp_ns: self.stamp_ns,
            first_stamp_ns: self.first_stamp_ns,
            faults: self.faults,
        };
        let mut parts = Parts::default();
        service.save(&mut parts);
        self.drop_older();
        let oldest = self.generations.front().map_or(0, |(generation, _)| *generation);
        let Some(store) = &mut self.store else { return Ok(()) };
        let moment = Moment { journal: store.entries(), ..moment };
        let generation = store
            .store(&moment, parts.into_changes(), oldest)
            .with_context(|| format!("storing the state of this service in {}", store.file().display()))?;
        self.generations.push_back((generation, moment));
        self.stored_at = Instant::now();
        Ok(())
    }

    /// Tells whoever came to an output what counts, in the words of the service.
    pub fn welcome_newcomers(&mut self, service: &mut impl Service, out: &mut Outbox) {
        while let Some(topic) = self.take_newcomer() {
            service.welcome(topic, out);
        }
    }

    /// Lets go of what will never be gone back to.
    fn drop_older(&mut self) {
        while self.generations.len() > 1 && self.is_stored_downstream(&self.generations[1].1) {
            self.generations.pop_front();
        }
    }

    /// The latest stored state that all is stored of downstream.
    pub(crate) fn usable(&self) -> Option<&Moment> {
        self.generations.iter().rev().map(|(_, moment)| moment).find(|moment| self.is_stored_downstream(moment))
    }

    fn is_stored_downstream(&self, moment: &Moment) -> bool {
        moment.is_behind(|code| {
            let sink = self.sinks.iter().find(|sink| sink.port.topic() as u32 == code);
            sink.map_or(u64::MAX, |sink| sink.port.acknowledged())
        })
    }
}

/// Whether messages of a topic are written down: those that can't be had again.
fn is_written_down(topic: Topic) -> bool {
    topic.delivery() == Delivery::Latest
}
