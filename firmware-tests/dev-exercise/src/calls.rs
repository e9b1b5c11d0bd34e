//! All calls, one after the other.

use core::fmt::Write as _;
use core::num::NonZeroU16;

use checks::Checks;
use condor_dev::drivers::{Format, Uart16550};
use condor_dev::{
    AccessError, Bus as _, Device, FdError, IoError, Location, Mmio, Mode, NoInterrupts, OpenError,
    Presence, Switch, Vector, device_switch,
};
use utah_mit_boards::{Adc16, Dac16, Encoder8, Mpp, Trigger};

use crate::memory::{BASE, Memory};

device_switch! {
    /// A board of each kind, and one that is not there.
    struct Boards {
        mpp: Mpp = [Location::at(BASE).interrupting(64, 3)],
        adc: Adc16 = [Location::at(BASE + 0x100), Location::at(BASE + 0x1000)],
        dac: Dac16 = [Location::at(BASE + 0x200)],
        encoder: Encoder8 = [Location::at(BASE + 0x300)],
        uart: Uart16550<1, 16> = [Location::at(BASE + 0x400).interrupting(64, 3)],
    }
}

const MPP: usize = BASE;
const ADC: usize = BASE + 0x100;
const DAC: usize = BASE + 0x200;
const ENCODER: usize = BASE + 0x300;
const UART: usize = BASE + 0x400;
const CHANNELS: usize = 0x20;

/// Descriptors of the switch.
const COUNT: usize = 5;

type Devices = Switch<Mmio, NoInterrupts, Boards, COUNT>;

static MEMORY: Memory = Memory::new();
static SWITCH: Devices = Switch::new(MEMORY.bus(), NoInterrupts, Boards::new());

/// The memory that answers as boards, from [`BASE`] on.
#[must_use]
pub fn memory() -> Mmio {
    MEMORY.bus()
}

/// Makes every call of a switch, once in a program.
pub fn everything(checks: &mut Checks<'_>) {
    let exercised = exercise(checks, &SWITCH, MEMORY.bus());
    checks.same("memory answers as boards do", exercised, Ok(()));
}

fn exercise(checks: &mut Checks<'_>, switch: &Devices, memory: Mmio) -> Result<(), AccessError> {
    identify(memory)?;
    checks.group("start-up");
    switch.start();
    let told = write!(checks, "{}", switch.inventory());
    checks.same("what is there is told", told, Ok(()));
    checks.group("descriptors");
    misuse(checks, switch);
    checks.group("typed calls");
    analog(checks, switch, memory)?;
    encoder(checks, switch);
    parallel(checks, switch);
    serial(checks, switch);
    checks.group("interrupts");
    switch.on_interrupt();
    let counts = switch.interrupt_counts();
    checks.same("an interrupt of nobody is spurious", counts.spurious, 1);
    checks.same("nobody is unhandled", switch.unhandled().count(), 0);
    checks.same("nothing is stuck", switch.stuck().count(), 0);
    Ok(())
}

/// Makes the memory look like the boards.
fn identify(memory: Mmio) -> Result<(), AccessError> {
    for (board, identification) in [
        (MPP, 0x3b70),
        (ADC, 0xadc0),
        (DAC, 0xdac0),
        (ENCODER, 0xe4c0),
    ] {
        memory.write16(board, identification)?;
    }
    for channel in 0..8_u8 {
        let at = CHANNELS + 4 * usize::from(channel);
        memory.write32(ADC + at, u32::from(channel) << 16 | u32::from(channel))?;
        memory.write32(ENCODER + at, u32::from(channel))?;
    }
    // A serial port that can always send.
    memory.write8(UART + 5, 0x60)?;
    Ok(())
}

