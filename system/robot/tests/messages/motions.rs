//! Tests of a motion queue that is asked by message.

use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use condor_hand::trajectory::{JointStream, ProfileLimits, StreamEnd, StreamPoint};
use condor_mbox::sim::{SimMailbox, SimSystem, SimWindow};
use condor_mbox::{Allocator, Call, MemoryWindow, Messenger, PeerState, Processor, Region};
use condor_robot::motions::{
    Batch, LedgerStore, MOTIONS, MotionRequest, MotionRequestPacket, MotionResponse,
    MotionResponsePacket, MotionsBlocks, MotionsClient, MotionsEvent, MotionsPost, MotionsServer,
    Offer, PackedBatch, RequestProgress, SentPoints, StreamRequest,
};
use condor_robot::packet::{self, ClientError};
use condor_robot::queue::{
    InControl, LedgerRow, MotionQueue, OWN, QueueAnswer, RefusalReason, RequestIdentity,
    RequestState, SessionOwner,
};
use proptest::prelude::*;
use zerocopy::IntoBytes;

/// The controller of an arm of two joints, and its clients.
const ARM: Processor = Processor(0);
const FIRST: Processor = Processor(1);
const SECOND: Processor = Processor(2);
const SOON: Duration = Duration::from_secs(1);
const DATA_BYTES: u32 = 8192;

type Queue = MotionQueue<Work, 2>;
type Client = MotionsClient<'static, SimMailbox<'static, 3>, SimWindow>;
type Post = MotionsPost<Work, 2>;
type Server = MotionsServer<'static, Work, Rows, 2>;

/// The motion or stream of a request.
#[derive(Clone, Debug, PartialEq)]
enum Work {
    Motion(Vec<u8>),
    Stream(u32),
}

impl Work {
    fn of(offer: Offer) -> Result<Self, RefusalReason> {
        match offer {
            Offer::Motions(name) if name == b"backflip" => Err(RefusalReason::NoMotion),
            Offer::Motions(name) => Ok(Self::Motion(name.to_vec())),
            Offer::Stream(mask @ 1..4) => Ok(Self::Stream(mask)),
            Offer::Stream(_) => Err(RefusalReason::Limits),
        }
    }
}

/// Rows in memory that fail when they are told to.
#[derive(Clone, Default)]
struct Rows {
    bytes: Arc<Mutex<Vec<LedgerRow>>>,
    fails: Arc<AtomicBool>,
}

/// The reason why rows cannot be read or written.
#[derive(Debug, PartialEq)]
enum Failed {
    Now,
    Missing,
}

impl Rows {
    fn check(&self) -> Result<(), Failed> {
        let fails = self.fails.load(Ordering::Relaxed);
        if fails { Err(Failed::Now) } else { Ok(()) }
    }
}

impl LedgerStore for Rows {
    type Error = Failed;

    fn read<T>(&mut self, restore: impl FnOnce(&[u8], u32) -> T) -> Result<T, Failed> {
        self.check()?;
        Ok(restore(&self.bytes.lock().unwrap().concat(), 1))
    }

    fn replace(&mut self, rows: impl Iterator<Item = LedgerRow>) -> Result<(), Failed> {
        self.check()?;
        *self.bytes.lock().unwrap() = rows.collect();
        Ok(())
    }

    fn write(&mut self, row: usize, bytes: &LedgerRow) -> Result<(), Failed> {
        self.check()?;
        let mut rows = self.bytes.lock().unwrap();
        *rows.get_mut(row).ok_or(Failed::Missing)? = *bytes;
        Ok(())
    }
}

/// The background of the arm.
struct Arm {
    server: Server,
    mailbox: SimMailbox<'static, 3>,
    news: Vec<MotionsEvent>,
    /// The errors of the server.
    errors: Vec<String>,
    /// The requests that have begun, in this order.
    begun: Vec<(RequestIdentity, Work)>,
    stream: &'static Mutex<Option<StreamRequest<2, 8>>>,
    /// True if motions end in the turn in which they begin.
    is_quick: bool,
    /// True if only the handler works.
    is_away: bool,
    /// True if the handler works only while the background looks for the incarnation of a client.
    serves_late: bool,
}

impl Arm {
    fn turn(&mut self) {
        let mailbox = &self.mailbox;
        if !self.serves_late {
            mailbox.serve(Duration::ZERO).unwrap();
        }
        if self.is_away {
            return;
        }
        let incarnation = |processor| {
            mailbox.serve(Duration::ZERO).unwrap();
            match mailbox.peer_state(Processor(processor as u8)) {
                Ok(PeerState::Up { incarnation, .. }) => Some(incarnation),
                _ => None,
            }
        };
        match self.server.attend(mailbox.now(), incarnation, Work::of) {
            Ok(Some(MotionsEvent::Aborted)) => {
                *self.stream.lock().unwrap() = None;
                if let Err(error) = self.server.abort(RefusalReason::Command) {
                    self.errors.push(format!("{error:?}"));
                }
                self.news.push(MotionsEvent::Aborted);
            }
            Ok(news) => self.news.extend(news),
            Err(error) => self.errors.push(format!("{error:?}")),
        }
        if let Some((identity, work)) = self.server.next_request()
            && self.server.begin() == Ok(true)
        {
            if let Work::Stream(mask) = work {
                let owner = self
                    .server
                    .look(|queue| queue.ledger().owner(identity.session));
                let stream = JointStream::new(mask, [LIMITS; 2], [0.0; 2], 0.02, 50).unwrap();
                let request = StreamRequest::new(identity, owner.flatten().unwrap(), stream);
                *self.stream.lock().unwrap() = Some(request);
            } else if self.is_quick {
                self.server
                    .end(RequestState::Done, RefusalReason::None)
                    .unwrap();
            } else {
                self.server.tell_progress(Some(0.25));
            }
            self.begun.push((identity, work));
        }
    }

