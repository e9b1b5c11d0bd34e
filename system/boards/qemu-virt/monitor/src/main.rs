//! The monitor, which a hart runs while it has no program: it waits for the host's order, starts the
//! program that the host has put into its memory, and is where the program ends. If the program ended by a
//! trap, the monitor says so on the hart's terminal.
#![no_std]
#![no_main]

mod report;

use core::time::Duration;

use board::Hart;
use board::resident::{self, Return};
use condor_mbox::{Clock as _, Doorbell as _};
use condor_rt::Machine as _;
use qemu_virt_host::{HartState, Map, map};

core::arch::global_asm!(
    include_str!("start.s"),
    harts = const map::HARTS,
    control = const 0x8000_0000_u64 + Map::control(0) as u64 + resident::SAVED as u64,
);

/// The time between two looks of a hart that was not rung.
const LOOK: Duration = Duration::from_millis(100);

/// The entry from `start.s`, each time that a hart comes to the monitor.
#[unsafe(no_mangle)]
extern "C" fn condor_monitor(why: usize, number: u32) -> ! {
    let why = Return::from_word(why);
    let fault = (why == Return::Faulted).then(|| resident::fault(number));
    resident::forget_debugger(number);
    resident::prepare(why, number);
    loop {
        // Before the host has written a map, the hart is nobody; those that the map leaves out stay so.
        if let Some(hart) = Hart::new(number) {
            // The page of this hart in the memory exists, since the hart does.
            let _ = settle(&hart, why, fault.as_ref());
            let _ = wait(&hart);
        }
        resident::nap(number);
    }
}

/// Says how the program has ended, if there was one.
fn settle(
    hart: &Hart,
    why: Return,
    fault: Option<&qemu_virt_host::HartFault>,
) -> Result<(), condor_mbox::AccessError> {
    let control = hart.control();
    let running = matches!(control.state()?, HartState::Runs { .. });
    match (why, fault) {
        (Return::Cold, _) => resident::guard_stack(hart.map(), hart.hart()),
        (Return::Abandoned, _) => control.leave()?,
        (Return::Faulted, Some(fault)) if running => {
            control.set_fault(fault)?;
            // A second trap finds that nothing runs any more.
            control.fail()?;
            // A peer that looks at the page of the hart sees it, too.
            let _ = report::tell(hart, fault);
        }
        // The program ended without having begun.
        (Return::Ended, _) if running => control.end(1)?,
        _ => {}
    }
    control.wait()
}

/// Waits for the host's order, and carries it out.
fn wait(hart: &Hart) -> Result<core::convert::Infallible, condor_mbox::AccessError> {
    let (bell, control, map) = (hart.doorbell(), hart.control(), hart.map());
    loop {
        let seen = bell.prepare();
        if let Some((start, entry)) = control.wanted()? {
            control.begin(start)?;
            let begin = map.programs.at(hart.hart());
            if (begin..begin.saturating_add(map.program_bytes())).contains(&entry) {
                resident::start(map, hart.hart(), entry);
            }
            // Nothing of the hart's lies there.
            control.end(1)?;
        }
        bell.wait(seen, bell.now().after(LOOK), None);
    }
}
