//! Two harts that share memory and ring each other by machine software interrupts.
//!
//! Hart 0 leads: it makes the checks of [`exercise`], prints them, and ends QEMU. First both
//! harts serve while they wait; then both serve from the mailbox interrupt, nested into a
//! background that computes and sends.
#![no_std]
#![no_main]

mod interrupt;
mod locks;
mod machine;

use core::panic::PanicInfo;
use core::time::Duration;

use condor_mbox::riscv::MsipDoorbell;
use condor_mbox::{
    Clock as _, CriticalSection, Doorbell as _, Messenger, Processor, StaticMemory, StaticWindow,
    Windows, layout,
};
use interrupt::{served_by_interrupt, served_on};
use machine::{CLINT, MTIME_HZ, print, switch_off};
use mbox_exercise::{Checks, DATA_BYTES, FOLLOWER, LEADER, Mbox, Order, PROCESSORS, Resident};

core::arch::global_asm!(include_str!("start.s"));

/// The doorbell of a hart.
type Bell = MsipDoorbell<PROCESSORS>;
/// What a hart is for its mailbox. The critical section masks this hart alone: nothing that it guards
/// is shared with the other one.
type Board = (StaticWindow<'static>, &'static Bell, CriticalSection);
type Mail<'v> = Mbox<'v, Board>;

/// Nothing here takes as long, unless something is broken.
const PATIENCE: Duration = Duration::from_secs(20);
const MAIL_WORDS: usize = layout::mail_bytes(PROCESSORS as u32) as usize / 4;
const DATA_WORDS: usize = DATA_BYTES as usize / 4;

static MAIL: [StaticMemory<MAIL_WORDS>; PROCESSORS] = [const { StaticMemory::new() }; PROCESSORS];
static DATA: [StaticMemory<DATA_WORDS>; PROCESSORS] = [const { StaticMemory::new() }; PROCESSORS];
static BELLS: [Bell; PROCESSORS] = [bell(LEADER), bell(FOLLOWER)];

const fn bell(me: Processor) -> Bell {
    // SAFETY: the machine has a CLINT of harts 0 and 1 there; they stay in machine mode, protect
    // nothing, and each uses its own doorbell alone. (The checks ring from that of the other.)
    match unsafe { Bell::new(CLINT, me, [0, 1], MTIME_HZ) } {
        Some(bell) => bell,
        None => panic!("there are two processors"),
    }
}

/// Where both harts come from `start.s`.
#[unsafe(no_mangle)]
extern "C" fn main(hart: usize) {
    let [first, second] = &BELLS;
    if hart == 0 {
        let mut checks = Checks::new(&print);
        lead(&mut checks, first);
        may_panic(hart);
        switch_off(checks.conclude());
    }
    follow(second);
}

fn windows() -> [Windows<StaticWindow<'static>>; PROCESSORS] {
    let ([mail0, mail1], [data0, data1]) = (&MAIL, &DATA);
    [(mail0, data0), (mail1, data1)].map(|(mail, data)| Windows {
        mail: mail.window(),
        data: data.window(),
    })
}

fn lead(checks: &mut Checks<'_>, bell: &'static Bell) {
    #[cfg(feature = "conformance")]
    suites(checks, bell);
    let resided = mbox_exercise::reside::<Board, _>(
        LEADER,
        windows(),
        bell,
        CriticalSection,
        |mailbox, resident| {
            #[cfg(feature = "conformance")]
            served_by_interrupt(mailbox, || ring_suite(checks, bell));
            checks.group("the first life");
            bell.ring(FOLLOWER);
            mbox_exercise::first_life(checks, mailbox, windows(), (bell, CriticalSection));
            checks.group("serving while waiting");
            mbox_exercise::messages(checks, mailbox, resident, 1);
            checks.group("polling");
            mbox_exercise::give(checks, mailbox, Order::Poll);
            mbox_exercise::messages(checks, mailbox, resident, 1);
            mbox_exercise::memory(checks, mailbox, &locks::All);
            checks.group("states");
            mbox_exercise::give(checks, mailbox, Order::Serve);
            mbox_exercise::second_life(checks, mailbox, resident);
            checks.group("serving from the mailbox interrupt");
            mbox_exercise::give(checks, mailbox, Order::Interrupts);
            checks.same("rings are asked for", mailbox.ring_always(true), Ok(()));
            let computed = compute();
            served_by_interrupt(mailbox, || {
                background(checks, bell, resident, computed);
                mbox_exercise::messages(checks, mailbox, resident, 1);
                mbox_exercise::memory(checks, mailbox, &locks::All);
            });
            checks.same(
                "rings are no longer needed",
                mailbox.ring_always(false),
                Ok(()),
            );
            checks.that("the interrupt of hart 0 has served", served_on(0) > 0);
            checks.that("the interrupt of hart 1 has served", served_on(1) > 0);
            checks.group("the end");
            mbox_exercise::last_order(checks, mailbox);
        },
    );
    checks.same("a mailbox is made", resided, Ok(()));
}