fn misuse(checks: &mut Checks<'_>, switch: &Devices) {
    let name = "toaster";
    let devices = &[
        ("mpp", 1),
        ("adc", 2),
        ("dac", 1),
        ("encoder", 1),
        ("uart", 1),
    ];
    checks.same(
        "there is no such device",
        switch.open(name, 0, Mode::READ),
        Err(OpenError::NoSuchDevice { name, devices }),
    );
    let absent = OpenError::NotPresent {
        name: ":adc",
        board: 1,
        presence: Presence::Absent,
    };
    checks.same(
        "a board is absent",
        switch.open(":adc", 1, Mode::READ),
        Err(absent),
    );
    let Ok(fd) = switch.open(":adc", 0, Mode::READ | Mode::EXCLUSIVE) else {
        return checks.that("a board is opened", false);
    };
    checks.that(
        "a board is opened alone",
        switch.open(":adc", 0, Mode::READ).is_err(),
    );
    checks.that("it is ready", switch.read_ready(fd) == Ok(true));
    let mut bytes = [0; 6];
    checks.same("it is read", switch.read(fd, &mut bytes), Ok(6));
    checks.same("in order", bytes.map(u16::from), sequence());
    let direction = FdError::Direction {
        fd,
        wanted: Mode::WRITE,
        opened: Mode::READ | Mode::EXCLUSIVE,
    };
    checks.same(
        "it is not written",
        switch.write(fd, &bytes),
        Err(IoError::Fd(direction)),
    );
    let wrong = FdError::WrongType { fd, wanted: "dac" };
    let other: Result<Device<'_, _, Dac16, COUNT>, _> = switch.device(Boards::dac, fd);
    checks.same("it is of its type alone", other.map(|_| ()), Err(wrong));
    checks.same("it is closed", switch.close(fd), Ok(()));
    checks.same(
        "what is closed cannot be closed",
        switch.close(fd),
        Err(IoError::Fd(FdError::Closed { fd })),
    );
}

/// What the first three channels read as, in bytes.
fn sequence() -> [u16; 6] {
    let mut bytes = [0; 6];
    for (pair, channel) in bytes.as_chunks_mut::<2>().0.iter_mut().zip([0_u16, 0, 1]) {
        *pair = channel.to_ne_bytes().map(u16::from);
    }
    bytes
}

fn analog(checks: &mut Checks<'_>, switch: &Devices, memory: Mmio) -> Result<(), AccessError> {
    if let Ok(fd) = switch.open("adc", 0, Mode::READ) {
        if let Ok(adc) = switch.device(Boards::adc, fd) {
            let begun = adc
                .set_trigger(adc.registers, Trigger::Command)
                .and_then(|()| adc.start(adc.registers))
                .and_then(|()| adc.is_ready(adc.registers));
            checks.same("a conversion is begun", begun, Ok(false));
            let left = adc.set_trigger(adc.registers, Trigger::Continuous);
            checks.same("triggers are left", left, Ok(()));
            let mut values = [0; 16];
            checks.same(
                "all channels are scanned",
                adc.scan(adc.registers, &mut values),
                Ok(16),
            );
            checks.that("each is its own", values[15] == 7 && values[2] == 1);
        }
        checks.same("the board is closed", switch.close(fd), Ok(()));
    }
    if let Ok(fd) = switch.open("dac", 0, Mode::WRITE) {
        checks.same("bytes are channels", switch.write(fd, &[1; 4]), Ok(4));
        checks.same("it is flushed", switch.is_flushed(fd), Ok(true));
        checks.same("it can be written", switch.write_ready(fd), Ok(true));
        if let Ok(dac) = switch.device(Boards::dac, fd) {
            let written = dac.write_channels(dac.registers, 14, &[-2, -3]);
            checks.same("two channels are written", written, Ok(()));
            checks.that(
                "no more than there are",
                dac.write_channels(dac.registers, 15, &[0; 2]).is_err(),
            );
            let last = memory.read16(DAC + CHANNELS + 30)?;
            checks.same("the last is its own", last.cast_signed(), -3);
            checks.same(
                "all are written",
                dac.write_all(dac.registers, &[9; 16]),
                Ok(()),
            );
        }
        checks.same("the board is closed", switch.close(fd), Ok(()));
    }
    Ok(())
}

