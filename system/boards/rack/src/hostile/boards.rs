//! A switch over one simulated board of each driver, and two boards of those that share a vector.

use std::sync::{Arc, Mutex, MutexGuard};

use crate::sim::{AdcModel, DacModel, EncoderModel, MppModel};
use crate::{Adc16, Dac16, Encoder8, Mpp};
use condor_dev::BusAccessError;
use condor_dev::drivers::Uart16550;
use condor_dev::sim::{Controller, SimBus, UartModel};
use condor_dev::{
    DeviceError, Driver, Fd, InterruptVector, IoError, Location, OpenMode, Switch, device_switch,
};

device_switch! {
    /// The boards that the fuzz test uses: one of each driver at least. The parallel ports share
    /// one vector, and the serial ports another.
    pub struct Boards {
        adc: Adc16 = [Location::at(ADC).interrupting(67, 4)],
        dac: Dac16 = [Location::at(DAC)],
        encoder: Encoder8 = [Location::at(ENCODER)],
        mpp: Mpp = [
            Location::at(MPP[0]).interrupting(65, 3),
            Location::at(MPP[1]).interrupting(65, 3),
        ],
        uart: Uart16550<1, 32> = [Location::at(UART[0]).interrupting(66, 2)],
        uart4: Uart16550<4, 32> = [Location::at(UART[1]).interrupting(66, 2)],
    }
}

pub const ADC: usize = 0x1000;
pub const DAC: usize = 0x2000;
pub const ENCODER: usize = 0x3000;
pub const MPP: [usize; 2] = [0x4000, 0x4100];
pub const UART: [usize; 2] = [0x5000, 0x5100];

pub const MPPS: InterruptVector = InterruptVector(65);
pub const UARTS: InterruptVector = InterruptVector(66);
pub const ADCS: InterruptVector = InterruptVector(67);

pub const BOTH: OpenMode = OpenMode::READ.union(OpenMode::WRITE);

pub type Error = IoError<BusAccessError>;
pub type Serial = Uart16550<1, 32>;
pub type Serial4 = Uart16550<4, 32>;

/// A simulated machine with all boards: the test accesses them as a program does, and also their
/// models.
pub struct Machine {
    pub bus: SimBus,
    pub controller: Controller,
    pub switch: Switch<SimBus, Controller, Boards, 8>,
    pub adc: Arc<Mutex<AdcModel>>,
    pub dac: Arc<Mutex<DacModel>>,
    pub encoder: Arc<Mutex<EncoderModel>>,
    pub mpp: [Arc<Mutex<MppModel>>; 2],
    pub uart: Arc<Mutex<UartModel>>,
    pub uart4: Arc<Mutex<UartModel<4>>>,
}

impl Machine {
    /// Makes a machine with the models of all boards at their addresses; [`Switch::start`] has not
    /// run yet.
    pub fn new() -> Self {
        let (bus, controller) = (SimBus::new(), Controller::new());
        let this = Self {
            adc: bus.insert(ADC, AdcModel::default()),
            dac: bus.insert(DAC, DacModel::default()),
            encoder: bus.insert(ENCODER, EncoderModel::default()),
            mpp: MPP.map(|base| bus.insert(base, MppModel::default())),
            uart: bus.insert(UART[0], UartModel::default()),
            uart4: bus.insert(UART[1], UartModel::default()),
            switch: Switch::new(bus.clone(), controller.clone(), Boards::new()),
            bus,
            controller,
        };
        for mpp in &this.mpp {
            this.controller.connect(MPPS, mpp.clone());
        }
        this.controller.connect(ADCS, this.adc.clone());
        this.controller.connect(UARTS, this.uart.clone());
        this.controller.connect(UARTS, this.uart4.clone());
        this
    }

    pub fn started() -> Self {
        let this = Self::new();
        this.switch.start();
        this
    }

    pub fn open(&self, name: &str, mode: OpenMode) -> Fd {
        self.switch.open(name, 0, mode).unwrap()
    }

    /// Serves the pending interrupts, if there are any.
    pub fn interrupts(&self) {
        if self.controller.is_pending() {
            self.switch.on_interrupt();
        }
    }

    pub fn read(&self, fd: Fd) -> Result<Vec<u8>, Error> {
        let mut bytes = [0; 40];
        let count = self.switch.read(fd, &mut bytes)?;
        Ok(bytes[..count].to_vec())
    }
}

/// Locks the model of a board, so that a test can act on the board from outside.
pub fn outside<M>(model: &Mutex<M>) -> MutexGuard<'_, M> {
    model.lock().unwrap()
}

/// Converts a driver's error to the one that a descriptor returns.
pub fn io<E>(error: DeviceError<E>) -> IoError<E> {
    error.into()
}

/// Returns true if the driver `D` recognizes the board at `base` as its own.
pub fn finds<D: Driver>(bus: &SimBus, base: usize) -> bool {
    D::probe(condor_dev::Registers::new(bus, base))
}
