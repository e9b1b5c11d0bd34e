//! The promises of `LinuxWindow`, apart from memory that vanishes.
#![cfg(feature = "linux")]

use std::fs::File;
use std::io::Write;

use condor_mbox::linux::{LinuxWindow, WindowAccess, WindowMapError};
use condor_mbox::window::{CompareExchange, WindowError, WindowErrorKind};
use condor_mbox::{LoadOrder, MemoryWindow, StoreOrder};

fn file_of(bytes: u64) -> File {
    let file = tempfile::tempfile().expect("a temporary file");
    file.set_len(bytes).expect("it can grow");
    file
}

fn window_of(bytes: u32, access: WindowAccess) -> LinuxWindow {
    LinuxWindow::map(file_of(bytes.into()), 0, bytes, access).expect("it can be mapped")
}

fn kind<T: std::fmt::Debug, E: WindowError>(result: Result<T, E>) -> WindowErrorKind {
    result.expect_err("it is refused").kind()
}

#[test]
fn accesses_outside_or_misaligned_are_refused() {
    use WindowErrorKind::{Misaligned, OutOfBounds};
    let window = window_of(128, WindowAccess::ReadWrite);
    let cases = [
        (128, OutOfBounds),
        (132, OutOfBounds),
        (u32::MAX - 3, OutOfBounds),
        (1, Misaligned),
        (126, Misaligned),
        (127, Misaligned),
        (u32::MAX, Misaligned),
    ];
    for (offset, expected) in cases {
        assert_eq!(
            kind(window.load(offset, LoadOrder::Acquire)),
            expected,
            "load {offset}"
        );
        assert_eq!(
            kind(window.store(offset, 1, StoreOrder::Release)),
            expected,
            "store {offset}"
        );
        assert_eq!(
            kind(window.compare_exchange(offset, 0, 1)),
            expected,
            "exchange {offset}"
        );
        assert_eq!(
            kind(window.read(offset, &mut [0; 4])),
            expected,
            "read {offset}"
        );
        assert_eq!(
            kind(window.write(offset, &[1; 4])),
            expected,
            "write {offset}"
        );
    }
    assert_eq!(kind(window.read(124, &mut [0; 5])), OutOfBounds);
    assert_eq!(kind(window.write(0, &[1; 129])), OutOfBounds);
    assert_eq!(kind(window.read(2, &mut [])), Misaligned);
    assert_eq!(kind(window.read(132, &mut [])), OutOfBounds);
    window
        .read(128, &mut [])
        .expect("nothing at the end is inside");
    let mut all = [1; 128];
    window.read(0, &mut all).expect("it is inside");
    assert_eq!(all, [0; 128], "nothing was written");
}

#[test]
fn a_window_for_reading_refuses_to_write() {
    let window = window_of(64, WindowAccess::ReadOnly);
    assert_eq!(
        window.load(60, LoadOrder::Relaxed).expect("it can be read"),
        0
    );
    let read_only = WindowErrorKind::ReadOnly;
    assert_eq!(kind(window.store(0, 1, StoreOrder::Relaxed)), read_only);
    assert_eq!(kind(window.compare_exchange(0, 0, 1)), read_only);
    assert_eq!(kind(window.write(0, &[1])), read_only);
    window
        .write(64, &[])
        .expect("writing nothing is always possible");
}

#[test]
fn the_error_tells_the_access() {
    let window = window_of(64, WindowAccess::ReadWrite);
    let error = window.read(60, &mut [0; 8]).expect_err("it is outside");
    assert_eq!((error.offset, error.len, error.size), (60, 8, 64));
    assert_eq!(
        error.to_string(),
        "cannot access 8 bytes at offset 0x3c of a memory of 0x40 bytes: the range is not wholly inside the window"
    );
}

#[test]
fn words_are_little_endian_and_parts_of_words_are_kept() {
    let window = window_of(64, WindowAccess::ReadWrite);
    window
        .write(4, &[1, 2, 3, 4, 5, 6, 7])
        .expect("it is inside");
    assert_eq!(
        window.load(4, LoadOrder::Relaxed).expect("it is inside"),
        0x0403_0201
    );
    window.write(4, &[9]).expect("it is inside");
    assert_eq!(
        window.load(4, LoadOrder::Relaxed).expect("it is inside"),
        0x0403_0209
    );
    let mut bytes = [0; 7];
    window.read(4, &mut bytes).expect("it is inside");
    assert_eq!(bytes, [9, 2, 3, 4, 5, 6, 7]);
}

