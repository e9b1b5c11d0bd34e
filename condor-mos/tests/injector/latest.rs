//! [`Latest`] with interrupts at every point of either end.
//!
//! A point lies before and behind each atomic access, and between the words of a value that is
//! being written or read. A run is made for every way to place up to three interrupts at its points,
//! those within other interrupts included. One end of one cell is never in use twice: it is used
//! through `&mut`.
//!
//! It fails if the reader's buffer is not its own until its next call, if a value that was complete
//! before a call is not found by it, if the reader goes back to an older value, and if an exchange
//! is not one access.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use super::hook;
use crate::latest::{Latest, Reader, Writer};

/// How many interrupts come in one run.
const INTERRUPTS: usize = if cfg!(miri) { 1 } else { 3 };
/// How often the background does what it does.
const ROUNDS: u32 = 3;

/// Two words, so that a mixture shows.
type Value = [u32; 2];

const fn value(number: u32) -> Value {
    [number, !number]
}

/// A cell, and what was done to it. It is used for all runs, and so begins with any of its buffers
/// anywhere.
struct Channel {
    writer: RefCell<Writer<'static, Value>>,
    reader: RefCell<Reader<'static, Value>>,
    /// The last value whose publication has begun, and the last one whose publication has ended.
    begun: Cell<u32>,
    ended: Cell<u32>,
    /// The last one that was read.
    read: Cell<u32>,
}

impl Channel {
    fn new() -> Rc<Self> {
        let cell = Box::leak(Box::new(Latest::new(value(0))));
        let (writer, reader) = cell.split().expect("the first");
        Rc::new(Self {
            writer: RefCell::new(writer),
            reader: RefCell::new(reader),
            begun: Cell::new(0),
            ended: Cell::new(0),
            read: Cell::new(0),
        })
    }

    /// Writes the next value; every other one in place.
    fn write(&self) {
        let mut writer = self.writer.borrow_mut();
        let number = self.begun.get() + 1;
        if number.is_multiple_of(2) {
            let [first, second] = value(number);
            writer.buffer()[0] = first;
            hook::point();
            writer.buffer()[1] = second;
            self.begun.set(number);
            writer.publish();
        } else {
            self.begun.set(number);
            writer.write(value(number));
        }
        self.ended.set(number);
    }

    /// Reads what was complete before, or is newer.
    fn read(&self) {
        let mut reader = self.reader.borrow_mut();
        let (before, ended) = (self.read.get(), self.ended.get());
        let fresh = reader.is_fresh();
        assert!(fresh || ended <= before, "{ended} is not fresh");
        let value_read = reader.read();
        let number = value_read[0];
        let newest = self.begun.get();
        assert!(
            (ended.max(before)..=newest).contains(&number),
            "{number} after {before}, while {ended} to {newest} are there"
        );
        assert!(!fresh || number > before, "{number} was fresh");
        // It stays, whatever is written meanwhile.
        hook::point();
        assert_eq!(*value_read, value(number));
        self.read.set(number);
    }

    /// Nothing is lost.
    fn check_end(&self) {
        self.read();
        assert_eq!(self.read.get(), self.ended.get());
        assert!(!self.reader.borrow().is_fresh());
    }
}

/// What a context does.
type Program = Rc<dyn Fn()>;

/// The point of a run at which an interrupt comes, and the loop that it runs.
type Interrupt = (u32, usize);

/// Where a run is.
struct Run {
    /// From the slowest on.
    loops: Vec<Program>,
    plan: Vec<Interrupt>,
    /// Interrupts that have come.
    came: Cell<usize>,
    /// Points that have passed.
    points: Cell<u32>,
    /// Loops below this number are in progress, or as good as.
    level: Cell<usize>,
}

impl Run {
    fn on_point(&self) {
        let here = self.points.get();
        self.points.set(here + 1);
        while let Some(&(point, number)) = self.plan.get(self.came.get())
            && point == here
            && number >= self.level.get()
        {
            self.came.set(self.came.get() + 1);
            let level = self.level.replace(number + 1);
            self.loops[number]();
            self.level.set(level);
        }
    }
}

