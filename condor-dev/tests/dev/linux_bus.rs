//! Registers behind mappings, which vanish, beside the handlers of others.
#![cfg(all(feature = "linux", target_os = "linux", target_arch = "x86_64"))]

use std::fs::File;
use std::os::unix::process::ExitStatusExt as _;
use std::process::Command;

use condor_dev::linux::{BusMapError, LinuxBus, MapAccess};
use condor_dev::{
    Bus, BusAccessError, BusErrorKind, Location, NoInterrupts, OpenError, OpenMode, Presence,
    Switch, device_switch,
};
use condor_mbox::linux::{LinuxWindow, WindowAccess};
use condor_mbox::{LoadOrder, MemoryWindow as _};
use utah_mit_boards::Adc16;

const BASE: usize = 0xee00_0000;
const BYTES: usize = 0x4000;

fn mapped(access: MapAccess) -> (File, LinuxBus) {
    let file = tempfile::tempfile().unwrap();
    file.set_len(BYTES as u64).unwrap();
    let bus = LinuxBus::map(&file, 0, BASE, BYTES, access).unwrap();
    (file, bus)
}

fn kind<T: std::fmt::Debug>(result: Result<T, BusAccessError>) -> BusErrorKind {
    result.unwrap_err().kind
}

type Call = fn(&LinuxBus, usize) -> Result<u32, BusAccessError>;

const READS: [Call; 3] = [
    |bus, at| bus.read8(at).map(u32::from),
    |bus, at| bus.read16(at).map(u32::from),
    |bus, at| bus.read32(at),
];
const WRITES: [Call; 3] = [
    |bus, at| bus.write8(at, 0x5a).map(|()| 0x5a),
    |bus, at| bus.write16(at, 0x5a5b).map(|()| 0x5a5b),
    |bus, at| bus.write32(at, 0x5a5b_5c5d).map(|()| 0x5a5b_5c5d),
];

#[test]
fn each_width_is_read_as_it_was_written() {
    let (file, bus) = mapped(MapAccess::ReadWrite);
    let same = LinuxBus::map(&file, 0x1004, 0x100, 0x10, MapAccess::ReadOnly).unwrap();
    for (read, write) in READS.into_iter().zip(WRITES) {
        let written = write(&bus, BASE + 0x1008).unwrap();
        assert_eq!(read(&bus, BASE + 0x1008), Ok(written));
        assert_eq!(
            read(&same, 0x104),
            Ok(written),
            "another window, another base"
        );
    }
    assert_eq!(bus.read8(BASE + 0x100c), Ok(0), "nothing beside it");
    assert_eq!(kind(bus.read8(BASE - 1)), BusErrorKind::OutOfRange);
    assert_eq!(kind(bus.read8(BASE + BYTES)), BusErrorKind::OutOfRange);
    assert_eq!(kind(bus.write32(BASE + 2, 0)), BusErrorKind::Misaligned);
    assert_eq!(kind(same.write8(0x104, 0)), BusErrorKind::ReadOnly);
    let buses = (same, bus);
    assert_eq!(buses.read32(0x104), buses.read32(BASE + 0x1008));
    assert_eq!(kind(buses.read32(0x200)), BusErrorKind::OutOfRange);
}

#[cfg(feature = "conformance")]
#[test]
fn conforms() {
    use condor_dev::conformance::{BusMemory, bus as suite};

    let (file, bus) = mapped(MapAccess::ReadWrite);
    file.set_len(0x1000).unwrap();
    let ground = |memory, absent| BusMemory {
        memory,
        absent: Some(absent),
        refuses_misaligned: true,
    };
    suite(&bus, ground(BASE + 0x10, BASE + 0x2000)).unwrap();
    suite(&bus, ground(BASE, BASE + BYTES)).unwrap();
    suite(&(bus.clone(), bus), ground(BASE + 0xff8, BASE - 8)).unwrap();
}

