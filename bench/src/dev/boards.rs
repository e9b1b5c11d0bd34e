//! The boards of all paths: four drivers on a bus that is plain memory.

use std::cell::UnsafeCell;

use condor_dev::{
    Bus, BusError, BusErrorKind, Device, DeviceError, Driver, Mode, NoInterrupts, Place, Registers,
    Switch, Width, device_switch, drivers::Adc16,
};

/// Bytes of the bus.
const SIZE: usize = 0x1000;

/// What the bus says when there is nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Nothing(BusErrorKind);

impl BusError for Nothing {
    fn kind(&self) -> BusErrorKind {
        self.0
    }
}

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
    fn place<T>(&self, address: usize) -> Result<*mut T, Nothing> {
        if !address.is_multiple_of(size_of::<T>()) {
            return Err(Nothing(BusErrorKind::Misaligned));
        }
        if address > SIZE - size_of::<T>() {
            return Err(Nothing(BusErrorKind::NoAnswer));
        }
        // SAFETY: an aligned `T` at `address` ends inside of the bytes, which are aligned to 16.
        Ok(unsafe { self.0.get().cast::<u8>().add(address).cast() })
    }
}

macro_rules! accesses {
    ($($read:ident, $write:ident: $kind:ty;)*) => {
        $(
            #[inline]
            fn $read(&self, address: usize) -> Result<$kind, Nothing> {
                let place = self.place::<$kind>(address)?;
                // SAFETY: `place` checked it, and nobody else accesses it.
                Ok(unsafe { place.read_volatile() })
            }

            #[inline]
            fn $write(&self, address: usize, value: $kind) -> Result<(), Nothing> {
                let place = self.place::<$kind>(address)?;
                // SAFETY: as above.
                unsafe { place.write_volatile(value) };
                Ok(())
            }
        )*
    };
}

impl Bus for Memory {
    type Error = Nothing;

    accesses! {
        read8, write8: u8;
        read16, write16: u16;
        read32, write32: u32;
    }
}

macro_rules! written_in {
    ($(#[$doc:meta])* $driver:ident, $name:literal, $kind:ty, $write:ident, $offset:literal) => {
        $(#[$doc])*
        #[derive(Debug)]
        pub(super) struct $driver(());

        impl Driver for $driver {
            const NAME: &'static str = $name;
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
    Lamps, "lamps", u8, write8, 0x3
}
written_in! {
    /// A board with a word.
    Counter, "counter", u32, write32, 0x10
}
written_in! {
    /// The board that all paths write to: the memo's parallel port in raw 16-bit mode.
    Port, "port", u16, write16, 0x22
}

/// Where the port is.
pub(super) const PORT: usize = 0x700;

device_switch! {
    /// The port comes last, which is the longest way through the switch.
    pub(super) struct Boards {
        adc: Adc16 = [Place::at(0x000), Place::at(0x100)],
        lamps: Lamps = [Place::at(0x200), Place::at(0x300)],
        counter: Counter = [Place::at(0x400), Place::at(0x500)],
        port: Port = [Place::at(0x600), Place::at(PORT)],
    }
}

/// The switch of the descriptors' path.
pub(super) type BenchSwitch = Switch<Memory, NoInterrupts, Boards, 8>;

/// The device of the typed path.
pub(super) type PortDevice<'s> = Device<'s, Memory, Port, 8>;

/// One write of sixteen bits, which is peculiar to the port.
#[inline]
pub(super) fn set<B: Bus>(registers: Registers<'_, B>, value: u16) -> Result<(), B::Error> {
    registers.write16(0x22, value)
}

/// How the port is opened.
pub(super) const MODE: Mode = Mode::WRITE;
