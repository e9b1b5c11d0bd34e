//! Each access of each call of each driver fails in turn; afterwards the board is as usable as before.

use std::num::NonZeroU16;

use crate::boards::*;
use condor_dev::drivers::Format;
use condor_dev::sim::LineFault;
use condor_dev::{Fd, OpenMode};
use utah_mit_boards::ConversionTrigger;

/// Calls of a device, whose results are not looked at.
type Session = fn(&Machine, Fd);

/// Opens the device, runs `session` in which one access fails, and closes it; then `check` must hold
/// in a session of its own.
fn fail_everywhere(name: &str, mode: OpenMode, session: Session, check: Session) {
    for failing in 0.. {
        let machine = Machine::started();
        let before = machine.bus.accesses();
        machine.bus.fail_after(failing);
        if let Ok(fd) = machine.switch.open(name, 0, mode) {
            session(&machine, fd);
            // A descriptor is closed though its board may not be.
            let _ = machine.switch.close(fd);
        }
        let reached = machine.bus.accesses() - before > failing;
        if reached {
            let fd = machine.open(name, mode);
            check(&machine, fd);
            assert_eq!(machine.switch.close(fd), Ok(()), "{name}, access {failing}");
            assert!(!machine.controller.is_pending(), "{name}, access {failing}");
        } else {
            assert!(failing > 4, "a session of {name} makes accesses");
            return;
        }
    }
}

#[test]
fn parallel_ports_bear_it() {
    let session: Session = |machine, fd| {
        let mpp = machine.switch.device(Boards::mpp, fd).unwrap();
        let _ = mpp.reset(mpp.registers);
        for byte in 0..18 {
            outside(&machine.mpp[0]).strobe_in(byte);
        }
        machine.interrupts();
        let _ = machine.read(fd);
        let _ = machine.switch.write(fd, &[1, 2, 3]);
        let _ = machine.switch.is_flushed(fd);
        let _ = mpp.poll(mpp.registers);
        let _ = mpp.config_16bit_raw(mpp.registers);
        let _ = machine.read(fd);
        let _ = machine.switch.write(fd, &[1, 2, 3]);
        let _ = mpp.read_16bits(mpp.registers);
    };
    fail_everywhere("mpp", BOTH, session, |machine, fd| {
        assert!(!outside(&machine.mpp[0]).is_raw());
        outside(&machine.mpp[0]).strobe_in(42);
        machine.interrupts();
        assert_eq!(machine.read(fd), Ok(vec![42]));
        assert_eq!(machine.switch.write(fd, &[43]), Ok(1));
        assert_eq!(outside(&machine.mpp[0]).strobed, [43]);
    });
}

#[test]
fn serial_ports_bear_it() {
    let session: Session = |machine, fd| {
        let uart = machine.switch.device(Boards::uart, fd).unwrap();
        let _ = machine.switch.write(fd, &[1, 2, 3]);
        outside(&machine.uart).receive(7, LineFault::None);
        machine.interrupts();
        let _ = machine.read(fd);
        let _ = uart.configure(uart.registers, NonZeroU16::MIN, Format::EIGHT_BITS);
        while outside(&machine.uart).transmit().is_some() {}
        let _ = machine.switch.write(fd, &[4, 5]);
        machine.interrupts();
        let _ = uart.poll(uart.registers);
        let _ = machine.switch.is_flushed(fd);
    };
    fail_everywhere("uart", BOTH, session, |machine, fd| {
        // What was accepted is sent, also in a later incarnation of the port.
        for _ in 0..4 {
            machine.interrupts();
            while outside(&machine.uart).transmit().is_some() {}
        }
        assert_eq!(machine.switch.is_flushed(fd), Ok(true));
        assert_eq!(machine.switch.write(fd, b"x"), Ok(1));
        outside(&machine.uart).receive(42, LineFault::None);
        machine.interrupts();
        assert_eq!(outside(&machine.uart).transmit(), Some(b'x'));
        assert_eq!(machine.read(fd), Ok(vec![42]));
        machine.interrupts();
    });
}

#[test]
fn converters_bear_it() {
    let session: Session = |machine, fd| {
        let adc = machine.switch.device(Boards::adc, fd).unwrap();
        let _ = adc.set_trigger(adc.registers, ConversionTrigger::Command);
        let _ = adc.start(adc.registers);
        outside(&machine.adc).complete();
        let _ = adc.is_ready(adc.registers);
        let _ = machine.read(fd);
        let _ = adc.scan(adc.registers, &mut [0; 16]);
    };
    fail_everywhere("adc", OpenMode::READ, session, |machine, fd| {
        outside(&machine.adc).channels = [-3; 16];
        let adc = machine.switch.device(Boards::adc, fd).unwrap();
        let mut channels = [0; 16];
        assert_eq!(adc.scan(adc.registers, &mut channels), Ok(16));
        assert_eq!(channels, [-3; 16]);
    });
    let session: Session = |machine, fd| {
        let dac = machine.switch.device(Boards::dac, fd).unwrap();
        let _ = dac.write_all(dac.registers, &[9; 16]);
        let _ = machine.switch.write(fd, &[1; 32]);
    };
    fail_everywhere("dac", OpenMode::WRITE, session, |machine, fd| {
        assert_eq!(outside(&machine.dac).outputs(), [0; 16]);
        let dac = machine.switch.device(Boards::dac, fd).unwrap();
        assert_eq!(dac.write_all(dac.registers, &[7; 16]), Ok(()));
        assert_eq!(outside(&machine.dac).outputs(), [7; 16]);
    });
}

#[test]
fn encoders_bear_it() {
    let session: Session = |machine, fd| {
        let encoder = machine.switch.device(Boards::encoder, fd).unwrap();
        let _ = encoder.zero_at_index(encoder.registers, 0xff);
        let _ = machine.read(fd);
        let _ = encoder.take_index(encoder.registers);
        let _ = encoder.zero(encoder.registers, 0xff);
    };
    fail_everywhere("encoder", OpenMode::READ, session, |machine, fd| {
        let encoder = machine.switch.device(Boards::encoder, fd).unwrap();
        assert_eq!(encoder.zero_at_index(encoder.registers, 0), Ok(()));
        outside(&machine.encoder).turn(2, 5);
        let mut counts = [0; 3];
        assert_eq!(encoder.scan(encoder.registers, &mut counts), Ok(3));
        assert_eq!(counts, [0, 0, 5]);
    });
}
