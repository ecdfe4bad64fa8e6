//! How a life of a service begins: what it is made of, in a process and elsewhere.

use anyhow::{Context, Result};
use echogrid_topics::{ControlServer, Domain, Input as Port, Output, Participant, Topic, TopicError};

use super::Runtime;
use super::memory::Memory;
use super::ports::Ports;
use super::vitals::Vitals;
use crate::driven::Driven;
use crate::host::{Host, Orders, System};
use crate::plan::{DOMAIN_VARIABLE, GONE_VARIABLE, Plan, SERVICE_VARIABLE};
use crate::store::Store;

/// What a life of a service is made of.
#[derive(Debug)]
pub struct Ends {
    /// The service's name in the graph.
    pub name: String,
    /// The plan of the run.
    pub plan: Plan,
    /// What it runs on.
    pub host: Box<dyn Host>,
    /// What it reads, in order, and how many messages each producer may be ahead.
    pub inputs: Vec<(Port, u64)>,
    /// The outputs of the service.
    pub outputs: Vec<Output>,
    /// What it says of itself.
    pub mouth: Output,
    /// The port at which it hears of the others.
    pub ear: Port,
    /// The way by which it gets orders; none: from nobody.
    pub orders: Option<Box<dyn Orders>>,
    /// What it goes on from; none: nobody restarts it.
    pub store: Option<Store>,
}

impl Runtime {
    /// Enters the graph that the environment names (see [`DOMAIN_VARIABLE`]) as `default_name`,
    /// unless the environment names the service too.
    ///
    /// # Errors
    /// There is no such graph, or shared memory refuses.
    pub fn enter(default_name: &str, inputs: &[Topic], outputs: &[Topic]) -> Result<Self> {
        let host = Box::new(System::attach()?);
        let name = std::env::var(SERVICE_VARIABLE).unwrap_or_else(|_| default_name.into());
        let domain = std::env::var(DOMAIN_VARIABLE)
            .with_context(|| format!("{DOMAIN_VARIABLE} is not set: name the domain of a running graph (--domain)"))?;
        let domain = Domain::named(&domain)?;
        let participant = Participant::join(&domain, &name)?;
        let plan = Plan::read(&domain)?;
        let gone = std::env::var(GONE_VARIABLE).unwrap_or_default();
        let open = |topic: Topic| {
            let there = |name: &&String| gone.split(',').all(|gone| gone != name.as_str());
            let consumers: Vec<String> = plan.consumers_of(topic).iter().filter(there).cloned().collect();
            Output::open(&participant, topic, plan.max_readings, plan.epoch, &consumers)
        };
        let mouth = open(Topic::Health)?;
        // Subscribers before publishers: whoever hears of us can rely on our being able to hear.
        let read = |topic: &Topic| Ok((Port::open(&participant, *topic)?, topic.qos(plan.max_readings).window));
        let inputs =
            inputs.iter().filter(|topic| plan.takes(&name, **topic)).map(read).collect::<Result<_, TopicError>>()?;
        let ear = Port::open(&participant, Topic::Health)?;
        let outputs: Vec<Topic> = outputs.iter().copied().filter(|topic| plan.writes(&name, *topic)).collect();
        let keeps_generations = outputs.iter().any(|topic| topic.resumes());
        let outputs = outputs.iter().map(|topic| open(*topic)).collect::<Result<_, TopicError>>()?;
        // A service that joins a running graph by hand is not one that the launcher knows.
        let orders =
            std::env::var_os(SERVICE_VARIABLE).map(|_| ControlServer::open(&participant, &name)).transpose()?;
        // Nor would anybody restart it.
        let folder = plan.state.as_ref().filter(|_| orders.is_some());
        let store = folder.map(|folder| {
            Store::open(&folder.join(format!("{name}.redb")), plan.epoch, plan.synced, keeps_generations)
        });
        let orders = orders.map(|orders| Driven::over(orders, &participant, &plan, &name)).transpose()?;
        let store = store.transpose()?;
        Ok(Self::new(Ends { name, plan, host, inputs, outputs, mouth, ear, orders, store }, Some(participant)))
    }

    /// A life with these ends.
    #[must_use]
    pub fn with(ends: Ends) -> Self {
        Self::new(ends, None)
    }

    fn new(ends: Ends, participant: Option<Participant>) -> Self {
        let Ends { name, plan, host, mut inputs, outputs, mouth, ear, orders, store } = ends;
        for (port, _) in inputs.iter_mut().filter(|(port, _)| port.topic().resumes()) {
            port.resume(plan.epoch, 0, 0);
        }
        let memory = Memory::new(store, host.now());
        Self {
            name,
            plan,
            ports: Ports::new(inputs, outputs),
            vitals: Vitals::new(host, mouth, ear),
            memory,
            orders,
            is_finished: false,
            _participant: participant,
        }
    }
}
