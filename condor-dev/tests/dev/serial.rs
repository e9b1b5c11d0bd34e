//! I2C and SPI controllers as buses, on simulated registers.

use condor_dev::conformance::{self, BusMemory};
use condor_dev::sim::{self, Model};
use condor_dev::{Bus, BusAccessError, BusErrorKind, I2cBus, Registers, SpiBus, SpiCommand, Width};
use embedded_hal::i2c::{self, ErrorKind, NoAcknowledgeSource, Operation};
use embedded_hal::spi;

/// A part of 256 registers that keep what they are written.
struct Part([u8; 256]);

impl Model for Part {
    fn size(&self) -> usize {
        256
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        (width == Width::Bits8).then(|| self.0[offset].into())
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        (width == Width::Bits8).then(|| self.0[offset] = value as u8)
    }
}

const COMMAND: SpiCommand = SpiCommand {
    read: 0x80,
    write: 0x40,
};

#[test]
fn parts_on_two_wires_and_on_four_conform() {
    let parts = sim::SimBus::new();
    parts.insert(0x40 << 8, Part([0; 256]));
    let ground = BusMemory {
        memory: 0x4010,
        absent: Some(0x4100),
        refuses_misaligned: true,
    };
    let i2c = I2cBus::new(sim::I2c(parts.clone()));
    assert_eq!(conformance::bus(&i2c, ground), Ok(()));
    let spi = sim::Spi {
        bus: parts,
        base: 0x40 << 8,
        command: COMMAND,
    };
    let spi = SpiBus::new(0x2_0000, spi, COMMAND);
    let ground = BusMemory {
        memory: 0x2_0038,
        absent: Some(0x2_0040),
        ..ground
    };
    assert_eq!(conformance::bus(&spi, ground), Ok(()));
    // Both in one switch.
    let both = (i2c, spi);
    assert_eq!(conformance::bus(&both, ground), Ok(()));
}

#[test]
fn a_long_block_goes_in_parts_and_none_leaves_its_part() {
    let parts = sim::SimBus::new();
    let part = parts.insert(0x40 << 8, Part([0; 256]));
    let bus = I2cBus::from(0x8000, sim::I2c(parts));
    let registers = Registers::new(&bus, 0x8000 + (0x40 << 8));
    let bytes: [u8; 150] = core::array::from_fn(|at| at as u8);
    registers.write_block(3, &bytes).unwrap();
    assert_eq!(part.lock().unwrap().0[3..153], bytes);
    let mut back = [0; 150];
    registers.read_block(3, &mut back).unwrap();
    assert_eq!(back, bytes);
    let beyond = |address| {
        Err(BusAccessError {
            address,
            kind: BusErrorKind::OutOfRange,
        })
    };
    assert_eq!(registers.read_block(0xff, &mut [0; 2]), beyond(0xc0ff));
    assert_eq!(bus.write8(0x1_0000, 0), beyond(0x1_0000));
    assert_eq!(bus.write8(0x7fff, 0), beyond(0x7fff));
}

#[test]
fn each_address_is_the_first_buss_that_reaches_it() {
    let [first, second, third] = [0, 1, 2].map(|number| {
        let parts = sim::SimBus::new();
        parts.insert(0x40 << 8, Part([number; 256]));
        I2cBus::from(0x8000 * usize::from(number), sim::I2c(parts))
    });
    let bus = (first, (second, third));
    for number in 0..3 {
        let address = 0x8000 * usize::from(number) + 0x4020;
        assert!(bus.answers(address, Width::Bits8));
        assert_eq!(bus.read8(address), Ok(number));
        bus.write_block(address, &[7, 8]).unwrap();
        bus.write8(address + 1, 9).unwrap();
        let mut back = [0; 2];
        bus.read_block(address, &mut back).unwrap();
        assert_eq!(back, [7, 9]);
    }
    let nowhere = BusAccessError {
        address: 0x1_8000,
        kind: BusErrorKind::OutOfRange,
    };
    assert_eq!(bus.read8(0x1_8000), Err(nowhere));
}

/// A controller whose every transfer fails.
struct Broken<E>(E);

impl i2c::ErrorType for Broken<ErrorKind> {
    type Error = ErrorKind;
}

impl i2c::I2c for Broken<ErrorKind> {
    fn transaction(&mut self, _: u8, _: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        Err(self.0)
    }
}

impl spi::ErrorType for Broken<spi::ErrorKind> {
    type Error = spi::ErrorKind;
}

impl spi::SpiDevice for Broken<spi::ErrorKind> {
    fn transaction(&mut self, _: &mut [spi::Operation<'_, u8>]) -> Result<(), spi::ErrorKind> {
        Err(self.0)
    }
}

/// A controller whose bus is used again in the middle of each transfer, as by an interrupt.
struct Interrupted;

static BUS: I2cBus<Interrupted> = I2cBus::new(Interrupted);

impl i2c::ErrorType for Interrupted {
    type Error = ErrorKind;
}

impl i2c::I2c for Interrupted {
    fn transaction(&mut self, _: u8, _: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        let kind = BUS.read8(0x4100).map_err(|error| error.kind);
        assert_eq!(kind, Err(BusErrorKind::Busy));
        Ok(())
    }
}

#[test]
fn a_bus_in_use_is_refused_to_others() {
    for _ in 0..2 {
        assert_eq!(BUS.write8(0x4000, 1), Ok(()));
    }
}

#[test]
fn what_a_controller_reports_has_a_kind() {
    for (reported, kind) in [
        (
            ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address),
            BusErrorKind::NoAnswer,
        ),
        (
            ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data),
            BusErrorKind::Other,
        ),
        (ErrorKind::ArbitrationLoss, BusErrorKind::Busy),
        (ErrorKind::Overrun, BusErrorKind::Other),
        (ErrorKind::Other, BusErrorKind::Other),
    ] {
        let bus = I2cBus::new(Broken(reported));
        assert_eq!(bus.read8(0x4000).unwrap_err().kind, kind);
        assert_eq!(bus.write8(0x4000, 0).unwrap_err().kind, kind);
    }
    let bus = SpiBus::new(0, Broken(spi::ErrorKind::ModeFault), COMMAND);
    assert_eq!(bus.read8(0).unwrap_err().kind, BusErrorKind::Other);
}
