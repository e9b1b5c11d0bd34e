//! Interrupts of boards that are memory, on processors in virtual time.
#![cfg(feature = "sim")]

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use condor_dev::sim::{Model, SimBus};
use condor_dev::{
    Attention, Bus, Driver, InterruptController, InterruptCounts, InterruptEntry, InterruptLevel,
    InterruptVector, Location, Registers, Switch, Width, conformance, device_switch,
};
use condor_mbox::{Messenger as _, Processor, Vector};
use condor_mos::Rate;
use condor_rt::sim::{SimMachine, VirtualSystem};
use condor_rt::{Interrupts, Machine, ProgramError, Raiser, Setup};
use proptest::collection::vec;
use proptest::prelude::*;

const TARGET: Processor = Processor(1);
const RAISER: Processor = Processor(2);
const NOTE: Vector = Vector(1);
const RESTART: Vector = Vector(2);
const WINDOW_BYTES: u32 = 16384;

/// The vector of each board, and its level: two boards share one.
const LINES: [(u16, u8); 4] = [(130, 2), (130, 2), (128, 1), (159, 7)];
/// A vector that no board has.
const STRANGER: u16 = 140;
/// Boards are as far apart on the bus.
const STRIDE: usize = 0x10;

/// Has a number of requests, of which a write takes one.
struct Requests {
    board: usize,
    left: u32,
    log: Log,
}

impl Model for Requests {
    fn size(&self) -> usize {
        STRIDE
    }

    fn read(&mut self, _: usize, _: Width) -> Option<u32> {
        Some(self.left)
    }

    fn write(&mut self, _: usize, _: Width, _: u32) -> Option<()> {
        self.left -= 1;
        self.log.add(Note::Board(self.board));
        Some(())
    }
}

struct Requester;

impl Driver for Requester {
    const NEW: Self = Self;

    fn probe<B: Bus>(_: Registers<'_, B>) -> bool {
        true
    }

    fn interrupt<B: Bus>(&self, registers: Registers<'_, B>) -> Result<Attention, B::Error> {
        if registers.read32(0)? == 0 {
            return Ok(Attention::NotMine);
        }
        while registers.read32(0)? > 0 {
            registers.write32(0, 1)?;
        }
        Ok(Attention::Mine)
    }
}

device_switch! {
    struct Boards {
        requester: Requester = [
            Location::at(0).interrupting(130, 2),
            Location::at(STRIDE).interrupting(130, 2),
            Location::at(2 * STRIDE).interrupting(128, 1),
            Location::at(3 * STRIDE).interrupting(159, 7),
        ],
    }
}

/// What the target does, at which instant of virtual time in ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Note {
    Loop,
    Board(usize),
    Mail,
}

/// Notes, each with its instant.
type Notes = Vec<(u64, Note)>;

/// The present instant, and what was noted until then.
#[derive(Clone, Default)]
struct Log(Arc<Mutex<(u64, Notes)>>);

impl Log {
    fn inside(&self) -> MutexGuard<'_, (u64, Notes)> {
        self.0.lock().unwrap()
    }

    /// Tells the instant of the notes that follow.
    fn at(&self, instant: u64) {
        self.inside().0 = instant;
    }

    fn add(&self, note: Note) {
        let mut log = self.inside();
        let now = log.0;
        log.1.push((now, note));
    }
}

/// Tells the log when the entry is called.
struct Timed<'t, E>(&'t E, &'t SimMachine<SimBus>, &'t Log);

impl<E: InterruptEntry> InterruptEntry for Timed<'_, E> {
    fn serve_interrupts(&self) {
        self.2.at(self.1.now());
        self.0.serve_interrupts();
    }

    fn counts(&self) -> InterruptCounts {
        self.0.counts()
    }

    fn each_unhandled(&self, each: &mut dyn FnMut(InterruptVector, u32)) {
        self.0.each_unhandled(each);
    }

    fn each_stuck(&self, each: &mut dyn FnMut(InterruptVector, u32)) {
        self.0.each_stuck(each);
    }
}

