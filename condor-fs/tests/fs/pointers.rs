//! Offsets and lengths that are not in the client's window, and tables that are none, are `EFAULT`, and
//! nothing is touched for their sake.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::cell::Cell;
use std::path::Path;
use std::time::Duration;

use crate::support::{Mail, Own, SERVER, TIMEOUT, disk, with_server};
use condor_fs::wire::{self, Operation, RequestSlot, Span, again, block, slot, table};
use condor_fs::{Errno, OpenOptions};
use condor_mbox::{Allocator, MemoryWindow, Messenger};

const PAUSE: Duration = Duration::from_millis(1);

/// A slot of one's own, for requests that the client would never make, about a file that it opened.
struct Raw<'r, 'v> {
    own: &'r Own,
    mail: &'r Mail<'v>,
    root: &'r Path,
    at: u32,
    /// Where the client's table of open files is.
    table: u32,
    /// The path of the file.
    path: Span,
    session: u64,
    handle: u64,
    sequence: Cell<u64>,
}

/// With a tree that holds one file, of 4096 sevens.
fn with_raw(program: impl FnOnce(&Raw<'_, '_>)) {
    let disk = disk();
    std::fs::write(disk.path().join("file"), [7; 4096]).unwrap();
    with_server(disk.path(), "", |fs, own, allocator, mail| {
        // As `Area` lays it out: behind the slot.
        let table = Allocator::new(own.size())
            .bytes(slot::BYTES as usize)
            .unwrap()
            + slot::BYTES;
        assert_eq!(own.word(table).unwrap(), table::MAGIC);
        let first = own.word(table + 8).unwrap();
        let at = allocator.bytes(slot::BYTES as usize).unwrap();
        let path = allocator.bytes(8).unwrap();
        own.write(path, b"file").unwrap();
        let options = OpenOptions::new().read().write();
        let _file = fs.open("file", options).unwrap();
        let word = |offset: u32| own.word(first + offset).unwrap();
        program(&Raw {
            own,
            mail,
            root: disk.path(),
            at,
            table,
            path: Span {
                offset: path,
                len: 4,
            },
            session: wire::whole(word(block::SESSION), word(block::SESSION + 4)),
            handle: wire::whole(word(block::HANDLE), word(block::HANDLE + 4)),
            sequence: Cell::new(1 << 20),
        });
    });
}

impl Raw<'_, '_> {
    fn request(&self, operation: Operation) -> RequestSlot {
        self.sequence.set(self.sequence.get() + 1);
        RequestSlot {
            session: self.session,
            sequence: self.sequence.get(),
            operation: operation as u32,
            handle: self.handle,
            ..RequestSlot::default()
        }
    }

    /// The errno of the answer, in the reply or in the slot.
    fn ask(&self, request: &RequestSlot) -> Errno {
        self.own.set_word(self.at + slot::STATE, 0).unwrap();
        for (word, n) in request.to_words().into_iter().zip(0..) {
            self.own.set_word(self.at + 4 * n, word).unwrap();
        }
        self.send(self.at)
    }

    fn send(&self, data: u32) -> Errno {
        loop {
            let reply = self
                .mail
                .send_with_reply(SERVER, wire::FILES, data, TIMEOUT)
                .unwrap();
            if reply == wire::DONE || wire::value_of(reply).is_some() {
                return Errno(self.own.word(self.at + slot::ERRNO).unwrap() as u16);
            }
            assert_ne!(reply & wire::REFUSED, 0);
            let errno = Errno((reply & !wire::REFUSED) as u16);
            if errno != Errno::AGAIN {
                return errno;
            }
            // It asks where the table is.
            self.mail.serve(PAUSE).unwrap();
        }
    }

    /// The window, without the slot.
    fn memory(&self) -> Vec<u32> {
        let slot = self.at..self.at + slot::BYTES;
        (0..self.own.size())
            .step_by(4)
            .filter(|at| !slot.contains(at))
            .map(|at| self.own.word(at).unwrap())
            .collect()
    }

