//! What viewers ask for, one after the other, in a thread of its own: a service may take its time.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use echogrid_core::{Fix, Pose2};
use echogrid_service::onlooker::Operator;
use echogrid_service::{Plan, in_words};
use echogrid_topics::{Command, Domain};
use serde::Deserialize;
use serde_json::Value;

use crate::hub::Hub;
use crate::protocol::Said;
use crate::why;

/// So many orders wait at most.
const QUEUE: usize = 16;
/// Writing a large map to a slow disk takes its time.
const SAVED_WITHIN: Duration = Duration::from_secs(60);
/// Between two steps of a service.
const DONE_WITHIN: Duration = Duration::from_secs(10);

/// The answer to an order.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) id: u64,
    pub(crate) ok: bool,
    pub(crate) text: String,
    pub(crate) why: Option<Value>,
}

/// Something to be done.
#[derive(Debug)]
enum Order {
    /// A viewer wants it.
    Of(Said, Sender<Answer>),
    /// The feed misses tiles.
    WholeMap,
}

/// Where orders are given.
#[derive(Debug, Clone)]
pub(crate) struct Orders(SyncSender<Order>);

impl Orders {
    /// Starts to carry out orders in `domain`.
    pub(crate) fn start(domain: Domain, hub: Arc<Hub>) -> Result<Self> {
        let (sender, orders) = sync_channel(QUEUE);
        let work = move || carry_out(&domain, &hub, &orders);
        std::thread::Builder::new().name("orders".into()).spawn(work).context("starting a thread")?;
        Ok(Self(sender))
    }

    /// Has a viewer's order carried out; the answer goes to `answers`.
    pub(crate) fn give(&self, said: Said, answers: &Sender<Answer>) {
        if self.0.try_send(Order::Of(said, answers.clone())).is_err() {
            let text = "too much is asked at a time: ask again".to_owned();
            let _ = answers.send(Answer { id: id_of(&said), ok: false, text, why: None });
        }
    }

    /// Asks the mapper for every tile once more.
    pub(crate) fn ask_for_the_whole_map(&self) {
        // Where the queue is full the feed asks again.
        let _ = self.0.try_send(Order::WholeMap);
    }
}

fn id_of(said: &Said) -> u64 {
    match *said {
        Said::Save { id } | Said::Pause { id } | Said::Resume { id } | Said::Fix { id, .. } | Said::Why { id, .. } => {
            id
        }
        Said::Layer { .. } => 0,
    }
}

/// Until nobody can give orders any more.
fn carry_out(domain: &Domain, hub: &Hub, orders: &Receiver<Order>) {
    while let Ok(order) = orders.recv() {
        match order {
            Order::WholeMap => {
                // It is asked for again as long as tiles are missing.
                if let Err(error) = whole_map(domain) {
                    tracing::debug!("asking for the whole map: {}", in_words(&error));
                }
            }
            Order::Of(said, answers) => {
                let done = obey(domain, hub, &said);
                let ok = done.is_ok();
                let (text, why) = done.unwrap_or_else(|error| (in_words(&error), None));
                // A viewer that has left needs no answer.
                let _ = answers.send(Answer { id: id_of(&said), ok, text, why });
            }
        }
    }
}

/// What is read of `[run]`.
#[derive(Debug, Deserialize)]
struct Run {
    out: PathBuf,
}

/// The graph as it is now: it may have been made anew since the last order.
fn enter(domain: &Domain) -> Result<Operator> {
    Operator::enter(domain, "echogrid live orders")
}

fn keeps_readings(plan: &Plan) -> bool {
    let key = plan.config.get("mapper").and_then(|mapper| mapper.get("keep_readings"));
    key.and_then(toml::Value::as_bool).unwrap_or(false)
}

fn obey(domain: &Domain, hub: &Hub, said: &Said) -> Result<(String, Option<Value>)> {
    let graph = enter(domain)?;
    let done = match *said {
        Said::Save { .. } => {
            let map = graph.order("publisher", Command::Save, SAVED_WITHIN)?;
            // After the map: what it is made of must be among them.
            let readings =
                keeps_readings(graph.plan()).then(|| graph.order("mapper", Command::Save, SAVED_WITHIN)).transpose()?;
            readings.map_or(map.clone(), |readings| format!("{map}; {readings}"))
        }
        Said::Pause { .. } => graph.order("mapper", Command::Pause, DONE_WITHIN)?,
        Said::Resume { .. } => graph.order("mapper", Command::Resume, DONE_WITHIN)?,
        Said::Fix { x, y, theta, sigma_m, sigma_rad, .. } => {
            let fix = Fix::about(Pose2::new(x, y, theta), sigma_m, sigma_rad);
            graph.order("odometry", Command::Fix(fix), DONE_WITHIN)?
        }
        Said::Why { x, y, .. } => {
            ensure!(
                keeps_readings(graph.plan()),
                "no readings are kept; start the graph with --set mapper.keep_readings=true, and ask then"
            );
            graph.order("mapper", Command::Save, SAVED_WITHIN)?;
            let run: Run = graph.plan().section("run")?;
            return why::answer(hub, &run.out, [x, y]).map(|why| (String::new(), Some(why)));
        }
        Said::Layer { .. } => String::new(),
    };
    Ok((done, None))
}

fn whole_map(domain: &Domain) -> Result<()> {
    enter(domain)?.order("mapper", Command::Tiles, DONE_WITHIN).map(drop)
}
