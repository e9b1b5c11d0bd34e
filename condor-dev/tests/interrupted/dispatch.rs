//! Every access of the entry, to what it notes or to the boards, is interrupted in turn by vectors of
//! a higher level, which come in by the same entry.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use std::rc::Rc;

use interrupt_injector::{Access, Interrupts, explore};

use crate::bus::{Bus, Registers, Width};
use crate::driver::{Attention, Driver};
use crate::interrupt::{InterruptController, InterruptLevel, InterruptVector};
use crate::switch::Switch;
use crate::unit::Location;

/// A board that is one register: how often it asks. Writing serves it once.
struct Bell;

impl Driver for Bell {
    const NEW: Self = Self;

    fn probe<B: Bus>(_: Registers<'_, B>) -> bool {
        true
    }

    fn interrupt<B: Bus>(&self, registers: Registers<'_, B>) -> Result<Attention, B::Error> {
        if registers.read8(0)? == 0 {
            return Ok(Attention::NotMine);
        }
        registers.write8(0, 0)?;
        Ok(Attention::Mine)
    }
}

#[derive(Default)]
struct Asks([Cell<u8>; 3]);

impl Bus for Asks {
    type Error = Infallible;

    fn read(&self, address: usize, _: Width) -> Result<u32, Infallible> {
        let _access = Access::begin();
        Ok(self.0[address].get().into())
    }

    fn write(&self, address: usize, _: Width, _: u32) -> Result<(), Infallible> {
        let _access = Access::begin();
        self.0[address].set(self.0[address].get() - 1);
        Ok(())
    }
}

/// Gives each vector that was put in once, and not while it is in service.
#[derive(Default)]
struct Queue {
    pending: RefCell<Vec<InterruptVector>>,
    in_service: RefCell<Vec<InterruptVector>>,
}

impl InterruptController for Queue {
    fn enable(&self, _: InterruptVector, _: InterruptLevel) {}

    fn disable(&self, vector: InterruptVector) {
        panic!("{vector:?} is not stuck");
    }

    fn claim(&self) -> Option<InterruptVector> {
        let _access = Access::begin();
        let mut pending = self.pending.borrow_mut();
        let mut in_service = self.in_service.borrow_mut();
        let at = pending
            .iter()
            .position(|vector| !in_service.contains(vector))?;
        let vector = pending.remove(at);
        in_service.push(vector);
        Some(vector)
    }

    fn complete(&self, vector: InterruptVector) {
        let _access = Access::begin();
        self.in_service
            .borrow_mut()
            .retain(|&other| other != vector);
    }
}

const SHARED: InterruptVector = InterruptVector(10);
const URGENT: InterruptVector = InterruptVector(20);
const STRANGERS: [InterruptVector; 2] = [InterruptVector(50), InterruptVector(51)];

crate::device_switch! {
    struct Bells {
        bell: Bell = [
            Location::at(0).interrupting(10, 1),
            Location::at(1).interrupting(10, 1),
            Location::at(2).interrupting(20, 2),
        ],
    }
}

type World = Switch<Asks, Queue, Bells, 1>;

fn ask(world: &World, board: usize) {
    let asks = &world.bus.0[board];
    asks.set(asks.get() + 1);
}

fn pend(world: &World, vectors: [InterruptVector; 2]) {
    world.controller.pending.borrow_mut().extend(vectors);
}

#[test]
fn nothing_is_lost_or_counted_wrongly_when_entries_nest() {
    let runs = explore(Interrupts::Nested(1), |plan| {
        let world = Rc::new(World::new(Asks::default(), Queue::default(), Bells::new()));
        world.start();
        let [first, second] = STRANGERS;
        ask(&world, 0);
        pend(&world, [first, SHARED]);
        let inner = world.clone();
        let interrupt = move |_| {
            ask(&inner, 1);
            ask(&inner, 2);
            pend(&inner, [second, URGENT]);
            pend(&inner, [SHARED, second]);
            inner.on_interrupt();
        };
        plan.run(interrupt, || world.on_interrupt());
        let Some(place) = plan.first() else {
            return;
        };
        assert!(world.bus.0.iter().all(|asks| asks.get() == 0), "{place}");
        let counts = world.interrupt_counts();
        assert_eq!(counts.stuck, 0, "{place}");
        // Before the first claim, the inner entry takes all there is.
        assert_eq!(counts.spurious, u32::from(place == 0), "{place}");
        assert_eq!(counts.served + counts.unclaimed, 3, "{place}");
        let mut named: Vec<_> = world.unhandled().collect();
        named.sort_unstable();
        assert_eq!(named, [(first, 1), (second, 2)], "{place}");
    });
    assert!(runs > 15, "{runs}");
}
