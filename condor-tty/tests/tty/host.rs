//! A processor and a host as two threads, with mailboxes between them.
#![cfg(feature = "linux")]

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use condor_mbox::sim::System;
use condor_mbox::{Call, CriticalSection, MemoryWindow, Messenger, Places, Processor, Region};
use condor_tty::linux::{Host, Log, Sink, Tee};
use condor_tty::{ConsoleError, Policy, Settings, Terminal, Vectors};
use embedded_io::{Read, ReadReady, Write};

const HOST: Processor = Processor(0);
const HAND: Processor = Processor(1);
const LONG: Duration = Duration::from_secs(60);
const SHORT: Duration = Duration::from_millis(2);

/// Takes a few bytes at a time, and sometimes none.
#[derive(Default)]
struct Slow(Vec<u8>, usize);

impl Sink for Slow {
    fn take(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.1 += 1;
        let count = bytes.len().min(self.1 * 7 % 100);
        self.0.extend(&bytes[..count]);
        Ok(count)
    }
}

#[test]
fn output_arrives_whole_and_input_is_answered() {
    let system = System::<2>::in_real_time(4096);
    let [_, windows] = system.windows(HAND);
    let ram = Region::users(windows.data).unwrap();
    let mut places = Places::new(ram.size());
    let terminal =
        Terminal::<_, _, 16>::new(ram.clone(), &mut places, 64, CriticalSection).unwrap();
    terminal
        .set_policy(Policy::Block { timeout: LONG })
        .unwrap();
    let echo = false;
    terminal
        .configure(&Settings {
            echo,
            ..Settings::COOKED
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
    hand.set_vector(Vectors::DEFAULT.input, &receive, "input")
        .unwrap();
    hand.set_vector(Vectors::DEFAULT.room, &receive, "room")
        .unwrap();
    hand.join().unwrap();
    let mut host = system.mailbox(HOST).unwrap();
    host.set_vector(Vectors::DEFAULT.output, &|_| 0, "output")
        .unwrap();
    host.join().unwrap();

    let sink = Tee::new(Slow::default(), Log::new(Vec::new(), Duration::default));
    let mut tty = Host::attach(ram, terminal.offset(), HAND, HOST, sink).unwrap();
    let (done, at_prompt, terminal, interrupts) = (&done, &at_prompt, &terminal, &interrupts);
    let sink = std::thread::scope(|threads| {
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
        tty.type_in(b"hello\n").unwrap();
        let mut typed = false;
        while !done.load(Ordering::Acquire) {
            tty.serve(&host).unwrap();
            host.serve(SHORT).unwrap();
            if at_prompt.load(Ordering::Acquire) && !typed {
                typed = true;
                tty.type_in(b"first\nsecond\nthird\n").unwrap();
            }
            if typed && tty.status().unwrap().full {
                assert!(tty.waiting_input() > 0);
                tty.type_in(b"\x03").unwrap();
            }
        }
        assert_eq!(interrupts.load(Ordering::Relaxed), 1);
        at_prompt.store(false, Ordering::Release);
        tty.detach().unwrap()
    });
    let mut expected = String::new();
    for number in 0..2000 {
        expected.extend(["line ", &number.to_string(), "\r\n"]);
    }
    expected += "got hello\r\n";
    assert_eq!(String::from_utf8(sink.first.0).unwrap(), expected);
    let log = String::from_utf8(sink.second.into_inner().unwrap()).unwrap();
    assert_eq!(log.lines().count(), 2001);
    assert!(log.lines().all(|line| line.starts_with("0.000000 ")));
    assert_eq!(terminal.lost(), 0);
}

/// Notes where its hosts have attached.
#[derive(Default)]
struct Attachments(Vec<(u32, u32)>);

impl Sink for Attachments {
    fn take(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        Ok(bytes.len())
    }

    fn attached(&mut self, life: u32, position: u32) {
        self.0.push((life, position));
    }
}

#[test]
fn a_sink_is_told_where_its_host_attaches() {
    let system = System::<2>::in_virtual_time(4096);
    let [_, windows] = system.windows(HAND);
    let ram = Region::users(windows.data).unwrap();
    let begin = || {
        let mut places = Places::new(ram.size());
        Terminal::<_, _, 16>::new(ram.clone(), &mut places, 64, CriticalSection).unwrap()
    };
    let terminal = begin();
    let mut host = system.mailbox(HOST).unwrap();
    host.join().unwrap();
    let attach = |sink| Host::attach(ram.clone(), terminal.offset(), HAND, HOST, sink).unwrap();
    let mut tty = attach(Tee::new(
        Attachments::default(),
        Box::<Attachments>::default(),
    ));
    for _ in 0..3 {
        terminal.accept(b'a').unwrap();
    }
    assert_eq!(tty.serve(&host).unwrap().output, 3);
    // As if it had been killed.
    let mut tty = attach(tty.sink);
    terminal.accept(b'a').unwrap();
    assert_eq!(tty.serve(&host).unwrap().output, 1);
    begin();
    tty.serve(&host).unwrap();
    let Tee { first, second, .. } = tty.sink;
    let lives: Vec<_> = first.0.iter().map(|(life, _)| life).collect();
    let positions: Vec<_> = first.0.iter().map(|(_, position)| *position).collect();
    assert_eq!(positions, [0, 3, 0]);
    assert!(lives[0] == lives[1] && lives[1] != lives[2], "{lives:?}");
    assert_eq!(first.0, second.0);
}

/// What is typed, with the mark by which one host after the other finds what comes next.
struct Keys {
    text: Vec<u8>,
    mark: Option<(u32, u32, usize)>,
    next: Option<usize>,
}

impl Sink for Keys {
    fn take(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        Ok(bytes.len())
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

    fn typing(&mut self, life: u32, taken: u32, waiting: usize) -> std::io::Result<()> {
        let offset = match (self.mark, self.next) {
            (Some((of, then, offset)), _) if of == life => {
                offset + taken.wrapping_sub(then) as usize
            }
            (_, next) => next.unwrap_or(0) - waiting,
        };
        self.mark = Some((life, taken, offset));
        self.next = Some(offset + waiting);
        Ok(())
    }

    fn dropped(&mut self, taken: u32, count: usize) -> std::io::Result<()> {
        let (life, then, offset) = self.mark.unwrap();
        let offset = offset + taken.wrapping_sub(then) as usize + count;
        self.mark = Some((life, taken, offset));
        Ok(())
    }
}

/// Types `text` by hosts that end one after the other, each after a few steps, while the processor's
/// program reads as it comes; gives all that it has read.
fn typed_by_many_hosts(text: &[u8], queue_is_read: impl Fn(u32) -> bool) -> Vec<u8> {
    let system = System::<2>::in_virtual_time(4096);
    let [_, windows] = system.windows(HAND);
    let ram = Region::users(windows.data).unwrap();
    let mut places = Places::new(ram.size());
    let terminal =
        Terminal::<_, _, 16>::new(ram.clone(), &mut places, 64, CriticalSection).unwrap();
    let receive = |call: &Call<'_>| terminal.receive(call);
    let mut hand = system.mailbox(HAND).unwrap();
    hand.set_vector(Vectors::DEFAULT.input, &receive, "input")
        .unwrap();
    hand.set_vector(Vectors::DEFAULT.room, &receive, "room")
        .unwrap();
    hand.join().unwrap();
    let mut console = terminal.console(&hand).with_read_timeout(Duration::ZERO);
    let mut sink = Keys {
        text: text.to_vec(),
        mark: None,
        next: None,
    };
    let (mut read, mut line) = (Vec::new(), [0; 16]);
    for life in 0_u32..1000 {
        sink.next = None;
        let mut host = system.mailbox(HOST).unwrap();
        host.join().unwrap();
        let mut tty = Host::attach(ram.clone(), terminal.offset(), HAND, HOST, sink).unwrap();
        for step in 0..life % 23 {
            tty.serve(&host).unwrap();
            if (life + step) % 3 != 0 {
                hand.serve(Duration::ZERO).unwrap();
            }
            while queue_is_read(life) && console.read_ready().unwrap() {
                match console.read(&mut line) {
                    Ok(count) => read.extend(&line[..count]),
                    Err(ConsoleError::Interrupted) => read.extend(b"^C"),
                    Err(error) => panic!("{error}"),
                }
            }
        }
        // As if it had been killed, with whatever was under way.
        sink = tty.sink;
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
    let read = typed_by_many_hosts(&text, |life| life > 300);
    assert_eq!(String::from_utf8_lossy(&read), "^Cafter\n");
}
