//! A process in a domain: its iceoryx2 node, and how it opens topics.

use std::path::Path as StdPath;
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::node::Node;
use iceoryx2::prelude::{
    AttributeVerifier, FilePath, LogLevel, NodeBuilder, NodeName, SemanticString, ServiceName, SignalHandlingMode, ipc,
    set_log_level_from_env_or,
};
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::domain::{Domain, DomainError, Membership};
use crate::topic::Topic;
use crate::wire::{Header, Wire};

/// The event that says "there are new messages".
pub(crate) const SENT: usize = 0;
/// How long a topic may take to appear: the launcher creates all before it starts anyone.
const OPEN_WITHIN: Duration = Duration::from_secs(2);

/// Processes per topic, tools included.
pub(crate) const MAX_NODES: usize = 32;

pub(crate) type Sized<W> = publish_subscribe::PortFactory<ipc::Service, W, Header>;
pub(crate) type Slice<W> = publish_subscribe::PortFactory<ipc::Service, [W], Header>;
pub(crate) type Bell = event::PortFactory<ipc::Service>;

/// Why a topic can't be used.
#[derive(Debug, thiserror::Error)]
pub enum TopicError {
    /// The domain can't be used.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// The process could not enter the shared memory.
    #[error("entering domain {domain:?} as {name:?}: {reason}")]
    Node {
        /// The domain.
        domain: String,
        /// The process.
        name: String,
        /// What iceoryx2 said.
        reason: String,
    },
    /// A topic could not be made, opened, written or read.
    #[error("topic {topic}: {what}: {reason}")]
    Topic {
        /// The topic.
        topic: String,
        /// What was tried.
        what: &'static str,
        /// What iceoryx2 said.
        reason: String,
    },
    /// The other side speaks another version.
    #[error("topic {topic}: this program speaks {mine}, the graph another version or type: {reason}")]
    Version {
        /// The topic.
        topic: String,
        /// Our message type.
        mine: &'static str,
        /// What iceoryx2 said.
        reason: String,
    },
}

/// A process in a domain.
#[derive(Debug)]
pub struct Participant {
    domain: Domain,
    node: Node<ipc::Service>,
    // After the node: who holds no membership any more has left shared memory.
    _membership: Membership,
}

impl Participant {
    /// Enters a domain that a launcher made.
    ///
    /// # Errors
    /// No launcher runs there, or shared memory refuses.
    pub fn join(domain: &Domain, name: &str) -> Result<Self, TopicError> {
        let membership = domain.join()?;
        let node = make_node(domain, name)?;
        Ok(Self { domain: domain.clone(), node, _membership: membership })
    }

    /// Where it is.
    pub(crate) fn domain(&self) -> &Domain {
        &self.domain
    }

    pub(crate) fn node(&self) -> &Node<ipc::Service> {
        &self.node
    }

    pub(crate) fn sized<W: Wire>(&self, topic: Topic) -> Result<Sized<W>, TopicError> {
        open(topic, W::SCHEMA, || {
            let builder = self.node.service_builder(&service_name(topic.name())?).publish_subscribe::<W>();
            Ok(builder.user_header::<Header>().open_with_attributes(&verifier(W::SCHEMA)?))
        })
    }

    pub(crate) fn slice<W: Wire>(&self, topic: Topic) -> Result<Slice<W>, TopicError> {
        open(topic, W::SCHEMA, || {
            let builder = self.node.service_builder(&service_name(topic.name())?).publish_subscribe::<[W]>();
            Ok(builder.user_header::<Header>().open_with_attributes(&verifier(W::SCHEMA)?))
        })
    }

    pub(crate) fn bell(&self, topic: Topic) -> Result<Bell, TopicError> {
        self.bell_of(topic.name())
    }

    /// The event of the topic of this name.
    pub(crate) fn bell_of(&self, topic: &str) -> Result<Bell, TopicError> {
        let builder = self.node.service_builder(&service_name(topic)?);
        builder.event().open().map_err(|e| failed(topic, "opening its event", e))
    }
}

fn make_node(domain: &Domain, name: &str) -> Result<Node<ipc::Service>, TopicError> {
    set_log_level_from_env_or(LogLevel::Fatal);
    let failed = |reason: String| TopicError::Node { domain: domain.name().into(), name: name.into(), reason };
    // The global configuration, not only the node's: cleaning up after the dead falls back to it.
    let path = domain.iceoryx2_config();
    let file = FilePath::new(path_bytes(&path)).map_err(|e| failed(format!("{}: {e:?}", path.display())))?;
    let config =
        Config::setup_global_config_from_file(&file).map_err(|e| failed(format!("{}: {e:?}", path.display())))?;
    NodeBuilder::new()
        .name(&NodeName::new(name).map_err(|e| failed(format!("{e:?}")))?)
        // Signals are the service loop's own business; iceoryx2's handlers swallow fifteen of them.
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(config)
        .create::<ipc::Service>()
        .map_err(|e| failed(e.to_string()))
}

pub(crate) fn path_bytes(path: &StdPath) -> &[u8] {
    use std::os::unix::ffi::OsStrExt;
    path.as_os_str().as_bytes()
}

pub(crate) fn service_name(topic: &str) -> Result<ServiceName, TopicError> {
    ServiceName::new(topic).map_err(|e| failed(topic, "naming it", format!("{e:?}")))
}

pub(crate) fn attribute_failed(e: impl core::fmt::Debug) -> TopicError {
    failed("schema", "setting the attribute", format!("{e:?}"))
}

pub(crate) fn verifier(schema: &str) -> Result<AttributeVerifier, TopicError> {
    let key = "schema".try_into().map_err(attribute_failed)?;
    let value = schema.try_into().map_err(attribute_failed)?;
    AttributeVerifier::new().require(&key, &value).map_err(attribute_failed)
}

/// Opens a topic; waits for one that is still being made.
fn open<F>(
    topic: Topic,
    mine: &'static str,
    mut attempt: impl FnMut() -> Result<Result<F, PublishSubscribeOpenError>, TopicError>,
) -> Result<F, TopicError> {
    use PublishSubscribeOpenError as E;
    let deadline = Instant::now() + OPEN_WITHIN;
    loop {
        match attempt()? {
            Ok(factory) => return Ok(factory),
            Err(E::IncompatibleTypes | E::IncompatibleAttributes) => {
                return Err(TopicError::Version {
                    topic: topic.name().into(),
                    mine,
                    reason: "incompatible message type".into(),
                });
            }
            Err(E::DoesNotExist | E::HangsInCreation) if Instant::now() < deadline => {
                // iceoryx2 offers nothing to wait on for a service that does not exist yet.
                std::thread::sleep(Duration::from_millis(5));
            }
            Err(e) => return Err(failed(topic, "opening it", e)),
        }
    }
}

pub(crate) fn failed(topic: impl AsRef<str>, what: &'static str, reason: impl ToString) -> TopicError {
    TopicError::Topic { topic: topic.as_ref().to_owned(), what, reason: reason.to_string() }
}
