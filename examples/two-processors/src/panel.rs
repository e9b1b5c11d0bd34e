//! The panel: an operator's terminal on the serial port, at which angles are typed.

use core::time::Duration;

use condor_dev::drivers::Uart16550;
use condor_dev::{Bus, InterruptController, OpenError, OpenMode, Switch, device_switch};
use condor_rt::{Buffering, Descriptor, Machine, SERIAL, Stdio, StdioError, Write as _};

device_switch! {
    /// The serial port, if the description names one for this processor.
    pub(crate) struct Ports { serial: Uart16550 = [SERIAL] }
}

/// The panel: each line from it is an angle in mrad, and is answered by a line.
pub(crate) struct Panel(Option<Descriptor>);

impl Panel {
    /// Opens the panel of a processor; without a serial port nothing comes from it.
    ///
    /// # Errors
    /// [`StdioError`] if the port is there and cannot be opened.
    pub(crate) fn open<'s, M: Machine>(
        stdio: &mut Stdio<'s, '_, M>,
        ports: &'s Switch<impl Bus, impl InterruptController, Ports, 1>,
    ) -> Result<Self, StdioError> {
        let mode = OpenMode::READ | OpenMode::WRITE;
        match stdio.open_board(ports, ("serial", 0), mode, Buffering::Line) {
            Err(StdioError::Board(OpenError::NotPresent { .. })) => Ok(Self(None)),
            opened => Ok(Self(Some(opened?))),
        }
    }

    /// Returns the next angle that was typed, and answers that the joint, which is at `at`, goes there; `None` if
    /// nothing more was typed. Does not wait.
    pub(crate) fn angle(&self, stdio: &mut Stdio<'_, '_, impl Machine>, at: i32) -> Option<i32> {
        let (panel, mut line) = (self.0?, [0; 16]);
        loop {
            let typed = match stdio.read_line(panel, &mut line, Duration::ZERO) {
                Ok(typed) => typed?.trim(),
                Err(StdioError::Line { .. }) => "this",
                // The port has gone.
                Err(_) => return None,
            };
            let mut answer = stdio.stream(panel).ok()?;
            // An answer that cannot be sent in time is kept; one more is lost.
            let _ = match typed.parse::<i32>() {
                _ if typed.is_empty() => continue,
                Ok(angle) => {
                    let _ = write!(answer, "{at} -> {angle}\r\n");
                    return Some(angle);
                }
                Err(_) => write!(
                    answer,
                    "{typed} is not an angle: type mrad, such as 300\r\n"
                ),
            };
        }
    }
}
