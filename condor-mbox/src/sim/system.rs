//! A whole system of simulated processors.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::cache::Cache;
use super::{SimMailbox, SimWindow};
use crate::doorbell::{Doorbell, Evidence};
use crate::error::MailboxError;
use crate::exclusion::CriticalSection;
use crate::id::Processor;
use crate::layout;
use crate::mailbox::Waiting;
use crate::time::{Clock, Instant};
use crate::windows::Windows;

/// The work of a processor while another one waits, in virtual time.
type Body = Arc<dyn Fn() + Send + Sync>;

/// A simulated system of `N` processors in one process, for tests. All clones are the same system.
///
/// ```
/// use std::time::Duration;
/// use condor_mbox::sim::SimSystem;
/// use condor_mbox::{MailboxError, Messenger, Processor, SendProgress, Vector};
///
/// # const HOST: Processor = Processor(0);
/// # const HAND: Processor = Processor(1);
/// # const V: Vector = Vector(3);
/// # const SECOND: Duration = Duration::from_secs(1);
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let system = SimSystem::<2>::in_virtual_time(4096);
/// let mut hand = system.mailbox(HAND)?;
/// hand.set_vector(V, &|call| call.data() + 1, "increment")?;
/// hand.join()?;
/// system.while_waiting(HAND, move || {
///     hand.serve(Duration::ZERO).expect("its memory is there");
/// });
/// let mut host = system.mailbox(HOST)?;
/// host.join()?;
///
/// // Rings that are lost delay a message, in virtual time.
/// system.drop_rings(HAND, u32::MAX);
/// assert_eq!(host.send_with_reply(HAND, V, 1, SECOND)?, 2);
///
/// // A processor that stops is stalled, and can go on; a virtual second takes no time.
/// system.stall(HAND, true);
/// assert_eq!(
///     host.send_with_reply(HAND, V, 2, SECOND),
///     Err(MailboxError::Stalled { to: HAND, vector: V, progress: SendProgress::MayRun })
/// );
/// system.stall(HAND, false);
/// assert_eq!(host.send_with_reply(HAND, V, 3, SECOND)?, 4);
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
pub struct SimSystem<const N: usize> {
    windows: [Windows<SimWindow>; N],
    caches: [Option<Arc<Cache>>; N],
    bells: Arc<Bells>,
}

/// The doorbell of a simulated processor, with the faults that its [`SimSystem`] injects.
#[derive(Clone)]
pub struct SimDoorbell {
    me: Processor,
    bells: Arc<Bells>,
}

struct Bells {
    processors: usize,
    state: Mutex<SystemState>,
    rung: Condvar,
    /// Real time counts from here; `None` in virtual time.
    begun: Option<std::time::Instant>,
}

#[derive(Default)]
struct SystemState {
    virtual_ns: u64,
    of: BTreeMap<Processor, Bell>,
}

#[derive(Default)]
struct Bell {
    rings: u64,
    drop_next: u32,
    repeat_next: u32,
    spurious_next: u32,
    stalled: bool,
    dead: bool,
    program: Option<Body>,
}

/// The step of virtual time at each reading of the clock.
const TICK_NS: u64 = 100;

impl<const N: usize> SimSystem<N> {
    /// Makes a system in virtual time: all processors run on one thread, and time passes when they
    /// wait or read the clock. The users' region of each processor's `data` has `data_bytes` bytes.
    #[must_use]
    pub fn in_virtual_time(data_bytes: u32) -> Self {
        Self::new(data_bytes, None)
    }

    /// Makes a system in real time, for processors that are threads. The users' region of each
    /// processor's `data` has `data_bytes` bytes.
    #[must_use]
    pub fn in_real_time(data_bytes: u32) -> Self {
        Self::new(data_bytes, Some(std::time::Instant::now()))
    }