/// What happens to the target.
#[derive(Clone, Copy, Debug)]
enum Event {
    /// A board has a request; and interrupts, unless the interrupt is lost.
    Request { board: usize, is_lost: bool },
    /// A vector interrupts although no board of it has a request.
    Stray { vector: u16 },
    /// A message that is noted.
    Message,
    /// A message whose handler enables again what was disabled.
    Restart,
}

fn event() -> impl Strategy<Value = Event> {
    let request =
        |is_lost| (0..LINES.len()).prop_map(move |board| Event::Request { board, is_lost });
    let vectors = [LINES[0].0, LINES[2].0, LINES[3].0, STRANGER];
    let stray = prop::sample::select(vectors.to_vec());
    prop_oneof![
        8 => request(false),
        1 => request(true),
        6 => stray.prop_map(|vector| Event::Stray { vector }),
        4 => Just(Event::Message),
        1 => Just(Event::Restart),
    ]
}

/// The period of the target's loop, ns, and when it is first due.
const PERIOD: u64 = 1_000_000;
const FIRST: u64 = PERIOD / 2;

/// The target as it should be.
#[derive(Default)]
struct Reference {
    requests: [u32; LINES.len()],
    raised: Vec<u16>,
    mail: Vec<Event>,
    disabled: Vec<u16>,
    in_a_row: BTreeMap<u16, u32>,
    strangers: u32,
    counts: InterruptCounts,
    log: Notes,
}

impl Reference {
    fn happens(&mut self, event: Event) {
        let mut raise = |vector| {
            if !self.raised.contains(&vector) {
                self.raised.push(vector);
            }
        };
        match event {
            Event::Request { board, is_lost } => {
                self.requests[board] += 1;
                if !is_lost {
                    raise(LINES[board].0);
                }
            }
            Event::Stray { vector } => raise(vector),
            Event::Message | Event::Restart => self.mail.push(event),
        }
    }

    /// Everything that waits is served at an instant: boards by their levels, then messages.
    fn serve(&mut self, now: u64) {
        self.interrupt(now);
        for message in std::mem::take(&mut self.mail) {
            if let Event::Restart = message {
                // A vector without a board stays disabled.
                self.disabled.retain(|vector| *vector == STRANGER);
            } else {
                self.log.push((now, Note::Mail));
            }
        }
        // What was enabled interrupts once the handlers have run.
        self.interrupt(now);
    }

    fn interrupt(&mut self, now: u64) {
        let level = |vector: u16| {
            let line = LINES.iter().find(|(of, _)| *of == vector);
            line.map_or(1, |(_, level)| *level)
        };
        loop {
            let open = self.raised.iter().filter(|it| !self.disabled.contains(it));
            let urgent = open.max_by_key(|&&vector| (level(vector), std::cmp::Reverse(vector)));
            let Some(&vector) = urgent else { return };
            self.raised.retain(|it| *it != vector);
            if vector == STRANGER {
                self.counts.unhandled += 1;
                self.strangers += 1;
                if self.strangers.is_multiple_of(16) {
                    self.disabled.push(vector);
                    self.counts.stuck += 1;
                }
                continue;
            }
            let mut served = false;
            for (board, (of, _)) in LINES.iter().enumerate() {
                if *of == vector {
                    served |= self.requests[board] > 0;
                    for _ in 0..std::mem::take(&mut self.requests[board]) {
                        self.log.push((now, Note::Board(board)));
                    }
                }
            }
            let in_a_row = self.in_a_row.entry(vector).or_default();
            *in_a_row += 1;
            if served {
                self.counts.served += 1;
                *in_a_row = 0;
            } else {
                self.counts.unclaimed += 1;
                if *in_a_row == 16 {
                    *in_a_row = 0;
                    self.disabled.push(vector);
                    self.counts.stuck += 1;
                }
            }
        }
    }
}

