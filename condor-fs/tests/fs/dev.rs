//! Files by the names and descriptors of a device switch, and its stdio over them.
#![cfg(all(feature = "dev", feature = "linux", target_os = "linux"))]

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crate::support::{CLIENT, FILES, Mail, N, Supervisor, disk};
use condor_dev::sim::SimBus;
use condor_dev::stdio::{self, BufReader, BufWriter, BufferedOutput, Buffering, ReadLine};
use condor_dev::stream::{Descriptors, DeviceStream, DeviceStreamError, looks};
use condor_dev::{
    BusError, BusErrorKind, Fd, FdError, IoError, Location, NoInterrupts, OpenMode, Switch,
    device_switch,
};
use condor_fs::dev::{FileOpenError, FileSwitch, TransferError};
use condor_fs::{Errno, FileError, OpenOptions};
use condor_mbox::linux::{LinuxSystem, LinuxWindow};
use embedded_io::{Read, SeekFrom, Write};
use utah_mit_boards::Adc16;
use utah_mit_boards::sim::AdcModel;

device_switch! {
    struct Boards {
        adc: Adc16 = [Location::at(0x1000)],
    }
}

const BOARD_FDS: usize = 2;

type Devices = Switch<SimBus, NoInterrupts, Boards, BOARD_FDS>;
type Files<'d, 'm> =
    FileSwitch<'d, 'm, SimBus, NoInterrupts, Boards, Mail<'m>, LinuxWindow, BOARD_FDS, FILES>;

fn devices() -> Devices {
    let bus = SimBus::new();
    let mut adc = AdcModel::default();
    adc.channels[0] = 0x1234;
    bus.insert(0x1000, adc);
    let devices = Devices::new(bus, NoInterrupts, Boards::new());
    devices.start();
    devices
}

fn with_switch(
    system: &Arc<LinuxSystem<N>>,
    root: &Path,
    options: &'static str,
    program: impl FnOnce(&Files<'_, '_>, &Supervisor),
) {
    let supervisor = Supervisor::start(system, root, None, options);
    crate::support::with_own_client(system, CLIENT, |files, _, _, _| {
        let devices = devices();
        program(&FileSwitch::new(&devices, files), &supervisor);
    });
}

