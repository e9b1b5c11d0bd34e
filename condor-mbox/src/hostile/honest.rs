//! The programs of the honest processors, and their checks.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use crate::{
    Call, Handler, Instant, MailboxError, Messenger, PendingReply, Processor, SendProgress,
    SingleContext, Vector, Waiting, layout,
};

use super::Tally;
use super::attack::Attack;
use super::script::Script;
use super::world::{HOSTILE, HonestMailbox, N, World};

/// A timeout that is enough for any wait that depends on honest processors alone.
const AMPLE: Duration = Duration::from_millis(20);
/// The timeout of a nested call.
const NESTED: Duration = Duration::from_micros(30);
const MOST_OPERATIONS: usize = 48;
/// The greatest number of calls in progress that a program polls later.
const MOST_PENDING: usize = 4;

const PLAIN: Vector = Vector(0);
const CALLS_BACK: Vector = Vector(1);
const CALLS_ON: Vector = Vector(2);
const SENDS_ON: Vector = Vector(3);
const BEGINS: Vector = Vector(4);
const MISSING: Vector = Vector(7);
const LAST: Vector = Vector(Vector::COUNT as u8 - 1);
const VECTORS: [Vector; 8] = [
    PLAIN, CALLS_BACK, CALLS_ON, SENDS_ON, BEGINS, MISSING, LAST, PLAIN,
];

thread_local! {
    /// The world of the run on this thread, for the handlers, which are functions.
    static WORLD: RefCell<Option<Rc<World>>> = const { RefCell::new(None) };
}

fn world() -> Rc<World> {
    let world = WORLD.with_borrow(Clone::clone);
    world.expect("handlers run within a run")
}

/// Tests mailboxes of honest processors beside a hostile one. `bytes`, from the fuzzer, decide what
/// all of them do. Returns counts of what happened.
///
/// # Panics
/// Panics if a promise of the mailbox is broken.
pub fn run(bytes: &[u8]) -> Tally {
    run_behind(None, bytes)
}

/// Tests mailboxes as [`run`] does, but on memory that is not coherent: every honest processor has
/// a cache.
///
/// # Panics
/// Panics if a promise of the mailbox is broken.
pub fn run_behind_caches(bytes: &[u8]) -> Tally {
    let seed = bytes.iter().fold(bytes.len() as u64, |seed, byte| {
        seed.rotate_left(9) ^ u64::from(*byte)
    });
    run_behind(Some(seed), bytes)
}

fn run_behind(caches: Option<u64>, bytes: &[u8]) -> Tally {
    let (honest, hostile) = bytes.split_at(bytes.len() / 2);
    let mut script = Script::new(honest);
    let world = World::new(Attack::new(hostile), caches);
    WORLD.set(Some(Rc::clone(&world)));
    if script.byte() & 7 != 0 {
        world.behave_first();
    }
    let mut programs = [Program::new(&world, 0), Program::new(&world, 2)];
    for _ in 0..MOST_OPERATIONS {
        if script.is_over() {
            break;
        }
        let which = script.below(2);
        programs[which].operate(&mut script);
    }
    world.stop_attack();
    let tally = world.tally();
    for program in &mut programs {
        program.finish();
    }
    drain(&world);
    for program in &programs {
        program.check_statistics();
    }
    replace_hostile(&world, script.byte());
    for number in 0..N {
        world.put_mailbox(number, None);
    }
    WORLD.set(None);
    tally
}

/// Runs all honest programs until no message is left, and checks that messages between honest processors were
/// taken.
fn drain(world: &World) {
    // Each processor may have a full ring of messages for each other one, as deep as calls nest.
    for _ in 0..N * N * layout::SLOTS as usize {
        let served: usize = (0..N).map(|number| world.run_program(number)).sum();
        if served == 0 {
            break;
        }
    }
    assert!(world.model.borrow().is_drained(), "a message was lost");
}

/// Lets an honest program take the hostile number; all others send messages to it at once.
fn replace_hostile(world: &Rc<World>, choice: u8) {
    world.wipe_hostile_mail(choice & 1 == 0);
    world.model.borrow_mut().replace_hostile();
    let mut programs = [0, 2, HOSTILE].map(|number| match number {
        HOSTILE => Program::new(world, number),
        _ => Program {
            world: Rc::clone(world),
            number,
            pending: Vec::new(),
        },
    });
    for from in 0..N {
        for to in 0..N {
            if programs[to].number != programs[from].number {
                let to = programs[to].number;
                programs[from].call(to, PLAIN, AMPLE);
                programs[from].send(to, LAST, AMPLE);
            }
        }
    }
    drain(world);
    programs[2].check_statistics();
}

