//! [`Server`]: the socket on which clients connect, and the clients.

use std::cell::Cell;
use std::collections::{BTreeSet, VecDeque};
use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::rc::Rc;
use std::time::{Duration, Instant};

use rustix::io::Errno;
use rustix::net::sockopt;

use super::calls::Call;
use super::connection::{Connection, End, ServerSettings};
use super::feeds::Sample;
use super::parameter_worker::WorkerMessage;
use super::protocol::Level;
use super::session::{Ask, Catalog, Channel, Session};
use crate::listening::Rules;
use condor_host::error::{AnyError, tell};
use condor_host::plain::plain;

/// The greatest number of clients.
const CLIENTS: usize = 8;
/// The greatest number of handshakes, and of files that are sent, at a time. One more ends the oldest. A page has
/// more than ten files, and several pages may be loaded at once.
const HANDSHAKES: usize = 64;

/// The bytes that the operating system keeps for a client. What waits longer may be replaced by what is
/// newer.
const SOCKET: usize = 128 << 10;
/// The time for which a client may be idle before the operating system asks whether it is there, and the
/// time between two such probes.
const IDLE: Duration = Duration::from_secs(10);
/// The number of probes without an answer that ends a connection.
const PROBES: u32 = 3;
/// The time for which sent bytes may wait for the client's machine to confirm them, in ms.
const VANISHED_MS: u32 = 30_000;
/// The least time between two reports that no connection can be accepted.
const REPORT: Duration = Duration::from_secs(1);

/// The socket and the clients. Nothing here waits.
pub(super) struct Server {
    listener: TcpListener,
    house: Rc<ServerSettings>,
    catalog: Catalog,
    clients: Vec<Client>,
    /// The number of the next client.
    next: u64,
    /// The number of the client whose question was taken last.
    asked: u64,
    /// The number of the client whose call was taken last.
    called: u64,
    /// The instant of the last report that no connection can be accepted.
    reported: Option<Instant>,
    pub(super) totals: Totals,
}

struct Client {
    number: u64,
    address: SocketAddr,
    connection: Connection<TcpStream>,
    /// Its questions that have not been passed on. They go when the client goes.
    asks: VecDeque<Ask>,
}

/// The numbers of clients, and of samples that were sent to them and lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Totals {
    pub(super) clients: u64,
    pub(super) sent: u64,
    pub(super) lost: u64,
}

