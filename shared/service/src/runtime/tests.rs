//! A life of a service over ports in memory: how it stores, resumes, acknowledges and stops.

use std::cell::RefCell;
use std::os::fd::BorrowedFd;
use std::path::Path;
use std::pin::Pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use anyhow::Result;
use echogrid_core::Pose2;
use echogrid_core::parts::{Parts, Saved};
use echogrid_topics::memory::{Bus, InOrder};
use echogrid_topics::topic::Qos;
use echogrid_topics::{
    Ack, Header, Health, Input as Port, Message, Output, RawOdometry, Received, ServiceState, Topic,
};

use super::{Ends, Runtime, Terminated};
use crate::host::{Host, Told, Woken};
use crate::signals::Caught;
use crate::store::Store;
use crate::{Input, Outbox, Plan, Service, life};

mod sensors;

const RUN: u64 = 7;
const WINDOW: u64 = 8;
/// The service, what it reads and what it writes.
const ADDER: u32 = 100;
const READ: Topic = Topic::RangeScan;
const WRITTEN: Topic = Topic::OdometryRaw;

/// Adds up the lengths of the scans.
#[derive(Debug, Default)]
struct Adder(u64);

impl Service for Adder {
    fn inputs(&self) -> &'static [Topic] {
        &[READ]
    }

    fn outputs(&self) -> &'static [Topic] {
        &[WRITTEN]
    }

    fn step(&mut self, input: Input, out: &mut Outbox) -> Result<()> {
        if let Input::Message { stamp_ns, message: Message::Scan(readings), .. } = input {
            self.0 += 1 + readings.len() as u64;
            let odom_from_base = Pose2::new(self.0 as f64, 0.0, 0.0);
            out.send(stamp_ns, Message::Odometry(RawOdometry { odom_from_base, v_mps: 0.0, w_radps: 0.0 }));
        }
        Ok(())
    }

    fn save(&mut self, parts: &mut Parts) {
        parts.put_value("sum", &self.0);
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        self.0 = saved.value("sum")?;
        Ok(())
    }
}

#[derive(Debug)]
struct Switches {
    now: Instant,
    told: Vec<Told>,
    orphaned: bool,
    waits: bool,
}

/// A system where 100 ms pass from one turn to the next.
#[derive(Debug, Clone)]
struct Turns(u32, Rc<RefCell<Switches>>);

impl Host for Turns {
    fn now(&self) -> Instant {
        self.1.borrow().now
    }

    fn pid(&self) -> u32 {
        self.0
    }

    fn is_launched(&self) -> bool {
        true
    }

    fn poll_wait(&mut self, _fds: &[BorrowedFd<'_>], _patience: Duration) -> Poll<Result<Woken>> {
        let mut switches = self.1.borrow_mut();
        switches.waits = !switches.waits;
        if switches.waits {
            return Poll::Pending;
        }
        switches.now += Duration::from_millis(100);
        Poll::Ready(Ok(Woken { told: std::mem::take(&mut switches.told), orphaned: switches.orphaned }))
    }
}

/// The adder's neighbours: who writes what it reads, who reads what it writes.
struct Neighbours {
    bus: Bus,
    lives: u32,
    producer: Output,
    sent: u64,
    consumer: Port,
    consumer_acks: u64,
    mouth: Output,
    ear: Port,
    folder: tempfile::TempDir,
    /// What the adder said last.
    health: Option<Health>,
}

fn qos(topic: Topic) -> Qos {
    Qos { history: 2 * WINDOW as usize, buffer: 4 * WINDOW as usize, window: WINDOW, ..topic.qos(1) }
}

fn output(bus: &Bus, process: u32, topic: Topic, consumers: &[String]) -> Output {
    let carrier = bus.carrier(process, topic, qos(topic));
    Output::over(carrier, topic, WINDOW, (RUN, u64::from(process)), consumers)
}

fn plan(folder: &Path) -> Plan {
    Plan {
        rate: None,
        max_readings: 1,
        epoch: RUN,
        state: Some(folder.into()),
        synced: false,
        consumers: [(WRITTEN.name().to_owned(), vec!["reader".to_owned()])].into(),
        config: toml::Table::new(),
    }
}

/// A life of the adder: one poll is one turn.
struct Life {
    future: Pin<Box<dyn Future<Output = Result<()>>>>,
    switches: Rc<RefCell<Switches>>,
    pid: u32,
}

impl Life {
    fn turn(&mut self) -> Poll<Result<()>> {
        self.future.as_mut().poll(&mut Context::from_waker(Waker::noop()))
    }

