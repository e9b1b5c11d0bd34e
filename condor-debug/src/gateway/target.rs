//! What `gdbstub` asks of a [`Session`].

use condor_mbox::MemoryWindow;
use gdbstub::common::Signal;
use gdbstub::target::ext::base::BaseOps;
use gdbstub::target::ext::base::singlethread::{
    SingleThreadBase, SingleThreadResume, SingleThreadResumeOps,
};
use gdbstub::target::ext::breakpoints::{
    Breakpoints, BreakpointsOps, SwBreakpoint, SwBreakpointOps,
};
use gdbstub::target::ext::memory_map::{MemoryMap, MemoryMapOps};
use gdbstub::target::ext::monitor_cmd::{ConsoleOutput, MonitorCmd, MonitorCmdOps, outputln};
use gdbstub::target::ext::section_offsets::{Offsets, SectionOffsets, SectionOffsetsOps};
use gdbstub::target::{Target, TargetError, TargetResult};

use super::riscv::{Rv64, Rv64Registers, frame};
use super::session::Session;
use crate::{Planted, TracerError};

/// As many breakpoints as a slave has room for.
const MOST_BREAKPOINTS: usize = crate::area::MOST_PLANTED as usize;
/// The size of a planted breakpoint.
const BREAKPOINT_BYTES: u64 = 2;
/// What the memory that the program cannot access is answered with: `EFAULT`.
const FAULT: u8 = 14;

impl From<TracerError> for TargetError<TracerError> {
    fn from(error: TracerError) -> Self {
        Self::Fatal(error)
    }
}

impl<W: MemoryWindow> Session<W> {
    /// The planted breakpoints that lie in `len` bytes at an address, at least in part.
    fn planted(&self, address: u64, len: usize) -> Result<Vec<Planted>, TracerError> {
        let end = address.saturating_add(len as u64);
        let mut planted = self.tracer().planted()?;
        planted
            .retain(|it| it.address < end && it.address.saturating_add(BREAKPOINT_BYTES) > address);
        Ok(planted)
    }
}

impl<W: MemoryWindow> Target for Session<W> {
    type Arch = Rv64;
    type Error = TracerError;

    fn base_ops(&mut self) -> BaseOps<'_, Rv64, TracerError> {
        BaseOps::SingleThread(self)
    }

    fn support_breakpoints(&mut self) -> Option<BreakpointsOps<'_, Self>> {
        Some(self)
    }

    fn support_section_offsets(&mut self) -> Option<SectionOffsetsOps<'_, Self>> {
        Some(self)
    }

    fn support_memory_map(&mut self) -> Option<MemoryMapOps<'_, Self>> {
        Some(self)
    }

    fn support_monitor_cmd(&mut self) -> Option<MonitorCmdOps<'_, Self>> {
        Some(self)
    }
}

impl<W: MemoryWindow> SingleThreadBase for Session<W> {
    fn read_registers(&mut self, registers: &mut Rv64Registers) -> TargetResult<(), Self> {
        let tracer = self.tracer();
        for (place, x) in (0..).zip(registers.x.iter_mut().skip(1)) {
            *x = tracer.register(place)?;
        }
        registers.pc = tracer.register(frame::PC)?;
        for (place, f) in (frame::FLOATS..).zip(&mut registers.f) {
            *f = tracer.register(place)?;
        }
        registers.fcsr = tracer.register(frame::FCSR)? as u32;
        Ok(())
    }

    fn write_registers(&mut self, registers: &Rv64Registers) -> TargetResult<(), Self> {
        let tracer = self.tracer();
        for (place, x) in (0..).zip(registers.x.iter().skip(1)) {
            tracer.set_register(place, *x)?;
        }
        tracer.set_register(frame::PC, registers.pc)?;
        for (place, f) in (frame::FLOATS..).zip(&registers.f) {
            tracer.set_register(place, *f)?;
        }
        Ok(tracer.set_register(frame::FCSR, registers.fcsr.into())?)
    }

    fn read_addrs(&mut self, address: u64, data: &mut [u8]) -> TargetResult<usize, Self> {
        let read = self.debuggee.read(address, data.len());
        data.copy_from_slice(&read.ok_or(TargetError::Errno(FAULT))?);
        // Breakpoints are hidden.
        for planted in self.planted(address, data.len())? {
            for (at, byte) in (planted.address..).zip((planted.original as u16).to_le_bytes()) {
                let place = at
                    .checked_sub(address)
                    .and_then(|at| usize::try_from(at).ok());
                if let Some(shown) = place.and_then(|place| data.get_mut(place)) {
                    *shown = byte;
                }
            }
        }
        Ok(data.len())
    }

