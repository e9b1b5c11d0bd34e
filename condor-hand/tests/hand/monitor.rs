//! What a monitor promises to its readers, and to the loop that it is in.

use std::cell::RefCell;
use std::collections::{HashSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use condor_hand::config::Hand;
use condor_hand::controller::{FingerController, Tick};
use condor_hand::monitor::{
    FingerVariables, JointVariable, Kind, MONITOR, Monitor, MonitorClient, MonitorClientError,
    MonitorError, MonitorObject, MonitorPlaces, MonitorReader, MonitorReaderError, Quantity, Ring,
    Row, Selection, SelectionError, TendonVariable, Variable, ring_bytes,
};
use condor_hand::servo::{Mode, Sensed};
use condor_hand::tendon::Pair;
use condor_mbox::sim::{SimWindow, System};
use condor_mbox::{
    AccessError, Call, CriticalSection, LoadOrder, MemoryWindow, Messenger, Places, Processor,
    Region, StaticMemory, StaticWindow, StoreOrder,
};
use nalgebra::{Vector3, Vector4};
use proptest::prelude::*;

const ROWS: u32 = 8;
const COLUMNS: u32 = 3;
const VARIABLES: u32 = 40;
const BYTES: u32 = ring_bytes(VARIABLES, COLUMNS, ROWS);

type Memory = StaticMemory<{ BYTES as usize / 4 }>;

fn variables() -> impl Iterator<Item = Variable> + Clone {
    (0..VARIABLES).map(|number| Variable::new(format_args!("v{number}"), "N", Kind::Real))
}

fn selection() -> Selection {
    Selection::new([0, 33, 39], 1).unwrap()
}

/// The values of a tick: a mixture of two ticks is none.
fn values(tick: u32) -> [u32; COLUMNS as usize] {
    [tick, tick.wrapping_mul(7), !tick]
}

fn write<W: MemoryWindow>(ring: &mut Ring<W>, tick: u32) {
    let values = values(tick).into_iter();
    ring.write(tick, &selection(), values).unwrap();
}

fn is_whole(row: &Row) -> bool {
    row.words == values(row.tick) && row.selection == selection()
}

fn ring<W: MemoryWindow>(window: W) -> Ring<W> {
    let ring = Ring::new(Region::whole(window), 400, variables(), COLUMNS).unwrap();
    assert_eq!(ring.rows(), ROWS);
    ring
}

fn reader<W: MemoryWindow>(window: W) -> MonitorReader<W> {
    MonitorReader::open(Region::whole(window)).unwrap()
}

#[test]
fn the_window_says_what_there_is() {
    let memory = Memory::new();
    assert!(matches!(
        MonitorReader::open(Region::whole(memory.window())),
        Err(MonitorReaderError::NoMonitor { magic: 0, .. })
    ));
    let _ring = ring(memory.window());
    let reader = reader(memory.window());
    assert_eq!((reader.servo_hz(), reader.rows()), (400, ROWS));
    assert_eq!(reader.variable_count(), VARIABLES as usize);
    for (number, variable) in variables().enumerate() {
        assert_eq!(reader.variable(number), Ok(Some(variable)));
    }
    assert_eq!(reader.variable(VARIABLES as usize), Ok(None));
    assert_eq!(reader.find("v27"), Ok(Some(27)));
    assert_eq!(reader.find("v40"), Ok(None));
}

#[test]
fn a_region_that_is_too_small_is_refused() {
    let memory = Memory::new();
    let region = Region::whole(memory.window());
    let one_row = ring_bytes(VARIABLES, COLUMNS, 1);
    let small = region.part(0, one_row).unwrap();
    let expected = MonitorError::Size {
        variables: VARIABLES,
        columns: COLUMNS,
        size: one_row,
    };
    let refused = Ring::new(small, 400, variables(), COLUMNS).unwrap_err();
    assert_eq!(refused, expected);
    assert!(Ring::new(region, 400, variables(), 0).is_err());
    assert!(Ring::new(region, 400, variables().take(0), 1).is_err());
}

#[test]
fn a_reader_that_falls_behind_knows_how_many_rows_it_lost() {
    let memory = Memory::new();
    let mut ring = ring(memory.window());
    let mut reader = reader(memory.window());
    assert_eq!(reader.read(), Ok(None));
    let (mut tick, mut lost) = (0, 0);
    for burst in [1, 2, ROWS, ROWS + 1, 3, 5 * ROWS + 3, 0, 1] {
        let first = tick;
        for _ in 0..burst {
            write(&mut ring, tick);
            tick += 1;
        }
        let missing = burst.saturating_sub(ROWS);
        lost += u64::from(missing);
        let mut next = first + missing;
        let mut told = missing;
        for row in &mut reader {
            let row = row.unwrap();
            assert!(is_whole(&row));
            assert_eq!((row.tick, row.lost), (next, told));
            (next, told) = (next + 1, 0);
        }
        assert_eq!((next, reader.lost()), (tick, lost));
    }
}

#[test]
fn a_writer_that_starts_anew_is_noticed_and_goes_on_counting() {
    let memory = Memory::new();
    let mut first = ring(memory.window());
    let mut old = reader(memory.window());
    (0..3).for_each(|tick| write(&mut first, tick));
    assert!(is_whole(&old.read().unwrap().unwrap()));
    let mut second = ring(memory.window());
    let restarted = MonitorReaderError::Restarted {
        found: 2,
        expected: 1,
    };
    assert_eq!(old.read(), Err(restarted));
    assert_eq!(old.variable(0), Err(restarted));
    let mut new = reader(memory.window());
    assert_eq!(new.read(), Ok(None));
    write(&mut second, 77);
    assert_eq!(new.read().unwrap().unwrap().tick, 77);
    assert_eq!(new.lost(), 0);
}

#[test]
fn sequences_wrap() {
    let memory = Memory::new();
    let region = Region::whole(memory.window());
    // Where the next ring goes on from.
    region.set_word(64, u32::MAX - 5).unwrap();
    let mut ring = ring(memory.window());
    let mut reader = reader(memory.window());
    for tick in 0..20 {
        write(&mut ring, tick);
        if tick % 3 == 2 {
            let ticks: Vec<_> = (&mut reader).map(|row| row.unwrap().tick).collect();
            assert_eq!(ticks, [tick - 2, tick - 1, tick]);
        }
    }
    assert_eq!(reader.lost(), 0);
}

/// A view of the memory that lets something else happen before some accesses.
struct Interrupted<'m, F> {
    window: StaticWindow<'m>,
    plan: RefCell<VecDeque<u8>>,
    happens: F,
}