    /// One tick of the stream.
    fn tick(&mut self) {
        let mut stream = self.stream.lock().unwrap();
        let Some(request) = stream.as_mut() else {
            return;
        };
        request.stream.tick();
        let end = match request.stream.end() {
            None => return,
            Some(StreamEnd::Done) => (RequestState::Done, RefusalReason::None),
            Some(StreamEnd::Starved) => (RequestState::Aborted, RefusalReason::Starved),
            Some(StreamEnd::Aborted) => (RequestState::Aborted, RefusalReason::Command),
        };
        *stream = None;
        self.server.end(end.0, end.1).unwrap();
    }
}

const LIMITS: ProfileLimits = ProfileLimits {
    low: -1.0,
    high: 1.0,
    velocity: 2.0,
    acceleration: 20.0,
    jerk: 1e4,
};

/// The arm and its clients, in virtual time.
struct Rig {
    system: SimSystem<3>,
    blocks: MotionsBlocks,
    rows: Rows,
    arm: Arc<Mutex<Arm>>,
}

impl Rig {
    fn new() -> Self {
        Self::with(Rows::default())
    }

    /// An arm with the rows of its former incarnation.
    fn with(rows: Rows) -> Self {
        let system = SimSystem::in_virtual_time(DATA_BYTES);
        let data = system.windows(ARM)[ARM.index()].data.clone();
        let own = Region::users(data).unwrap();
        let blocks = MotionsBlocks::new(&mut Allocator::new(own.size()), 3).unwrap();
        let post: &Post = Box::leak(Box::default());
        let stream: &Mutex<Option<StreamRequest<2, 8>>> = Box::leak(Box::default());
        let handler = Box::leak(Box::new(move |call: &Call<'_>| {
            post.answer(call, &blocks, &own, |sender, identity, batch| {
                let mut stream = stream.lock().unwrap();
                stream.as_mut()?.take(sender, identity, batch)
            })
        }));
        let mut mailbox = system.mailbox(ARM).unwrap();
        mailbox.set_vector(MOTIONS, handler, "motions").unwrap();
        mailbox.join().unwrap();
        let arm = Arc::new(Mutex::new(Arm {
            server: Server::new(post, rows.clone()),
            mailbox,
            news: Vec::new(),
            errors: Vec::new(),
            begun: Vec::new(),
            stream,
            is_quick: false,
            is_away: false,
            serves_late: false,
        }));
        let turning = Arc::clone(&arm);
        system.while_waiting(ARM, move || turning.lock().unwrap().turn());
        Self {
            system,
            blocks,
            rows,
            arm,
        }
    }

    /// An incarnation of a client's program, which ends only when it is killed.
    fn mailbox(&self, number: Processor) -> &'static SimMailbox<'static, 3> {
        let mut mailbox = self.system.mailbox(number).unwrap();
        mailbox.join().unwrap();
        Box::leak(Box::new(mailbox))
    }

    fn region(&self, of: Processor) -> Region<SimWindow> {
        Region::users(self.system.windows(of)[ARM.index()].data.clone()).unwrap()
    }

    fn client(&self, mailbox: &'static SimMailbox<'static, 3>) -> Client {
        let region = self.region(mailbox.number());
        MotionsClient::new(mailbox, ARM, &self.blocks, &region).unwrap()
    }

    fn arm<T>(&self, look: impl FnOnce(&mut Arm) -> T) -> T {
        look(&mut self.arm.lock().unwrap())
    }

    /// A request that no client sends, and what comes back.
    fn raw(&self, mailbox: &SimMailbox<'static, 3>, request: &MotionRequest) -> MotionResponse {
        let region = self.region(mailbox.number());
        let mut exchange = self.blocks.client(mailbox, &region).unwrap();
        packet::ask(&mut exchange, ARM, MOTIONS, request, SOON).unwrap()
    }
}

fn offer(session: u32, number: u32) -> MotionRequest {
    let motions = b"wave".as_slice().try_into().unwrap();
    MotionRequest::Offer(of(session, number), Offer::Motions(motions))
}

fn points(session: u32, number: u32) -> MotionRequest {
    let batch = PackedBatch {
        sequence: 0,
        is_last: false,
        numbers: [].into_iter().collect(),
    };
    MotionRequest::Points(of(session, number), batch)
}

fn look(session: u32, number: u32) -> MotionRequest {
    MotionRequest::Look(of(session, number))
}

fn control(session: u32) -> MotionRequest {
    MotionRequest::Control {
        session,
        from_other: true,
    }
}

