//! iceoryx2's request-response service.
//!
//! It makes its own mappings, so that this row shares the round and its order with the others,
//! but not the memory.

use std::hint::spin_loop;

use iceoryx2::prelude::{
    Config, FileName, LogLevel, Node, NodeBuilder, Path, SemanticString, ServiceName,
    SignalHandlingMode, ipc, set_log_level,
};

use super::contestant::{Ends, Setup};
use crate::Result;

/// Opens a request-response service, polled.
pub(super) fn open_request_response<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    let family = Family::new(setup)?;
    let of_server = family.clone();
    Ok(Ends::new(
        move || {
            let node = family.node()?;
            let builder = node.service_builder(&family.service("call")?);
            let service = builder.request_response::<u32, u32>().open_or_create()?;
            let port = service.client_builder().create()?;
            Ok(move |value| {
                // The node ends with its last port.
                let _ = &node;
                let pending = port.loan_uninit()?.write_payload(value).send()?;
                loop {
                    if let Some(response) = pending.receive()? {
                        return Ok(*response);
                    }
                    spin_loop();
                }
            })
        },
        move || {
            let node = of_server.node()?;
            let builder = node.service_builder(&of_server.service("call")?);
            let service = builder.request_response::<u32, u32>().open_or_create()?;
            let port = service.server_builder().create()?;
            Ok(move |count| {
                let _ = &node;
                for _ in 0..count {
                    let request = loop {
                        if let Some(request) = port.receive()? {
                            break request;
                        }
                        spin_loop();
                    };
                    request.loan_uninit()?.write_payload(*request).send()?;
                }
                Ok(())
            })
        },
    ))
}

/// The configuration and the name under which the services of one contestant are found.
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
}
