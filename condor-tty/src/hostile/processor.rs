//! The processor's end, whose host writes anything anywhere at any moment.

use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use crate::{ConsoleError, InputMode, InputResult, Policy, Terminal, TerminalSettings};
use condor_mbox::sim::SimWindow;
use condor_mbox::{Allocator, MemoryWindow, Region, SingleContext};
use embedded_io::{Read, Write};

use super::haunted::Haunted;
use super::script::Script;
use super::support::Board;

const OFFSET: u32 = 64;
const CAPACITY: u32 = 32;
const END: u32 = OFFSET + 128 + CAPACITY;
/// The number of characters for which the queue has room.
const QUEUE: usize = 16;
const TIMEOUT: Duration = Duration::from_millis(25);
const INTERRUPT: u8 = 3;

type Hand<'b> = Terminal<Haunted<'b>, SingleContext, QUEUE>;

/// Runs a fuzz test of a [`Terminal`]: `bytes` decide what the host and the program do, also things that no correct
/// host does.
///
/// # Panics
/// Panics if the terminal breaks a promise: if it waits past its deadline, writes words of the host, loses
/// characters without counting them, or returns input that was not typed.
pub fn run(bytes: &[u8]) {
    let script = Rc::new(Script::new(bytes));
    let memory = SimWindow::new(END + 64);
    let window = Haunted::new(&memory, &script, OFFSET..END);
    let region = Region::whole(window.clone());
    let mut allocator = Allocator::new(region.size());
    allocator.bytes(OFFSET as usize).unwrap();
    let hand = Hand::new(region, &mut allocator, CAPACITY, SingleContext::new()).unwrap();
    // From now on only the host may write the host's line.
    window.forbid(OFFSET + 64..OFFSET + 128);
    let board = Board::new();
    let mut run = Run {
        hand: &hand,
        board: &board,
        script: &script,
        typed: VecDeque::new(),
    };
    while !script.is_over() {
        run.step(&window);
        assert!(hand.unread().unwrap() <= CAPACITY);
    }
}

struct Run<'r, 'b> {
    hand: &'r Hand<'b>,
    board: &'r Board<'static>,
    script: &'r Script<'b>,
    /// The characters that can be read, in raw mode.
    typed: VecDeque<u8>,
}

impl Run<'_, '_> {
    fn step(&mut self, window: &Haunted<'_>) {
        match self.script.below(8) {
            0 | 1 => window.rewrite(),
            2 => self.post(),
            3 => self.write(),
            4 => self.accept(),
            5 => self.read(),
            6 => self.policy(),
            _ => self.configure(),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let byte = if self.script.below(2) == 0 {
            b'a'
        } else {
            b'\n'
        };
        vec![byte; self.script.below(80)]
    }

    fn post(&self) {
        let bytes = self.bytes();
        let before = self.hand.lost();
        let written = self.hand.poster(self.board).post(&bytes).unwrap();
        assert_eq!(
            bytes.len() - written,
            self.hand.lost().wrapping_sub(before) as usize
        );
    }

    fn write(&self) {
        let bytes = self.bytes();
        let (before, begun) = (self.hand.lost(), self.board.now_ns());
        let mut console = self.hand.console(self.board);
        let outcome = if self.script.below(4) == 0 {
            console.flush()
        } else {
            console.write_all(&bytes)
        };
        let lost = self.hand.lost().wrapping_sub(before) as usize;
        match outcome {
            Ok(()) => assert!(lost <= bytes.len()),
            Err(ConsoleError::TimedOut { lost: given_up }) => {
                assert!(given_up <= lost && lost <= bytes.len());
            }
            Err(error) => panic!("{error}"),
        }
        let took = Duration::from_nanos(self.board.now_ns() - begun);
        assert!(took <= TIMEOUT, "{took:?}");
    }

    fn accept(&mut self) {
        let character = match self.script.below(3) {
            0 => self.script.byte(),
            1 => self.script.byte() % 32,
            _ => b'a',
        };
        let accepted = self.hand.accept(character).unwrap();
        if self.hand.settings().mode == InputMode::Cooked {
            let interrupts = character == INTERRUPT;
            assert_eq!(accepted == InputResult::Interrupts, interrupts);
            assert_eq!(self.hand.take_interrupt(), interrupts);
            return;
        }
        if self.typed.len() < QUEUE {
            assert_eq!(accepted, InputResult::Taken);
            self.typed.push_back(character);
        } else {
            assert_eq!(accepted, InputResult::Full);
        }
    }

    fn read(&mut self) {
        let mut into = vec![0; 1 + self.script.below(20)];
        let console = self.hand.console(self.board);
        let outcome = console.with_read_timeout(TIMEOUT).read(&mut into);
        if self.hand.settings().mode == InputMode::Cooked {
            return;
        }
        let expected: Vec<u8> = {
            let count = into.len().min(self.typed.len());
            self.typed.drain(..count).collect()
        };
        if expected.is_empty() {
            assert_eq!(outcome, Err(ConsoleError::TimedOut { lost: 0 }));
        } else {
            assert_eq!(outcome, Ok(expected.len()));
            assert_eq!(into[..expected.len()], expected);
        }
    }

    fn policy(&self) {
        let policies = [
            Policy::Block { timeout: TIMEOUT },
            Policy::DropNew,
            Policy::DropOld,
        ];
        let policy = policies[self.script.below(3)];
        self.hand.set_policy(policy).unwrap();
        assert_eq!(self.hand.policy(), policy);
    }

    /// Configures the terminal. The queue is emptied before, so that its content is known.
    fn configure(&mut self) {
        let raw = self.script.below(2) == 0;
        let echo = self.script.below(2) == 0;
        let settings = if raw {
            TerminalSettings::RAW
        } else {
            TerminalSettings::COOKED
        };
        self.hand.configure(&TerminalSettings::RAW).unwrap();
        self.hand.take_interrupt();
        let console = self.hand.console(self.board);
        let mut console = console.with_read_timeout(Duration::ZERO);
        // One read for each place of the queue is enough: each returns at least one character, or the end of
        // the file.
        for _ in 0..=QUEUE {
            if console.read(&mut [0; QUEUE]).is_err() {
                break;
            }
        }
        self.typed.clear();
        self.hand
            .configure(&TerminalSettings { echo, ..settings })
            .unwrap();
    }
}