/// The answer about a request that does not run.
const fn known(answer: QueueAnswer) -> MotionResponse {
    MotionResponse::Request(RequestProgress {
        answer,
        before: 0,
        progress: None,
    })
}

const WAITS: QueueAnswer = QueueAnswer::Known(RequestState::Accepted, RefusalReason::None);
const RUNS: QueueAnswer = QueueAnswer::Known(RequestState::Started, RefusalReason::None);
const DONE: QueueAnswer = QueueAnswer::Known(RequestState::Done, RefusalReason::None);

const fn of(session: u32, number: u32) -> RequestIdentity {
    RequestIdentity { session, number }
}

#[test]
fn a_motion_that_is_offered_again_and_again_runs_once() {
    let rig = Rig::new();
    let mailbox = rig.mailbox(FIRST);
    let mut client = rig.client(mailbox);
    let session = client.open(SOON).unwrap();
    let refused = |reason| QueueAnswer::Known(RequestState::Refused, reason);
    let first = client.offer(of(session, 1), b"wave", SOON).unwrap();
    assert_eq!(first, refused(RefusalReason::NotInControl));
    client.take_control(session, false, SOON).unwrap();
    assert_eq!(
        client.offer(of(session, 2), b"backflip", SOON).unwrap(),
        refused(RefusalReason::NoMotion)
    );
    for _ in 0..3 {
        client.offer(of(session, 3), b"wave", SOON).unwrap();
        client.offer(of(session, 4), b"nod", SOON).unwrap();
    }
    let seen = client.look(of(session, 3), SOON).unwrap();
    let running = RequestProgress {
        answer: RUNS,
        before: 0,
        progress: Some(0.25),
    };
    assert_eq!(seen, running);
    let seen = client.look(of(session, 4), SOON).unwrap();
    assert_eq!(
        seen,
        RequestProgress {
            answer: WAITS,
            before: 1,
            progress: None
        }
    );
    rig.arm(|arm| {
        arm.server
            .end(RequestState::Done, RefusalReason::None)
            .unwrap();
    });
    let seen = client.look(of(session, 3), SOON).unwrap();
    assert_eq!(
        seen,
        RequestProgress {
            answer: DONE,
            before: 0,
            progress: None
        }
    );
    assert_eq!(client.look(of(session, 4), SOON).unwrap().answer, RUNS);
    let names = rig.arm(|arm| arm.begun.clone());
    let motion = |number, name: &[u8]| (of(session, number), Work::Motion(name.to_vec()));
    assert_eq!(names, [motion(3, b"wave"), motion(4, b"nod")]);
    let long = client.offer(of(session, 5), &[0; 481], SOON).unwrap_err();
    assert_eq!(
        long.to_string(),
        "the request has more than the 480 bytes for which there is room"
    );
    assert_eq!(
        client.look(of(99, 1), SOON).unwrap().answer,
        QueueAnswer::NoSession
    );

    // The next incarnation of the arm knows what was done, and what broke off.
    let next = Rig::with(rig.rows.clone());
    let mailbox = next.mailbox(FIRST);
    let mut client = next.client(mailbox);
    assert_eq!(client.look(of(session, 3), SOON).unwrap().answer, DONE);
    let broken = QueueAnswer::Known(RequestState::BrokenOff, RefusalReason::None);
    assert_eq!(client.look(of(session, 4), SOON).unwrap().answer, broken);
    assert!(client.open(SOON).unwrap() > session);
}

#[test]
fn a_session_is_used_by_its_owner_alone() {
    let rig = Rig::new();
    let (first, second) = (rig.mailbox(FIRST), rig.mailbox(SECOND));
    let session = rig.client(first).open(SOON).unwrap();
    // Nor is that of the controller itself of any client.
    for session in [session, OWN] {
        for request in [
            control(session),
            MotionRequest::Abort { session },
            MotionRequest::GiveUp { session },
            MotionRequest::Bind { session },
            points(session, 1),
        ] {
            let answer = rig.raw(second, &request);
            assert_eq!(answer, MotionResponse::NotYours, "{request:?}");
        }
    }
    assert_eq!(
        rig.raw(second, &offer(session, 1)),
        MotionResponse::NotYours
    );
    let none = known(QueueAnswer::NoSession);
    assert_eq!(rig.raw(second, &offer(OWN, 1)), none);
    let new = known(QueueAnswer::New);
    assert_eq!(rig.raw(second, &look(session, 1)), new);
    let control = rig.client(second).take_control(session, true, SOON);
    assert!(matches!(control, Err(ClientError::NotYours)), "{control:?}");
    assert_eq!(
        rig.arm(|arm| arm.server.look(MotionQueue::in_control)),
        Some(InControl::Nobody)
    );
    // Requests count from 1.
    for zero in [offer(session, 0), look(session, 0)] {
        assert_eq!(rig.raw(first, &zero), MotionResponse::Invalid);
    }
}