fn file_error(
    outcome: Result<usize, IoError<TransferError<<SimBus as condor_dev::Bus>::Error>>>,
) -> Errno {
    match outcome {
        Err(IoError::Bus(TransferError::File(FileError::Errno(errno)))) => errno,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_name_leads_to_a_file_or_to_a_board() {
    let disk = disk();
    std::fs::write(disk.path().join("hand.txt"), b"four fingers\nfour joints\n").unwrap();
    with_switch(
        &crate::support::system(),
        disk.path(),
        "",
        |switch, supervisor| {
            let board = switch.open(":adc", 0, OpenMode::READ).unwrap();
            let file = switch.open(":fs/hand.txt", 0, OpenMode::READ).unwrap();
            assert_ne!(board.number(), file.number());
            let mut bytes = [0; 12];
            assert_eq!(switch.read(board, &mut bytes[..2]), Ok(2));
            assert_eq!(bytes[..2], 0x1234_u16.to_ne_bytes());
            assert_eq!(switch.read(file, &mut bytes), Ok(12));
            assert_eq!(&bytes, b"four fingers");

            // Over the death of a server, like every file.
            supervisor.kill();
            let at = switch.with_file(file, |file| file.seek(SeekFrom::Start(5)));
            assert_eq!(at, Ok(5));
            assert_eq!(switch.read(file, &mut bytes[..7]), Ok(7));
            assert_eq!(&bytes[..7], b"fingers");
            let size = switch.with_file(file, |file| Ok(file.status()?.size));
            assert_eq!(size, Ok(25));

            switch.close(board).unwrap();
            switch.close(file).unwrap();
        },
    );
}

#[test]
fn every_misuse_has_its_error() {
    let disk = disk();
    std::fs::write(disk.path().join("a"), b"a").unwrap();
    with_switch(&crate::support::system(), disk.path(), "", |switch, _| {
        for (name, board, mode, expected) in [
            (
                "nothing",
                0,
                OpenMode::READ,
                "there is no device nothing; the devices are: adc",
            ),
            (
                ":fs/none",
                0,
                OpenMode::READ,
                ":fs/none: No such file or directory (ENOENT)",
            ),
            (
                "fs/../a",
                0,
                OpenMode::READ,
                "fs/../a: The path is outside of the served tree, or on another filesystem (EXDEV)",
            ),
            (
                ":fs/a",
                1,
                OpenMode::READ,
                "there is no :fs/a board 1: the program has 1, numbered from 0",
            ),
        ] {
            let error = switch.open(name, board, mode).unwrap_err();
            assert_eq!(error.to_string(), expected);
        }
        for mode in [OpenMode::empty(), OpenMode::READ | OpenMode::EXCLUSIVE] {
            let error = switch.open("fs/a", 0, mode).unwrap_err();
            let name = "fs/a";
            assert_eq!(
                error,
                FileOpenError::Device(condor_dev::OpenError::Direction { name, mode })
            );
        }

        let fd = switch.open("fs/a", 0, OpenMode::READ).unwrap();
        let (opened, wanted) = (OpenMode::READ, OpenMode::WRITE);
        let direction = FdError::Direction { fd, wanted, opened };
        assert_eq!(switch.write(fd, b"x"), Err(direction.into()));
        let foreign = Fd::new((BOARD_FDS + FILES) as u16, 0);
        let none = FdError::Closed { fd: foreign };
        assert_eq!(switch.close(foreign), Err(none.into()));
        switch.close(fd).unwrap();
        let mut byte = [0];
        let closed = Err(FdError::Closed { fd }.into());
        assert_eq!(switch.read(fd, &mut byte), closed);
        let again = switch.open("fs/a", 0, OpenMode::READ).unwrap();
        assert_eq!(again.number(), fd.number());
        assert_eq!(switch.close(fd), Err(FdError::Closed { fd }.into()));
        assert_eq!(switch.read(again, &mut byte), Ok(1));

        let files: Vec<_> = (1..FILES)
            .map(|_| switch.open("fs/a", 0, OpenMode::READ).unwrap())
            .collect();
        let many = switch.open("fs/a", 0, OpenMode::READ).unwrap_err();
        let error = FileError::Errno(Errno::MFILE);
        assert_eq!(
            many,
            FileOpenError::File {
                name: "fs/a",
                error
            }
        );
        for fd in files {
            switch.close(fd).unwrap();
        }
        // In the middle of another use: what an interrupt of this context finds.
        switch.with_system(|_| {
            assert_eq!(switch.read(again, &mut byte), Err(IoError::WouldBlock));
            assert_eq!(switch.read_ready(again), Ok(false));
        });
        assert_eq!(switch.read_ready(again), Ok(true));
    });
}

#[test]
fn errors_of_files_keep_their_numbers() {
    let disk = disk();
    with_switch(
        &crate::support::system(),
        disk.path(),
        "max-file=1000",
        |switch, _| {
            let fd = switch.open("fs/log", 0, OpenMode::WRITE).unwrap();
            assert_eq!(switch.write(fd, &[b'x'; 1000]), Ok(1000));
            let outcome = switch.write(fd, b"y");
            let Err(IoError::Bus(error)) = outcome else {
                panic!("{outcome:?}");
            };
            assert_eq!(error.kind(), BusErrorKind::OutOfRange);
            assert_eq!(file_error(outcome), Errno::FBIG);
            let mut stream = DeviceStream::new(switch, fd, looks(0));
            let error = stream.write(b"y").unwrap_err();
            assert_eq!(error, DeviceStreamError::Io(outcome.unwrap_err()));
        },
    );
}

#[test]
fn stdio_works_over_files() {
    let disk = disk();
    let at = |name: &str| disk.path().join(name);
    std::fs::write(at("hand.txt"), b"four fingers\n\nfour joints").unwrap();
    with_switch(&crate::support::system(), disk.path(), "", |switch, _| {
        let fd = switch.open("fs/hand.txt", 0, OpenMode::READ).unwrap();
        let mut reader = BufReader::<_, 5>::new(DeviceStream::new(switch, fd, looks(0)));
        let mut line = [0; 32];
        for expected in ["four fingers\n", "\n", "four joints", ""] {
            assert_eq!(reader.read_line(&mut line).unwrap(), expected);
        }
        assert_eq!(reader.read(&mut line), Ok(0));

        std::fs::write(at("log"), b"old\n").unwrap();
        let fd = switch.open("fs/log", 0, OpenMode::WRITE).unwrap();
        let stream = DeviceStream::new(switch, fd, looks(0));
        let mut writer = BufWriter::<_, 64>::new(stream, Buffering::Block);
        for n in 0..3 {
            writeln!(writer, "tendon {n}").unwrap();
        }
        assert_eq!(std::fs::read(at("log")).unwrap(), b"old\n");
        writer.flush().unwrap();
        switch.close(fd).unwrap();
        assert_eq!(
            std::fs::read(at("log")).unwrap(),
            b"old\ntendon 0\ntendon 1\ntendon 2\n"
        );
        let options = OpenOptions::new().write().truncate();
        let fd = switch.open_file("log", options).unwrap();
        assert_eq!(switch.write(fd, b"new"), Ok(3));
        assert_eq!(std::fs::read(at("log")).unwrap(), b"new");
    });
}

type Log = DeviceStream<'static, Files<'static, 'static>, fn(u32) -> bool>;

static OUTPUT: BufferedOutput<Log, 128> = BufferedOutput::new(Buffering::Line);

/// What a program's start-up does, where all this is in `static`s.
#[test]
fn what_is_printed_is_a_file_of_the_host() {
    let disk = disk();
    let system = crate::support::system();
    let _supervisor = Supervisor::start(&system, disk.path(), None, "");
    let mut claim = system.claim(CLIENT).unwrap();
    let own = condor_mbox::Region::users(claim.windows()[CLIENT.index()].data.clone()).unwrap();
    let mut allocator = claim.places().unwrap();
    let area = condor_fs::Area::<FILES>::new(&mut allocator, 300, 4096).unwrap();
    let handler = Box::leak(Box::new(area.handler()));
    let mut mail = claim.mailbox().unwrap();
    let vector = condor_fs::wire::OPEN_FILES;
    mail.set_vector(vector, handler, "open files").unwrap();
    mail.join().unwrap();
    let mail: &'static Mail<'static> = Box::leak(Box::new(mail));
    let timeout = Duration::from_secs(60);
    let system =
        condor_fs::FileSystem::connect(mail, crate::support::SERVER, own, area, timeout).unwrap();
    let devices: &'static Devices = Box::leak(Box::new(devices()));
    let switch: &'static Files<'_, '_> = Box::leak(Box::new(FileSwitch::new(devices, system)));

    let fd = switch.open(":fs/run.log", 0, OpenMode::WRITE).unwrap();
    let once: fn(u32) -> bool = |_| false;
    OUTPUT
        .open(DeviceStream::new(switch, fd, once))
        .ok()
        .unwrap();
    stdio::set_output(&OUTPUT).unwrap();
    let log = || std::fs::read_to_string(disk.path().join("run.log")).unwrap();
    condor_dev::println!("joint {} is at {:.3} rad", 3, 0.25);
    assert_eq!(log(), "joint 3 is at 0.250 rad\n");
    condor_dev::postln!("posted");
    assert_eq!(log(), "joint 3 is at 0.250 rad\n");
    // In the middle of another use: held, and written next time.
    switch.with_system(|_| condor_dev::println!("interrupting"));
    stdio::flush().unwrap();
    assert_eq!(log(), "joint 3 is at 0.250 rad\nposted\ninterrupting\n");
    assert_eq!(stdio::lost(), 0);
}
