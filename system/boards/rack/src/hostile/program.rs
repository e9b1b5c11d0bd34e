//! A program that opens, uses and closes all devices, in an order that bytes decide.

use std::num::NonZeroU16;
use std::rc::Rc;

use crate::ConversionTrigger;
use condor_dev::drivers::Format;
use condor_dev::sim::{LineFault, Model};
use condor_dev::{Fd, IoError, OpenMode, Switch};

use super::Tally;
use super::boards::{BOTH, Boards, Machine, outside};
use super::bus::{HostileBus, HostileController, Script};
use super::journal::PORTS;

/// A number of accesses that no call may reach. The longest call serves 40 interrupts of two boards, with 4
/// reasons each of 64 bytes, two accesses a byte, and makes some more.
const ENDLESS: u64 = 50_000;

const DEVICES: [(&str, u8); 7] = [
    ("mpp", 0),
    ("mpp", 1),
    ("uart", 0),
    ("uart4", 0),
    ("adc", 0),
    ("dac", 0),
    ("encoder", 0),
];

struct Program {
    machine: Machine,
    script: Rc<Script>,
    switch: Switch<HostileBus, HostileController, Boards, 6>,
    open: Vec<(usize, Fd)>,
    calls: u64,
}

/// Runs a fuzz test of the drivers: `bytes` decide what the program calls, and how the bus and the boards fail. Returns
/// counts of what happened.
///
/// # Panics
/// Panics if a driver breaks a promise, such as to send each accepted byte once.
pub fn run(bytes: &[u8]) -> Tally {
    let script = Script::new(bytes);
    let machine = Machine::new();
    let bus = HostileBus {
        inside: machine.bus.clone(),
        script: script.clone(),
    };
    let controller = HostileController {
        inside: machine.controller.clone(),
        script: script.clone(),
    };
    let mut program = Program {
        switch: Switch::new(bus, controller, Boards::new()),
        machine,
        script,
        open: Vec::new(),
        calls: 0,
    };
    program.run()
}

impl Program {
    fn run(&mut self) -> Tally {
        let first = self.script.byte();
        self.script.lies.set(first & 1 != 0);
        if first & 2 != 0 {
            // Start-up may fail: then boards are missing until the next one.
            self.script.awake.set(true);
            self.switch.start();
            self.script.awake.set(false);
        }
        self.switch.start();
        self.script.awake.set(true);
        while let Some(step) = self.script.next() {
            let before = self.script.accesses.get();
            self.step(step);
            self.calls += 1;
            assert!(self.script.accesses.get() - before < ENDLESS, "{step:#x}");
        }
        self.finish();
        Tally {
            accesses: self.script.accesses.get(),
            hostile: self.script.hostile.get(),
            calls: self.calls,
            bytes: self.script.journal.borrow().bytes,
        }
    }

    fn step(&mut self, step: u8) {
        match step & 0x0f {
            0 | 1 => self.open(usize::from(step >> 4) % DEVICES.len(), BOTH),
            2 => {
                let mode = OpenMode::from_bits_truncate(self.script.byte());
                self.open(usize::from(step >> 4) % DEVICES.len(), mode);
            }
            3 if !self.open.is_empty() => {
                let (_, fd) = self.open.remove(usize::from(step >> 4) % self.open.len());
                let _ = self.switch.close(fd);
            }
            4..=6 => self.with_open(step, Self::read),
            7..=9 => self.with_open(step, Self::write),
            10 => self.with_open(step, Self::peculiar),
            11 => self.with_open(step, |this, _, fd| {
                let _ = this.switch.read_ready(fd);
                let _ = this.switch.write_ready(fd);
                let _ = this.switch.is_flushed(fd);
            }),
            12 | 13 => self.outside(step >> 4),
            _ => self.switch.on_interrupt(),
        }
    }

    fn with_open(&mut self, step: u8, use_it: impl FnOnce(&mut Self, usize, Fd)) {
        if !self.open.is_empty() {
            let (device, fd) = self.open[usize::from(step >> 4) % self.open.len()];
            use_it(self, device, fd);
        }
    }

    fn open(&mut self, device: usize, mode: OpenMode) {
        let (name, board) = DEVICES[device];
        let mode = match name {
            "dac" => mode - OpenMode::READ,
            "adc" | "encoder" => mode - OpenMode::WRITE,
            _ => mode,
        };
        if let Ok(fd) = self.switch.open(name, board, mode) {
            self.open.push((device, fd));
        }
    }

    fn read(&mut self, device: usize, fd: Fd) {
        let mut bytes = [0; 40];
        let most = usize::from(self.script.byte()) % bytes.len();
        if let Ok(count) = self.switch.read(fd, &mut bytes[..most]) {
            assert!(count <= most);
            if device < PORTS {
                let mut journal = self.script.journal.borrow_mut();
                journal.read(device, &bytes[..count]);
            }
        }
    }

    fn write(&mut self, device: usize, fd: Fd) {
        let first = self.script.byte();
        let most = usize::from(self.script.byte()) % 40;
        let bytes: Vec<u8> = (0..40).map(|number| first.wrapping_add(number)).collect();
        let bytes = &bytes[..most];
        if device >= PORTS {
            let _ = self.switch.write(fd, bytes);
            return;
        }
        let before = self.script.journal.borrow_mut().offer(device, bytes);
        let result = self.switch.write(fd, bytes);
        let mut journal = self.script.journal.borrow_mut();
        match result {
            Ok(count) => journal.accept(device, bytes, before, count),
            Err(_) => journal.accept(device, bytes, before, 0),
        }
    }

