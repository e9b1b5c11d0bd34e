//! [`Worker`]: a thread that answers calls of services, so that rows never wait for an answer.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::Scope;
use std::time::Duration;

use super::calls::{Call, Service};
use super::server::Server;
use super::simulation::{Simulation, Workshop};
use condor_host::error::AnyError;

/// The way to the thread, which ends when this is dropped.
pub(super) struct Worker {
    calls: Sender<(u64, Call)>,
    done: Receiver<CallAnswer>,
    /// Whether it has a call that is not answered yet.
    is_asked: bool,
}

/// An answer to a call of a client.
struct CallAnswer {
    client: u64,
    call: Call,
    result: Result<Vec<u8>, String>,
}

impl Worker {
    /// Starts the thread; returns the services that it has, too.
    pub(super) fn start<'scope, 'env>(
        scope: &'scope Scope<'scope, 'env>,
        workshop: Workshop<'env>,
    ) -> Result<(Self, Vec<Service>), AnyError> {
        let (calls, received) = channel::<(u64, Call)>();
        let (teller, done) = channel();
        let (opener, ready) = channel();
        scope.spawn(move || {
            let mut simulation = match Simulation::open(workshop) {
                Ok(simulation) => simulation,
                Err(error) => {
                    let _ = opener.send(Err(error.to_string()));
                    return;
                }
            };
            // The other end waits for it.
            let _ = opener.send(Ok(simulation.services().to_vec()));
            while let Ok((client, call)) = received.recv() {
                let result = simulation.answer(&call).map_err(|error| error.to_string());
                let done = CallAnswer {
                    client,
                    call,
                    result,
                };
                // Nobody listens any more at the end.
                let _ = teller.send(done);
            }
        });
        let services = ready.recv()??;
        let worker = Self {
            calls,
            done,
            is_asked: false,
        };
        Ok((worker, services))
    }

    /// Takes the next call of the clients if the thread is free, waits for an answer, at most for this
    /// time, and passes it on to its client.
    pub(super) fn turn(&mut self, server: &mut Server, wait: Duration) {
        if !self.is_asked
            && let Some(next) = server.call()
        {
            // The thread receives as long as `self` exists.
            self.is_asked = self.calls.send(next).is_ok();
        }
        if let Ok(done) = self.done.recv_timeout(wait) {
            self.is_asked = false;
            server.respond(done.client, &done.call, done.result);
        }
    }
}
