use core::fmt;

use condor_hand::ImageError;
use crc::{CRC_32_ISO_HDLC, Crc};
use serde::{Deserialize, Serialize};
use zerocopy::little_endian::U64;
use zerocopy::{FromBytes, Immutable, IntoBytes, TryFromBytes};

/// The size of a row of a [`Ledger`], in bytes.
pub const ROW_BYTES: usize = 32;
/// The bytes of one row of a [`Ledger`], as a program stores them.
pub type LedgerRow = [u8; ROW_BYTES];

const MAGIC: u32 = u32::from_le_bytes(*b"CNDQ");
const VERSION: u32 = 2;
const EMPTY: u32 = 0;
const SESSION: u32 = 1;
const REQUEST: u32 = 2;
const CLOSED: u32 = 3;
const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// The identity of a request: the session of its client, and the number of the request in that
/// session. The queue runs no identity twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct RequestIdentity {
    /// The number of the session, which the queue has assigned to the client.
    pub session: u32,
    /// The number of the request, which the client chooses: from 1 on, and greater than those of all
    /// earlier requests of the session.
    pub number: u32,
}

impl fmt::Display for RequestIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "request {} of session {}", self.number, self.session)
    }
}

/// The owner of a session: the incarnation of a processor that opened the session. Only the owner
/// can use it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SessionOwner {
    /// The number of the processor.
    pub processor: u32,
    /// The incarnation of its mailbox, or another number that changes with each start of its program.
    pub incarnation: u32,
}

/// The state of a request in a queue: it waits, it runs, or it has ended in one of several ways.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Hash,
    Serialize,
    Deserialize,
    TryFromBytes,
    IntoBytes,
    Immutable,
)]
#[repr(u32)]
#[non_exhaustive]
pub enum RequestState {
    /// The request waits in the queue.
    Accepted = 1,
    /// The request runs.
    Started = 2,
    /// The request has reached its targets.
    Done = 3,
    /// The request's own guard has stopped it.
    Stopped = 4,
    /// The request was ended early, or taken out of the queue, for a [`RefusalReason`].
    Aborted = 5,
    /// The request has not run and never will, for a [`RefusalReason`].
    Refused = 6,
    /// The program ended before the request began: it has not run and never will.
    Lost = 7,
    /// The program ended while the request ran: it is not known how far it came.
    BrokenOff = 8,
}

impl fmt::Display for RequestState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Accepted => "waiting",
            Self::Started => "started",
            Self::Done => "done",
            Self::Stopped => "stopped by its guard",
            Self::Aborted => "aborted",
            Self::Refused => "refused",
            Self::Lost => "never run, since its program ended",
            Self::BrokenOff => "broken off, since its program ended",
        })
    }
}

impl RequestState {
    /// Returns the name of the state in lower case, such as `broken-off`, for programs to print and
    /// to compare.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Started => "started",
            Self::Done => "done",
            Self::Stopped => "stopped",
            Self::Aborted => "aborted",
            Self::Refused => "refused",
            Self::Lost => "lost",
            Self::BrokenOff => "broken-off",
        }
    }

    /// Returns true if the state is final: the request neither waits nor runs.
    #[must_use]
    pub const fn is_final(self) -> bool {
        !matches!(self, Self::Accepted | Self::Started)
    }

    /// Returns the state in the next incarnation of a program that ended in this one.
    const fn afterwards(self) -> Self {
        match self {
            Self::Accepted => Self::Lost,
            Self::Started => Self::BrokenOff,
            state => state,
        }
    }
}

