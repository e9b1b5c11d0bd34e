//! What a person types, what the program reads, and what the person sees.
#![cfg(feature = "hostile")]

use crate::support::{Board, HOST};
use condor_mbox::sim::SimWindow;
use condor_mbox::{Allocator, MemoryWindow, Region, SingleContext};
use condor_tty::{ConsoleError, InputResult, Terminal, TerminalReader, TerminalSettings};
use embedded_io::{BufRead, Read, ReadReady, Write};

type Hand = Terminal<SimWindow, SingleContext, 8>;

fn hand() -> (SimWindow, Hand) {
    let memory = SimWindow::new(1024);
    let region = Region::whole(memory.clone());
    let mut allocator = Allocator::new(region.size());
    let terminal = Terminal::new(region, &mut allocator, 512, SingleContext::new()).unwrap();
    (memory, terminal)
}

fn shown(memory: &SimWindow) -> String {
    let mut reader = TerminalReader::attach(Region::whole(memory.clone()), 0, HOST).unwrap();
    let mut bytes = [0; 512];
    let fetched = reader.fetch(&mut bytes).unwrap();
    reader.acknowledge(fetched.len).unwrap();
    String::from_utf8(bytes[..fetched.len].to_vec()).unwrap()
}

fn type_in(terminal: &Hand, text: &str) {
    for byte in text.bytes() {
        assert_ne!(
            terminal.accept(byte).unwrap(),
            InputResult::Full,
            "{text:?}"
        );
    }
}

#[test]
fn a_closed_terminal_leaves_what_is_typed_to_the_host() {
    let (memory, hand) = hand();
    hand.configure(&TerminalSettings::OUTPUT).unwrap();
    for character in *b"a\n\x03" {
        assert_eq!(hand.accept(character), Ok(InputResult::Full));
    }
    let reader = TerminalReader::attach(Region::whole(memory.clone()), 0, HOST).unwrap();
    let status = reader.status().unwrap();
    assert!(status.full && status.interrupt.is_none(), "{status:?}");
    assert_eq!(hand.settings(), TerminalSettings::OUTPUT);
    hand.configure(&TerminalSettings::COOKED).unwrap();
    assert!(!reader.status().unwrap().full);
    type_in(&hand, "b\n");
    assert_eq!(reads(&hand), ["b\n"]);
    assert_eq!(shown(&memory), "b\r\n");
}

#[test]
fn in_cbreak_mode_each_character_comes_at_once_and_interrupts_stay() {
    let (memory, hand) = hand();
    hand.configure(&TerminalSettings::CBREAK).unwrap();
    assert_eq!(hand.settings(), TerminalSettings::CBREAK);
    let reader = TerminalReader::attach(Region::whole(memory.clone()), 0, HOST).unwrap();
    let status = reader.status().unwrap();
    assert_eq!((status.cooked, status.interrupt), (false, Some(3)));
    type_in(&hand, "a\x7f\t\n");
    assert_eq!(reads(&hand), ["a\x7f\t\n"]);
    assert_eq!(hand.accept(0x13), Ok(InputResult::Taken));
    assert!(reader.status().unwrap().stopped);
    assert_eq!(hand.accept(0x11), Ok(InputResult::Taken));
    type_in(&hand, "12345678");
    assert_eq!(hand.accept(b'9'), Ok(InputResult::Full));
    assert_eq!(hand.accept(3), Ok(InputResult::Interrupts));
    assert!(hand.take_interrupt());
    assert!(reads(&hand).is_empty());
    assert_eq!(shown(&memory), "");
}

/// What reads give until there is nothing.
fn reads(terminal: &Hand) -> Vec<String> {
    let board = Board::new();
    let mut console = terminal.console(&board);
    let mut found = Vec::new();
    let mut bytes = [0; 32];
    while console.read_ready().unwrap() {
        let count = console.read(&mut bytes).unwrap();
        found.push(String::from_utf8(bytes[..count].to_vec()).unwrap());
    }
    found
}

#[test]
fn lines_are_edited() {
    let wipe = "\x08 \x08";
    let table: &[(&str, &[&str], String)] = &[
        ("hi\n", &["hi\n"], "hi\r\n".into()),
        ("hi\r", &["hi\n"], "hi\r\n".into()),
        ("a\nb\n", &["a\n", "b\n"], "a\r\nb\r\n".into()),
        ("unread", &[], "unread".into()),
        ("ab\x7fc\n", &["ac\n"], format!("ab{wipe}c\r\n")),
        (
            "ab\x08\x08\x08c\n",
            &["c\n"],
            format!("ab{wipe}{wipe}c\r\n"),
        ),
        ("a\n\x7fb\n", &["a\n", "b\n"], "a\r\nb\r\n".into()),
        ("aé\x7f\n", &["a\n"], format!("aé{wipe}\r\n")),
        ("a\x01\x7f\n", &["a\n"], format!("a^A{wipe}{wipe}\r\n")),
        ("a\tb\n", &["a\tb\n"], "a b\r\n".into()),
        (
            "a bc \x17d\n",
            &["a d\n"],
            format!("a bc {wipe}{wipe}{wipe}d\r\n"),
        ),
        (
            "abc\x15d\n",
            &["d\n"],
            format!("abc{wipe}{wipe}{wipe}d\r\n"),
        ),
        ("ab\x04", &["ab"], "ab".into()),
        ("\x04", &[""], String::new()),
        ("ab\x04\x04c\n", &["ab", "", "c\n"], "abc\r\n".into()),
        ("a\x13b\x11\n", &["ab\n"], "ab\r\n".into()),
    ];
    for (typed, read, seen) in table {
        let (memory, terminal) = hand();
        type_in(&terminal, typed);
        assert_eq!(reads(&terminal), *read, "{typed:?}");
        assert_eq!(shown(&memory), *seen, "{typed:?}");
    }
}

