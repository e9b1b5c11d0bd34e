//! iceoryx2: shared memory with services; publish-subscribe twice, and request-response.
//!
//! It makes its own mappings, so that these rows share the round and its order with the others,
//! but not the memory.

use std::hint::spin_loop;
use std::time::Duration;

use iceoryx2::port::client::Client as RequestPort;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::server::Server as ResponsePort;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    Config, FileName, LogLevel, Node, NodeBuilder, Path, SemanticString, ServiceName,
    SignalHandlingMode, ipc, set_log_level,
};

use super::contestant::{Client, Contestant, Server, Setup};
use crate::Result;

/// Nobody sleeps longer without a look.
const NAP: Duration = Duration::from_secs(1);

/// Opens a service for requests and one for answers, both polled.
pub(super) fn open_publish_subscribe<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    Ok(Box::new(PublishSubscribe(Family::new(setup)?)))
}

/// Opens a request-response service, polled.
pub(super) fn open_request_response<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    Ok(Box::new(RequestResponse {
        family: Family::new(setup)?,
        events: false,
    }))
}

/// Opens a request-response service, with an event service a direction to sleep on.
pub(super) fn open_events<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    Ok(Box::new(RequestResponse {
        family: Family::new(setup)?,
        events: true,
    }))
}

/// Where the services of one contestant are found.
struct Family {
    config: Config,
    name: String,
}

impl Family {
    fn new(setup: &Setup<'_>) -> Result<Self> {
        let mut config = Config::default();
        let directory = setup
            .directory
            .to_str()
            .ok_or("the directory has a strange name")?;
        config
            .global
            .set_root_path(&Path::new(directory.as_bytes())?);
        config.global.prefix = FileName::new(setup.prefix.as_bytes())?;
        Ok(Self {
            config,
            name: setup.service.clone(),
        })
    }

    /// Begins to take part, in the process that calls.
    fn node(&self) -> Result<Node<ipc::Service>> {
        set_log_level(LogLevel::Error);
        let builder = NodeBuilder::new().signal_handling_mode(SignalHandlingMode::Disabled);
        Ok(builder.config(&self.config).create()?)
    }

    fn service(&self, what: &str) -> Result<ServiceName> {
        Ok(ServiceName::new(&format!("{}/{what}", self.name))?)
    }
}

struct PublishSubscribe(Family);

impl PublishSubscribe {
    fn end(&self, publish: &str, subscribe: &str) -> Result<Topics> {
        let node = self.0.node()?;
        let topic = |name| -> Result<_> {
            let builder = node.service_builder(&self.0.service(name)?);
            Ok(builder.publish_subscribe::<u32>().open_or_create()?)
        };
        Ok(Topics {
            publisher: topic(publish)?.publisher_builder().create()?,
            subscriber: topic(subscribe)?.subscriber_builder().create()?,
            _node: node,
        })
    }
}

impl Contestant for PublishSubscribe {
    fn client<'a>(self: Box<Self>) -> Result<Box<dyn Client + 'a>>
    where
        Self: 'a,
    {
        Ok(Box::new(self.end("request", "answer")?))
    }

    fn server<'a>(self: Box<Self>) -> Result<Box<dyn Server + 'a>>
    where
        Self: 'a,
    {
        Ok(Box::new(self.end("answer", "request")?))
    }
}

/// One process of two services.
struct Topics {
    publisher: Publisher<ipc::Service, u32, ()>,
    subscriber: Subscriber<ipc::Service, u32, ()>,
    _node: Node<ipc::Service>,
}

impl Topics {
    fn publish(&self, value: u32) -> Result<()> {
        self.publisher.loan_uninit()?.write_payload(value).send()?;
        Ok(())
    }

    fn receive(&self) -> Result<u32> {
        loop {
            if let Some(sample) = self.subscriber.receive()? {
                return Ok(*sample);
            }
            spin_loop();
        }
    }
}

impl Client for Topics {
    fn call(&mut self, value: u32) -> Result<u32> {
        self.publish(value)?;
        self.receive()
    }
}

impl Server for Topics {
    fn serve(&mut self, count: u32) -> Result<()> {
        for _ in 0..count {
            let value = self.receive()?;
            self.publish(value)?;
        }
        Ok(())
    }
}

struct RequestResponse {
    family: Family,
    events: bool,
}

impl RequestResponse {
    /// How a process waits that rings `ring` and is rung by `listen`.
    fn waiting(&self, node: &Node<ipc::Service>, ring: &str, listen: &str) -> Result<Waiting> {
        if !self.events {
            return Ok(Waiting::Spin);
        }
        let event = |name| -> Result<_> {
            let builder = node.service_builder(&self.family.service(name)?);
            Ok(builder.event().open_or_create()?)
        };
        Ok(Waiting::Sleep {
            notifier: event(ring)?.notifier_builder().create()?,
            listener: event(listen)?.listener_builder().create()?,
        })
    }
}

impl Contestant for RequestResponse {
    fn client<'a>(self: Box<Self>) -> Result<Box<dyn Client + 'a>>
    where
        Self: 'a,
    {
        let node = self.family.node()?;
        let builder = node.service_builder(&self.family.service("call")?);
        let service = builder.request_response::<u32, u32>().open_or_create()?;
        let port = service.client_builder().create()?;
        let waiting = self.waiting(&node, "asked", "answered")?;
        Ok(Box::new(Asking {
            port,
            waiting,
            _node: node,
        }))
    }

    fn server<'a>(self: Box<Self>) -> Result<Box<dyn Server + 'a>>
    where
        Self: 'a,
    {
        let node = self.family.node()?;
        let builder = node.service_builder(&self.family.service("call")?);
        let service = builder.request_response::<u32, u32>().open_or_create()?;
        let port = service.server_builder().create()?;
        let waiting = self.waiting(&node, "answered", "asked")?;
        Ok(Box::new(Answering {
            port,
            waiting,
            _node: node,
        }))
    }
}

/// What a process does until there is something for it.
#[expect(clippy::large_enum_variant, reason = "there is one of it in a process")]
enum Waiting {
    Spin,
    Sleep {
        notifier: Notifier<ipc::Service>,
        listener: Listener<ipc::Service>,
    },
}

impl Waiting {
    fn ring(&self) -> Result<()> {
        if let Self::Sleep { notifier, .. } = self {
            notifier.notify()?;
        }
        Ok(())
    }

    fn wait(&self) -> Result<()> {
        match self {
            Self::Spin => spin_loop(),
            Self::Sleep { listener, .. } => {
                listener.timed_wait(|_| (), NAP)?;
            }
        }
        Ok(())
    }
}

struct Asking {
    port: RequestPort<ipc::Service, u32, (), u32, ()>,
    waiting: Waiting,
    _node: Node<ipc::Service>,
}

impl Client for Asking {
    fn call(&mut self, value: u32) -> Result<u32> {
        let pending = self.port.loan_uninit()?.write_payload(value).send()?;
        self.waiting.ring()?;
        loop {
            if let Some(response) = pending.receive()? {
                return Ok(*response);
            }
            self.waiting.wait()?;
        }
    }
}

struct Answering {
    port: ResponsePort<ipc::Service, u32, (), u32, ()>,
    waiting: Waiting,
    _node: Node<ipc::Service>,
}

impl Server for Answering {
    fn serve(&mut self, count: u32) -> Result<()> {
        for _ in 0..count {
            let request = loop {
                if let Some(request) = self.port.receive()? {
                    break request;
                }
                self.waiting.wait()?;
            };
            request.loan_uninit()?.write_payload(*request).send()?;
            self.waiting.ring()?;
        }
        Ok(())
    }
}
