//! A processor and a host as two threads, with mailboxes between them.
#![cfg(feature = "linux")]

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use condor_mbox::sim::SimSystem;
use condor_mbox::{Allocator, Call, CriticalSection, MemoryWindow, Messenger, Processor, Region};
use condor_tty::linux::{Piece, Sink, TerminalHost, TerminalLog};
use condor_tty::{ConsoleError, Policy, Terminal, TerminalSettings, TerminalVectors};
use embedded_io::{Read, ReadReady, Write};

const HOST: Processor = Processor(0);
const HAND: Processor = Processor(1);
const LONG: Duration = Duration::from_secs(60);
const SHORT: Duration = Duration::from_millis(2);

/// Takes a few bytes at a time, and sometimes none.
#[derive(Default)]
struct Slow {
    shown: Vec<u8>,
    looks: usize,
    typed: VecDeque<u8>,
}

impl Sink for Slow {
    fn take(&mut self, piece: Piece<'_>) -> std::io::Result<usize> {
        self.looks += 1;
        let count = piece.bytes.len().min(self.looks * 7 % 100);
        self.shown.extend(&piece.bytes[..count]);
        Ok(count)
    }

    fn typed(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = into.len().min(self.typed.len());
        for (place, character) in into.iter_mut().zip(self.typed.drain(..count)) {
            *place = character;
        }
        Ok(count)
    }
}

#[test]
fn output_arrives_whole_and_input_is_answered() {
    let system = SimSystem::<2>::in_real_time(4096);
    let [_, windows] = system.windows(HAND);
    let ram = Region::users(windows.data).unwrap();
    let mut allocator = Allocator::new(ram.size());
    let terminal =
        Terminal::<_, _, 16>::new(ram.clone(), &mut allocator, 64, CriticalSection).unwrap();
    terminal
        .set_policy(Policy::Block { timeout: LONG })
        .unwrap();
    let echo = false;
    terminal
        .configure(&TerminalSettings {
            echo,
            ..TerminalSettings::COOKED
        })
        .unwrap();
    let (done, at_prompt) = (AtomicBool::new(false), AtomicBool::new(false));
    let interrupts = AtomicU32::new(0);
    let receive = |call: &Call<'_>| {
        terminal.receive_and(call, || {
            interrupts.fetch_add(1, Ordering::Relaxed);
        })
    };
    let mut hand = system.mailbox(HAND).unwrap();
    hand.set_vector(TerminalVectors::DEFAULT.input, &receive, "input")
        .unwrap();
    hand.set_vector(TerminalVectors::DEFAULT.room, &receive, "room")
        .unwrap();
    hand.join().unwrap();
    let mut host = system.mailbox(HOST).unwrap();
    host.set_vector(TerminalVectors::DEFAULT.output, &|_| 0, "output")
        .unwrap();
    host.join().unwrap();

    let mut slow = Slow::default();
    let mut tty = TerminalHost::attach(ram, terminal.offset(), HAND, HOST).unwrap();
    let (done, at_prompt, terminal, interrupts) = (&done, &at_prompt, &terminal, &interrupts);
    let log = std::thread::scope(|threads| {
        threads.spawn(move || {
            let mut console = terminal.console(&hand).with_read_timeout(LONG);
            for number in 0..2000 {
                writeln!(console, "line {number}").unwrap();
            }
            let mut line = [0; 32];
            let count = console.read(&mut line).unwrap();
            console.write_all(b"got ").unwrap();
            console.write_all(&line[..count]).unwrap();
            console.flush().unwrap();
            // From here on it serves and does not read: the queue fills.
            at_prompt.store(true, Ordering::Release);
            while interrupts.load(Ordering::Relaxed) == 0 {
                hand.serve(SHORT).unwrap();
            }
            assert_eq!(console.read(&mut line), Err(ConsoleError::Interrupted));
            done.store(true, Ordering::Release);
            while at_prompt.load(Ordering::Acquire) {
                hand.serve(SHORT).unwrap();
            }
        });
        slow.typed.extend(b"hello\n");
        let mut log = TerminalLog::new(slow, Vec::new(), Duration::default);
        let mut typed = false;
        while !done.load(Ordering::Acquire) {
            tty.serve(&host, &mut log).unwrap();
            host.serve(SHORT).unwrap();
            if at_prompt.load(Ordering::Acquire) && !typed {
                typed = true;
                log.sink.typed.extend(b"first\nsecond\nthird\n");
            }
            if typed && tty.status().unwrap().full {
                assert!(tty.waiting_input() > 0);
                log.sink.typed.extend(b"\x03");
            }
        }
        assert_eq!(interrupts.load(Ordering::Relaxed), 1);
        at_prompt.store(false, Ordering::Release);
        tty.detach().unwrap();
        log
    });
    let mut expected = String::new();
    for number in 0..2000 {
        expected.extend(["line ", &number.to_string(), "\r\n"]);
    }
    expected += "got hello\r\n";
    let (slow, log) = log.into_inner().unwrap();
    assert_eq!(String::from_utf8(slow.shown).unwrap(), expected);
    let log = String::from_utf8(log).unwrap();
    assert_eq!(log.lines().count(), 2001);
    assert!(log.lines().all(|line| line.starts_with("0.000000 ")));
    assert_eq!(terminal.lost(), 0);
}