/// Returns the target as it should be after `events`, each with its instant, if a run of its loop takes `work` ns.
fn expected(events: &[(u64, Event)], work: u64, end: u64) -> Reference {
    let mut reference = Reference::default();
    let mut left = events.iter().peekable();
    let mut release = FIRST;
    loop {
        let next = left.peek().map_or(end, |(at, _)| *at);
        if release <= next && release < end {
            reference.log.push((release, Note::Loop));
            let done = release + work;
            while let Some((_, event)) = left.next_if(|(at, _)| *at <= done) {
                reference.happens(*event);
            }
            reference.serve(done);
            release += PERIOD;
        } else if next < end {
            while let Some((_, event)) = left.next_if(|(at, _)| *at == next) {
                reference.happens(*event);
            }
            reference.serve(next);
        } else {
            return reference;
        }
    }
}

fn target(
    machine: &SimMachine<SimBus>,
    log: &Log,
    interrupts: &Mutex<Option<Interrupts>>,
) -> Result<(), ProgramError> {
    let (bus, controller) = (machine.bus(), machine.interrupt_controller());
    let switch = Switch::<_, _, _, 1>::new(bus, controller, Boards::new());
    switch.start();
    let entry = Timed(&switch, machine, log);
    let note = |_: &condor_rt::HandlerCall<'_>| {
        log.at(machine.now());
        log.add(Note::Mail);
        0
    };
    let restart = |_: &condor_rt::HandlerCall<'_>| {
        switch.start();
        0
    };
    Setup::new(machine)?
        .interrupts(&entry)
        .on(NOTE, "note", &note)
        .on(RESTART, "restart", &restart)
        .servo("loop", Rate::hz(1000), &mut |tick| {
            log.at(tick.due.as_ns());
            log.add(Note::Loop);
        })
        .run()?;
    *interrupts.lock().unwrap() = Some(Interrupts::of(&entry, 0));
    Ok(())
}

/// Lets `events` happen to a target in virtual time, and returns what it did and counted.
fn run(events: &[(u64, Event)], work: u64, end: u64) -> (Notes, Interrupts) {
    let (log, interrupts) = (Log::default(), Mutex::new(None));
    let bus = SimBus::new();
    let boards: Vec<_> = (0..LINES.len())
        .map(|board| {
            let log = log.clone();
            bus.insert(
                board * STRIDE,
                Requests {
                    board,
                    left: 0,
                    log,
                },
            )
        })
        .collect();
    let mut system = VirtualSystem::with_bus(WINDOW_BYTES, bus).unwrap();
    system.set_work(TARGET, 0, work).unwrap();
    system
        .host(TARGET, |machine| target(machine, &log, &interrupts))
        .unwrap();
    let raise = |machine: &SimMachine<SimBus>| {
        let (raiser, mut mailbox) = (Raiser::new(machine), machine.mailbox()?);
        mailbox.join()?;
        for (at, event) in events {
            // Even no time lets others run.
            if *at > machine.now() {
                machine.work(at - machine.now());
            }
            let send = |vector| mailbox.send(TARGET, vector, 0, Duration::ZERO);
            match event {
                Event::Request { board, is_lost } => {
                    boards[*board].lock().unwrap().left += 1;
                    if !is_lost {
                        raiser.raise(TARGET, InterruptVector(LINES[*board].0));
                    }
                }
                Event::Stray { vector } => raiser.raise(TARGET, InterruptVector(*vector)),
                Event::Message => send(NOTE)?,
                Event::Restart => send(RESTART)?,
            }
        }
        Ok::<_, ProgramError>(())
    };
    system.host(RAISER, raise).unwrap();
    system.run_until(end).unwrap();
    let mut log = std::mem::take(&mut log.inside().1);
    // The program ends where it looks next.
    log.retain(|(at, _)| *at < end);
    let interrupts = interrupts.lock().unwrap().take().unwrap();
    (log, interrupts)
}

/// A message finds room: at most as many of them wait as a ring has slots.
fn with_instants(events: Vec<(u64, Event)>) -> Vec<(u64, Event)> {
    // The programs have joined by then, and no event comes when a loop ends.
    let mut now = FIRST / 2;
    let mut messages = 0;
    let mut placed = Vec::new();
    for (gap_us, event) in events {
        now += 1000 * gap_us;
        if gap_us >= 50 {
            messages = 0;
        }
        if let Event::Message | Event::Restart = event {
            messages += 1;
        }
        if messages <= 8 {
            placed.push((now, event));
        }
    }
    placed
}