    /// Makes calls that only the driver of the device has.
    fn peculiar(&mut self, device: usize, fd: Fd) {
        let what = self.script.byte();
        let divisor = NonZeroU16::new(u16::from(what)).unwrap_or(NonZeroU16::MIN);
        if let Ok(mpp) = self.switch.device(Boards::mpp, fd) {
            let _ = match what & 7 {
                0 => mpp.reset(mpp.registers),
                1 => mpp.config_16bit_raw(mpp.registers),
                2 => mpp.config_8bit(mpp.registers),
                3 => mpp.read_16bits(mpp.registers).map(drop),
                4 => mpp.write_16bits(mpp.registers, what.into()),
                _ => mpp.poll(mpp.registers),
            };
        } else if let Ok(uart) = self.switch.device(Boards::uart, fd) {
            let _ = match what & 1 {
                0 => uart.poll(uart.registers),
                _ => uart.configure(uart.registers, divisor, Format::EIGHT_BITS),
            };
        } else if let Ok(uart) = self.switch.device(Boards::uart4, fd) {
            let _ = match what & 1 {
                0 => uart.poll(uart.registers),
                _ => uart.configure(uart.registers, divisor, Format::SEVEN_BITS.odd()),
            };
        } else if let Ok(adc) = self.switch.device(Boards::adc, fd) {
            let triggers = [
                ConversionTrigger::Continuous,
                ConversionTrigger::Command,
                ConversionTrigger::External,
            ];
            let _ = match what & 7 {
                0 => adc.set_trigger(adc.registers, triggers[usize::from(what >> 3) % 3]),
                1 | 2 => adc.set_timer(adc.registers, what.into(), 100),
                _ => adc.start(adc.registers),
            };
            let mut channels = [0; 20];
            let scanned = adc.scan(adc.registers, &mut channels[..usize::from(what) % 20]);
            if let Ok(scanned) = scanned
                && !self.script.lies.get()
            {
                // All channels have one voltage at each instant.
                let channels = &channels[..scanned];
                assert!(channels.iter().all(|channel| *channel == channels[0]));
            }
        } else if let Ok(dac) = self.switch.device(Boards::dac, fd) {
            let values = [i16::from(what); 20];
            let _ = dac.write_channels(
                dac.registers,
                usize::from(what & 31),
                &values[..usize::from(what) % 20],
            );
        } else if let Ok(encoder) = self.switch.device(Boards::encoder, fd) {
            let mut last = [0; 8];
            let _ = encoder.scan_differences(encoder.registers, &mut last);
            let _ = encoder.zero_at_index(encoder.registers, what);
            let _ = encoder.take_index(encoder.registers);
        } else {
            unreachable!("{device} is one of these");
        }
    }

    /// Makes an event on the other side of a board.
    fn outside(&mut self, what: u8) {
        let machine = &self.machine;
        let byte = self.script.byte();
        match what {
            8..=10 => {
                let mut adc = outside(&machine.adc);
                adc.channels = [i16::from(byte); 16];
                adc.tick();
            }
            0 | 1 => {
                outside(&machine.mpp[usize::from(what & 1)]).strobe_in(byte);
            }
            2 | 12 => {
                outside(&machine.uart).receive(byte, LineFault::None);
            }
            3 | 13 => {
                outside(&machine.uart4).receive(byte, LineFault::Parity);
            }
            4 | 14 => {
                outside(&machine.uart).transmit();
            }
            5 => {
                outside(&machine.uart4).transmit();
            }
            6 | 11 => outside(&machine.mpp[0]).strobed.clear(),
            _ => {
                let mut uart = outside(&machine.uart);
                uart.stuck = !uart.stuck;
            }
        }
    }

    /// Checks that every board is usable and no byte is left behind once all faults have ended.
    fn finish(&mut self) {
        self.script.awake.set(false);
        outside(&self.machine.uart).stuck = false;
        for (_, fd) in self.open.drain(..) {
            assert_eq!(self.switch.close(fd), Ok(()));
        }
        let fds: Vec<Fd> = DEVICES[..PORTS]
            .iter()
            .map(|&(name, board)| self.switch.open(name, board, BOTH).unwrap())
            .collect();
        // A port that lied when it was initialised may send byte by byte.
        for _ in 0..64 {
            for (device, &fd) in fds.iter().enumerate() {
                self.poll(fd);
                self.read(device, fd);
            }
            while outside(&self.machine.uart).transmit().is_some() {}
            while outside(&self.machine.uart4).transmit().is_some() {}
        }
        for (device, &fd) in fds.iter().enumerate() {
            let rest = self.switch.read(fd, &mut [0]);
            assert_eq!(rest, Err(IoError::WouldBlock), "port {device}");
            assert_eq!(self.switch.is_flushed(fd), Ok(true), "port {device}");
            self.switch.close(fd).unwrap();
        }
        self.script.journal.borrow().check();
        assert!(!outside(&self.machine.uart).interrupts());
    }

    fn poll(&self, fd: Fd) {
        if let Ok(mpp) = self.switch.device(Boards::mpp, fd) {
            mpp.poll(mpp.registers).unwrap();
        } else if let Ok(uart) = self.switch.device(Boards::uart, fd) {
            uart.poll(uart.registers).unwrap();
        } else if let Ok(uart) = self.switch.device(Boards::uart4, fd) {
            uart.poll(uart.registers).unwrap();
        }
    }
}