fn reply_to(vector: Vector, data: u32) -> u32 {
    data.rotate_left(7) ^ u32::from(vector.0)
}

/// Handles a call on processor `ME`: every handler lets the model check the call, and then does the work of its
/// vector.
fn handle<const ME: usize>(call: &Call<'_>) -> u32 {
    let world = world();
    world.model.borrow_mut().started(ME, call);
    let third = (call.sender().index() + 1) % N;
    match call.vector() {
        CALLS_BACK => nested_call::<ME>(&world, call, call.sender().index()),
        CALLS_ON => nested_call::<ME>(&world, call, third),
        SENDS_ON => {
            let to = Processor(third as u8);
            let data = world.model.borrow_mut().offer(ME, to, PLAIN);
            let sent = call.send(to, PLAIN, data, Duration::ZERO).is_ok();
            assert_eq!(sent, world.model.borrow().is_published(data));
        }
        BEGINS => {
            let to = Processor(third as u8);
            let data = world.model.borrow_mut().offer(ME, to, PLAIN);
            if let Ok(mut ticket) = call.begin(to, PLAIN, data, Duration::ZERO)
                && let Ok(Some(value)) = ticket.poll()
            {
                world.model.borrow().check_reply(data, value);
            }
        }
        _ => {}
    }
    let value = reply_to(call.vector(), call.data());
    world.model.borrow_mut().ended(ME, call, value);
    value
}

fn nested_call<const ME: usize>(world: &World, call: &Call<'_>, to: usize) {
    let to = Processor(to as u8);
    let data = world.model.borrow_mut().offer(ME, to, PLAIN);
    let outcome = world.within(NESTED, call.deadline(), || {
        call.send_with_reply(to, PLAIN, data, NESTED)
    });
    check_call(world, data, outcome);
}

/// Checks that the outcome of a call agrees with the model, whether its receiver is honest or not.
fn check_call(world: &World, data: u32, outcome: Result<u32, MailboxError>) {
    let model = world.model.borrow();
    match outcome {
        Ok(value) => {
            assert!(model.is_published(data));
            model.check_reply(data, value);
        }
        Err(error) => {
            if let Some(progress) = progress(error) {
                // A message that never runs may have been published to a processor that left or died.
                let ended = matches!(
                    error,
                    MailboxError::PeerDied { .. } | MailboxError::PeerLeft { .. }
                );
                let published = model.is_published(data);
                assert!(
                    ended || (progress != SendProgress::Never) == published,
                    "{error}"
                );
                let to = model.offered(data).to();
                if published && model.is_honest(to) {
                    let taken = progress == SendProgress::Taken;
                    assert_eq!(taken, model.offered(data).is_taken(), "{error}");
                }
            }
        }
    }
}

fn progress(error: MailboxError) -> Option<SendProgress> {
    match error {
        MailboxError::TimedOut { progress, .. }
        | MailboxError::Stalled { progress, .. }
        | MailboxError::PeerDied { progress, .. }
        | MailboxError::PeerLeft { progress, .. }
        | MailboxError::PeerRestarted { progress, .. } => Some(progress),
        MailboxError::NoSlot { .. }
        | MailboxError::NotConnected { .. }
        | MailboxError::TooDeep { .. } => Some(SendProgress::Never),
        _ => None,
    }
}

/// The program of an honest processor.
struct Program {
    world: Rc<World>,
    number: usize,
    pending: Vec<(u32, PendingReply)>,
}

impl Program {
    fn new(world: &Rc<World>, number: usize) -> Self {
        let mut program = Self {
            world: Rc::clone(world),
            number,
            pending: Vec::new(),
        };
        program.restart();
        program
    }