impl<F: Fn(u8)> Interrupted<'_, F> {
    fn happen(&self) {
        let next = self.plan.borrow_mut().pop_front();
        if let Some(count @ 1..) = next {
            (self.happens)(count);
        }
    }
}

impl<F: Fn(u8)> MemoryWindow for Interrupted<'_, F> {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.window.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.happen();
        self.window.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.happen();
        self.window.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.window.check(offset, len)
    }
}

fn plan() -> impl Strategy<Value = Vec<u8>> {
    let step = prop_oneof![20 => Just(0), 2 => 1_u8..4, 1 => 6_u8..12];
    prop::collection::vec(step, 0..600)
}

/// What a reader has seen: whole rows, in order; with the lost ones they are all.
fn check_all(rows: &[Row], lost: u64, written: u32) -> Result<(), TestCaseError> {
    let mut next = 0;
    for row in rows {
        prop_assert!(is_whole(row), "{row:?}");
        prop_assert_eq!(row.tick, next + row.lost);
        next = row.tick + 1;
    }
    prop_assert_eq!(rows.len() as u64 + lost, u64::from(written));
    Ok(())
}

proptest! {
    /// The writer writes rows between any two loads of the reader.
    #[test]
    fn a_reader_that_is_interrupted_by_the_writer(plan in plan()) {
        let memory = Memory::new();
        let writer = RefCell::new((ring(memory.window()), 0));
        let window = Interrupted {
            window: memory.window(),
            plan: RefCell::default(),
            happens: |count| {
                let (ring, tick) = &mut *writer.borrow_mut();
                for _ in 0..count {
                    write(ring, *tick);
                    *tick += 1;
                }
            },
        };
        let mut reader = reader(&window);
        window.plan.replace(plan.into());
        let mut rows = Vec::new();
        loop {
            let was_undisturbed = window.plan.borrow().is_empty();
            let row = reader.read().unwrap();
            let is_over = row.is_none() && was_undisturbed;
            rows.extend(row);
            if is_over {
                break;
            }
        }
        let written = writer.borrow().1;
        check_all(&rows, reader.lost(), written)?;
    }

    /// The reader reads between any two stores of the writer.
    #[test]
    fn a_writer_that_is_interrupted_by_a_reader(plan in plan()) {
        let memory = Memory::new();
        let _ = ring(memory.window());
        let seen = RefCell::new((None, Vec::new()));
        let window = Interrupted {
            window: memory.window(),
            plan: RefCell::default(),
            happens: |count| {
                let (reader, rows) = &mut *seen.borrow_mut();
                let reader: &mut MonitorReader<StaticWindow<'_>> = Option::as_mut(reader).unwrap();
                rows.extend((0..count).filter_map(|_| reader.read().unwrap()));
            },
        };
        let mut ring = ring(&window);
        seen.borrow_mut().0 = Some(reader(memory.window()));
        window.plan.replace(plan.into());
        let mut written = 0;
        while !window.plan.borrow().is_empty() {
            write(&mut ring, written);
            written += 1;
        }
        let (reader, mut rows) = seen.take();
        let mut reader = reader.unwrap();
        while let Some(row) = reader.read().unwrap() {
            rows.push(row);
        }
        check_all(&rows, reader.lost(), written)?;
    }

    /// Whatever is in the window, a reader ends, and a writer mends it.
    #[test]
    fn garbage_is_survived_and_mended(
        header in prop::collection::vec(prop_oneof![0_u32..64, any::<u32>()], 28),
        rows in prop::collection::vec(prop_oneof![0_u32..20, any::<u32>()], 200),
        is_marked in any::<bool>(),
    ) {
        let memory = Memory::new();
        let region = Region::whole(memory.window());
        for (offset, word) in (0..BYTES).step_by(4).zip(header.iter().chain(rows.iter().cycle())) {
            region.set_word(offset, *word).unwrap();
        }
        if is_marked {
            region.set_word(0, u32::from_le_bytes(*b"CMON")).unwrap();
            region.set_word(4, 1).unwrap();
            region.set_word(12, VARIABLES).unwrap();
            region.set_word(16, COLUMNS).unwrap();
            region.set_word(20, ROWS).unwrap();
        }
        if let Ok(mut reader) = MonitorReader::open(Region::whole(memory.window())) {
            for newest in &rows {
                region.set_word(64, *newest).unwrap();
                let _ = (reader.read(), reader.variable(*newest as usize));
            }
        }
        let mut ring = ring(memory.window());
        let mut reader = reader(memory.window());
        write(&mut ring, 5);
        let row = reader.read().unwrap().unwrap();
        prop_assert!(is_whole(&row));
        prop_assert_eq!((row.tick, reader.read()), (5, Ok(None)));
    }
}

