//! Windows, clocks, doorbells and sections for loom, and two connected mailboxes made of them.
//!
//! Loom sees every word of the protocol. Words that carry none of it (names, counts, heartbeats,
//! the constant part of the header) are ordinary atomics: they only make executions longer.

// Every model is a program of its own, and none needs everything.
#![allow(dead_code, unreachable_pub)]

use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::{AcqRel, Acquire, Relaxed};
use std::time::Duration;

use condor_mbox::layout::{self, header};
use condor_mbox::window::{CompareExchange, WindowError, WindowErrorKind, check_access};
use condor_mbox::{
    Clock, Doorbell, Evidence, Exclusion, Handler, Instant, LoadOrder, Mailbox, MemoryWindow,
    Messenger, Processor, StoreOrder, Vector, Waiting, Windows,
};
use loom::sync::atomic::{AtomicU32, Ordering};
use loom::sync::{Condvar, Mutex};

pub const A: Processor = Processor(0);
pub const B: Processor = Processor(1);
pub const V: Vector = Vector(0);
pub const W: Vector = Vector(1);
pub const LONG: std::time::Duration = std::time::Duration::from_secs(1 << 20);

/// Explores `model` with at most `preemptions` and says how many executions there were.
pub fn explore(name: &str, preemptions: usize, model: impl Fn() + Sync + Send + 'static) {
    let executions = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&executions);
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(preemptions);
    builder.max_branches = 20_000;
    let begun = std::time::Instant::now();
    builder.check(move || {
        counted.fetch_add(1, Relaxed);
        model();
    });
    println!(
        "{name}: {} executions in {:.1?}",
        executions.load(Relaxed),
        begun.elapsed()
    );
}

/// A word that loom sees, or one that carries no protocol.
enum Word {
    Seen(AtomicU32),
    Plain(std::sync::atomic::AtomicU32),
}

/// Memory of loom's atomics; clones show the same memory.
#[derive(Clone)]
pub struct LoomWindow(Arc<Vec<Word>>);

#[derive(Debug)]
pub struct LoomWindowError(WindowErrorKind);

impl WindowError for LoomWindowError {
    fn kind(&self) -> WindowErrorKind {
        self.0
    }
}

impl LoomWindow {
    /// A `mail` of a system of `processors`.
    pub fn mail(processors: u32) -> Self {
        let vectors = layout::vector_entry(processors, 0)
            ..layout::vector_entry(processors, layout::VECTORS as u32);
        let word = |offset| {
            let plain = matches!(
                offset,
                header::MAGIC
                    ..=header::DATA_SIZE
                        | header::LAST_INCARNATION
                        | header::PROCESS_ID
                        | header::HEARTBEAT
            ) || vectors.contains(&offset);
            if plain {
                Word::Plain(0.into())
            } else {
                Word::Seen(AtomicU32::new(0))
            }
        };
        Self(Arc::new(
            (0..layout::mail_bytes(processors))
                .step_by(4)
                .map(word)
                .collect(),
        ))
    }

    /// A `data` that nobody uses.
    pub fn data() -> Self {
        let words = 0..layout::BELL_BYTES / 4;
        Self(Arc::new(words.map(|_| Word::Plain(0.into())).collect()))
    }

    /// Memory for anything else, all of it seen.
    pub fn seen(bytes: u32) -> Self {
        let words = 0..bytes / 4;
        Self(Arc::new(
            words.map(|_| Word::Seen(AtomicU32::new(0))).collect(),
        ))
    }
}

impl MemoryWindow for LoomWindow {
    type Error = LoomWindowError;

