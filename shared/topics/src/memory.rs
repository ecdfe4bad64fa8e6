//! Ports in the memory of one process: what shared memory promises, and no more.
//!
//! Each producer has a queue in front of each consumer, and keeps a history for those that come late. What one producer sent
//! arrives in its order; which producer is read next is open, and decided by whoever plays the schedule. What a dead producer
//! had sent stays in the queues until somebody cleans up; but for those who had not looked since it came, it is lost with it.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::os::fd::BorrowedFd;
use std::rc::Rc;

use crate::contract::Message;
use crate::participant::TopicError;
use crate::port::{Carrier, Mailbox, Received};
use crate::topic::{Qos, Topic};
use crate::wire::Header;

/// What is open in shared memory, decided.
pub trait Schedule {
    /// Which of so many producers is read next; none: what they sent is still on its way.
    fn choose(&mut self, producers: usize) -> Option<usize>;

    /// Whether this process lives to do what it is about to.
    fn lives(&mut self, process: u32) -> bool;
}

/// Producers are read in the order in which they came, and everybody lives.
#[derive(Debug, Clone, Copy, Default)]
pub struct InOrder;

impl Schedule for InOrder {
    fn choose(&mut self, _producers: usize) -> Option<usize> {
        Some(0)
    }

    fn lives(&mut self, _process: u32) -> bool {
        true
    }
}

type Sent = Rc<(Header, Option<Message>)>;

#[derive(Debug)]
struct Producer {
    topic: Topic,
    process: u32,
    qos: Qos,
    is_alive: bool,
    history: VecDeque<Sent>,
    /// What is on its way, by the number of the consumer.
    queues: BTreeMap<usize, VecDeque<Sent>>,
    /// The consumers that have looked since it came.
    met: BTreeSet<usize>,
}

#[derive(Debug)]
struct Consumer {
    topic: Topic,
    process: u32,
}

struct State {
    schedule: Box<dyn Schedule>,
    /// By their numbers, in the order in which they came.
    producers: BTreeMap<usize, Producer>,
    consumers: BTreeMap<usize, Consumer>,
    next: usize,
    /// Grows with whatever somebody may be waiting for, by topic.
    rung: BTreeMap<Topic, u64>,
}

impl core::fmt::Debug for State {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("State").field("producers", &self.producers).field("consumers", &self.consumers).finish()
    }
}

/// The topics of a graph.
#[derive(Debug, Clone)]
pub struct Bus(Rc<RefCell<State>>);

impl Bus {
    /// A graph's topics without producers and consumers.
    #[must_use]
    pub fn new(schedule: Box<dyn Schedule>) -> Self {
        let (producers, consumers, rung) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        Self(Rc::new(RefCell::new(State { schedule, producers, consumers, next: 0, rung })))
    }

    /// What `process` writes `topic` by.
    #[must_use]
    pub fn carrier(&self, process: u32, topic: Topic, qos: Qos) -> Box<dyn Carrier> {
        let mut state = self.0.borrow_mut();
        let number = state.take_number();
        let (history, queues, met) = (VecDeque::new(), BTreeMap::new(), BTreeSet::new());
        state.producers.insert(number, Producer { topic, process, qos, is_alive: true, history, queues, met });
        Box::new(Writer { bus: self.clone(), number })
    }

    /// What `process` reads `topic` by.
    #[must_use]
    pub fn mailbox(&self, process: u32, topic: Topic) -> Box<dyn Mailbox> {
        let mut state = self.0.borrow_mut();
        let number = state.take_number();
        state.consumers.insert(number, Consumer { topic, process });
        Box::new(Reader { bus: self.clone(), number })
    }

