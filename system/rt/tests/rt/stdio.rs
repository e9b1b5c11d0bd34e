//! One table of descriptors over files, the terminal and boards.
#![cfg(feature = "sim")]

use std::fs;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use std::thread;
use std::time::Duration;

use condor_dev::drivers::Uart16550;
use condor_dev::stdio::LineError;
use condor_dev::{FdError, OpenError, OpenMode, Switch, device_switch};
use condor_fs::server::{FileServer, ServerOptions};
use condor_mbox::{Call, Messenger as _, Processor};
use condor_rt::linux::{LinuxProcess, LoopContext};
use condor_rt::objects::{self, ObjectKind};
use condor_rt::{
    Background, Buffering, DESCRIPTORS, Machine, OpenOptions, ProgramError, SERIAL, STDERR, STDIN,
    STDOUT, Setup, Stdio, StdioCause, StdioError, Write, numbers, sim, users,
};
use condor_tty::layout::input_data;
use condor_tty::{TerminalReader, TerminalVectors};

use crate::environment::environment;
use crate::terminal::raw_terminal;

type Sim = sim::SimMachine<condor_rt::Silent>;

const ME: Processor = Processor(2);
const VISITOR: Processor = Processor(20);
const SECOND: Duration = Duration::from_secs(1);
const WINDOW_BYTES: u32 = 65536;
const LOG: OpenOptions = OpenOptions::new().append().create();
const READ: OpenOptions = OpenOptions::new().read();

