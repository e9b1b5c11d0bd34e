//! Boards that interrupt a process: its serial port, and one for which it has no driver.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::time::{Duration, Instant};

use condor_dev::drivers::Uart16550;
use condor_dev::{InterruptVector, OpenMode, Switch, device_switch};
use condor_rt::{Machine, Program, ProgramError, Raiser, SERIAL, Setup};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use serde_json::Value;

use crate::commands::{answer, text};
use crate::running::{DEADLINE, Up};

/// A vector without a driver.
const STRANGE: InterruptVector = InterruptVector(140);

device_switch! { struct Ports { serial: Uart16550 = [SERIAL] } }

/// Sends back what comes from the serial port, and is interrupted by a board that it does not know.
pub(crate) struct Echo;

impl Program for Echo {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let (bus, controller) = (machine.bus(), machine.interrupt_controller());
        let ports = Switch::<_, _, _, 1>::new(bus, controller, Ports::new());
        ports.start();
        let serial = ports.open("serial", 0, OpenMode::READ | OpenMode::WRITE)?;
        Setup::new(machine)?
            .interrupts(&ports)
            .background(|background| {
                Raiser::new(machine).raise(machine.number(), STRANGE);
                let mut bytes = [0; 16];
                while !background.is_stopping() {
                    let read = ports.read(serial, &mut bytes).unwrap_or(0);
                    // There is room for what is sent here.
                    let _ = ports.write(serial, &bytes[..read]);
                    background.serve(Duration::from_millis(1))?;
                }
                Ok(())
            })
    }
}

/// Waits until the counts of interrupts are as wanted.
fn until(up: &Up, are_so: impl Fn(&Value) -> bool) -> Value {
    let begun = Instant::now();
    loop {
        let top = answer(up, &["top", "--once", "--every", "10ms"]);
        let counts = &top["interrupts"][0];
        if are_so(counts) {
            return counts.clone();
        }
        assert!(begun.elapsed() < DEADLINE, "{top}");
    }
}

/// Has a process echo by the clock that `options` say, and looks at its interrupts.
fn echoes(options: &[&str]) {
    let other = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&other).unwrap();
    unlockpt(&other).unwrap();
    let path = ptsname(&other, Vec::new()).unwrap().into_string().unwrap();
    let echo = format!(
        "[[processors]]\nnumber = 1\nname = \"echo\"\nprogram = \"THIS\"\narguments = [\"echo\"]\nserial = {path:?}\n"
    );
    let up = Up::start(&echo, options);
    // The program discards what came before it had opened its port.
    until(&up, |counts| counts["unhandled"] == 1);
    let mut other = File::from(other);
    other.write_all(b"there and back").unwrap();
    let mut back = String::new();
    while !back.ends_with("and back") {
        let patience = Timespec::try_from(DEADLINE).unwrap();
        let ready = poll(&mut [PollFd::new(&other, PollFlags::IN)], Some(&patience)).unwrap();
        assert!(ready > 0, "only {back:?} came back");
        let mut bytes = [0; 16];
        let count = other.read(&mut bytes).unwrap();
        back += str::from_utf8(&bytes[..count]).unwrap();
    }
    assert_eq!(back, "there and back");
    let counts = until(&up, |counts| counts["served"].as_u64() > Some(0));
    assert_eq!(counts["unhandled_vectors"].to_string(), "[140]", "{counts}");
    let table = text(&up, &["top", "--once", "--every", "10ms"]);
    assert!(table.contains("without a driver: 140"), "{table}");
}

#[test]
fn a_serial_port_interrupts_and_a_board_without_driver_is_named() {
    echoes(&[]);
}

#[test]
fn a_serial_port_interrupts_in_simulated_time() {
    echoes(&["--clock", "simulated"]);
}
