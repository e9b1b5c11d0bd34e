//! The report that a hart prints on its own terminal about the trap that has ended its program.

use core::fmt::{self, Write as _};
use core::time::Duration;

use board::Hart;
use condor_mbox::{Allocator, Call, Clock as _, MemoryWindow as _, Messenger as _};
use condor_rt::objects::{ObjectKind, ObjectTable};
use condor_rt::{Machine as _, ProgramError, users};
use condor_tty::{Terminal, TerminalVectors};
use qemu_virt_host::HartFault;

const SHOWN_BYTES: u32 = 4096;
/// The time that the host may take to show the report.
const PATIENCE: Duration = Duration::from_secs(2);
const NAP: Duration = Duration::from_millis(5);

/// Reports `fault` in an incarnation of the processor that does nothing else. The incarnation ends when the host
/// has shown the report, or after `PATIENCE`.
pub(crate) fn tell(hart: &Hart, fault: &HartFault) -> Result<(), ProgramError> {
    let number = hart.number();
    let own = users(hart, number)?;
    let mut allocator = Allocator::new(own.size());
    let mut objects = ObjectTable::new(own, &mut allocator)?;
    let terminal = Terminal::<_, _, 16>::new(own, &mut allocator, SHOWN_BYTES, hart.exclusion())?;
    let (name, kind) = ("console", ObjectKind::Terminal);
    objects.enter(&mut allocator, name, kind, terminal.offset(), SHOWN_BYTES)?;
    let typed = |call: &Call<'_>| terminal.receive(call);
    let mut mailbox = hart.mailbox()?;
    mailbox.set_vector(TerminalVectors::DEFAULT.input, &typed, "terminal input")?;
    mailbox.set_vector(TerminalVectors::DEFAULT.room, &typed, "terminal room")?;
    mailbox.join()?;
    // The ring takes all of it.
    let _ = write!(terminal.console(&mailbox), "{}", Report { hart, fault });
    let bell = hart.doorbell();
    let deadline = bell.now().after(PATIENCE);
    while bell.now() < deadline && (terminal.attached()?.is_none() || terminal.unread()? > 0) {
        mailbox.serve(NAP)?;
    }
    Ok(())
}

struct Report<'r> {
    hart: &'r Hart,
    fault: &'r HartFault,
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { hart, fault } = self;
        writeln!(
            f,
            "hart {}, processor {}: {} at pc {:#x}\n\
             value {:#x}, cause {}, mstatus {:#x}",
            hart.hart(),
            hart.number().0,
            fault.name(),
            fault.pc,
            fault.value,
            fault.cause,
            fault.status,
        )?;
        for (place, (name, value)) in NAMES.iter().zip(fault.registers).enumerate() {
            let end = if place % 4 == 3 { "\n" } else { "  " };
            write!(f, "{name:>3} {value:016x}{end}")?;
        }
        writeln!(f)
    }
}

/// `x1` to `x31` by their names in the calling convention.
const NAMES: [&str; 31] = [
    "ra", "sp", "gp", "tp", "t0", "t1", "t2", "s0", "s1", "a0", "a1", "a2", "a3", "a4", "a5", "a6",
    "a7", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "s9", "s10", "s11", "t3", "t4", "t5", "t6",
];