    fn tell(&self, told: Told) {
        self.switches.borrow_mut().told.push(told);
    }
}

impl Neighbours {
    fn new() -> Self {
        let bus = Bus::new(Box::new(InOrder));
        let consumer = Port::over(bus.mailbox(2, WRITTEN), WRITTEN);
        Self {
            producer: output(&bus, 1, READ, &["adder".to_owned()]),
            consumer,
            mouth: output(&bus, 2, Topic::Health, &[]),
            ear: Port::over(bus.mailbox(1, Topic::Health), Topic::Health),
            bus,
            lives: 0,
            sent: 0,
            consumer_acks: 0,
            folder: tempfile::tempdir().unwrap(),
            health: None,
        }
    }

    fn live(&mut self) -> Life {
        let inputs = |bus: &Bus, pid| vec![(Port::over(bus.mailbox(pid, READ), READ), WINDOW)];
        let (mut runtime, switches, pid) = self.runtime(None, inputs);
        let future = Box::pin(async move { life::serve(&mut runtime, &mut Adder::default()).await });
        Life { future, switches, pid }
    }

    fn runtime(
        &mut self,
        rate: Option<f64>,
        inputs: impl Fn(&Bus, u32) -> Vec<(Port, u64)>,
    ) -> (Runtime, Rc<RefCell<Switches>>, u32) {
        self.lives += 1;
        let pid = ADDER + self.lives;
        let switches = Switches { now: Instant::now(), told: Vec::new(), orphaned: false, waits: false };
        let host = Turns(pid, Rc::new(RefCell::new(switches)));
        let switches = host.1.clone();
        let plan = Plan { rate, ..plan(self.folder.path()) };
        let store = Store::open(&self.folder.path().join("adder.redb"), RUN, false, true).unwrap();
        let runtime = Runtime::with(Ends {
            name: "adder".into(),
            host: Box::new(host),
            inputs: inputs(&self.bus, pid),
            outputs: vec![output(&self.bus, pid, WRITTEN, plan.consumers_of(WRITTEN))],
            mouth: output(&self.bus, pid, Topic::Health, &[]),
            ear: Port::over(self.bus.mailbox(pid, Topic::Health), Topic::Health),
            orders: None,
            store: Some(store),
            plan,
        });
        (runtime, switches, pid)
    }

    /// The producer dies with all it had sent, and another sends what is not acknowledged; likewise nobody else.
    fn another_producer(&mut self) {
        self.bus.bury(1);
        self.bus.clean();
        self.producer = output(&self.bus, 1, READ, &["adder".to_owned()]);
        self.ear = Port::over(self.bus.mailbox(1, Topic::Health), Topic::Health);
        self.sent = 0;
    }

    fn kill(&mut self, life: Life) {
        self.bus.bury(life.pid);
    }

    /// Sends as many scans as there is room for, of `until`.
    fn produce(&mut self, until: u64) {
        self.listen();
        while self.producer.room() > 0 && self.sent < until {
            self.sent += 1;
            self.producer.send(self.sent, &Message::Scan(Vec::new())).unwrap();
        }
    }

    fn listen(&mut self) {
        while let Some(received) = self.ear.receive().unwrap() {
            let Received::Message(_, Message::Health(health)) = received else { continue };
            if health.service == "adder" {
                self.producer.note(&health);
                self.health = Some(health);
            }
        }
        self.producer.welcome().unwrap();
    }

    /// What the reader hears; it says that it has stored `consumer_acks`.
    fn consume(&mut self) -> (Vec<u64>, bool) {
        let (mut sums, mut ended) = (Vec::new(), false);
        while let Some(received) = self.consumer.receive().unwrap() {
            match received {
                Received::Message(_, Message::Odometry(raw)) => sums.push(raw.odom_from_base.x as u64),
                Received::End(Header { .. }) => ended = true,
                other => panic!("{other:?}"),
            }
        }
        let acks = vec![Ack { topic: WRITTEN, epoch: RUN, sequence: self.consumer_acks }];
        let health = Health { acks, ..Health::new("reader", 2, ServiceState::Running) };
        self.mouth.send(0, &Message::Health(health)).unwrap();
        (sums, ended)
    }

