//! [`Connection`]: a client's handshake and frames, over a stream that never waits.

use core::mem;
use std::cell::Cell;
use std::collections::VecDeque;
use std::io::{self, BufRead, Cursor, ErrorKind, Read, Write};
use std::net::IpAddr;
use std::rc::Rc;
use std::time::{Duration, Instant};

use tungstenite::error::ProtocolError;
use tungstenite::handshake::MidHandshake;
use tungstenite::handshake::server::{Callback, ErrorResponse, ServerHandshake};
use tungstenite::handshake::server::{Request, Response};
use tungstenite::http::header::{HOST, ORIGIN, SEC_WEBSOCKET_PROTOCOL};
use tungstenite::http::{HeaderValue, StatusCode};
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::protocol::{CloseFrame, WebSocketConfig};
use tungstenite::{Error, HandshakeError, Message, WebSocket};

use super::page::{self, PageRequest};
use super::protocol::SUBPROTOCOLS;
use super::session::{Ask, Catalog, Frame, Session};
use crate::listening::{Rules, Trust, Visit};

/// The greatest time of a whole handshake, or of an answer to a plain request, however they are cut into pieces.
pub(crate) const HANDSHAKE: Duration = Duration::from_secs(5);
/// The greatest message of a client, in bytes.
pub(crate) const MESSAGE: usize = 64 << 10;
/// The room for frames on their way to the socket, in bytes. No message of the server is as large.
const ROOM: usize = 16 << 20;
/// The number of frames that are read, or written, at once before other clients have their turn.
const TURN: usize = 32;
/// The number of bytes that are read before other clients have their turn. Fragments without content are
/// not frames, and cost as much.
const BYTES: usize = 128 << 10;

/// The end of a connection.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// The client has closed it, or is gone.
    Left,
    /// The client has got the file for which it has asked.
    Served,
    /// The client was refused, or has broken the protocol of frames.
    Refused(String),
}

/// A client that connects or is connected.
pub(crate) struct Connection<S: Read + Write> {
    stage: Stage<MeteredStream<S>>,
    gate: Gate,
    /// The number of bytes that may still be read in this turn.
    left: Rc<Cell<usize>>,
    began: Instant,
}

enum Stage<S: Read + Write> {
    /// The head of the request comes.
    Arriving(S, Vec<u8>),
    /// The rest of the answer to a plain request goes; with the reason, if it is a refusal.
    Answering(S, Cursor<Vec<u8>>, Option<String>),
    Greeting(Box<MidHandshake<ServerHandshake<S, Gate>>>),
    Open(Box<OpenConnection<S>>),
    /// The connection is between two stages.
    Over,
}

/// A stream that has nothing to read after the bytes of a turn.
struct MeteredStream<S> {
    stream: S,
    /// The bytes that were read before, and are read again.
    head: Cursor<Vec<u8>>,
    left: Rc<Cell<usize>>,
}

struct OpenConnection<S> {
    socket: WebSocket<S>,
    session: Session,
}

/// The settings that all connections share.
pub(crate) struct ServerSettings {
    pub(crate) rules: Rules,
    /// The greatest number of clients.
    pub(crate) most: usize,
    /// The number of clients that are present.
    pub(crate) present: Cell<usize>,
}

/// Admits or refuses one client by its request.
#[derive(Clone)]
struct Gate {
    house: Rc<ServerSettings>,
    local: IpAddr,
    admitted: Rc<Cell<Option<AdmittedRequest>>>,
}

/// The rights of an admitted client, and the rate that it wants.
#[derive(Clone, Copy)]
struct AdmittedRequest {
    trust: Trust,
    /// The least time between two samples of a channel.
    pace: Option<Duration>,
}

impl<S: Read + Write> Connection<S> {
    /// Begins the handshake with a client that has connected to the address `local`.
    pub(crate) fn new(stream: S, local: IpAddr, house: &Rc<ServerSettings>, now: Instant) -> Self {
        let left = Rc::new(Cell::new(BYTES));
        let stream = MeteredStream {
            stream,
            head: Cursor::default(),
            left: left.clone(),
        };
        Self {
            stage: Stage::Arriving(stream, Vec::new()),
            gate: Gate {
                house: house.clone(),
                local,
                admitted: Rc::default(),
            },
            left,
            began: now,
        }
    }

    /// Returns the session; `None` during the handshake.
    pub(crate) fn session(&mut self) -> Option<&mut Session> {
        match &mut self.stage {
            Stage::Open(open) => Some(&mut open.session),
            _ => None,
        }
    }

