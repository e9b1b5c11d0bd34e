//! Measures the stack that the levels of a program take: background, mailbox interrupt with handlers that
//! call back, a slow loop and a fast one; each alone, and all together.
//!
//! The machine must run with `-icount`, so that whatever is too late is so by the program's fault.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use core::time::Duration;

use board::{Hart, HartTimer, MTIME, stack};
use condor_mbox::{Call, Clock as _, Messenger, Processor, Vector};
use condor_mos::{ClockSpec, LoopId, Loops, Overrun, Rate, Scan, Scheduler};
use condor_rt::{Machine as _, MailboxOf, ProgramError, Setup};
use drills::WRONG;
use drills::stack::{Depths, NAME, NESTED};

const RATES: [Rate; 2] = [Rate::hz(400), Rate::hz(100)];
const FAST: LoopId = LoopId(0);
const SLOW: LoopId = LoopId(1);
const ASK: Vector = Vector(10);
const TICK: Vector = Vector(9);

/// The time for which the slow loop computes, and the innermost handler: long enough to be interrupted by
/// all that is above them.
const SLOW_TAKES: Duration = Duration::from_micros(3500);
const HANDLER_TAKES: Duration = Duration::from_millis(4);
/// The number of measurements of each level alone, and the length of each, in ticks of the timer.
const LOOKS: u32 = 50;
const PERIOD_OF_FAST: u64 = 25_000;
const PERIOD_OF_SLOW: u64 = 100_000;
const LONGER_THAN_HANDLER: u64 = 50_000;
/// The time for which all levels run together.
const TOGETHER: Duration = Duration::from_secs(3);
const PATIENCE: Duration = Duration::from_secs(1);

/// Measures, and publishes what came out.
pub(crate) fn run(hart: &Hart) -> Result<(), ProgramError> {
    // Its own mailbox, loops and interrupts: a level is to be what it is alone.
    let mut publisher = Setup::new(hart)?.publish::<Depths>(NAME)?;
    let state = Reached::default();
    let ask = |call: &Call<'_>| state.answer(hart, call);
    let tick = |_: &Call<'_>| 0;
    let mut mailbox = hart.mailbox()?;
    mailbox.set_vector(ASK, &ask, "ask")?;
    mailbox.set_vector(TICK, &tick, "tick")?;
    mailbox.join()?;
    mailbox.ring_always(true)?;
    let levels = Levels {
        hart,
        mailbox: &mailbox,
        state: &state,
    };
    let depths = levels.measure()?;
    if state.failed.load(Ordering::Relaxed) {
        return Err(ProgramError::program(&WRONG));
    }
    publisher.publish(&depths)?;
    Ok(())
}

/// The flags and counts by which levels tell each other how far they are. On one hart, what an interrupt
/// has stored is visible at once.
#[derive(Default)]
struct Reached {
    in_handler: AtomicBool,
    in_slow: AtomicBool,
    /// The number of runs of the fast loop above both.
    at_once: AtomicU32,
    failed: AtomicBool,
}

impl Reached {
    /// Asks back, as often as it is told to; the innermost handler computes.
    fn answer(&self, hart: &Hart, call: &Call<'_>) -> u32 {
        let Some(rest) = call.data().checked_sub(1) else {
            self.in_handler.store(true, Ordering::Relaxed);
            compute(hart, HANDLER_TAKES);
            self.in_handler.store(false, Ordering::Relaxed);
            return 0;
        };
        let reply = call.send_with_reply(hart.number(), ASK, rest, PATIENCE);
        if reply.is_err() {
            self.failed.store(true, Ordering::Relaxed);
        }
        reply.map_or(0, |reply| reply.wrapping_add(1))
    }

