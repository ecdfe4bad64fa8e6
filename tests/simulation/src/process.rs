//! A process of a simulated run: the very loops and steps of a real one.

use std::path::PathBuf;
use std::pin::Pin;
use std::task::{Context, Poll, Waker};

use anyhow::{Result, bail};
use echogrid_publisher::PublisherService;
use echogrid_service::host::Told;
use echogrid_service::runtime::{Ends, Runtime};
use echogrid_service::store::{Shelf as _, Store, Table, beginning};
use echogrid_service::{Plan, Service, life, play};
use echogrid_supervision::{End, Process, Usage};
use echogrid_topics::memory::Bus;
use echogrid_topics::topic::Qos;
use echogrid_topics::{Delivery, Input, Output, Topic};

use crate::disk::{SimulatedFolder, SimulatedShelf, publisher};
use crate::drive::{Drive, OUTPUTS, Recording};
use crate::world::{KILLED, Shared, SimulatedHost};

/// What a producer may be ahead, in messages: so little that it has to wait.
const WINDOW: u64 = 6;

/// Room that a topic has here.
pub(crate) fn qos(topic: Topic) -> Qos {
    let real = topic.qos(2);
    match topic.delivery() {
        Delivery::Lossless => Qos { window: WINDOW, history: 2 * WINDOW as usize, buffer: 4 * WINDOW as usize, ..real },
        Delivery::Relayed => Qos { window: WINDOW, buffer: 2 * WINDOW as usize, ..real },
        // Words get lost where many are said at once.
        Delivery::Latest if topic == Topic::Health => Qos { buffer: 2, ..real },
        Delivery::Latest | Delivery::Droppable => real,
    }
}

/// A producer of the process `process`.
pub(crate) fn output(bus: &Bus, process: u32, topic: Topic, run: u64, consumers: &[String]) -> Output {
    let qos = qos(topic);
    Output::over(bus.carrier(process, topic, qos), topic, qos.window, (run, u64::from(process)), consumers)
}

/// A consumer.
pub(crate) fn input(bus: &Bus, process: u32, topic: Topic) -> Input {
    Input::over(bus.mailbox(process, topic), topic)
}

/// What a service reads and writes.
pub(crate) fn topics(name: &str) -> Result<(&'static [Topic], &'static [Topic])> {
    Ok(match name {
        "sensor" => (&[], OUTPUTS),
        "odometry" => (echogrid_odometry::INPUTS, echogrid_odometry::OUTPUTS),
        "localizer" => (echogrid_localizer::INPUTS, echogrid_localizer::OUTPUTS),
        "mapper" => (echogrid_mapper::INPUTS, echogrid_mapper::OUTPUTS),
        "publisher" => (echogrid_publisher::INPUTS, echogrid_publisher::OUTPUTS),
        _ => bail!("no service {name}"),
    })
}

pub(crate) fn plan(drive: Drive, run: u64) -> Result<Plan> {
    let mut consumers: std::collections::BTreeMap<String, Vec<String>> = Default::default();
    for name in drive.services() {
        for topic in topics(name)?.0 {
            consumers.entry(topic.name().into()).or_default().push((*name).to_owned());
        }
    }
    Ok(Plan {
        rate: None,
        max_readings: 2,
        epoch: run,
        state: None,
        synced: true,
        consumers,
        config: toml::Table::new(),
    })
}

/// A process in the launcher's hand.
#[derive(Debug)]
pub(crate) struct SimulatedProcess {
    pub(crate) number: u32,
    pub(crate) world: Shared,
}

impl Process for SimulatedProcess {
    fn pid(&self) -> u32 {
        self.number
    }

    fn ask_to_stop(&mut self) {
        self.world.borrow_mut().waits.entry(self.number).or_default().told.push(Told::Stop);
    }

    fn kill(&mut self) {
        let world = &mut *self.world.borrow_mut();
        world.dead.insert(self.number);
        world.ends.entry(self.number).or_insert(KILLED);
    }

    fn look(&mut self) -> Result<()> {
        Ok(())
    }

    fn end(&self) -> Option<End> {
        self.world.borrow().ends.get(&self.number).copied()
    }