    fn size(&self) -> u32 {
        self.0.len() as u32 * 4
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, LoomWindowError> {
        self.check(offset, 4)?;
        Ok(match (&self.0[offset as usize / 4], order) {
            (Word::Seen(word), LoadOrder::Relaxed) => word.load(Ordering::Relaxed),
            (Word::Seen(word), LoadOrder::Acquire) => word.load(Ordering::Acquire),
            (Word::Plain(word), _) => word.load(Relaxed),
        })
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), LoomWindowError> {
        self.check(offset, 4)?;
        match (&self.0[offset as usize / 4], order) {
            (Word::Seen(word), StoreOrder::Relaxed) => word.store(value, Ordering::Relaxed),
            (Word::Seen(word), StoreOrder::Release) => word.store(value, Ordering::Release),
            (Word::Plain(word), _) => word.store(value, Relaxed),
        }
        Ok(())
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), LoomWindowError> {
        check_access(self.size(), offset, len).map_err(LoomWindowError)
    }
}

impl CompareExchange for LoomWindow {
    fn compare_exchange(
        &self,
        offset: u32,
        current: u32,
        new: u32,
    ) -> Result<u32, LoomWindowError> {
        self.check(offset, 4)?;
        let (success, failure) = (Ordering::AcqRel, Ordering::Acquire);
        let (Ok(found) | Err(found)) = match &self.0[offset as usize / 4] {
            Word::Seen(word) => word.compare_exchange(current, new, success, failure),
            Word::Plain(word) => word.compare_exchange(current, new, AcqRel, Acquire),
        };
        Ok(found)
    }
}

/// One processor's place to sleep.
struct Bed {
    /// Rings so far.
    rings: AtomicU32,
    /// Whether a ring has not been waited for; only of a doorbell with memory.
    pending: Mutex<bool>,
    woken: Condvar,
}

impl Bed {
    fn new() -> Self {
        Self {
            rings: AtomicU32::new(0),
            pending: Mutex::new(false),
            woken: Condvar::new(),
        }
    }
}

/// The beds of a system of `N`.
pub struct Beds<const N: usize>([Bed; N]);

impl<const N: usize> Beds<N> {
    pub fn new() -> Arc<Self> {
        Arc::new(Self(std::array::from_fn(|_| Bed::new())))
    }
}

/// A doorbell, and a clock that never expires, so that a lost wake-up is a deadlock.
pub trait Bell<const N: usize>: Doorbell + Send + Sync + 'static {
    const WAITING: Waiting;

    fn of(beds: &Arc<Beds<N>>, me: Processor) -> Self;
}

/// A futex: forgets rings that nobody sleeps through, compares a counter instead.
pub struct Futex<const N: usize>(Arc<Beds<N>>, Processor);

/// An eventfd, or an interrupt's pending bit: remembers one ring until it is waited for.
pub struct Pending<const N: usize>(Arc<Beds<N>>, Processor);

/// Nobody sleeps, and so nobody need ring.
pub struct Spinning;

impl<const N: usize> Clock for Futex<N> {
    fn now(&self) -> Instant {
        Instant::from_ns(0)
    }
}

impl<const N: usize> Doorbell for Futex<N> {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        let bed = &self.0.0[processor.index()];
        bed.rings.fetch_add(1, Ordering::Release);
        // The kernel holds its queue while it compares and while it wakes.
        drop(bed.pending.lock().unwrap());
        bed.woken.notify_all();
    }

    fn prepare(&self) -> u32 {
        // Acquire: no later look may come before it.
        self.0.0[self.1.index()].rings.load(Ordering::Acquire)
    }

    fn wait(&self, seen: u32, _until: Instant, _: Option<Processor>) {
        let bed = &self.0.0[self.1.index()];
        let queue = bed.pending.lock().unwrap();
        if bed.rings.load(Ordering::Relaxed) == seen {
            drop(bed.woken.wait(queue).unwrap());
        }
    }
}

impl<const N: usize> Bell<N> for Futex<N> {
    const WAITING: Waiting = Waiting::Sleep;

    fn of(beds: &Arc<Beds<N>>, me: Processor) -> Self {
        Self(Arc::clone(beds), me)
    }
}

impl<const N: usize> Clock for Pending<N> {
    fn now(&self) -> Instant {
        Instant::from_ns(0)
    }
}

impl<const N: usize> Doorbell for Pending<N> {
    type Seen = ();

    fn ring(&self, processor: Processor) {
        let bed = &self.0.0[processor.index()];
        *bed.pending.lock().unwrap() = true;
        bed.woken.notify_all();
    }

    fn prepare(&self) {}

    fn wait(&self, (): (), _until: Instant, _: Option<Processor>) {
        let bed = &self.0.0[self.1.index()];
        let mut pending = bed.pending.lock().unwrap();
        while !*pending {
            pending = bed.woken.wait(pending).unwrap();
        }
        *pending = false;
    }
}