#[test]
fn compare_exchange_gives_what_was_there() {
    let window = window_of(64, WindowAccess::ReadWrite);
    assert_eq!(window.compare_exchange(8, 0, 5).expect("it is inside"), 0);
    assert_eq!(window.compare_exchange(8, 0, 6).expect("it is inside"), 5);
    assert_eq!(window.load(8, LoadOrder::Acquire).expect("it is inside"), 5);
}

#[test]
fn a_window_may_begin_anywhere_and_is_shared() {
    let file = file_of(3 * 65536);
    let whole = LinuxWindow::map(&file, 0, 3 * 65536, WindowAccess::ReadWrite).expect("it maps");
    let part =
        LinuxWindow::map(&file, 65536 + 4, 65536 + 8, WindowAccess::ReadWrite).expect("it maps");
    assert_eq!(part.size(), 65536 + 8);
    part.store(65536 + 4, 7, StoreOrder::Release)
        .expect("it is inside");
    assert_eq!(
        whole
            .load(2 * 65536 + 8, LoadOrder::Acquire)
            .expect("it is inside"),
        7
    );
    drop(part);
    let clone = whole.clone();
    drop(whole);
    assert_eq!(
        clone
            .load(2 * 65536 + 8, LoadOrder::Acquire)
            .expect("it is mapped"),
        7
    );
}

#[test]
fn ranges_that_cannot_be_windows_are_refused_with_their_values() {
    let file = file_of(4096);
    let map = |offset, len| {
        LinuxWindow::map(&file, offset, len, WindowAccess::ReadWrite).expect_err("it is refused")
    };
    for (offset, len) in [(0, 0), (0, 6), (2, 8)] {
        let error = map(offset, len);
        assert!(
            matches!(error, WindowMapError::NotWords { offset: o, len: l } if o == offset && l == u64::from(len)),
            "{error}"
        );
    }
    let error = map(4092, 8);
    assert!(
        matches!(
            error,
            WindowMapError::TooShort {
                needed: 4100,
                found: 4096
            }
        ),
        "{error}"
    );
    let error = map(u64::MAX - 3, 8);
    assert!(matches!(error, WindowMapError::TooLarge { .. }), "{error}");
}

#[test]
fn what_cannot_be_mapped_is_refused() {
    let (reader, mut writer) = std::io::pipe().expect("a pipe");
    writer.write_all(&[0; 64]).expect("it has room");
    let error =
        LinuxWindow::map(reader, 0, 64, WindowAccess::ReadOnly).expect_err("no pipe is mapped");
    assert!(matches!(error, WindowMapError::System { .. }), "{error}");
    let error = LinuxWindow::uio(u32::MAX, 0, WindowAccess::ReadOnly).expect_err("no such device");
    assert!(matches!(error, WindowMapError::System { .. }), "{error}");
}

#[test]
fn long_copies_are_copies_of_all_words() {
    let window = window_of(4096, WindowAccess::ReadWrite);
    for (offset, len) in [(0, 4096_u32), (4, 1027), (60, 130), (12, 64), (8, 3)] {
        for at in (0..4096).step_by(4) {
            window.store(at, u32::MAX, StoreOrder::Relaxed).unwrap();
        }
        let from: Vec<u8> = (0..len).map(|at| (at * 7 % 251) as u8).collect();
        window.write(offset, &from).unwrap();
        let (start, end) = (offset as usize, offset as usize + from.len());
        let found: Vec<u8> = (0..4096)
            .step_by(4)
            .flat_map(|at| window.load(at, LoadOrder::Relaxed).unwrap().to_le_bytes())
            .collect();
        assert_eq!(found[start..end], from, "{len} bytes at {offset}");
        let mut others = found[..start].iter().chain(&found[end..]);
        assert!(others.all(|byte| *byte == 0xff), "{len} bytes at {offset}");

        let mut into = vec![0; from.len()];
        window.read(offset, &mut into).unwrap();
        assert_eq!(into, from, "{len} bytes at {offset}");
    }
}
