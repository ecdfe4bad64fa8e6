//! Orders to a running service, and its answers.
//!
//! Each service of a graph has a request-response service `control/<name>` and an event service of
//! the same name: event 0 wakes the server, event 1 the client.

use std::os::fd::BorrowedFd;
use std::time::{Duration, Instant};

use echogrid_core::{Fix, Pose2};
use iceoryx2::node::Node;
use iceoryx2::port::client::Client;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::{BackpressureStrategy, EventId, FileDescriptorBased, ServiceName, ipc};
use iceoryx2::service::port_factory::{event, request_response};
use serde::{Deserialize, Serialize};

use crate::participant::{Participant, TopicError};
use crate::wire::{ZeroCopySend, bytes_to_text, text_to_bytes, wire};

const REQUEST: usize = 0;
const REPLY: usize = 1;
/// A process that has not answered may be dead: so soon the next one hears the order, too.
const REPEAT_AFTER: Duration = Duration::from_secs(1);
/// Clients at a time, and as many as may be left of crashed ones.
const CLIENTS: usize = 8;

type Factory = request_response::PortFactory<ipc::Service, ControlRequestWire, (), ControlReplyWire, ()>;
type ClientPort = Client<ipc::Service, ControlRequestWire, (), ControlReplyWire, ()>;
type ServerPort = Server<ipc::Service, ControlRequestWire, (), ControlReplyWire, ()>;

wire! {
    /// `control`, request to one service.
    "echogrid/ControlRequest/2" ControlRequestWire {
        /// The same on every repetition: a request is carried out once.
        id: u64,
        /// 1 save, 2 pause, 3 resume, 5 fix, 6 drive.
        command: u32,
        /// Zero.
        reserved: u32,
        /// For a fix: x, y (metres), θ (radians), standard deviations of position (metres) and heading (radians).
        /// For driving: forward speed (m/s), turn rate (rad/s).
        arguments: [f64; 5],
    }
}

wire! {
    /// `control`, reply.
    "echogrid/ControlReply/1" ControlReplyWire {
        /// Of the request.
        id: u64,
        /// 1 done, 0 refused.
        done: u32,
        /// Zero.
        reserved: u32,
        /// What was done, or why not; UTF-8, padded with zeros.
        text: [u8; 480],
    }
}

/// What a service can be told.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Command {
    /// Save what you have.
    Save,
    /// Map nothing until told to resume.
    Pause,
    /// Go on mapping.
    Resume,
    /// The robot is here now.
    Fix(Fix),
    /// Tell every tile of the map once more: who looks on came late, or fell behind.
    Tiles,
    /// Drive like this until told otherwise.
    Drive {
        /// Forward speed, m/s.
        v_mps: f64,
        /// Turn rate, rad/s, counter-clockwise.
        w_radps: f64,
    },
}

impl Command {
    /// The command as people say it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Save => "save",
            Self::Pause => "pause",
            Self::Resume => "resume",
            Self::Fix(_) => "fix",
            Self::Tiles => "tell tiles",
            Self::Drive { .. } => "drive",
        }
    }

    fn request(self, id: u64) -> ControlRequestWire {
        let (command, arguments) = match self {
            Self::Save => (1, [0.0; 5]),
            Self::Pause => (2, [0.0; 5]),
            Self::Resume => (3, [0.0; 5]),
            Self::Fix(Fix { pose: Pose2 { x, y, theta }, covariance, .. }) => {
                (5, [x, y, theta, covariance[(0, 0)].sqrt(), covariance[(2, 2)].sqrt()])
            }
            Self::Tiles => (7, [0.0; 5]),
            Self::Drive { v_mps, w_radps } => (6, [v_mps, w_radps, 0.0, 0.0, 0.0]),
        };
        ControlRequestWire { id, command, reserved: 0, arguments }
    }

    /// What a request says; its numbers are for whoever carries it out to check.
    #[must_use]
    pub fn of(request: &ControlRequestWire) -> Option<Self> {
        let [a, b, c, d, e] = request.arguments;
        Some(match request.command {
            1 => Self::Save,
            2 => Self::Pause,
            3 => Self::Resume,
            5 => Self::Fix(Fix::about(Pose2 { x: a, y: b, theta: c }, d, e)),
            7 => Self::Tiles,
            6 => Self::Drive { v_mps: a, w_radps: b },
            _ => return None,
        })
    }
}

/// Where a service hears orders.
#[derive(Debug)]
pub struct ControlServer {
    server: ServerPort,
    bell: Notifier<ipc::Service>,
    listener: Listener<ipc::Service>,
    /// The last order carried out: a repeated one gets the same answer.
    last: Option<ControlReplyWire>,
}