    /// Restarts as a new process does, without a message to the others.
    fn restart(&mut self) {
        self.pending.clear();
        self.world.put_mailbox(self.number, None);
        self.world.model.borrow_mut().restart(self.number);
        let windows = self.world.windows(self.number);
        let bell = self.world.bell(self.number);
        let number = Processor(self.number as u8);
        let mailbox = HonestMailbox::new(number, windows, bell, SingleContext::new());
        let mut mailbox = mailbox.expect("the windows are in order");
        let handler: Handler<'static> = match self.number {
            0 => &handle::<0>,
            1 => &handle::<1>,
            _ => &handle::<2>,
        };
        for vector in [PLAIN, CALLS_BACK, CALLS_ON, SENDS_ON, BEGINS, LAST] {
            let set = mailbox.set_vector(vector, handler, "honest");
            set.expect("a free vector");
        }
        mailbox.set_listener(handler);
        mailbox.set_waiting(Waiting::Sleep);
        mailbox.join().expect("to join");
        self.world.put_mailbox(self.number, Some(mailbox));
    }

    fn mailbox(&self) -> Rc<RefCell<HonestMailbox>> {
        self.world.mailbox(self.number)
    }

    fn operate(&mut self, script: &mut Script<'_>) {
        let to = script.below(N);
        let operation = script.byte();
        let timeout = Duration::from_micros(1 << (script.byte() % 11));
        match operation % 20 {
            0 | 1 => self.send(to, script.one_of(&VECTORS), timeout),
            2 | 3 => self.try_send(to, script.one_of(&VECTORS)),
            4..=7 => self.call(to, script.one_of(&VECTORS), timeout),
            8 => self.begin(to, script.one_of(&VECTORS)),
            9 => self.poll(),
            10 => self.abandon(),
            11 | 12 => {
                self.world.run_program(self.number);
            }
            13 => self.serve(timeout),
            // A processor that listened to itself would hear every message twice.
            14 if to != self.number => self.listen(Some(to), timeout),
            14 | 15 => self.listen(None, timeout),
            16 => self.observe(to, script.byte()),
            17 => self.rejoin(),
            18 => self.wait_by(script.byte()),
            _ => self.restart(),
        }
    }

    /// Returns true if a wait for `to` depends on honest processors alone.
    fn is_honest(&self, to: usize) -> bool {
        self.world.model.borrow().is_honest(to)
    }

    fn send(&mut self, to: usize, vector: Vector, timeout: Duration) {
        let timeout = if self.is_honest(to) { AMPLE } else { timeout };
        let data = self.offer(to, vector);
        let mailbox = self.mailbox();
        let outcome = self.world.within(timeout, Instant::FOREVER, || {
            let mailbox = mailbox.borrow();
            mailbox.send(Processor(to as u8), vector, data, timeout)
        });
        let published = self.world.model.borrow().is_published(data);
        assert_eq!(outcome.is_ok(), published, "{outcome:?}");
        if self.is_honest(to) && !self.is_starved(&outcome, to, data as usize + 1) {
            assert_eq!(outcome, Ok(()));
        }
    }

    /// Returns true if there was no slot in time because the sender's handlers took each slot for messages that
    /// they sent on.
    ///
    /// A sender's handlers may send that many messages; but when it pauses, there are slots again.
    fn is_starved<T>(&self, outcome: &Result<T, MailboxError>, to: usize, before: usize) -> bool {
        let competed = || {
            let model = self.world.model.borrow();
            model.has_sent(before, self.number, to)
        };
        let late = matches!(
            outcome,
            Err(MailboxError::NoSlot { .. } | MailboxError::TimedOut { .. })
        );
        if !late || !competed() {
            return false;
        }
        self.world.pause_attack(true);
        drain(&self.world);
        self.call_honest(to, PLAIN);
        self.world.pause_attack(false);
        true
    }

    fn call_honest(&self, to: usize, vector: Vector) {
        let data = self.offer(to, vector);
        let mailbox = self.mailbox();
        let mailbox = mailbox.borrow();
        let to = Processor(to as u8);
        assert_eq!(
            mailbox.send_with_reply(to, vector, data, AMPLE),
            Ok(reply_to(vector, data))
        );
    }

    fn try_send(&mut self, to: usize, vector: Vector) {
        let data = self.offer(to, vector);
        let mailbox = self.mailbox();
        let outcome = self.world.within(Duration::ZERO, Instant::FOREVER, || {
            let mailbox = mailbox.borrow();
            mailbox.send(Processor(to as u8), vector, data, Duration::ZERO)
        });
        let published = self.world.model.borrow().is_published(data);
        assert_eq!(outcome.is_ok(), published, "{outcome:?}");
    }

    fn call(&mut self, to: usize, vector: Vector, timeout: Duration) {
        let timeout = if self.is_honest(to) { AMPLE } else { timeout };
        let data = self.offer(to, vector);
        let mailbox = self.mailbox();
        let outcome = self.world.within(timeout, Instant::FOREVER, || {
            let mailbox = mailbox.borrow();
            mailbox.send_with_reply(Processor(to as u8), vector, data, timeout)
        });
        check_call(&self.world, data, outcome);
        if self.is_honest(to) && !self.is_starved(&outcome, to, data as usize + 1) {
            let expected = if vector == MISSING {
                let to = Processor(to as u8);
                Err(MailboxError::NoHandler { to, vector })
            } else {
                Ok(reply_to(vector, data))
            };
            assert_eq!(outcome, expected);
        }
    }

    fn begin(&mut self, to: usize, vector: Vector) {
        if self.pending.len() >= MOST_PENDING {
            return;
        }
        let data = self.offer(to, vector);
        let opened = self
            .mailbox()
            .borrow()
            .begin(Processor(to as u8), vector, data, Duration::ZERO)
            .map(|ticket| ticket.detach().expect("it was not looked at"));
        let published = self.world.model.borrow().is_published(data);
        assert_eq!(opened.is_ok(), published, "{opened:?}");
        self.pending
            .extend(opened.ok().map(|pending| (data, pending)));
    }

    fn poll(&mut self) {
        let mailbox = self.mailbox();
        let mailbox = mailbox.borrow();
        let world = &self.world;
        self.pending
            .retain(|(data, pending)| match mailbox.poll_pending(pending) {
                Ok(Some(value)) => {
                    world.model.borrow().check_reply(*data, value);
                    false
                }
                outcome => outcome == Ok(None),
            });
    }

    fn abandon(&mut self) {
        if let Some((_, pending)) = self.pending.pop() {
            self.mailbox().borrow().abandon(&pending);
        }
    }

    fn serve(&mut self, timeout: Duration) {
        let mailbox = self.mailbox();
        let served = self.world.within(timeout, Instant::FOREVER, || {
            mailbox.borrow().serve(timeout)
        });
        served.expect("who serves is not harmed by others");
    }

    fn listen(&mut self, to: Option<usize>, timeout: Duration) {
        let honest = to.is_none_or(|to| self.is_honest(to));
        let timeout = if honest { AMPLE } else { timeout };
        let number = to.map(|to| Processor(to as u8));
        self.world.model.borrow_mut().listens(self.number);
        let before = self.world.model.borrow().offers();
        let mailbox = self.mailbox();
        let outcome = self.world.within(timeout, Instant::FOREVER, || {
            mailbox.borrow_mut().listen(number, timeout)
        });
        if honest && !to.is_some_and(|to| self.is_starved(&outcome, to, before)) {
            assert_eq!(outcome, Ok(()));
        }
    }

    fn observe(&mut self, of: usize, vector: u8) {
        let mailbox = self.mailbox();
        let mailbox = mailbox.borrow();
        let number = Processor(of as u8);
        let state = mailbox.peer_state(number);
        let statistics = mailbox.vector_statistics(number, Vector(vector));
        if self.is_honest(of) {
            state.expect("a living processor");
            assert_eq!(statistics.is_ok(), usize::from(vector) < Vector::COUNT);
        }
        if let Ok(statistics) = statistics {
            assert!(statistics.name().len() <= layout::NAME_BYTES);
        }
        mailbox.missed(number).expect("a number of the system");
    }

    fn rejoin(&mut self) {
        self.pending.clear();
        let mailbox = self.mailbox();
        let mut mailbox = mailbox.borrow_mut();
        mailbox.leave().expect("to leave");
        mailbox.join().expect("to join");
    }

    fn wait_by(&mut self, choice: u8) {
        let mailbox = self.mailbox();
        let mut mailbox = mailbox.borrow_mut();
        let spin = Duration::from_micros(u64::from(choice % 16));
        mailbox.set_waiting(Waiting::SpinThenSleep { spin });
        let always = mailbox.ring_always(choice & 0x80 != 0);
        always.expect("the own memory is there");
    }

    fn offer(&self, to: usize, vector: Vector) -> u32 {
        let mut model = self.world.model.borrow_mut();
        model.offer(self.number, Processor(to as u8), vector)
    }

    /// Abandons all calls in progress.
    fn finish(&mut self) {
        self.poll();
        while !self.pending.is_empty() {
            self.abandon();
        }
    }

    fn check_statistics(&self) {
        let mailbox = self.mailbox();
        let mailbox = mailbox.borrow();
        // Miri takes milliseconds for each access to simulated memory.
        let step = if cfg!(miri) { 21 } else { 1 };
        for vector in (0..Vector::COUNT as u8).step_by(step).map(Vector) {
            let statistics = mailbox
                .vector_statistics(Processor(self.number as u8), vector)
                .expect("the own memory is there");
            let expected = self.world.model.borrow().statistics(self.number, vector);
            assert_eq!((statistics.sent, statistics.handled), expected, "{vector}");
        }
    }
}