    fn fast(&self) {
        if self.in_handler.load(Ordering::Relaxed) && self.in_slow.load(Ordering::Relaxed) {
            self.at_once.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn slow(&self, hart: &Hart) {
        self.in_slow.store(true, Ordering::Relaxed);
        compute(hart, SLOW_TAKES);
        self.in_slow.store(false, Ordering::Relaxed);
    }
}

type Two = Scheduler<HartTimer, 2, 0>;

struct Levels<'l, 'v> {
    hart: &'l Hart,
    mailbox: &'l MailboxOf<'v, Hart>,
    state: &'l Reached,
}

impl Levels<'_, '_> {
    fn measure(&self) -> Result<Depths, ProgramError> {
        let Self { hart, state, .. } = self;
        let me = hart.number();
        let table = Scan::try_new(&RATES, ClockSpec::of::<u64>(MTIME))?;
        let scheduler: Two = Scheduler::new(hart.platform(), table);
        // Each sends when it begins and when it has computed: its own rings come while it runs.
        let mut fast = |_| {
            state.fast();
            self.tick(me);
        };
        let mut slow = |_| {
            self.tick(me);
            state.slow(hart);
            self.tick(me);
        };
        let mut depths = Depths {
            stack: stack::BYTES,
            ..Depths::default()
        };
        scheduler.scope(|scope| {
            scope.assign(FAST, Overrun::Skip, &mut fast)?;
            scope.assign(SLOW, Overrun::Skip, &mut slow)?;
            let serve = || {
                let served = self.mailbox.serve(Duration::ZERO);
                served.unwrap_or_else(|_| {
                    state.failed.store(true, Ordering::Relaxed);
                    0
                })
            };
            // Rings of the loops are noted while they run, and serve nothing afterwards.
            hart.with_mail(
                || 0,
                || -> Result<(), ProgramError> {
                    depths.slow = self.alone(&scheduler, [SLOW, FAST], PERIOD_OF_SLOW)?;
                    depths.fast = self.alone(&scheduler, [FAST, SLOW], PERIOD_OF_FAST)?;
                    Ok(())
                },
            )??;
            hart.with_mail(serve, || {
                for (nested, depth) in (0..).zip(&mut depths.mailbox) {
                    *depth = self.mailbox_alone(me, nested)?;
                }
                let now = hart.doorbell().now();
                depths.background = critical_section::with(|_| self.background(me, now, true))?;
                scheduler.enable(SLOW)?;
                scheduler.enable(FAST)?;
                stack::paint(hart);
                let skipped = || -> Result<u32, ProgramError> {
                    let (fast, slow) = (scheduler.statistics(FAST)?, scheduler.statistics(SLOW)?);
                    Ok(fast.skipped.wrapping_add(slow.skipped) as u32)
                };
                depths.skipped = scheduler.run(|| {
                    let before = skipped()?;
                    let end = hart.doorbell().now().after(TOGETHER);
                    self.background(me, end, false)?;
                    Ok::<_, ProgramError>(skipped()?.wrapping_sub(before))
                })??;
                depths.deepest = stack::deepest(hart);
                Ok::<(), ProgramError>(())
            })?
        })?;
        depths.at_once = state.at_once.load(Ordering::Relaxed);
        Ok(depths)
    }

    /// Sends a message for whose end nobody waits. If there is no room, it is sent another time.
    fn tick(&self, me: Processor) {
        let _ = self.mailbox.send(me, TICK, 0, Duration::ZERO);
    }

    /// Returns the stack that the first of two loops takes above an idle background, in bytes.
    fn alone(&self, scheduler: &Two, loops: [LoopId; 2], ticks: u64) -> Result<u32, ProgramError> {
        let [alone, not] = loops;
        scheduler.enable(alone)?;
        scheduler.disable(not)?;
        let mut most = 0;
        scheduler.run(|| {
            for _ in 0..LOOKS {
                most = critical_section::with(|_| stack::taken(self.hart, ticks)).max(most);
                // There is room for the next.
                self.mailbox.serve(Duration::ZERO)?;
            }
            Ok::<_, ProgramError>(())
        })??;
        Ok(most)
    }

    /// Returns the stack that the mailbox interrupt takes above an idle background, in bytes.
    fn mailbox_alone(&self, me: Processor, nested: u32) -> Result<u32, ProgramError> {
        let mut most = 0;
        for _ in 0..LOOKS {
            let taken = critical_section::with(|_| -> Result<_, ProgramError> {
                let mut ticket = self.mailbox.begin(me, ASK, nested, Duration::ZERO)?;
                let taken = stack::taken(self.hart, LONGER_THAN_HANDLER);
                match ticket.poll()? {
                    Some(reply) if reply == nested => Ok(taken),
                    _ => Err(ProgramError::program(&WRONG)),
                }
            })?;
            most = most.max(taken);
        }
        Ok(most)
    }

    /// Calls itself until then, and says how deep the stack was; alone it is interrupted only where it
    /// idles, and what interrupts leave there is painted over.
    #[inline(never)]
    fn background(
        &self,
        me: Processor,
        end: condor_mbox::Instant,
        alone: bool,
    ) -> Result<u32, ProgramError> {
        let deepest = Cell::new(0);
        let look = || deepest.set(stack::deepest(self.hart).max(deepest.get()));
        if alone {
            stack::paint(self.hart);
        }
        loop {
            let nested = NESTED as u32 - 1;
            let mut ticket = self.mailbox.begin(me, ASK, nested, Duration::ZERO)?;
            if alone {
                look();
                let _ = stack::taken(self.hart, LONGER_THAN_HANDLER);
                stack::paint(self.hart);
            }
            let reply = loop {
                if let Some(reply) = ticket.poll()? {
                    break reply;
                }
            };
            drop(ticket);
            if reply != nested {
                return Err(ProgramError::program(&WRONG));
            }
            look();
            if self.hart.doorbell().now() >= end {
                return Ok(deepest.get());
            }
        }
    }
}

/// Computes for so long, with a frame of some size that floating point is done in.
#[inline(never)]
fn compute(hart: &Hart, time: Duration) {
    let bell = hart.doorbell();
    let end = bell.now().after(time);
    let mut values = [1.0_f64; 32];
    while bell.now() < end {
        for value in core::hint::black_box(&mut values) {
            *value = *value * 0.75 + 0.25;
        }
    }
}