/// The reason why a request was refused or aborted; other requests have [`RefusalReason::None`].
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, TryFromBytes, IntoBytes, Immutable,
)]
#[repr(u32)]
#[non_exhaustive]
pub enum RefusalReason {
    /// The request was neither refused nor aborted.
    None = 0,
    /// The queue has no room.
    Full = 1,
    /// Another session is in control, or none is.
    NotInControl = 2,
    /// The program cannot read the bytes of the request, or has no motion with the name in it.
    NoMotion = 3,
    /// A position, a pace or a guard is not possible.
    Limits = 4,
    /// A part of the robot that it moves is off, has a fault, or does something else.
    NotReady = 5,
    /// A person or a program aborted the request.
    Command = 6,
    /// A part of the robot that it moves has failed.
    Failure = 7,
    /// The motion is not possible from the position that the robot had when its turn came.
    FromHere = 8,
    /// The points of a stream did not come in time.
    Starved = 9,
    /// The client has withdrawn the request before it came.
    Withdrawn = 10,
}

impl fmt::Display for RefusalReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "no reason",
            Self::Full => "the queue is full; wait until one of its motions has ended",
            Self::NotInControl => "the session is not in control; take control first",
            Self::NoMotion => "there is no such motion; `motions` at the master's terminal lists those that are there",
            Self::Limits => "a position, a pace or a guard is not possible; the master's terminal says which",
            Self::NotReady => "a finger that it moves is not enabled; `enable` it at the master's terminal",
            Self::Command => "it was aborted",
            Self::Failure => "a finger that it moves has failed; `status` says which, and what to do",
            Self::FromHere => "it is not possible from where the robot was; the master's terminal says why",
            Self::Starved => "its points did not come in time; send them earlier",
            Self::Withdrawn => "it was withdrawn",
        })
    }
}

/// A session; number 0 stands for none.
#[derive(Clone, Copy, Debug, Default)]
struct Session {
    number: u32,
    /// Requests up to this one have been answered, whether they are still in a row or not.
    answered: u32,
    /// The number of the change of the ledger at which the session was last used.
    used: u64,
    owner: SessionOwner,
    /// True if the owner is gone, so that no request can come any more.
    is_closed: bool,
    /// True if its requests end with it. This is not stored, since none outlives the program.
    is_bound: bool,
}

/// A request, as its row records it.
#[derive(Clone, Copy, Debug)]
struct Request {
    identity: RequestIdentity,
    state: RequestState,
    reason: RefusalReason,
    entered: u64,
}

/// The record of the requests that a queue has received, which outlives the program. It has up to `2 * N` sessions at a
/// time, and the states of the last `4 * N` requests. Of all earlier requests it knows only that they were answered.
///
/// Every change is written before it is in force. The bytes of a ledger are `1 + S + R` rows, where `S` is the number
/// of sessions and `R` that of requests. A row has eight little-endian words, of which the last one is the CRC-32
/// (ISO-HDLC) of the others. Numbers of 64 bits have two words, the low one first.
///
/// | row | words |
/// |---|---|
/// | 0 | "CNDQ", version 2, `S`, `R` |
/// | 1 to S | 1, or 3 if the session is closed, session, number up to which its requests were answered, when it was last used (64 bits), processor and incarnation of its owner |
/// | S + 1 on | 2, session, number, [`RequestState`], [`RefusalReason`], when it was entered or ended (64 bits) |
///
/// An empty row has zeros before its checksum. A row whose checksum is wrong is damaged. The requests that it had are
/// unknown, so all requests that are in no other row count as answered. Rows must be written whole or not at all when
/// the program ends. After an error of `write` the row may be there or not: store all [rows](Self::rows) anew before
/// the next change.
#[derive(Clone, Debug)]
pub struct Ledger<const N: usize> {
    sessions: [[Session; 2]; N],
    requests: [[Option<Request>; 4]; N],
    /// The least number of the next session.
    least: u32,
    /// The number of changes so far, which orders sessions and requests in time.
    changes: u64,
}

impl<const N: usize> Ledger<N> {
    const SESSIONS: usize = 2 * N;
    const REQUESTS: usize = 4 * N;

    /// The number of rows of the ledger, each of [`ROW_BYTES`].
    pub const ROWS: usize = 1 + Self::SESSIONS + Self::REQUESTS;

