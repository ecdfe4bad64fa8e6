//! What a service remembers over its lives: what it stores, when, and where it goes back to.
//!
//! A producer may have written more than its consumers have stored when both die. So a state counts as stored only when
//! all that had been written by then is stored downstream; until then older ones are kept, and what was read is not
//! acknowledged. Gone back to an older state, a service reads the same and writes the same again, and who has it already
//! skips it.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_core::parts::Parts;
use echogrid_topics::{Ack, Command, Delivery, Message, Topic};

use super::ports::{Ports, Source};
use super::vitals::Vitals;
use crate::mutants::Mutant;
use crate::store::{Entry, Moment, Read, Store, Unrepeatable};

/// A service that has nothing to do stores what it has taken in this long after it stored last …
const STORE_AFTER: Duration = Duration::from_millis(500);
/// … or at once when that is this share of what its producer may be ahead: it may be waiting for it.
const SOON: u64 = 8;
/// A service that is busy stores when that is this share.
const LATE: u64 = 2;

/// As many people as can give orders at the same time.
const ORDERS_KNOWN: usize = 8;
/// The number of what a planner says.
const NO_ORDER: u64 = 0;

/// Whether it is time to store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Due {
    /// It is.
    Now,
    /// It will be, then at the latest.
    Within(Duration),
}

/// What is stored of a service, and what of it is still to take effect again.
#[derive(Debug)]
pub(crate) struct Memory {
    /// None where nobody would restart the service.
    pub(crate) store: Option<Store>,
    /// What is stored, and may be gone back to; the latest last.
    pub(crate) generations: VecDeque<(u64, Moment)>,
    /// What took effect in an earlier life after what was gone back to.
    pub(crate) replaying: VecDeque<Entry>,
    /// The numbers of the latest orders that were carried out, in whichever life.
    pub(crate) orders: VecDeque<u64>,
    stored_at: Instant,
    /// Number of the next message of a live sensor.
    pub(crate) spooled: u64,
    /// After so many messages the streams ended, in this life of the sensor or an earlier one.
    pub(crate) ends_at: Option<u64>,
}

impl Memory {
    /// Of a life that began `now`.
    pub(crate) fn new(store: Option<Store>, now: Instant) -> Self {
        Self {
            store,
            generations: VecDeque::new(),
            replaying: VecDeque::new(),
            orders: VecDeque::new(),
            stored_at: now,
            spooled: 0,
            ends_at: None,
        }
    }

    /// Whether an earlier process of the service stored something.
    ///
    /// # Errors
    /// What was stored is broken.
    pub(crate) fn had_life(&self) -> Result<bool> {
        self.store.as_ref().map_or(Ok(false), |store| Ok(!moments_in(store)?.is_empty()))
    }

    /// The latest stored state that goes with what those downstream have stored.
    ///
    /// # Errors
    /// What was stored is broken, or there is none as old as that.
    pub(crate) fn latest(&self, ports: &Ports) -> Result<Option<(u64, Moment)>> {
        let Some(store) = &self.store else { return Ok(None) };
        let moments = moments_in(store)?;
        let had_moments = !moments.is_empty();
        let latest = moments
            .into_iter()
            .filter(|(_, moment)| is_stored_downstream(moment, ports))
            .max_by_key(|(_, moment)| moment.progress);
        anyhow::ensure!(
            latest.is_some() || !had_moments,
            "{}: no state stored there is as old as that of those downstream; begin a new run, in another folder",
            store.file().display()
        );
        Ok(latest)
    }

    /// Whether an input may be read now: what took effect in an earlier life does so at the same place again.
    pub(crate) fn may_read(&self, ports: &Ports, index: usize) -> bool {
        let Some(next) = self.replaying.front() else { return true };
        let source = &ports.sources[index];
        if !source.resumes() {
            return !is_written_down(source.port.topic());
        }
        let place = ports.sources[..index].iter().filter(|source| source.resumes()).count();
        next.at.get(place).is_none_or(|until| source.port.taken().sequence < *until)
    }

