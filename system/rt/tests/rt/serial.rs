//! The serial port of a process: the driver of a 16550, whose line is a terminal device.
#![cfg(feature = "sim")]

use core::num::NonZeroU16;
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

use condor_dev::drivers::{Format, Uart16550};
use condor_dev::{BusErrorKind, Fd, IoError, OpenError, OpenMode, Switch, device_switch};
use condor_mbox::Processor;
use condor_rt::linux::{LinuxProcess, LoopContext, ProcessBus, ProcessError, ProcessInterrupts};
use condor_rt::{Machine as _, SERIAL, Setup};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::termios::{ControlModes, tcgetattr};

use crate::environment::environment;
use crate::terminal::{raw_terminal, terminal};

const ME: Processor = Processor(3);
const PATIENCE: Duration = Duration::from_secs(60);
/// More than all buffers on the way hold, and not even.
const BYTES: usize = 20_001;

device_switch! { struct Ports { serial: Uart16550 = [SERIAL] } }

/// Waits until the line has bytes, or room for one; false if that takes too long.
fn is_ready(line: &File, events: PollFlags) -> bool {
    let patience = Timespec::try_from(PATIENCE).unwrap();
    poll(&mut [PollFd::new(line, events)], Some(&patience)).unwrap() > 0
}

/// Has a program send back all that it receives, each byte with another bit changed.
fn echoes(loops: LoopContext) {
    let directory = tempfile::tempdir().unwrap();
    let (other, path) = terminal();
    let mut environment = environment(directory.path(), ME, 16384, loops);
    environment.serial = Some(path);
    // SAFETY: the program has no loop.
    let machine = unsafe { LinuxProcess::allowing_signals(&environment, []) }.unwrap();
    let (bus, controller) = (machine.bus(), machine.interrupt_controller());
    let switch = Switch::<_, _, _, 1>::new(bus, controller, Ports::new());
    switch.start();
    let port = switch
        .open("serial", 0, OpenMode::READ | OpenMode::WRITE)
        .unwrap();
    let gone = AtomicBool::new(false);
    let sent: Vec<u8> = (0..BYTES).map(|number| (number * 7 % 256) as u8).collect();
    let mut received = vec![0; BYTES];
    thread::scope(|scope| {
        scope.spawn(|| {
            for byte in sent.iter().take_while(|_| is_ready(&other, PollFlags::OUT)) {
                (&other).write_all(&[*byte]).unwrap();
            }
        });
        scope.spawn(|| {
            let mut rest = &mut received[..];
            while !rest.is_empty() && is_ready(&other, PollFlags::IN) {
                let count = (&other).read(rest).unwrap();
                rest = &mut rest[count..];
            }
            gone.store(true, Relaxed);
        });
        let ran = Setup::new(&machine)
            .unwrap()
            .interrupts(&switch)
            .background(|running| {
                let (mut bytes, mut held) = ([0; 100], 0..0);
                while !gone.load(Relaxed) {
                    if held.is_empty() {
                        let read = switch.read(port, &mut bytes);
                        held = 0..read.unwrap_or(0);
                        bytes = bytes.map(|byte| byte ^ 0x80);
                    }
                    match switch.write(port, &bytes[held.clone()]) {
                        Ok(written) => held.start += written,
                        Err(error) => assert_eq!(error, IoError::WouldBlock),
                    }
                    running.serve(Duration::from_micros(100))?;
                }
                Ok(())
            });
        ran.unwrap();
    });
    let back: Vec<u8> = received.iter().map(|byte| byte ^ 0x80).collect();
    assert!(back == sent, "the bytes came back changed");
    let counts = switch.interrupt_counts();
    assert!(counts.served > 0, "{counts:?}");
    assert_eq!(
        (counts.unclaimed, counts.unhandled, counts.stuck),
        (0, 0, 0)
    );
}

#[test]
fn bytes_pass_both_ways_beside_threads() {
    echoes(LoopContext::Threads);
}

#[test]
fn bytes_pass_both_ways_beside_signals() {
    echoes(LoopContext::Signals);
}

