//! The entry of interrupts: order, strangers, and lines that do not end.
#![cfg(feature = "sim")]

use std::sync::{Arc, Mutex};

use condor_dev::sim::{Controller, Model, SimBus};
use condor_dev::{
    Attention, Bus as _, DeviceError, Driver, InterruptController, InterruptCounts, InterruptLevel,
    InterruptVector, Location, Registers, Switch, Width, device_switch,
};

/// A board with one register: reading says whether it asks, writing serves it.
struct Bell;

impl Driver for Bell {
    const NEW: Self = Self;
    const READS: bool = true;
    const WRITES: bool = false;

    fn probe<B: condor_dev::Bus>(registers: Registers<'_, B>) -> bool {
        registers.answers(0, Width::Bits8)
    }

    fn init<B: condor_dev::Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write8(1, 0)
    }

    fn read<B: condor_dev::Bus>(
        &self,
        _: Registers<'_, B>,
        _: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        Err(DeviceError::WouldBlock)
    }

    fn write<B: condor_dev::Bus>(
        &self,
        _: Registers<'_, B>,
        _: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        Err(DeviceError::WouldBlock)
    }

    fn read_ready<B: condor_dev::Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(false)
    }

    fn write_ready<B: condor_dev::Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(false)
    }

    fn interrupt<B: condor_dev::Bus>(
        &self,
        registers: Registers<'_, B>,
    ) -> Result<Attention, B::Error> {
        if registers.read8(0)? == 0 {
            return Ok(Attention::NotMine);
        }
        registers.write8(0, 0)?;
        Ok(Attention::Mine)
    }
}

const COUNT: usize = 6;

/// What all boards have in common.
#[derive(Default)]
struct Bench {
    /// How often each still asks.
    asks: [u32; COUNT],
    /// Asks and does not say so.
    hidden: [bool; COUNT],
    /// Who begins to ask when a board has been served.
    followed_by: [Option<usize>; COUNT],
    served: Vec<usize>,
    /// Boards that ask until they are initialised.
    wild: [bool; COUNT],
}

struct Board {
    bench: Arc<Mutex<Bench>>,
    number: usize,
}

impl Model for Board {
    fn size(&self) -> usize {
        2
    }

    fn read(&mut self, _: usize, _: Width) -> Option<u32> {
        let bench = self.bench.lock().unwrap();
        Some(u32::from(
            bench.asks[self.number] > 0 && !bench.hidden[self.number],
        ))
    }

    fn write(&mut self, offset: usize, _: Width, _: u32) -> Option<()> {
        let mut bench = self.bench.lock().unwrap();
        if offset == 1 {
            bench.wild[self.number] = false;
            return Some(());
        }
        if let Some(next) = bench.followed_by[self.number].take() {
            bench.asks[next] += 1;
        }
        let asks = &mut bench.asks[self.number];
        // The largest number is endless.
        if *asks != u32::MAX {
            *asks -= 1;
        }
        bench.served.push(self.number);
        Some(())
    }

    fn interrupts(&self) -> bool {
        let bench = self.bench.lock().unwrap();
        bench.asks[self.number] > 0 || bench.wild[self.number]
    }
}

const SHARED: InterruptVector = InterruptVector(10);
const ONE: InterruptVector = InterruptVector(20);
const OTHER: InterruptVector = InterruptVector(30);
const INNOCENT: InterruptVector = InterruptVector(40);
const STRANGER: u16 = 50;

device_switch! {
    struct Bells {
        bell: Bell = [
            Location::at(0x000).interrupting(SHARED.0, 1),
            Location::at(0x100).interrupting(SHARED.0, 1),
            Location::at(0x200).interrupting(SHARED.0, 1),
            Location::at(0x300).interrupting(ONE.0, 2),
            Location::at(0x400).interrupting(OTHER.0, 2),
            Location::at(0x500).interrupting(INNOCENT.0, 1),
        ],
    }
}

struct Machine<C> {
    bench: Arc<Mutex<Bench>>,
    controller: C,
    switch: Switch<SimBus, C, Bells, 1>,
}

const VECTORS: [InterruptVector; COUNT] = [SHARED, SHARED, SHARED, ONE, OTHER, INNOCENT];

/// A machine whose controller is made around the simulated one.
fn machine<C: InterruptController + Clone>(
    bench: Bench,
    around: impl FnOnce(Controller, &Arc<Mutex<Bench>>) -> C,
) -> Machine<C> {
    let (bus, inside) = (SimBus::new(), Controller::new());
    let bench = Arc::new(Mutex::new(bench));
    for (number, vector) in VECTORS.into_iter().enumerate() {
        let bench = bench.clone();
        let board = bus.insert(number * 0x100, Board { bench, number });
        inside.connect(vector, board);
    }
    let controller = around(inside, &bench);
    let switch = Switch::new(bus, controller.clone(), Bells::new());
    switch.start();
    Machine {
        bench,
        controller,
        switch,
    }
}

