//! What the kernel offers to wait for another process: sockets and event counters.

use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::event::{EventfdFlags, eventfd};

use super::contestant::{Ends, Setup};
use crate::Result;

/// Opens a stream socket of the Unix domain; both sides block in it.
pub(super) fn open_unix_socket<'m>(_: &Setup<'m>) -> Result<Ends<'m>> {
    let (mut client, mut server) = UnixStream::pair()?;
    let call = move |value| {
        send(&mut client, value)?;
        receive(&mut client)
    };
    let serve = move |count| {
        for _ in 0..count {
            let value = receive(&mut server)?;
            send(&mut server, value)?;
        }
        Ok(())
    };
    Ok(Ends::new(|| Ok(call), || Ok(serve)))
}

fn send(stream: &mut UnixStream, value: u32) -> Result<()> {
    Ok(stream.write_all(&value.to_le_bytes())?)
}

fn receive(stream: &mut UnixStream) -> Result<u32> {
    let mut bytes = [0; 4];
    stream.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

/// Opens two event counters beside two words of the mapping.
pub(super) fn open_eventfd<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    let counter = || eventfd(0, EventfdFlags::CLOEXEC).map(Rc::new);
    let (request, answer) = (setup.place.line(0), setup.place.line(2));
    let (asked, answered) = (counter()?, counter()?);
    let (is_asked, answers) = (Rc::clone(&asked), Rc::clone(&answered));
    let call = move |value| {
        publish(request, value, &asked)?;
        wait(answer, &answered)
    };
    let serve = move |count| {
        for _ in 0..count {
            let value = wait(request, &is_asked)?;
            publish(answer, value, &answers)?;
        }
        Ok(())
    };
    Ok(Ends::new(|| Ok(call), || Ok(serve)))
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