impl<const N: usize> Bell<N> for Pending<N> {
    const WAITING: Waiting = Waiting::Sleep;

    fn of(beds: &Arc<Beds<N>>, me: Processor) -> Self {
        Self(Arc::clone(beds), me)
    }
}

impl Clock for Spinning {
    fn now(&self) -> Instant {
        loom::thread::yield_now();
        Instant::from_ns(0)
    }
}

impl Doorbell for Spinning {
    type Seen = ();

    fn ring(&self, _processor: Processor) {}

    fn prepare(&self) {}

    fn wait(&self, (): (), _until: Instant, _: Option<Processor>) {
        unreachable!("who spins does not sleep");
    }

    fn evidence(&self, _processor: Processor) -> Evidence {
        Evidence::Unknown
    }
}

impl<const N: usize> Bell<N> for Spinning {
    const WAITING: Waiting = Waiting::Spin;

    fn of(_beds: &Arc<Beds<N>>, _me: Processor) -> Self {
        Self
    }
}

/// As [`Spinning`], and somebody else may run while its owner waits: for preparations that take
/// two, without the executions of a second thread.
pub struct Helped(std::sync::Mutex<Option<Box<dyn Fn() + Send>>>);

impl Helped {
    pub fn by(&self, help: Option<Box<dyn Fn() + Send>>) {
        *self.0.lock().unwrap() = help;
    }
}

impl Clock for Helped {
    fn now(&self) -> Instant {
        match &*self.0.lock().unwrap() {
            Some(help) => help(),
            None => loom::thread::yield_now(),
        }
        Instant::from_ns(0)
    }
}

impl Doorbell for Helped {
    type Seen = ();

    fn ring(&self, _processor: Processor) {}

    fn prepare(&self) {}

    fn wait(&self, (): (), _until: Instant, _: Option<Processor>) {
        unreachable!("who spins does not sleep");
    }
}

impl<const N: usize> Bell<N> for Helped {
    const WAITING: Waiting = Waiting::Spin;

    fn of(_beds: &Arc<Beds<N>>, _me: Processor) -> Self {
        Self(std::sync::Mutex::new(None))
    }
}

/// The section of a processor with one context.
pub struct Alone;

impl Exclusion for Alone {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        body()
    }
}

/// The section of a processor whose contexts are threads.
pub struct Locked(Mutex<()>);

impl Locked {
    pub fn new() -> Self {
        Self(Mutex::new(()))
    }
}

impl Exclusion for Locked {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        let _alone = self.0.lock().unwrap();
        body()
    }
}

/// The memory and the beds of a system of `N`.
pub struct System<const N: usize> {
    windows: [Windows<LoomWindow>; N],
    beds: Arc<Beds<N>>,
}

impl<const N: usize> System<N> {
    pub fn new() -> Self {
        let windows = std::array::from_fn(|_| Windows {
            mail: LoomWindow::mail(N as u32),
            data: LoomWindow::data(),
        });
        Self {
            windows,
            beds: Beds::new(),
        }
    }

    /// A mailbox that has joined.
    pub fn joined<D: Bell<N>, X: Exclusion>(
        &self,
        number: Processor,
        exclusion: X,
        vectors: &[(Vector, Handler<'static>)],
    ) -> Mailbox<'static, (LoomWindow, D, X), N> {
        let doorbell = D::of(&self.beds, number);
        let mut mailbox = Mailbox::new(number, self.windows.clone(), doorbell, exclusion).unwrap();
        mailbox.set_waiting(D::WAITING);
        for &(vector, handler) in vectors {
            mailbox.set_vector(vector, handler, "").unwrap();
        }
        mailbox.join().unwrap();
        mailbox
    }
}

/// A mailbox for a thread of its own.
pub type Single<D, const N: usize> = Mailbox<'static, (LoomWindow, D, Alone), N>;

/// Lets `a` and `b` acknowledge each other, so that a model begins where messages pass.
pub fn connect<D: Doorbell, X: Exclusion, Y: Exclusion, const N: usize>(
    a: &Mailbox<'static, (LoomWindow, D, X), N>,
    b: &Mailbox<'static, (LoomWindow, D, Y), N>,
) {
    a.serve(Duration::ZERO).unwrap();
    b.serve(Duration::ZERO).unwrap();
    a.serve(Duration::ZERO).unwrap();
}