    fn acknowledged(&self) -> u64 {
        self.health.as_ref().map_or(0, |health| health.acks[0].sequence)
    }
}

#[test]
fn what_was_read_is_acknowledged_when_all_that_came_of_it_is_stored() {
    let mut graph = Neighbours::new();
    let mut life = graph.live();
    let mut sums = Vec::new();
    for turn in 0..30 {
        assert!(life.turn().is_pending());
        // One at a time: there is a state of each.
        graph.produce(turn);
        sums.extend(graph.consume().0);
    }
    // The reader has stored nothing: no more than a window is on its way, and none of it need not be kept.
    assert_eq!((sums, graph.acknowledged()), ((1..=WINDOW).collect(), 0));
    graph.consumer_acks = 5;
    for _ in 0..30 {
        assert!(life.turn().is_pending());
        graph.produce(100);
        graph.consume();
    }
    // Of the states that were stored, the latest that the reader has all of.
    let acknowledged = graph.acknowledged();
    assert!((4..=5).contains(&acknowledged), "{acknowledged}");
}

#[test]
fn a_service_that_dies_at_any_turn_goes_on_where_it_was() {
    for dies_after in 1..40 {
        let mut graph = Neighbours::new();
        let mut sums = Vec::new();
        let mut life = graph.live();
        for turn in 0.. {
            assert!(turn < 2_000, "killed after {dies_after} turns it did not come to an end: {sums:?}");
            if turn > 0 && turn % dies_after == 0 && turn < 5 * dies_after {
                graph.kill(life);
                graph.bus.clean();
                if turn % 2 == 0 {
                    graph.another_producer();
                }
                life = graph.live();
            }
            assert!(life.turn().is_pending());
            graph.produce(50);
            let (more, _) = graph.consume();
            sums.extend(more);
            graph.consumer_acks = sums.len() as u64;
            if sums.len() == 50 {
                break;
            }
        }
        assert_eq!(sums, (1..=50).collect::<Vec<_>>(), "killed after {dies_after} turns");
        assert_eq!(graph.consumer.lost(), 0);
    }
}

#[test]
fn who_is_done_leaves_what_is_not_stored_upstream_until_the_launcher_has_heard_it() {
    let mut graph = Neighbours::new();
    let mut life = graph.live();
    let (mut sums, mut heard_end) = (Vec::new(), false);
    let mut run = |graph: &mut Neighbours, turns: usize| {
        for _ in 0..turns {
            if let Poll::Ready(end) = life.turn() {
                graph.listen();
                return Some(end);
            }
            graph.produce(3);
            let (more, ended) = graph.consume();
            sums.extend(more);
            heard_end |= ended;
            graph.consumer_acks = sums.len() as u64;
        }
        None
    };
    assert!(run(&mut graph, 20).is_none());
    graph.producer.end(3).unwrap();
    assert!(run(&mut graph, 20).is_none(), "left before the reader was done");
    assert!(!graph.producer.is_drained());
    graph.consumer_acks = 4;
    let acks = vec![Ack { topic: WRITTEN, epoch: RUN, sequence: 4 }];
    let health = Health { acks, ..Health::new("reader", 2, ServiceState::Running) };
    graph.mouth.send(0, &Message::Health(health)).unwrap();
    run(&mut graph, 5).unwrap().unwrap();
    assert!(!graph.producer.is_drained(), "what if nobody heard that it was done?");
    graph.producer.note(&Health::new("adder", 1, ServiceState::Gone));
    assert!(graph.producer.is_drained());
    assert_eq!(graph.health.unwrap().state, ServiceState::Finished);
    assert_eq!((sums, heard_end), (vec![1, 2, 3], true));
}

#[test]
fn who_is_asked_to_stop_takes_in_what_has_come_and_ends_no_stream() {
    let mut graph = Neighbours::new();
    let mut life = graph.live();
    for _ in 0..10 {
        assert!(life.turn().is_pending());
        graph.produce(2);
        graph.consume();
    }
    graph.sent = 0;
    graph.producer.send(3, &Message::Scan(Vec::new())).unwrap();
    life.tell(Told::Stop);
    let mut heard = (Vec::new(), false);
    for _ in 0..20 {
        let ended = life.turn();
        let (sums, end) = graph.consume();
        heard.0.extend(sums);
        heard.1 |= end;
        if let Poll::Ready(end) = ended {
            end.unwrap();
            // Its stream goes on with the life that comes after it.
            assert_eq!(heard, (vec![3], false));
            return;
        }
    }
    panic!("it did not leave: {heard:?}");
}

#[test]
fn who_has_no_launcher_any_more_waits_for_nobody() {
    let mut graph = Neighbours::new();
    let mut life = graph.live();
    assert!(life.turn().is_pending());
    life.switches.borrow_mut().orphaned = true;
    let turns = (0..5).position(|_| life.turn().is_ready());
    assert!(turns.is_some());
}

#[test]
fn a_strangers_signal_is_a_death() {
    let mut graph = Neighbours::new();
    let mut life = graph.live();
    assert!(life.turn().is_pending());
    life.tell(Told::Leave(Caught { signal: nix::sys::signal::Signal::SIGTERM, sender: 1 }));
    let Poll::Ready(Err(error)) = life.turn() else { panic!("it goes on") };
    assert!(error.is::<Terminated>(), "{error}");
}
