//! How a life goes on where an earlier one was, and what it leaves for the next.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use anyhow::{Context, Result};
use echogrid_core::parts::{Parts, Saved};
use echogrid_topics::{Command, Message, Topic};

use super::memory::Due;
use super::{Runtime, Stop};
use crate::Service;
use crate::store::{Measured, Moment, Spooled, Store};

/// How long a service waits for the next word of its consumers.
const WORD_WITHIN: Duration = Duration::from_secs(1);

impl Runtime {
    /// Waits until every consumer has said how far it has come; whether the service may begin. If it `must` meet them, it does so
    /// when it was asked to stop, too: it could not end its streams where they are, or go on from what it had stored.
    async fn meet_consumers(&mut self, must: bool) -> Result<bool> {
        // Who is on its way comes, and who does not is gone for good: the launcher says so, where there is one.
        let must = must && self.vitals.host.is_launched();
        loop {
            if self.stop().is_some_and(|stop| !must || stop != Stop::Asked) {
                return Ok(false);
            }
            if self.ports.sinks.iter().all(|sink| !sink.port.topic().resumes() || sink.port.is_met()) {
                self.set_waits_for(None);
                return Ok(true);
            }
            self.set_waits_for(self.awaited_output());
            self.attend(WORD_WITHIN).await?;
        }
    }

    /// Brings `service` to where an earlier process of it was, as far as its consumers know. Whether it is there: asked to
    /// stop, it may meet nobody who could tell, and what comes in is not for it then.
    ///
    /// # Errors
    /// What was stored is broken, or of another version.
    pub async fn recover(&mut self, service: &mut impl Service) -> Result<bool> {
        let had_life = self.memory.had_life()?;
        if !self.meet_consumers(had_life).await? {
            return Ok(!had_life);
        }
        let latest = self.memory.latest(&self.ports)?;
        let moment = latest.as_ref().map(|(_, moment)| moment.clone()).unwrap_or_default();
        if let Some(store) = &mut self.memory.store {
            self.memory.replaying = store.journal(moment.journal)?.into();
            if let Some((generation, _)) = &latest {
                let state = store.go_back(*generation)?;
                service.restore(&Saved::from_parts(state)).with_context(|| {
                    format!("{}: going on with what an earlier process had stored", store.file().display())
                })?;
                let orders = self.memory.replaying.len();
                tracing::info!(messages = moment.progress, orders, "restarted: goes on where an earlier process was");
            }
        }
        self.memory.know_orders(&moment);
        self.go_to(&moment);
        self.memory.generations.extend(latest);
        if self.memory.generations.is_empty() && self.memory.replaying.is_empty() {
            // The beginning is gone back to as well, while those downstream have stored nothing.
            self.store_now(service)?;
        }
        Ok(true)
    }

    fn go_to(&mut self, moment: &Moment) {
        let epoch = self.plan.epoch;
        for read in &moment.read {
            let source = self.ports.sources.iter_mut().find(|source| source.port.topic() as u32 == read.topic);
            let Some(source) = source else { continue };
            source.port.resume(epoch, read.sequence, read.stamp_ns);
            (source.ended, source.lost_before) = (read.ended, read.lost);
        }
        for source in self.ports.sources.iter_mut().filter(|source| moment.progress > 0 && !source.ended) {
            source.seen = true;
        }
        self.resume_outputs(|topic| {
            moment.written.iter().find(|(code, _)| *code == topic).map_or(0, |(_, sequence)| *sequence)
        });
        let vitals = &mut self.vitals;
        (vitals.progress, vitals.stamp_ns, vitals.faults) = (moment.progress, moment.stamp_ns, moment.faults);
        vitals.first_stamp_ns = moment.first_stamp_ns;
    }

    /// Every output that is numbered through the run goes on after what was `written` of the topic of a code.
    fn resume_outputs(&mut self, written: impl Fn(u32) -> u64) {
        for sink in self.ports.sinks.iter_mut().filter(|sink| sink.port.topic().resumes()) {
            sink.port.resume(written(sink.port.topic() as u32));
        }
    }

