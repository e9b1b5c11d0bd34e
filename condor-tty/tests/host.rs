//! A processor and a host as two threads, with mailboxes between them.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use condor_mbox::sim::System;
use condor_mbox::{Call, CriticalSection, Processor, Region};
use condor_tty::linux::{Host, Log, Sink, Tee};
use condor_tty::{ConsoleError, Policy, Settings, Terminal, Vectors};
use embedded_io::{Read, Write};

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
    let terminal =
        Terminal::<_, _, 16>::new(ram.clone(), &mut ram.places(), 64, CriticalSection).unwrap();
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
struct Places(Vec<(u32, u32)>);

impl Sink for Places {
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
    let begin =
        || Terminal::<_, _, 16>::new(ram.clone(), &mut ram.places(), 64, CriticalSection).unwrap();
    let terminal = begin();
    let mut host = system.mailbox(HOST).unwrap();
    host.join().unwrap();
    let attach = |sink| Host::attach(ram.clone(), terminal.offset(), HAND, HOST, sink).unwrap();
    let mut tty = attach(Tee::new(Places::default(), Box::<Places>::default()));
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