#[test]
fn the_next_incarnation_of_an_owner_cannot_use_its_session() {
    let rig = Rig::new();
    let mailbox = rig.mailbox(FIRST);
    let mut first = rig.client(mailbox);
    let session = first.open(SOON).unwrap();
    first.take_control(session, false, SOON).unwrap();
    let stream = first.stream(of(session, 1), 1, SOON).unwrap();
    assert_eq!(stream, RUNS);
    // The arm sees neither the end of that incarnation nor the next one.
    rig.arm(|arm| arm.is_away = true);
    rig.system.kill(FIRST);
    let mailbox = rig.mailbox(FIRST);
    for request in [
        control(session),
        MotionRequest::Abort { session },
        MotionRequest::GiveUp { session },
        offer(session, 2),
        points(session, 1),
    ] {
        let answer = rig.raw(mailbox, &request);
        assert_eq!(answer, MotionResponse::NotYours, "{request:?}");
    }
    let control = rig.arm(|arm| arm.server.look(MotionQueue::in_control));
    assert_eq!(control, Some(InControl::Session(session)));
}

#[test]
fn control_of_a_client_that_is_gone_is_free_and_what_it_had_enqueued_goes_on() {
    let rig = Rig::new();
    let second = rig.mailbox(SECOND);
    let mut second = rig.client(second);
    let mailbox = rig.mailbox(FIRST);
    let mut first = rig.client(mailbox);
    let (gone, other) = (first.open(SOON).unwrap(), second.open(SOON).unwrap());
    first.take_control(gone, false, SOON).unwrap();
    assert_eq!(first.offer(of(gone, 1), b"wave", SOON).unwrap(), RUNS);
    let refused = second.take_control(other, false, SOON).unwrap_err();
    assert_eq!(
        refused,
        ClientError::NotInControl(InControl::Session(gone)),
        "{refused}"
    );
    // What the arm has not looked at when its client ends, it does not take any more.
    rig.arm(|arm| arm.is_away = true);
    assert_eq!(rig.raw(mailbox, &offer(gone, 2)), MotionResponse::Pending);
    rig.system.kill(FIRST);
    rig.arm(|arm| arm.is_away = false);
    assert_eq!(second.look(of(gone, 1), SOON).unwrap().answer, RUNS);
    assert_eq!(
        second.look(of(gone, 2), SOON).unwrap().answer,
        QueueAnswer::Never
    );
    assert_eq!(
        rig.arm(|arm| arm.news.clone()),
        [MotionsEvent::Taken(gone), MotionsEvent::Gone(gone)]
    );
    second.take_control(other, false, SOON).unwrap();
    rig.arm(|arm| {
        arm.server
            .end(RequestState::Done, RefusalReason::None)
            .unwrap();
    });
    // Its next incarnation cannot use the session.
    let mailbox = rig.mailbox(FIRST);
    let mut first = rig.client(mailbox);
    let control = first.take_control(gone, true, SOON);
    assert!(matches!(control, Err(ClientError::NotYours)), "{control:?}");
    assert_eq!(first.look(of(gone, 1), SOON).unwrap().answer, DONE);
    let again = first.offer(of(gone, 2), b"wave", SOON).unwrap();
    assert_eq!(again, QueueAnswer::Never);
}

#[test]
fn motion_that_is_bound_to_a_client_ends_with_it() {
    let rig = Rig::new();
    let second = rig.mailbox(SECOND);
    let mut second = rig.client(second);
    let other = second.open(SOON).unwrap();
    for is_bound in [false, true] {
        let mailbox = rig.mailbox(FIRST);
        let mut first = rig.client(mailbox);
        let gone = first.open(SOON).unwrap();
        if is_bound {
            first.bind(gone, SOON).unwrap();
        }
        first.take_control(gone, false, SOON).unwrap();
        assert_eq!(first.offer(of(gone, 1), b"wave", SOON).unwrap(), RUNS);
        first.give_up_control(gone, SOON).unwrap();
        rig.system.kill(FIRST);
        // The session is closed in one turn, and all motion ends in the next one.
        rig.arm(|arm| [(); 2].map(|()| arm.turn()));
        let aborted = QueueAnswer::Known(RequestState::Aborted, RefusalReason::Command);
        let expected = if is_bound { aborted } else { RUNS };
        assert_eq!(second.look(of(gone, 1), SOON).unwrap().answer, expected);
        second.take_control(other, true, SOON).unwrap();
        second.abort(other, SOON).unwrap();
        second.give_up_control(other, SOON).unwrap();
    }
    // Whether the ledger can be written or not.
    let mailbox = rig.mailbox(FIRST);
    let mut first = rig.client(mailbox);
    let gone = first.open(SOON).unwrap();
    first.take_control(gone, false, SOON).unwrap();
    first.bind(gone, SOON).unwrap();
    assert_eq!(first.offer(of(gone, 1), b"wave", SOON).unwrap(), RUNS);
    let before = rig.arm(|arm| arm.news.len());
    rig.rows.fails.store(true, Ordering::Relaxed);
    rig.system.kill(FIRST);
    rig.arm(Arm::turn);
    assert_eq!(
        rig.arm(|arm| arm.news[before..].to_vec()),
        [MotionsEvent::Aborted]
    );
    rig.rows.fails.store(false, Ordering::Relaxed);
    // A bound client that has nothing to do ends nothing.
    let mailbox = rig.mailbox(FIRST);
    let mut first = rig.client(mailbox);
    let idle = first.open(SOON).unwrap();
    first.bind(idle, SOON).unwrap();
    second.take_control(other, false, SOON).unwrap();
    let offered = second.offer(of(other, 1), b"wave", SOON).unwrap();
    assert_eq!(offered, RUNS);
    rig.system.kill(FIRST);
    rig.arm(|arm| [(); 2].map(|()| arm.turn()));
    let closed = second.look(of(idle, 1), SOON).unwrap().answer;
    assert_eq!(closed, QueueAnswer::Never);
    assert_eq!(second.look(of(other, 1), SOON).unwrap().answer, RUNS);
}