/// Notes of which incarnation and from which position on it was offered output.
#[derive(Default)]
struct Positions(Vec<(u32, u32, u32, usize)>);

impl Sink for Positions {
    fn take(&mut self, piece: Piece<'_>) -> std::io::Result<usize> {
        let Piece {
            incarnation,
            position,
            ..
        } = piece;
        let count = piece.bytes.len();
        self.0
            .push((incarnation, position, piece.overwritten, count));
        Ok(count)
    }
}

#[test]
fn a_sink_is_told_where_in_an_incarnation_its_output_was() {
    let system = SimSystem::<2>::in_virtual_time(4096);
    let [_, windows] = system.windows(HAND);
    let ram = Region::users(windows.data).unwrap();
    let begin = || {
        let mut allocator = Allocator::new(ram.size());
        Terminal::<_, _, 16>::new(ram.clone(), &mut allocator, 64, CriticalSection).unwrap()
    };
    let terminal = begin();
    let mut host = system.mailbox(HOST).unwrap();
    host.join().unwrap();
    let attach = || TerminalHost::attach(ram.clone(), terminal.offset(), HAND, HOST).unwrap();
    let mut sink = Positions::default();
    let mut tty = attach();
    for _ in 0..3 {
        terminal.accept(b'a').unwrap();
    }
    assert_eq!(tty.serve(&host, &mut sink).unwrap().output, 3);
    // As if it had been killed.
    let mut tty = attach();
    terminal.accept(b'a').unwrap();
    assert_eq!(tty.serve(&host, &mut sink).unwrap().output, 1);
    terminal.set_policy(Policy::DropOld).unwrap();
    for _ in 0..33 {
        terminal.accept(3).unwrap(); // "^C\r\n"
    }
    tty.serve(&host, &mut sink).unwrap();
    let terminal = begin();
    tty.serve(&host, &mut sink).unwrap();
    terminal.accept(b'a').unwrap();
    tty.serve(&host, &mut sink).unwrap();
    let first = sink.0[0].0;
    let last = sink.0[3].0;
    assert_ne!(first, last);
    let expected = [
        (first, 0, 0, 3),
        (first, 3, 0, 1),
        (first, 4 + 68, 68, 64),
        (last, 0, 0, 1),
    ];
    assert_eq!(sink.0, expected);
}

/// What is typed, with the mark by which one host after the other finds what comes next.
struct Keys {
    text: Vec<u8>,
    mark: Option<(u32, u32, usize)>,
    next: Option<usize>,
}

