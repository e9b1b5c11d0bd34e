//! A [`TerminalHost`], whose processor writes anything anywhere at any moment, and replies with any words.

use std::cell::Cell;
use std::io;
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use crate::linux::{HostError, Piece, Sink, TerminalHost};
use crate::{Policy, Terminal, TerminalReaderError, TerminalVectors};
use condor_mbox::sim::SimSystem;
use condor_mbox::{Allocator, MemoryWindow, Messenger, Processor, Region, SingleContext};

use super::haunted::Haunted;
use super::script::Script;

const HOST: Processor = Processor(0);
const HAND: Processor = Processor(1);
/// The line of the doorbell, before the region of the users.
const BASE: u32 = 64;
const CAPACITY: u32 = 32;
const END: u32 = BASE + 128 + CAPACITY;

/// A person who takes output and types input as a script decides.
struct Person<'b> {
    script: Rc<Script<'b>>,
    taken: Rc<Cell<usize>>,
    typed: Rc<Cell<usize>>,
}

impl Sink for Person<'_> {
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        let choice = self.script.below(8);
        if choice == 7 {
            return Err(io::Error::other("a sink that fails"));
        }
        let count = piece.bytes.len().min(choice * 12);
        self.taken.set(self.taken.get() + count);
        Ok(count)
    }

    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.script.below(4);
        for place in into.iter_mut().take(count) {
            *place = if self.script.below(4) == 0 { 3 } else { b'a' };
        }
        self.typed.set(self.typed.get() + count);
        Ok(count)
    }
}

/// Runs a fuzz test of a [`TerminalHost`]: `bytes` decide what the processor and the person at the terminal do, also
/// things that no correct processor does.
///
/// # Panics
/// Panics if the host breaks a promise: if it writes words of the processor, claims to have shown characters
/// that it has not, invents a character, or returns an error that only its own mailbox can cause.
pub fn run(bytes: &[u8]) {
    let script = Rc::new(Script::new(bytes));
    let system = SimSystem::<2>::in_virtual_time(BASE + 1024);
    let [_, windows] = system.windows(HAND);
    let own = Region::users(windows.data.clone()).unwrap();
    let hand = Terminal::<_, _, 16>::new(
        own.clone(),
        &mut Allocator::new(own.size()),
        CAPACITY,
        SingleContext::new(),
    )
    .unwrap();
    let reply = AtomicU32::new(1);
    let replies = |_: &condor_mbox::Call<'_>| reply.load(Ordering::Relaxed);
    let mut processor = system.mailbox(HAND).unwrap();
    processor
        .set_vector(TerminalVectors::DEFAULT.input, &replies, "input")
        .unwrap();
    processor
        .set_vector(TerminalVectors::DEFAULT.room, &replies, "room")
        .unwrap();
    processor.join().unwrap();
    let mut mailbox = system.mailbox(HOST).unwrap();
    mailbox
        .set_vector(TerminalVectors::DEFAULT.output, &|_| 0, "output")
        .unwrap();
    mailbox.join().unwrap();

    let window = Haunted::new(&windows.data, &script, BASE..END);
    window.forbid(BASE..BASE + 64);
    let (taken, typed) = (Rc::new(Cell::new(0)), Rc::new(Cell::new(0)));
    let accepted = Cell::new(0);
    let attach = || {
        let region = Region::users(window.clone()).unwrap();
        // Characters that waited at a former host are gone with it.
        typed.set(0);
        accepted.set(0);
        TerminalHost::attach(region, 0, HAND, HOST).ok()
    };
    let mut person = Person {
        script: Rc::clone(&script),
        taken: Rc::clone(&taken),
        typed: Rc::clone(&typed),
    };
    let mut tty = attach();
    while !script.is_over() {
        match script.below(8) {
            0 => window.rewrite(),
            1 => {
                let post = vec![b'a'; script.below(80)];
                hand.poster(&processor).post(&post).unwrap();
            }
            2 => {
                let policies = [Policy::DropNew, Policy::DropOld];
                hand.set_policy(policies[script.below(2)]).unwrap();
            }
            3 => {
                let replies = [0, 1, 2, script.word()];
                reply.store(replies[script.below(4)], Ordering::Relaxed);
            }
            4 => {
                processor.serve(Duration::from_micros(1)).unwrap();
                mailbox.serve(Duration::from_micros(1)).unwrap();
            }
            5 => tty = attach(),
            _ => {
                let Some(host) = &mut tty else { continue };
                let before = taken.get();
                match host.serve(&mailbox, &mut person) {
                    Ok(served) => {
                        assert_eq!(served.output, taken.get() - before);
                        accepted.set(accepted.get() + served.input);
                    }
                    Err(HostError::Sink(_)) => {}
                    Err(HostError::Reader(
                        TerminalReaderError::Displaced { .. }
                        | TerminalReaderError::Broken { .. }
                        | TerminalReaderError::Restarted { .. }
                        | TerminalReaderError::NoTerminal { .. }
                        | TerminalReaderError::Access(_),
                    )) => tty = None,
                    Err(error) => panic!("{error}"),
                }
                if let Some(host) = &tty {
                    let known = host.waiting_input() + accepted.get();
                    assert!(known <= typed.get(), "{known} of {}", typed.get());
                }
            }
        }
    }
}
