//! All calls, one after the other.

use core::fmt::Write as _;
use core::num::NonZeroU16;

use checks::Checks;
use condor_dev::drivers::{Format, Uart16550};
use condor_dev::{
    Bus as _, BusAccessError, Device, FdError, InterruptVector, IoError, Location, Mmio,
    NoInterrupts, OpenError, OpenMode, Presence, Switch, device_switch,
};
use utah_mit_boards::{Adc16, ConversionTrigger, Dac16, Encoder8, Mpp};

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

/// Returns the memory that answers as boards, from [`BASE`] on.
#[must_use]
pub fn memory() -> Mmio {
    MEMORY.bus()
}

/// Makes every call of a switch, once in a program.
pub fn everything(checks: &mut Checks<'_>) {
    let exercised = exercise(checks, &SWITCH, MEMORY.bus());
    checks.same(exercised, Ok(()));
}

fn exercise(checks: &mut Checks<'_>, switch: &Devices, memory: Mmio) -> Result<(), BusAccessError> {
    identify(memory)?;
    checks.group("start-up");
    switch.start();
    let told = write!(checks, "{}", switch.inventory());
    checks.same(told, Ok(()));
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
    checks.same(counts.spurious, 1);
    checks.same(switch.unhandled().count(), 0);
    checks.same(switch.stuck().count(), 0);
    Ok(())
}

/// Makes the memory look like the boards.
fn identify(memory: Mmio) -> Result<(), BusAccessError> {
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
    // A serial port without a reason to interrupt, that can always send.
    memory.write8(UART + 2, 1)?;
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
        switch.open(name, 0, OpenMode::READ),
        Err(OpenError::NoSuchDevice { name, devices }),
    );
    let absent = OpenError::NotPresent {
        name: ":adc",
        board: 1,
        presence: Presence::Absent,
    };
    checks.same(switch.open(":adc", 1, OpenMode::READ), Err(absent));
    let Ok(fd) = switch.open(":adc", 0, OpenMode::READ | OpenMode::EXCLUSIVE) else {
        return checks.that(false);
    };
    checks.that(switch.open(":adc", 0, OpenMode::READ).is_err());
    checks.that(switch.read_ready(fd) == Ok(true));
    let mut bytes = [0; 6];
    checks.same(switch.read(fd, &mut bytes), Ok(6));
    checks.same(bytes.map(u16::from), sequence());
    let direction = FdError::Direction {
        fd,
        wanted: OpenMode::WRITE,
        opened: OpenMode::READ | OpenMode::EXCLUSIVE,
    };
    checks.same(switch.write(fd, &bytes), Err(IoError::Fd(direction)));
    let wrong = FdError::WrongType { fd, wanted: "dac" };
    let other: Result<Device<'_, _, Dac16, COUNT>, _> = switch.device(Boards::dac, fd);
    checks.same(other.map(|_| ()), Err(wrong));
    checks.same(switch.close(fd), Ok(()));
    checks.same(switch.close(fd), Err(IoError::Fd(FdError::Closed { fd })));
}

/// Returns the bytes that the first three channels must read.
fn sequence() -> [u16; 6] {
    let mut bytes = [0; 6];
    for (pair, channel) in bytes.as_chunks_mut::<2>().0.iter_mut().zip([0_u16, 0, 1]) {
        *pair = channel.to_ne_bytes().map(u16::from);
    }
    bytes
}