#[test]
fn what_was_truncated_is_lost_and_the_rest_is_not() {
    let (file, bus) = mapped(MapAccess::ReadWrite);
    bus.write32(BASE, 7).unwrap();
    file.set_len(0x1000).unwrap();
    for access in READS.into_iter().chain(WRITES) {
        assert_eq!(kind(access(&bus, BASE + 0x2000)), BusErrorKind::Lost);
    }
    assert_eq!(bus.read32(BASE), Ok(7));
    file.set_len(BYTES as u64).unwrap();
    assert_eq!(bus.read32(BASE + 0x2000), Ok(0), "it is there again");
}

#[test]
fn many_threads_lose_at_once() {
    let (file, bus) = mapped(MapAccess::ReadWrite);
    let (_keeps, other) = mapped(MapAccess::ReadWrite);
    file.set_len(0).unwrap();
    std::thread::scope(|threads| {
        for thread in 0..4_u32 {
            let (bus, other) = (bus.clone(), &other);
            threads.spawn(move || {
                let at = BASE + 4 * thread as usize;
                for count in 0..2000 {
                    assert_eq!(kind(bus.read32(at)), BusErrorKind::Lost);
                    other.write32(at, count).unwrap();
                    assert_eq!(other.read32(at), Ok(count));
                }
            });
        }
    });
}

device_switch! {
    struct Boards {
        adc: Adc16 = [Location::at(BASE + 0x100), Location::at(BASE + 0x2000)],
    }
}

#[test]
fn an_unchanged_driver_finds_the_boards_that_are_there() {
    let (file, bus) = mapped(MapAccess::ReadWrite);
    bus.write16(BASE + 0x100, 0xadc0).unwrap();
    bus.write16(BASE + 0x126, 1234).unwrap();
    file.set_len(0x1000).unwrap();
    let switch: Switch<_, _, _, 2> = Switch::new(bus, NoInterrupts, Boards::new());
    switch.start();
    let absent = OpenError::NotPresent {
        name: "adc",
        board: 1,
        presence: Presence::Absent,
    };
    assert_eq!(switch.open("adc", 1, OpenMode::READ), Err(absent));
    let fd = switch.open("adc", 0, OpenMode::READ).unwrap();
    let mut channels = [0; 16];
    let adc = switch.device(Boards::adc, fd).unwrap();
    adc.scan(adc.registers, &mut channels).unwrap();
    assert_eq!(channels[3], 1234);
    file.set_len(0).unwrap();
    assert_eq!(
        kind(adc.scan(adc.registers, &mut channels)),
        BusErrorKind::Lost
    );
}

#[test]
fn what_cannot_be_mapped_says_why() {
    let file = tempfile::tempfile().unwrap();
    file.set_len(0x100).unwrap();
    let map = |offset, base, len| LinuxBus::map(&file, offset, base, len, MapAccess::ReadOnly);
    let misaligned = |result| matches!(result, Err(BusMapError::Misaligned { .. }));
    assert!(misaligned(map(2, 0, 4)) && misaligned(map(0, 2, 4)) && misaligned(map(0, 0, 0)));
    let large = |result| matches!(result, Err(BusMapError::TooLarge { .. }));
    assert!(large(map(u64::MAX - 3, 0, 8)) && large(map(0, usize::MAX - 3, 8)));
    assert!(matches!(
        map(0x80, 0, 0x84),
        Err(BusMapError::TooShort {
            needed: 0x104,
            found: 0x100
        })
    ));
    assert!(matches!(
        LinuxBus::uio(u32::MAX, 0, MapAccess::ReadOnly),
        Err(BusMapError::System { .. })
    ));
}

/// A window of a mailbox has a handler of its own for the same signal.
#[test]
fn windows_and_buses_are_lost_in_one_program() {
    for part in ["the window's handler first", "the bus's handler first"] {
        let ended = play(part);
        assert!(ended.success(), "{part}: {ended}");
    }
}

#[test]
fn a_bus_error_of_somebody_else_still_kills() {
    for part in ["a foreign fault", "a sent signal"] {
        assert_eq!(play(part).signal(), Some(libc::SIGBUS), "{part}");
    }
}

#[test]
fn the_handler_that_was_there_is_called() {
    for part in ["a fault of its own", "a signal for it"] {
        assert_eq!(play(part).code(), Some(77), "{part}");
    }
}

