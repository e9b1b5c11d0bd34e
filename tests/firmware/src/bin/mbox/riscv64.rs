//! Two harts that share memory and ring each other by machine software interrupts.
//!
//! Hart 0 leads: it makes the checks, prints them, and ends QEMU. First both harts serve while they wait or
//! poll; then both serve from the mailbox interrupt, nested into a background that computes and sends.

mod interrupt;

use core::num::NonZeroU32;
use core::time::Duration;

use condor_mbox::riscv::MsipDoorbell;
use condor_mbox::{Clock as _, Doorbell as _, Messenger as _, Processor};
use firmware::{CLINT, Checks, MTIME_HZ, check, print, ring};
use interrupt::{served_by_interrupt, served_on};
use riscv::register::{mie, mip};

#[cfg(feature = "conformance")]
use crate::conformance;
use crate::follower::{Order, give, obey, order, turn};
use crate::kept::kept;
use crate::memory::memory;
use crate::messages::messages;
use crate::resident::{Resident, reside};
use crate::{Bell, FOLLOWER, LEADER, PATIENCE, PROCESSORS};

static BELLS: [MsipDoorbell<PROCESSORS>; PROCESSORS] = [bell(LEADER), bell(FOLLOWER)];

const fn bell(me: Processor) -> MsipDoorbell<PROCESSORS> {
    const HZ: NonZeroU32 = NonZeroU32::new(MTIME_HZ).unwrap();
    // SAFETY: the machine has a CLINT of harts 0 and 1 there; they stay in machine mode, protect
    // nothing, and each uses its own doorbell alone. (The checks ring from that of the other.)
    unsafe { MsipDoorbell::new(CLINT, me, [0, 1], HZ) }.unwrap()
}

/// Tells `riscv-rt` whether this hart initializes memory. Hart 0 does, then rings hart 1, which waits here
/// until then.
#[unsafe(no_mangle)]
extern "C" fn _mp_hook(hart: usize) -> bool {
    if hart == 0 {
        return true;
    }
    // SAFETY: interrupts are masked: this one only ends the sleep.
    unsafe { mie::set_msoft() };
    while !mip::read().msoft() {
        riscv::asm::wfi();
    }
    // SAFETY: as above.
    unsafe { mie::clear_msoft() };
    ring(hart, false);
    riscv::asm::fence();
    false
}

/// Enters the program, on both harts.
#[firmware::entry]
fn main(hart: usize) -> ! {
    let [first, second] = &BELLS;
    if hart == 0 {
        check(|checks| lead(checks, first));
    }
    follow(second);
    loop {
        riscv::asm::wfi();
    }
}

fn lead(checks: &mut Checks, bell: Bell) {
    #[cfg(feature = "conformance")]
    {
        conformance::memories(checks);
        ring_suite(checks, bell);
    }
    let resided = reside(LEADER, bell, |mailbox, resident| {
        #[cfg(feature = "conformance")]
        served_by_interrupt(mailbox, || ring_suite(checks, bell));
        kept(mailbox);
        checks.group("serving while waiting");
        // The follower waits in `_mp_hook`.
        bell.ring(FOLLOWER);
        checks.same(mailbox.join(), Ok(()));
        let peer = mailbox.wait_for_peer(FOLLOWER, None, PATIENCE);
        checks.that(peer.is_ok());
        messages(checks, mailbox, resident, 1);
        checks.group("polling");
        give(checks, mailbox, Order::Poll);
        messages(checks, mailbox, resident, 1);
        memory(checks, mailbox);
        checks.group("serving from the mailbox interrupt");
        give(checks, mailbox, Order::Interrupts);
        checks.same(mailbox.ring_always(true), Ok(()));
        served_by_interrupt(mailbox, || {
            background(checks, bell, resident);
            messages(checks, mailbox, resident, 1);
            memory(checks, mailbox);
        });
        checks.that(served_on(0) > 0);
        checks.that(served_on(1) > 0);
    });
    checks.same(resided, Ok(()));
}

/// Checks a background that calls nothing of the mailbox: the interrupt serves all messages.
fn background(checks: &mut Checks, bell: Bell, resident: &Resident) {
    let deadline = bell.now().after(PATIENCE);
    let before = resident.ticks();
    let ticked = || resident.ticks().wrapping_sub(before) >= 10;
    while !ticked() && bell.now() < deadline {}
    checks.that(ticked());
}

fn follow(bell: Bell) {
    let resided = reside(FOLLOWER, bell, |mailbox, resident| {
        let mut ended = mailbox.join();
        while ended.is_ok() {
            let present = order(resident);
            obey(resident, present);
            match present {
                Order::Serve => ended = mailbox.serve(PATIENCE).map(drop),
                Order::Poll => {
                    // Memory that is gone stops the mailbox, too.
                    let _ = turn(mailbox, resident);
                    ended = mailbox.serve(Duration::ZERO).map(drop);
                }
                Order::Interrupts => {
                    ended = mailbox.ring_always(true);
                    served_by_interrupt(mailbox, || {
                        // For messages that came before rings were asked for.
                        bell.ring(FOLLOWER);
                        while order(resident) == present {
                            let _ = turn(mailbox, resident);
                        }
                    });
                    ended = ended.and_then(|()| mailbox.ring_always(false));
                }
            }
        }
    });
    if resided.is_err() {
        print("hart 1 has no mailbox\n");
    }
}

/// Checks the doorbell, with and without an interrupt handler that takes the rings.
#[cfg(feature = "conformance")]
fn ring_suite(checks: &mut Checks, bell: Bell) {
    let [_, other] = &BELLS;
    conformance::doorbell(checks, bell, || other.ring(LEADER));
}