    /// With caches, if the environment variable `CONDOR_SIM_CACHES` has a seed for them: so any tests
    /// are run on memory that is not coherent.
    fn new(data_bytes: u32, begun: Option<std::time::Instant>) -> Self {
        let windows = core::array::from_fn(|_| Windows {
            mail: SimWindow::new(layout::mail_bytes(N as u32)),
            data: SimWindow::new(layout::BELL_BYTES + data_bytes),
        });
        let bells = Bells {
            processors: N,
            state: Mutex::default(),
            rung: Condvar::new(),
            begun,
        };
        let system = Self {
            windows,
            caches: [const { None }; N],
            bells: Arc::new(bells),
        };
        let seed = std::env::var("CONDOR_SIM_CACHES").ok();
        match seed.and_then(|seed| seed.parse().ok()) {
            Some(seed) => system.with_caches(seed),
            None => system,
        }
    }

    /// Returns the same system, in which every processor has its own, non-coherent cache. The cache
    /// delays writes, and evicts and fetches lines at random; the same `seed` repeats the same
    /// choices. Windows that were taken before have no cache.
    #[must_use]
    pub fn with_caches(mut self, seed: u64) -> Self {
        let mut number = 0;
        self.caches = [const { None }; N].map(|_: Option<Arc<Cache>>| {
            number += 1;
            let seed = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
            Some(Arc::new(Cache::new(seed.rotate_left(number))))
        });
        self
    }

    /// Returns the windows of all processors as `owner` maps them: each `mail` except the owner's
    /// own is read-only. The index is the processor's number.
    #[must_use]
    pub fn windows(&self, owner: Processor) -> [Windows<SimWindow>; N] {
        core::array::from_fn(|number| {
            let cache = self.caches.get(owner.index()).cloned().flatten();
            let Windows { mail, data } = self.windows[number].clone();
            let (mail, data) = (mail.through(cache.clone()), data.through(cache));
            let mail = if number == owner.index() {
                mail
            } else {
                mail.read_only()
            };
            Windows { mail, data }
        })
    }

    /// Returns the doorbell of the processor `owner`.
    #[must_use]
    pub fn doorbell(&self, owner: Processor) -> SimDoorbell {
        SimDoorbell {
            me: owner,
            bells: Arc::clone(&self.bells),
        }
    }

    /// Makes a mailbox for the processor `number`, which has not joined yet.
    ///
    /// In virtual time the mailbox sleeps whenever it waits, so that the other processors run.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] if no processor has the number; [`MailboxError::Window`]
    /// if the processor's memory was made to fail by [`SimWindow::lose`].
    pub fn mailbox<'v>(&self, number: Processor) -> Result<SimMailbox<'v, N>, MailboxError> {
        if number.index() >= N {
            return Err(MailboxError::NoSuchProcessor {
                number,
                processors: N as u8,
            });
        }
        self.change(number, |bell| bell.dead = false);
        let (windows, doorbell) = (self.windows(number), self.doorbell(number));
        let mut mailbox = SimMailbox::new(number, windows, doorbell, CriticalSection)?;
        if self.bells.begun.is_none() {
            mailbox.set_waiting(Waiting::Sleep);
        }
        Ok(mailbox)
    }

    /// Sets the program that `processor` runs in virtual time whenever another processor waits, for
    /// example `move || { mailbox.serve(Duration::ZERO); }`.
    pub fn while_waiting(&self, processor: Processor, program: impl Fn() + Send + Sync + 'static) {
        self.change(processor, |bell| bell.program = Some(Arc::new(program)));
    }

    /// Injects a fault: the next `count` rings that others send to `processor` are lost.
    pub fn drop_rings(&self, processor: Processor, count: u32) {
        self.change(processor, |bell| bell.drop_next = count);
    }

    /// Injects a fault: the next `count` rings that others send to `processor` come twice.
    pub fn repeat_rings(&self, processor: Processor, count: u32) {
        self.change(processor, |bell| bell.repeat_next = count);
    }

