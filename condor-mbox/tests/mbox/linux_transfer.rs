//! The kernel moves data between a file and a window, inside of the window only.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::fs::File;
use std::io::{Seek, Write};

use condor_mbox::MemoryWindow;
use condor_mbox::linux::{LinuxWindow, WindowAccess};

fn file_of(bytes: &[u8]) -> File {
    let mut file = tempfile::tempfile().expect("a temporary file");
    file.write_all(bytes).expect("it is written");
    file.rewind().expect("it is a file");
    file
}

#[test]
fn data_go_both_ways() {
    let memory = file_of(&[0; 4096]);
    let window = LinuxWindow::map(&memory, 4, 1024, WindowAccess::ReadWrite).expect("it is mapped");
    let file = file_of(b"0123456789");
    assert_eq!(window.read_file(&file, 2, 8, 100).expect("it is read"), 8);
    let mut read = [0; 12];
    window.read(4, &mut read).expect("it is inside");
    assert_eq!(&read, b"\0\0\0\x0023456789");
    assert_eq!(window.write_file(&file, 9, 8, 3).expect("it is written"), 3);
    assert_eq!(window.read_file(&file, 0, 0, 100).expect("it is read"), 12);
    window.read(0, &mut read).expect("it is inside");
    assert_eq!(&read, b"012345678234");
}

#[test]
fn what_is_not_inside_is_a_bad_address() {
    let memory = file_of(&[0; 4096]);
    let window = LinuxWindow::map(&memory, 0, 1024, WindowAccess::ReadWrite).expect("it is mapped");
    let file = file_of(&[1; 4096]);
    for (offset, len) in [
        (1024, 1),
        (1020, 5),
        (2, 4),
        (u32::MAX - 3, 8),
        (0, usize::MAX),
    ] {
        for result in [
            window.read_file(&file, 0, offset, len),
            window.write_file(&file, 0, offset, len),
        ] {
            let error = result.expect_err("it is not inside");
            assert_eq!(
                error.raw_os_error(),
                Some(libc::EFAULT),
                "{len} at {offset}"
            );
        }
    }
    assert_eq!(
        window.read_file(&file, 0, 1020, 4).expect("it is inside"),
        4
    );
    assert_eq!(
        window.read_file(&file, 0, 1024, 0).expect("it is nothing"),
        0
    );
    let error = window
        .read_file(&file, u64::MAX, 0, 4)
        .expect_err("there is no such position");
    assert_eq!(error.raw_os_error(), Some(libc::EINVAL));

    let window = LinuxWindow::map(&memory, 0, 1024, WindowAccess::ReadOnly).expect("it is mapped");
    let error = window
        .read_file(&file, 0, 0, 4)
        .expect_err("it is read-only");
    assert_eq!(error.raw_os_error(), Some(libc::EFAULT));
    assert_eq!(
        window.write_file(&file, 0, 0, 4).expect("it can be read"),
        4
    );
}

#[test]
fn memory_that_is_gone_is_a_bad_address() {
    let memory = file_of(&[0; 8192]);
    let window = LinuxWindow::map(&memory, 0, 8192, WindowAccess::ReadWrite).expect("it is mapped");
    let file = file_of(&[1; 8192]);
    memory.set_len(0).expect("it is truncated");
    for result in [
        window.read_file(&file, 0, 4096, 4),
        window.write_file(&file, 0, 4096, 4),
    ] {
        let error = result.expect_err("the memory is gone");
        assert_eq!(error.raw_os_error(), Some(libc::EFAULT));
    }
}