fn level_triggered() -> Machine<Controller> {
    machine(Bench::default(), |inside, _| inside)
}

impl<C: InterruptController> Machine<C> {
    fn interrupt(&self) -> Vec<usize> {
        self.switch.on_interrupt();
        std::mem::take(&mut self.bench.lock().unwrap().served)
    }

    fn ask(&self, boards: impl IntoIterator<Item = (usize, u32)>) {
        for (board, times) in boards {
            self.bench.lock().unwrap().asks[board] = times;
        }
    }

    fn counts(&self) -> InterruptCounts {
        self.switch.interrupt_counts()
    }
}

#[test]
fn boards_of_one_vector_take_turns_in_being_first() {
    let machine = level_triggered();
    let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 1, 2]];
    for order in orders {
        machine.ask([(0, 1), (1, 1), (2, 1)]);
        assert_eq!(machine.interrupt(), order);
    }
    let expected = InterruptCounts {
        served: 4,
        ..InterruptCounts::default()
    };
    assert_eq!(machine.counts(), expected);
}

#[test]
fn one_that_asks_often_does_not_keep_others_waiting() {
    let machine = level_triggered();
    machine.ask([(0, 1000), (2, 1)]);
    let served = machine.interrupt();
    assert_eq!(served[..2], [0, 2]);
    assert_eq!(served.len(), 1001);
}

/// Pends a vector when its line goes up, and then not again before it has been down.
#[derive(Clone)]
struct EdgeTriggered {
    boards: Arc<Mutex<Bench>>,
    was_up: Arc<Mutex<bool>>,
}

impl InterruptController for EdgeTriggered {
    fn enable(&self, _: InterruptVector, _: InterruptLevel) {}

    fn disable(&self, _: InterruptVector) {}

    fn claim(&self) -> Option<InterruptVector> {
        let up = self.boards.lock().unwrap().asks[..3].iter().any(|&n| n > 0);
        let was_up = std::mem::replace(&mut *self.was_up.lock().unwrap(), up);
        (up && !was_up).then_some(SHARED)
    }

    fn complete(&self, _: InterruptVector) {}
}

#[test]
fn a_shared_line_that_is_edge_triggered_is_left_quiet() {
    for first in 0..3 {
        for next in (0..3).filter(|&next| next != first) {
            let machine = machine(Bench::default(), |_, boards| EdgeTriggered {
                boards: boards.clone(),
                was_up: Arc::default(),
            });
            // Before one board lets go of the line, another one holds it.
            machine.bench.lock().unwrap().followed_by[first] = Some(next);
            machine.ask([(first, 1)]);
            assert_eq!(machine.interrupt(), [first, next]);
            machine.ask([(first, 1)]);
            assert_eq!(machine.interrupt(), [first], "the line went up again");
        }
    }
}

#[test]
fn nothing_interrupts_before_all_boards_are_initialised() {
    #[derive(Clone)]
    struct Watched(Controller);

    impl InterruptController for Watched {
        fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
            self.0.enable(vector, level);
            assert!(!self.0.is_pending(), "{vector:?}");
        }

        fn disable(&self, vector: InterruptVector) {
            self.0.disable(vector);
        }

        fn claim(&self) -> Option<InterruptVector> {
            self.0.claim()
        }

        fn complete(&self, vector: InterruptVector) {
            self.0.complete(vector);
        }
    }

    let bench = Bench {
        wild: [true; COUNT],
        ..Bench::default()
    };
    let machine = machine(bench, |inside, _| Watched(inside));
    machine.ask([(5, 1)]);
    assert_eq!(machine.interrupt(), [5]);
}

#[test]
fn vectors_without_a_board_are_named_and_disabled() {
    let machine = level_triggered();
    for stranger in STRANGER..STRANGER + 10 {
        machine
            .controller
            .enable(InterruptVector(stranger), InterruptLevel(1));
    }
    for stranger in STRANGER..STRANGER + 9 {
        machine.controller.set(InterruptVector(stranger), true);
        machine.switch.on_interrupt();
    }
    let named: Vec<_> = machine.switch.unhandled().collect();
    let expected: Vec<_> = (STRANGER..STRANGER + 8)
        .map(|stranger| (InterruptVector(stranger), 16))
        .collect();
    assert_eq!(named, expected);
    let enabled = |stranger| machine.controller.is_enabled(InterruptVector(stranger));
    assert!(!(STRANGER..STRANGER + 9).any(enabled));
    assert!(enabled(STRANGER + 9));
    let expected = InterruptCounts {
        unhandled: 8 * 16 + 1,
        stuck: 9,
        ..InterruptCounts::default()
    };
    assert_eq!(machine.counts(), expected);
}

