//! [`Journal`]: the place where each byte must be.

use std::collections::VecDeque;

use super::boards::{MPP, UART};

/// The number of ports that move bytes, in the order of [`Journal`]'s fields.
pub(super) const PORTS: usize = 4;

/// One port that moves bytes.
#[derive(Default)]
struct Port {
    /// True if its first register is that of the divisor (serial), or if its data lines are moved as lines, not
    /// as bytes (parallel).
    shut: bool,
    /// Bytes that its driver took from the board and no program has read.
    taken: VecDeque<u8>,
    /// Bytes that its driver accepted from a program and has not handed to the board.
    accepted: VecDeque<u8>,
    /// Bytes handed to the board by the call that is being made.
    handed: Vec<u8>,
}

/// The bytes that the two parallel ports, and then the two serial ones, have accepted and delivered.
#[derive(Default)]
pub(super) struct Journal {
    ports: [Port; PORTS],
    /// The number of acknowledged bytes.
    pub(super) bytes: u64,
}

/// Returns the port and the number of the register at an address.
fn locate(address: usize) -> Option<(usize, usize)> {
    let within = |base: usize, size: usize| (base..base + size).contains(&address);
    if let Some(port) = MPP.iter().position(|&base| within(base, 0x10)) {
        return Some((port, address - MPP[port]));
    }
    if within(UART[0], 8) {
        return Some((2, address - UART[0]));
    }
    within(UART[1], 0x20).then(|| (3, (address - UART[1]) / 4))
}

impl Journal {
    pub(super) fn was_read(&mut self, address: usize, value: u32) {
        if let Some((port, register)) = locate(address) {
            let port_is_serial = port >= 2;
            let port = &mut self.ports[port];
            if (port_is_serial && register == 0 && !port.shut) || (!port_is_serial && register == 7)
            {
                port.taken.push_back(value as u8);
            }
        }
    }

    pub(super) fn was_written(&mut self, address: usize, value: u32) {
        let Some((number, register)) = locate(address) else {
            return;
        };
        let port = &mut self.ports[number];
        match (number >= 2, register) {
            (true, 0) if !port.shut => {
                let expected = port.accepted.pop_front();
                assert_eq!(expected, Some(value as u8), "sent by serial port {number}");
            }
            (true, 2) if value & 2 != 0 => port.taken.clear(),
            (true, 3) => port.shut = value & 0x80 != 0,
            // A reset also lets the port move bytes again, not lines.
            (false, 2) if value & 0x8000 != 0 => {
                port.taken.clear();
                port.shut = false;
            }
            (false, 2) => port.shut = value & 2 != 0,
            (false, 7) => port.handed.push(value as u8),
            _ => {}
        }
    }

    /// Checks the bytes that a driver returned to a program.
    pub(super) fn read(&mut self, number: usize, bytes: &[u8]) {
        let port = &mut self.ports[number];
        if number < 2 && port.shut {
            return;
        }
        self.bytes += bytes.len() as u64;
        let expected: Vec<u8> = port
            .taken
            .drain(..bytes.len().min(port.taken.len()))
            .collect();
        assert_eq!(bytes, expected, "read from port {number}");
    }

    /// Records bytes that a program is about to pass to a driver, which may hand them on at once.
    pub(super) fn offer(&mut self, number: usize, bytes: &[u8]) -> usize {
        let port = &mut self.ports[number];
        port.handed.clear();
        let before = port.accepted.len();
        if number >= 2 {
            port.accepted.extend(bytes);
        }
        before
    }

    /// Records that the driver accepted the first `count` of the offered bytes.
    pub(super) fn accept(&mut self, number: usize, offered: &[u8], before: usize, count: usize) {
        let port = &mut self.ports[number];
        self.bytes += count as u64;
        if number >= 2 {
            port.accepted.truncate(before + count);
        } else if !port.shut {
            assert_eq!(
                port.handed,
                offered[..count],
                "sent by parallel port {number}"
            );
        }
    }

    /// Checks that all accepted bytes are with the board, and that all bytes which the driver took were read.
    pub(super) fn check(&self) {
        for (number, port) in self.ports.iter().enumerate() {
            assert!(port.accepted.is_empty(), "not sent by port {number}");
            assert!(port.taken.is_empty(), "not read from port {number}");
        }
    }
}
