//! The other ways from a number to the same driver.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use condor_dev::{Bus, DeviceError, Driver, Fd, FdError, IoError, OpenMode, Registers};
use utah_mit_boards::Adc16;
use vm_device::DeviceMmio;
use vm_device::bus::{MmioAddress, MmioAddressOffset, MmioRange};
use vm_device::device_manager::{IoManager, MmioManager};

use super::boards::{Counter, Lamps, Memory, Port};
use crate::Result;

/// A board as its caller has it: the state of its driver, and where it is.
pub(super) struct Board<D: 'static> {
    pub(super) driver: D,
    pub(super) registers: Registers<'static, Memory>,
}

impl<D: Driver> Board<D> {
    pub(super) const fn new(bus: &'static Memory, base: usize) -> Self {
        Self {
            driver: D::NEW,
            registers: Registers::new(bus, base),
        }
    }
}

type DriverResult = std::result::Result<usize, DeviceError<<Memory as Bus>::Error>>;

/// The calls of a switch of trait objects.
pub(super) trait AnyBoard: Sync {
    #[allow(
        dead_code,
        reason = "a switch that writes alone would have smaller tables than ours"
    )]
    fn read(&self, into: &mut [u8]) -> DriverResult;
    fn write(&self, from: &[u8]) -> DriverResult;
}

impl<D: Driver> AnyBoard for Board<D> {
    fn read(&self, into: &mut [u8]) -> DriverResult {
        self.driver.read(self.registers, into)
    }

    fn write(&self, from: &[u8]) -> DriverResult {
        self.driver.write(self.registers, from)
    }
}

/// A switch that checks descriptors as [`condor_dev::Switch`] does, and calls trait objects.
pub(super) struct DynSwitch {
    /// Generation, board, whether it is open, and how.
    entries: [AtomicU32; 8],
    boards: [&'static dyn AnyBoard; 8],
}

const OPEN: u32 = 1 << 19;

fn wanted(generation: u16, mode: OpenMode) -> u32 {
    OPEN | u32::from(mode.bits()) << 16 | u32::from(generation)
}

impl DynSwitch {
    /// Makes a switch of all boards of the benchmark, the port as the last one.
    pub(super) fn new(bus: &'static Memory, port: usize) -> Self {
        fn boards<D: Driver>(bus: &'static Memory, first: usize) -> [&'static dyn AnyBoard; 2] {
            [first, first + 0x100].map(|base| -> &'static dyn AnyBoard {
                Box::leak(Box::new(Board::<D>::new(bus, base)))
            })
        }
        let kinds = [
            boards::<Adc16>(bus, 0),
            boards::<Lamps>(bus, 0x200),
            boards::<Counter>(bus, 0x400),
            boards::<Port>(bus, port - 0x100),
        ];
        Self {
            entries: Default::default(),
            boards: std::array::from_fn(|slot| kinds[slot / 2][slot % 2]),
        }
    }

    /// Makes `fd` a descriptor of the port.
    pub(super) fn open(&self, fd: Fd, mode: OpenMode) {
        let entry = 7 << 20 | wanted(fd.generation(), mode);
        self.entries[usize::from(fd.number())].store(entry, Ordering::Release);
    }

    #[inline]
    pub(super) fn write(
        &self,
        fd: Fd,
        from: &[u8],
    ) -> std::result::Result<usize, IoError<<Memory as Bus>::Error>> {
        let entry = self.check(fd, OpenMode::WRITE)?;
        if from.is_empty() {
            return Ok(0);
        }
        let board = self.boards.get((entry >> 20) as usize);
        let board = board.ok_or(FdError::Closed { fd })?;
        Ok(board.write(from)?)
    }

    #[inline]
    fn check(&self, fd: Fd, mode: OpenMode) -> std::result::Result<u32, FdError> {
        if let Some(place) = self.entries.get(usize::from(fd.number())) {
            let entry = place.load(Ordering::Acquire);
            if entry & wanted(0xffff, mode) == wanted(fd.generation(), mode) {
                return Ok(entry);
            }
        }
        Err(FdError::Closed { fd })
    }
}

impl<D: Driver + Send> DeviceMmio for Board<D> {
    fn mmio_read(&self, _: MmioAddress, _: MmioAddressOffset, data: &mut [u8]) {
        let _ = self.driver.read(self.registers, data);
    }

    fn mmio_write(&self, _: MmioAddress, _: MmioAddressOffset, data: &[u8]) {
        let _ = self.driver.write(self.registers, data);
    }
}

/// Makes the manager of rust-vmm with all boards of the benchmark.
pub(super) fn io_manager(bus: &'static Memory, port: usize) -> Result<IoManager> {
    fn register<D: Driver + Send>(
        manager: &mut IoManager,
        bus: &'static Memory,
        first: usize,
    ) -> Result<()> {
        for base in [first, first + 0x100] {
            let range = MmioRange::new(MmioAddress(base as u64), 0x100)
                .map_err(|error| format!("vm-device: {error:?}"))?;
            manager
                .register_mmio(range, Arc::new(Board::<D>::new(bus, base)))
                .map_err(|error| format!("vm-device: {error:?}"))?;
        }
        Ok(())
    }
    let mut manager = IoManager::new();
    register::<Adc16>(&mut manager, bus, 0)?;
    register::<Lamps>(&mut manager, bus, 0x200)?;
    register::<Counter>(&mut manager, bus, 0x400)?;
    register::<Port>(&mut manager, bus, port - 0x100)?;
    Ok(manager)
}
