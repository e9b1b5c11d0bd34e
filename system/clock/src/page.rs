//! [`Page`]: the shared words by which participants pass the turn, and the rules for passing it.
//!
//! One participant has the turn at any moment. It alone changes the time and passes the turn to the
//! participant that goes on first. If no participant may go on, the turn is free. A participant that then
//! changes something takes the turn and passes it on, in case another may now go on.

mod rules;
#[cfg(all(test, not(condor_loom)))]
mod tests;

use crate::handover::Handover;
use crate::obstacle::Obstacle;
use crate::sizes::LINES;
use crate::sync::{AtomicU32, AtomicU64, Ordering};

/// An instant that never comes; as a limit or a deadline it means that there is none.
pub const NEVER: u64 = u64::MAX;

/// `CCLK`.
const MAGIC: u32 = u32::from_le_bytes(*b"CCLK");
const VERSION: u32 = 1;

/// The longest sleep of a participant before it checks whether the participant that should wake it
/// has died.
const LOOK_NS: u64 = 100_000_000;
/// The greatest lag behind the real time that simulated time makes up for later.
const LAG_NS: u64 = 50_000_000;

/// The bit that marks the number of a participant which takes the turn only to give it on. Any
/// thread of its program may do that for a moment, while another thread waits for the turn under
/// the plain number.
const PASSING: u8 = 0x40;

/// The roles that a line can stand for.
mod role {
    pub(super) const NOBODY: u32 = 0;
    /// A processor whose program has entered and has not had its first turn.
    pub(super) const ENTERING: u32 = 1;
    pub(super) const PROCESSOR: u32 = 2;
    /// A part of the host that time waits for while it owes something.
    pub(super) const SERVICE: u32 = 3;
    /// A part of the host that may ask for the turn and owes nothing.
    pub(super) const GUEST: u32 = 4;
}

/// The events that end a wait of a processor before its instant, as bits.
mod ends {
    pub(super) const RING: u32 = 1;
    pub(super) const STOP: u32 = 2;
}

/// The page of memory through which all participants share one simulated time.
///
/// Memory becomes a page by [`reset`](Self::reset), which sets the time to instant 0. Instants are
/// in nanoseconds of simulated time since then; [`NEVER`] is after all of them. A program that
/// writes other words into the page can stop time or change the order of processors, but can do
/// nothing worse: all words are read as numbers and checked.
#[repr(C, align(64))]
#[derive(Debug)]
pub struct Page<const N: usize = LINES> {
    magic: AtomicU32,
    version: AtomicU32,
    /// The holder's number plus 1, or 0, in the lowest 8 bits; above them a count of changes.
    turn: AtomicU32,
    /// A bit for each processor whose program has to enter before anybody goes on.
    holds: AtomicU32,
    /// The present instant. Only the participant that has the turn writes this word and the next
    /// five.
    now: AtomicU64,
    /// Time does not pass this instant.
    limit: AtomicU64,
    /// From this instant on programs are to stop.
    stop_at: AtomicU64,
    /// Simulated time per real time in thousandths; 0 for as fast as possible.
    speed: AtomicU64,
    /// The real time of the instant `pace_from`.
    pace_wall: AtomicU64,
    pace_from: AtomicU64,
    lines: [Line; N],
}

/// A participant.
#[repr(C, align(64))]
#[derive(Debug)]
struct Line {
    role: AtomicU32,
    /// The events that end its wait early: bits of `ends`.
    ends: AtomicU32,
    /// The count of rings that the participant knew when it began to wait.
    seen: AtomicU32,
    /// Counts the rings of a processor, and the messages to a service.
    rings: AtomicU32,
    /// Counts the turns that the participant was given. The participant sleeps on this word.
    grants: AtomicU32,
    /// The count of rings whose messages the service has handled.
    consumed: AtomicU32,
    /// The number plus 1 of the service for whose answer the participant waits with the turn, or 0.
    asks: AtomicU32,
    /// Not 0 for a processor of another machine, which cannot sleep on these words.
    far: AtomicU32,
    /// The instant at which the participant goes on. If there is none, the instant before which none enters;
    /// `NEVER` if there is no such instant.
    next: AtomicU64,
}

/// The event that lets a processor go on before the instant for which it waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Until {
    /// No event: the processor waits for its instant.
    Instant,
    /// The count of rings of the processor differs from `seen`, or the instant comes from which
    /// programs are to stop.
    Ring {
        /// The count of rings that the processor had read before it began to wait.
        seen: u32,
    },
}