/// Runs `act` as the background of a program with a terminal and files.
fn with_table<M: Machine>(
    machine: &M,
    act: impl FnOnce(&Background<'_, M>, &mut Stdio<'_, '_, M>) -> Result<(), StdioError>,
) -> Result<(), ProgramError> {
    Setup::new(machine)?
        .console()?
        .files()?
        .background(|background| {
            let files = background.files()?;
            files.set_timeout(Duration::from_millis(100));
            let mut stdio = background.stdio().with_files(&files);
            Ok(act(background, &mut stdio)?)
        })
}

/// Runs `act` beside a file service for a new directory, in virtual time.
fn with_files(act: impl FnOnce(&mut Stdio<'_, '_, Sim>, &Path) -> Result<(), StdioError> + Send) {
    let root = tempfile::tempdir().unwrap();
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    system.files(root.path()).unwrap();
    let run = |machine: &_| with_table(machine, |_, stdio| act(stdio, root.path()));
    system.host(ME, run).unwrap();
    system.run_until(60_000_000_000).unwrap();
}

#[test]
fn bytes_leave_as_the_buffering_says() {
    with_files(|stdio, root| {
        let text = || fs::read_to_string(root.join("log")).unwrap();
        let log = stdio.open_file("log", LOG, Buffering::Line)?;
        write!(stdio.stream(log)?, "joint {} ", 3).unwrap();
        assert_eq!(text(), "");
        writeln!(stdio.stream(log)?, "is slack").unwrap();
        assert_eq!(text(), "joint 3 is slack\n");
        write!(stdio.stream(log)?, "end").unwrap();
        stdio.close(log)?;
        assert_eq!(text(), "joint 3 is slack\nend");

        let options = OpenOptions::new().write().truncate();
        let log = stdio.open_file("log", options, Buffering::Block)?;
        stdio.stream(log)?.write_all(&[b'\n'; 300])?;
        assert_eq!(text().len(), 256);
        stdio.flush(log)?;
        assert_eq!(text().len(), 300);
        stdio.stream(log)?.write_all(b"lost")?;
        assert_eq!(stdio.discard(log), Ok(4));

        let log = stdio.open_file("log", options, Buffering::None)?;
        stdio.stream(log)?.write_all(b"now")?;
        assert_eq!(text(), "now");
        stdio.close(log)
    });
}

#[test]
fn lines_of_a_file_are_read_to_its_end() {
    with_files(|stdio, root| {
        let text = [
            b"one\n\n".to_vec(),
            vec![b'x'; 300],
            b"\nlonger\n\xff\nend".to_vec(),
        ]
        .concat();
        fs::write(root.join("text"), text).unwrap();
        let text = stdio.open_file("text", READ, Buffering::Line)?;
        let mut line = [0; 6];
        let mut next = || {
            stdio
                .read_line(text, &mut line, Duration::ZERO)
                .map(|line| line.map(str::to_owned))
        };
        let some = |line: &str| Ok(Some(line.to_owned()));
        let refused = |error: Result<_, StdioError>| match error {
            Err(StdioError::Line { name, error }) => {
                assert_eq!(name.as_str(), "text");
                error
            }
            other => panic!("{other:?}"),
        };
        assert_eq!(next(), some("one\n"));
        assert_eq!(next(), some("\n"));
        assert_eq!(refused(next()), LineError::TooLong { room: 256 });
        assert_eq!(refused(next()), LineError::TooLong { room: 6 });
        assert_eq!(refused(next()), LineError::NotUtf8 { bytes: 2 });
        assert_eq!(next(), some("end"));
        assert_eq!(next(), some(""));
        Ok(())
    });
}

#[test]
fn a_descriptor_that_was_closed_is_not_taken_for_a_newer_one() {
    with_files(|stdio, root| {
        fs::write(root.join("a"), "a").unwrap();
        let closed = stdio.open_file("a", READ, Buffering::None)?;
        stdio.close(closed)?;
        let newer = stdio.open_file("a", READ, Buffering::None)?;
        let refused = stdio.read_line(closed, &mut [0; 4], SECOND).unwrap_err();
        assert!(
            matches!(refused, StdioError::Descriptor(FdError::Closed { .. })),
            "{refused}"
        );
        assert_eq!(stdio.read_line(newer, &mut [0; 4], SECOND), Ok(Some("a")));
        let refused = stdio.stream(newer)?.write_all(b"b").unwrap_err();
        assert!(
            matches!(refused, StdioError::Descriptor(FdError::Direction { .. })),
            "{refused}"
        );
        let refused = stdio.open_file("none", READ, Buffering::None).unwrap_err();
        assert!(refused.to_string().starts_with("`none`: "), "{refused}");
        Ok(())
    });
}

#[test]
fn nothing_is_lost_or_written_twice_when_the_service_answers_too_late() {
    let root = tempfile::tempdir().unwrap();
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    let serve = |machine: &Sim| {
        let server = FileServer::new(root.path(), ServerOptions::default()).unwrap();
        let (windows, calls) = (machine.windows(), AtomicU32::new(0));
        let answer = |call: &Call<'_>| {
            let reply = server.answer(call, &windows);
            // It is done, but the client hears of it too late.
            if calls.fetch_add(1, Relaxed) % 3 == 2 {
                machine.work(250_000_000);
            }
            reply
        };
        let mut mailbox = machine.mailbox()?;
        mailbox.set_vector(condor_fs::wire::FILES, &answer, "files")?;
        mailbox.join()?;
        while !machine.is_stopping() {
            mailbox.serve(Duration::from_millis(10))?;
        }
        Ok::<_, ProgramError>(())
    };
    system.host(numbers::FILES, serve).unwrap();
    let program = |machine: &_| {
        with_table(machine, |_, stdio| {
            let mut failed = 0;
            for (name, options) in [
                ("appended", LOG),
                ("written", OpenOptions::new().write().create()),
            ] {
                let log = stdio.open_file(name, options, Buffering::Line);
                let log = log.or_else(|_| stdio.open_file(name, options, Buffering::Line))?;
                let mut expected = Vec::new();
                for number in 0..30 {
                    let line = format!("line {number} of {name}\n");
                    let mut rest = line.as_bytes();
                    while !rest.is_empty() {
                        match stdio.stream(log)?.write(rest) {
                            Ok(taken) => rest = &rest[taken..],
                            Err(error) => {
                                assert!(matches!(error, StdioError::Failed { .. }), "{error}");
                                failed += 1;
                            }
                        }
                    }
                    expected.extend_from_slice(line.as_bytes());
                }
                stdio.stream(log)?.write_all(b"end")?;
                expected.extend_from_slice(b"end");
                while let Err(error) = stdio.flush(log) {
                    assert!(
                        matches!(error, StdioError::Unwritten { bytes: 3, .. }),
                        "{error}"
                    );
                    failed += 1;
                }
                assert_eq!(
                    String::from_utf8(fs::read(root.path().join(name)).unwrap()).unwrap(),
                    String::from_utf8(expected.clone()).unwrap()
                );
            }
            assert!(failed > 0, "no answer came too late");
            Ok(())
        })
    };
    system.host(ME, program).unwrap();
    system.run_until(600_000_000_000).unwrap();
}