#[test]
fn bytes_pass_both_ways_where_a_program_spins() {
    echoes(LoopContext::Spin);
}

#[test]
fn a_process_without_serial_port_has_no_board_there() {
    let directory = tempfile::tempdir().unwrap();
    let environment = environment(directory.path(), ME, 16384, LoopContext::Threads);
    let machine = LinuxProcess::new(&environment, []).unwrap();
    let (bus, controller) = (machine.bus(), machine.interrupt_controller());
    let switch = Switch::<_, _, _, 1>::new(bus, controller, Ports::new());
    switch.start();
    let opened = switch.open("serial", 0, OpenMode::READ);
    assert!(matches!(opened, Err(OpenError::NotPresent { .. })));
}

#[test]
fn what_is_no_terminal_device_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("file");
    std::fs::write(&file, "").unwrap();
    for path in [file, directory.path().join("none")] {
        let mut environment = environment(directory.path(), ME, 16384, LoopContext::Threads);
        environment.serial = Some(path.clone());
        let error = LinuxProcess::new(&environment, []).err().unwrap();
        assert!(matches!(
            error,
            ProcessError::Open {
                what: "serial port",
                ..
            }
        ));
        let error = error.to_string();
        assert!(error.contains(path.to_str().unwrap()), "{error}");
    }
}

/// Makes a process whose serial port is the device `path`, and has it use the port in its background.
fn with_port(
    path: PathBuf,
    test: impl FnOnce(&Switch<ProcessBus, ProcessInterrupts, Ports, 1>, Fd),
) {
    let directory = tempfile::tempdir().unwrap();
    let mut environment = environment(directory.path(), ME, 16384, LoopContext::Threads);
    environment.serial = Some(path);
    let machine = LinuxProcess::new(&environment, []).unwrap();
    let switch = Switch::new(machine.bus(), machine.interrupt_controller(), Ports::new());
    switch.start();
    let port = switch
        .open("serial", 0, OpenMode::READ | OpenMode::WRITE)
        .unwrap();
    test(&switch, port);
}

/// Reads until something comes.
fn read(switch: &Switch<ProcessBus, ProcessInterrupts, Ports, 1>, port: Fd) -> u8 {
    let (begun, mut byte) = (Instant::now(), [0]);
    loop {
        let uart = switch.device(Ports::serial, port).unwrap();
        uart.poll(uart.registers).unwrap();
        if let Ok(1) = switch.read(port, &mut byte) {
            return byte[0];
        }
        assert!(begun.elapsed() < PATIENCE);
    }
}

#[test]
fn the_line_has_the_format_and_the_speed_of_the_driver() {
    let (other, path) = terminal();
    with_port(path, |switch, port| {
        let uart = switch.device(Ports::serial, port).unwrap();
        let divisor = NonZeroU16::new(12).unwrap();
        let format = Format::SEVEN_BITS.even().two_stop_bits();
        uart.configure(uart.registers, divisor, format).unwrap();
        let set = tcgetattr(&other).unwrap();
        assert_eq!(set.output_speed(), 9600);
        // A terminal without a line has eight bits and no parity.
        assert!(set.control_modes.contains(ControlModes::CSTOPB));
        assert!(!set.control_modes.contains(ControlModes::PARODD));
    });
}

#[test]
fn what_came_before_the_port_was_opened_is_discarded() {
    // A user of before has left the line as it is.
    let (mut other, path) = raw_terminal();
    other.write_all(&[b'o'; 100]).unwrap();
    with_port(path, |switch, port| {
        other.write_all(b"n").unwrap();
        assert_eq!(read(switch, port), b'n');
    });
}

#[test]
fn accesses_fail_when_the_line_has_gone() {
    let (other, path) = terminal();
    with_port(path, |switch, port| {
        drop(other);
        let uart = switch.device(Ports::serial, port).unwrap();
        let error = uart.poll(uart.registers).unwrap_err();
        assert_eq!(error.kind, BusErrorKind::Lost);
        let flushed = switch.is_flushed(port).unwrap_err();
        assert!(matches!(flushed, IoError::Bus(error) if error.kind == BusErrorKind::Lost));
    });
}