/// The error of [`Page::check`]: the memory does not hold a page, or the page has another version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the page of the simulated clock begins with {magic:#010x}, version {version}; expected {MAGIC:#010x}, version \
     {VERSION}: build all programs of the system from the same sources"
)]
pub struct PageError {
    /// The first word that was found.
    pub magic: u32,
    /// The second word that was found.
    pub version: u32,
}

#[cfg(not(condor_loom))]
const _: () = assert!(size_of::<Page>() == crate::sizes::PAGE_BYTES as usize);

impl Line {
    fn new() -> Self {
        Self {
            role: AtomicU32::new(role::NOBODY),
            ends: AtomicU32::new(0),
            seen: AtomicU32::new(0),
            rings: AtomicU32::new(0),
            grants: AtomicU32::new(0),
            consumed: AtomicU32::new(0),
            asks: AtomicU32::new(0),
            far: AtomicU32::new(0),
            next: AtomicU64::new(NEVER),
        }
    }
}

impl<const N: usize> Page<N> {
    /// Makes a page in the program's own memory, and resets it.
    #[must_use]
    pub fn new() -> Self {
        const { assert!(N <= PASSING as usize, "a number has a bit to spare") }
        let page = Self {
            magic: AtomicU32::new(0),
            version: AtomicU32::new(0),
            turn: AtomicU32::new(0),
            holds: AtomicU32::new(0),
            now: AtomicU64::new(0),
            limit: AtomicU64::new(NEVER),
            stop_at: AtomicU64::new(NEVER),
            speed: AtomicU64::new(0),
            pace_wall: AtomicU64::new(0),
            pace_from: AtomicU64::new(0),
            lines: core::array::from_fn(|_| Line::new()),
        };
        page.reset(0);
        page
    }

    /// Returns the page that lies in `words`, memory that participants share; `None` if there are too few words for a
    /// page, or if they are not aligned to 64 bytes.
    #[cfg(not(condor_loom))]
    #[must_use]
    pub fn from_words(words: &[AtomicU32]) -> Option<&Self> {
        let fits = size_of_val(words) >= size_of::<Self>();
        let page = words.as_ptr().cast::<Self>();
        // SAFETY: there are as many bytes, aligned, for as long as `words` are borrowed; any bytes
        // are valid atomics, and memory of atomics may be written by others.
        (fits && page.is_aligned()).then(|| unsafe { &*page })
    }

    /// Resets the page: the time is instant 0, and there are no participants. If bit *i* of `holds`
    /// is set, no participant goes on before processor *i* has [announced](Self::announce) itself.
    /// No other thread or program may use the page during this call.
    pub fn reset(&self, holds: u32) {
        for line in &self.lines {
            for word in [
                &line.role,
                &line.ends,
                &line.seen,
                &line.rings,
                &line.asks,
                &line.far,
            ] {
                word.store(0, Ordering::Relaxed);
            }
            line.grants.store(0, Ordering::Relaxed);
            line.consumed.store(0, Ordering::Relaxed);
            line.next.store(NEVER, Ordering::Relaxed);
        }
        for instant in [&self.now, &self.speed, &self.pace_wall, &self.pace_from] {
            instant.store(0, Ordering::Relaxed);
        }
        self.limit.store(NEVER, Ordering::Relaxed);
        self.stop_at.store(NEVER, Ordering::Relaxed);
        self.turn.store(0, Ordering::Relaxed);
        self.holds.store(holds, Ordering::Relaxed);
        self.version.store(VERSION, Ordering::Relaxed);
        // Release: pairs with the Acquire load in `check`.
        self.magic.store(MAGIC, Ordering::Release);
    }

    /// Checks that this is a page of this version.
    ///
    /// # Errors
    /// [`PageError`] if the first two words are not those of a page of this version.
    pub fn check(&self) -> Result<(), PageError> {
        // Acquire: pairs with the Release store in `reset`.
        let magic = self.magic.load(Ordering::Acquire);
        let version = self.version.load(Ordering::Relaxed);
        ((magic, version) == (MAGIC, VERSION))
            .then_some(())
            .ok_or(PageError { magic, version })
    }

    /// Returns the present instant of simulated time, in nanoseconds.
    #[inline]
    #[must_use]
    pub fn now(&self) -> u64 {
        // Relaxed: who has the turn has it from whoever wrote this.
        self.now.load(Ordering::Relaxed)
    }