    /// Injects a fault: the next `count` times that `processor` waits for a ring, the wait ends at
    /// once without one.
    pub fn spurious_rings(&self, processor: Processor, count: u32) {
        self.change(processor, |bell| bell.spurious_next = count);
        self.bells.rung.notify_all();
    }

    /// Injects a fault: if `stalled`, `processor` stops in the middle of its program; otherwise it
    /// goes on. In real time it stops at its next wait.
    pub fn stall(&self, processor: Processor, stalled: bool) {
        self.change(processor, |bell| bell.stalled = stalled);
        self.bells.rung.notify_all();
    }

    /// Injects a fault: the program of `processor` has ended without leaving the system. The caller
    /// must not use the processor's mailbox any more, nor drop it. A new mailbox from
    /// [`mailbox`](Self::mailbox) begins the next program.
    pub fn kill(&self, processor: Processor) {
        self.change(processor, |bell| {
            bell.dead = true;
            bell.program = None;
        });
    }

    fn change(&self, processor: Processor, change: impl FnOnce(&mut Bell)) {
        change(self.bells.lock().of.entry(processor).or_default());
    }
}

impl Bells {
    fn lock(&self) -> MutexGuard<'_, SystemState> {
        // A panic of one processor's test does not stop the others.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn programs(&self, except: Processor) -> Vec<Body> {
        let state = self.lock();
        let running = state
            .of
            .iter()
            .filter(|(number, bell)| **number != except && !bell.stalled);
        running
            .filter_map(|(_, bell)| bell.program.clone())
            .collect()
    }
}

impl Clock for SimDoorbell {
    fn now(&self) -> Instant {
        if let Some(begun) = self.bells.begun {
            return Instant::from_ns(u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX));
        }
        let mut state = self.bells.lock();
        state.virtual_ns += TICK_NS;
        Instant::from_ns(state.virtual_ns)
    }
}

impl Doorbell for SimDoorbell {
    type Seen = u64;

    fn ring(&self, processor: Processor) {
        if processor.index() >= self.bells.processors {
            return;
        }
        let mut state = self.bells.lock();
        let bell = state.of.entry(processor).or_default();
        if bell.drop_next > 0 {
            bell.drop_next -= 1;
            return;
        }
        let repeated = bell.repeat_next > 0;
        bell.repeat_next -= u32::from(repeated);
        bell.rings += 1 + u64::from(repeated);
        drop(state);
        self.bells.rung.notify_all();
    }

    fn prepare(&self) -> u64 {
        self.bells.lock().of.entry(self.me).or_default().rings
    }

    fn wait(&self, seen: u64, until: Instant, _: Option<Processor>) {
        let virtual_time = self.bells.begun.is_none();
        if virtual_time
            && self
                .bells
                .lock()
                .of
                .get(&self.me)
                .is_none_or(|bell| bell.rings == seen)
        {
            for program in self.bells.programs(self.me) {
                program();
            }
        }
        let mut state = self.bells.lock();
        loop {
            let bell = state.of.entry(self.me).or_default();
            let spurious = bell.spurious_next > 0;
            if !bell.stalled && (bell.rings != seen || spurious) {
                bell.spurious_next -= u32::from(spurious);
                return;
            }
            let stalled = bell.stalled;
            if virtual_time {
                state.virtual_ns = state.virtual_ns.max(until.as_ns());
                return;
            }
            // In real time the clock takes no lock.
            let left = until.ns_since(self.now());
            if left == 0 && !stalled {
                return;
            }
            // Woken by a ring or a change of its faults; a stalled processor waits for the latter.
            let nap = Duration::from_nanos(left.clamp(1, 10_000_000));
            let woken = self.bells.rung.wait_timeout(state, nap);
            state = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        if processor.index() >= self.bells.processors {
            return Evidence::Unknown;
        }
        let dead = self
            .bells
            .lock()
            .of
            .get(&processor)
            .is_some_and(|bell| bell.dead);
        if dead {
            Evidence::Dead
        } else {
            Evidence::Alive
        }
    }
}