/// The background calls nothing of the mailbox: what comes, the interrupt serves.
fn background(
    checks: &mut Checks<'_>,
    bell: &Bell,
    resident: &Resident<StaticWindow<'static>>,
    computed: f64,
) {
    let deadline = bell.now().after(PATIENCE);
    let before = resident.ticks();
    let mut right = true;
    while resident.ticks().wrapping_sub(before) < 10 && bell.now() < deadline {
        right &= compute().to_bits() == computed.to_bits();
    }
    checks.that(
        "messages are served while the background computes",
        resident.ticks().wrapping_sub(before) >= 10,
    );
    checks.that("its floating-point registers are its own", right);
}

/// Something that lives in floating-point registers for a while.
fn compute() -> f64 {
    let (mut even, mut odd) = (core::hint::black_box(1.0), core::hint::black_box(0.5));
    for _ in 0..20_000 {
        even = even * 0.75 + odd;
        odd = odd * 0.5 + even * 0.125;
    }
    even + odd
}

fn follow(bell: &'static Bell) {
    let resided = mbox_exercise::reside::<Board, _>(
        FOLLOWER,
        windows(),
        bell,
        CriticalSection,
        |mailbox, resident| {
            let mut ended = mailbox.join();
            while ended.is_ok() {
                let order = resident.order();
                match order {
                    Order::Serve => {
                        resident.obey(order);
                        ended = mailbox.serve(PATIENCE).map(drop);
                    }
                    Order::Poll => {
                        resident.obey(order);
                        // Memory that is gone stops the mailbox, too.
                        let _ = mbox_exercise::turn(mailbox, resident, &locks::All);
                        ended = mailbox.serve(Duration::ZERO).map(drop);
                    }
                    Order::Hold => resident.obey(order),
                    Order::Interrupts => {
                        ended = mailbox.ring_always(true);
                        served_by_interrupt(mailbox, || {
                            // What came before rings were asked for.
                            bell.ring(FOLLOWER);
                            resident.obey(order);
                            while resident.order() == order {
                                let _ = mbox_exercise::turn(mailbox, resident, &locks::All);
                            }
                        });
                        ended = ended.and_then(|()| mailbox.ring_always(false));
                    }
                    Order::Stop => {
                        resident.obey(order);
                        // Dropping the mailbox would leave in good order.
                        loop {
                            riscv::asm::wfi();
                        }
                    }
                }
            }
        },
    );
    if resided.is_err() {
        print("hart 1 has no mailbox\n");
    }
}

#[cfg(feature = "conformance")]
fn suites(checks: &mut Checks<'_>, bell: &Bell) {
    checks.group("backends");
    let [Windows { mail, data }, _] = windows();
    mbox_exercise::window(checks, &mail);
    mbox_exercise::window(checks, &data);
    ring_suite(checks, bell);
}

/// With and without an interrupt handler that takes the rings.
#[cfg(feature = "conformance")]
fn ring_suite(checks: &mut Checks<'_>, bell: &Bell) {
    let [_, other] = &BELLS;
    mbox_exercise::doorbell(checks, bell, LEADER, || other.ring(LEADER));
}

/// Panics, if built to: the search for panicking paths must find this one.
fn may_panic(index: usize) {
    if cfg!(feature = "panicking") {
        let table = core::hint::black_box([0_u8; 4]);
        core::hint::black_box(table[core::hint::black_box(index)]);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        print("panic in ");
        print(place.file());
        print("\n");
    }
    condor_firmware_panicked()
}

/// The name that is searched for in the linked image: it is there only if something can panic.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn condor_firmware_panicked() -> ! {
    switch_off(false)
}