    /// Returns the instant from which programs must stop, in nanoseconds; [`NEVER`] if none is set.
    #[must_use]
    pub fn stop_at(&self) -> u64 {
        self.stop_at.load(Ordering::Relaxed)
    }

    /// Returns the limit of simulated time: the instant, in nanoseconds, at which time stops until
    /// the limit is raised. Returns [`NEVER`] if there is no limit.
    #[must_use]
    pub fn limit(&self) -> u64 {
        self.limit.load(Ordering::Relaxed)
    }

    /// Returns the speed of simulated time that was set, in thousandths of real time: 1000 is as
    /// fast as real time. 0 means as fast as possible.
    #[must_use]
    pub fn speed(&self) -> u64 {
        self.speed.load(Ordering::Relaxed)
    }

    /// Returns true if `number` is a processor whose program has had its first turn and has not
    /// ended.
    #[must_use]
    pub fn is_alive(&self, number: u8) -> bool {
        self.role(number) == role::PROCESSOR
    }

    /// Returns true if `number` is a processor that was announced and has not ended, even if it has
    /// not had its first turn yet.
    #[must_use]
    pub fn is_processor(&self, number: u8) -> bool {
        matches!(self.role(number), role::PROCESSOR | role::ENTERING)
    }

    /// Returns true if `number` is a service that runs or will be restarted.
    #[must_use]
    pub fn is_service(&self, number: u8) -> bool {
        self.role(number) == role::SERVICE
    }

    /// Returns true if the participant `number` can only be woken by its doorbell, because it does
    /// not sleep on the words of this page. It is a part of the host, which also waits for other
    /// events, or a processor of another machine.
    #[must_use]
    pub fn needs_bell(&self, number: u8) -> bool {
        let is_far = |line: &Line| line.far.load(Ordering::Relaxed) != 0;
        matches!(self.role(number), role::SERVICE | role::GUEST)
            || self.line(number).is_some_and(is_far)
    }

    /// Sets whether the processor `me` belongs to another machine, so that only a doorbell can wake
    /// it. Call this before `me` is [announced](Self::announce).
    pub fn set_far(&self, me: u8, is_far: bool) {
        if let Some(line) = self.line(me) {
            line.far.store(is_far.into(), Ordering::Relaxed);
        }
    }

    /// Returns true if `number` is a participant of any kind: a processor, a service or a guest.
    #[must_use]
    pub fn takes_part(&self, number: u8) -> bool {
        self.role(number) != role::NOBODY
    }

    fn role(&self, number: u8) -> u32 {
        // Acquire: pairs with the Release stores of roles.
        let line = self.line(number);
        line.map_or(role::NOBODY, |line| line.role.load(Ordering::Acquire))
    }

    fn line(&self, number: u8) -> Option<&Line> {
        self.lines.get(usize::from(number))
    }

    /// Returns the number of the participant that has the turn, even if it has it only for a moment
    /// to pass it on; `None` if the turn is free.
    #[must_use]
    pub fn holder(&self) -> Option<u8> {
        // Acquire: pairs with the Release of `pass`: what the former holder wrote is seen.
        let holder = holder_of(self.turn.load(Ordering::Acquire))?;
        let number = holder & !PASSING;
        Some(self.line(number).map_or(holder, |_| number))
    }

    /// Returns true if the participant `number` has the turn, the right to run.
    #[must_use]
    pub fn has_turn(&self, number: u8) -> bool {
        // Acquire: as in `holder`.
        holder_of(self.turn.load(Ordering::Acquire)) == Some(number)
    }

    /// Returns true if the participant `number` has the turn and is not waiting for the answer of a
    /// service.
    #[must_use]
    pub fn is_busy(&self, number: u8) -> bool {
        let asks = |line: &Line| line.asks.load(Ordering::Relaxed) != 0;
        self.holder() == Some(number) && !self.line(number).is_some_and(asks)
    }

    // The operations of a processor.

    /// Makes processor `me` a participant. Its program gets its first turn at the latest of three instants: `at`, in
    /// nanoseconds, the instant to which its entry was [deferred](Self::defer), and the present one. Ends the
    /// [hold](Self::hold) for `me`. The caller must [kick](Self::kick) afterwards.
    pub fn announce(&self, me: u8, at: u64) {
        let line = self.line(me).filter(|_| !self.takes_part(me));
        let deferred = line.map(|line| line.next.load(Ordering::Relaxed));
        let deferred = deferred.filter(|&deferred| deferred != NEVER).unwrap_or(0);
        self.set_role(me, role::ENTERING, at.max(deferred));
        self.release(me);
    }