#[test]
fn a_request_that_was_withdrawn_never_runs() {
    let rig = Rig::new();
    let mailbox = rig.mailbox(FIRST);
    let mut client = rig.client(mailbox);
    let session = client.open(SOON).unwrap();
    let withdrawn = QueueAnswer::Known(RequestState::Refused, RefusalReason::Withdrawn);
    // Without control, too: nothing moves.
    let answer = client.withdraw(of(session, 1), SOON).unwrap();
    assert_eq!(answer, withdrawn);
    client.take_control(session, false, SOON).unwrap();
    let late = client.offer(of(session, 1), b"wave", SOON).unwrap();
    assert_eq!(late, withdrawn);
    // What runs already is not changed.
    client.offer(of(session, 2), b"wave", SOON).unwrap();
    assert_eq!(client.withdraw(of(session, 2), SOON).unwrap(), RUNS);
    assert_eq!(rig.arm(|arm| arm.begun.len()), 1);
}

#[test]
fn one_client_leaves_room_for_others() {
    let rig = Rig::new();
    let (first, second) = (rig.mailbox(FIRST), rig.mailbox(SECOND));
    let sessions = [first, second].map(|it| rig.client(it).open(SOON).unwrap());
    rig.arm(|arm| arm.is_away = true);
    let (pending, busy) = (MotionResponse::Pending, MotionResponse::Busy);
    let [one, two] = sessions;
    assert_eq!(rig.raw(first, &offer(one, 1)), pending);
    assert_eq!(rig.raw(first, &offer(one, 2)), busy);
    assert_eq!(rig.raw(first, &offer(one, 1)), pending);
    assert_eq!(rig.raw(second, &offer(two, 1)), pending);
    // Whoever asks about one of them is not told that it is new.
    assert_eq!(rig.raw(second, &look(one, 1)), pending);
    // Sessions are opened in turn, whoever asks more often.
    let open = MotionRequest::Open;
    for _ in 0..3 {
        assert_eq!(rig.raw(first, &open), pending);
    }
    assert_eq!(rig.raw(second, &open), pending);
    let mut served = Vec::new();
    for _ in 0..4 {
        rig.arm(|arm| {
            arm.is_away = false;
            arm.turn();
            arm.is_away = true;
        });
        for (number, mailbox) in [(1, first), (2, second)] {
            if matches!(rig.raw(mailbox, &open), MotionResponse::Opened(_)) {
                served.push(number);
            }
            rig.raw(mailbox, &open);
        }
    }
    assert_eq!(served, [1, 2, 1, 2]);
}

#[test]
fn a_session_that_was_taken_away_is_not_given() {
    let rig = Rig::new();
    let (first, second) = (rig.mailbox(FIRST), rig.mailbox(SECOND));
    let open = MotionRequest::Open;
    assert_eq!(rig.raw(first, &open), MotionResponse::Pending);
    let mut other = rig.client(second);
    // Of all others there are requests that have not ended.
    let newer = [(); 3].map(|()| {
        let session = other.open(SOON).unwrap();
        other.take_control(session, true, SOON).unwrap();
        other.offer(of(session, 1), b"wave", SOON).unwrap();
        session
    });
    other.open(SOON).unwrap();
    let taken = newer[0] - 1;
    assert_eq!(
        rig.arm(|arm| arm.server.look(|queue| queue.ledger().owner(taken))),
        Some(None)
    );
    assert_eq!(rig.raw(first, &open), MotionResponse::Pending);
    assert!(rig.client(first).open(SOON).unwrap() > newer[2]);
}

