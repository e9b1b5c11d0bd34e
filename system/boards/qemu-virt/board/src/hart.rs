//! [`Hart`]: a hart as the machine of a program.

use core::time::Duration;

use condor_clock::Page;
use condor_dev::{InterruptController as _, InterruptEntry, Mmio};
use condor_mbox::spin_lock::NativeSwap;
use condor_mbox::{AccessError, CriticalSection, Processor, Region, StaticWindow, Windows};
use condor_mos::riscv::Clint;
use condor_mos::{Armed, ConnectError, Loops, Platform, Rate, Timer};
use condor_rt::{
    Machine, PROCESSORS, ProgramError, SERIAL_VECTOR, ServoLoop, ShortText, on_one_stack,
};
use qemu_virt_host::{ARGUMENT_BYTES, Control, ERROR_BYTES, Map};

use crate::bell::HartBell;
use crate::boards::{self, HartInterrupts};
use crate::machine::{CLINT, EXTERNAL, LINE, MTIME, RAM, SOFTWARE};
use crate::memory::{LEAST_BYTES, memory};
use crate::msip::{self, HARTS, of_harts};
use crate::{hooks, serial, trap};

const fn timer(hart: u16) -> Clint {
    // SAFETY: the machine has a CLINT there; each hart uses its own timer, in machine mode.
    unsafe { Clint::new(CLINT, hart, MTIME) }.interrupted_also_by(SOFTWARE | EXTERNAL | LINE)
}

static TIMERS: [Clint; HARTS] = of_harts!(timer);

/// The timer of a hart.
pub(crate) fn clint(hart: usize) -> Option<&'static Clint> {
    TIMERS.get(hart)
}

/// The hart (RISC-V hardware thread) that runs this program. It is the
/// [`Machine`](condor_rt::Machine) that the program gets.
#[derive(Debug)]
pub struct Hart {
    /// Which of the machine.
    index: u32,
    number: Processor,
    map: Map,
    control: Control<StaticWindow<'static>>,
    bell: HartBell,
    clint: &'static Clint,
    bus: (Mmio, Mmio),
    interrupts: HartInterrupts,
    arguments: [u8; ARGUMENT_BYTES],
    arguments_len: usize,
    /// Arguments that are not the program's.
    skipped: usize,
}

impl Hart {
    /// Makes the machine of the calling hart. `hart` is the index of this hart, counted from 0.
    /// Returns `None` if the memory has no valid map, or the map has no hart with this index.
    #[must_use]
    pub fn new(hart: u32) -> Option<Self> {
        let least = memory(LEAST_BYTES);
        let map = Map::read(&least).ok()?;
        let number = Processor(*map.numbers.get(hart as usize)?);
        let msip = msip::of(hart as usize)?;
        let clint = clint(hart as usize)?;
        let control = Control::new(&least, hart).ok()?;
        let mut arguments = [0; ARGUMENT_BYTES];
        let arguments_len = control.arguments(&mut arguments).ok()?;
        let bus = RAM.wrapping_add(map.bus as usize) as *mut u8;
        // SAFETY: the map has checked that it lies in the RAM and in nothing else's; whoever else
        // uses it, boards that are simulated, accesses it as this does.
        let bus = unsafe { Mmio::translated(bus, 0, map.bus_bytes as usize) };
        let data = window(map.data.at(number.0.into()), map.data_bytes);
        let bell = HartBell::new(msip, &map);
        let lines = boards::lines(number, data, bell);
        let (port, source) = serial::find(hart);
        if source.is_some() {
            // The port has this vector alone.
            lines.disable(SERIAL_VECTOR);
        }
        let interrupts = HartInterrupts::new(lines, boards::own_plic(hart)?, source);
        Some(Self {
            index: hart,
            number,
            control,
            bell,
            clint,
            bus: (bus, port),
            interrupts,
            arguments,
            arguments_len,
            skipped: 0,
            map,
        })
    }

    /// Returns the index of the hart, counted from 0.
    #[must_use]
    pub const fn hart(&self) -> u32 {
        self.index
    }

    /// Returns the map of the machine's memory, which tells where everything lies in it.
    #[must_use]
    pub const fn map(&self) -> &Map {
        &self.map
    }

    /// Returns the page of memory by which the host controls this hart.
    #[must_use]
    pub const fn control(&self) -> &Control<StaticWindow<'static>> {
        &self.control
    }

    /// Returns the first argument of the image, and removes it from the arguments; `None` if there
    /// is none. An image with several programs uses it to select one of them.
    pub fn program(&mut self) -> Option<&str> {
        let program = self.skipped;
        self.skipped = program.saturating_add(1);
        self.text(program)
    }

    /// Returns the timer of the hart, which is the platform for a
    /// [`Scheduler`](condor_mos::Scheduler). Only one scheduler at a time may use it.
    #[must_use]
    pub const fn platform(&self) -> HartTimer {
        HartTimer(self.clint)
    }

    /// Leaves the text of the error with which the program ends, for the log of the host.
    pub(crate) fn leave(&self, error: &ProgramError) {
        let text = ShortText::<ERROR_BYTES>::of(error);
        // The page of the hart is there.
        let _ = self.control.set_error(text.as_str());
    }

    /// The hart's own `data`.
    pub(crate) fn own_data(&self) -> StaticWindow<'static> {
        window(self.map.data.at(self.number.0.into()), self.map.data_bytes)
    }

    /// Forgets what boards have requested of a former program.
    pub(crate) fn forget_boards(&self) {
        self.interrupts.lines().clear();
    }

    /// The page of the simulated clock.
    pub(crate) fn clock_page(&self) -> &'static Page {
        let page = RAM.wrapping_add(self.map.clock as usize) as *const Page;
        // SAFETY: the map has checked that it lies in the RAM, at the beginning of a page of memory;
        // whoever else uses it accesses it as this does.
        unsafe { &*page }
    }

    fn text(&self, index: usize) -> Option<&str> {
        let all = self.arguments.get(..self.arguments_len)?;
        let end = all.iter().rposition(|&byte| byte == 0)?;
        let argument = all.get(..end)?.split(|&byte| byte == 0).nth(index)?;
        core::str::from_utf8(argument).ok()
    }
}