/// Some 10 000 arrivals; 100 000 come with `PROPTEST_CASES=500`.
fn config() -> ProptestConfig {
    let chosen = std::env::var_os("PROPTEST_CASES").is_some();
    let cases = if chosen {
        ProptestConfig::default().cases
    } else {
        50
    };
    ProptestConfig::with_cases(cases)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn arrivals_are_served_as_by_the_reference(
        events in vec((prop_oneof![Just(0), 1..20_u64, Just(50), Just(250), Just(500)], event()), 1..400),
        work in prop_oneof![Just(0), Just(33_333), Just(333_333_u64)],
    ) {
        let events = with_instants(events);
        let last = events.last().map_or(0, |(at, _)| *at);
        let end = last + 10 * PERIOD;
        let reference = expected(&events, work, end);
        let (log, interrupts) = run(&events, work, end);
        // Boards of one vector are served in turn: here by their numbers.
        prop_assert_eq!(in_order(log), in_order(reference.log));
        let counts = InterruptCounts {
            served: interrupts.served,
            spurious: interrupts.spurious,
            unclaimed: interrupts.unclaimed,
            unhandled: interrupts.unhandled,
            stuck: interrupts.stuck,
        };
        prop_assert_eq!(counts, reference.counts);
    }
}

/// Sorts neighbours that are boards of one vector.
fn in_order(mut log: Notes) -> Notes {
    let vector = |note: &(u64, Note)| match note.1 {
        Note::Board(board) => Some((note.0, LINES[board].0)),
        Note::Loop | Note::Mail => None,
    };
    let same = |one: &(u64, Note), other: &(u64, Note)| {
        vector(one).is_some() && vector(one) == vector(other)
    };
    for notes in log.chunk_by_mut(same) {
        notes.sort_by_key(|(_, note)| match note {
            Note::Board(board) => *board,
            Note::Loop | Note::Mail => 0,
        });
    }
    log
}

/// Lines whose boards ask until they are served: they request once more when an interrupt has been completed.
struct Levels<C> {
    lines: C,
    raiser: Raiser<SimMachine<SimBus>>,
    asking: Mutex<BTreeMap<InterruptVector, bool>>,
}

impl<C> Levels<C> {
    fn request(&self, vector: InterruptVector) {
        if self.asking.lock().unwrap().get(&vector) == Some(&true) {
            self.raiser.raise(TARGET, vector);
        }
    }
}

impl<C: InterruptController> InterruptController for Levels<C> {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        self.lines.enable(vector, level);
    }

    fn disable(&self, vector: InterruptVector) {
        self.lines.disable(vector);
    }

    fn claim(&self) -> Option<InterruptVector> {
        // A board withdraws its request by no longer asking; its driver then finds nothing.
        loop {
            let vector = self.lines.claim()?;
            if self.asking.lock().unwrap().get(&vector) == Some(&true) {
                return Some(vector);
            }
            self.lines.complete(vector);
        }
    }

    fn complete(&self, vector: InterruptVector) {
        self.lines.complete(vector);
        self.request(vector);
    }
}

#[test]
fn the_controller_conforms() {
    let mut system = VirtualSystem::with_bus(WINDOW_BYTES, SimBus::new()).unwrap();
    let check = |machine: &SimMachine<SimBus>| {
        let levels = Levels {
            lines: machine.interrupt_controller(),
            raiser: Raiser::new(machine),
            asking: Mutex::default(),
        };
        let lines = [128, 159].map(InterruptVector);
        for line in lines {
            levels.disable(line);
        }
        conformance::interrupt_controller(&levels, lines, InterruptVector(160), |vector, asks| {
            levels.asking.lock().unwrap().insert(vector, asks);
            levels.request(vector);
        })
    };
    system.host(TARGET, check).unwrap();
    system.run().unwrap();
}