#[test]
fn a_ledger_that_fails_is_told_once_and_delays_everything_but_loses_nothing() {
    let rig = Rig::new();
    let mailbox = rig.mailbox(FIRST);
    let mut client = rig.client(mailbox);
    let fails = |fails| rig.rows.fails.store(fails, Ordering::Relaxed);
    fails(true);
    let open = client.open(SOON);
    assert!(
        matches!(open, Err(ClientError::TimedOut { .. })),
        "{open:?}"
    );
    let errors = rig.arm(|arm| core::mem::take(&mut arm.errors));
    assert_eq!(errors, ["Write(Now)"]);
    fails(false);
    let session = client.open(SOON).unwrap();
    client.take_control(session, false, SOON).unwrap();
    client.offer(of(session, 1), b"wave", SOON).unwrap();
    // The end of a motion is written as soon as that is possible, and before the next one begins.
    fails(true);
    rig.arm(|arm| {
        arm.server
            .end(RequestState::Done, RefusalReason::None)
            .unwrap_err()
    });
    assert_eq!(client.look(of(session, 1), SOON).unwrap().answer, RUNS);
    fails(false);
    mailbox.serve(SOON).unwrap();
    assert_eq!(client.look(of(session, 1), SOON).unwrap().answer, DONE);
    // An offer that cannot be written waits; the controller is told once.
    fails(true);
    let offer = client.offer(of(session, 2), b"nod", SOON);
    assert!(
        matches!(offer, Err(ClientError::TimedOut { .. })),
        "{offer:?}"
    );
    let errors = rig.arm(|arm| core::mem::take(&mut arm.errors));
    assert_eq!(errors, ["Write(Now)"]);
    fails(false);
    // Rows that are missing are written anew.
    rig.rows.bytes.lock().unwrap().clear();
    rig.arm(|arm| arm.is_quick = true);
    client
        .offer(of(session, 2), b"nod", SOON)
        .unwrap_or(QueueAnswer::New);
    mailbox.serve(SOON).unwrap();
    client.offer(of(session, 2), b"nod", SOON).unwrap();
    mailbox.serve(SOON).unwrap();
    assert_eq!(client.look(of(session, 2), SOON).unwrap().answer, DONE);
    assert_eq!(rig.arm(|arm| arm.begun.len()), 2);
    let next = Rig::with(rig.rows.clone());
    let mailbox = next.mailbox(FIRST);
    for number in [1, 2] {
        let seen = next.client(mailbox).look(of(session, number), SOON);
        assert_eq!(seen.unwrap().answer, DONE);
    }
    // The rows of another queue are refused.
    let mut other = MotionQueue::<(), 1>::restore(&[], 1, |_, _| Ok::<_, Infallible>(())).unwrap();
    other
        .open(SessionOwner::default(), |_, _| Ok::<_, Infallible>(()))
        .unwrap();
    *rig.rows.bytes.lock().unwrap() = other.ledger().rows().collect();
    let closed = Rig::with(rig.rows.clone());
    let mailbox = closed.mailbox(FIRST);
    assert!(closed.client(mailbox).open(SOON).is_err());
    let errors = closed.arm(|arm| core::mem::take(&mut arm.errors));
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert!(errors[0].starts_with("Ledger(Count"), "{errors:?}");
}

/// A client in control, whose first motion runs and whose second one waits.
fn busy(rig: &Rig) -> (&'static SimMailbox<'static, 3>, Client, u32) {
    let mailbox = rig.mailbox(FIRST);
    let mut client = rig.client(mailbox);
    let session = client.open(SOON).unwrap();
    client.take_control(session, false, SOON).unwrap();
    client.offer(of(session, 1), b"wave", SOON).unwrap();
    client.offer(of(session, 2), b"nod", SOON).unwrap();
    (mailbox, client, session)
}

#[test]
fn an_abort_that_cannot_be_written_leaves_what_was_done_and_what_comes_later() {
    let rig = Rig::new();
    let (_, mut client, session) = busy(&rig);
    rig.rows.fails.store(true, Ordering::Relaxed);
    rig.arm(|arm| {
        arm.server
            .end(RequestState::Done, RefusalReason::None)
            .unwrap_err();
        arm.server.abort(RefusalReason::Command).unwrap();
    });
    let third = client.offer(of(session, 3), b"wave", Duration::from_millis(10));
    assert!(third.is_err(), "{third:?}");
    rig.rows.fails.store(false, Ordering::Relaxed);
    client.offer(of(session, 3), b"wave", SOON).unwrap();
    let aborted = QueueAnswer::Known(RequestState::Aborted, RefusalReason::Command);
    for (number, answer) in [(1, DONE), (2, aborted), (3, RUNS)] {
        let seen = client.look(of(session, number), SOON).unwrap();
        assert_eq!(seen.answer, answer, "{number}");
    }
}

#[test]
fn nothing_begins_after_an_abort_that_the_controller_has_not_seen() {
    let rig = Rig::new();
    let (mailbox, mut client, session) = busy(&rig);
    rig.arm(|arm| {
        arm.server
            .end(RequestState::Done, RefusalReason::None)
            .unwrap();
        arm.is_away = true;
    });
    // The second motion is being prepared.
    let next = rig.arm(|arm| arm.server.next_request());
    assert_eq!(next.map(|it| it.0), Some(of(session, 2)));
    let abort = MotionRequest::Abort { session };
    let (pending, done) = (MotionResponse::Pending, MotionResponse::Done);
    assert_eq!(rig.raw(mailbox, &abort), pending);
    assert_eq!(rig.arm(|arm| arm.server.begin()), Ok(false));
    assert_eq!(rig.arm(|arm| arm.server.next_request()), None);
    assert_eq!(rig.raw(mailbox, &abort), pending);
    rig.arm(|arm| arm.is_away = false);
    mailbox.serve(Duration::from_millis(10)).unwrap();
    assert_eq!(rig.raw(mailbox, &abort), done);
    let seen = client.look(of(session, 2), SOON).unwrap();
    assert_eq!(
        seen.answer,
        QueueAnswer::Known(RequestState::Aborted, RefusalReason::Command)
    );
    // The end of what moves later is asked for anew.
    client.offer(of(session, 3), b"wave", SOON).unwrap();
    rig.arm(|arm| arm.is_away = true);
    assert_eq!(rig.raw(mailbox, &abort), pending);
}

