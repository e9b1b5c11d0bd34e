//! [`Requests`]: the master's queue of motions, with its ledger in a file.

use core::cell::RefCell;
use core::time::Duration;

use condor_fs::{Error as FileError, OpenOptions};
use condor_hand::queue::{
    Answer, Identity, MotionQueue, ROW_BYTES, Reason, RestoreError, Row, State,
};
use condor_mbox::Processor;
use condor_rt::{FilesOf, Machine, PROCESSORS};
use critical_section::Mutex;
use embedded_io::SeekFrom;
use heapless::{Deque, Vec};

use super::FILES_TIMEOUT;
use super::words::{LEDGER, Problem, is_name};
use crate::file;
use crate::motions::{BODY_BYTES, Code, Request, Response, VERSION, Verb};

/// How long one write of a row may take: what is not written then is tried again, and the terminal
/// must not wait for it.
const WRITE_TIMEOUT: Duration = Duration::from_millis(200);
/// Requests that wait for their turn.
const WAITING: usize = 4;
/// Clients with a session, the terminal among them.
const SESSIONS: usize = 8;
/// Requests whose outcome is known.
const REMEMBERED: usize = 32;
/// Requests that the background has not looked at.
const INBOX: usize = 2;

type Queue = MotionQueue<Work, WAITING, SESSIONS, REMEMBERED>;

/// What a request is to do.
#[derive(Clone, Debug)]
pub(super) struct Work {
    /// The name of a motion, or an image of motions.
    body: Vec<u8, BODY_BYTES>,
    /// Whether it is what is in memory, recorded or loaded, under this name.
    pub(super) is_kept: bool,
}

impl Work {
    /// The motion of this name.
    pub(super) fn named(name: &str, is_kept: bool) -> Self {
        // Names are short enough.
        let body = Vec::from_slice(name.as_bytes()).unwrap_or_default();
        Self { body, is_kept }
    }

    /// What the body of a request says.
    fn of(request: &Request) -> Result<Self, Reason> {
        let body = request.body().and_then(|body| Vec::from_slice(body).ok());
        let body = body.ok_or(Reason::NoMotion)?;
        let is_kept = false;
        Ok(Self { body, is_kept })
    }

    pub(super) fn name(&self) -> Option<&str> {
        let name = core::str::from_utf8(&self.body).ok();
        name.filter(|name| is_name(name))
    }

    pub(super) fn image(&self) -> &[u8] {
        &self.body
    }
}

/// Where the handler of messages and the background meet.
pub(super) struct Post {
    /// None while the background works on it.
    queue: Option<Queue>,
    inbox: Deque<Request, INBOX>,
    /// For each processor the session that was opened for it, or 0 if it is still to be.
    opened: [Option<u32>; PROCESSORS],
    /// Who took control, of which the terminal is to tell.
    taken_by: Option<u32>,
    /// Whether a client has ended all motion.
    is_aborted: bool,
}

pub(super) type SharedPost = Mutex<RefCell<Post>>;

impl Post {
    pub(super) const fn new() -> Self {
        Self {
            queue: None,
            inbox: Deque::new(),
            opened: [None; PROCESSORS],
            taken_by: None,
            is_aborted: false,
        }
    }

    /// The handler's part: answers what can be answered at once, and keeps the rest.
    fn receive(&mut self, sender: Processor, request: &Request) -> Response {
        let Some(queue) = &mut self.queue else {
            return Response::new(Code::Busy, 0);
        };
        let identity = request.identity();
        let in_control = |queue: &Queue| queue.in_control().unwrap_or(0);
        let verb = Verb::from_number(request.verb);
        match verb.filter(|_| request.version == VERSION) {
            Some(Verb::Open) => {
                let Some(opened) = self.opened.get_mut(sender.index()) else {
                    return Response::new(Code::Wrong, 0);
                };
                match opened.take() {
                    Some(session) if session != 0 => Response::new(Code::Done, session),
                    _ => {
                        *opened = Some(0);
                        Response::new(Code::Pending, 0)
                    }
                }
            }
            Some(Verb::Control) => {
                let before = queue.in_control();
                queue.take_control(request.session, request.number == 1);
                let now = queue.in_control();
                if now != before {
                    self.taken_by = now;
                }
                Response::new(Code::Done, in_control(queue))
            }
            Some(Verb::Offer) => match queue.answer(identity) {
                Answer::New => {
                    let is_here = self.inbox.iter().any(|it| it.identity() == identity);
                    if request.body().is_none() {
                        Response::new(Code::Wrong, 0)
                    } else if is_here || self.inbox.push_back(*request).is_ok() {
                        Response::new(Code::Pending, 0)
                    } else {
                        Response::new(Code::Busy, 0)
                    }
                }
                answer => Response::of(answer, queue.before(identity).unwrap_or(0)),
            },
            Some(Verb::Look) => {
                Response::of(queue.answer(identity), queue.before(identity).unwrap_or(0))
            }
            Some(Verb::Abort) => {
                if queue.in_control() == Some(request.session) {
                    self.is_aborted = true;
                    // What nobody has decided about is as new as before.
                    self.inbox.clear();
                }
                Response::new(Code::Done, in_control(queue))
            }
            Some(Verb::GiveUp) => {
                queue.give_up_control(request.session);
                Response::new(Code::Done, 0)
            }
            None => Response::new(Code::Wrong, 0),
        }
    }
}

