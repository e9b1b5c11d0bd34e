//! Memory that vanishes under a window, and bus errors that are none of its business.
#![cfg(feature = "linux")]

use std::fs::File;
use std::os::unix::process::ExitStatusExt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use crate::linux_child::{Actor, part, say, wait_for_parent};
use condor_mbox::linux::{LinuxWindow, WindowAccess};
use condor_mbox::window::{CompareExchange, WindowError, WindowErrorKind};
use condor_mbox::{LoadOrder, MemoryWindow, StoreOrder};

const BYTES: u32 = 4 * 65536;

fn mapped() -> (File, LinuxWindow) {
    let file = tempfile::tempfile().expect("a temporary file");
    file.set_len(BYTES.into()).expect("it can grow");
    let window =
        LinuxWindow::map(&file, 0, BYTES, WindowAccess::ReadWrite).expect("it can be mapped");
    (file, window)
}

fn is_lost<T, E: WindowError>(result: Result<T, E>) -> bool {
    matches!(result, Err(error) if error.kind() == WindowErrorKind::Lost)
}

#[test]
fn every_access_to_a_truncated_file_is_lost() {
    let accesses: [fn(&LinuxWindow) -> bool; 5] = [
        |window| is_lost(window.load(BYTES - 4, LoadOrder::Relaxed)),
        |window| is_lost(window.store(65536, 1, StoreOrder::Release)),
        |window| is_lost(window.compare_exchange(65536, 0, 1)),
        |window| is_lost(window.read(BYTES - 9 * 4, &mut [0; 36])),
        |window| is_lost(window.write(65536, &[1; 7])),
    ];
    for first in accesses {
        let (file, window) = mapped();
        window
            .store(65536, 1, StoreOrder::Relaxed)
            .expect("the file is there");
        file.set_len(4).expect("it can shrink");
        assert!(first(&window));
        assert!(window.is_lost());
        for access in accesses {
            assert!(access(&window));
        }
        assert!(
            is_lost(window.load(0, LoadOrder::Relaxed)),
            "what is left of the file, too"
        );
        window
            .read(BYTES, &mut [])
            .expect("nothing is there to be lost");
        file.set_len(BYTES.into()).expect("it can grow");
        assert!(
            is_lost(window.load(0, LoadOrder::Relaxed)),
            "also when it is back"
        );
        let again =
            LinuxWindow::map(&file, 0, BYTES, WindowAccess::ReadWrite).expect("it can be mapped");
        again
            .store(65536, 1, StoreOrder::Relaxed)
            .expect("a new window sees the new file");
    }
}

#[test]
fn a_window_for_reading_can_be_lost() {
    let (file, _window) = mapped();
    let window =
        LinuxWindow::map(&file, 65536, 65536, WindowAccess::ReadOnly).expect("it can be mapped");
    file.set_len(0).expect("it can shrink");
    assert!(is_lost(window.load(0, LoadOrder::Acquire)));
    assert!(is_lost(window.read(0, &mut [0; 64])));
}

#[test]
fn lost_windows_leave_others_alone() {
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        let _ends = StopAtEnd(&stop);
        for _ in 0..2 {
            scope.spawn(|| {
                // Mappings come and go beside those that fault, often at their addresses.
                while !stop.load(Ordering::Relaxed) {
                    let (_file, window) = mapped();
                    for offset in (0..BYTES).step_by(4096) {
                        window
                            .store(offset, !offset, StoreOrder::Release)
                            .expect("it is there");
                        let value = window
                            .load(offset, LoadOrder::Acquire)
                            .expect("it is there");
                        assert_eq!(value, !offset);
                    }
                }
            });
        }
        for _ in 0..2000 {
            let (file, window) = mapped();
            let clone = window.clone();
            file.set_len(0).expect("it can shrink");
            // Two threads fault in the same mapping.
            let other = scope.spawn(move || is_lost(clone.load(8, LoadOrder::Relaxed)));
            assert!(is_lost(window.load(4, LoadOrder::Relaxed)));
            assert!(other.join().expect("it does not panic"));
        }
    });
}

/// Ends the other threads also if this one panics.
struct StopAtEnd<'a>(&'a AtomicBool);

impl Drop for StopAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[test]
fn slots_are_used_again() {
    for _ in 0..10_000 {
        drop(mapped());
    }
}

#[test]
fn too_many_windows_are_an_error() {
    let mut actor = Actor::start("fault::the_parts", "too many", |_| {});
    assert_eq!(actor.hear().as_deref(), Some("TooMany { slots: 4096 }"));
}