impl ControlServer {
    /// Opens the orders to `service`; the launcher made the topic.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn open(participant: &Participant, service: &str) -> Result<Self, TopicError> {
        let name = name(service)?;
        let events = participant.node().service_builder(&name).event().open().map_err(|e| failed("opening", e))?;
        let listener = events.listener_builder().create().map_err(|e| failed("listening", e))?;
        let factory = open(participant.node(), &name)?;
        let server = factory
            .server_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| failed("serving", e))?;
        Ok(Self { server, bell: notifier(&events, REPLY)?, listener, last: None })
    }

    /// Readable when there may be an order.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the listener owns the descriptor and outlives the borrow.
        unsafe { BorrowedFd::borrow_raw(self.listener.file_descriptor().native_handle()) }
    }

    /// Answers the orders that have come; `carry_out`, which hears the number of the order, too, says what was done, or why not.
    ///
    /// # Errors
    /// Shared memory refuses.
    pub fn serve(
        &mut self,
        mut carry_out: impl FnMut(u64, Command) -> Result<String, String>,
    ) -> Result<(), TopicError> {
        self.listener.try_wait(|_| {}).map_err(|e| failed("draining its event", e))?;
        while let Some(request) = self.server.receive().map_err(|e| failed("receiving", e))? {
            let ControlRequestWire { id, command, .. } = *request;
            let reply = self.last.filter(|last| last.id == id).unwrap_or_else(|| {
                let result = match Command::of(&request) {
                    Some(command) => carry_out(id, command),
                    None => Err(format!("command {command} is not known here")),
                };
                let (done, text) = match result {
                    Ok(text) => (1, text),
                    Err(text) => (0, text),
                };
                ControlReplyWire { id, done, reserved: 0, text: text_to_bytes(&text) }
            });
            self.last = Some(reply);
            request.send_copy(reply).map_err(|e| failed("replying", e))?;
            self.bell.notify().map_err(|e| failed("notifying", e))?;
        }
        Ok(())
    }
}

/// Tells `service` to carry out `command` and waits for its answer: what was done, or why not. Should its process die, the
/// next one is told, too; it is carried out once.
///
/// # Errors
/// There is no such service in the graph, it does not answer within `patience`, the graph has ended, or shared memory refuses.
pub fn order(
    participant: &Participant,
    service: &str,
    command: Command,
    patience: Duration,
) -> Result<Result<String, String>, TopicError> {
    let name = name(service)?;
    let events = participant.node().service_builder(&name).event().open().map_err(|e| failed("opening", e))?;
    let listener = events.listener_builder().create().map_err(|e| failed("listening", e))?;
    let client: ClientPort = open(participant.node(), &name)?
        .client_builder()
        .backpressure_strategy(BackpressureStrategy::DiscardData)
        .create()
        .map_err(|e| failed("asking", e))?;
    let request = command.request(new_id());
    let bell = notifier(&events, REQUEST)?;
    let deadline = Instant::now() + patience;
    loop {
        let pending = client.send_copy(request).map_err(|e| failed("asking", e))?;
        bell.notify().map_err(|e| failed("notifying", e))?;
        let repeat = deadline.min(Instant::now() + REPEAT_AFTER);
        loop {
            if let Some(reply) = pending.receive().map_err(|e| failed("receiving", e))? {
                let text = bytes_to_text(&reply.text);
                return Ok(if reply.done == 1 { Ok(text) } else { Err(text) });
            }
            let left = repeat.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            listener.timed_wait(|_| {}, left).map_err(|e| failed("waiting", e))?;
        }
        if !participant.domain().has_launcher() {
            return Err(failed("asking", format!("the graph has ended, and {service} has not answered")));
        }
        if Instant::now() >= deadline {
            return Err(failed("asking", format!("{service} has not answered within {} s", patience.as_secs())));
        }
    }
}

/// Makes the orders to `service` possible. The launcher keeps what this gives for as long as the graph lives.
pub(crate) fn create(node: &Node<ipc::Service>, service: &str) -> Result<[Box<dyn core::fmt::Debug>; 2], TopicError> {
    let name = name(service)?;
    let orders = node
        .service_builder(&name)
        .request_response::<ControlRequestWire, ControlReplyWire>()
        .max_nodes(CLIENTS)
        .max_clients(CLIENTS)
        .max_servers(2)
        .max_active_requests_per_client(1)
        .max_response_buffer_size(1)
        .enable_safe_overflow_for_requests(false)
        .enable_safe_overflow_for_responses(false)
        .create()
        .map_err(|e| failed("creating", e))?;
    let events = node
        .service_builder(&name)
        .event()
        .max_nodes(CLIENTS)
        .max_notifiers(CLIENTS + 2)
        .max_listeners(CLIENTS + 2)
        .event_id_max_value(15)
        .create()
        .map_err(|e| failed("creating", e))?;
    Ok([Box::new(orders), Box::new(events)])
}

/// Differs between any two requests: the time, and who asks.
fn new_id() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    (since.as_nanos() as u64) << 16 ^ u64::from(std::process::id())
}

fn open(node: &Node<ipc::Service>, name: &ServiceName) -> Result<Factory, TopicError> {
    let builder = node.service_builder(name).request_response::<ControlRequestWire, ControlReplyWire>();
    builder.open().map_err(|e| failed("opening", e))
}

fn notifier(events: &event::PortFactory<ipc::Service>, id: usize) -> Result<Notifier<ipc::Service>, TopicError> {
    let builder = events.notifier_builder().default_event_id(EventId::new(id));
    builder.create().map_err(|e| failed("creating a notifier", e))
}

fn name(service: &str) -> Result<ServiceName, TopicError> {
    ServiceName::new(&format!("control/{service}")).map_err(|e| failed("naming", format!("{e:?}")))
}

fn failed(what: &'static str, reason: impl ToString) -> TopicError {
    crate::participant::failed("control", what, reason.to_string())
}