/// Answers a request that came by message.
pub(super) fn receive(post: &SharedPost, sender: Processor, request: &Request) -> Response {
    with(post, |post| post.receive(sender, request)).unwrap_or(Response::new(Code::Busy, 0))
}

/// Does something with the post; `None` if that is in progress already.
fn with<R>(post: &SharedPost, work: impl FnOnce(&mut Post) -> R) -> Option<R> {
    critical_section::with(|section| {
        let mut post = post.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut post))
    })
}

/// The background's side.
pub(super) struct Requests<'r, M: Machine> {
    post: &'r SharedPost,
    files: &'r FilesOf<'r, M>,
    /// The session of the terminal, and the number of its last request.
    terminal: Identity,
    /// Whether somebody has typed that the terminal is in control: then it stays so.
    keeps_control: bool,
    /// How the request that ran has ended, if that could not be written.
    ending: Option<(State, Reason)>,
    /// Why all requests are to end, if that could not be written.
    aborting: Option<Reason>,
}

impl<'r, M: Machine> Requests<'r, M> {
    /// Reads the ledger of the former life, and opens the session of the terminal.
    pub(super) fn new(
        post: &'r SharedPost,
        files: &'r FilesOf<'r, M>,
    ) -> Result<Self, Problem<'static>> {
        let mut bytes = [0; ROW_BYTES * Queue::ROWS];
        let options = OpenOptions::new().read().write().create();
        let len = file::read(files, LEDGER, options, &mut bytes).map_err(Problem::LedgerFile)?;
        let mut write = |row: usize, bytes: &Row| write::<M>(files, row, bytes);
        let bytes = bytes.get(..len).unwrap_or(&[]);
        let restored = Queue::restore(bytes, &mut write);
        let mut queue = restored.map_err(|error| match error {
            RestoreError::Write(error) => Problem::LedgerFile(error),
            RestoreError::Ledger(error) => Problem::Ledger(error),
            _ => Problem::Nothing,
        })?;
        let session = queue.open(&mut write).map_err(Problem::LedgerFile)?;
        let terminal = Identity {
            // Nobody else is in control, and nothing runs: a place is free.
            session: session.unwrap_or(0),
            number: 0,
        };
        with(post, |post| post.queue = Some(queue));
        Ok(Self {
            post,
            files,
            terminal,
            keeps_control: false,
            ending: None,
            aborting: None,
        })
    }

    /// Works on the queue, which handlers do not have meanwhile: what is written may take long.
    fn on_queue<R>(
        &self,
        work: impl FnOnce(
            &mut Queue,
            &mut dyn FnMut(usize, &Row) -> Result<(), FileError>,
        ) -> Result<R, FileError>,
    ) -> Result<Option<R>, Problem<'static>> {
        let Some(mut queue) = with(self.post, |post| post.queue.take()).flatten() else {
            return Ok(None);
        };
        let mut write = |row: usize, bytes: &Row| write::<M>(self.files, row, bytes);
        self.files.set_timeout(WRITE_TIMEOUT);
        let outcome = work(&mut queue, &mut write);
        self.files.set_timeout(FILES_TIMEOUT);
        with(self.post, |post| post.queue = Some(queue));
        outcome.map(Some).map_err(Problem::LedgerFile)
    }

    /// Deals with what has come by message. Returns whether a client has ended all motion.
    pub(super) fn attend(
        &mut self,
        mut say: impl FnMut(core::fmt::Arguments<'_>),
    ) -> Result<bool, Problem<'static>> {
        let own = self.terminal.session;
        let is_aborted = with(self.post, |post| core::mem::take(&mut post.is_aborted));
        if is_aborted == Some(true) {
            return Ok(true);
        }
        let news = with(self.post, |post| {
            if let Some(queue) = &mut post.queue
                && queue.waiting() == 0
                && queue.running().is_none()
                && !self.keeps_control
            {
                queue.give_up_control(own);
            }
            let asks = post.opened.iter().position(|it| *it == Some(0));
            let taken = post.taken_by.take();
            (asks, post.inbox.pop_front(), taken)
        });
        let Some((asks, request, taken_by)) = news else {
            return Ok(false);
        };
        if let Some(session) = taken_by {
            say(format_args!("session {session} is in control"));
        }
        if let Some(asks) = asks {
            let opened = self.on_queue(|queue, write| queue.open(write))?.flatten();
            with(self.post, |post| {
                if let Some(place) = post.opened.get_mut(asks) {
                    // Without a place it asks again.
                    *place = opened;
                }
            });
        }
        if let Some(request) = request {
            let made = Work::of(&request);
            self.on_queue(|queue, write| queue.offer(request.identity(), write, || made))?;
        }
        Ok(false)
    }

    /// Enqueues what was typed.
    pub(super) fn enqueue(&mut self, work: Work) -> Result<(), Problem<'static>> {
        self.take_control(false)?;
        self.terminal.number = self.terminal.number.wrapping_add(1);
        let identity = self.terminal;
        match self.on_queue(|queue, write| queue.offer(identity, write, || Ok(work)))? {
            Some(Answer::Known(State::Refused, reason)) => Err(Problem::Refused(reason)),
            Some(Answer::Known(..)) => Ok(()),
            _ => Err(Problem::NoSession),
        }
    }

    /// Has the terminal in control, if nobody else is or `from_other`.
    pub(super) fn take_control(&mut self, from_other: bool) -> Result<(), Problem<'static>> {
        self.reopen()?;
        let session = self.terminal.session;
        self.keeps_control |= from_other;
        let other = with(self.post, |post| {
            let queue = post.queue.as_mut()?;
            queue.take_control(session, from_other);
            queue.in_control().filter(|it| *it != session)
        });
        match other.flatten() {
            Some(other) => {
                self.keeps_control = false;
                Err(Problem::InControl(other))
            }
            None => Ok(()),
        }
    }

    /// Opens another session for the terminal if those of clients have taken the place of its own.
    fn reopen(&mut self) -> Result<(), Problem<'static>> {
        let terminal = self.terminal;
        let opened = self.on_queue(|queue, write| match queue.answer(terminal) {
            Answer::NoSession => queue.open(write),
            _ => Ok(Some(terminal.session)),
        });
        let session = opened?.flatten().ok_or(Problem::NoSession)?;
        if session != terminal.session {
            self.terminal = Identity { session, number: 0 };
        }
        Ok(())
    }

    /// The next request and its work, if none runs. Begin it, or refuse it.
    pub(super) fn next(&mut self) -> Result<Option<(Identity, Work)>, Problem<'static>> {
        if let Some(reason) = self.aborting {
            self.abort(reason)?;
        }
        if let Some((state, reason)) = self.ending {
            self.end(state, reason)?;
        }
        let next = with(self.post, |post| {
            let queue = post.queue.as_ref()?;
            let (identity, work) = queue.next()?;
            Some((identity, work.clone()))
        });
        Ok(next.flatten())
    }

    /// The next request cannot run.
    pub(super) fn refuse(&mut self, reason: Reason) -> Result<(), Problem<'static>> {
        self.on_queue(|queue, write| queue.refuse_next(reason, write))
            .map(drop)
    }

    /// The next request begins.
    pub(super) fn begin(&mut self) -> Result<(), Problem<'static>> {
        self.on_queue(|queue, write| queue.start(write)).map(drop)
    }

    /// The request that runs has ended; if that cannot be written now, it is tried again.
    pub(super) fn end(&mut self, state: State, reason: Reason) -> Result<(), Problem<'static>> {
        let ended = self.on_queue(|queue, write| queue.end(state, reason, write));
        self.ending = match &ended {
            Ok(Some(())) => None,
            _ => Some((state, reason)),
        };
        ended.map(drop)
    }

    /// All requests have ended; if that cannot be written now, it is tried again before the next one.
    pub(super) fn abort(&mut self, reason: Reason) -> Result<(), Problem<'static>> {
        self.aborting = Some(reason);
        with(self.post, |post| post.inbox.clear());
        self.end(State::Aborted, reason)?;
        let aborted = self.on_queue(|queue, write| queue.abort(reason, write))?;
        if aborted.is_some() {
            self.aborting = None;
        }
        Ok(())
    }

    pub(super) fn is_own(&self, session: u32) -> bool {
        session == self.terminal.session
    }

    /// How many requests wait, and the session that is in control.
    pub(super) fn waiting(&self) -> (usize, Option<u32>) {
        let seen = with(self.post, |post| {
            let queue = post.queue.as_ref()?;
            Some((queue.waiting(), queue.in_control()))
        });
        seen.flatten().unwrap_or((0, None))
    }
}

fn write<M: Machine>(files: &FilesOf<'_, M>, row: usize, bytes: &Row) -> Result<(), FileError> {
    let mut file = files.open(LEDGER, OpenOptions::new().write())?;
    file.seek(SeekFrom::Start((row * ROW_BYTES) as u64))?;
    // A row does not cross a page, and comes as a whole or not at all.
    file::write_all(&mut file, bytes)?;
    file.close()
}