/// What runs in turn: the background, and loops that interrupt it and each other.
struct Contexts {
    channels: Vec<Rc<Channel>>,
    background: Program,
    loops: Vec<Program>,
    runs: Cell<u64>,
}

impl Contexts {
    fn explore(channels: &[&Rc<Channel>], background: impl Fn() + 'static, loops: Vec<Program>) {
        let contexts = Self {
            channels: channels.iter().copied().map(Rc::clone).collect(),
            background: Rc::new(background),
            loops,
            runs: Cell::new(0),
        };
        contexts.explore_from(&[]);
        println!("{} runs", contexts.runs.get());
        assert!(contexts.runs.get() > 100 || cfg!(miri));
    }

    /// All runs whose first interrupts are these.
    fn explore_from(&self, plan: &[Interrupt]) {
        let Some(points) = self.run(plan) else { return };
        if plan.len() == INTERRUPTS {
            return;
        }
        let first = plan.last().map_or(0, |&(point, _)| point);
        for point in first..points {
            for number in 0..self.loops.len() {
                self.explore_from(&[plan, &[(point, number)]].concat());
            }
        }
    }

    /// Makes a run; gives the number of its points if all interrupts have come.
    fn run(&self, plan: &[Interrupt]) -> Option<u32> {
        self.runs.set(self.runs.get() + 1);
        let run = Rc::new(Run {
            loops: self.loops.clone(),
            plan: plan.to_vec(),
            came: Cell::new(0),
            points: Cell::new(0),
            level: Cell::new(0),
        });
        let on_point = {
            let run = Rc::clone(&run);
            Rc::new(move || run.on_point())
        };
        hook::with(on_point, || {
            (0..ROUNDS).for_each(|_| (self.background)());
        });
        self.channels.iter().for_each(|channel| channel.check_end());
        (run.came.get() == plan.len()).then(|| run.points.get())
    }
}

/// A loop that does this with a channel.
fn does(channel: &Rc<Channel>, program: fn(&Channel)) -> Program {
    let channel = Rc::clone(channel);
    Rc::new(move || program(&channel))
}

/// A loop that takes from one channel and gives to another.
fn passes_on(from: &Rc<Channel>, to: &Rc<Channel>) -> Program {
    let (from, to) = (Rc::clone(from), Rc::clone(to));
    Rc::new(move || {
        from.read();
        to.write();
    })
}

#[test]
fn a_reader_is_interrupted_by_a_writer() {
    let channel = Channel::new();
    let read = does(&channel, Channel::read);
    let loops = vec![does(&channel, Channel::write)];
    Contexts::explore(&[&channel], move || read(), loops);
}

#[test]
fn a_writer_is_interrupted_by_a_reader() {
    let channel = Channel::new();
    let write = does(&channel, Channel::write);
    let loops = vec![does(&channel, Channel::read)];
    Contexts::explore(&[&channel], move || write(), loops);
}

#[test]
fn a_loop_and_the_background_have_an_end_of_two_cells_each() {
    let (up, down) = (Channel::new(), Channel::new());
    let background = passes_on(&up, &down);
    let loops = vec![passes_on(&down, &up)];
    Contexts::explore(&[&up, &down], move || background(), loops);
}

#[test]
fn a_writer_that_interrupts_a_reader_is_interrupted_by_another_writer() {
    let (fast, slow) = (Channel::new(), Channel::new());
    let read = does(&slow, Channel::read);
    let loops = vec![passes_on(&fast, &slow), does(&fast, Channel::write)];
    Contexts::explore(&[&fast, &slow], move || read(), loops);
}

#[test]
fn a_reader_that_interrupts_a_writer_is_interrupted_by_another_reader() {
    let (slow, fast) = (Channel::new(), Channel::new());
    let write = does(&slow, Channel::write);
    let loops = vec![passes_on(&slow, &fast), does(&fast, Channel::read)];
    Contexts::explore(&[&slow, &fast], move || write(), loops);
}