fn analog(checks: &mut Checks<'_>, switch: &Devices, memory: Mmio) -> Result<(), BusAccessError> {
    if let Ok(fd) = switch.open("adc", 0, OpenMode::READ) {
        if let Ok(adc) = switch.device(Boards::adc, fd) {
            let begun = adc
                .set_trigger(adc.registers, ConversionTrigger::Command)
                .and_then(|()| adc.start(adc.registers))
                .and_then(|()| adc.is_ready(adc.registers));
            checks.same(begun, Ok(false));
            checks.same(
                adc.set_trigger(adc.registers, ConversionTrigger::Continuous),
                Ok(()),
            );
            let mut values = [0; 16];
            checks.same(adc.scan(adc.registers, &mut values), Ok(16));
            checks.that(values[15] == 7 && values[2] == 1);
        }
        checks.same(switch.close(fd), Ok(()));
    }
    if let Ok(fd) = switch.open("dac", 0, OpenMode::WRITE) {
        checks.same(switch.write(fd, &[1; 4]), Ok(4));
        checks.same(switch.is_flushed(fd), Ok(true));
        checks.same(switch.write_ready(fd), Ok(true));
        if let Ok(dac) = switch.device(Boards::dac, fd) {
            checks.same(dac.write_channels(dac.registers, 14, &[-2, -3]), Ok(()));
            checks.that(dac.write_channels(dac.registers, 15, &[0; 2]).is_err());
            let last = memory.read16(DAC + CHANNELS + 30)?;
            checks.same(last.cast_signed(), -3);
            checks.same(dac.write_all(dac.registers, &[9; 16]), Ok(()));
        }
        checks.same(switch.close(fd), Ok(()));
    }
    Ok(())
}

fn encoder(checks: &mut Checks<'_>, switch: &Devices) {
    let Ok(fd) = switch.open("encoder", 0, OpenMode::READ) else {
        return checks.that(false);
    };
    if let Ok(encoder) = switch.device(Boards::encoder, fd) {
        let (registers, mut counts) = (encoder.registers, [0; 8]);
        checks.same(encoder.scan(registers, &mut counts), Ok(8));
        checks.same(counts, [0, 1, 2, 3, 4, 5, 6, 7]);
        checks.same(encoder.scan_differences(registers, &mut counts), Ok([0; 8]));
        let zeroed = encoder.zero(registers, 3);
        let zeroed = zeroed.and_then(|()| encoder.zero_at_index(registers, 1));
        checks.same(zeroed, Ok(()));
        let (index, missed) = (
            encoder.take_index(registers),
            encoder.take_missed(registers),
        );
        checks.that(index.is_ok() && missed.is_ok());
    }
    checks.same(switch.close(fd), Ok(()));
}

fn parallel(checks: &mut Checks<'_>, switch: &Devices) {
    let Ok(fd) = switch.open("mpp", 0, OpenMode::READ | OpenMode::WRITE) else {
        return checks.that(false);
    };
    if let Ok(mpp) = switch.device(Boards::mpp, fd) {
        let registers = mpp.registers;
        let set = mpp.config_8bit(registers);
        checks.same(set.and_then(|()| mpp.config_16bit_raw(registers)), Ok(()));
        let written = mpp.write_16bits(registers, 0xa55a);
        let read = written.and_then(|()| mpp.read_16bits(registers));
        checks.same(read, Ok(0xa55a));
        checks.same(mpp.overruns(), 0);
        checks.same(mpp.poll(registers), Ok(()));
    }
    checks.same(switch.read(fd, &mut [0; 2]), Ok(2));
    checks.same(switch.write(fd, &[0; 2]), Ok(2));
    if let Ok(mpp) = switch.device(Boards::mpp, fd) {
        checks.that(mpp.reset(mpp.registers).is_ok());
    }
    checks.same(switch.close(fd), Ok(()));
}

fn serial(checks: &mut Checks<'_>, switch: &Devices) {
    let Ok(fd) = switch.open("uart", 0, OpenMode::READ | OpenMode::WRITE) else {
        return checks.that(false);
    };
    checks.same(switch.read(fd, &mut [0]), Err(IoError::WouldBlock));
    if let Ok(uart) = switch.device(Boards::uart, fd) {
        let format = Format::SEVEN_BITS.even().two_stop_bits();
        let divisor = const { NonZeroU16::new(12).unwrap() };
        checks.same(uart.configure(uart.registers, divisor, format), Ok(()));
        checks.same(switch.write(fd, &[7; 20]), Ok(16));
        // Memory does not look like a FIFO: they are sent one by one.
        checks.same((0..16).try_for_each(|_| uart.poll(uart.registers)), Ok(()));
        checks.same(uart.line_errors().framing, 0);
    }
    checks.same(switch.is_flushed(fd), Ok(true));
    checks.same(switch.close(fd), Ok(()));
    checks.that(
        Location::at(UART)
            .interrupting(64, 3)
            .interrupt()
            .map(|(vector, _)| vector)
            == Some(InterruptVector(64)),
    );
}
