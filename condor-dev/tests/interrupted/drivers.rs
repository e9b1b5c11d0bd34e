//! Every access that a driver makes, to what its halves share or to the bus, is interrupted in
//! turn: by its board, or by a faster loop that uses the same board.

use std::cell::RefCell;
use std::sync::{Arc, Mutex};

use interrupt_injector::Access;

use super::everywhere;
use crate::bus::{Bus, BusAccessError, Registers, Width};
use crate::driver::Driver;
use crate::drivers::Uart16550;
use crate::sim::{self, LineFault, Model, UartModel};

type Serial = Uart16550<1, 8>;

/// A bus before and behind each of whose accesses the interrupt may come.
struct Interrupted(sim::SimBus);

impl Bus for Interrupted {
    type Error = BusAccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        let _access = Access::begin();
        self.0.read(address, width)
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        let _access = Access::begin();
        self.0.write(address, width, value)
    }
}

/// A board that the programs of one processor use, and what they have done.
struct World<D, M> {
    bus: Interrupted,
    board: Arc<Mutex<M>>,
    driver: D,
    accepted: RefCell<Vec<u8>>,
    read: RefCell<Vec<u8>>,
    sent: RefCell<Vec<u8>>,
    received: RefCell<Vec<u8>>,
}

impl<D: Driver, M: Model + Default + 'static> World<D, M> {
    fn new() -> Self {
        let bus = Interrupted(sim::SimBus::new());
        let world = Self {
            board: bus.0.insert(0, M::default()),
            bus,
            driver: D::NEW,
            accepted: RefCell::default(),
            read: RefCell::default(),
            sent: RefCell::default(),
            received: RefCell::default(),
        };
        world.driver.init(world.registers()).unwrap();
        world.driver.open(world.registers()).unwrap();
        world
    }

    fn registers(&self) -> Registers<'_, Interrupted> {
        Registers::new(&self.bus, 0)
    }

    fn write(&self, bytes: &[u8]) {
        // What interrupts this call accepts its bytes before, or after, all of them.
        if let Ok(count) = self.driver.write(self.registers(), bytes) {
            self.accepted.borrow_mut().extend(&bytes[..count]);
        }
    }

    fn read(&self, most: usize) {
        let mut bytes = [0; 8];
        if let Ok(count) = self.driver.read(self.registers(), &mut bytes[..most]) {
            self.read.borrow_mut().extend(&bytes[..count]);
        }
    }

    /// The board interrupts, if it asks to.
    fn interrupt(&self) {
        if self.board.lock().unwrap().interrupts() {
            self.driver.interrupt(self.registers()).unwrap();
        }
    }
}

impl World<Serial, UartModel> {
    fn receive(&self, bytes: impl IntoIterator<Item = u8>) {
        let mut board = self.board.lock().unwrap();
        for byte in bytes {
            if board.receive(byte, LineFault::None) {
                self.received.borrow_mut().push(byte);
            }
        }
    }

    fn transmit(&self) {
        let mut board = self.board.lock().unwrap();
        while let Some(byte) = board.transmit() {
            self.sent.borrow_mut().push(byte);
        }
    }

    /// With some bytes on their way in all buffers.
    fn busy() -> Self {
        let world = Self::new();
        world.receive(1..4);
        world.write(&[101, 102, 103]);
        world.interrupt();
        world.receive(4..6);
        world.write(&[104, 105]);
        world
    }

    /// All that was accepted is sent and all that came is read, with nothing but interrupts.
    fn check(&self) {
        for _ in 0..8 {
            self.interrupt();
            self.transmit();
            self.read(8);
        }
        assert_eq!(sorted(&self.sent), sorted(&self.accepted));
        assert_eq!(sorted(&self.read), sorted(&self.received));
        assert!(!self.board.lock().unwrap().interrupts());
    }

    /// A faster loop that uses the port.
    fn loop_runs(&self) {
        self.read(2);
        self.write(&[110]);
        self.receive([10]);
    }
}

/// Loops that interrupt each other note what they did in another order than they did it.
fn sorted(bytes: &RefCell<Vec<u8>>) -> Vec<u8> {
    let mut bytes = bytes.borrow().clone();
    bytes.sort_unstable();
    bytes
}

/// Both orders of two uses of a busy serial port.
fn serial(one: fn(&World<Serial, UartModel>), other: fn(&World<Serial, UartModel>)) {
    everywhere(World::busy, one, other, World::check);
    everywhere(World::busy, other, one, World::check);
}

#[test]
fn a_serial_port_is_read_while_it_interrupts() {
    serial(World::interrupt, |world| world.read(8));
}

#[test]
fn a_serial_port_is_written_while_it_interrupts() {
    serial(World::interrupt, |world| world.write(&[120, 121, 122]));
}

#[test]
fn a_serial_port_is_written_after_all_was_sent() {
    serial(
        |world| {
            world.transmit();
            world.interrupt();
        },
        |world| {
            world.transmit();
            world.interrupt();
            world.transmit();
            world.interrupt();
            world.write(&[120]);
        },
    );
}

#[test]
fn a_serial_port_is_shared_by_loops() {
    serial(World::loop_runs, |world| world.read(3));
    serial(World::loop_runs, |world| world.write(&[120, 121]));
    serial(World::loop_runs, World::interrupt);
}

#[test]
fn a_full_serial_port_is_emptied_while_it_interrupts() {
    let full = || {
        let world = World::busy();
        for _ in 0..3 {
            world.receive(10..20);
            world.interrupt();
        }
        world
    };
    everywhere(full, World::interrupt, |world| world.read(8), World::check);
}

#[test]
fn a_serial_port_recovers_from_an_error_of_the_bus_at_any_access() {
    for failing in 0.. {
        let world = World::busy();
        world.transmit();
        world.bus.0.fail_after(failing);
        let before = world.bus.0.accesses();
        for _ in 0..2 {
            world.write(&[120]);
            if world.board.lock().unwrap().interrupts() {
                // It may fail; the board goes on interrupting, or has been asked again.
                let _ = world.driver.interrupt(world.registers());
            }
            world.transmit();
            world.read(8);
        }
        if world.bus.0.accesses() - before <= failing {
            assert!(failing > 10);
            return;
        }
        // A call of any kind takes up what failed.
        let _ = world.driver.is_flushed(world.registers());
        world.check();
    }
}

#[test]
fn a_serial_port_is_closed_and_opened_while_it_interrupts() {
    let reopen = |world: &World<Serial, UartModel>| {
        world.driver.close(world.registers()).unwrap();
        world.driver.open(world.registers()).unwrap();
    };
    // What was not read when the port is opened is forgotten; nothing else is.
    let check = |world: &World<Serial, UartModel>| {
        world.interrupt();
        world.read(8);
        world.read.borrow_mut().clear();
        world.received.borrow_mut().clear();
        world.receive([77]);
        world.check();
    };
    everywhere(World::busy, World::interrupt, reopen, check);
}