impl Server {
    pub(super) fn bind(at: SocketAddr, rules: Rules, catalog: Catalog) -> Result<Self, AnyError> {
        let listener = TcpListener::bind(at);
        let listener = listener.map_err(|error| {
            format!("cannot listen at {at}: {error}; choose another port by --port, such as 0 for a free one")
        })?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            house: Rc::new(ServerSettings {
                rules,
                most: CLIENTS,
                present: Cell::new(0),
            }),
            catalog,
            clients: Vec::new(),
            next: 0,
            asked: 0,
            called: 0,
            reported: None,
            totals: Totals::default(),
        })
    }

    /// Returns the address at which it listens.
    pub(super) fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Lets everybody in who has come, and reads and writes what can be without waiting.
    pub(super) fn turn(&mut self, now: Instant) -> Result<(), AnyError> {
        self.accept(now)?;
        let mut ended = Vec::new();
        for (place, client) in self.clients.iter_mut().enumerate() {
            let was_open = client.connection.session().is_some();
            let (connection, asks) = (&mut client.connection, &mut client.asks);
            let turn = connection.turn(now, &self.catalog, asks);
            if !was_open && client.connection.session().is_some() {
                self.totals.clients += 1;
                self.house.present.set(self.house.present.get() + 1);
                eprintln!("{}: connected", client.address);
            }
            if let Err(end) = turn {
                ended.push((place, end));
            }
        }
        for (place, end) in ended.into_iter().rev() {
            let client = self.clients.remove(place);
            self.end(client, &end);
        }
        Ok(())
    }

    /// Takes a question of the next client that has one; returns it with the client's number.
    pub(super) fn ask(&mut self) -> Option<(u64, Ask)> {
        let asked = self.asked;
        let clients = self.clients.iter_mut().filter(|it| !it.asks.is_empty());
        // Numbers rise: those after the last one come first.
        let client = clients.min_by_key(|it| (it.number <= asked, it.number))?;
        self.asked = client.number;
        Some((client.number, client.asks.pop_front()?))
    }

    /// Takes a call of the next client that has one; returns it with the client's number.
    pub(super) fn call(&mut self) -> Option<(u64, Call)> {
        let called = self.called;
        let clients = self.clients.iter_mut();
        let sessions = clients.filter_map(|it| Some((it.number, it.connection.session()?)));
        let ready = sessions.filter(|(_, session)| session.calls.is_ready());
        let (number, session) = ready.min_by_key(|(number, _)| (*number <= called, *number))?;
        self.called = number;
        Some((number, session.calls.take()?))
    }

    /// Passes the answer to a call on to its client.
    pub(super) fn respond(&mut self, client: u64, call: &Call, result: Result<Vec<u8>, String>) {
        if let Some(session) = self.session(client) {
            session.respond(call, result);
        }
    }

    fn accept(&mut self, now: Instant) -> Result<(), AnyError> {
        for _ in 0..HANDSHAKES {
            let (stream, address) = match self.listener.accept() {
                Ok(accepted) => accepted,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                // The client has gone before it was let in.
                Err(error) if error.kind() == ErrorKind::ConnectionAborted => continue,
                Err(error) if is_fatal(&error) => {
                    return Err(format!("cannot accept a connection: {error}").into());
                }
                // An error such as too many open files: the clients that are connected go on.
                Err(error) => {
                    if self.reported.is_none_or(|at| now - at >= REPORT) {
                        tell(format_args!("cannot accept a connection: {error}"));
                        self.reported = Some(now);
                    }
                    return Ok(());
                }
            };
            let mut all = self.clients.iter_mut().enumerate();
            let mut pending = all.by_ref().filter_map(|(place, client)| {
                let is_pending = client.connection.session().is_none();
                is_pending.then_some(place)
            });
            if let Some(oldest) = pending.next()
                && pending.count() + 1 >= HANDSHAKES
            {
                let client = self.clients.remove(oldest);
                let reason = format!("more than {HANDSHAKES} handshakes are in progress");
                self.end(client, &End::Refused(reason));
            }
            let Ok(local) = prepare(&stream) else {
                // The client has gone again.
                continue;
            };
            self.clients.push(Client {
                number: self.next,
                address,
                connection: Connection::new(stream, local, &self.house, now),
                asks: VecDeque::new(),
            });
            self.next += 1;
        }
        Ok(())
    }

    /// Counts and tells what a client was, which has ended.
    fn end(&mut self, mut client: Client, end: &End) {
        let address = client.address;
        let reason = match end {
            // A page has several files, and they are no news.
            End::Served => return,
            End::Left => "left".into(),
            End::Refused(reason) => format!("refused: {}", plain(reason)),
        };
        match client.connection.session() {
            Some(session) => {
                let (sent, lost) = (session.sent, session.lost() + session.waiting());
                self.totals.sent += sent;
                self.totals.lost += lost;
                self.house.present.set(self.house.present.get() - 1);
                eprintln!("{address}: {reason}; samples: {sent} sent, {lost} lost");
            }
            None => eprintln!("{address}: {reason}"),
        }
    }

    /// Ends all connections, and returns what the clients were and got.
    pub(super) fn close(mut self) -> Totals {
        for client in core::mem::take(&mut self.clients) {
            self.end(client, &End::Left);
        }
        self.totals
    }

    /// Returns the number of channels.
    pub(super) const fn channels(&self) -> usize {
        self.catalog.channels.len()
    }

    /// Offers further channels to all.
    pub(super) fn advertise(&mut self, channels: Vec<Channel>) {
        let text = self.catalog.add(channels);
        for session in self.sessions() {
            session.advertise(&text);
        }
    }

    /// Pushes a sample to all clients that have subscribed to its channel.
    pub(super) fn push(&mut self, sample: &Sample) {
        let Sample {
            channel,
            at_ns,
            payload,
        } = sample;
        for session in self.sessions() {
            session.push(*channel, *at_ns, payload);
        }
    }

    /// Tells all clients the time.
    pub(super) fn set_time(&mut self, at_ns: u64) {
        for session in self.sessions() {
            session.set_time(at_ns);
        }
    }

    /// Tells all that something has happened.
    pub(super) fn tell(&mut self, text: &str) {
        for session in self.sessions() {
            session.tell(Level::Warning, text);
        }
    }

    /// Passes an answer on to the client that asked, and a change to all clients that watch the parameter.
    pub(super) fn take(&mut self, message: WorkerMessage) {
        match message {
            WorkerMessage::Answer {
                client,
                parameters,
                id,
                troubles,
            } => {
                if let Some(session) = self.session(client) {
                    session.answer(&parameters, id.as_deref(), &troubles);
                }
            }
            WorkerMessage::Changed { place, parameter } => {
                let (value, kind) = (parameter.value.as_ref(), parameter.kind.as_deref());
                for session in self.sessions() {
                    session.change(place, value, kind);
                }
            }
        }
    }

    /// Returns the parameters of which any client wants to know changes.
    pub(super) fn watched(&mut self) -> BTreeSet<usize> {
        let sessions = self.sessions();
        sessions.flat_map(|session| session.watched()).collect()
    }

    /// Returns the channels to which any client has subscribed.
    pub(super) fn wanted(&mut self) -> BTreeSet<usize> {
        let sessions = self.sessions();
        sessions.flat_map(|session| session.channels()).collect()
    }

    /// Returns the session of a client, if it has not gone.
    fn session(&mut self, client: u64) -> Option<&mut Session> {
        let mut clients = self.clients.iter_mut();
        let client = clients.find(|it| it.number == client)?;
        client.connection.session()
    }

    fn sessions(&mut self) -> impl Iterator<Item = &mut Session> {
        let clients = self.clients.iter_mut();
        clients.filter_map(|client| client.connection.session())
    }
}

/// Returns whether the socket will never accept a connection again.
fn is_fatal(error: &std::io::Error) -> bool {
    let fatal = [Errno::BADF, Errno::INVAL, Errno::NOTSOCK];
    Errno::from_io_error(error).is_some_and(|errno| fatal.contains(&errno))
}

/// Prepares a stream that nobody waits for; returns the address to which the client has connected.
fn prepare(stream: &TcpStream) -> std::io::Result<IpAddr> {
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    sockopt::set_socket_send_buffer_size(stream, SOCKET)?;
    // A client that has vanished does not keep its place.
    sockopt::set_socket_keepalive(stream, true)?;
    sockopt::set_tcp_keepidle(stream, IDLE)?;
    sockopt::set_tcp_keepintvl(stream, IDLE)?;
    sockopt::set_tcp_keepcnt(stream, PROBES)?;
    sockopt::set_tcp_user_timeout(stream, VANISHED_MS)?;
    Ok(stream.local_addr()?.ip())
}