#[test]
fn raw_mode_gives_every_character_at_once() {
    let (memory, terminal) = hand();
    type_in(&terminal, "ab");
    terminal.configure(&TerminalSettings::RAW).unwrap();
    type_in(&terminal, "\x7f\x03\x04\r");
    assert_eq!(reads(&terminal), ["ab\x7f\x03\x04\r"]);
    assert_eq!(shown(&memory), "ab");
}

#[test]
fn nothing_is_shown_without_echo() {
    let (memory, terminal) = hand();
    let echo = false;
    terminal
        .configure(&TerminalSettings {
            echo,
            ..TerminalSettings::COOKED
        })
        .unwrap();
    type_in(&terminal, "key\x7f\x7f\x03no\n");
    assert!(terminal.take_interrupt());
    assert_eq!(
        (reads(&terminal), shown(&memory)),
        (vec!["no\n".into()], String::new())
    );
}

#[test]
fn a_full_queue_refuses_until_the_program_reads() {
    let (memory, terminal) = hand();
    let full = || {
        TerminalReader::attach(Region::whole(memory.clone()), 0, HOST)
            .unwrap()
            .status()
            .unwrap()
            .full
    };
    type_in(&terminal, "abc\ndef");
    assert_eq!(terminal.accept(b'g').unwrap(), InputResult::Full);
    assert!(full());
    // The last place is for the end of the line.
    type_in(&terminal, "\n");
    assert_eq!(terminal.accept(b'\n').unwrap(), InputResult::Full);
    let board = Board::new();
    let mut four = [0; 4];
    assert_eq!(terminal.console(&board).read(&mut four).unwrap(), 4);
    // The host, which keeps a character, is told.
    assert_eq!((full(), board.rings.get()), (false, 1));
    type_in(&terminal, "gh\n");
    assert_eq!(reads(&terminal), ["def\n", "gh\n"]);
}

#[test]
fn a_line_longer_than_the_queue_can_still_be_ended() {
    let (memory, terminal) = hand();
    type_in(&terminal, "123456789");
    assert_eq!(terminal.overlong(), 2);
    type_in(&terminal, "\x7fx\n");
    assert_eq!(reads(&terminal), ["123456x\n"]);
    assert_eq!(shown(&memory), "1234567\x07\x07\x08 \x08x\r\n");
}

#[test]
fn an_interrupt_passes_a_full_queue() {
    let (memory, terminal) = hand();
    type_in(&terminal, "abc\ndef\n");
    assert_eq!(terminal.accept(b'x').unwrap(), InputResult::Full);
    assert_eq!(terminal.accept(3).unwrap(), InputResult::Interrupts);
    let board = Board::new();
    let mut bytes = [0; 8];
    let read = terminal.console(&board).read(&mut bytes);
    assert_eq!(read, Err(ConsoleError::Interrupted));
    type_in(&terminal, "new\n");
    assert_eq!(reads(&terminal), ["new\n"]);
    assert!(shown(&memory).ends_with("^C\r\nnew\r\n"));
}

#[test]
fn a_person_stops_the_output() {
    let (memory, terminal) = hand();
    let reader = TerminalReader::attach(Region::whole(memory), 0, HOST).unwrap();
    let stopped = || reader.status().unwrap().stopped;
    for (typed, now) in [
        ("\x13", true),
        ("a", true),
        ("\x11", false),
        ("\x13", true),
        ("\x03", false),
    ] {
        type_in(&terminal, typed);
        assert_eq!(stopped(), now, "{typed:?}");
    }
}

#[test]
fn reads_time_out_and_buffered_ones_hold_the_rest() {
    let (_, terminal) = hand();
    let board = Board::new();
    let mut console = terminal.console(&board);
    assert_eq!(
        console.read(&mut [0; 4]),
        Err(ConsoleError::TimedOut { lost: 0 })
    );
    assert_eq!(board.now_ns(), 1_000_000_000);
    type_in(&terminal, "hello\n");
    assert_eq!(console.fill_buf().unwrap(), b"hello\n");
    console.consume(2);
    let mut three = [0; 3];
    assert_eq!((console.read(&mut three), &three), (Ok(3), b"llo"));
    assert_eq!(console.fill_buf().unwrap(), b"\n");
    console.consume(9);
    type_in(&terminal, "\x04");
    assert_eq!(console.fill_buf().unwrap(), b"");
}

#[test]
fn newlines_are_as_terminals_want_them() {
    let (memory, terminal) = hand();
    let board = Board::new();
    write!(terminal.console(&board), "{} rad\n\n{}", 0.25, 1).unwrap();
    assert_eq!(shown(&memory), "0.25 rad\r\n\r\n1");
}

#[test]
fn half_a_newline_is_never_written() {
    let memory = SimWindow::new(512);
    let region = Region::whole(memory.clone());
    let mut allocator = Allocator::new(region.size());
    let terminal: Hand = Terminal::new(region, &mut allocator, 8, SingleContext::new()).unwrap();
    let board = Board::new();
    assert_eq!(terminal.poster(&board).post(b"1234567\n9").unwrap(), 7);
    assert_eq!((terminal.lost(), shown(&memory)), (2, "1234567".into()));
}
