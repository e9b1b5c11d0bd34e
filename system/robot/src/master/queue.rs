//! [`Requests`]: the master's queue of motions, with its ledger in a file.

use condor_hand::message::motions::{BODY_BYTES, MotionsEvent, MotionsPost, MotionsServer, Offer};
use condor_hand::queue::{
    MotionQueue, QueueAnswer, RefusalReason, RequestIdentity, RequestState, RestoreError,
    SessionOwner,
};
use condor_mbox::{Clock, PeerState, Processor};
use condor_rt::{Background, FilesOf, Machine, MailboxOf};

use super::drive::ALL;
use super::play::Title;
use super::words::{Problem, is_name};

mod ledger;

use ledger::LedgerFile;

/// Requests that wait for their turn; the outcomes of four times as many are known. Twice as many
/// clients have a session, the terminal among them.
const WAITING: usize = 8;

type Queue = MotionQueue<Work, WAITING>;
/// The memory in which the handler of messages about the queue and the background meet.
pub(super) type Post = MotionsPost<Work, WAITING>;
type Server<'r, M> = MotionsServer<'r, Work, LedgerFile<'r, M>, WAITING>;

/// The work of a request.
#[derive(Clone, Debug)]
pub(super) struct Work {
    /// The name of a motion, or an image of motions.
    body: heapless::Vec<u8, BODY_BYTES>,
    /// Whether it is what is in memory, recorded or loaded, under this name.
    pub(super) is_kept: bool,
    /// The joints of a stream.
    pub(super) stream: Option<u32>,
    /// The title at the terminal, if it has no name.
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

    /// Makes the work from the offer of a client.
    fn of(offer: Offer<'_>) -> Result<Self, RefusalReason> {
        let (body, stream) = match offer {
            Offer::Motions(body) => (body, None),
            Offer::Stream(mask) if (1..1 << ALL).contains(&mask) => (&[][..], Some(mask)),
            Offer::Stream(_) => return Err(RefusalReason::NoMotion),
        };
        Ok(Self {
            body: heapless::Vec::from_slice(body).map_err(|_| RefusalReason::NoMotion)?,
            is_kept: false,
            stream,
            title: None,
        })
    }

    pub(super) fn name(&self) -> Option<&str> {
        let name = core::str::from_utf8(&self.body).ok();
        name.filter(|name| self.title.is_none() && is_name(name))
    }

    pub(super) fn image(&self) -> &[u8] {
        &self.body
    }
}

/// The queue in the background, and the terminal as a client of it.
pub(super) struct Requests<'r, M: Machine> {
    pub(super) server: Server<'r, M>,
    mailbox: &'r MailboxOf<'r, M>,
    /// The owner of the terminal's sessions, in all incarnations of this program.
    own: SessionOwner,
    /// The session of the terminal, 0 at first, and the number of its last request.
    terminal: RequestIdentity,
    /// Whether somebody has typed that the terminal is in control: then it stays so.
    keeps_control: bool,
}

impl<'r, M: Machine> Requests<'r, M> {
    /// Makes the requests with a ledger that [`attend`](Self::attend) reads.
    pub(super) fn new(
        post: &'r Post,
        files: &'r FilesOf<'r, M>,
        background: &'r Background<'r, M>,
    ) -> Self {
        Self {
            server: Server::new(post, LedgerFile(files)),
            mailbox: background.mailbox(),
            own: SessionOwner {
                processor: background.machine().number().0.into(),
                incarnation: 0,
            },
            terminal: RequestIdentity {
                session: 0,
                number: 0,
            },
            keeps_control: false,
        }
    }

