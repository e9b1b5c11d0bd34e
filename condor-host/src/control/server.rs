//! The supervisor's end of its control socket: never waits for a client.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::{UnixListener, UnixStream};

use rustix::event::PollFlags;

use super::{Answer, Event, Request};

/// Bytes of a request.
const LONGEST: usize = 64 * 1024;
/// Bytes that wait for a client who does not read; then it is left.
const WAITING: usize = 4 * 1024 * 1024;

/// All connections.
pub(crate) struct Server {
    listener: UnixListener,
    connections: Vec<Connection>,
    next: u64,
}

/// Which connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct From(u64);

struct Connection {
    from: From,
    stream: UnixStream,
    input: Vec<u8>,
    output: VecDeque<u8>,
    follows: bool,
    /// A request is being carried out; the next one waits.
    busy: bool,
    end: End,
}

/// Whether a connection has come to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Open,
    /// The client sends nothing more, and may still wait for answers.
    Closed,
    Gone,
}

impl Server {
    pub(crate) fn new(listener: UnixListener) -> std::io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            connections: Vec::new(),
            next: 0,
        })
    }

    /// What is to be polled, and for what.
    pub(crate) fn descriptors(&self) -> impl Iterator<Item = (BorrowedFd<'_>, PollFlags)> {
        // Who closed is looked at again when there is an answer, and then only for room.
        let open =
            |connection: &&Connection| connection.end == End::Open || !connection.output.is_empty();
        let connections = self.connections.iter().filter(open).map(|connection| {
            let mut flags = PollFlags::empty();
            flags.set(PollFlags::IN, connection.end == End::Open);
            flags.set(PollFlags::OUT, !connection.output.is_empty());
            (connection.stream.as_fd(), flags)
        });
        core::iter::once((self.listener.as_fd(), PollFlags::IN)).chain(connections)
    }

    /// Moves what there is, and gives the requests that came.
    pub(crate) fn serve(&mut self) -> Vec<(From, Request)> {
        while let Ok((stream, _)) = self.listener.accept() {
            if stream.set_nonblocking(true).is_ok() {
                self.connections
                    .push(Connection::new(From(self.next), stream));
                self.next += 1;
            }
        }
        let mut requests = Vec::new();
        for connection in &mut self.connections {
            connection.write();
            connection.read();
            if let Some(request) = connection.next() {
                requests.push((connection.from, request));
            }
            connection.write();
        }
        self.connections.retain(|connection| {
            let waits = connection.busy || !connection.output.is_empty();
            match connection.end {
                End::Open => true,
                End::Closed => waits,
                End::Gone => false,
            }
        });
        requests
    }

    /// Answers a request; of somebody who is gone, nobody.
    pub(crate) fn answer(&mut self, to: From, answer: &Answer) {
        for connection in &mut self.connections {
            if connection.from == to {
                connection.busy = false;
                connection.send(answer);
            }
        }
    }

    pub(crate) fn follow(&mut self, who: From) {
        for connection in &mut self.connections {
            connection.follows |= connection.from == who;
        }
    }

    pub(crate) fn tell(&mut self, event: &Event) {
        for connection in &mut self.connections {
            if connection.follows {
                connection.send(event);
            }
        }
    }
}

impl Connection {
    fn new(from: From, stream: UnixStream) -> Self {
        Self {
            from,
            stream,
            input: Vec::new(),
            output: VecDeque::new(),
            follows: false,
            busy: false,
            end: End::Open,
        }
    }

    fn send(&mut self, message: &impl serde::Serialize) {
        match serde_json::to_vec(message) {
            Ok(line) => self.output.extend(line),
            Err(_) => self.end = End::Gone,
        }
        self.output.push_back(b'\n');
        if self.output.len() > WAITING {
            self.end = End::Gone;
        }
        self.write();
    }

    fn write(&mut self) {
        while !self.output.is_empty() {
            match self.stream.write(self.output.as_slices().0) {
                Ok(0) => break,
                Ok(count) => drop(self.output.drain(..count)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(_) => {
                    self.end = End::Gone;
                    break;
                }
            }
        }
    }

    fn read(&mut self) {
        let mut piece = [0; 4096];
        while self.end == End::Open && self.input.len() <= LONGEST {
            match self.stream.read(&mut piece) {
                Ok(0) => {
                    self.end = End::Closed;
                    return;
                }
                Ok(count) => self
                    .input
                    .extend_from_slice(piece.get(..count).unwrap_or_default()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(_) => {
                    self.end = End::Gone;
                    return;
                }
            }
        }
        if !self.input.contains(&b'\n') {
            self.end = End::Gone;
        }
    }

    /// The next request, if it can be understood; the others are answered here.
    fn next(&mut self) -> Option<Request> {
        while !self.busy {
            let end = self.input.iter().position(|&byte| byte == b'\n')?;
            let line: Vec<u8> = self.input.drain(..=end).collect();
            match serde_json::from_slice(&line) {
                Ok(request) => {
                    self.busy = true;
                    return Some(request);
                }
                Err(error) => self.send(&Answer {
                    error: Some(format!("this is no request: {error}")),
                    ..Answer::default()
                }),
            }
        }
        None
    }
}
