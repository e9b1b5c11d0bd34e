//! [`HartInterrupts`]: the interrupts of the boards of one hart's program.

use condor_dev::riscv::{Context, Plic};
use condor_dev::{InterruptController, InterruptLevel, InterruptVector, Mmio};
use condor_mbox::{Processor, StaticWindow};
use condor_rt::{BoardLines, FIRST_LINE, LineState, SERIAL_VECTOR};

use crate::bell::HartBell;
use crate::machine::{PLIC, PLIC_BYTES, PLIC_HIGHEST, PLIC_SOURCES};
use crate::msip::HARTS;

// SAFETY: the machine has a PLIC there, whose registers have four bytes.
static REGISTERS: Mmio = unsafe { Mmio::new(PLIC, PLIC_BYTES) };

/// The state of the lines of the hart that runs this image.
static STATE: LineState = LineState::new();

/// The PLIC of the machine, as one of its contexts sees it.
pub(crate) type HartPlic = Plic<&'static Mmio>;

pub(crate) const fn plic(context: Context) -> HartPlic {
    let highest = InterruptLevel(PLIC_HIGHEST);
    Plic::new(&REGISTERS, PLIC, context, PLIC_SOURCES, highest)
}

/// The PLIC as a hart's program sees it: the context of machine mode. Each hart has two contexts, and that of
/// supervisor mode is for the serial line between harts and host.
pub(crate) fn own_plic(hart: u32) -> Option<HartPlic> {
    let context = Context::new(u16::try_from(hart).ok()?.checked_mul(2)?)?;
    ((hart as usize) < HARTS).then(|| plic(context))
}

/// Makes the lines of boards that are memory of the processor `number`, with this `data` and doorbell.
pub(crate) const fn lines<D>(
    number: Processor,
    data: StaticWindow<'static>,
    bell: D,
) -> HartLines<D> {
    BoardLines::new(number, data, bell, &STATE)
}

/// The lines of boards that are memory.
pub(crate) type HartLines<D = HartBell> = BoardLines<StaticWindow<'static>, D, &'static LineState>;

/// The controller of the boards' interrupts of a hart's program: vectors 128 to 159 are boards that are memory,
/// and come first; lower ones are the sources of the machine's interrupt controller, the PLIC. The source of the hart's
/// serial port has the vector of [`SERIAL`](condor_rt::SERIAL).
#[derive(Clone, Debug)]
pub struct HartInterrupts {
    lines: HartLines,
    plic: HartPlic,
    /// The source of the serial port, if the hart has one.
    serial: Option<InterruptVector>,
}

impl HartInterrupts {
    /// Makes the controller of a hart with these lines, a PLIC of its own, and this source of its serial port.
    pub(crate) const fn new(
        lines: HartLines,
        plic: HartPlic,
        serial: Option<InterruptVector>,
    ) -> Self {
        Self {
            lines,
            plic,
            serial,
        }
    }

    /// The source in the PLIC that has a vector; `None` if it is that of a line.
    fn source(&self, vector: InterruptVector) -> Option<InterruptVector> {
        if vector == SERIAL_VECTOR {
            self.serial
        } else {
            (vector < FIRST_LINE).then_some(vector)
        }
    }

    /// The vector of a source in the PLIC.
    fn vector(&self, source: InterruptVector) -> InterruptVector {
        if self.serial == Some(source) {
            SERIAL_VECTOR
        } else {
            source
        }
    }

    /// The lines of boards that are memory.
    pub(crate) const fn lines(&self) -> &HartLines {
        &self.lines
    }
}

impl InterruptController for HartInterrupts {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        match self.source(vector) {
            Some(source) => self.plic.enable(source, level),
            None => self.lines.enable(vector, level),
        }
    }

    fn disable(&self, vector: InterruptVector) {
        match self.source(vector) {
            Some(source) => self.plic.disable(source),
            None => self.lines.disable(vector),
        }
    }

    fn claim(&self) -> Option<InterruptVector> {
        let line = self.lines.claim();
        line.or_else(|| Some(self.vector(self.plic.claim()?)))
    }

    fn complete(&self, vector: InterruptVector) {
        match self.source(vector) {
            Some(source) => self.plic.complete(source),
            None => self.lines.complete(vector),
        }
    }
}