    /// Deals with what has come by message.
    pub(super) fn attend(&mut self) -> Result<Option<MotionsEvent>, Problem<'static>> {
        let (own, mailbox) = (self.own, self.mailbox);
        let incarnation = |processor: u32| {
            if processor == own.processor {
                return Some(own.incarnation);
            }
            let processor = Processor(u8::try_from(processor).ok()?);
            match mailbox.peer_state(processor) {
                Ok(PeerState::Up { incarnation, .. }) => Some(incarnation),
                _ => None,
            }
        };
        let news = self
            .server
            .attend(mailbox.doorbell().now(), incarnation, Work::of);
        let news = news.map_err(|error| match error {
            RestoreError::Ledger(error) => Problem::Ledger(error),
            RestoreError::Write(error) => error.into(),
            _ => Problem::NoSession,
        })?;
        self.keeps_control &= !matches!(news, Some(MotionsEvent::Taken(_)));
        let session = self.terminal.session;
        let is_over = self.server.look(|queue| {
            let is_idle = queue.waiting() == 0 && queue.running().is_none();
            is_idle && queue.in_control() == Some(session)
        });
        if is_over == Some(true) && !self.keeps_control {
            self.server.change(|queue, _| {
                queue.give_up_control(session);
                Ok(())
            })?;
        }
        Ok(news)
    }

    /// Enqueues what was typed.
    pub(super) fn enqueue(&mut self, work: Work) -> Result<(), Problem<'static>> {
        self.take_control(false)?;
        self.terminal.number = self.terminal.number.wrapping_add(1);
        let identity = self.terminal;
        let make = || Ok(work);
        match (self.server).change(|queue, write| queue.offer(identity, write, make))? {
            Some(QueueAnswer::Known(RequestState::Refused, reason)) => {
                Err(Problem::Refused(reason))
            }
            Some(QueueAnswer::Known(..)) => Ok(()),
            _ => Err(Problem::NoSession),
        }
    }

    /// Has the terminal in control, if nobody else is or `from_other`.
    pub(super) fn take_control(&mut self, from_other: bool) -> Result<(), Problem<'static>> {
        self.reopen()?;
        let session = self.terminal.session;
        self.keeps_control |= from_other;
        let other = self.server.change(|queue, _| {
            queue.take_control(session, from_other);
            Ok(queue.in_control().filter(|it| *it != session))
        })?;
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
        let busy = (self.server).look(|queue| queue.running().is_some() || queue.waiting() > 0);
        match busy {
            Some(false) => Ok(()),
            _ => Err(Problem::Running),
        }
    }

    /// Returns an error if what is in memory waits to run: it must stay as it is.
    pub(super) fn check_kept(&self) -> Result<(), Problem<'static>> {
        match (self.server).look(|queue| queue.works().any(|work| work.is_kept)) {
            Some(true) => Err(Problem::Running),
            _ => Ok(()),
        }
    }

    /// Opens a session for the terminal if it has none, or those of clients have taken its place.
    fn reopen(&mut self) -> Result<(), Problem<'static>> {
        let (terminal, own) = (self.terminal, self.own);
        let opened = self
            .server
            .change(|queue, write| match queue.answer(terminal) {
                QueueAnswer::NoSession => Ok((queue.open(own, write)?, queue.is_exhausted())),
                _ => Ok((Some(terminal.session), false)),
            })?;
        let session = match opened {
            Some((Some(session), _)) => session,
            Some((None, true)) => return Err(Problem::Exhausted),
            _ => return Err(Problem::NoSession),
        };
        if session != terminal.session {
            self.terminal = RequestIdentity { session, number: 0 };
        }
        Ok(())
    }

    /// Returns the owner of a session.
    pub(super) fn owner(&self, session: u32) -> Option<SessionOwner> {
        self.server.look(|queue| queue.owner(session)).flatten()
    }

    pub(super) fn is_own(&self, session: u32) -> bool {
        session == self.terminal.session
    }

    /// Returns the number of requests that wait, and the session that is in control.
    pub(super) fn waiting(&self) -> (usize, Option<u32>) {
        let seen = (self.server).look(|queue| (queue.waiting(), queue.in_control()));
        seen.unwrap_or((0, None))
    }
}