#[test]
fn two_lines_that_nobody_claims_end_both() {
    let machine = level_triggered();
    machine.bench.lock().unwrap().hidden = [true; COUNT];
    machine.ask([(3, 1), (4, 1)]);
    assert!(machine.interrupt().is_empty());
    let stuck: Vec<_> = machine.switch.stuck().collect();
    assert_eq!(stuck, [(ONE, 1), (OTHER, 1)]);
    let expected = InterruptCounts {
        unclaimed: 32,
        stuck: 2,
        ..InterruptCounts::default()
    };
    assert_eq!(machine.counts(), expected);
}

/// Claims in turn what is pending, as a controller with equal levels may.
#[derive(Clone)]
struct InTurn {
    inside: Controller,
    last: Arc<Mutex<InterruptVector>>,
}

impl InterruptController for InTurn {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        self.inside.enable(vector, level);
    }

    fn disable(&self, vector: InterruptVector) {
        self.inside.disable(vector);
    }

    fn claim(&self) -> Option<InterruptVector> {
        let mut claimed = Vec::new();
        while let Some(vector) = self.inside.claim() {
            claimed.push(vector);
        }
        claimed.sort();
        let mut last = self.last.lock().unwrap();
        let next = claimed.iter().copied().find(|vector| *vector > *last);
        let chosen = next.or(claimed.first().copied());
        for vector in claimed {
            if Some(vector) != chosen {
                self.inside.complete(vector);
            }
        }
        *last = chosen?;
        chosen
    }

    fn complete(&self, vector: InterruptVector) {
        self.inside.complete(vector);
    }
}

fn in_turn() -> Machine<InTurn> {
    machine(Bench::default(), |inside, _| InTurn {
        inside,
        last: Arc::new(Mutex::new(InterruptVector(0))),
    })
}

#[test]
fn alternating_lines_that_nobody_claims_end_both() {
    let machine = in_turn();
    machine.bench.lock().unwrap().hidden = [true; COUNT];
    machine.ask([(3, 1), (4, 1)]);
    assert!(machine.interrupt().is_empty());
    assert_eq!(machine.switch.stuck().count(), 2);
}

#[test]
fn lines_that_never_end_do_not_take_others_with_them() {
    let machine = in_turn();
    machine.ask([(3, u32::MAX), (4, u32::MAX), (0, u32::MAX), (5, 2000)]);
    let served = machine.interrupt();
    let innocent = served.iter().filter(|&&number| number == 5).count();
    assert_eq!(innocent, 2000);
    let enabled = |vector| machine.controller.inside.is_enabled(vector);
    assert!(!enabled(ONE) && !enabled(OTHER) && !enabled(SHARED) && enabled(INNOCENT));
    assert_eq!(
        machine.switch.stuck().map(|(_, times)| times).sum::<u32>(),
        3
    );

    // When the reason is gone, starting again lets them in.
    machine.ask([(3, 0), (4, 0), (0, 0)]);
    machine.switch.start();
    machine.ask([(3, 1), (1, 1)]);
    let mut served = machine.interrupt();
    served.sort_unstable();
    assert_eq!(served, [1, 3]);
    assert_eq!(machine.counts().stuck, 3);
}

/// Claims what a test has put in, once each.
#[derive(Clone, Default)]
struct Queue(Arc<Mutex<Vec<InterruptVector>>>);

impl InterruptController for Queue {
    fn enable(&self, _: InterruptVector, _: InterruptLevel) {}

    fn disable(&self, _: InterruptVector) {}

    fn claim(&self) -> Option<InterruptVector> {
        self.0.lock().unwrap().pop()
    }

    fn complete(&self, _: InterruptVector) {}
}

#[test]
fn nobodys_interrupts_in_between_are_no_reason_to_disable() {
    let machine = machine(Bench::default(), |_, _| Queue::default());
    for _ in 0..100 {
        *machine.controller.0.lock().unwrap() = vec![ONE; 15];
        assert!(machine.interrupt().is_empty());
        *machine.controller.0.lock().unwrap() = vec![ONE];
        machine.ask([(3, 1)]);
        assert_eq!(machine.interrupt(), [3]);
    }
    assert_eq!(machine.switch.stuck().count(), 0);
    *machine.controller.0.lock().unwrap() = vec![ONE; 16];
    assert!(machine.interrupt().is_empty());
    assert_eq!(machine.switch.stuck().count(), 1);
}
