//! iceoryx2: shared memory with services; publish-subscribe twice, and request-response.
//!
//! It makes its own mappings, so that these rows share the round and its order with the others,
//! but not the memory.

use std::hint::spin_loop;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{
    Config, FileName, LogLevel, Node, NodeBuilder, Path, SemanticString, ServiceName,
    SignalHandlingMode, ipc, set_log_level,
};

use super::contestant::{Ends, Setup};
use crate::Result;

/// Nobody sleeps longer without a look.
const NAP: Duration = Duration::from_secs(1);

/// Opens a service for requests and one for answers, both polled.
pub(super) fn open_publish_subscribe<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    let family = Family::new(setup)?;
    let join = move |publish, subscribe| {
        let node = family.node()?;
        let topic = |name| -> Result<_> {
            let builder = node.service_builder(&family.service(name)?);
            Ok(builder.publish_subscribe::<u32>().open_or_create()?)
        };
        let publisher = topic(publish)?.publisher_builder().create()?;
        let subscriber = topic(subscribe)?.subscriber_builder().create()?;
        let send = move |value| -> Result<()> {
            publisher.loan_uninit()?.write_payload(value).send()?;
            Ok(())
        };
        let receive = move || -> Result<u32> {
            // It ends with its last port.
            let _ = &node;
            loop {
                if let Some(sample) = subscriber.receive()? {
                    return Ok(*sample);
                }
                spin_loop();
            }
        };
        Ok::<_, Box<dyn std::error::Error>>((send, receive))
    };
    let join_server = join.clone();
    Ok(Ends::new(
        move || {
            let (send, receive) = join("request", "answer")?;
            Ok(move |value| {
                send(value)?;
                receive()
            })
        },
        move || {
            let (send, receive) = join_server("answer", "request")?;
            Ok(move |count| {
                for _ in 0..count {
                    send(receive()?)?;
                }
                Ok(())
            })
        },
    ))
}

/// Opens a request-response service, polled.
pub(super) fn open_request_response<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    open_calls(setup, false)
}

/// Opens a request-response service, with an event service a direction to sleep on.
pub(super) fn open_events<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    open_calls(setup, true)
}

fn open_calls<'m>(setup: &Setup<'m>, events: bool) -> Result<Ends<'m>> {
    let family = Family::new(setup)?;
    let of_server = family.clone();
    Ok(Ends::new(
        move || {
            let node = family.node()?;
            let builder = node.service_builder(&family.service("call")?);
            let service = builder.request_response::<u32, u32>().open_or_create()?;
            let port = service.client_builder().create()?;
            let waiting = family.waiting(&node, events.then_some(["asked", "answered"]))?;
            Ok(move |value| {
                // It ends with its last port.
                let _ = &node;
                let pending = port.loan_uninit()?.write_payload(value).send()?;
                waiting.ring()?;
                loop {
                    if let Some(response) = pending.receive()? {
                        return Ok(*response);
                    }
                    waiting.wait()?;
                }
            })
        },
        move || {
            let node = of_server.node()?;
            let builder = node.service_builder(&of_server.service("call")?);
            let service = builder.request_response::<u32, u32>().open_or_create()?;
            let port = service.server_builder().create()?;
            let waiting = of_server.waiting(&node, events.then_some(["answered", "asked"]))?;
            Ok(move |count| {
                let _ = &node;
                for _ in 0..count {
                    let request = loop {
                        if let Some(request) = port.receive()? {
                            break request;
                        }
                        waiting.wait()?;
                    };
                    request.loan_uninit()?.write_payload(*request).send()?;
                    waiting.ring()?;
                }
                Ok(())
            })
        },
    ))
}

/// Where the services of one contestant are found.
#[derive(Clone)]
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

    /// How a process waits that rings the first of two event services, and is rung by the second.
    fn waiting(&self, node: &Node<ipc::Service>, events: Option<[&str; 2]>) -> Result<Waiting> {
        let Some([ring, listen]) = events else {
            return Ok(Waiting(None));
        };
        let event = |name| -> Result<_> {
            let builder = node.service_builder(&self.service(name)?);
            Ok(builder.event().open_or_create()?)
        };
        let notifier = event(ring)?.notifier_builder().create()?;
        let listener = event(listen)?.listener_builder().create()?;
        Ok(Waiting(Some((notifier, listener))))
    }
}

/// What a process does until there is something for it: it sleeps, or spins.
struct Waiting(Option<(Notifier<ipc::Service>, Listener<ipc::Service>)>);

impl Waiting {
    fn ring(&self) -> Result<()> {
        if let Some((notifier, _)) = &self.0 {
            notifier.notify()?;
        }
        Ok(())
    }

    fn wait(&self) -> Result<()> {
        match &self.0 {
            None => spin_loop(),
            Some((_, listener)) => {
                listener.timed_wait(|_| (), NAP)?;
            }
        }
        Ok(())
    }
}
