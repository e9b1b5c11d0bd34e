//! What the kernel offers to wait for another process: sockets and event counters.

use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::event::{EventfdFlags, eventfd};

use super::contestant::{Client, Contestant, Server, Setup};
use crate::Result;

/// Opens a stream socket of the Unix domain; both sides block in it.
pub(super) fn open_unix_socket<'m>(_: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    let (client, server) = UnixStream::pair()?;
    Ok(Box::new(Sockets { client, server }))
}

/// Opens two event counters beside two words of the mapping.
pub(super) fn open_eventfd<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    Ok(Box::new(Counters {
        request: setup.place.line(0),
        answer: setup.place.line(2),
        asked: eventfd(0, EventfdFlags::CLOEXEC)?,
        answered: eventfd(0, EventfdFlags::CLOEXEC)?,
    }))
}

struct Sockets {
    client: UnixStream,
    server: UnixStream,
}

impl Contestant for Sockets {
    fn client<'a>(self: Box<Self>) -> Result<Box<dyn Client + 'a>>
    where
        Self: 'a,
    {
        Ok(Box::new(Socket(self.client)))
    }

    fn server<'a>(self: Box<Self>) -> Result<Box<dyn Server + 'a>>
    where
        Self: 'a,
    {
        Ok(Box::new(Socket(self.server)))
    }
}

struct Socket(UnixStream);

impl Socket {
    fn receive(&mut self) -> Result<u32> {
        let mut bytes = [0; 4];
        self.0.read_exact(&mut bytes)?;
        Ok(u32::from_le_bytes(bytes))
    }
}

impl Client for Socket {
    fn call(&mut self, value: u32) -> Result<u32> {
        self.0.write_all(&value.to_le_bytes())?;
        self.receive()
    }
}

impl Server for Socket {
    fn serve(&mut self, count: u32) -> Result<()> {
        for _ in 0..count {
            let value = self.receive()?;
            self.0.write_all(&value.to_le_bytes())?;
        }
        Ok(())
    }
}

struct Counters<'m> {
    request: &'m AtomicU32,
    answer: &'m AtomicU32,
    asked: OwnedFd,
    answered: OwnedFd,
}

/// Stores `value` where the other side looks, and rings.
fn publish(word: &AtomicU32, value: u32, bell: &OwnedFd) -> Result<()> {
    // Pairs with the `Acquire` load in `wait`.
    word.store(value, Ordering::Release);
    rustix::io::write(bell, &1_u64.to_ne_bytes())?;
    Ok(())
}

/// Sleeps until it rings, and loads what was stored.
fn wait(word: &AtomicU32, bell: &OwnedFd) -> Result<u32> {
    rustix::io::read(bell, &mut [0_u8; 8])?;
    // Pairs with the `Release` store in `publish`.
    Ok(word.load(Ordering::Acquire))
}

impl Contestant for Counters<'_> {
    fn client<'a>(self: Box<Self>) -> Result<Box<dyn Client + 'a>>
    where
        Self: 'a,
    {
        Ok(self)
    }

    fn server<'a>(self: Box<Self>) -> Result<Box<dyn Server + 'a>>
    where
        Self: 'a,
    {
        Ok(self)
    }
}

impl Client for Counters<'_> {
    fn call(&mut self, value: u32) -> Result<u32> {
        publish(self.request, value, &self.asked)?;
        wait(self.answer, &self.answered)
    }
}

impl Server for Counters<'_> {
    fn serve(&mut self, count: u32) -> Result<()> {
        for _ in 0..count {
            let value = wait(self.request, &self.asked)?;
            publish(self.answer, value, &self.answered)?;
        }
        Ok(())
    }
}
