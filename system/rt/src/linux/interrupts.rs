//! [`ProcessInterrupts`]: the interrupts of a process's boards.

use std::fs::File;
use std::io;
use std::sync::Arc;

use condor_dev::linux::UioInterrupts;
use condor_dev::{InterruptController, InterruptLevel, InterruptVector};
use condor_mbox::linux::LinuxWindow;

use super::bell::ProcessBell;
use super::environment::UioDevice;
use super::error::ProcessError;
use super::serial::SerialPort;
use crate::lines::{BoardLines, FIRST_LINE, LineState, SERIAL_VECTOR};

/// The controller of the boards' interrupts of a [`LinuxProcess`](super::LinuxProcess): vectors 128 to 159 are boards
/// that are memory, and come first, the serial port among them; lower ones are the UIO devices of the process. All
/// clones are the same controller.
#[derive(Clone, Debug)]
pub struct ProcessInterrupts {
    pub(super) lines: BoardLines<LinuxWindow, ProcessBell, Arc<LineState>>,
    pub(super) uio: Option<Arc<UioInterrupts>>,
    pub(super) serial: Option<Arc<SerialPort>>,
}

/// Opens UIO devices; `None` if there are none.
pub(super) fn open(devices: &[UioDevice]) -> Result<Option<Arc<UioInterrupts>>, ProcessError> {
    let Some(UioDevice { path: first, .. }) = devices.first() else {
        return Ok(None);
    };
    let failed = |path: &std::path::Path, source: io::Error| ProcessError::Open {
        what: "UIO device",
        path: path.to_owned(),
        source,
    };
    let mut opened = Vec::new();
    for UioDevice { vector, path } in devices {
        let file = File::options().read(true).write(true).open(path);
        let file = file.map_err(|source| failed(path, source))?;
        opened.push((InterruptVector(*vector), file.into()));
    }
    let interrupts = UioInterrupts::new(opened).map_err(|source| failed(first, source))?;
    Ok(Some(Arc::new(interrupts)))
}

impl ProcessInterrupts {
    fn of(&self, vector: InterruptVector) -> Option<&dyn InterruptController> {
        if vector < FIRST_LINE {
            self.uio.as_ref().map(|uio| &**uio as _)
        } else {
            Some(&self.lines)
        }
    }
}

impl InterruptController for ProcessInterrupts {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        if let Some(controller) = self.of(vector) {
            controller.enable(vector, level);
        }
    }

    fn disable(&self, vector: InterruptVector) {
        if let Some(controller) = self.of(vector) {
            controller.disable(vector);
        }
    }

    fn claim(&self) -> Option<InterruptVector> {
        let line = self.lines.claim();
        line.or_else(|| self.uio.as_ref()?.claim())
    }

    fn complete(&self, vector: InterruptVector) {
        if let Some(controller) = self.of(vector) {
            controller.complete(vector);
        }
        if let Some(serial) = &self.serial
            && vector == SERIAL_VECTOR
        {
            serial.look_again();
        }
    }
}
