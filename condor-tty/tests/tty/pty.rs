//! A terminal on a pseudo-terminal that a program opens, reads, writes and leaves.
#![cfg(feature = "linux")]

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::fd::AsFd;

use condor_tty::linux::{Pty, Sink};
use rustix::event::{PollFd, PollFlags};

fn open(pty: &Pty) -> File {
    OpenOptions::new()
        .read(true)
        .write(true)
        .open(pty.path())
        .unwrap()
}

#[test]
fn a_program_reads_what_is_written_and_types() {
    let mut pty = Pty::open().unwrap();
    assert_eq!(
        (pty.take(b"nobody".into()).unwrap(), pty.discarded()),
        (6, 6)
    );
    let mut program = open(&pty);
    assert_eq!(pty.take(b"ready\r\n> ".into()).unwrap(), 9);
    let mut bytes = [0; 9];
    program.read_exact(&mut bytes).unwrap();
    assert_eq!(&bytes, b"ready\r\n> ");
    // Every character at once, none of them treated by the kernel, no echo.
    program.write_all(b"\x03\x04x\r").unwrap();
    let mut polled = [PollFd::new(&pty, PollFlags::IN)];
    rustix::event::poll(&mut polled, None).unwrap();
    let mut typed = [0; 16];
    assert_eq!(pty.typed(&mut typed).unwrap(), 4);
    assert_eq!(&typed[..4], b"\x03\x04x\r");
    assert_eq!(pty.typed(&mut typed).unwrap(), 0);
    drop(program);
    assert_eq!((pty.typed(&mut typed).unwrap(), pty.discarded()), (0, 6));
    let _again = open(&pty);
    assert_eq!((pty.take(b"x".into()).unwrap(), pty.discarded()), (1, 6));
}

#[test]
fn what_a_full_one_does_not_take_is_kept() {
    let mut pty = Pty::open().unwrap();
    let mut program = open(&pty);
    let text: Vec<u8> = (0..200_000_u32)
        .map(|index| b'a' + (index % 23) as u8)
        .collect();
    let mut taken = 0;
    loop {
        let count = pty.take((&text[taken..]).into()).unwrap();
        if count == 0 {
            break;
        }
        taken += count;
    }
    assert!(taken < text.len(), "nobody has read");
    let mut read: Vec<u8> = Vec::new();
    while read.len() < text.len() {
        taken += pty.take((&text[taken..]).into()).unwrap();
        let mut polled = [PollFd::new(&program, PollFlags::IN)];
        rustix::event::poll(&mut polled, None).unwrap();
        let mut bytes = [0; 4096];
        let count = program.read(&mut bytes).unwrap();
        read.extend(&bytes[..count]);
    }
    assert_eq!(read, text);
}

#[test]
fn one_that_nobody_watches_discards() {
    let mut pty = Pty::open().unwrap();
    assert_eq!(pty.take((&vec![b'a'; 100_000]).into()).unwrap(), 100_000);
    assert_eq!(
        (pty.discarded(), pty.is_watched().unwrap()),
        (100_000, false)
    );
    let _program = open(&pty);
    assert!(pty.is_watched().unwrap());
    assert!(pty.as_fd().try_clone_to_owned().is_ok());
}