impl Sink for Keys {
    fn take(&mut self, piece: Piece<'_>) -> std::io::Result<usize> {
        Ok(piece.bytes.len())
    }

    fn typed(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let Some(next) = &mut self.next else {
            return Ok(0);
        };
        let rest = &self.text[*next..];
        let count = rest.len().min(into.len());
        into[..count].copy_from_slice(&rest[..count]);
        *next += count;
        Ok(count)
    }

    fn typing(&mut self, incarnation: u32, taken: u32, waiting: usize) -> std::io::Result<()> {
        let offset = match (self.next, self.mark) {
            (Some(next), _) => next - waiting,
            (None, Some((of, then, offset))) if of == incarnation => {
                offset + taken.wrapping_sub(then) as usize
            }
            (None, _) => 0,
        };
        self.mark = Some((incarnation, taken, offset));
        self.next = Some(offset + waiting);
        Ok(())
    }
}

/// Types `text` by hosts that end one after the other, each after a few steps, while the processor's
/// program reads as it comes; gives all that it has read.
fn typed_by_many_hosts(text: &[u8], queue_is_read: impl Fn(u32) -> bool) -> Vec<u8> {
    let system = SimSystem::<2>::in_virtual_time(4096);
    let [_, windows] = system.windows(HAND);
    let ram = Region::users(windows.data).unwrap();
    let mut allocator = Allocator::new(ram.size());
    let terminal =
        Terminal::<_, _, 16>::new(ram.clone(), &mut allocator, 64, CriticalSection).unwrap();
    let receive = |call: &Call<'_>| terminal.receive(call);
    let mut hand = system.mailbox(HAND).unwrap();
    hand.set_vector(TerminalVectors::DEFAULT.input, &receive, "input")
        .unwrap();
    hand.set_vector(TerminalVectors::DEFAULT.room, &receive, "room")
        .unwrap();
    hand.join().unwrap();
    let mut console = terminal.console(&hand).with_read_timeout(Duration::ZERO);
    let mut sink = Keys {
        text: text.to_vec(),
        mark: None,
        next: None,
    };
    let (mut read, mut line) = (Vec::new(), [0; 16]);
    for incarnation in 0_u32..1000 {
        sink.next = None;
        let mut host = system.mailbox(HOST).unwrap();
        host.join().unwrap();
        let mut tty = TerminalHost::attach(ram.clone(), terminal.offset(), HAND, HOST).unwrap();
        for step in 0..incarnation % 23 {
            tty.serve(&host, &mut sink).unwrap();
            if (incarnation + step) % 3 != 0 {
                hand.serve(Duration::ZERO).unwrap();
            }
            while queue_is_read(incarnation) && console.read_ready().unwrap() {
                match console.read(&mut line) {
                    Ok(count) => read.extend(&line[..count]),
                    Err(ConsoleError::Interrupted) => read.extend(b"^C"),
                    Err(error) => panic!("{error}"),
                }
            }
        }
        // As if it had been killed, with whatever was under way.
    }
    read
}

#[test]
fn what_is_typed_is_taken_once_whenever_hosts_are_killed() {
    let lines: Vec<_> = (0..200).map(|number| format!("{number}\n")).collect();
    let text = lines.concat();
    let read = typed_by_many_hosts(text.as_bytes(), |_| true);
    assert_eq!(String::from_utf8(read).unwrap(), text);
}

#[test]
fn what_an_interrupt_has_dropped_is_not_typed_by_the_next_host() {
    // The program reads late, so that most of the first lines wait when somebody interrupts.
    let mut text: Vec<u8> = (0..30).flat_map(|_| *b"forget\n").collect();
    text.extend(b"\x03after\n");
    let read = typed_by_many_hosts(&text, |incarnation| incarnation > 300);
    assert_eq!(String::from_utf8_lossy(&read), "^Cafter\n");
}