    /// Makes the ledger from the rows that an earlier run of the program has stored, one after another in `bytes`.
    /// Without any bytes the ledger is empty. Requests that had not ended become [`RequestState::Lost`] or
    /// [`RequestState::BrokenOff`].
    ///
    /// Sessions that are opened from here on have greater numbers than all sessions in the ledger, and at least the
    /// number `least`. If `least` is the time in seconds, sessions have new numbers even after a ledger was deleted or
    /// the row of a session was damaged. Without a clock, a number can then be used again.
    ///
    /// # Errors
    /// Returns [`ImageError::Magic`] or [`ImageError::Version`] if the bytes are not a ledger of this version,
    /// [`ImageError::Count`] if its number of sessions or requests differs, [`ImageError::Length`] if it is cut
    /// or too long.
    pub fn read(bytes: &[u8], least: u32) -> Result<Self, ImageError> {
        let mut ledger = Self {
            sessions: [[Session::default(); 2]; N],
            requests: [[None; 4]; N],
            least,
            changes: 0,
        };
        if bytes.is_empty() {
            return Ok(ledger);
        }
        let (rows, _) = bytes.as_chunks::<ROW_BYTES>();
        if let Some(head) = rows.first() {
            let [magic, version, sessions, requests, ..]: [u32; 8] = zerocopy::transmute!(*head);
            if magic != MAGIC {
                let [found, wanted] = [magic, MAGIC].map(u32::to_le_bytes);
                return Err(ImageError::Magic { found, wanted });
            }
            if version != VERSION {
                let (found, wanted) = (version, VERSION);
                return Err(ImageError::Version { found, wanted });
            }
            for (of, found, wanted) in [
                ("sessions", sessions, Self::SESSIONS),
                ("requests", requests, Self::REQUESTS),
            ] {
                if found as usize != wanted {
                    return Err(ImageError::Count { of, found, wanted });
                }
            }
        }
        let (len, needed) = (bytes.len(), Self::ROWS * ROW_BYTES);
        if len != needed {
            return Err(ImageError::Length { needed, len });
        }
        let mut rows = rows.iter().skip(1);
        let mut is_damaged = false;
        for (place, row) in ledger.sessions.as_flattened_mut().iter_mut().zip(&mut rows) {
            match unpack::<SessionRow>(row) {
                Some(it) if matches!(it.kind, SESSION | CLOSED) => {
                    *place = Session {
                        number: it.number,
                        answered: it.answered,
                        used: it.used.get(),
                        owner: SessionOwner {
                            processor: it.processor,
                            incarnation: it.incarnation,
                        },
                        is_closed: it.kind == CLOSED,
                        is_bound: false,
                    };
                    ledger.changes = ledger.changes.max(place.used);
                }
                Some(it) if it.kind == EMPTY => {}
                _ => is_damaged = true,
            }
        }
        for (place, row) in ledger.requests.as_flattened_mut().iter_mut().zip(rows) {
            *place = Request::unpack(row);
            if let Some(request) = place {
                request.state = request.state.afterwards();
                ledger.changes = ledger.changes.max(request.entered);
            } else {
                is_damaged |= unpack::<SessionRow>(row).is_none_or(|it| it.kind != EMPTY);
            }
        }
        if is_damaged {
            for session in ledger.sessions.as_flattened_mut() {
                session.answered = u32::MAX;
            }
        }
        Ok(ledger)
    }