#[test]
fn lines_of_the_terminal_are_read_with_a_deadline() {
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    let program = |machine: &Sim| {
        Setup::new(machine)?.console()?.background(|background| {
            let mut stdio = background.stdio();
            let error = stdio.open_file("a", READ, Buffering::None).unwrap_err();
            assert!(matches!(error, StdioError::NoFiles { .. }), "{error}");
            let mut line = [0; 16];
            write!(stdio.stream(STDOUT)?, "angle? ")?;
            let half = Duration::from_millis(500);
            assert_eq!(stdio.read_line(STDIN, &mut line, half)?, None);
            assert_eq!(stdio.read_line(STDIN, &mut line, SECOND)?, Some("300\n"));
            writeln!(stdio.stream(STDERR)?, "it is {}", 300)?;
            let refused = stdio.stream(STDIN)?.write(b"x").unwrap_err();
            assert!(matches!(refused, StdioError::Descriptor(_)), "{refused}");
            stdio.close(STDIN)?;
            assert!(stdio.read_line(STDIN, &mut line, SECOND).is_err());
            background.serve(SECOND)
        })
    };
    system.host(ME, program).unwrap();
    let visitor = |machine: &Sim| {
        let mut mailbox = machine.mailbox()?;
        mailbox.join()?;
        machine.work(1_000_000);
        let region = users(machine, ME)?;
        let console = objects::find(&region, "console", ObjectKind::Terminal)?.unwrap();
        let types = |text: &[u8]| {
            for character in text {
                let data = input_data(console.offset, *character);
                let vector = TerminalVectors::DEFAULT.input;
                mailbox.send_with_reply(ME, vector, data, SECOND).unwrap();
            }
        };
        types(b"30");
        machine.work(600_000_000);
        types(b"0\n");
        machine.work(100_000_000);
        let mut reader = TerminalReader::attach(region, console.offset, VISITOR).unwrap();
        let (mut shown, mut bytes) = (Vec::new(), [0; 64]);
        loop {
            let len = reader.fetch(&mut bytes).unwrap().len;
            if len == 0 {
                break;
            }
            shown.extend_from_slice(&bytes[..len]);
            reader.acknowledge(len).unwrap();
        }
        assert_eq!(
            String::from_utf8(shown).unwrap(),
            "angle? 300\r\nit is 300\r\n"
        );
        Ok::<_, ProgramError>(())
    };
    system.host(VISITOR, visitor).unwrap();
    system.run_until(5_000_000_000).unwrap();
}

#[test]
fn a_program_without_terminal_has_no_standard_descriptors() {
    let root = tempfile::tempdir().unwrap();
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    system.files(root.path()).unwrap();
    let program = |machine: &Sim| {
        Setup::new(machine)?.files()?.background(|background| {
            let mut stdio = background.stdio();
            for descriptor in [STDIN, STDOUT, STDERR] {
                let error = stdio.flush(descriptor).unwrap_err();
                assert!(
                    error.to_string().contains("`console` of `Setup`"),
                    "{error}"
                );
            }
            let files = background.files()?;
            let mut stdio = background.stdio().with_files(&files);
            let options = OpenOptions::new().write().create();
            let file = stdio.open_file("first", options, Buffering::None)?;
            assert!(![STDIN, STDOUT, STDERR].contains(&file));
            assert!(stdio.flush(STDOUT).is_err());
            Ok(())
        })
    };
    system.host(ME, program).unwrap();
    system.run_until(60_000_000_000).unwrap();
}

