//! Buffered readers and writers against a model, with errors, short writes and timeouts anywhere.
#![cfg(all(feature = "hostile", target_os = "linux"))]

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};

use crate::peer::{BUFFER, Own, Pair, TIMEOUT};
use condor_fs::wire::{self, Operation};
use condor_fs::{Errno, FileError, OpenOptions};
use condor_mbox::MemoryWindow;
use embedded_io::{BufRead, Read, Seek, SeekFrom, Write};
use proptest::collection::vec;
use proptest::prelude::*;

/// A host with one file, which is open.
#[derive(Default)]
struct Disk {
    file: Vec<u8>,
    /// What the next reads and writes meet.
    faults: VecDeque<Fault>,
    transfers: usize,
}

#[derive(Clone, Copy, Debug)]
enum Fault {
    Fine,
    /// Fewer bytes are moved.
    Short(u8),
    Fails,
}

type Shared = Arc<Mutex<Disk>>;

fn lock(disk: &Shared) -> MutexGuard<'_, Disk> {
    disk.lock().unwrap()
}

impl Disk {
    fn answer(&mut self, own: &Own, slot: u32) -> u32 {
        let request = crate::peer::request(own, slot).unwrap();
        // As every server: what is recorded is not done again.
        let done = own.word(slot + wire::slot::STATE).unwrap() == wire::state::DONE
            && u64::from(own.word(slot + wire::slot::STATE_SEQUENCE).unwrap()) == request.sequence;
        if !done {
            let outcome = self.act(own, &request);
            crate::peer::record(own, slot, &request, outcome);
        }
        wire::DONE
    }

    fn act(&mut self, own: &Own, request: &wire::RequestSlot) -> Result<u64, u16> {
        let size = self.file.len() as u64;
        let (buffer, position) = (request.buffer, request.position);
        let mut bytes = vec![0; buffer.len as usize];
        let position = match Operation::from_word(request.operation).unwrap() {
            Operation::Session => return Ok(1),
            Operation::Open | Operation::Close => return Ok(0),
            Operation::FileStatus => {
                // Only the size is looked at, which is the first two words of the status.
                return Ok(0);
            }
            Operation::Append => size,
            _ => position,
        };
        let mut most = bytes.len();
        self.transfers += 1;
        match self.faults.pop_front().unwrap_or(Fault::Fine) {
            Fault::Fine => {}
            Fault::Short(len) => most = most.min(usize::from(len) + 1),
            Fault::Fails => return Err(Errno::NOSPC.0),
        }
        let begin = usize::try_from(position).unwrap();
        if request.operation == Operation::Read as u32 {
            let end = (begin + most).min(self.file.len());
            let read = self.file.get(begin..end).unwrap_or_default();
            own.write(buffer.offset, read).unwrap();
            return Ok(read.len() as u64);
        }
        own.read(buffer.offset, &mut bytes).unwrap();
        let end = begin + most;
        self.file.resize(self.file.len().max(end), 0);
        self.file[begin..end].copy_from_slice(&bytes[..most]);
        Ok(most as u64)
    }
}

fn with_disk<R>(disk: &Shared, program: impl FnOnce(&Pair) -> R) -> R {
    let shared = disk.clone();
    crate::peer::run(move |own, slot| lock(&shared).answer(own, slot), program)
}

#[derive(Clone, Debug)]
enum Act {
    Write(Vec<u8>),
    Read(usize),
    FillAndConsume(usize),
    Flush,
    Seek(u64),
    Back(u8),
    /// The host stops until one more act has been tried.
    Stall,
    Fault(Fault),
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        Just(Fault::Fine),
        any::<u8>().prop_map(|n| Fault::Short(n % 24)),
        Just(Fault::Fails),
    ]
}

fn write_act() -> impl Strategy<Value = Act> {
    prop_oneof![
        8 => vec(any::<u8>(), 0..60).prop_map(Act::Write),
        2 => Just(Act::Flush),
        1 => (0_u64..400).prop_map(Act::Seek),
        2 => Just(Act::Stall),
        3 => fault().prop_map(Act::Fault),
    ]
}