    fn write_addrs(&mut self, address: u64, data: &[u8]) -> TargetResult<(), Self> {
        // Windows are accessed by words.
        let words = self.debuggee.words(address, data.len());
        let (begin, before, mut bytes) = words.ok_or(TargetError::Errno(FAULT))?;
        if !self.planted(address, data.len())?.is_empty() {
            // They are planted again when the program goes on.
            self.tracer().plant(&[], false)?;
        }
        for (place, byte) in bytes.iter_mut().skip(before).zip(data) {
            *place = *byte;
        }
        let written = self.debuggee.memory.write(begin, &bytes);
        written.map_err(|_| TargetError::Errno(FAULT))
    }

    fn support_resume(&mut self) -> Option<SingleThreadResumeOps<'_, Self>> {
        Some(self)
    }
}

impl<W: MemoryWindow> SingleThreadResume for Session<W> {
    /// Programs of harts have no signals.
    fn resume(&mut self, _: Option<Signal>) -> Result<(), TracerError> {
        match self.tracer().plant(&self.wanted, true) {
            // The program stays held, which GDB is told.
            Err(TracerError::Refused { .. }) => Ok(()),
            other => other,
        }
    }
}

impl<W: MemoryWindow> Breakpoints for Session<W> {
    fn support_sw_breakpoint(&mut self) -> Option<SwBreakpointOps<'_, Self>> {
        Some(self)
    }
}

impl<W: MemoryWindow> SwBreakpoint for Session<W> {
    fn add_sw_breakpoint(&mut self, address: u64, _: usize) -> TargetResult<bool, Self> {
        if self.wanted.contains(&address) {
            return Ok(true);
        }
        let is_code = self.debuggee.code.contains(&address) && address.is_multiple_of(2);
        if !is_code || self.wanted.len() >= MOST_BREAKPOINTS {
            return Ok(false);
        }
        self.wanted.push(address);
        Ok(true)
    }

    fn remove_sw_breakpoint(&mut self, address: u64, _: usize) -> TargetResult<bool, Self> {
        let before = self.wanted.len();
        self.wanted.retain(|wanted| *wanted != address);
        Ok(self.wanted.len() < before)
    }
}

impl<W: MemoryWindow> SectionOffsets for Session<W> {
    fn get_section_offsets(&mut self) -> Result<Offsets<u64>, TracerError> {
        let bias = self.debuggee.bias;
        Ok(Offsets::Sections {
            text: bias,
            data: bias,
            bss: None,
        })
    }
}

impl<W: MemoryWindow> MemoryMap for Session<W> {
    fn memory_map_xml(
        &self,
        offset: u64,
        length: usize,
        buffer: &mut [u8],
    ) -> TargetResult<usize, Self> {
        let (base, bytes) = (self.debuggee.base, self.debuggee.memory.size());
        let xml = format!(
            "<?xml version=\"1.0\"?><!DOCTYPE memory-map PUBLIC \"+//IDN gnu.org//DTD GDB Memory Map \
             V1.0//EN\" \"http://sourceware.org/gdb/gdb-memory-map.dtd\"><memory-map>\
             <memory type=\"ram\" start=\"{base:#x}\" length=\"{bytes:#x}\"/></memory-map>"
        );
        let begin = usize::try_from(offset).unwrap_or(usize::MAX);
        let rest = xml.as_bytes().get(begin..).unwrap_or_default();
        let len = rest.len().min(length).min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(rest.iter().take(len)) {
            *place = *byte;
        }
        Ok(len)
    }
}

impl<W: MemoryWindow> MonitorCmd for Session<W> {
    fn handle_monitor_cmd(
        &mut self,
        command: &[u8],
        mut out: ConsoleOutput<'_>,
    ) -> Result<(), TracerError> {
        let tracer = self.tracer();
        match command.trim_ascii() {
            b"trap" => {
                let [cause, value, status] = [frame::CAUSE, frame::VALUE, frame::STATUS];
                outputln!(
                    out,
                    "cause {:#x}, value {:#x}, mstatus {:#x}",
                    tracer.register(cause)?,
                    tracer.register(value)?,
                    tracer.register(status)?
                );
            }
            b"statistics" => {
                let (holds, planted) = (tracer.holds()?, tracer.planted()?.len());
                outputln!(
                    out,
                    "{}: held {holds} times; {planted} breakpoints are planted",
                    self.debuggee.name
                );
            }
            other => {
                let other = String::from_utf8_lossy(other);
                if !matches!(&*other, "" | "help") {
                    outputln!(out, "there is no command `{}`", other.escape_debug());
                }
                outputln!(out, "monitor trap: cause and value of the last trap");
                outputln!(out, "monitor statistics: how often the program was held");
            }
        }
        Ok(())
    }
}
