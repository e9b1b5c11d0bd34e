//! [`Requests`]: the master's queue of motions, with its ledger in a file.

use core::fmt::Arguments;
use core::time::Duration;

use condor_hand::queue::{
    Answer, Identity, MotionQueue, Owner, ROW_BYTES, Reason, RestoreError, Row, State,
};
use condor_mbox::{Clock, Instant, PeerState, Processor};
use condor_rt::{Background, FilesOf, Machine, MailboxOf};

use super::play::Title;
use super::words::{Problem, RowError, is_name};
use crate::motions::{ALL, BODY_BYTES, Request, Verb};

mod ledger;
mod post;

use ledger::{LedgerFile, room};
pub(super) use post::{Post, receive};
use post::{SharedPost, with};

/// Requests that wait for their turn.
const WAITING: usize = 4;
/// Clients with a session, the terminal among them.
const SESSIONS: usize = 16;
/// Requests whose outcome is known.
const REMEMBERED: usize = 32;
/// After such a time a ledger that could not be read or written is tried again.
const AGAIN: Duration = Duration::from_millis(500);

pub(super) type Queue = MotionQueue<Work, WAITING, SESSIONS, REMEMBERED>;

/// What a request is to do.
#[derive(Clone, Debug)]
pub(super) struct Work {
    /// The name of a motion, an image of motions, or the mask of a stream.
    body: heapless::Vec<u8, BODY_BYTES>,
    /// Whether it is what is in memory, recorded or loaded, under this name.
    pub(super) is_kept: bool,
    /// The joints of a stream.
    pub(super) stream: Option<u32>,
    /// What the terminal calls it, if it has no name.
    pub(super) title: Option<Title>,
}

impl Work {
    /// The motion of this name.
    pub(super) fn named(name: &str, is_kept: bool) -> Self {
        // Names are short enough.
        let body = heapless::Vec::from_slice(name.as_bytes()).unwrap_or_default();
        Self {
            body,
            is_kept,
            stream: None,
            title: None,
        }
    }

    /// The motions of an image; `None` if it is too long.
    pub(super) fn of_image(image: &[u8], title: Title) -> Option<Self> {
        Some(Self {
            body: heapless::Vec::from_slice(image).ok()?,
            is_kept: false,
            stream: None,
            title: Some(title),
        })
    }

    /// What the body of a request says.
    fn of(request: &Request) -> Result<Self, Reason> {
        let bytes = request.body().ok_or(Reason::NoMotion)?;
        let stream = if request.verb == Verb::Stream as u32 {
            let mask = bytes.first_chunk().map(|mask| u32::from_le_bytes(*mask));
            let mask = mask.filter(|mask| (1..1 << ALL).contains(mask));
            Some(mask.ok_or(Reason::NoMotion)?)
        } else {
            None
        };
        Ok(Self {
            body: heapless::Vec::from_slice(bytes).map_err(|_| Reason::NoMotion)?,
            is_kept: false,
            stream,
            title: None,
        })
    }

    pub(super) fn name(&self) -> Option<&str> {
        let name = core::str::from_utf8(&self.body).ok();
        let is_named = self.title.is_none() && self.stream.is_none();
        name.filter(|name| is_named && is_name(name))
    }

    pub(super) fn image(&self) -> &[u8] {
        &self.body
    }
}

/// How the file of the ledger is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Condition {
    /// The ledger of the program's former life has not been read.
    Unread,
    /// The file must be made again from the queue in memory.
    Gone,
    /// The file agrees with the queue in memory.
    Whole,
}

/// The background's side.
pub(super) struct Requests<'r, M: Machine> {
    post: &'r SharedPost,
    file: LedgerFile<'r, M>,
    mailbox: &'r MailboxOf<'r, M>,
    /// The owner of the terminal's sessions, in all lives of this program.
    own: Owner,
    /// The session of the terminal, 0 at first, and the number of its last request.
    terminal: Identity,
    /// Whether somebody has typed that the terminal is in control: then it stays so.
    keeps_control: bool,
    ledger: Condition,
    /// When a ledger that could not be read or written is tried again.
    again: Option<Instant>,
    /// Whether the terminal has been told of that.
    has_complained: bool,
    /// How the request that ran has ended, if that could not be written.
    ending: Option<(State, Reason)>,
    /// Why all requests are to end, if that could not be written.
    aborting: Option<Reason>,
}

