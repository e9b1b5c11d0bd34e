//! [`Requests`]: the master's queue of motions, with its ledger in a file.

use condor_hand::trajectory::image::MotionSequence;
use condor_hand::trajectory::{Begin, MotionError, Pace, Profile, Target};
use condor_mbox::{Clock, PeerState, Processor};
use condor_rt::{Background, FilesOf, Machine, MailboxOf};

use super::drive::{ALL, Motion};
use super::play::check;
use super::words::{MotionName, Problem, is_name};
use crate::RobotDescription;
use crate::joints::JointNumbers;
use crate::motions::{BODY_BYTES, MotionsEvent, MotionsPost, MotionsServer, Offer};
use crate::queue::{InControl, MotionQueue, OWN, RequestIdentity, RestoreError, SessionOwner};

mod ledger;

use ledger::LedgerFile;

/// Requests that wait for their turn; the outcomes of four times as many are known. Twice as many
/// clients have a session.
const WAITING: usize = 8;

type Queue = MotionQueue<Work, WAITING>;
/// The memory in which the handler of messages about the queue and the background meet.
pub(super) type Post = MotionsPost<Work, WAITING>;
type Server<'r, M> = MotionsServer<'r, Work, LedgerFile<'r, M>, WAITING>;

/// The work of a request.
#[derive(Clone, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "nothing is allocated, and few requests wait"
)]
pub(super) enum Work {
    /// The motion of this name, in its file.
    Named(MotionName),
    /// The motions in memory, recorded or loaded, under this name.
    Kept(MotionName),
    /// One joint goes to a position.
    Joint(JointMove),
    /// Motions in an image, which was checked, and the fingers that they move, a bit for each.
    Motions(heapless::Vec<u8, BODY_BYTES>, u32),
    /// A stream of the joints in this mask, which the robot has.
    Stream(u32),
}

/// A motion of one joint, by its number, beside other motions.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointMove {
    pub(super) joint: usize,
    pub(super) position: f64,
    pub(super) pace: Pace,
}

impl JointMove {
    pub(super) fn motion(self) -> Result<Motion, MotionError> {
        let motion = Motion::new(self.pace, Profile::MinimumJerk);
        let mut motion = motion.with(self.joint, Target::Absolute(self.position))?;
        motion.begin = Begin::Beside;
        Ok(motion)
    }
}

impl Work {
    /// Makes the work of what a client offers, and checks it.
    fn of(offer: Offer, hand: &RobotDescription) -> Result<Self, Problem<'static>> {
        let numbers = JointNumbers::of(hand);
        match offer {
            Offer::Motions(bytes) => {
                let name = core::str::from_utf8(&bytes).ok();
                if let Some(name) = name.filter(|name| is_name(name)) {
                    // Names are short enough.
                    return Ok(Self::Named(MotionName::try_from(name).unwrap_or_default()));
                }
                let motions = MotionSequence::<ALL>::new(numbers.count(), &bytes);
                let fingers = check(hand, motions.map_err(Problem::Offered)?.iter())?;
                Ok(Self::Motions(bytes, fingers))
            }
            Offer::Stream(0) => Err(Problem::Nothing),
            Offer::Stream(mask) => {
                let missing = |joint| Problem::NoSuchJoint { joint };
                numbers.check(mask).map_err(missing)?;
                Ok(Self::Stream(mask))
            }
        }
    }
}

/// The queue in the background, and the terminal that uses it, too.
pub(super) struct Requests<'r, M: Machine> {
    pub(super) server: Server<'r, M>,
    mailbox: &'r MailboxOf<'r, M>,
    hand: &'r RobotDescription,
    /// Whether somebody has typed that the terminal is in control: then it stays so.
    keeps_control: bool,
    /// The reason why the last offer of a client is refused, until it is told.
    refused: Option<Problem<'static>>,
}

impl<'r, M: Machine> Requests<'r, M> {
    /// Makes the requests with a ledger that [`attend`](Self::attend) reads.
    pub(super) fn new(
        post: &'r Post,
        files: &'r FilesOf<'r, M>,
        background: &'r Background<'r, M>,
        hand: &'r RobotDescription,
    ) -> Self {
        Self {
            server: Server::new(post, LedgerFile(files)),
            mailbox: background.mailbox(),
            hand,
            keeps_control: false,
            refused: None,
        }
    }

    /// Deals with what has come by message.
    pub(super) fn attend(&mut self) -> Result<Option<MotionsEvent>, Problem<'static>> {
        let (mailbox, hand) = (self.mailbox, self.hand);
        let incarnation = |processor: u32| {
            let processor = Processor(u8::try_from(processor).ok()?);
            match mailbox.peer_state(processor) {
                Ok(PeerState::Up { incarnation, .. }) => Some(incarnation),
                _ => None,
            }
        };
        let now = mailbox.doorbell().now();
        let refused = &mut self.refused;
        let make = |offer| {
            Work::of(offer, hand).map_err(|problem| {
                let reason = problem.reason();
                *refused = Some(problem);
                reason
            })
        };
        let news = self.server.attend(now, incarnation, make);
        let news = news.map_err(|error| match error {
            RestoreError::Ledger(error) => Problem::Ledger(error),
            RestoreError::Write(error) => error.into(),
        })?;
        self.keeps_control &= !matches!(news, Some(MotionsEvent::Taken(_)));
        let is_over = self.server.look(|queue| {
            let is_idle = queue.waiting() == 0 && queue.running().is_none();
            is_idle && queue.in_control() == InControl::Program
        });
        if is_over == Some(true) && !self.keeps_control {
            self.server.change(|queue, _| {
                queue.give_up_control(OWN);
                Ok(())
            })?;
        }
        Ok(news)
    }

    /// Returns the reason why the last offer of a client is refused, once.
    pub(super) fn take_refused(&mut self) -> Option<Problem<'static>> {
        self.refused.take()
    }

    /// Enqueues what was typed.
    pub(super) fn enqueue(&mut self, work: Work) -> Result<(), Problem<'static>> {
        self.take_control(false)?;
        match self.server.change(|queue, _| Ok(queue.enqueue(work)))? {
            Some(enqueued) => enqueued.map_err(Problem::Refused),
            None => Err(Problem::NoQueue),
        }
    }

    /// Has the terminal in control, if nobody else is or `from_other`.
    pub(super) fn take_control(&mut self, from_other: bool) -> Result<(), Problem<'static>> {
        self.keeps_control |= from_other;
        let other = self.server.change(|queue, _| {
            queue.take_control(OWN, from_other);
            Ok(match queue.in_control() {
                InControl::Session(session) => Some((session, queue.ledger().owner(session))),
                InControl::Program | InControl::Nobody => None,
            })
        })?;
        match other {
            Some(None) => Ok(()),
            Some(Some((session, owner))) => {
                self.keeps_control = false;
                Err(Problem::InControl { owner, session })
            }
            None => Err(Problem::NoQueue),
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
        let waits = |queue: &Queue| queue.works().any(|work| matches!(work, Work::Kept(_)));
        match self.server.look(waits) {
            Some(true) => Err(Problem::Running),
            _ => Ok(()),
        }
    }

    /// Returns the owner of the session of a request.
    pub(super) fn owner(&self, identity: RequestIdentity) -> Option<SessionOwner> {
        self.server
            .look(|queue| queue.ledger().owner(identity.session))
            .flatten()
    }

    /// Returns the number of requests that wait, and the owner of control.
    pub(super) fn waiting(&self) -> (usize, InControl) {
        let seen = (self.server).look(|queue| (queue.waiting(), queue.in_control()));
        seen.unwrap_or((0, InControl::Nobody))
    }
}
