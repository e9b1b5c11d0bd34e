//! The panel: an operator's terminal on the serial port, at which angles are typed.

use core::fmt::{self, Write as _};
use core::mem;

use condor_dev::drivers::Uart16550;
use condor_dev::{Bus, Fd, InterruptController, OpenError, OpenMode, Switch, device_switch};
use condor_rt::{ProgramError, SERIAL};

device_switch! {
    /// The serial port, if the description names one for this processor.
    pub(crate) struct Ports { serial: Uart16550 = [SERIAL] }
}

/// The panel: each line from it is an angle in mrad, and is answered by a line.
pub(crate) struct Panel<'p, B, C> {
    ports: &'p Switch<B, C, Ports, 1>,
    serial: Option<Fd>,
    line: [u8; 16],
    len: usize,
}

impl<'p, B: Bus, C: InterruptController> Panel<'p, B, C> {
    /// Makes the panel of a processor; without a serial port nothing comes from it.
    ///
    /// # Errors
    /// [`ProgramError`] if the port is there and cannot be opened.
    pub(crate) fn new(ports: &'p Switch<B, C, Ports, 1>) -> Result<Self, ProgramError> {
        ports.start();
        let serial = match ports.open("serial", 0, OpenMode::READ | OpenMode::WRITE) {
            Err(OpenError::NotPresent { .. }) => None,
            opened => Some(opened?),
        };
        Ok(Self {
            ports,
            serial,
            line: [0; 16],
            len: 0,
        })
    }

    /// Returns the next angle that was typed, and answers that the joint, which is at `place`, goes there; `None` if
    /// nothing more was typed.
    pub(crate) fn angle(&mut self, place: i32) -> Option<i32> {
        let (serial, mut byte) = (self.serial?, [0]);
        while let Ok(1) = self.ports.read(serial, &mut byte) {
            let [byte] = byte;
            if !matches!(byte, b'\r' | b'\n') {
                if let Some(free) = self.line.get_mut(self.len) {
                    *free = byte;
                }
                self.len = self.len.saturating_add(1);
                continue;
            }
            let (line, len) = (self.line, mem::take(&mut self.len));
            // A longer line was not kept.
            let line = line.get(..len).and_then(|line| str::from_utf8(line).ok());
            let line = match line {
                Some("") => continue,
                line => line.unwrap_or("this"),
            };
            let _ = match line.parse() {
                Ok(angle) => {
                    let _ = write!(self, "{place} -> {angle}\r\n");
                    return Some(angle);
                }
                Err(_) => write!(self, "{line} is no angle in mrad, such as 300\r\n"),
            };
        }
        None
    }
}

impl<B: Bus, C: InterruptController> fmt::Write for Panel<'_, B, C> {
    /// Sends text; what has no room is lost.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        if let Some(serial) = self.serial {
            let _ = self.ports.write(serial, text.as_bytes());
        }
        Ok(())
    }
}
