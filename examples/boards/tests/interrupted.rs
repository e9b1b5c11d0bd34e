//! Every access that a driver makes to the bus is interrupted in turn: by its board, or by a faster
//! loop that uses the same board.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::{Arc, Mutex};

use condor_dev::sim::{self, Model};
use condor_dev::{AccessError, Bus, Driver, Registers, Width};
use example_boards::sim::{EncoderModel, MppModel};
use example_boards::{Encoder8, Mpp};

type Routine = Rc<dyn Fn()>;

thread_local! {
    /// Accesses until the interrupt, and what it does.
    static PENDING: RefCell<Option<(Cell<u32>, Routine)>> = const { RefCell::new(None) };
}

/// A bus before each of whose accesses the interrupt may come.
struct Interrupted(sim::Bus);

impl Interrupted {
    fn access() {
        let due = PENDING.with_borrow_mut(|pending| {
            let (left, _) = pending.as_ref()?;
            left.set(left.get() - 1);
            if left.get() > 0 {
                return None;
            }
            pending.take()
        });
        if let Some((_, routine)) = due {
            routine();
        }
    }
}

impl Bus for Interrupted {
    type Error = AccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, AccessError> {
        Self::access();
        self.0.read(address, width)
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), AccessError> {
        Self::access();
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
        let bus = Interrupted(sim::Bus::new());
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

/// Runs `operation` with `routine` before each access that it makes, one after the other.
fn everywhere<W: 'static>(
    world: impl Fn() -> W,
    routine: impl Fn(&W) + Clone + 'static,
    operation: impl Fn(&W),
) {
    for access in 1.. {
        let world = Rc::new(world());
        let (seen, routine) = (Rc::clone(&world), routine.clone());
        let routine: Routine = Rc::new(move || routine(&seen));
        PENDING.set(Some((Cell::new(access), routine)));
        operation(&world);
        if PENDING.take().is_some() {
            assert!(access > 4, "an operation makes some accesses");
            return;
        }
    }
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
