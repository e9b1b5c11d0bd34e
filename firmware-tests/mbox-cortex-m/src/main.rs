//! Two processors of one system in a core without compare-and-swap.
//!
//! The leader is the background of the core: it makes the checks of [`exercise`] and prints
//! them. The follower serves from the interrupt that its doorbell pends, in the middle of
//! whatever the leader does.
#![no_std]
#![no_main]

mod bell;
mod interrupt;
mod locks;
mod machine;

use core::panic::PanicInfo;

use bell::Bell;
use condor_mbox::{Backend, CriticalSection, StaticMemory, StaticWindow, Windows, layout};
use cortex_m::Peripherals;
use cortex_m::peripheral::syst::SystClkSource;
use interrupt::{Runnable, running, served};
use machine::{print, start_clock, switch_off};
use mbox_exercise::{Checks, DATA_BYTES, FOLLOWER, LEADER, Mbox, Order, PROCESSORS, Resident};

/// The chip, for a mailbox.
struct Chip;

impl Backend for Chip {
    type Window = StaticWindow<'static>;
    type Doorbell = Bell;
    type Exclusion = CriticalSection;
}

type Mail<'v> = Mbox<'v, Chip>;

const MAIL_WORDS: usize = layout::mail_bytes(PROCESSORS as u32) as usize / 4;
const DATA_WORDS: usize = DATA_BYTES as usize / 4;
/// At 16 MHz, 1000 in a second.
const TICK_CYCLES: u32 = 16_000;

static MAIL: [StaticMemory<MAIL_WORDS>; PROCESSORS] = [const { StaticMemory::new() }; PROCESSORS];
static DATA: [StaticMemory<DATA_WORDS>; PROCESSORS] = [const { StaticMemory::new() }; PROCESSORS];

#[cortex_m_rt::entry]
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
    let mut checks = Checks::new(&print);
    #[cfg(feature = "conformance")]
    suites(&mut checks);
    let bell = Bell { me: FOLLOWER };
    let resided = mbox_exercise::reside::<Chip, _>(
        FOLLOWER,
        windows(),
        bell,
        CriticalSection,
        |mailbox, resident| {
            let joined = mailbox.join().and_then(|()| mailbox.ring_always(true));
            checks.same("the follower joins", joined, Ok(()));
            let follower = Runnable { mailbox, resident };
            running(&follower, || lead(&mut checks));
        },
    );
    checks.same("a mailbox is made", resided, Ok(()));
    may_panic(TICK_CYCLES as usize);
    switch_off(checks.conclude());
}

fn lead(checks: &mut Checks<'_>) {
    let bell = Bell { me: LEADER };
    let resided = mbox_exercise::reside::<Chip, _>(
        LEADER,
        windows(),
        bell,
        CriticalSection,
        |mailbox, resident| {
            checks.group("the first life");
            mbox_exercise::first_life(checks, mailbox, windows(), (bell, CriticalSection));
            checks.group("serving from the mailbox interrupt");
            mbox_exercise::give(checks, mailbox, Order::Poll);
            let before = served();
            exchange(checks, mailbox, resident);
            checks.that("the interrupt has served", served() != before);
            checks.group("states");
            mbox_exercise::second_life(checks, mailbox, resident);
            checks.group("serving, and sending in between");
            mbox_exercise::give(checks, mailbox, Order::Interrupts);
            exchange(checks, mailbox, resident);
            checks.that("the follower has sent by itself", resident.ticks() > 0);
            checks.group("the end");
            mbox_exercise::last_order(checks, mailbox);
        },
    );
    checks.same("a mailbox is made", resided, Ok(()));
}

fn exchange(
    checks: &mut Checks<'_>,
    mailbox: &Mail<'_>,
    resident: &Resident<StaticWindow<'static>>,
) {
    let leader = Runnable { mailbox, resident };
    running(&leader, || {
        mbox_exercise::messages(checks, mailbox, resident, 2);
        mbox_exercise::memory(checks, mailbox, &locks::All);
    });
}

fn windows() -> [Windows<StaticWindow<'static>>; PROCESSORS] {
    let ([mail0, mail1], [data0, data1]) = (&MAIL, &DATA);
    [(mail0, data0), (mail1, data1)].map(|(mail, data)| Windows {
        mail: mail.window(),
        data: data.window(),
    })
}

#[cfg(feature = "conformance")]
fn suites(checks: &mut Checks<'_>) {
    use condor_mbox::Doorbell as _;

    checks.group("backends");
    let [Windows { mail, data }, _] = windows();
    mbox_exercise::window(checks, &mail);
    mbox_exercise::window(checks, &data);
    let bell = Bell { me: LEADER };
    mbox_exercise::doorbell(checks, &bell, LEADER, || Bell { me: FOLLOWER }.ring(LEADER));
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