#[test]
fn an_offer_is_pending_until_the_queue_has_it_or_an_abort_comes() {
    let rig = Rig::new();
    let (mailbox, _, session) = busy(&rig);
    let asked_while_deciding = |number, request| {
        rig.arm(|arm| arm.is_away = true);
        let offered = rig.raw(mailbox, &offer(session, number));
        assert_eq!(offered, MotionResponse::Pending);
        rig.arm(|arm| (arm.is_away, arm.serves_late) = (false, true));
        assert_eq!(rig.raw(mailbox, &request), MotionResponse::Pending);
        rig.arm(|arm| arm.serves_late = false);
        match rig.raw(mailbox, &look(session, number)) {
            MotionResponse::Request(seen) => seen.answer,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(asked_while_deciding(3, look(session, 3)), WAITS);
    let abort = MotionRequest::Abort { session };
    assert_eq!(asked_while_deciding(4, abort), QueueAnswer::New);
}

#[test]
fn whoever_is_in_control_ends_everything() {
    let rig = Rig::new();
    let (first, second) = (rig.mailbox(FIRST), rig.mailbox(SECOND));
    let (mut first, mut second) = (rig.client(first), rig.client(second));
    let [mine, other] = [&mut first, &mut second].map(|it| it.open(SOON).unwrap());
    first.take_control(mine, false, SOON).unwrap();
    for number in 1..=3 {
        first.offer(of(mine, number), b"wave", SOON).unwrap();
    }
    assert_eq!(
        second.abort(other, SOON),
        Err(ClientError::NotInControl(InControl::Session(mine)))
    );
    assert_eq!(first.look(of(mine, 1), SOON).unwrap().answer, RUNS);
    first.abort(mine, SOON).unwrap();
    let aborted = QueueAnswer::Known(RequestState::Aborted, RefusalReason::Command);
    for number in 1..=3 {
        assert_eq!(first.look(of(mine, number), SOON).unwrap().answer, aborted);
    }
    // Of a client that has lost control again before the arm has looked, nobody is told.
    rig.arm(|arm| arm.is_away = true);
    second.take_control(other, true, SOON).unwrap();
    second.give_up_control(other, SOON).unwrap();
    rig.arm(|arm| arm.is_away = false);
    first.take_control(mine, false, SOON).unwrap();
    first.look(of(mine, 1), SOON).unwrap();
    let news = rig.arm(|arm| arm.news.clone());
    assert_eq!(
        news,
        [
            MotionsEvent::Taken(mine),
            MotionsEvent::Aborted,
            MotionsEvent::Taken(mine)
        ]
    );
}

/// A batch of one point of the second joint: time, position and velocity.
fn batch(sequence: u32, point: (f64, f64, f64), is_last: bool) -> Batch<2> {
    let (time, position, velocity) = point;
    let point = StreamPoint {
        time,
        positions: [0.0, position],
        velocities: [0.0, velocity],
    };
    Batch {
        sequence,
        is_last,
        points: [point].into_iter().collect(),
    }
}

#[test]
fn a_stream_takes_points_of_its_client_until_it_ends() {
    let rig = Rig::new();
    let (first, second) = (rig.mailbox(FIRST), rig.mailbox(SECOND));
    let (mut client, mut other) = (rig.client(first), rig.client(second));
    let session = client.open(SOON).unwrap();
    client.take_control(session, false, SOON).unwrap();
    let none = client.stream(of(session, 1), 4, SOON).unwrap();
    assert_eq!(
        none,
        QueueAnswer::Known(RequestState::Refused, RefusalReason::Limits)
    );
    let mut send = |number, batch: &Batch<2>| client.points(of(session, number), 2, batch, SOON);
    let unknown = send(2, &batch(0, (0.1, 0.0, 0.0), false)).unwrap();
    assert_eq!(unknown, SentPoints::Ended(QueueAnswer::New));
    assert_eq!(
        rig.client(first).stream(of(session, 2), 2, SOON).unwrap(),
        RUNS
    );
    let until = |ms| SentPoints::Until(Duration::from_millis(ms));
    for _ in 0..2 {
        let first = batch(0, (0.2, 0.1, 0.5), false);
        assert_eq!(send(2, &first).unwrap(), until(200));
    }
    let foreign = other.points(of(session, 2), 2, &batch(1, (0.4, 0.2, 0.0), true), SOON);
    assert!(matches!(foreign, Err(ClientError::NotYours)), "{foreign:?}");
    let far = send(2, &batch(1, (0.4, 7.0, 0.0), true));
    assert_eq!(
        far.unwrap_err().to_string(),
        "joint 1 at 0.4 s: the position, rad, is 7; it must be at most 1"
    );
    let early = send(2, &batch(2, (0.4, 0.2, 0.0), true));
    assert_eq!(
        early.unwrap_err().to_string(),
        "batch 2 has come, but batch 1 must come first"
    );
    let late = send(2, &batch(1, (0.1, 0.1, 0.0), true));
    assert_eq!(
        late.unwrap_err().to_string(),
        "a point at 0.1 s is not after the point before it, or the start, at 0.2 s"
    );
    let seen = rig.client(first).look(of(session, 2), SOON).unwrap();
    assert_eq!(
        seen,
        RequestProgress {
            answer: RUNS,
            before: 0,
            progress: None
        }
    );
    for sequence in 1..8 {
        let time = 0.2 + 0.01 * f64::from(sequence);
        let position = 0.1 + 0.5 * (time - 0.2);
        send(2, &batch(sequence, (time, position, 0.5), false)).unwrap();
    }
    // There is room for eight.
    let ninth = batch(8, (0.5, 0.24, 0.0), true);
    let full = send(2, &ninth);
    assert!(
        matches!(full, Err(ClientError::TimedOut { .. })),
        "{full:?}"
    );
    (0..12).for_each(|_| rig.arm(Arm::tick));
    assert_eq!(send(2, &ninth).unwrap(), until(500));
    (0..20).for_each(|_| rig.arm(Arm::tick));
    assert_eq!(send(2, &ninth).unwrap(), SentPoints::Ended(DONE));
    // Nobody sends any.
    rig.client(first).stream(of(session, 3), 2, SOON).unwrap();
    rig.client(first).look(of(session, 3), SOON).unwrap();
    (0..52).for_each(|_| rig.arm(Arm::tick));
    let starved = QueueAnswer::Known(RequestState::Aborted, RefusalReason::Starved);
    assert_eq!(
        rig.client(first).look(of(session, 3), SOON).unwrap().answer,
        starved
    );
}

#[test]
fn whatever_a_peer_writes_is_answered() {
    let rig = Rig::new();
    let (first, second) = (rig.mailbox(FIRST), rig.mailbox(SECOND));
    rig.client(first).open(SOON).unwrap();
    rig.arm(|arm| arm.is_quick = true);
    let counts = [const { AtomicU32::new(0) }; 12];
    let number = || prop_oneof![4 => 0..20_u32, 1 => any::<u32>()];
    let session = prop::option::weighted(0.2, number());
    let bytes = prop::collection::vec(any::<u8>(), 0..480);
    let numbers = prop::collection::vec(any::<f64>(), 0..58);
    let errors = prop::collection::vec((0..500_u32, any::<u8>()), 0..2);
    proptest!(|(
        kind in 0..12_u8,
        session in session,
        number in number(),
        bytes in bytes,
        numbers in numbers,
        errors in errors,
        flag in any::<bool>(),
        own in any::<bool>(),
    )| {
        let newest = rig.arm(|arm| {
            let of_first = |(_, owner): &(u32, SessionOwner)| owner.processor == u32::from(FIRST.0);
            let session = |queue: &Queue| queue.ledger().sessions().filter(of_first).map(|it| it.0).max();
            arm.server.look(session).flatten()
        });
        let session = session.or(newest).unwrap_or(0);
        let motions = || Offer::Motions(bytes.as_slice().try_into().unwrap());
        let request = match kind {
            0 => MotionRequest::Open,
            1 => MotionRequest::GiveUp { session },
            2 => MotionRequest::Abort { session },
            3 | 4 => MotionRequest::Control { session, from_other: flag },
            5 => MotionRequest::Look(of(session, number)),
            6 | 7 => MotionRequest::Offer(of(session, number), motions()),
            8 => MotionRequest::Offer(of(session, number), Offer::Stream(number)),
            9 => MotionRequest::Withdraw(of(session, number)),
            10 => MotionRequest::Bind { session },
            _ => MotionRequest::Points(of(session, number), PackedBatch {
                sequence: number,
                is_last: flag,
                numbers: numbers.into_iter().collect(),
            }),
        };
        let mut packet = MotionRequestPacket::new(&request).unwrap();
        for (place, byte) in &errors {
            packet.as_mut_bytes()[*place as usize] = *byte;
        }
        let sender = if own { first } else { second };
        let region = rig.region(sender.number());
        let mut exchange = rig.blocks.client(sender, &region).unwrap();
        let response: MotionResponsePacket = exchange.call(ARM, MOTIONS, &packet, SOON).unwrap();
        let place = match response.value() {
            Err(_) => {
                prop_assert!(!errors.is_empty(), "{:?}", request);
                0
            }
            Ok(MotionResponse::Busy) => 1,
            Ok(MotionResponse::Pending) => 2,
            Ok(MotionResponse::Done) => 3,
            Ok(MotionResponse::Opened(_)) => 4,
            Ok(MotionResponse::InControl(_)) => 5,
            Ok(MotionResponse::Request(_)) => 6,
            Ok(MotionResponse::NotYours) => 7,
            Ok(_) => 8,
        };
        counts[place].fetch_add(1, Ordering::Relaxed);
        rig.arm(Arm::tick);
    });
    let counts = counts.map(AtomicU32::into_inner);
    let seen = counts.iter().filter(|count| **count > 0).count();
    assert!(seen > 6, "{counts:?}");
    // The arm serves all the same.
    let session = rig.client(second).open(SOON).unwrap();
    rig.client(second)
        .take_control(session, true, SOON)
        .unwrap();
}