fn read_act() -> impl Strategy<Value = Act> {
    prop_oneof![
        6 => (0_usize..30).prop_map(Act::Read),
        6 => (0_usize..12).prop_map(Act::FillAndConsume),
        1 => (0_u64..400).prop_map(Act::Seek),
        1 => any::<u8>().prop_map(|n| Act::Back(n % 8)),
        2 => Just(Act::Stall),
        2 => fault().prop_map(Act::Fault),
    ]
}

/// Whether the error is one of those that were asked for.
fn expected(error: &FileError) -> bool {
    matches!(
        error,
        FileError::Errno(Errno::NOSPC) | FileError::TimedOut { .. } | FileError::NotBegun { .. }
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn every_byte_is_written_once(acts in vec(write_act(), 0..90), append in any::<bool>()) {
        let disk = Shared::default();
        let mut model = Vec::new();
        let mut at = 0_usize;
        let outcome = with_disk(&disk, |pair| {
            let fs = pair.connect().unwrap();
            let mut options = OpenOptions::new().write().create();
            if append {
                options = options.append();
            }
            let mut writer = fs.open("file", options).unwrap().writer();
            for act in acts {
                let stalled = matches!(act, Act::Stall | Act::Fault(_));
                match act {
                    Act::Write(bytes) => match writer.write(&bytes) {
                        Ok(taken) => {
                            prop_assert_eq!(taken == 0, bytes.is_empty());
                            let end = at + taken;
                            if taken > 0 {
                                model.resize(model.len().max(end), 0);
                                model[at..end].copy_from_slice(&bytes[..taken]);
                            }
                            at = end;
                        }
                        Err(error) => prop_assert!(expected(&error), "{error}"),
                    },
                    Act::Flush => match writer.flush() {
                        Ok(()) => prop_assert_eq!(&lock(&disk).file, &model),
                        Err(error) => prop_assert!(expected(&error), "{error}"),
                    },
                    Act::Seek(to) if !append => match writer.seek(SeekFrom::Start(to)) {
                        Ok(position) => at = usize::try_from(position).unwrap(),
                        Err(error) => prop_assert!(expected(&error), "{error}"),
                    },
                    Act::Stall => pair.stall(true),
                    Act::Fault(fault) => lock(&disk).faults.push_back(fault),
                    _ => {}
                }
                if !stalled {
                    pair.stall(false);
                }
                prop_assert!(writer.held() <= BUFFER);
            }
            // The writer comes back as long as there is something to lose.
            pair.stall(false);
            let mut closing = Some(writer);
            while let Some(writer) = closing.take() {
                match writer.close() {
                    Ok(()) => {}
                    Err(unwritten) => {
                        prop_assert!(expected(&unwritten.error), "{unwritten}");
                        closing = unwritten.writer;
                        prop_assert!(closing.is_some());
                    }
                }
            }
            Ok(())
        });
        outcome?;
        prop_assert_eq!(&lock(&disk).file, &model);
    }

    #[test]
    fn every_byte_is_read_once(acts in vec(read_act(), 0..90), file in vec(any::<u8>(), 0..600)) {
        let disk = Shared::default();
        lock(&disk).file.clone_from(&file);
        let mut at = 0_usize;
        with_disk(&disk, |pair| {
            let fs = pair.connect().unwrap();
            let mut reader = fs.open("file", OpenOptions::new().read()).unwrap().reader::<8>();
            for act in acts {
                let left = file.get(at..).unwrap_or_default();
                let stalled = matches!(act, Act::Stall | Act::Fault(_));
                match act {
                    Act::Read(len) => {
                        let mut into = vec![0; len];
                        match reader.read(&mut into) {
                            Ok(read) => {
                                prop_assert_eq!(&into[..read], &left[..read]);
                                prop_assert_eq!(read == 0, len == 0 || left.is_empty());
                                at += read;
                            }
                            Err(error) => prop_assert!(expected(&error), "{error}"),
                        }
                    }
                    Act::FillAndConsume(len) => match reader.fill_buf() {
                        Ok(bytes) => {
                            prop_assert_eq!(bytes, &left[..bytes.len()]);
                            prop_assert_eq!(bytes.is_empty(), left.is_empty());
                            at += len.min(bytes.len());
                            reader.consume(len);
                        }
                        Err(error) => prop_assert!(expected(&error), "{error}"),
                    },
                    Act::Seek(to) => match reader.seek(SeekFrom::Start(to)) {
                        Ok(position) => at = usize::try_from(position).unwrap(),
                        Err(error) => prop_assert!(expected(&error), "{error}"),
                    },
                    Act::Back(step) => match reader.seek(SeekFrom::Current(-i64::from(step))) {
                        Ok(position) => at = usize::try_from(position).unwrap(),
                        Err(FileError::Errno(Errno::INVAL)) => prop_assert!(usize::from(step) > at),
                        Err(error) => prop_assert!(expected(&error), "{error}"),
                    },
                    Act::Stall => pair.stall(true),
                    Act::Fault(fault) => lock(&disk).faults.push_back(fault),
                    Act::Write(_) | Act::Flush => {}
                }
                if !stalled {
                    pair.stall(false);
                }
                // A read in doubt moves it when it has ended.
                if !fs.in_doubt() {
                    prop_assert_eq!(reader.stream_position().ok(), Some(at as u64));
                }
            }
            Ok(())
        })?;
    }
}

#[test]
fn small_transfers_become_few() {
    let disk = Shared::default();
    with_disk(&disk, |pair| {
        let fs = pair.connect().unwrap();
        let options = OpenOptions::new().write().read().create();
        let mut writer = fs.open("file", options).unwrap().writer();
        for n in 0..100_u8 {
            writer.write_all(&[n]).unwrap();
        }
        assert_eq!((writer.held(), lock(&disk).file.len()), (4, 96));
        writer.flush().unwrap();
        assert_eq!(lock(&disk).transfers, 100_usize.div_ceil(BUFFER as usize));
        let mut file = writer.into_inner().unwrap();
        file.seek(SeekFrom::Start(0)).unwrap();
        lock(&disk).transfers = 0;
        let mut reader = file.reader::<4>();
        for n in 0..100_u8 {
            let mut byte = [0];
            reader.read_exact(&mut byte).unwrap();
            assert_eq!(byte, [n]);
        }
        assert_eq!(lock(&disk).transfers, 5);
    });
}

#[test]
fn what_cannot_be_written_is_reported_and_kept() {
    let disk = Shared::default();
    with_disk(&disk, |pair| {
        let fs = pair.connect().unwrap();
        let mut log = fs
            .open("log", OpenOptions::new().append())
            .unwrap()
            .writer();
        log.write_all(b"tendon 3 ").unwrap();
        lock(&disk).faults.extend([Fault::Short(2), Fault::Fails]);
        let unwritten = log.close().unwrap_err();
        assert_eq!(unwritten.to_string(), "No space left (ENOSPC)");
        let mut log = unwritten.writer.unwrap();
        assert_eq!((log.held(), &lock(&disk).file[..]), (6, &b"ten"[..]));
        log.write_all(b"is slack").unwrap();

        // In doubt: neither is it written again, nor does its buffer change meanwhile.
        pair.stall(true);
        fs.set_timeout(TIMEOUT / 2);
        assert!(matches!(log.flush(), Err(FileError::TimedOut { .. })));
        assert!(matches!(log.write(b"!"), Err(FileError::NotBegun { .. })));
        pair.stall(false);
        log.write_all(b"!").unwrap();
        assert_eq!(
            (log.held(), &lock(&disk).file[..]),
            (1, &b"tendon 3 is slack"[..])
        );
        log.close().unwrap();
        assert_eq!(lock(&disk).file, b"tendon 3 is slack!");
    });
}