    /// The ports of `process` are used no more; what it had sent is still on its way to those who knew of it.
    pub fn bury(&self, process: u32) {
        let state = &mut *self.0.borrow_mut();
        let gone: Vec<usize> =
            state.consumers.iter().filter(|(_, of)| of.process == process).map(|(number, _)| *number).collect();
        for number in gone {
            state.consumers.remove(&number);
            state.producers.values_mut().for_each(|producer| drop(producer.queues.remove(&number)));
        }
        for dead in state.producers.values_mut().filter(|of| of.process == process) {
            dead.is_alive = false;
            dead.queues.retain(|consumer, _| dead.met.contains(consumer));
        }
    }

    /// Removes what dead producers left, read or not.
    pub fn clean(&self) {
        self.0.borrow_mut().producers.retain(|_, producer| producer.is_alive);
    }

    /// Whether there is something that `process` has not read.
    #[must_use]
    pub fn has_mail(&self, process: u32) -> bool {
        let state = self.0.borrow();
        let mine = state.consumers.iter().filter(|(_, of)| of.process == process).map(|(number, _)| number);
        let full = |number: &usize| {
            let mut queues = state.producers.values().filter_map(|producer| producer.queues.get(number));
            queues.any(|queue| !queue.is_empty())
        };
        mine.into_iter().any(full)
    }

    /// How often somebody was woken for a topic that `process` reads.
    #[must_use]
    pub fn rung(&self, process: u32) -> u64 {
        let state = self.0.borrow();
        let mine = state.consumers.values().filter(|of| of.process == process);
        mine.map(|of| state.rung.get(&of.topic).copied().unwrap_or(0)).sum()
    }

    /// Takes part in the schedule: whether `process` lives to do what it is about to.
    #[must_use]
    pub fn lives(&self, process: u32) -> bool {
        self.0.borrow_mut().schedule.lives(process)
    }
}

impl State {
    fn take_number(&mut self) -> usize {
        self.next += 1;
        self.next
    }

    /// Whoever reads the producer's topic and was not known to it gets its history.
    fn connect(&mut self, number: usize) {
        let Some(producer) = self.producers.get_mut(&number) else { return };
        for (consumer, _) in self.consumers.iter().filter(|(_, of)| of.topic == producer.topic) {
            let queue = producer.queues.entry(*consumer);
            queue.or_insert_with(|| {
                let late = producer.history.len().saturating_sub(producer.qos.buffer);
                producer.history.iter().skip(late).cloned().collect()
            });
        }
    }
}

fn dead(topic: Topic) -> TopicError {
    crate::participant::failed(topic, "using it", "the process is dead")
}

#[derive(Debug)]
struct Writer {
    bus: Bus,
    number: usize,
}

impl Writer {
    fn alive(&self) -> Result<std::cell::RefMut<'_, State>, TopicError> {
        let mut state = self.bus.0.borrow_mut();
        let (topic, process, is_alive) = match state.producers.get(&self.number) {
            Some(producer) => (producer.topic, producer.process, producer.is_alive),
            None => (Topic::Health, 0, false),
        };
        if is_alive && state.schedule.lives(process) { Ok(state) } else { Err(dead(topic)) }
    }
}

impl Carrier for Writer {
    fn put(&mut self, header: Header, message: Option<&Message>) -> Result<(), TopicError> {
        let mut state = self.alive()?;
        state.connect(self.number);
        let Some(producer) = state.producers.get_mut(&self.number) else { return Ok(()) };
        let sent: Sent = Rc::new((header, message.cloned()));
        for queue in producer.queues.values_mut() {
            if queue.len() == producer.qos.buffer {
                queue.pop_front();
            }
            queue.push_back(sent.clone());
        }
        if producer.history.len() == producer.qos.history {
            producer.history.pop_front();
        }
        if producer.qos.history > 0 {
            producer.history.push_back(sent);
        }
        Ok(())
    }

    fn connect(&mut self) -> Result<(), TopicError> {
        self.alive()?.connect(self.number);
        Ok(())
    }