    /// Waits for the consumers of a sensor, to send what they have not stored. Of a sensor that `is_live`, what an earlier
    /// process of it had measured and is not stored by all.
    ///
    /// # Errors
    /// What was stored is broken, or of another version.
    pub async fn begin(&mut self, is_live: bool) -> Result<VecDeque<(u64, Message)>> {
        self.meet_consumers(true).await?;
        let (mut again, mut sent) = (VecDeque::new(), BTreeMap::new());
        self.memory.take_journal()?;
        if let Some(store) = self.memory.store.as_ref().filter(|_| is_live) {
            let (messages, next, trimmed) = store.spooled()?;
            (self.memory.spooled, sent) = (next, trimmed);
            again.extend(messages.into_iter().map(|spooled| (spooled.stamp_ns, spooled.message.into())));
            // What was ordered is in what was measured.
            self.memory.replaying.clear();
        }
        self.resume_outputs(|topic| sent.get(&topic).copied().unwrap_or(0));
        // What a live one had sent is in `again`.
        let had_life = self.memory.store.as_mut().filter(|_| !is_live).map_or(Ok(false), Store::begin_life)?;
        if had_life {
            self.ports.sinks.iter_mut().for_each(|sink| sink.port.assume_heard());
        }
        Ok(again)
    }

    /// Keeps what a live sensor has measured, before anybody hears of it.
    ///
    /// # Errors
    /// The disk is full.
    pub fn spool(&mut self, stamp_ns: u64, message: &Message) -> Result<()> {
        let Some((store, measured)) = self.memory.store.as_mut().zip(Measured::of(message)) else { return Ok(()) };
        let sequence = self.ports.sink(message.topic()).map_or(0, |sink| sink.port.sequence()) + 1;
        let spooled = Spooled { topic: message.topic() as u32, sequence, stamp_ns, message: measured };
        let is_stored = |topic: u32, sequence: u64| {
            let sink = Topic::from_code(topic).and_then(|topic| self.ports.sink(topic));
            sink.filter(|sink| sink.port.topic().resumes()).is_some_and(|sink| sequence <= sink.port.acknowledged())
        };
        store
            .spool(self.memory.spooled, &spooled, is_stored)
            .with_context(|| format!("spooling what was measured in {}", store.file().display()))?;
        self.memory.spooled += 1;
        Ok(())
    }

    /// Whether some consumer already has what is sent next.
    #[must_use]
    pub fn is_catching_up(&self) -> bool {
        self.ports.sinks.iter().any(|sink| sink.port.is_known())
    }

    /// Whether something was sent, in this life or an earlier one.
    #[must_use]
    pub fn has_spoken(&self) -> bool {
        self.vitals.progress > 0 || self.is_catching_up() || self.ports.sinks.iter().any(|sink| !sink.port.may_end())
    }

    /// Whether the streams may end here: where an earlier life ended them, or else where no consumer has more of it.
    #[must_use]
    pub fn may_end(&self) -> bool {
        match self.memory.ends_at {
            Some(sent) => self.vitals.progress >= sent,
            None => self.ports.sinks.iter().all(|sink| sink.port.may_end()),
        }
    }

    /// Whether the streams of this sensor end here, as an earlier life of it wrote down. One that `is_live` has sent again by
    /// then what was measured before.
    #[must_use]
    pub fn ends_here(&self, is_live: bool) -> bool {
        self.memory.ends_at.is_some_and(|sent| is_live || self.vitals.progress >= sent)
    }

    /// The streams of this sensor end here: that is written down before anybody hears of it, so that no life that comes after
    /// this one ends them elsewhere.
    ///
    /// # Errors
    /// The disk is full.
    pub fn write_down_end(&mut self) -> Result<()> {
        self.memory.write_down_end(self.vitals.progress, self.vitals.stamp_ns)
    }

    /// An order that a sensor of an earlier life carried out when it had made so many messages.
    pub fn order_at(&mut self, made: u64) -> Option<Command> {
        self.memory.order_at(made)
    }

    /// Stores the state of the service if it is time to; everything that it wrote must be on its way. `idle`: there is
    /// nothing else to do. When it will be time at the latest.
    ///
    /// # Errors
    /// The disk is full: what was stored before is intact.
    pub fn store_if_due(&mut self, service: &mut impl Service, idle: bool) -> Result<Duration> {
        match self.memory.due(&self.ports, self.now(), idle) {
            Due::Within(within) => Ok(within),
            Due::Now => {
                self.store_now(service)?;
                Ok(Duration::MAX)
            }
        }
    }

    fn store_now(&mut self, service: &mut impl Service) -> Result<()> {
        if self.memory.store.is_none() {
            return Ok(());
        }
        let mut parts = Parts::default();
        service.save(&mut parts);
        self.memory.store(&self.ports, &self.vitals, parts)
    }
}
