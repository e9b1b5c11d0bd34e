//! [`Proxy`]: hands on connections, cuts them, and lets them fall silent.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use crate::system::Outcome;

/// A proxy before a port of this machine.
pub(crate) struct Proxy {
    port: u16,
    open: Arc<Mutex<Vec<TcpStream>>>,
    is_silent: Arc<AtomicBool>,
}

impl Proxy {
    pub(crate) fn before(to: u16) -> Outcome<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let port = listener.local_addr()?.port();
        let open = Arc::new(Mutex::new(Vec::new()));
        let is_silent = Arc::new(AtomicBool::new(false));
        let (all, silent) = (open.clone(), is_silent.clone());
        thread::spawn(move || {
            for client in listener.incoming().flatten() {
                // Who listens there may have been killed.
                if let Ok(server) = TcpStream::connect(("127.0.0.1", to)) {
                    let _ = hand_on(client, server, &all, &silent);
                }
            }
        });
        Ok(Self {
            port,
            open,
            is_silent,
        })
    }

    /// From now on nothing is handed on any more, and no connection ends, as when a cable is pulled out.
    pub(crate) fn fall_silent(&self) {
        // It orders nothing else.
        self.is_silent.store(true, Ordering::Relaxed);
    }

    /// The place for clients of zenoh.
    pub(crate) fn place(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.port)
    }

    /// Cuts all connections that there are; returns their number. What is on its way is lost.
    pub(crate) fn cut(&self) -> usize {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        for stream in open.iter() {
            // It may have ended.
            let _ = stream.shutdown(Shutdown::Both);
        }
        open.drain(..).count() / 2
    }
}

fn hand_on(
    client: TcpStream,
    server: TcpStream,
    all: &Mutex<Vec<TcpStream>>,
    is_silent: &Arc<AtomicBool>,
) -> std::io::Result<()> {
    for (from, to) in [(&client, &server), (&server, &client)] {
        let (mut from, mut to) = (from.try_clone()?, to.try_clone()?);
        let is_silent = is_silent.clone();
        thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = from.read(&mut bytes) {
                if is_silent.load(Ordering::Relaxed) {
                    continue;
                }
                if to.write_all(&bytes[..count]).is_err() {
                    break;
                }
            }
            let _ = from.shutdown(Shutdown::Both);
            let _ = to.shutdown(Shutdown::Both);
        });
    }
    let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
    all.extend([client, server]);
    Ok(())
}