    fn check_tree(&self) {
        assert_eq!(std::fs::read(self.root.join("file")).unwrap(), [7; 4096]);
        for entry in std::fs::read_dir(self.root.join(".condor-fs")).unwrap() {
            let name = entry.unwrap().file_name();
            assert!(
                name == "lock" || name == "journal",
                "{} was left",
                name.display()
            );
        }
    }
}

#[test]
fn slots_buffers_and_paths_are_inside_of_the_window() {
    with_raw(|raw| {
        let (size, before) = (raw.own.size(), raw.memory());
        let outside = [size, size - 64, u32::MAX, u32::MAX - 63, 0x8000_0000];
        for at in outside.into_iter().chain([3, 4, raw.at + 32]) {
            assert_eq!(raw.send(at), Errno::FAULT, "slot at {at:#x}");
        }
        for (offset, len) in [
            (size, 1),
            (size - 4, 5),
            (2, 4),
            (0, u32::MAX),
            (u32::MAX - 3, 4),
            (u32::MAX, 0),
            (size + 4, 0),
        ] {
            let span = Span { offset, len };
            for operation in [Operation::Read, Operation::Write, Operation::Append] {
                let buffer = span;
                let errno = raw.ask(&RequestSlot {
                    buffer,
                    ..raw.request(operation)
                });
                assert_eq!(errno, Errno::FAULT, "{operation:?} {span:?}");
            }
            if (1..=wire::MAX_PATH).contains(&len) {
                for operation in [Operation::Open, Operation::Unlink, Operation::PathStatus] {
                    let errno = raw.ask(&RequestSlot {
                        path: span,
                        flags: 1,
                        ..raw.request(operation)
                    });
                    assert_eq!(errno, Errno::FAULT, "{operation:?} {span:?}");
                }
            }
        }
        assert_eq!(raw.memory(), before);
        raw.check_tree();
    });
}

#[test]
fn arguments_that_mean_nothing_are_refused() {
    with_raw(|raw| {
        let path = Span {
            offset: 0,
            len: wire::MAX_PATH + 1,
        };
        let long = RequestSlot {
            path,
            ..raw.request(Operation::Unlink)
        };
        assert_eq!(raw.ask(&long), Errno::NAMETOOLONG);
        let unknown = RequestSlot {
            operation: 99,
            ..raw.request(Operation::Read)
        };
        assert_eq!(raw.ask(&unknown), Errno::NOSYS);
        let buffer = raw.path;
        let stranger = RequestSlot {
            handle: raw.handle + 12_345,
            buffer,
            ..raw.request(Operation::Read)
        };
        assert_eq!(raw.ask(&stranger), Errno::BADF);
        for position in [u64::MAX, u64::MAX - 3, 1 << 63] {
            for operation in [Operation::Read, Operation::Write, Operation::Truncate] {
                let errno = raw.ask(&RequestSlot {
                    position,
                    buffer,
                    ..raw.request(operation)
                });
                assert!(
                    matches!(errno, Errno::INVAL | Errno::FBIG),
                    "{operation:?} at {position:#x}: {errno}"
                );
            }
        }
        raw.check_tree();
    });
}

#[test]
fn a_table_that_is_none_is_found_before_anything_is_touched() {
    with_raw(|raw| {
        for (at, value) in [
            (raw.table, 0),
            (raw.table + 4, wire::MAX_FILES + 1),
            (raw.table + 8, raw.own.size()),
            (raw.table + 12, block::BYTES - 4),
        ] {
            let was = raw.own.word(at).unwrap();
            raw.own.set_word(at, value).unwrap();
            let unlink = RequestSlot {
                path: raw.path,
                ..raw.request(Operation::Unlink)
            };
            assert_eq!(raw.ask(&unlink), Errno::FAULT, "{value:#x} at {at:#x}");
            raw.own.set_word(at, was).unwrap();
            raw.check_tree();
        }
    });
}

/// As far apart as a sequence of 32 bits would go before it came again.
const LAP: u64 = 1 << 32;

