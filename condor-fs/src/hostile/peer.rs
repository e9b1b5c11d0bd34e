//! A client in virtual time, and a host that answers each slot with a closure.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::{Area, FileError, FileSystem, wire};
use condor_mbox::sim::{SimMailbox, SimSystem, SimWindow};
use condor_mbox::{Allocator, Call, MemoryWindow, Messenger, Processor, Region};

pub const HOST: Processor = Processor(0);
pub const CLIENT: Processor = Processor(1);
pub const FILES: usize = 3;
/// The greatest length of a path of the client, in bytes.
pub const PATH: u32 = 32;
/// The size of the client's buffer for each file, in bytes.
pub const BUFFER: u32 = 24;
pub const TIMEOUT: Duration = Duration::from_millis(10);
const BYTES: u32 = 2048;

/// The shared memory of the client: the users' region of its `data`.
pub type Own = Region<SimWindow>;
pub type Fs = FileSystem<'static, SimMailbox<'static, 2>, SimWindow, FILES>;
/// A function that answers requests in the place of a host. It gets the client's memory and the
/// offset of the slot there, and returns the word of the reply.
pub type Answer = Box<dyn FnMut(&Own, u32) -> u32 + Send>;

/// A simulated client and its host. Many runs use a pair one after the other, because the memory of
/// mailboxes is never freed.
pub struct Pair {
    system: SimSystem<2>,
    answer: Arc<Mutex<Option<Answer>>>,
    client: &'static SimMailbox<'static, 2>,
    area: Area<FILES>,
    own: Own,
}

/// The pairs that no run uses.
static IDLE: Mutex<Vec<&'static Pair>> = Mutex::new(Vec::new());

/// Runs `program` with a client whose host answers every request by calling `answer`. Returns the
/// result of `program`.
pub fn run<R>(
    answer: impl FnMut(&Own, u32) -> u32 + Send + 'static,
    program: impl FnOnce(&Pair) -> R,
) -> R {
    let idle = lock(&IDLE).pop();
    let pair = idle.unwrap_or_else(|| Box::leak(Box::new(Pair::new())));
    pair.stall(false);
    pair.set(Some(Box::new(answer)));
    let outcome = program(pair);
    pair.set(None);
    lock(&IDLE).push(pair);
    outcome
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pair {
    fn new() -> Self {
        let system = SimSystem::<2>::in_virtual_time(BYTES);
        let answer = Arc::new(Mutex::new(None::<Answer>));
        let [_, windows] = system.windows(HOST);
        let seen = Region::users(windows.data).unwrap();
        let answers = answer.clone();
        let handler = Box::leak(Box::new(move |call: &Call<'_>| {
            let mut answer = lock(&answers);
            answer
                .as_mut()
                .map_or(0, |answer| answer(&seen, call.data() & !wire::again::BITS))
        }));
        let mut host = system.mailbox(HOST).unwrap();
        host.set_vector(wire::FILES, handler, "files").unwrap();
        host.join().unwrap();
        system.while_waiting(HOST, move || {
            host.serve(Duration::ZERO).unwrap();
        });

        let [_, windows] = system.windows(CLIENT);
        let own = Region::users(windows.data).unwrap();
        let area = Area::<FILES>::new(&mut Allocator::new(own.size()), PATH, BUFFER).unwrap();
        let mut client = system.mailbox(CLIENT).unwrap();
        let handler = Box::leak(Box::new(area.handler()));
        client
            .set_vector(wire::OPEN_FILES, handler, "open files")
            .unwrap();
        client.join().unwrap();
        Self {
            system,
            answer,
            client: Box::leak(Box::new(client)),
            area,
            own,
        }
    }

    fn set(&self, answer: Option<Answer>) {
        *lock(&self.answer) = answer;
    }

    pub fn own(&self) -> &Own {
        &self.own
    }

    pub fn connect(&self) -> Result<Fs, FileError> {
        FileSystem::connect(self.client, HOST, self.own.clone(), self.area, TIMEOUT)
    }

    /// Stops the host if `stalled` is true; otherwise lets it go on. Requests to a stopped host end
    /// in doubt.
    pub fn stall(&self, stalled: bool) {
        self.system.stall(HOST, stalled);
    }
}

/// Returns the request in the slot at offset `slot` of `own`; `None` if no request is there.
pub fn request(own: &Own, slot: u32) -> Option<wire::RequestSlot> {
    let words = std::array::from_fn(|n| own.word(slot + 4 * n as u32).unwrap());
    wire::RequestSlot::from_words(&words)
}

/// Writes `outcome`, a value or an error number, to the slot as the result of `request`.
pub fn record(own: &Own, slot: u32, request: &wire::RequestSlot, outcome: Result<u64, u16>) {
    let [session, session_high] = wire::halves(request.session);
    let [sequence, sequence_high] = wire::halves(request.sequence);
    let [value, value_high] = wire::halves(outcome.unwrap_or(0));
    for (offset, word) in [
        (wire::slot::STATE_SESSION, session),
        (wire::slot::STATE_SESSION + 4, session_high),
        (wire::slot::STATE_SEQUENCE, sequence),
        (wire::slot::STATE_SEQUENCE + 4, sequence_high),
        (wire::slot::ERRNO, outcome.err().unwrap_or(0).into()),
        (wire::slot::VALUE, value),
        (wire::slot::VALUE + 4, value_high),
        (wire::slot::STATE, wire::state::DONE),
    ] {
        own.set_word(slot + offset, word).unwrap();
    }
}
