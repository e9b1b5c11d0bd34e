//! The switch over boards that are memory: what is written to a register is read from it.

use core::fmt::{self, Display as _};

use condor_dev::drivers::Uart16550;
use condor_dev::stream::{DeviceStream, DeviceStreamError};
use condor_dev::{
    Bus as _, BusAccessError, FdError, IoError, Location, Mmio, NoInterrupts, OpenError, OpenMode,
    Presence, Switch, device_switch,
};
use embedded_io::{Read as _, Write as _};
use firmware::{Checks, Console, keep};
use utah_mit_boards::{Adc16, Dac16, Encoder8, Mpp};

use crate::memory::{BASE, MEMORY};

type Uart = Uart16550<1, 16>;

device_switch! {
    /// A board of each kind, and one that is not there.
    struct Boards {
        mpp: Mpp = [Location::at(BASE).interrupting(64, 3)],
        adc: Adc16 = [Location::at(ADC), Location::at(BASE + 0x1000)],
        dac: Dac16 = [Location::at(BASE + 0x200)],
        encoder: Encoder8 = [Location::at(BASE + 0x300)],
        uart: Uart = [Location::at(UART).interrupting(64, 3)],
    }
}

const ADC: usize = BASE + 0x100;
const UART: usize = BASE + 0x400;
const CHANNELS: usize = 0x20;

type Devices = Switch<Mmio, NoInterrupts, Boards, 5>;

static SWITCH: Devices = Switch::new(MEMORY.bus(), NoInterrupts, Boards::new());

/// Finds the boards, and reads and writes by a descriptor, once in a program.
pub(crate) fn boards(checks: &mut Checks) {
    kept();
    checks.group("boards that are memory");
    checks.same(identify(MEMORY.bus()), Ok(()));
    SWITCH.start();
    let told = fmt::Write::write_fmt(&mut Console, format_args!("{}", SWITCH.inventory()));
    checks.same(told, Ok(()));
    let absent = OpenError::NotPresent {
        name: ":adc",
        board: 1,
        presence: Presence::Absent,
    };
    checks.same(SWITCH.open(":adc", 1, OpenMode::READ), Err(absent));
    if let Ok(fd) = SWITCH.open("adc", 0, OpenMode::READ) {
        let mut values = [0; 16];
        let adc = SWITCH.device(Boards::adc, fd);
        let scanned = adc.map(|adc| adc.scan(adc.registers, &mut values));
        checks.same(scanned, Ok(Ok(16)));
        checks.same(values[15], 7);
        checks.same(SWITCH.close(fd), Ok(()));
    }
    let both = OpenMode::READ | OpenMode::WRITE | OpenMode::EXCLUSIVE;
    if let Ok(fd) = SWITCH.open(":uart", 0, both) {
        checks.same(SWITCH.read(fd, &mut [0]), Err(IoError::WouldBlock));
        let mut port = DeviceStream::new(&SWITCH, fd, || false);
        checks.same(port.read(&mut [0]), Err(DeviceStreamError::TimedOut));
        checks.same(port.write(&[7; 20]), Ok(16));
        checks.same(port.flush(), Err(DeviceStreamError::TimedOut));
        checks.same(SWITCH.close(fd), Ok(()));
        checks.that(SWITCH.close(fd).is_err());
    }
    SWITCH.on_interrupt();
    checks.same(SWITCH.interrupt_counts().spurious, 1);
    checks.same(SWITCH.unhandled().chain(SWITCH.stuck()).count(), 0);
}

/// Makes the memory look like the boards.
fn identify(memory: Mmio) -> Result<(), BusAccessError> {
    for (board, identification) in [0x3b70, 0xadc0, 0xdac0, 0xe4c0].into_iter().enumerate() {
        memory.write16(BASE + 0x100 * board, identification)?;
    }
    for channel in 0..8 {
        let at = ADC + CHANNELS + 4 * channel;
        memory.write32(at, (channel << 16 | channel) as u32)?;
    }
    // A serial port without a reason to interrupt, that can always send.
    memory.write8(UART + 2, 1)?;
    memory.write8(UART + 5, 0x60)
}

/// Keeps the calls that are made nowhere here.
fn kept() {
    keep! {
        Devices: open, open_typed::<Uart>, read, write, read_ready, write_ready, is_flushed, close,
            on_interrupt, interrupt_counts;
        Mpp: reset::<Mmio>, config_8bit::<Mmio>, config_16bit_raw::<Mmio>, read_16bits::<Mmio>,
            write_16bits::<Mmio>, overruns, poll::<Mmio>;
        Adc16: scan::<Mmio>, set_trigger::<Mmio>, start::<Mmio>, is_ready::<Mmio>;
        Dac16: write_channels::<Mmio>, write_all::<Mmio>;
        Encoder8: scan::<Mmio>, scan_differences::<Mmio>, zero::<Mmio>, zero_at_index::<Mmio>,
            take_index::<Mmio>, take_missed::<Mmio>;
        Uart: configure::<Mmio>, line_errors, poll::<Mmio>;
        OpenError<'_>: fmt;
        FdError: fmt;
        IoError<BusAccessError>: fmt;
        DeviceStreamError: fmt;
    }
}