    /// What takes effect here again, if something does.
    pub(crate) fn replay(&mut self, ports: &Ports) -> Option<Entry> {
        let next = self.replaying.front()?;
        let here = ports.position().iter().zip(&next.at).all(|(taken, at)| taken >= at);
        if here { self.replaying.pop_front() } else { None }
    }

    /// An order that a sensor of an earlier life carried out when it had made so many messages.
    pub(crate) fn order_at(&mut self, made: u64) -> Option<Command> {
        let is_due = self.replaying.front().is_some_and(|next| next.at.first().is_none_or(|at| *at <= made));
        if !is_due {
            return None;
        }
        match self.replaying.pop_front()?.what {
            Unrepeatable::Command(_, command) => Some(command),
            Unrepeatable::Robot(_) | Unrepeatable::Fix(_) | Unrepeatable::End => None,
        }
    }

    /// The orders that had been carried out by a moment, and those that are carried out again after it.
    pub(crate) fn know_orders(&mut self, moment: &Moment) {
        let again = self.replaying.iter().filter_map(|entry| match entry.what {
            Unrepeatable::Command(order, _) if order != NO_ORDER => Some(order),
            _ => None,
        });
        let all: Vec<u64> = moment.orders.iter().copied().chain(again).collect();
        all.into_iter().for_each(|order| self.know_order(order));
    }

    /// Writes down what will not come again, before it takes effect.
    pub(crate) fn write_down(&mut self, ports: &Ports, stamp_ns: u64, message: &Message) -> Result<()> {
        let what = match message {
            Message::Robot(robot) => Unrepeatable::Robot(robot.clone()),
            Message::Fix(fix) => Unrepeatable::Fix(*fix),
            _ => return Ok(()),
        };
        let at = ports.position();
        self.store.as_mut().map_or(Ok(()), |store| store.write_down(&Entry { at, stamp_ns, what }))
    }

    /// Likewise an order of the user.
    pub(crate) fn write_down_order(
        &mut self,
        at: &[u64],
        stamp_ns: u64,
        order: Option<u64>,
        command: Command,
    ) -> Result<()> {
        let what = Unrepeatable::Command(order.unwrap_or(NO_ORDER), command);
        self.store.as_mut().map_or(Ok(()), |store| store.write_down(&Entry { at: at.to_vec(), stamp_ns, what }))?;
        order.into_iter().for_each(|order| self.know_order(order));
        Ok(())
    }

    /// An order was carried out: whoever gives it again did not hear the answer.
    pub(crate) fn know_order(&mut self, order: u64) {
        self.orders.push_back(order);
        if self.orders.len() > ORDERS_KNOWN {
            self.orders.pop_front();
        }
    }

    /// Takes what is written down of a sensor: its orders, and where the user ended its stream.
    pub(crate) fn take_journal(&mut self) -> Result<()> {
        let Some(store) = &self.store else { return Ok(()) };
        for entry in store.journal(0)? {
            match entry.what {
                Unrepeatable::End => self.ends_at = entry.at.first().copied(),
                _ => self.replaying.push_back(entry),
            }
        }
        self.know_orders(&Moment::default());
        Ok(())
    }

    /// The streams of a sensor end when it has sent so many messages: whoever comes after it ends them there, too.
    pub(crate) fn write_down_end(&mut self, sent: u64, stamp_ns: u64) -> Result<()> {
        let Some(store) = self.store.as_mut().filter(|_| self.ends_at.is_none() && !Mutant::ForgetsEnd.lives()) else {
            return Ok(());
        };
        self.ends_at = Some(sent);
        store.write_down(&Entry { at: vec![sent], stamp_ns, what: Unrepeatable::End })
    }

    /// Whether it is time to store the state of the service. `idle`: there is nothing else to do.
    pub(crate) fn due(&self, ports: &Ports, now: Instant, idle: bool) -> Due {
        if self.store.is_none() || !self.replaying.is_empty() {
            return Due::Within(Duration::MAX);
        }
        // What was taken in since, at most, of a share of the window.
        let last = self.generations.back().map(|(_, moment)| moment);
        let mut ahead = false;
        let mut anything = false;
        for (place, source) in ports.sources.iter().filter(|source| source.resumes()).enumerate() {
            let stored = last.and_then(|moment| moment.read.get(place)).map_or(0, |read| read.sequence);
            let taken = source.port.taken().sequence.saturating_sub(stored);
            ahead |= taken >= source.window / if idle { SOON } else { LATE };
            anything |= taken > 0;
        }
        let waited = now.saturating_duration_since(self.stored_at);
        match (ahead || (anything && waited >= STORE_AFTER), anything) {
            (true, _) => Due::Now,
            (false, true) => Due::Within(STORE_AFTER - waited),
            (false, false) => Due::Within(Duration::MAX),
        }
    }

