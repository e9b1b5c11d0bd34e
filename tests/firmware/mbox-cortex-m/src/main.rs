//! Two processors of one system in a core without compare-and-swap.
//!
//! The leader is the background of the core: it makes the checks of [`mbox_exercise`] and prints
//! them. The follower serves from the interrupt that its doorbell pends, in the middle of
//! whatever the leader does.
#![no_std]
#![no_main]

mod bell;
mod interrupt;

use bell::Bell;
use cortex_m::Peripherals;
use cortex_m::peripheral::syst::SystClkSource;
use interrupt::{Runnable, running, served};
use machine::{CORE_HZ, check, start_clock};
use mbox_exercise::{Checks, FOLLOWER, LEADER, Mbox, Order, Resident};

type Mail<'v> = Mbox<'v, Bell>;

/// 1000 in a second.
const TICK_CYCLES: u32 = CORE_HZ / 1000;

#[machine::entry]
fn main() -> ! {
    start_clock();
    if let Some(core) = Peripherals::take() {
        let mut timer = core.SYST;
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload(TICK_CYCLES - 1);
        timer.clear_current();
        timer.enable_counter();
        timer.enable_interrupt();
    }
    check(|checks| {
        #[cfg(feature = "conformance")]
        suites(checks);
        let bell = Bell { me: FOLLOWER };
        let resided = mbox_exercise::reside(FOLLOWER, bell, |mailbox, resident| {
            let joined = mailbox.join().and_then(|()| mailbox.ring_always(true));
            checks.same(joined, Ok(()));
            let follower = Runnable { mailbox, resident };
            running(&follower, || lead(checks));
        });
        checks.same(resided, Ok(()));
    })
}

fn lead(checks: &mut Checks<'_>) {
    let bell = Bell { me: LEADER };
    let resided = mbox_exercise::reside(LEADER, bell, |mailbox, resident| {
        checks.group("the first incarnation");
        mbox_exercise::first_incarnation(checks, mailbox, bell);
        checks.group("serving from the mailbox interrupt");
        mbox_exercise::give(checks, mailbox, Order::Poll);
        let before = served();
        exchange(checks, mailbox, resident);
        checks.that(served() != before);
        checks.group("states");
        mbox_exercise::second_incarnation(checks, mailbox, resident);
        checks.group("serving, and sending in between");
        mbox_exercise::give(checks, mailbox, Order::Interrupts);
        exchange(checks, mailbox, resident);
        checks.that(resident.ticks() > 0);
        checks.group("the end");
        mbox_exercise::last_order(checks, mailbox);
    });
    checks.same(resided, Ok(()));
}

fn exchange(checks: &mut Checks<'_>, mailbox: &Mail<'_>, resident: &Resident) {
    let leader = Runnable { mailbox, resident };
    running(&leader, || {
        mbox_exercise::messages(checks, mailbox, resident, 2);
        mbox_exercise::memory(checks, mailbox);
    });
}

#[cfg(feature = "conformance")]
fn suites(checks: &mut Checks<'_>) {
    use condor_mbox::Doorbell as _;

    mbox_exercise::memories(checks);
    let bell = Bell { me: LEADER };
    mbox_exercise::doorbell(checks, &bell, || Bell { me: FOLLOWER }.ring(LEADER));
}