    /// Reads and writes what can be without waiting. Adds to `asks` what has to be asked.
    pub(crate) fn turn(
        &mut self,
        now: Instant,
        catalog: &Catalog,
        asks: &mut VecDeque<Ask>,
    ) -> Result<(), End> {
        self.left.set(BYTES);
        if let Stage::Open(open) = &mut self.stage {
            return open.turn(now, catalog, asks);
        }
        self.stage = match mem::replace(&mut self.stage, Stage::Over) {
            Stage::Arriving(stream, head) => self.arrive(stream, head)?,
            stage => stage,
        };
        self.stage = match mem::replace(&mut self.stage, Stage::Over) {
            Stage::Answering(stream, rest, refusal) => answer(stream, rest, refusal)?,
            Stage::Greeting(handshake) => self.greet(*handshake, catalog)?,
            stage => stage,
        };
        match &mut self.stage {
            Stage::Open(open) => open.turn(now, catalog, asks),
            _ if now.saturating_duration_since(self.began) < HANDSHAKE => Ok(()),
            _ => {
                let limit = HANDSHAKE.as_secs();
                Err(End::Refused(format!(
                    "the client sent no handshake within {limit} s"
                )))
            }
        }
    }

    /// Reads the head of the request.
    fn arrive(
        &self,
        mut stream: MeteredStream<S>,
        mut head: Vec<u8>,
    ) -> Result<Stage<MeteredStream<S>>, End> {
        let mut piece = [0; 1 << 10];
        loop {
            match stream.read(&mut piece) {
                Ok(0) => return Err(End::Left),
                Ok(count) => head.extend(piece.iter().take(count)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    return Ok(Stage::Arriving(stream, head));
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(End::Left),
            }
            let Gate { house, local, .. } = &self.gate;
            match page::read(&head, &house.rules, *local).map_err(End::Refused)? {
                PageRequest::More => {}
                PageRequest::File(bytes, refusal) => {
                    return Ok(Stage::Answering(stream, Cursor::new(bytes), refusal));
                }
                PageRequest::Websocket => {
                    stream.head = Cursor::new(head);
                    let config = WebSocketConfig::default()
                        .max_message_size(Some(MESSAGE))
                        .max_frame_size(Some(MESSAGE))
                        .max_write_buffer_size(ROOM);
                    let start = ServerHandshake::start(stream, self.gate.clone(), Some(config));
                    return Ok(Stage::Greeting(Box::new(start)));
                }
            }
        }
    }

    fn greet(
        &self,
        handshake: MidHandshake<ServerHandshake<MeteredStream<S>, Gate>>,
        catalog: &Catalog,
    ) -> Result<Stage<MeteredStream<S>>, End> {
        match handshake.handshake() {
            Ok(socket) => {
                let admitted = self.gate.admitted.get().unwrap_or(AdmittedRequest {
                    trust: Trust::MayLook,
                    pace: None,
                });
                let session = Session::new(admitted.trust, admitted.pace, catalog);
                Ok(Stage::Open(Box::new(OpenConnection { socket, session })))
            }
            Err(HandshakeError::Interrupted(handshake)) => Ok(Stage::Greeting(Box::new(handshake))),
            Err(HandshakeError::Failure(Error::Http(response))) => {
                let body = response.into_body().unwrap_or_default();
                Err(End::Refused(String::from_utf8_lossy(&body).trim().into()))
            }
            Err(HandshakeError::Failure(error)) => Err(End::Refused(error.to_string())),
        }
    }
}

/// Writes what can be of the answer to a plain request. It ends the connection.
fn answer<S: Read + Write>(
    mut stream: S,
    mut rest: Cursor<Vec<u8>>,
    refusal: Option<String>,
) -> Result<Stage<S>, End> {
    loop {
        match rest.fill_buf() {
            Ok([]) | Err(_) => return Err(refusal.map_or(End::Served, End::Refused)),
            Ok(bytes) => match stream.write(bytes) {
                Ok(0) => return Err(End::Left),
                Ok(count) => rest.consume(count),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    return Ok(Stage::Answering(stream, rest, refusal));
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(End::Left),
            },
        }
    }
}

impl<S: Read> Read for MeteredStream<S> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let again = self.head.read(to)?;
        if again > 0 {
            return Ok(again);
        }
        let most = to.len().min(self.left.get());
        let (to, _) = to.split_at_mut(most);
        if to.is_empty() {
            return Err(ErrorKind::WouldBlock.into());
        }
        let count = self.stream.read(to)?;
        self.left.set(self.left.get().saturating_sub(count));
        Ok(count)
    }
}