#[test]
fn a_foreign_bus_error_kills() {
    for part in [
        "foreign fault",
        "foreign fault at default",
        "sent at default",
    ] {
        let mut actor = Actor::start("fault::the_parts", part, |_| {});
        assert_eq!(actor.hear().as_deref(), Some("about to fault"), "{part}");
        actor.release();
        assert_eq!(actor.hear(), None, "{part}: nothing runs after the fault");
        assert_eq!(actor.wait().signal(), Some(libc::SIGBUS), "{part}");
    }
}

#[test]
fn a_foreign_bus_error_reaches_the_handler_that_was_there() {
    for part in ["chained fault", "chained signal", "plain handler"] {
        let mut actor = Actor::start("fault::the_parts", part, |_| {});
        assert_eq!(actor.hear().as_deref(), Some("handled"), "{part}");
    }
}

#[test]
fn a_sent_signal_stays_ignored() {
    let mut actor = Actor::start("fault::the_parts", "ignored", |_| {});
    assert_eq!(actor.hear().as_deref(), Some("still here"));
}

/// What the children do; nothing in the parent.
#[test]
fn the_parts() {
    match part().as_deref() {
        Some("too many") => {
            let file = tempfile::tempfile().expect("a temporary file");
            file.set_len(4096).expect("it can grow");
            let mut windows = Vec::new();
            loop {
                match LinuxWindow::map(&file, 0, 4096, WindowAccess::ReadOnly) {
                    Ok(window) => windows.push(window),
                    Err(error) => return say(&format!("{error:?}")),
                }
            }
        }
        Some("foreign fault") => {
            let _ours = mapped();
            about_to_fault();
            touch_foreign_memory();
            say("went on");
        }
        Some("foreign fault at default") => {
            act_on_bus_errors(libc::SIG_DFL, 0);
            let _ours = mapped();
            about_to_fault();
            touch_foreign_memory();
            say("went on");
        }
        Some("sent at default") => {
            act_on_bus_errors(libc::SIG_DFL, 0);
            let _ours = mapped();
            about_to_fault();
            send_bus_error();
            say("went on");
        }
        Some("chained fault") => {
            act_on_bus_errors(say_and_exit as *const () as usize, libc::SA_SIGINFO);
            let (file, window) = mapped();
            file.set_len(0).expect("it can shrink");
            assert!(
                is_lost(window.load(0, LoadOrder::Relaxed)),
                "ours is not chained"
            );
            touch_foreign_memory();
        }
        Some("chained signal") => {
            act_on_bus_errors(say_and_exit as *const () as usize, libc::SA_SIGINFO);
            let _ours = mapped();
            send_bus_error();
        }
        Some("plain handler") => {
            act_on_bus_errors(say_plainly as *const () as usize, 0);
            let _ours = mapped();
            send_bus_error();
        }
        Some("ignored") => {
            act_on_bus_errors(libc::SIG_IGN, 0);
            let (file, window) = mapped();
            send_bus_error();
            file.set_len(0).expect("it can shrink");
            assert!(is_lost(window.load(0, LoadOrder::Relaxed)));
            say("still here");
        }
        Some(other) => panic!("nobody plays {other}"),
        None => {}
    }
}

fn about_to_fault() {
    say("about to fault");
    wait_for_parent();
}

extern "C" fn say_and_exit(_: i32, info: *mut libc::siginfo_t, _: *mut libc::c_void) {
    assert!(!info.is_null());
    say_plainly(libc::SIGBUS);
}

extern "C" fn say_plainly(signal: i32) {
    assert_eq!(signal, libc::SIGBUS);
    say("handled");
    std::process::exit(0);
}

fn act_on_bus_errors(handler: usize, flags: i32) {
    // SAFETY: all-zero is a valid action; the handlers of this file have the signatures that
    // their flags ask for, and run where nothing is held that they need.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = handler;
        action.sa_flags = flags;
        assert_eq!(
            libc::sigaction(libc::SIGBUS, &raw const action, std::ptr::null_mut()),
            0
        );
    }
}

fn send_bus_error() {
    // SAFETY: a signal to ourselves.
    assert_eq!(unsafe { libc::raise(libc::SIGBUS) }, 0);
}

/// Reads from a mapping that no window knows, of a file that has no memory.
fn touch_foreign_memory() {
    let file = tempfile::tempfile().expect("a temporary file");
    // SAFETY: a new mapping, read as volatile; that the read faults is the point.
    unsafe {
        let memory = rustix::mm::mmap(
            std::ptr::null_mut(),
            4096,
            rustix::mm::ProtFlags::READ,
            rustix::mm::MapFlags::SHARED,
            &file,
            0,
        )
        .expect("an empty file can be mapped");
        let _ = memory.cast::<u32>().read_volatile();
    }
}
