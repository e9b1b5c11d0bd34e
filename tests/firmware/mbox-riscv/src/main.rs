//! Two harts that share memory and ring each other by machine software interrupts.
//!
//! Hart 0 leads: it makes the checks of [`mbox_exercise`], prints them, and ends QEMU. First both
//! harts serve while they wait; then both serve from the mailbox interrupt, nested into a
//! background that computes and sends.
#![no_std]
#![no_main]

mod interrupt;

use core::num::NonZeroU32;
use core::time::Duration;

use condor_mbox::riscv::MsipDoorbell;
use condor_mbox::{Clock as _, Doorbell as _, Messenger as _, Processor};
use interrupt::{served_by_interrupt, served_on};
use machine::{CLINT, MTIME_HZ, check, print, ring};
use mbox_exercise::{Checks, FOLLOWER, LEADER, Mbox, Order, PROCESSORS, Resident};
use riscv::register::{mie, mip};

/// The doorbell of a hart.
type Bell = MsipDoorbell<PROCESSORS>;
/// The critical section masks this hart alone: nothing that it guards is shared with the other one.
type Mail<'v> = Mbox<'v, &'static Bell>;

/// Nothing here takes as long, unless something is broken.
const PATIENCE: Duration = Duration::from_secs(20);

static BELLS: [Bell; PROCESSORS] = [bell(LEADER), bell(FOLLOWER)];

const fn bell(me: Processor) -> Bell {
    const HZ: NonZeroU32 = NonZeroU32::new(MTIME_HZ).unwrap();
    // SAFETY: the machine has a CLINT of harts 0 and 1 there; they stay in machine mode, protect
    // nothing, and each uses its own doorbell alone. (The checks ring from that of the other.)
    unsafe { Bell::new(CLINT, me, [0, 1], HZ) }.unwrap()
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
#[machine::entry]
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

fn lead(checks: &mut Checks<'_>, bell: &'static Bell) {
    #[cfg(feature = "conformance")]
    {
        mbox_exercise::memories(checks);
        ring_suite(checks, bell);
    }
    let resided = mbox_exercise::reside(LEADER, bell, |mailbox, resident| {
        #[cfg(feature = "conformance")]
        served_by_interrupt(mailbox, || ring_suite(checks, bell));
        checks.group("the first incarnation");
        bell.ring(FOLLOWER);
        mbox_exercise::first_incarnation(checks, mailbox, bell);
        checks.group("serving while waiting");
        mbox_exercise::messages(checks, mailbox, resident, 1);
        checks.group("polling");
        mbox_exercise::give(checks, mailbox, Order::Poll);
        mbox_exercise::messages(checks, mailbox, resident, 1);
        mbox_exercise::memory(checks, mailbox);
        checks.group("states");
        mbox_exercise::give(checks, mailbox, Order::Serve);
        mbox_exercise::second_incarnation(checks, mailbox, resident);
        checks.group("serving from the mailbox interrupt");
        mbox_exercise::give(checks, mailbox, Order::Interrupts);
        checks.same(mailbox.ring_always(true), Ok(()));
        served_by_interrupt(mailbox, || {
            background(checks, bell, resident);
            mbox_exercise::messages(checks, mailbox, resident, 1);
            mbox_exercise::memory(checks, mailbox);
        });
        checks.same(mailbox.ring_always(false), Ok(()));
        checks.that(served_on(0) > 0);
        checks.that(served_on(1) > 0);
        checks.group("the end");
        mbox_exercise::last_order(checks, mailbox);
    });
    checks.same(resided, Ok(()));
}

/// Checks a background that calls nothing of the mailbox: the interrupt serves all messages.
fn background(checks: &mut Checks<'_>, bell: &Bell, resident: &Resident) {
    let deadline = bell.now().after(PATIENCE);
    let before = resident.ticks();
    let ticked = || resident.ticks().wrapping_sub(before) >= 10;
    while !ticked() && bell.now() < deadline {}
    checks.that(ticked());
}

fn follow(bell: &'static Bell) {
    let resided = mbox_exercise::reside(FOLLOWER, bell, |mailbox, resident| {
        let mut ended = mailbox.join();
        while ended.is_ok() {
            let order = resident.order();
            resident.obey(order);
            match order {
                Order::Serve => ended = mailbox.serve(PATIENCE).map(drop),
                Order::Poll => {
                    // Memory that is gone stops the mailbox, too.
                    let _ = mbox_exercise::turn(mailbox, resident);
                    ended = mailbox.serve(Duration::ZERO).map(drop);
                }
                Order::Hold => {}
                Order::Interrupts => {
                    ended = mailbox.ring_always(true);
                    served_by_interrupt(mailbox, || {
                        // For messages that came before rings were asked for.
                        bell.ring(FOLLOWER);
                        while resident.order() == order {
                            let _ = mbox_exercise::turn(mailbox, resident);
                        }
                    });
                    ended = ended.and_then(|()| mailbox.ring_always(false));
                }
                Order::Stop => {
                    // Dropping the mailbox would leave in good order.
                    loop {
                        riscv::asm::wfi();
                    }
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
fn ring_suite(checks: &mut Checks<'_>, bell: &Bell) {
    let [_, other] = &BELLS;
    mbox_exercise::doorbell(checks, bell, || other.ring(LEADER));
}