    fn notify(&mut self) -> Result<(), TopicError> {
        let mut state = self.alive()?;
        let Some(topic) = state.producers.get(&self.number).map(|producer| producer.topic) else { return Ok(()) };
        *state.rung.entry(topic).or_default() += 1;
        Ok(())
    }
}

#[derive(Debug)]
struct Reader {
    bus: Bus,
    number: usize,
}

impl Mailbox for Reader {
    fn get(&mut self) -> Result<Option<Received>, TopicError> {
        let state = &mut *self.bus.0.borrow_mut();
        let Some(Consumer { topic, process }) = state.consumers.get(&self.number) else {
            return Err(dead(Topic::Health));
        };
        if !state.schedule.lives(*process) {
            return Err(dead(*topic));
        }
        state.producers.values_mut().filter(|of| of.topic == *topic).for_each(|of| {
            of.met.insert(self.number);
        });
        let queues = state.producers.values_mut().filter_map(|producer| producer.queues.get_mut(&self.number));
        let mut full: Vec<_> = queues.filter(|queue| !queue.is_empty()).collect();
        if full.is_empty() {
            return Ok(None);
        }
        let chosen = state.schedule.choose(full.len());
        let sent = chosen.and_then(|chosen| full.get_mut(chosen)).and_then(|queue| queue.pop_front());
        Ok(sent.map(|sent| {
            let (header, message) = &*sent;
            // What has no content has a flag that says why.
            Received::judge(*header, || Ok(message.clone().unwrap_or_else(|| Message::Scan(Vec::new()))))
        }))
    }

    fn hush(&self) -> Result<(), TopicError> {
        Ok(())
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::port::{Input, Output};

    fn qos() -> Qos {
        Qos { history: 2, buffer: 3, window: 2, ..Topic::RangeScan.qos(1) }
    }

    fn output(bus: &Bus, process: u32, life: u64) -> Output {
        Output::over(bus.carrier(process, Topic::RangeScan, qos()), Topic::RangeScan, 2, (7, life), &[])
    }

    fn sequences(input: &mut Input) -> Vec<u64> {
        let received = std::iter::from_fn(|| input.receive().unwrap());
        received
            .map(|received| match received {
                Received::Message(header, _) | Received::End(header) => header.sequence,
                other => panic!("{other:?}"),
            })
            .collect()
    }

    #[test]
    fn who_comes_late_gets_the_history_and_who_is_slow_the_newest() {
        let bus = Bus::new(Box::new(InOrder));
        let mut output = output(&bus, 1, 1);
        let mut early = Input::over(bus.mailbox(2, Topic::RangeScan), Topic::RangeScan);
        (0..4).for_each(|stamp_ns| output.send(stamp_ns, &Message::Scan(Vec::new())).unwrap());
        let mut late = Input::over(bus.mailbox(3, Topic::RangeScan), Topic::RangeScan);
        assert_eq!((sequences(&mut early), sequences(&mut late)), (vec![2, 3, 4], vec![]));
        output.end(4).unwrap();
        assert_eq!((sequences(&mut early), sequences(&mut late)), (vec![5], vec![3, 4, 5]));
    }

    #[test]
    fn what_the_dead_sent_is_read_until_it_is_cleaned_up() {
        let bus = Bus::new(Box::new(InOrder));
        let mut input = Input::over(bus.mailbox(2, Topic::RangeScan), Topic::RangeScan);
        let mut output = output(&bus, 1, 1);
        let mut late = Input::over(bus.mailbox(3, Topic::RangeScan), Topic::RangeScan);
        assert_eq!(sequences(&mut input), [0; 0]);
        output.send(0, &Message::Scan(Vec::new())).unwrap();
        bus.bury(1);
        assert_eq!(sequences(&mut late), [0; 0], "it had not looked in time");
        assert!(output.send(1, &Message::Scan(Vec::new())).is_err());
        assert_eq!(sequences(&mut input), [1]);
        bus.clean();
        assert!(!bus.has_mail(2));
    }
}