    /// Stores what the service saved, as it is `now`; everything that it wrote must be on its way.
    ///
    /// # Errors
    /// The disk is full: what was stored before is intact.
    pub(crate) fn store(&mut self, ports: &Ports, vitals: &Vitals, parts: Parts) -> Result<()> {
        self.drop_older(ports);
        let oldest = self.generations.front().map_or(0, |(generation, _)| *generation);
        let Some(store) = &mut self.store else { return Ok(()) };
        let orders = self.orders.iter().copied().collect();
        let moment = Moment { journal: store.entries(), orders, ..moment(ports, vitals) };
        let generation = store
            .store(&moment, parts.into_changes(), oldest)
            .with_context(|| format!("storing the state of this service in {}", store.file().display()))?;
        self.generations.push_back((generation, moment));
        self.stored_at = vitals.host.now();
        Ok(())
    }

    /// What the producers need not keep for us any longer, by input.
    pub(crate) fn acknowledged(&self, ports: &Ports) -> Vec<Ack> {
        let usable = self.generations.iter().rev().map(|(_, moment)| moment);
        let usable = usable.into_iter().find(|moment| is_stored_downstream(moment, ports));
        let mut stored = usable.into_iter().flat_map(|moment| moment.read.iter());
        let mut ack = |source: &Source| {
            let taken = source.port.taken();
            // The end counts when all is done that comes of it.
            let end = u64::from(source.ended);
            let sequence = match &self.store {
                Some(_) if source.resumes() && !Mutant::AcknowledgesEarly.lives() => {
                    stored.next().map_or(0, |read| read.sequence - u64::from(read.ended))
                }
                _ => taken.sequence.saturating_sub(end),
            };
            Ack { sequence, ..taken }
        };
        ports.sources.iter().map(&mut ack).collect()
    }

    /// Lets go of what will never be gone back to.
    fn drop_older(&mut self, ports: &Ports) {
        while self.generations.len() > 1 && is_stored_downstream(&self.generations[1].1, ports) {
            self.generations.pop_front();
        }
    }
}

/// The states that are stored.
fn moments_in(store: &Store) -> Result<BTreeMap<u64, Moment>> {
    store.moments().with_context(|| store.file().display().to_string())
}

/// How far everything has come.
fn moment(ports: &Ports, vitals: &Vitals) -> Moment {
    let read = |source: &Source| Read {
        topic: source.port.topic() as u32,
        sequence: source.port.taken().sequence,
        stamp_ns: source.port.stamp_ns(),
        lost: source.lost(),
        ended: source.ended,
    };
    let sinks = ports.sinks.iter().filter(|sink| sink.port.topic().resumes());
    Moment {
        read: ports.sources.iter().filter(|source| source.resumes()).map(read).collect(),
        written: sinks.map(|sink| (sink.port.topic() as u32, sink.port.sequence())).collect(),
        journal: 0,
        orders: Vec::new(),
        progress: vitals.progress,
        stamp_ns: vitals.stamp_ns,
        first_stamp_ns: vitals.first_stamp_ns,
        faults: vitals.faults,
    }
}

/// Whether all that had been written by then is stored by those who read it.
fn is_stored_downstream(moment: &Moment, ports: &Ports) -> bool {
    if Mutant::TrustsDownstream.lives() {
        return true;
    }
    moment.is_behind(|code| {
        let sink = ports.sinks.iter().find(|sink| sink.port.topic() as u32 == code);
        sink.map_or(u64::MAX, |sink| sink.port.acknowledged())
    })
}

/// Whether messages of a topic are written down: those that can't be had again.
fn is_written_down(topic: Topic) -> bool {
    topic.delivery() == Delivery::Latest
}
