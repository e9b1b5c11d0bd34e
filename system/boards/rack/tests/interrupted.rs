//! The driver is interrupted before and behind each access that it makes to the bus in turn: by its board, or by a
//! faster loop that uses the same board.

use std::rc::Rc;
use std::sync::{Arc, Mutex};

use condor_dev::sim::{self, Model};
use condor_dev::{Bus, BusAccessError, Driver, Registers, Width};
use interrupt_injector::{Access, Interrupts, explore};
use utah_mit_boards::sim::{EncoderModel, MppModel};
use utah_mit_boards::{Encoder8, Mpp};

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

/// A board that the programs of one processor use.
struct World<D, M> {
    bus: Interrupted,
    board: Arc<Mutex<M>>,
    driver: D,
}

impl<D: Driver, M: Model + Default + 'static> World<D, M> {
    fn new() -> Self {
        let bus = Interrupted(sim::SimBus::new());
        let world = Self {
            board: bus.0.insert(0, M::default()),
            bus,
            driver: D::NEW,
        };
        world.driver.init(world.registers()).unwrap();
        world.driver.open(world.registers()).unwrap();
        world
    }

    fn registers(&self) -> Registers<'_, Interrupted> {
        Registers::new(&self.bus, 0)
    }
}

/// Runs `operation` with `routine` before and behind each access that it makes, one after the other.
fn everywhere<W: 'static>(
    world: impl Fn() -> W,
    routine: impl Fn(&W) + Clone + 'static,
    operation: impl Fn(&W),
) {
    let runs = explore(Interrupts::Nested(1), |plan| {
        let world = Rc::new(world());
        let (seen, routine) = (Rc::clone(&world), routine.clone());
        plan.run(move |_| routine(&seen), || operation(&world));
    });
    println!("{runs} runs");
    assert!(runs > 4, "an operation makes some accesses");
}

#[test]
fn a_scan_of_counters_is_of_one_instant() {
    type Counters = World<Encoder8, EncoderModel>;
    let scan = |world: &Counters| {
        let mut bytes = [0; 32];
        world.driver.read(world.registers(), &mut bytes).unwrap();
        let (counts, _) = bytes.as_chunks::<4>();
        assert!(counts.iter().all(|count| count == &counts[0]), "{counts:?}");
    };
    let turn_and_scan = move |world: &Counters| {
        for number in 0..8 {
            world.board.lock().unwrap().turn(number, 1);
        }
        scan(world);
    };
    everywhere(Counters::new, turn_and_scan, scan);
}

#[test]
fn a_parallel_port_loses_nothing_while_it_is_read_and_interrupts() {
    type Port = World<Mpp, MppModel>;
    let busy = || {
        let world = Port::new();
        for byte in 0..8 {
            assert!(world.board.lock().unwrap().strobe_in(byte));
        }
        world
    };
    let interrupt = |world: &Port| {
        if world.board.lock().unwrap().interrupts() {
            world.driver.interrupt(world.registers()).unwrap();
        }
    };
    everywhere(busy, interrupt, |world| {
        let mut read = Vec::<u8>::new();
        for _ in 0..8 {
            interrupt(world);
            let mut bytes = [0; 3];
            if let Ok(count) = world.driver.read(world.registers(), &mut bytes) {
                read.extend(&bytes[..count]);
            }
        }
        assert_eq!(read, [0, 1, 2, 3, 4, 5, 6, 7]);
    });
}