impl<'r, M: Machine> Requests<'r, M> {
    /// With a ledger that [`attend`](Self::attend) reads.
    pub(super) fn new(
        post: &'r SharedPost,
        files: &'r FilesOf<'r, M>,
        background: &'r Background<'r, M>,
    ) -> Self {
        Self {
            post,
            file: LedgerFile(files),
            mailbox: background.mailbox(),
            own: Owner {
                processor: background.machine().number().0.into(),
                life: 0,
            },
            terminal: Identity {
                session: 0,
                number: 0,
            },
            keeps_control: false,
            ledger: Condition::Unread,
            again: None,
            has_complained: false,
            ending: None,
            aborting: None,
        }
    }

    /// Reads the ledger of the former life.
    fn restore(&self) -> Result<Queue, Problem<'static>> {
        let mut bytes = room();
        let (bytes, time) = self.file.read(&mut bytes).map_err(RowError::File)?;
        // It is written as a whole below.
        let restored = Queue::restore(bytes, time, |_, _| Ok::<_, RowError>(()));
        let queue = restored.map_err(|error| match error {
            RestoreError::Ledger(error) => Problem::Ledger(error),
            RestoreError::Write(error) => error.into(),
            _ => Problem::NoSession,
        })?;
        self.file.replace(&queue).map_err(RowError::File)?;
        Ok(queue)
    }

    /// Reads the ledger, or makes its file anew, if that is to be done; says only once why it cannot.
    fn mend(&mut self) -> Result<(), Problem<'static>> {
        let mended = self.try_to_mend();
        let has_complained = self.has_complained;
        self.has_complained =
            self.ledger != Condition::Whole && (has_complained || mended.is_err());
        if has_complained { Ok(()) } else { mended }
    }

    fn try_to_mend(&mut self) -> Result<(), Problem<'static>> {
        if self.ledger == Condition::Whole {
            return Ok(());
        }
        let now = self.mailbox.doorbell().now();
        if self.again.is_some_and(|again| again.ns_since(now) > 0) {
            return Ok(());
        }
        self.again = Some(now.after(AGAIN));
        if self.ledger == Condition::Unread {
            let queue = self.restore()?;
            with(self.post, |post| post.queue = Some(queue));
            self.ledger = Condition::Whole;
        } else if let Some(queue) = with(self.post, |post| post.queue.take()).flatten() {
            let replaced = self.file.replace(&queue);
            with(self.post, |post| post.queue = Some(queue));
            replaced.map_err(RowError::File)?;
            self.ledger = Condition::Whole;
        }
        Ok(())
    }

    /// Works on the queue, which handlers do not have meanwhile: what is written may take long.
    fn on_queue<R>(
        &mut self,
        work: impl FnOnce(
            &mut Queue,
            &mut dyn FnMut(usize, &Row) -> Result<(), RowError>,
        ) -> Result<R, RowError>,
    ) -> Result<Option<R>, Problem<'static>> {
        let Some(mut queue) = with(self.post, |post| post.queue.take()).flatten() else {
            return Ok(None);
        };
        let mut write = |row: usize, bytes: &[u8; ROW_BYTES]| self.file.write(row, bytes);
        let outcome = work(&mut queue, &mut write);
        with(self.post, |post| post.queue = Some(queue));
        if outcome.as_ref().is_err_and(RowError::is_file_gone) {
            self.ledger = Condition::Gone;
        }
        Ok(outcome.map(Some)?)
    }

    /// Closes the sessions of clients whose programs have ended.
    fn close_gone(&mut self, say: &mut impl FnMut(Arguments<'_>)) -> Result<(), Problem<'static>> {
        let own = self.own;
        let mut sessions = heapless::Vec::<_, SESSIONS>::new();
        with(self.post, |post| {
            let Some(queue) = &post.queue else {
                return;
            };
            for session in queue.sessions().filter(|it| !queue.is_closed(it.0)) {
                // There are as many places.
                let _ = sessions.push(session);
            }
        });
        for &(session, owner) in &sessions {
            if owner == own || self.life(owner.processor) == Some(owner.life) {
                continue;
            }
            let was_in_control = self.on_queue(|queue, write| queue.close(session, write))?;
            if was_in_control == Some(true) {
                say(format_args!(
                    "the client of session {session} is gone: nobody is in control"
                ));
            }
        }
        Ok(())
    }

    /// The present life of a processor, if it has one.
    fn life(&self, processor: u32) -> Option<u32> {
        let processor = Processor(u8::try_from(processor).ok()?);
        match self.mailbox.peer_state(processor) {
            Ok(PeerState::Up { incarnation, .. }) => Some(incarnation),
            _ => None,
        }
    }

    /// Deals with what has come by message. Returns whether a client has ended all motion.
    pub(super) fn attend(
        &mut self,
        mut say: impl FnMut(Arguments<'_>),
    ) -> Result<bool, Problem<'static>> {
        self.mend()?;
        let own = self.terminal.session;
        let is_aborted = with(self.post, |post| core::mem::take(&mut post.is_aborted));
        if is_aborted == Some(true) {
            return Ok(true);
        }
        self.close_gone(&mut say)?;
        let news = with(self.post, |post| {
            let queue = post.queue.as_mut()?;
            let taken_by = post.taken_by.take();
            self.keeps_control &= taken_by.is_none();
            if queue.waiting() == 0 && queue.running().is_none() && !self.keeps_control {
                queue.give_up_control(own);
            }
            Some((post.next_to_open(), post.inbox.pop_front(), taken_by))
        });
        let Some((asks, request, taken_by)) = news.flatten() else {
            return Ok(false);
        };
        if let Some(session) = taken_by {
            say(format_args!("session {session} is in control"));
        }
        if let Some(asks) = asks
            && let Some(life) = self.life(asks.0.into())
        {
            let owner = Owner {
                processor: asks.0.into(),
                life,
            };
            let opened = self.on_queue(|queue, write| queue.open(owner, write))?;
            with(self.post, |post| post.open(asks, opened.flatten()));
        }
        if let Some((sender, request)) = request {
            let made = Work::of(&request);
            let identity = request.identity();
            let life = self.life(sender.0.into());
            self.on_queue(|queue, write| {
                let owner = queue.owner(identity.session);
                // A life that has ended since then has no say any more.
                if owner.is_some_and(|owner| Some(owner.life) == life) {
                    queue.offer(identity, write, || made).map(drop)
                } else {
                    Ok(())
                }
            })?;
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

    /// Returns an error unless the terminal may move the hand by other means than a request: it is in
    /// control, and no request runs or waits.
    pub(super) fn check_free(&mut self) -> Result<(), Problem<'static>> {
        self.take_control(false)?;
        let busy = with(self.post, |post| {
            let queue = post.queue.as_ref()?;
            Some(queue.running().is_some() || queue.waiting() > 0)
        });
        match busy.flatten() {
            Some(false) => Ok(()),
            _ => Err(Problem::Running),
        }
    }

    /// Returns an error if what is in memory waits to run: it must stay as it is.
    pub(super) fn check_kept(&self) -> Result<(), Problem<'static>> {
        let waits = with(self.post, |post| {
            let mut works = post.queue.iter().flat_map(Queue::works);
            works.any(|work| work.is_kept)
        });
        match waits {
            Some(false) => Ok(()),
            _ => Err(Problem::Running),
        }
    }

    /// Opens a session for the terminal if it has none, or those of clients have taken its place.
    fn reopen(&mut self) -> Result<(), Problem<'static>> {
        let (terminal, own) = (self.terminal, self.own);
        let opened = self.on_queue(|queue, write| match queue.answer(terminal) {
            Answer::NoSession => queue.open(own, write),
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
        if self.ledger != Condition::Whole {
            return Ok(None);
        }
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

    /// The next request begins. Returns whether it does: the queue may be in use.
    pub(super) fn begin(&mut self) -> Result<bool, Problem<'static>> {
        with(self.post, |post| post.progress = 0);
        let begun = self.on_queue(|queue, write| queue.start(write))?;
        Ok(begun.flatten().is_some())
    }

    /// How far the request is that runs, in thousandths.
    pub(super) fn tell_progress(&self, progress: u32) {
        with(self.post, |post| post.progress = progress);
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

    /// Who opened a session.
    pub(super) fn owner(&self, session: u32) -> Option<Owner> {
        with(self.post, |post| post.queue.as_ref()?.owner(session)).flatten()
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