    /// Returns all rows of the ledger in the order of their indices. Store them after [`read`](Self::read), which may
    /// have changed states.
    pub fn rows(&self) -> impl Iterator<Item = LedgerRow> + '_ {
        let (sessions, requests) = (Self::SESSIONS as u32, Self::REQUESTS as u32);
        let head = pack(&[MAGIC, VERSION, sessions, requests, 0, 0, 0]);
        let sessions = self.sessions.as_flattened().iter().map(Session::pack);
        let requests = self.requests.as_flattened().iter();
        let requests = requests.map(|it| it.map_or(pack(&[EMPTY; 7]), |it| it.pack()));
        core::iter::once(head).chain(sessions).chain(requests)
    }

    /// Writes all rows of the ledger: calls `write` with the index and the bytes of each row.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written.
    pub fn write_all<E>(
        &self,
        mut write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut rows = self.rows().enumerate();
        rows.try_for_each(|(row, bytes)| write(row, &bytes))
    }

    /// Opens a session for `owner`, and returns the number of the session. `write` stores a row.
    ///
    /// The session takes a free row. If there is none, it takes the row of another session, which ends: of a closed
    /// session; else of a session of the same owner; else of any session. Of several such sessions it takes the one
    /// that was used longest ago, and of closed sessions first those of the same owner. Sessions whose requests have
    /// not ended keep their rows, and so do sessions for which `may_end` returns false.
    ///
    /// Returns `None` if no row can be taken, or if all numbers are used; see [`is_exhausted`](Self::is_exhausted).
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; no session is opened then.
    pub fn open<E>(
        &mut self,
        owner: SessionOwner,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
        may_end: impl Fn(u32) -> bool,
    ) -> Result<Option<u32>, E> {
        let busy = |session: u32| {
            let mut requests = self.requests.as_flattened().iter().flatten();
            requests.any(|it| it.identity.session == session && !it.state.is_final())
        };
        let places = self.sessions.as_flattened().iter().enumerate();
        let place = places
            .filter(|(_, it)| it.number == 0 || may_end(it.number) && !busy(it.number))
            .min_by_key(|(_, it)| (it.number != 0, !it.is_closed, it.owner != owner, it.used));
        let (Some((place, _)), Some(number)) = (place, self.newest().checked_add(1)) else {
            return Ok(None);
        };
        let number = number.max(self.least);
        let session = Session {
            number,
            answered: 0,
            used: self.changes.wrapping_add(1),
            owner,
            is_closed: false,
            is_bound: false,
        };
        self.put_session(place, session, write)?;
        Ok(Some(number))
    }

    /// Returns true if all session numbers are used, up to the greatest one, so that no session can be opened any more.
    #[must_use]
    pub fn is_exhausted(&self) -> bool {
        self.newest() == u32::MAX
    }

    /// Returns the greatest number of a session; 0 if there is none.
    fn newest(&self) -> u32 {
        // No number is used twice: that of the newest session leaves its row only for a newer one. If that row
        // is damaged, rows of its requests may have it.
        let sessions = self.sessions.as_flattened().iter().map(|it| it.number);
        let requests = self.requests.as_flattened().iter().flatten();
        let all = sessions.chain(requests.map(|it| it.identity.session));
        all.max().unwrap_or(0)
    }

    /// Iterates over all sessions of the ledger, also closed ones; each item is the session's
    /// number and owner.
    pub fn sessions(&self) -> impl Iterator<Item = (u32, SessionOwner)> + '_ {
        let sessions = self
            .sessions
            .as_flattened()
            .iter()
            .filter(|it| it.number != 0);
        sessions.map(|it| (it.number, it.owner))
    }

    /// Returns the owner of session number `session`; `None` if there is no such session.
    #[must_use]
    pub fn owner(&self, session: u32) -> Option<SessionOwner> {
        self.session(session).map(|(_, it)| it.owner)
    }

    /// Closes a session whose owner has ended. The states of its requests stay in the ledger.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the session is not closed then.
    pub fn close<E>(
        &mut self,
        session: u32,
        write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some((place, session)) = self.session(session)
            && !session.is_closed
        {
            let is_closed = true;
            self.put_session(
                place,
                Session {
                    is_closed,
                    ..session
                },
                write,
            )?;
        }
        Ok(())
    }

    /// Binds the requests of session number `session` to it, until the program ends.
    pub fn bind(&mut self, session: u32) {
        let mut sessions = self.sessions.as_flattened_mut().iter_mut();
        if let Some(it) = sessions.find(|it| session != 0 && it.number == session) {
            it.is_bound = true;
        }
    }

    /// Iterates over the requests of [bound](Self::bind) sessions that wait or run; each item is the owner of the session.
    pub fn owners_of_bound_requests(&self) -> impl Iterator<Item = SessionOwner> + '_ {
        let requests = self.requests.as_flattened().iter().flatten();
        let unfinished = requests.filter(|it| !it.state.is_final());
        let sessions = unfinished.filter_map(|it| self.session(it.identity.session));
        sessions.filter_map(|(_, it)| it.is_bound.then_some(it.owner))
    }

    /// Returns true if session number `session` was closed; false also if there is no such session.
    #[must_use]
    pub fn is_closed(&self, session: u32) -> bool {
        self.session(session).is_some_and(|(_, it)| it.is_closed)
    }

    /// Returns true if session number `session` is in the ledger, open or closed.
    #[must_use]
    pub fn has_session(&self, session: u32) -> bool {
        self.session(session).is_some()
    }

    /// Returns the state of a request, and the reason for that state. Returns `None` if the ledger
    /// has no row for the request, or has one no longer.
    #[must_use]
    pub fn state(&self, identity: RequestIdentity) -> Option<(RequestState, RefusalReason)> {
        let request = self.requests.as_flattened().iter().flatten();
        let mut request = request.filter(|it| it.identity == identity);
        request.next().map(|it| (it.state, it.reason))
    }

    /// Returns the number up to which requests of a session may have had rows that others have taken; 0 if there are
    /// none.
    #[must_use]
    pub fn forgotten(&self, session: u32) -> u32 {
        self.session(session).map_or(0, |(_, it)| it.answered)
    }

    /// Returns the greatest number of all requests of a session that the ledger has or once had; 0 if there are none.
    ///
    /// A request up to this number that has no row is never run: either it was answered and forgotten, or the client
    /// has skipped its number.
    #[must_use]
    pub fn answered(&self, session: u32) -> u32 {
        let requests = self.requests.as_flattened().iter().flatten();
        let numbers = requests
            .filter(|it| it.identity.session == session)
            .map(|it| it.identity.number);
        let known = self.session(session).map_or(0, |(_, it)| it.answered);
        numbers.max().unwrap_or(0).max(known)
    }

    /// Records the state of a request, and the reason for it. `write` stores a row.
    ///
    /// A request that has no row yet takes a free row, or else that of the request that ended first; if more than half
    /// of the rows are of refused requests, that of the oldest of these, so that a client that is refused again and
    /// again cannot have the others forgotten. Returns `false` if there is no such row.
    ///
    /// # Errors
    /// Returns the error of `write` if a row cannot be written; the state of the request is not changed then.
    pub fn set<E>(
        &mut self,
        identity: RequestIdentity,
        state: RequestState,
        reason: RefusalReason,
        mut write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<bool, E> {
        let mut places = self.requests.as_flattened().iter().enumerate();
        let known = places.find(|(_, it)| it.is_some_and(|it| it.identity == identity));
        let place = known.or_else(|| {
            let rows = self.requests.as_flattened();
            let is_refused = |it: &Request| it.state == RequestState::Refused;
            let refused = rows.iter().flatten().filter(|it| is_refused(it)).count();
            let are_first = refused > rows.len() / 2;
            let ended = rows.iter().enumerate();
            ended
                .filter(|(_, it)| it.is_none_or(|it| it.state.is_final()))
                .min_by_key(|(_, it)| it.map(|it| (are_first && !is_refused(&it), it.entered)))
        });
        let Some((place, &former)) = place else {
            return Ok(false);
        };
        if let Some(former) = former.filter(|it| it.identity != identity) {
            // A request that no longer has a row must stay answered.
            let RequestIdentity { session, number } = former.identity;
            if let Some((at, session)) = self.session(session)
                && session.answered < number
            {
                let session = Session {
                    answered: number,
                    ..session
                };
                self.put_session(at, session, &mut write)?;
            }
        }
        let same = former.filter(|it| it.identity == identity);
        let request = Request {
            identity,
            state,
            reason,
            // A request that has just ended is remembered longest.
            entered: same
                .filter(|_| !state.is_final())
                .map_or(self.changes.wrapping_add(1), |it| it.entered),
        };
        write(1 + Self::SESSIONS + place, &request.pack())?;
        self.changes = self.changes.wrapping_add(1);
        if let Some(place) = self.requests.as_flattened_mut().get_mut(place) {
            *place = Some(request);
        }
        if let Some((at, session)) = self.session(identity.session)
            && let Some(place) = self.sessions.as_flattened_mut().get_mut(at)
        {
            *place = Session {
                used: self.changes,
                ..session
            };
        }
        Ok(true)
    }

    fn session(&self, number: u32) -> Option<(usize, Session)> {
        let mut sessions = self.sessions.as_flattened().iter().copied().enumerate();
        sessions.find(|(_, it)| number != 0 && it.number == number)
    }

    fn put_session<E>(
        &mut self,
        place: usize,
        session: Session,
        mut write: impl FnMut(usize, &LedgerRow) -> Result<(), E>,
    ) -> Result<(), E> {
        write(1 + place, &session.pack())?;
        self.changes = self.changes.max(session.used);
        if let Some(place) = self.sessions.as_flattened_mut().get_mut(place) {
            *place = session;
        }
        Ok(())
    }
}