    /// Waits until processor `me`, which was [announced](Self::announce), has its first turn.
    pub fn first_turn(&self, me: u8, by: &impl Handover) {
        let Some(line) = self.line(me) else {
            return;
        };
        self.await_turn(me, by);
        while self.now() < line.next.load(Ordering::Relaxed) {
            // This turn was meant for its former incarnation.
            self.give(me, by);
            self.await_turn(me, by);
        }
        // Release: pairs with the Acquire loads of roles.
        line.role.store(role::PROCESSOR, Ordering::Release);
    }

    /// Ends the participation of processor `me`. Call it when the program of `me` ends. Rings all other processors,
    /// which may wait for `me`, and passes the turn on if `me` has it.
    pub fn leave(&self, me: u8, by: &impl Handover) {
        // A giver that finds no program there takes its turn back, but only from `me` itself.
        let had_turn = self.take_from(me, |holder| holder == me);
        self.end(me, by);
        if had_turn {
            self.give(me | PASSING, by);
        }
    }

    /// Passes the turn of `me` on, and waits until `me` has it again: at the instant `at`, in nanoseconds,
    /// or earlier at the event `until`. Returns the instant at which `me` goes on. In a
    /// [closed](Handover::is_closed) program it returns [`NEVER`] if no participant could ever wake `me`.
    pub fn turn(&self, me: u8, at: u64, until: Until, by: &impl Handover) -> u64 {
        let Some(line) = self.line(me) else {
            return at;
        };
        // Relaxed: read by who has the turn, or by who takes it after the second look of `give`.
        line.next.store(at, Ordering::Relaxed);
        let stops = self.now() < self.stop_at();
        if let Until::Ring { seen } = until {
            line.seen.store(seen, Ordering::Relaxed);
            let stop = if stops { ends::STOP } else { 0 };
            line.ends.store(ends::RING | stop, Ordering::Relaxed);
        }
        self.give(me, by);
        self.await_turn(me, by);
        line.ends.store(0, Ordering::Relaxed);
        let is_rung = matches!(until, Until::Ring { seen } if self.rings(me) != seen);
        let is_stopped = stops && self.now() >= self.stop_at();
        if by.is_closed() && at == NEVER && !is_rung && !is_stopped {
            return NEVER;
        }
        self.now()
    }

    /// Waits for an answer of the service `of`, while `me` keeps the turn and no time passes. The
    /// wait ends when the count of rings of `me` is no longer `seen`, or after 10 ms of real time.
    pub fn ask(&self, me: u8, of: u8, seen: u32, by: &impl Handover) {
        if let Some(line) = self.line(me) {
            line.asks.store(u32::from(of) + 1, Ordering::Relaxed);
            self.doze(me, seen, by);
            line.asks.store(0, Ordering::Relaxed);
        }
    }

    /// Waits until the count of rings of `me` is no longer `seen`, or for at most 10 ms of real
    /// time. `me` may have the turn or not.
    pub fn doze(&self, me: u8, seen: u32, by: &impl Handover) {
        const WHILE_NS: u64 = 10_000_000;
        if let Some(line) = self.line(me) {
            by.sleep(&line.rings, seen, WHILE_NS);
        }
    }

    /// Returns the number of times that the processor `number` was rung or, if `number` is a service, the number of
    /// messages to it that were counted. The count wraps.
    #[must_use]
    pub fn rings(&self, number: u8) -> u32 {
        // Acquire: pairs with the Release addition in `count_ring`.
        let line = self.line(number);
        line.map_or(0, |line| line.rings.load(Ordering::Acquire))
    }

    /// Counts a ring of the participant `number`, but does not wake it. The caller must have the turn, or must have
    /// sent a message to the service `number` and ring that service's own doorbell afterwards.
    pub fn count_ring(&self, number: u8) {
        if let Some(line) = self.line(number) {
            // Release: pairs with the Acquire loads of `rings`: what was written before is seen.
            line.rings.fetch_add(1, Ordering::Release);
        }
    }

    /// Wakes the participant `number` from a sleep on any of its words in the page, on behalf of a
    /// participant of another machine, which cannot wake `number` itself.
    pub fn wake(&self, number: u8, by: &impl Handover) {
        if let Some(line) = self.line(number) {
            by.wake(number, &line.grants);
            by.wake(number, &line.rings);
        }
    }

    // The operations of a part of the host.