device_switch! { struct Ports { serial: Uart16550 = [SERIAL] } }

#[test]
fn a_board_is_read_by_lines_and_written_like_a_file() {
    const BYTES: usize = 2000;
    let directory = tempfile::tempdir().unwrap();
    let (mut other, path) = raw_terminal();
    let mut environment = environment(directory.path(), ME, WINDOW_BYTES, LoopContext::Threads);
    environment.serial = Some(path);
    let machine = LinuxProcess::new(&environment, []).unwrap();
    let (bus, controller) = (machine.bus(), machine.interrupt_controller());
    let switch = Switch::<_, _, _, 8>::new(bus, controller, Ports::new());
    switch.start();
    let read = AtomicBool::new(false);
    let ran = Setup::new(&machine)
        .unwrap()
        .console()
        .unwrap()
        .interrupts(&switch)
        .background(|background| {
            let mut stdio = background.stdio();
            let mode = OpenMode::READ | OpenMode::WRITE;
            let port = stdio.open_board(&switch, ("serial", 0), mode, Buffering::Line)?;
            let none = stdio.open_board(&switch, ("serial", 1), mode, Buffering::Line);
            assert!(matches!(
                none,
                Err(StdioError::Board(OpenError::NoSuchBoard { .. }))
            ));
            let mut line = [0; 16];
            assert_eq!(stdio.read_line(port, &mut line, Duration::ZERO)?, None);
            other.write_all(b"25").unwrap();
            assert_eq!(
                stdio.read_line(port, &mut line, Duration::from_millis(1))?,
                None
            );
            other
                .write_all(b"0\rtoo long for the line\rnext\n")
                .unwrap();
            let long = Duration::from_secs(60);
            assert_eq!(stdio.read_line(port, &mut line, long)?, Some("250\r"));
            let refused = stdio.read_line(port, &mut line, long);
            assert!(
                matches!(refused, Err(StdioError::Line { .. })),
                "{refused:?}"
            );
            assert_eq!(stdio.read_line(port, &mut line, long)?, Some("next\n"));

            // More than has room on the way.
            thread::scope(|scope| {
                scope.spawn(|| {
                    let mut bytes = vec![0; BYTES];
                    other.read_exact(&mut bytes).unwrap();
                    assert!(bytes.iter().all(|byte| *byte == b'z'));
                    read.store(true, Relaxed);
                });
                let mut left = BYTES;
                while left > 0 {
                    let piece = &[b'z'; 100][..left.min(100)];
                    match stdio.stream(port)?.write(piece) {
                        Ok(taken) => left -= taken,
                        Err(StdioError::Failed { cause, .. }) => {
                            assert_eq!(cause, StdioCause::TimedOut);
                        }
                        Err(error) => return Err(error),
                    }
                }
                stdio.close(port)
            })?;
            assert!(stdio.flush(port).is_err());
            for _ in 3..DESCRIPTORS {
                stdio.open_board(&switch, ("serial", 0), mode, Buffering::None)?;
            }
            let full = stdio.open_board(&switch, ("serial", 0), mode, Buffering::None);
            assert_eq!(
                full.unwrap_err().to_string(),
                "`serial` cannot be opened: all 8 descriptors are open; `close` one first"
            );
            stdio.close(STDIN)?;
            stdio.open_board(&switch, ("serial", 0), mode, Buffering::None)?;
            Ok(())
        });
    ran.unwrap();
    assert!(read.into_inner());
}