fn encoder(checks: &mut Checks<'_>, switch: &Devices) {
    let Ok(fd) = switch.open("encoder", 0, Mode::READ) else {
        return checks.that("an encoder board is opened", false);
    };
    if let Ok(encoder) = switch.device(Boards::encoder, fd) {
        let (registers, mut counts) = (encoder.registers, [0; 8]);
        let scanned = encoder.scan(registers, &mut counts);
        checks.same("all counters are read", scanned, Ok(8));
        checks.same("each is its own", counts, [0, 1, 2, 3, 4, 5, 6, 7]);
        let moved = encoder.scan_differences(registers, &mut counts);
        checks.same("none has moved", moved, Ok([0; 8]));
        let zeroed = encoder.zero(registers, 3);
        let zeroed = zeroed.and_then(|()| encoder.zero_at_index(registers, 1));
        checks.same("counters are zeroed, also at their index", zeroed, Ok(()));
        let (index, missed) = (
            encoder.take_index(registers),
            encoder.take_missed(registers),
        );
        checks.that("pulses are read", index.is_ok() && missed.is_ok());
    }
    checks.same("the board is closed", switch.close(fd), Ok(()));
}

fn parallel(checks: &mut Checks<'_>, switch: &Devices) {
    let Ok(fd) = switch.open("mpp", 0, Mode::READ | Mode::WRITE) else {
        return checks.that("a parallel port is opened", false);
    };
    if let Ok(mpp) = switch.device(Boards::mpp, fd) {
        let registers = mpp.registers;
        let set = mpp.config_8bit(registers);
        let set = set.and_then(|()| mpp.config_16bit_raw(registers));
        checks.same("bytes are chosen, then raw lines", set, Ok(()));
        let written = mpp.write_16bits(registers, 0xa55a);
        let read = written.and_then(|()| mpp.read_16bits(registers));
        checks.same("lines are written and read", read, Ok(0xa55a));
        checks.same("nothing ran over", mpp.overruns(), 0);
        checks.same("the board is served", mpp.poll(registers), Ok(()));
    }
    checks.same("two bytes are read", switch.read(fd, &mut [0; 2]), Ok(2));
    checks.same("two bytes are written", switch.write(fd, &[0; 2]), Ok(2));
    if let Ok(mpp) = switch.device(Boards::mpp, fd) {
        checks.that("the board is reset", mpp.reset(mpp.registers).is_ok());
    }
    checks.same("the board is closed", switch.close(fd), Ok(()));
}

fn serial(checks: &mut Checks<'_>, switch: &Devices) {
    let Ok(fd) = switch.open("uart", 0, Mode::READ | Mode::WRITE) else {
        return checks.that("a serial port is opened", false);
    };
    checks.same(
        "nothing has come",
        switch.read(fd, &mut [0]),
        Err(IoError::WouldBlock),
    );
    if let Ok(uart) = switch.device(Boards::uart, fd) {
        let format = Format::SEVEN_BITS.even().two_stop_bits();
        let divisor = const { NonZeroU16::new(12).unwrap() };
        checks.same(
            "the speed is set",
            uart.configure(uart.registers, divisor, format),
            Ok(()),
        );
        checks.same(
            "sixteen bytes are taken",
            switch.write(fd, &[7; 20]),
            Ok(16),
        );
        // Memory does not look like a FIFO: they are sent one by one.
        let sent = (0..16).try_for_each(|_| uart.poll(uart.registers));
        checks.same("they are sent", sent, Ok(()));
        checks.same("no line errors", uart.line_errors().framing, 0);
    }
    checks.same("all is sent", switch.is_flushed(fd), Ok(true));
    checks.same("the port is closed", switch.close(fd), Ok(()));
    checks.that(
        "its vector is known",
        Location::at(UART)
            .interrupting(64, 3)
            .interrupt()
            .map(|(vector, _)| vector)
            == Some(Vector(64)),
    );
}