/// A window of the map.
fn window(offset: u32, bytes: u32) -> StaticWindow<'static> {
    let address = RAM.wrapping_add(offset as usize) as *mut u32;
    // SAFETY: the map has checked that it lies in the RAM, between the map and the ranges of programs;
    // processors and processes of the host access it by words.
    unsafe { StaticWindow::from_raw(address, bytes) }
}

impl Machine for Hart {
    type Window = StaticWindow<'static>;
    type Doorbell = HartBell;
    type Exclusion = CriticalSection;
    /// The registers of boards, which harts and host share, and the serial port.
    type Bus = (Mmio, Mmio);
    type TestAndSet = NativeSwap<Region<StaticWindow<'static>>>;
    type Controller = HartInterrupts;

    fn number(&self) -> Processor {
        self.number
    }

    fn windows(&self) -> [Windows<StaticWindow<'static>>; PROCESSORS] {
        core::array::from_fn(|number| {
            let number = number as u32;
            Windows {
                mail: window(self.map.mail.at(number), Map::mail_bytes()),
                data: window(self.map.data.at(number), self.map.data_bytes),
            }
        })
    }

    fn doorbell(&self) -> HartBell {
        self.bell
    }

    fn exclusion(&self) -> CriticalSection {
        CriticalSection
    }

    fn shared_memory(&self) -> Option<Region<StaticWindow<'static>>> {
        let bytes = self.map.shared_bytes;
        (bytes > 0).then(|| Region::whole(window(self.map.shared, bytes)))
    }

    fn test_and_set(
        &self,
        memory: Region<StaticWindow<'static>>,
        offset: u32,
    ) -> Result<Self::TestAndSet, AccessError> {
        NativeSwap::new(memory, offset)
    }

    fn bus(&self) -> (Mmio, Mmio) {
        self.bus
    }

    fn argument(&self, index: usize) -> Option<&str> {
        self.text(index.checked_add(self.skipped)?)
    }

    fn is_stopping(&self) -> bool {
        // The memory is there.
        self.control.is_asked_to_end().unwrap_or(false)
    }

    fn is_float_exception_fatal(&self) -> bool {
        // The memory is there.
        self.control.float_exceptions().unwrap_or(false)
    }

    fn fail(&self, error: &ProgramError) {
        self.leave(error);
        // SAFETY: an illegal instruction, which the monitor reports, or at which a debugger holds the program.
        unsafe { core::arch::asm!("unimp", options(noreturn)) }
    }

    fn interrupt_controller(&self) -> HartInterrupts {
        self.interrupts.clone()
    }

    fn with_interrupts<R>(
        &self,
        entry: &dyn InterruptEntry,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let serve = || entry.serve_interrupts();
        let lines = *self.interrupts.lines();
        let set = |hooks: &hooks::Hooks, hook: Option<&'static dyn Fn()>| {
            hooks.boards.set(hook.map(|hook| (lines, hook)));
            // An interrupt that came before was not handled then.
            hooks.unhandled.update(|causes| causes & !(EXTERNAL as u32));
        };
        lines.serving(|| {
            hooks::with(&serve, set, || {
                // An interrupt from before was not heard.
                msip::ring_hart(self.index as usize);
                background()
            })
        })
    }

    fn unhandled_causes(&self) -> u32 {
        trap::unhandled_causes()
    }

    fn mail_interrupts(&self) -> bool {
        true
    }

    fn with_mail<R>(
        &self,
        serve: impl Fn() -> usize + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let serve = || {
            serve();
        };
        let set = |hooks: &hooks::Hooks, hook| hooks.mail.set(hook);
        Ok(hooks::with(&serve, set, background))
    }

    fn timer_frequency(&self) -> Rate {
        self.platform().frequency()
    }

    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        ahead: Duration,
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, ProgramError> {
        on_one_stack(self.platform(), loops, ahead, background)
    }
}

/// The timer of a hart, as the [`Platform`] of a scheduler. [`connect`](Platform::connect) sets the
/// handler of the timer's interrupt for as long as the scheduler runs.
#[derive(Clone, Copy, Debug)]
pub struct HartTimer(&'static Clint);

impl Timer for HartTimer {
    type Instant = u64;

    #[inline]
    fn frequency(&self) -> Rate {
        self.0.frequency()
    }

    #[inline]
    fn now(&self) -> u64 {
        self.0.now()
    }

    #[inline]
    fn arm(&self, at: u64) -> Armed {
        self.0.arm(at)
    }

    #[inline]
    fn disarm(&self) {
        self.0.disarm();
    }
}

impl Platform for HartTimer {
    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        let set = |hooks: &hooks::Hooks, hook: Option<&'static dyn Fn()>| {
            hooks.timer.set(hook.map(|hook| (self.0, hook)));
        };
        let result = hooks::with(&handler, set, || {
            trap::time(true);
            let result = program();
            trap::time(false);
            result
        });
        self.disarm();
        Ok(result)
    }

    #[inline]
    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        self.0.interruptible(rank, body);
    }
}