impl<S: Write> Write for MeteredStream<S> {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        self.stream.write(from)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

impl<S: Read + Write> OpenConnection<S> {
    fn turn(
        &mut self,
        now: Instant,
        catalog: &Catalog,
        asks: &mut VecDeque<Ask>,
    ) -> Result<(), End> {
        for _ in 0..TURN {
            if self.session.is_busy() {
                break;
            }
            match self.socket.read() {
                Ok(Message::Text(text)) => asks.extend(self.session.hear(&text, catalog)),
                Ok(Message::Binary(frame)) => self.session.hear_binary(&frame, catalog),
                // The library answers them.
                Ok(_) => {}
                Err(error) if is_waiting(&error) => break,
                Err(error) => return Err(self.end(&error)),
            }
        }
        loop {
            match self.socket.flush() {
                Ok(()) => {}
                Err(error) if is_waiting(&error) => return Ok(()),
                Err(error) => return Err(self.end(&error)),
            }
            let mut is_last = true;
            for _ in 0..TURN {
                let Some(frame) = self.session.next(now, catalog) else {
                    break;
                };
                is_last = false;
                let message = match frame {
                    Frame::Text(text) => Message::text(text),
                    Frame::Binary(bytes) => Message::binary(bytes),
                };
                match self.socket.write(message) {
                    Ok(()) => {}
                    // The message is in the buffer all the same.
                    Err(error) if is_waiting(&error) => return Ok(()),
                    Err(error) => return Err(self.end(&error)),
                }
            }
            if is_last {
                return Ok(());
            }
        }
    }

    /// Says why the connection ends, to the client, too, if it can be told.
    fn end(&mut self, error: &Error) -> End {
        let code = match error {
            Error::ConnectionClosed
            | Error::AlreadyClosed
            | Error::Io(_)
            | Error::Protocol(ProtocolError::ResetWithoutClosingHandshake) => return End::Left,
            Error::Capacity(_) => CloseCode::Size,
            _ => CloseCode::Protocol,
        };
        let text = error.to_string();
        let frame = CloseFrame {
            code,
            reason: text
                .chars()
                .filter(char::is_ascii)
                .take(100)
                .collect::<String>()
                .into(),
        };
        // The connection ends, whether the client takes the frame or not.
        let _ = self.socket.close(Some(frame));
        End::Refused(text)
    }
}

fn is_waiting(error: &Error) -> bool {
    matches!(error, Error::Io(error) if error.kind() == ErrorKind::WouldBlock)
}

impl Callback for Gate {
    fn on_request(
        self,
        request: &Request,
        mut response: Response,
    ) -> Result<Response, ErrorResponse> {
        let headers = request.headers();
        let only = |name| {
            let mut all = headers.get_all(name).into_iter();
            // Two are as good as one that nobody knows.
            all.next().filter(|_| all.next().is_none())?.to_str().ok()
        };
        let origin = headers.contains_key(ORIGIN);
        let visit = Visit {
            host: only(HOST),
            origin: origin.then(|| only(ORIGIN).unwrap_or("of an unreadable origin")),
            query: request.uri().query(),
            local: self.local,
        };
        let trust = self.house.rules.admit(&visit);
        let trust = trust.map_err(|refusal| no(StatusCode::FORBIDDEN, refusal.to_string()))?;
        let pace = pace(visit.query).map_err(|text| no(StatusCode::BAD_REQUEST, text))?;
        let offers = headers.get_all(SEC_WEBSOCKET_PROTOCOL).into_iter();
        let offers = offers.filter_map(|header| header.to_str().ok());
        let offered: Vec<&str> = offers
            .flat_map(|all| all.split(','))
            .map(str::trim)
            .collect();
        let Some(chosen) = SUBPROTOCOLS.iter().find(|it| offered.contains(*it)) else {
            let text = format!(
                "this server speaks the websocket subprotocols {}",
                SUBPROTOCOLS.join(" and ")
            );
            return Err(no(StatusCode::BAD_REQUEST, text));
        };
        if self.house.present.get() >= self.house.most {
            let most = self.house.most;
            let text = format!("{most} clients are connected, which is the most");
            return Err(no(StatusCode::SERVICE_UNAVAILABLE, text));
        }
        let chosen = HeaderValue::from_static(chosen);
        response
            .headers_mut()
            .insert(SEC_WEBSOCKET_PROTOCOL, chosen);
        self.admitted.set(Some(AdmittedRequest { trust, pace }));
        Ok(response)
    }
}

/// Returns the least time between two samples of a channel: `hz=` of a query says how many there are at most in
/// a second.
fn pace(query: Option<&str>) -> Result<Option<Duration>, String> {
    let mut fields = query.unwrap_or_default().split('&');
    let Some(text) = fields.find_map(|field| field.strip_prefix("hz=")) else {
        return Ok(None);
    };
    match text.parse() {
        Ok(hz @ 1..=1000_u32) => Ok(Some(Duration::from_secs(1) / hz)),
        _ => Err("`hz` must be a number from 1 to 1000".into()),
    }
}

fn no(status: StatusCode, text: String) -> ErrorResponse {
    let mut response = ErrorResponse::new(Some(text + "\n"));
    *response.status_mut() = status;
    response
}