impl Session {
    fn pack(&self) -> LedgerRow {
        if self.number == 0 {
            return pack(&[EMPTY; 7]);
        }
        pack(&SessionRow {
            kind: if self.is_closed { CLOSED } else { SESSION },
            number: self.number,
            answered: self.answered,
            used: self.used.into(),
            processor: self.owner.processor,
            incarnation: self.owner.incarnation,
        })
    }
}

impl Request {
    fn pack(&self) -> LedgerRow {
        let RequestIdentity { session, number } = self.identity;
        pack(&RequestRow {
            kind: REQUEST,
            session,
            number,
            state: self.state,
            reason: self.reason,
            entered: self.entered.into(),
        })
    }

    fn unpack(row: &LedgerRow) -> Option<Self> {
        let row = unpack::<RequestRow>(row).filter(|it| it.kind == REQUEST)?;
        let (session, number) = (row.session, row.number);
        Some(Self {
            identity: RequestIdentity { session, number },
            state: row.state,
            reason: row.reason,
            entered: row.entered.get(),
        })
    }
}

/// The words of the row of a session, before the checksum.
#[derive(FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct SessionRow {
    kind: u32,
    number: u32,
    answered: u32,
    used: U64,
    processor: u32,
    incarnation: u32,
}

/// The words of the row of a request, before the checksum.
#[derive(TryFromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct RequestRow {
    kind: u32,
    session: u32,
    number: u32,
    state: RequestState,
    reason: RefusalReason,
    entered: U64,
}

/// Returns a row of these words, and of their checksum.
fn pack(words: &(impl IntoBytes + Immutable)) -> LedgerRow {
    let words = words.as_bytes();
    let sum = CRC.checksum(words).to_le_bytes();
    let mut row = [0; ROW_BYTES];
    for (place, byte) in row.iter_mut().zip(words.iter().chain(&sum)) {
        *place = *byte;
    }
    row
}

/// Returns the words of a row; `None` if the checksum is wrong, or a word has a value that is none of its type.
fn unpack<T: TryFromBytes>(row: &LedgerRow) -> Option<T> {
    let (words, sum) = row.split_last_chunk()?;
    let is_whole = CRC.checksum(words) == u32::from_le_bytes(*sum);
    T::try_read_from_bytes(words).ok().filter(|_| is_whole)
}

const _: () = assert!(size_of::<SessionRow>() == ROW_BYTES - 4);
const _: () = assert!(size_of::<RequestRow>() == ROW_BYTES - 4);