#[test]
fn threads_read_while_the_loop_writes() {
    const LAST: u32 = 50_000;
    let memory: &'static Memory = Box::leak(Box::new(Memory::new()));
    let mut ring = ring(memory.window());
    let readers = [(); 2].map(|()| reader(memory.window()));
    std::thread::scope(|threads| {
        for mut reader in readers {
            threads.spawn(move || {
                let (mut next, mut count) = (0, 0);
                while next <= LAST {
                    if let Some(row) = reader.read().unwrap() {
                        assert!(is_whole(&row), "{row:?}");
                        assert_eq!(row.tick, next + row.lost);
                        next = row.tick + 1;
                        count += 1;
                    }
                }
                assert_eq!(count + reader.lost(), u64::from(LAST) + 1);
            });
        }
        for tick in 0..=LAST {
            write(&mut ring, tick);
        }
    });
}

const MASTER: Processor = Processor(0);
const SLAVE: Processor = Processor(1);
const SECOND: Duration = Duration::from_secs(1);

type Four = FingerVariables<1, 4>;

/// What a finger did in each tick.
type History = Arc<Mutex<Vec<Tick<4>>>>;

/// A finger whose loop runs once whenever the master waits.
struct Watched {
    system: System<2>,
    places: MonitorPlaces,
    history: History,
    ticking: Arc<AtomicBool>,
}