    fn usage(&self) -> Option<Usage> {
        let world = self.world.borrow();
        let is_stopped = world.waits.get(&self.number).is_some_and(|wait| wait.stopped_until > world.now);
        Some(Usage { state: if is_stopped { 'T' } else { 'S' }, ..Usage::default() })
    }
}

/// A life of a service.
pub(crate) struct Life {
    pub(crate) process: u32,
    future: Pin<Box<dyn Future<Output = Result<()>>>>,
    /// How often somebody had been woken for what it reads when it looked last.
    pub(crate) rung: u64,
}

impl Life {
    /// One turn: until it waits.
    pub(crate) fn turn(&mut self) -> Poll<Result<()>> {
        self.future.as_mut().poll(&mut Context::from_waker(Waker::noop()))
    }
}

/// What a process is told when it is started.
pub(crate) struct Start<'a> {
    pub(crate) world: &'a Shared,
    pub(crate) bus: &'a Bus,
    pub(crate) drive: Drive,
    pub(crate) run: u64,
    pub(crate) name: &'a str,
    pub(crate) process: u32,
    /// Services that have left for good.
    pub(crate) gone: &'a [String],
}

impl Start<'_> {
    /// Starts it.
    ///
    /// # Errors
    /// It could not enter the graph, or died while it did.
    pub(crate) fn life(&self) -> Result<Life> {
        let (world, bus, process, run) = (self.world, self.bus, self.process, self.run);
        let plan = plan(self.drive, run)?;
        let (reads, writes) = topics(self.name)?;
        let there = |name: &&String| !self.gone.contains(name);
        let consumers = |topic: Topic| plan.consumers_of(topic).iter().filter(there).cloned().collect::<Vec<String>>();
        let open = |topic: Topic| output(bus, process, topic, run, &consumers(topic));
        let mouth = open(Topic::Health);
        let inputs = reads.iter().map(|topic| (input(bus, process, *topic), qos(*topic).window)).collect();
        let ear = input(bus, process, Topic::Health);
        let outputs = writes.iter().map(|topic| open(*topic)).collect();
        let mut shelf = SimulatedShelf { world: world.clone(), process, service: self.name.into() };
        if !world.borrow().disk.stores.contains_key(self.name) {
            shelf.commit(vec![beginning(run)])?;
        }
        let measured =
            shelf.last(Table::Spool)?.map_or(0, |last| 1 + last.iter().fold(0, |n, b| n << 8 | u64::from(*b)));
        let keeps_generations = writes.iter().any(|topic| topic.resumes());
        let file = PathBuf::from(format!("{}.redb", self.name));
        let store = Some(Store::over(Box::new(shelf), &file, run, keeps_generations)?);
        let host = Box::new(SimulatedHost { process, world: world.clone() });
        let name = self.name.to_owned();
        let runtime = Runtime::with(Ends { name, plan, host, inputs, outputs, mouth, ear, orders: None, store });
        let future: Pin<Box<dyn Future<Output = Result<()>>>> = match self.name {
            "sensor" => {
                let is_live = self.drive.is_live();
                let measured = if is_live { measured } else { 0 };
                let mut sensor = Recording::new(&self.drive.messages(), is_live, measured);
                let mut runtime = runtime;
                Box::pin(async move {
                    let end = play::play(&mut runtime, &mut sensor).await;
                    last_words(runtime, end)
                })
            }
            "odometry" => serve(runtime, self.drive.odometry()?),
            "localizer" => serve(runtime, self.drive.localizer()?),
            "mapper" => serve(runtime, self.drive.mapper()?),
            _ => {
                let service = PublisherService::new(publisher(), PathBuf::new(), Default::default())?;
                serve(runtime, service.saving_by(Box::new(SimulatedFolder { world: world.clone(), process })))
            }
        };
        Ok(Life { process, future, rung: 0 })
    }
}

fn serve(mut runtime: Runtime, mut service: impl Service + 'static) -> Pin<Box<dyn Future<Output = Result<()>>>> {
    Box::pin(async move {
        let end = life::serve(&mut runtime, &mut service).await;
        last_words(runtime, end)
    })
}

fn last_words(mut runtime: Runtime, end: Result<()>) -> Result<()> {
    if let Err(error) = &end {
        runtime.fail(&error.to_string());
    }
    end
}
