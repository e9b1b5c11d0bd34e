//! Two processors in a core without compare-and-swap.
//!
//! The leader is the background of the core: it makes the checks and prints them. The follower serves from the
//! interrupt that its doorbell pends, in the middle of whatever the leader does.

mod interrupt;

use condor_mbox::Processor;
use cortex_m::Peripherals;
use cortex_m::peripheral::syst::SystClkSource;
use firmware::{CORE_HZ, Checks, check, start_clock};
use interrupt::{Runnable, running, serve_other, served};

use crate::follower::{Order, give};
use crate::kept::kept;
use crate::memory::memory;
use crate::messages::messages;
use crate::resident::{Resident, reside};
use crate::{Bell, FOLLOWER, LEADER, Mail, PATIENCE};

/// 1000 in a second.
const TICK_CYCLES: u32 = CORE_HZ / 1000;

#[firmware::entry]
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
        let own = bell(FOLLOWER);
        let resided = reside(FOLLOWER, own, |mailbox, resident| {
            let joined = mailbox.join().and_then(|()| mailbox.ring_always(true));
            checks.same(joined, Ok(()));
            let follower = Runnable { mailbox, resident };
            running(&follower, || lead(checks));
        });
        checks.same(resided, Ok(()));
    })
}

const fn bell(me: Processor) -> Bell {
    Bell {
        me,
        run_other: serve_other,
    }
}

fn lead(checks: &mut Checks) {
    let own = bell(LEADER);
    let resided = reside(LEADER, own, |mailbox, resident| {
        kept(mailbox);
        checks.group("serving from the mailbox interrupt");
        checks.same(mailbox.join(), Ok(()));
        let peer = mailbox.wait_for_peer(FOLLOWER, None, PATIENCE);
        checks.that(peer.is_ok());
        give(checks, mailbox, Order::Poll);
        let before = served();
        exchange(checks, mailbox, resident);
        checks.that(served() != before);
        checks.group("serving, and sending in between");
        give(checks, mailbox, Order::Interrupts);
        exchange(checks, mailbox, resident);
        checks.that(resident.ticks() > 0);
    });
    checks.same(resided, Ok(()));
}

fn exchange(checks: &mut Checks, mailbox: &Mail<'_>, resident: &Resident) {
    let leader = Runnable { mailbox, resident };
    running(&leader, || {
        messages(checks, mailbox, resident, 2);
        memory(checks, mailbox);
    });
}

#[cfg(feature = "conformance")]
fn suites(checks: &mut Checks) {
    use condor_mbox::Doorbell as _;

    use crate::conformance;

    conformance::memories(checks);
    let own = bell(LEADER);
    conformance::doorbell(checks, own, || bell(FOLLOWER).ring(LEADER));
}