    /// Makes `me` a service: a part of the host for which time waits until it has taken all
    /// messages to it. Also [requests](Self::request) the turn for `me`, so that no time passes
    /// before the service has seen what its previous run left undone.
    pub fn serve(&self, me: u8) {
        self.set_role(me, role::SERVICE, 0);
        // Relaxed: `pass` acquires.
        let turn = self.turn.load(Ordering::Relaxed);
        if holder_of(turn) == Some(me | PASSING) {
            // Its former incarnation died while it gave the turn on.
            self.pass(turn, Some(me));
        }
    }

    /// Makes `me` a guest: a part of the host that may [request](Self::request) the turn, and for
    /// which time otherwise does not wait.
    pub fn visit(&self, me: u8) {
        self.set_role(me, role::GUEST, NEVER);
    }

    /// Ends the participation of the guest or service `me`. Time no longer waits for it.
    pub fn give_up(&self, me: u8, by: &impl Handover) {
        self.set_role(me, role::NOBODY, NEVER);
        self.finish(me, by);
        self.kick(me, by);
    }

    fn set_role(&self, me: u8, role: u32, at: u64) {
        if let Some(line) = self.line(me) {
            line.asks.store(0, Ordering::Relaxed);
            line.ends.store(0, Ordering::Relaxed);
            line.next.store(at, Ordering::Relaxed);
            // Release: pairs with the Acquire loads of roles: who finds it finds when it goes on.
            line.role.store(role, Ordering::Release);
        }
    }

    /// Rings the processor `number` on behalf of `me`, which does not have the turn.
    pub fn ring(&self, me: u8, number: u8, by: &impl Handover) {
        if let Some(line) = self.line(number) {
            self.count_ring(number);
            // The processor may have the turn and wait for an answer.
            by.wake(number, &line.rings);
        }
        self.kick(me, by);
    }

    /// Records that the service `me` has handled all messages that were counted before
    /// [`rings`](Self::rings) returned `seen`. Simulated time does not wait for them any more.
    pub fn consumed(&self, me: u8, seen: u32, by: &impl Handover) {
        if let Some(line) = self.line(me) {
            // Release: pairs with the Acquire load in `owing`: what it has done is seen.
            if line.consumed.swap(seen, Ordering::Release) != seen {
                self.kick(me, by);
            }
        }
    }

    /// Asks for the turn for `me`, a part of the host, without waiting. `me` gets the turn at the
    /// instant `at`, in nanoseconds, or at the present instant if `at` has passed; in both cases
    /// after all processors that go on at that instant.
    pub fn request(&self, me: u8, at: u64, by: &impl Handover) {
        self.set_next(me, at);
        self.kick(me, by);
    }

    fn set_next(&self, me: u8, at: u64) {
        if let Some(line) = self.line(me) {
            // Release: pairs with the Acquire load in `first`.
            line.next.store(at, Ordering::Release);
        }
    }

    /// Releases the turn that `me` has [requested](Self::request), or withdraws the request if `me`
    /// does not have the turn yet.
    pub fn finish(&self, me: u8, by: &impl Handover) {
        self.postpone(me, NEVER, by);
    }

    /// Releases the turn that `me` has [requested](Self::request), and requests it again for the instant `at`, in
    /// nanoseconds, before any time passes.
    pub fn postpone(&self, me: u8, at: u64, by: &impl Handover) {
        self.set_next(me, at);
        if self.take_from(me, |holder| holder == me) {
            self.give(me | PASSING, by);
        }
    }

    /// Waits at most `most_ns` nanoseconds of real time for the turn that `me` has
    /// [requested](Self::request); returns true if `me` has it. Once the requested instant has
    /// come, `me` takes the turn if it is free, even while time waits for a program or a service. A
    /// caller without a line in the page, whose number is `N` or more, can take a free turn at any
    /// instant.
    pub fn await_request(&self, me: u8, most_ns: u64, by: &impl Handover) -> bool {
        if self.has_request(me, by) {
            return true;
        }
        if let Some(line) = self.line(me) {
            // Acquire: pairs with the Release addition in `give`.
            let grants = line.grants.load(Ordering::Acquire);
            if !self.has_turn(me) {
                by.sleep(&line.grants, grants, most_ns);
            }
        }
        self.has_request(me, by)
    }

    fn has_request(&self, me: u8, by: &impl Handover) -> bool {
        // Those who may go on go on before; the last holder may have died before its second look.
        self.kick(me, by);
        let line = self.line(me);
        let is_due = line.is_none_or(|line| line.next.load(Ordering::Relaxed) <= self.now());
        self.has_turn(me) || (is_due && self.take(me))
    }

