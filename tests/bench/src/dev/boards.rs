//! The boards of all paths: four drivers on a bus that is plain memory.

use std::cell::UnsafeCell;
use std::ffi::c_void;

use condor_dev::{
    Bus, BusErrorKind, Device, DeviceError, Driver, Location, NoInterrupts, OpenMode, Registers,
    Switch, Width, device_switch,
};
use utah_mit_boards::Adc16;

/// Bytes of the bus.
const SIZE: usize = 0x1000;

/// Registers that are memory.
#[repr(align(16))]
pub(super) struct Memory(UnsafeCell<[u8; SIZE]>);

// SAFETY: the program accesses the bus from one thread.
unsafe impl Sync for Memory {}

impl Memory {
    pub(super) const fn new() -> Self {
        Self(UnsafeCell::new([0; SIZE]))
    }

    #[inline]
    fn place(&self, address: usize, width: Width) -> Result<*mut c_void, BusErrorKind> {
        if !address.is_multiple_of(width.bytes()) {
            return Err(BusErrorKind::Misaligned);
        }
        if address > SIZE - width.bytes() {
            return Err(BusErrorKind::NoAnswer);
        }
        Ok(self.0.get().cast::<u8>().wrapping_add(address).cast())
    }
}

impl Bus for Memory {
    type Error = BusErrorKind;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Result<u32, BusErrorKind> {
        let place = self.place(address, width)?;
        // SAFETY: `place` checked it, and nobody else accesses it.
        Ok(unsafe {
            match width {
                Width::Bits8 => place.cast::<u8>().read_volatile().into(),
                Width::Bits16 => place.cast::<u16>().read_volatile().into(),
                Width::Bits32 => place.cast::<u32>().read_volatile(),
            }
        })
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusErrorKind> {
        let place = self.place(address, width)?;
        // SAFETY: as above.
        unsafe {
            match width {
                Width::Bits8 => place.cast::<u8>().write_volatile(value as u8),
                Width::Bits16 => place.cast::<u16>().write_volatile(value as u16),
                Width::Bits32 => place.cast::<u32>().write_volatile(value),
            }
        }
        Ok(())
    }
}

macro_rules! written_in {
    ($(#[$doc:meta])* $driver:ident, $kind:ty, $write:ident, $offset:literal) => {
        $(#[$doc])*
        #[derive(Debug)]
        pub(super) struct $driver(());

        impl Driver for $driver {
            const NEW: Self = Self(());
            const READS: bool = false;
            const WRITES: bool = true;

            fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
                registers.answers($offset, Width::Bits8)
            }

            fn init<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
                Ok(())
            }

            fn read<B: Bus>(
                &self,
                _: Registers<'_, B>,
                into: &mut [u8],
            ) -> Result<usize, DeviceError<B::Error>> {
                Err(DeviceError::Length { bytes: into.len(), unit: 0 })
            }

            fn write<B: Bus>(
                &self,
                registers: Registers<'_, B>,
                from: &[u8],
            ) -> Result<usize, DeviceError<B::Error>> {
                let Ok(bytes) = from.try_into() else {
                    let unit = size_of::<$kind>();
                    return Err(DeviceError::Length { bytes: from.len(), unit });
                };
                registers.$write($offset, <$kind>::from_ne_bytes(bytes))?;
                Ok(from.len())
            }

            fn read_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
                Ok(false)
            }

            fn write_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
                Ok(true)
            }
        }
    };
}

written_in! {
    /// A board with a byte.
    Lamps, u8, write8, 0x3
}
written_in! {
    /// A board with a word.
    Counter, u32, write32, 0x10
}
written_in! {
    /// The board that all paths write to: the memo's parallel port in raw 16-bit mode.
    Port, u16, write16, 0x22
}

/// The address of the port.
pub(super) const PORT: usize = 0x700;

device_switch! {
    /// The port comes last, which is the longest way through the switch.
    pub(super) struct Boards {
        adc: Adc16 = [Location::at(0x000), Location::at(0x100)],
        lamps: Lamps = [Location::at(0x200), Location::at(0x300)],
        counter: Counter = [Location::at(0x400), Location::at(0x500)],
        port: Port = [Location::at(0x600), Location::at(PORT)],
    }
}

/// The switch of the descriptors' path.
pub(super) type BenchSwitch = Switch<Memory, NoInterrupts, Boards, 8>;

/// The device of the typed path.
pub(super) type PortDevice<'s> = Device<'s, Memory, Port, 8>;

/// Writes sixteen bits at once, which is peculiar to the port.
#[inline]
pub(super) fn set<B: Bus>(registers: Registers<'_, B>, value: u16) -> Result<(), B::Error> {
    registers.write16(0x22, value)
}

/// The mode in which the port is opened.
pub(super) const MODE: OpenMode = OpenMode::WRITE;
