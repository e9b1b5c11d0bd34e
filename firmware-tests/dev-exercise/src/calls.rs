//! All calls, one after the other.

use core::fmt::{self, Write as _};
use core::num::NonZeroU16;

use checks::Checks;
use condor_dev::drivers::{Format, Uart16550};
use condor_dev::{
    AccessError, Bus as _, BusErrorKind, Device, FdError, InterruptController, IoError, Location,
    Mmio, Mode, OpenError, Presence, Switch, Vector, device_switch,
};
use utah_mit_boards::{Adc16, Dac16, Encoder8, Mpp, Trigger};

use crate::BASE;

device_switch! {
    /// A board of each kind, and one that is not there.
    pub struct Boards {
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

/// The switch that is exercised.
pub type Devices<C> = Switch<Mmio, C, Boards, COUNT>;

/// Makes every call of a switch that has not started.
///
/// # Errors
/// The memory refused what it must not refuse.
pub fn everything<C: InterruptController>(
    checks: &mut Checks<'_>,
    switch: &Devices<C>,
    memory: Mmio,
) -> Result<(), AccessError> {
    identify(memory)?;
    checks.group("start-up");
    switch.start();
    let mut found = Found::default();
    // It takes everything.
    let _ = write!(found, "{}", switch.inventory());
    checks.same("five boards are present", found.count(b"Present"), 5);
    checks.same("one is absent", found.count(b"Absent"), 1);
    checks.group("descriptors");
    misuse(checks, switch);
    checks.group("typed calls");
    analog(checks, switch, memory)?;
    encoder(checks, switch, memory)?;
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
    let beyond = memory.read8(BASE + 0x1000).map_err(|error| error.kind);
    let odd = memory.read32(BASE + 2).map_err(|error| error.kind);
    if beyond != Err(BusErrorKind::OutOfRange) || odd != Err(BusErrorKind::Misaligned) {
        return Err(AccessError {
            address: BASE,
            kind: BusErrorKind::Lost,
        });
    }
    Ok(())
}

fn misuse<C: InterruptController>(checks: &mut Checks<'_>, switch: &Devices<C>) {
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

fn analog<C: InterruptController>(
    checks: &mut Checks<'_>,
    switch: &Devices<C>,
    memory: Mmio,
) -> Result<(), AccessError> {
    if let Ok(fd) = switch.open("adc", 0, Mode::READ) {
        if let Ok(adc) = switch.device(Boards::adc, fd) {
            checks.same(
                "triggers are chosen",
                adc.set_trigger(adc.registers, Trigger::Command),
                Ok(()),
            );
            checks.same("a conversion is started", adc.start(adc.registers), Ok(()));
            checks.same("it is not done", adc.is_ready(adc.registers), Ok(false));
            checks.same(
                "triggers are left",
                adc.set_trigger(adc.registers, Trigger::Continuous),
                Ok(()),
            );
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

fn encoder<C: InterruptController>(
    checks: &mut Checks<'_>,
    switch: &Devices<C>,
    memory: Mmio,
) -> Result<(), AccessError> {
    let Ok(fd) = switch.open("encoder", 0, Mode::READ) else {
        checks.that("an encoder board is opened", false);
        return Ok(());
    };
    if let Ok(encoder) = switch.device(Boards::encoder, fd) {
        let mut counts = [0; 8];
        checks.same(
            "all counters are read",
            encoder.scan(encoder.registers, &mut counts),
            Ok(8),
        );
        checks.same("each is its own", counts, [0, 1, 2, 3, 4, 5, 6, 7]);
        memory.write32(ENCODER + CHANNELS, 100)?;
        let moved = encoder.scan_differences(encoder.registers, &mut counts);
        checks.same("one has moved", moved, Ok([100, 0, 0, 0, 0, 0, 0, 0]));
        checks.same(
            "counters are zeroed",
            encoder.zero(encoder.registers, 3),
            Ok(()),
        );
        checks.same(
            "and at their index",
            encoder.zero_at_index(encoder.registers, 1),
            Ok(()),
        );
        checks.that(
            "index pulses are read",
            encoder.take_index(encoder.registers).is_ok(),
        );
        checks.that(
            "missed pulses are read",
            encoder.take_missed(encoder.registers).is_ok(),
        );
    }
    checks.same("the board is closed", switch.close(fd), Ok(()));
    Ok(())
}

fn parallel<C: InterruptController>(checks: &mut Checks<'_>, switch: &Devices<C>) {
    let Ok(fd) = switch.open("mpp", 0, Mode::READ | Mode::WRITE) else {
        return checks.that("a parallel port is opened", false);
    };
    if let Ok(mpp) = switch.device(Boards::mpp, fd) {
        checks.same("bytes are chosen", mpp.config_8bit(mpp.registers), Ok(()));
        checks.same(
            "raw lines are chosen",
            mpp.config_16bit_raw(mpp.registers),
            Ok(()),
        );
        checks.same(
            "lines are written",
            mpp.write_16bits(mpp.registers, 0xa55a),
            Ok(()),
        );
        checks.same("and read", mpp.read_16bits(mpp.registers), Ok(0xa55a));
        checks.same("nothing ran over", mpp.overruns(), 0);
        checks.same("the board is served", mpp.poll(mpp.registers), Ok(()));
    }
    checks.same("two bytes are read", switch.read(fd, &mut [0; 2]), Ok(2));
    checks.same("two bytes are written", switch.write(fd, &[0; 2]), Ok(2));
    if let Ok(mpp) = switch.device(Boards::mpp, fd) {
        checks.that("the board is reset", mpp.reset(mpp.registers).is_ok());
    }
    checks.same("the board is closed", switch.close(fd), Ok(()));
}

fn serial<C: InterruptController>(checks: &mut Checks<'_>, switch: &Devices<C>) {
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

/// Counts words in what is printed, a line at a time.
struct Found {
    text: [u8; 512],
    len: usize,
}

impl Default for Found {
    fn default() -> Self {
        Self {
            text: [0; 512],
            len: 0,
        }
    }
}

impl Found {
    fn count(&self, word: &[u8]) -> usize {
        self.text
            .windows(word.len().max(1))
            .filter(|window| *window == word)
            .count()
    }
}

impl fmt::Write for Found {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            *self.text.get_mut(self.len).ok_or(fmt::Error)? = byte;
            self.len += 1;
        }
        Ok(())
    }
}