    // The operations of the supervisor.

    /// Keeps all participants from going on until processor `number` is
    /// [announced](Self::announce).
    pub fn hold(&self, number: u8) {
        self.holds.fetch_or(bit(number), Ordering::SeqCst);
    }

    /// Ends the [`hold`](Self::hold) for the processor `number`. The caller must [kick](Self::kick)
    /// afterwards.
    pub fn release(&self, number: u8) {
        self.holds.fetch_and(!bit(number), Ordering::SeqCst);
    }

    /// Returns true if a [hold](Self::hold) for the processor `number` is in force.
    #[must_use]
    pub fn is_held(&self, number: u8) -> bool {
        self.holds.load(Ordering::SeqCst) & bit(number) != 0
    }

    /// Ends the participation of the processor or guest `number`, whose program has ended or was killed. If `number`
    /// had the turn, `me` takes the turn and passes it on.
    pub fn bury(&self, number: u8, me: u8, by: &impl Handover) {
        self.end(number, by);
        self.free(number, me, by);
        self.kick(me, by);
    }

    /// Defers the entry of the next program of processor `number`, which was [buried](Self::bury), to the
    /// instant `at`, in nanoseconds. Others go on meanwhile, once that program has [announced](Self::announce)
    /// itself. Call it before that program is started.
    pub fn defer(&self, number: u8, at: u64) {
        self.set_next(number, at);
    }

    /// Ends the participation of `number`, and rings its peers, which may wait for it.
    fn end(&self, number: u8, by: &impl Handover) {
        self.set_role(number, role::NOBODY, NEVER);
        for (peer, line) in (0..).zip(&self.lines) {
            if self.is_alive(peer) {
                self.count_ring(peer);
                by.wake(peer, &line.rings);
            }
        }
    }

    /// Cancels the request for the turn of `number`, a part of the host whose program has ended. If `number` had the
    /// turn, `me` takes the turn and passes it on.
    pub fn free(&self, number: u8, me: u8, by: &impl Handover) {
        self.set_next(number, NEVER);
        // One that was given the turn in vain has it if the giver died before it could see that.
        if self.take_from(me, |holder| {
            holder == number || holder == number | PASSING || self.is_void(holder)
        }) {
            self.give(me | PASSING, by);
        }
    }

    /// Sets the limit of simulated time to the instant `at`, in nanoseconds: participants that are due later do not go
    /// on until the limit is raised. With [`NEVER`] there is no limit. The caller must have the turn.
    pub fn set_limit(&self, at: u64) {
        self.limit.store(at, Ordering::Relaxed);
    }

    /// Sets the instant `at`, in nanoseconds, from which programs must stop. The caller must have the turn.
    pub fn set_stop_at(&self, at: u64) {
        self.stop_at.store(at, Ordering::Relaxed);
    }

    /// Sets the speed of simulated time in thousandths of real time: 1000 is as fast as real time.
    /// 0 means as fast as possible. The caller must have the turn.
    pub fn set_speed(&self, thousandths: u64, by: &impl Handover) {
        self.speed.store(thousandths, Ordering::Relaxed);
        self.keep_pace_from(by);
    }

    /// Compares simulated time with real time from the present instant on. Call this after a pause,
    /// so that simulated time does not hurry to make up for it. The caller must have the turn.
    pub fn keep_pace_from(&self, by: &impl Handover) {
        let wall = by.wall_ns().unwrap_or(0);
        self.pace_wall.store(wall, Ordering::Relaxed);
        self.pace_from.store(self.now(), Ordering::Relaxed);
    }

    /// Returns the reason why simulated time does not pass at this moment.
    pub fn standing(&self, by: &impl Handover) -> Obstacle {
        if let Some(holder) = self.holder() {
            let asks = self.line(holder);
            let asks = asks.map_or(0, |line| line.asks.load(Ordering::Relaxed));
            let asks = asks.checked_sub(1).map(|service| service as u8);
            // One that has its answer and does not go on is waited for itself.
            let asks = asks.filter(|&service| self.owes(service));
            return Obstacle::Turn { holder, asks };
        }
        self.first(by).err().unwrap_or(Obstacle::Pace)
    }
}

impl<const N: usize> Default for Page<N> {
    fn default() -> Self {
        Self::new()
    }
}

const fn bit(number: u8) -> u32 {
    1_u32.wrapping_shl(number as u32)
}

fn holder_of(turn: u32) -> Option<u8> {
    ((turn & 0xff) as u8).checked_sub(1)
}