fn watched() -> Watched {
    let system = System::<2>::in_virtual_time(65536);
    let hand = Hand::<4, 4>::from_toml(include_str!("../../hands/utah-mit.toml"), "hand").unwrap();
    let finger = &hand.fingers[0];
    let variables = Four::new([finger]);
    let mut controller = FingerController::new(&hand, finger, finger.planar().unwrap()).unwrap();
    controller.set_mode(1, Mode::Position).unwrap();
    let [_, windows] = system.windows(SLAVE);
    let ram = Region::users(windows.data).unwrap();
    let bytes = ring_bytes(Four::COUNT as u32, 6, 64);
    let places = MonitorPlaces::new(&mut Places::new(ram.size()), 2, bytes).unwrap();
    let object = Box::leak(Box::new(MonitorObject::new()));
    let (handler, mut monitor): (_, Monitor<'static, SimWindow>) = object
        .split(&ram, places, CriticalSection, 400, variables.variables(), 6)
        .unwrap();
    let mut slave = system.mailbox(SLAVE).unwrap();
    let handler = Box::leak(Box::new(move |call: &Call<'_>| handler.answer(call)));
    slave.set_vector(MONITOR, handler, "monitor").unwrap();
    slave.join().unwrap();

    let (history, ticking) = (Arc::default(), Arc::new(AtomicBool::new(true)));
    let of_loop: History = Arc::clone(&history);
    let runs = Arc::clone(&ticking);
    let servo = Mutex::new(move || {
        let count = of_loop.lock().unwrap().len();
        let sensed = Sensed {
            position: Vector4::new(0.1, 0.6, 0.8, 0.7 + 1e-4 * f64::from(count as u32)),
            tension: [Pair::both(4.0); 4],
        };
        let tick = controller.tick(&sensed, &Vector3::new(0.0, 0.0, -9.81), 0.0025);
        monitor
            .tick(|number| Four::word(number, &[sensed], &[tick]))
            .unwrap();
        of_loop.lock().unwrap().push(tick);
    });
    system.while_waiting(SLAVE, move || {
        slave.serve(Duration::ZERO).unwrap();
        if runs.load(Ordering::Relaxed) {
            (servo.lock().unwrap())();
        }
    });
    Watched {
        system,
        places,
        history,
        ticking,
    }
}

fn number(quantity: Quantity) -> usize {
    Four::number(0, quantity).unwrap()
}

#[test]
fn a_selection_is_sampled_from_the_next_tick_on() {
    let watched = watched();
    let mut master = watched.system.mailbox(MASTER).unwrap();
    master.join().unwrap();
    let ram = Region::users(watched.system.windows(MASTER)[1].data.clone()).unwrap();
    let mut client = MonitorClient::new(&master, SLAVE, &ram, watched.places).unwrap();
    let mut reader = MonitorReader::open(watched.places.ring(&ram).unwrap()).unwrap();
    assert_eq!(reader.selection_number(), Ok(0));
    let pass = |ticks: usize| {
        let until = watched.history.lock().unwrap().len() + ticks;
        while watched.history.lock().unwrap().len() < until {
            // The loop runs while this processor waits.
            master.serve(Duration::from_millis(1)).unwrap();
        }
    };
    pass(10);
    assert_eq!(reader.read(), Ok(None));

    let quantities = [
        Quantity::Joint(3, JointVariable::Position),
        Quantity::Joint(3, JointVariable::Velocity),
        Quantity::Joint(1, JointVariable::Error),
        Quantity::Extensor(2, TendonVariable::Desired),
        Quantity::Fault,
    ];
    let selection = Selection::new(quantities.map(number), 3).unwrap();
    assert_eq!(client.select(&selection, SECOND), Ok(1));
    pass(30);
    assert_eq!(reader.selection_number(), Ok(1));
    assert_eq!(reader.selection(), Ok(Some(selection)));
    let rows: Vec<_> = (&mut reader).map(Result::unwrap).collect();
    assert!(rows.len() >= 10);
    assert!(rows.is_sorted_by(|a, b| a.tick + 3 == b.tick));
    let history = watched.history.lock().unwrap().clone();
    for row in &rows {
        let tick = &history[row.tick as usize];
        let error = tick.target[1].unwrap() - tick.output.position[1];
        let expected = [
            tick.output.position[3],
            tick.output.velocity[3],
            error,
            tick.output.tension[2].extensor,
        ];
        for (quantity, value) in quantities.into_iter().zip(expected) {
            let word = row.word(number(quantity));
            assert_eq!(word, Some((value as f32).to_bits()), "{quantity:?}");
        }
        assert_eq!(row.word(number(Quantity::Fault)), Some(0));
        assert_eq!(row.word(number(Quantity::Saturated)), None);
    }

    // Another selection while it runs; rows of both tell by themselves what they are.
    let target = number(Quantity::Joint(0, JointVariable::Target));
    let other = Selection::new([target], 1).unwrap();
    assert_eq!(client.select(&other, SECOND), Ok(2));
    pass(20);
    let rows: Vec<_> = (&mut reader).map(Result::unwrap).collect();
    let change = rows.iter().position(|row| row.selection == other).unwrap();
    assert!(rows[change..].is_sorted_by(|a, b| a.tick + 1 == b.tick));
    assert!(
        rows[change..]
            .iter()
            .all(|row| row.real(target).unwrap().is_nan())
    );
    assert_eq!(reader.lost(), 0);

    // Nothing at all.
    client.select(&Selection::NOTHING, SECOND).unwrap();
    pass(2);
    (&mut reader).for_each(drop);
    pass(20);
    assert_eq!(reader.read(), Ok(None));

    // What the monitor cannot follow changes nothing.
    let error = MonitorClientError::Selection(SelectionError::Columns {
        chosen: 7,
        columns: 6,
    });
    let many = Selection::new(0..7, 1).unwrap();
    assert_eq!(client.select(&many, SECOND), Err(error));
    let error = MonitorClientError::Selection(SelectionError::NoVariable {
        variable: 200,
        variables: Four::COUNT as u32,
    });
    let unknown = Selection::new([3, 200], 1).unwrap();
    assert_eq!(client.select(&unknown, SECOND), Err(error));
    assert!(Selection::new([3], 0).is_err());
    pass(5);
    assert_eq!(reader.selection_number(), Ok(3));

    // The loop that stands still has not taken it over.
    watched.ticking.store(false, Ordering::Relaxed);
    assert_eq!(client.select(&other, SECOND), Ok(4));
    assert_eq!(reader.selection_number(), Ok(3));
}

#[test]
fn words_that_no_client_sends_are_answered_and_change_nothing_wrong() {
    let watched = watched();
    let mut master = watched.system.mailbox(MASTER).unwrap();
    master.join().unwrap();
    let ram = Region::users(watched.system.windows(MASTER)[1].data.clone()).unwrap();
    let block = watched.places.block(MASTER).unwrap();
    let words = prop::collection::vec(prop_oneof![0_u32..4, any::<u32>()], 16);
    proptest!(|(words in words, offset in any::<u32>(), own in any::<bool>())| {
        for (word, at) in words.iter().zip((block..).step_by(4)) {
            ram.set_word(at, *word).unwrap();
        }
        let offset = if own { block } else { offset };
        let reply = master.send_with_reply(SLAVE, MONITOR, offset, SECOND).unwrap();
        prop_assert_eq!(reply, u32::from(own || offset == block));
        let status = ram.word(block + 64).unwrap();
        prop_assert!(!own || matches!(status, 0 | 16..=19));
    });
    assert_eq!(
        master.send_with_reply(SLAVE, MONITOR, block + 64, SECOND),
        Ok(0)
    );
}

#[test]
fn the_variables_of_a_hand_have_names_of_their_own() {
    let hand = Hand::<4, 4>::from_toml(include_str!("../../hands/utah-mit.toml"), "hand").unwrap();
    let [a, b, c, d] = &*hand.fingers else {
        panic!("four fingers");
    };
    let variables = FingerVariables::new([a, b, c, d]);
    let names: HashSet<_> = variables
        .variables()
        .map(|variable| variable.name)
        .collect();
    assert_eq!(names.len(), FingerVariables::<4, 4>::COUNT);
    let flexor = FingerVariables::<4, 4>::number(2, Quantity::Flexor(1, TendonVariable::Command));
    let variable = variables.variables().nth(flexor.unwrap()).unwrap();
    let expected = format!("{}.{}.flexor.command", c.name, c.joints[1].name);
    assert_eq!(variable.name.as_str(), expected);
    assert_eq!((variable.unit.as_str(), variable.kind), ("N", Kind::Real));
}
