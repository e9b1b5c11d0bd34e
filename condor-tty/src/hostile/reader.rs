//! The host's half of the ring, whose processor writes anything anywhere at any moment.

use std::rc::Rc;

use crate::{Policy, Terminal, TerminalReader, TerminalReaderError};
use condor_mbox::sim::SimWindow;
use condor_mbox::{Allocator, MemoryWindow, Region, SingleContext};

use super::haunted::Haunted;
use super::script::Script;
use super::support::{Board, HOST};

const OFFSET: u32 = 64;
const CAPACITY: u32 = 32;
const END: u32 = OFFSET + 128 + CAPACITY;

/// Runs a fuzz test of a [`TerminalReader`]: `bytes` decide what the processor does, also things that no correct
/// processor does.
///
/// # Panics
/// Panics if the reader breaks a promise: if it writes words of the processor, copies more than there can be,
/// or returns an error that no processor can cause.
pub fn run(bytes: &[u8]) {
    let script = Rc::new(Script::new(bytes));
    let memory = SimWindow::new(END + 64);
    let window = Haunted::new(&memory, &script, OFFSET..END);
    // A processor that behaves correctly between its attacks.
    let region = Region::whole(memory);
    let mut allocator = Allocator::new(region.size());
    allocator.bytes(OFFSET as usize).unwrap();
    let hand =
        Terminal::<_, _, 16>::new(region, &mut allocator, CAPACITY, SingleContext::new()).unwrap();
    let board = Board::new();
    window.forbid(OFFSET..OFFSET + 64);
    let mut reader = None;
    while !script.is_over() {
        match script.below(8) {
            0 => window.rewrite(),
            1 => {
                hand.poster(&board)
                    .post(&vec![b'a'; script.below(80)])
                    .unwrap();
            }
            2 => {
                let policies = [Policy::DropNew, Policy::DropOld];
                hand.set_policy(policies[script.below(2)]).unwrap();
            }
            3 => reader = attach(&window),
            4 => {
                if let Some(reader) = reader.take() {
                    look(TerminalReader::detach(reader));
                }
            }
            _ => {
                if let Some(reader) = &mut reader {
                    read(reader, &script);
                }
            }
        }
    }
}

fn attach<'b>(window: &Haunted<'b>) -> Option<TerminalReader<Haunted<'b>>> {
    match TerminalReader::attach(Region::whole(window.clone()), OFFSET, HOST) {
        Ok(reader) => {
            assert!(reader.capacity() >= 8 && reader.capacity() <= CAPACITY + 64);
            Some(reader)
        }
        Err(TerminalReaderError::Displaced { .. } | TerminalReaderError::Restarted { .. }) => {
            panic!("nobody was attached")
        }
        // The capacity may be beyond the window.
        Err(_) => None,
    }
}

fn read(reader: &mut TerminalReader<Haunted<'_>>, script: &Script<'_>) {
    let most = script.below(100);
    let mut bytes = vec![0; most];
    if let Some(fetched) = look(reader.fetch(&mut bytes)) {
        assert!(fetched.len <= most && fetched.len <= reader.capacity() as usize);
    }
    look(reader.acknowledge(script.below(100)));
    let status = reader.status().unwrap();
    assert!(status.unread <= reader.capacity());
}

/// Returns the value, or `None` for an error that a processor can cause.
fn look<T>(outcome: Result<T, TerminalReaderError>) -> Option<T> {
    match outcome {
        Ok(value) => Some(value),
        Err(
            TerminalReaderError::Restarted { .. }
            | TerminalReaderError::Displaced { .. }
            | TerminalReaderError::Broken { .. },
        ) => None,
        Err(error) => panic!("{error}"),
    }
}