const PART: &str = "CONDOR_TEST_PART";

/// Runs this program again, in which nothing has installed a handler yet.
fn play(part: &str) -> std::process::ExitStatus {
    Command::new(std::env::current_exe().unwrap())
        .args(["linux_bus::the_parts", "--exact"])
        .env(PART, part)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .status()
        .unwrap()
}

/// What the children do; nothing in the parent.
#[test]
fn the_parts() {
    match std::env::var(PART).as_deref() {
        Ok("the window's handler first") => {
            let window = window();
            let bus = mapped(MapAccess::ReadWrite);
            both_are_lost(&bus, &window);
        }
        Ok("the bus's handler first") => {
            let bus = mapped(MapAccess::ReadWrite);
            let window = window();
            both_are_lost(&bus, &window);
        }
        Ok("a foreign fault") => {
            let _ours = mapped(MapAccess::ReadWrite);
            touch_foreign_memory();
        }
        Ok("a sent signal") => {
            // Rust's own handler would let it pass.
            handle_bus_errors(libc::SIG_DFL);
            let _ours = mapped(MapAccess::ReadWrite);
            send_bus_error();
        }
        Ok("a fault of its own") => {
            handle_bus_errors(exit_77 as *const () as usize);
            let (file, bus) = mapped(MapAccess::ReadWrite);
            file.set_len(0).unwrap();
            assert_eq!(kind(bus.read8(BASE)), BusErrorKind::Lost, "not for him");
            touch_foreign_memory();
        }
        Ok("a signal for it") => {
            handle_bus_errors(exit_77 as *const () as usize);
            let _ours = mapped(MapAccess::ReadWrite);
            send_bus_error();
        }
        Ok(other) => panic!("nobody plays {other}"),
        Err(_) => {}
    }
}

fn window() -> (File, LinuxWindow) {
    let file = tempfile::tempfile().unwrap();
    file.set_len(BYTES as u64).unwrap();
    let window = LinuxWindow::map(&file, 0, BYTES as u32, WindowAccess::ReadWrite).unwrap();
    (file, window)
}

fn both_are_lost(bus: &(File, LinuxBus), window: &(File, LinuxWindow)) {
    let ((bus_file, bus), (window_file, window)) = (bus, window);
    for _ in 0..10 {
        bus_file.set_len(0).unwrap();
        assert_eq!(kind(bus.read32(BASE + 0x1000)), BusErrorKind::Lost);
        assert!(window.load(0, LoadOrder::Acquire).is_ok());
        bus_file.set_len(BYTES as u64).unwrap();
        assert_eq!(bus.read32(BASE + 0x1000), Ok(0));
    }
    window_file.set_len(0).unwrap();
    assert!(window.load(0, LoadOrder::Acquire).is_err());
    assert_eq!(bus.read32(BASE + 0x1000), Ok(0));
    bus_file.set_len(0).unwrap();
    assert_eq!(kind(bus.write8(BASE, 0)), BusErrorKind::Lost);
}

extern "C" fn exit_77(_: i32, info: *mut libc::siginfo_t, _: *mut libc::c_void) {
    assert!(!info.is_null());
    // SAFETY: it ends the program at once.
    unsafe { libc::_exit(77) };
}

fn handle_bus_errors(handler: libc::sighandler_t) {
    // SAFETY: all-zero is a valid action, and `exit_77` has the signature that the flags ask for.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = handler;
        action.sa_flags = libc::SA_SIGINFO;
        let done = libc::sigaction(libc::SIGBUS, &raw const action, std::ptr::null_mut());
        assert_eq!(done, 0);
    }
}

fn send_bus_error() {
    // SAFETY: a signal to ourselves.
    assert_eq!(unsafe { libc::raise(libc::SIGBUS) }, 0);
}

/// Reads from a mapping that no bus knows, of a file that has no memory.
fn touch_foreign_memory() {
    let file = tempfile::tempfile().unwrap();
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
        .unwrap();
        let _ = memory.cast::<u32>().read_volatile();
    }
}
