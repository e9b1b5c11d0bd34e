//! [`Latest`] with interrupts at every point of either end.
//!
//! There are points between the words of a value that is being written or read, too. A run is made for
//! every way to place up to three interrupts, those within other interrupts included. One end of one cell is never in
//! use twice: it is used through `&mut`.
//!
//! It fails if the reader's buffer is not its own until its next call, if a value that was complete
//! before a call is not found by it, if the reader goes back to an older value, and if an exchange
//! is not one access.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use interrupt_injector::{Interrupts, explore, point};

use crate::latest::{Latest, LatestReader, LatestWriter};

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
    writer: RefCell<LatestWriter<'static, Value>>,
    reader: RefCell<LatestReader<'static, Value>>,
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
            point();
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
        point();
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

/// Runs the background, and loops that interrupt it and each other, from the slowest on.
fn explore_channels(channels: &[&Rc<Channel>], background: impl Fn(), loops: Vec<Program>) {
    let interrupts = Interrupts::Ranked {
        most: INTERRUPTS,
        sources: loops.len(),
    };
    let loops = Rc::new(loops);
    let runs = explore(interrupts, |plan| {
        let loops = Rc::clone(&loops);
        plan.run(
            move |number| loops[number](),
            || (0..ROUNDS).for_each(|_| background()),
        );
        for channel in channels {
            channel.check_end();
        }
    });
    println!("{runs} runs");
    assert!(runs > 100 || cfg!(miri));
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
    explore_channels(&[&channel], move || read(), loops);
}

#[test]
fn a_writer_is_interrupted_by_a_reader() {
    let channel = Channel::new();
    let write = does(&channel, Channel::write);
    let loops = vec![does(&channel, Channel::read)];
    explore_channels(&[&channel], move || write(), loops);
}

#[test]
fn a_loop_and_the_background_have_an_end_of_two_cells_each() {
    let (up, down) = (Channel::new(), Channel::new());
    let background = passes_on(&up, &down);
    let loops = vec![passes_on(&down, &up)];
    explore_channels(&[&up, &down], move || background(), loops);
}

#[test]
fn a_writer_that_interrupts_a_reader_is_interrupted_by_another_writer() {
    let (fast, slow) = (Channel::new(), Channel::new());
    let read = does(&slow, Channel::read);
    let loops = vec![passes_on(&fast, &slow), does(&fast, Channel::write)];
    explore_channels(&[&fast, &slow], move || read(), loops);
}

#[test]
fn a_reader_that_interrupts_a_writer_is_interrupted_by_another_reader() {
    let (slow, fast) = (Channel::new(), Channel::new());
    let write = does(&slow, Channel::write);
    let loops = vec![passes_on(&slow, &fast), does(&fast, Channel::read)];
    explore_channels(&[&slow, &fast], move || write(), loops);
}
