//! The supervisor's end of its control socket: never waits for a client, and keeps a bounded number of bytes
//! for each of a bounded number of clients.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::{UnixListener, UnixStream};

use rustix::event::PollFlags;

use super::{ControlAnswer, ControlRequest, SystemEvent};

/// The greatest size, in bytes, of a request together with the requests that wait behind it.
const LONGEST: usize = 64 * 1024;
/// The greatest number of bytes that wait for a client that does not read. Above [`LONGEST`] bytes,
/// no further request of the client is served. At this number, a follower of events is
/// disconnected.
const WAITING: usize = 4 * 1024 * 1024;
/// The greatest number of clients. One more displaces the oldest client that waits for no answer.
const CLIENTS: usize = 64;

/// All connections.
pub(crate) struct Server {
    listener: UnixListener,
    /// Whether no connection can be accepted now, because the process has no descriptors left.
    is_deaf: bool,
    connections: Vec<Connection>,
    next: u64,
    /// The place of the connection whose turn it is.
    turn: usize,
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
            is_deaf: false,
            connections: Vec::new(),
            next: 0,
            turn: 0,
        })
    }

    /// Returns the descriptors to poll, each with its events. An event that could not be served now
    /// is left out.
    pub(crate) fn descriptors(&self) -> impl Iterator<Item = (BorrowedFd<'_>, PollFlags)> {
        let connections = self.connections.iter().filter_map(|connection| {
            let mut flags = PollFlags::empty();
            flags.set(PollFlags::IN, connection.has_room());
            flags.set(PollFlags::OUT, !connection.output.is_empty());
            // Of one without flags the end would be told again and again.
            (!flags.is_empty()).then_some((connection.stream.as_fd(), flags))
        });
        let listener = (!self.is_deaf).then_some((self.listener.as_fd(), PollFlags::IN));
        listener.into_iter().chain(connections)
    }

    /// Moves what there is.
    pub(crate) fn serve(&mut self) {
        self.accept();
        for connection in &mut self.connections {
            connection.write();
            connection.read();
        }
        self.connections.retain(|connection| match connection.end {
            End::Open => true,
            End::Closed => {
                connection.busy || !connection.output.is_empty() || connection.has_request()
            }
            End::Gone => false,
        });
    }

    fn accept(&mut self) {
        self.is_deaf = false;
        for _ in 0..CLIENTS {
            let stream = match self.listener.accept() {
                Ok((stream, _)) => stream,
                Err(error) => {
                    // Another error, such as a lack of descriptors, would be told again and again.
                    self.is_deaf = !matches!(
                        error.kind(),
                        ErrorKind::WouldBlock
                            | ErrorKind::Interrupted
                            | ErrorKind::ConnectionAborted
                    );
                    return;
                }
            };
            if self.connections.len() >= CLIENTS {
                let mut connections = self.connections.iter();
                let Some(place) = connections.position(Connection::waits_for_nothing) else {
                    continue;
                };
                self.connections.remove(place);
            }
            if stream.set_nonblocking(true).is_ok() {
                self.connections
                    .push(Connection::new(From(self.next), stream));
                self.next += 1;
            }
        }
    }

    /// The next request, of each client in its turn. One that has been given must be answered.
    pub(crate) fn next(&mut self) -> Option<(From, ControlRequest)> {
        let count = self.connections.len();
        for _ in 0..count {
            self.turn = (self.turn + 1) % count;
            let connection = self.connections.get_mut(self.turn)?;
            if let Some(request) = connection.next() {
                return Some((connection.from, request));
            }
        }
        None
    }

    /// Whether there is a next request, whatever may happen.
    pub(crate) fn has_more(&self) -> bool {
        self.connections.iter().any(Connection::has_request)
    }

    /// Sends the answer to a request; does nothing if its client has disconnected.
    pub(crate) fn answer(&mut self, to: From, answer: &ControlAnswer) {
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

    pub(crate) fn tell(&mut self, event: &SystemEvent) {
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
        self.write();
        if self.output.len() > WAITING {
            self.end = End::Gone;
        }
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

    /// Whether more is read of the client.
    fn has_room(&self) -> bool {
        self.end == End::Open && self.input.len() <= LONGEST
    }

    /// Whether it could make room for another client.
    fn waits_for_nothing(&self) -> bool {
        !self.busy && !self.follows && self.input.is_empty() && self.output.is_empty()
    }

    fn read(&mut self) {
        let mut piece = [0; 4096];
        while self.has_room() {
            match self.stream.read(&mut piece) {
                Ok(0) => self.end = End::Closed,
                Ok(count) => self
                    .input
                    .extend_from_slice(piece.get(..count).unwrap_or_default()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(_) => self.end = End::Gone,
            }
        }
        if self.end == End::Open && !self.input.contains(&b'\n') {
            self.end = End::Gone;
        }
    }

    fn takes_request(&self) -> bool {
        !self.busy && self.end != End::Gone && self.output.len() <= LONGEST
    }

    /// Whether a request can be carried out now.
    fn has_request(&self) -> bool {
        self.takes_request() && self.input.contains(&b'\n')
    }

    /// The next request, if it can be understood; the others are answered here.
    fn next(&mut self) -> Option<ControlRequest> {
        while self.takes_request() {
            let end = self.input.iter().position(|&byte| byte == b'\n')?;
            let line: Vec<u8> = self.input.drain(..=end).collect();
            match serde_json::from_slice(&line) {
                Ok(request) => {
                    self.busy = true;
                    return Some(request);
                }
                Err(error) => self.send(&ControlAnswer {
                    error: Some(format!("cannot understand the request: {error}")),
                    ..ControlAnswer::default()
                }),
            }
        }
        None
    }
}

#[cfg(test)]
mod tests;