#[test]
fn a_handle_is_no_other_one_of_a_lap_later() {
    with_raw(|raw| {
        std::fs::write(raw.root.join("efil"), [9; 8]).unwrap();
        let name = Span {
            offset: raw.path.offset + 64,
            len: 4,
        };
        raw.own.write(name.offset, b"efil").unwrap();
        let open = |path: Span, sequence: u64| {
            let errno = raw.ask(&RequestSlot {
                sequence,
                flags: wire::open::READ,
                path,
                ..raw.request(Operation::Open)
            });
            assert_eq!(errno, Errno(0));
        };
        let (first, second) = (LAP + 5, 2 * LAP + 5);
        open(raw.path, first);
        open(name, second);
        for (handle, byte) in [(first, 7), (second, 9), (first, 7)] {
            let errno = raw.ask(&RequestSlot {
                handle,
                buffer: name,
                ..raw.request(Operation::Read)
            });
            assert_eq!(errno, Errno(0));
            let mut read = [0; 4];
            raw.own.read(name.offset, &mut read).unwrap();
            assert_eq!(read, [byte; 4], "{handle:#x}");
        }
        // Nor is its block another one's.
        let stranger = RequestSlot {
            handle: raw.handle + LAP,
            buffer: name,
            ..raw.request(Operation::Read)
        };
        assert_eq!(raw.ask(&stranger), Errno::BADF);
    });
}

#[test]
fn a_file_that_was_set_aside_is_no_other_one_of_a_lap_later() {
    with_raw(|raw| {
        let unlink = |sequence: u64| {
            raw.ask(&RequestSlot {
                sequence,
                path: raw.path,
                ..raw.request(Operation::Unlink)
            })
        };
        // It is open, and set aside.
        assert_eq!(unlink(LAP + 5), Errno(0));
        std::fs::write(raw.root.join("file"), b"new").unwrap();
        assert_eq!(unlink(2 * LAP + 5), Errno(0));
        assert!(!raw.root.join("file").exists());
        let errno = raw.ask(&RequestSlot {
            buffer: raw.path,
            ..raw.request(Operation::Read)
        });
        assert_eq!(errno, Errno(0));
        let mut read = [0; 4];
        raw.own.read(raw.path.offset, &mut read).unwrap();
        assert_eq!(read, [7; 4]);
    });
}

#[test]
fn a_message_may_say_alone_what_changes() {
    with_raw(|raw| {
        let first = RequestSlot {
            position: 4090,
            buffer: Span {
                offset: raw.path.offset,
                len: 4,
            },
            ..raw.request(Operation::Read)
        };
        let bits = |how: u32, after: u64| how | ((first.sequence + after) as u32 % 16) << 2;
        let reply = |bits: u32| {
            let message = raw.at | bits;
            (raw.mail)
                .send_with_reply(SERVER, wire::FILES, message, TIMEOUT)
                .unwrap()
        };
        let again = wire::REFUSED | u32::from(Errno::AGAIN.0);
        assert_eq!(reply(bits(again::SAME, 1)), again, "of which request?");
        for wrong in [bits(again::SAME, 2), bits(again::SAME, 4)] {
            assert_eq!(raw.ask(&first), Errno(0));
            assert_eq!(reply(bits(again::ONWARDS, 1)), wire::with_value(2));
            assert_eq!(reply(bits(again::SAME, 2)), wire::with_value(2));
            let done = [0, 4].map(|at| raw.own.word(raw.at + slot::STATE_SEQUENCE + at));
            assert_eq!(done.map(Result::unwrap), wire::halves(first.sequence + 2));
            assert_eq!(reply(wrong), again);
            assert_eq!(reply(bits(again::SAME, 3)), again, "it is forgotten");
        }
        for none in [0, again::SAME | again::ONWARDS] {
            let fault = wire::REFUSED | u32::from(Errno::FAULT.0);
            assert_eq!(reply(bits(none, 3)), fault);
        }
    });
}
