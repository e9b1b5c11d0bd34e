//! The answers to GDB: queries, registers, memory, breakpoints, commands of `monitor`.

use condor_mbox::MemoryWindow;

use super::connection::{PACKET_BYTES, hex, hexed, unescaped, unhex};
use super::conversation::{Answer, Conversation};
use super::riscv::{self, frame};
use super::session::{AttachedProcessor, SessionError};
use crate::{Breakpoint, ProgramState, TracerError, Trigger, TriggerAccess};

/// As many breakpoints as a stub has room for.
const MOST_BREAKPOINTS: usize = crate::area::MOST_PLANTED as usize;
/// The size of a planted breakpoint.
const BREAKPOINT_BYTES: u64 = 2;
/// The answer about memory that programs cannot access: `EFAULT`.
const FAULT: &str = "E0e";
/// The commands of `monitor`.
const HELP: &str = "\
monitor trap: cause and value of the last trap
monitor statistics: how often the debugger stopped programs
monitor vectors: which messages the program handles, and how many it has handled
monitor reset: starts the program again, and stops it at its first statement
monitor load FILE ARGUMENTS: starts another program, and stops it at its first statement
";
/// The greatest number of bytes of memory or of a document in an answer.
const MOST_BYTES: usize = PACKET_BYTES / 2 - 4;

/// Two hexadecimal numbers with a comma between them.
fn pair(text: &[u8]) -> Option<(u64, u64)> {
    let (first, second) = split(text, b',')?;
    Some((hex(first)?, hex(second)?))
}

/// Splits a text at the first `mark`, which neither part has.
fn split(text: &[u8], mark: u8) -> Option<(&[u8], &[u8])> {
    let (before, behind) = text.split_at(text.iter().position(|byte| *byte == mark)?);
    Some((before, behind.get(1..)?))
}

/// The piece of a document that GDB asks for by offset and length.
fn piece(document: &str, asked: &[u8]) -> Answer {
    let Some((offset, len)) = pair(asked) else {
        return Answer::refused();
    };
    let offset = usize::try_from(offset).unwrap_or(usize::MAX);
    let rest = document.as_bytes().get(offset..).unwrap_or_default();
    let len = usize::try_from(len).unwrap_or(usize::MAX);
    let len = rest.len().min(len).min(MOST_BYTES);
    let first = if len < rest.len() { b'm' } else { b'l' };
    let bytes = rest.iter().take(len).flat_map(|&byte| match byte {
        b'#' | b'$' | b'}' | b'*' => vec![b'}', byte ^ 0x20],
        byte => vec![byte],
    });
    Answer::Packet(core::iter::once(first).chain(bytes).collect())
}

fn escaped(text: &str) -> String {
    let letters = text.chars().map(|letter| match letter {
        '&' => "&amp;".into(),
        '<' => "&lt;".into(),
        '>' => "&gt;".into(),
        '"' => "&quot;".into(),
        letter => letter.to_string(),
    });
    letters.collect()
}

impl<W: MemoryWindow> Conversation<'_, W> {
    fn chosen(&self) -> Option<&AttachedProcessor<W>> {
        self.session.processors.get(self.chosen)
    }

    pub(super) fn query(&mut self, packet: &[u8]) -> Result<Answer, SessionError> {
        if packet.starts_with(b"Supported") {
            return Ok(Answer::text(format!(
                "PacketSize={PACKET_BYTES:x};QStartNoAckMode+;QNonStop+;swbreak+;hwbreak+;vContSupported+;\
                 qXfer:features:read+;qXfer:memory-map:read+;qXfer:threads:read+"
            )));
        }
        if let Some(asked) = packet.strip_prefix(b"Xfer:features:read:target.xml:") {
            return Ok(piece(riscv::DESCRIPTION, asked));
        }
        if let Some(asked) = packet.strip_prefix(b"Xfer:memory-map:read::") {
            return Ok(piece(&self.memory_map(), asked));
        }
        if let Some(asked) = packet.strip_prefix(b"Xfer:threads:read::") {
            return Ok(piece(&self.threads(), asked));
        }
        if let Some(command) = packet.strip_prefix(b"Rcmd,") {
            let command = unhex(command).unwrap_or_default();
            let text = self.monitor(String::from_utf8_lossy(&command).trim())?;
            return Ok(Answer::Packet(hexed(text.as_bytes())));
        }
        Ok(match packet {
            b"fThreadInfo" => {
                let alive = self.alive().map(|(thread, _)| format!("{thread:x}"));
                Answer::text(format!("m{}", alive.collect::<Vec<_>>().join(",")))
            }
            b"sThreadInfo" => Answer::text("l"),
            b"C" => Answer::text(format!("QC{:x}", self.chosen + 1)),
            b"Attached" => Answer::text("1"),
            b"Offsets" => {
                // Those of other processors come with their symbols.
                let bias = self
                    .session
                    .processors
                    .first()
                    .map_or(0, |it| it.debuggee.bias);
                Answer::text(format!("Text={bias:x};Data={bias:x};Bss={bias:x}"))
            }
            _ => Answer::unknown(),
        })
    }

    /// Threads with a program, by their identifiers.
    fn alive(&self) -> impl Iterator<Item = (usize, &AttachedProcessor<W>)> {
        let processors = (1..).zip(&self.session.processors);
        processors.filter(|(_, attached)| attached.is_alive())
    }

    fn threads(&self) -> String {
        let threads = self.alive().map(|(thread, attached)| {
            let name = escaped(&attached.debuggee.name);
            format!("<thread id=\"{thread:x}\" name=\"{name}\"/>")
        });
        let threads: String = threads.collect();
        format!("<?xml version=\"1.0\"?><threads>{threads}</threads>")
    }

    fn memory_map(&self) -> String {
        let memory = self
            .session
            .processors
            .first()
            .map_or((0, 0), |it| (it.debuggee.base, it.debuggee.memory.size()));
        let (base, bytes) = memory;
        format!(
            "<?xml version=\"1.0\"?><!DOCTYPE memory-map PUBLIC \"+//IDN gnu.org//DTD GDB Memory Map \
             V1.0//EN\" \"http://sourceware.org/gdb/gdb-memory-map.dtd\"><memory-map>\
             <memory type=\"ram\" start=\"{base:#x}\" length=\"{bytes:#x}\"/></memory-map>"
        )
    }

    /// The thread whose registers GDB means, if its program stands.
    fn held(&self) -> Result<Option<&AttachedProcessor<W>>, SessionError> {
        let Some(attached) = self.chosen() else {
            return Ok(None);
        };
        let state = attached.named(attached.tracer().state())?;
        Ok((state != ProgramState::Runs).then_some(attached))
    }

    pub(super) fn read_registers(&self, what: u8, rest: &[u8]) -> Result<Answer, SessionError> {
        let Some(attached) = self.held()? else {
            return Ok(Answer::refused());
        };
        let tracer = attached.tracer();
        let bytes = if what == b'g' {
            attached.named(riscv::read_all(tracer))?
        } else {
            let register = hex(rest).and_then(|register| u32::try_from(register).ok());
            let read = register.map_or(Ok(None), |register| riscv::read(tracer, register));
            match attached.named(read)? {
                Some(bytes) => bytes,
                None => return Ok(Answer::refused()),
            }
        };
        Ok(Answer::Packet(hexed(&bytes)))
    }

    pub(super) fn write_registers(&self, what: u8, rest: &[u8]) -> Result<Answer, SessionError> {
        let Some(attached) = self.held()? else {
            return Ok(Answer::refused());
        };
        let tracer = attached.tracer();
        let is_written = if what == b'G' {
            let bytes = unhex(rest);
            bytes.map_or(Ok(false), |bytes| riscv::write_all(tracer, &bytes))
        } else {
            let parts = split(rest, b'=').and_then(|(register, bytes)| {
                let register = u32::try_from(hex(register)?).ok()?;
                Some((register, unhex(bytes)?))
            });
            parts.map_or(Ok(false), |(register, bytes)| {
                riscv::write(tracer, register, &bytes).map(|written| written.is_some())
            })
        };
        Ok(if attached.named(is_written)? {
            Answer::ok()
        } else {
            Answer::refused()
        })
    }

    pub(super) fn read_memory(&self, asked: &[u8]) -> Result<Answer, SessionError> {
        let (Some((address, len)), Some(chosen)) = (pair(asked), self.chosen()) else {
            return Ok(Answer::refused());
        };
        let len = usize::try_from(len).unwrap_or(usize::MAX).min(MOST_BYTES);
        let Some(mut bytes) = chosen.debuggee.read(address, len) else {
            return Ok(Answer::text(FAULT));
        };
        for attached in &self.session.processors {
            attached.named(attached.hide_breakpoints(address, &mut bytes))?;
        }
        Ok(Answer::Packet(hexed(&bytes)))
    }

    pub(super) fn write_memory(&self, what: u8, rest: &[u8]) -> Result<Answer, SessionError> {
        let parts = split(rest, b':').and_then(|(place, data)| {
            let (address, len) = pair(place)?;
            let bytes = if what == b'X' {
                unescaped(data)
            } else {
                unhex(data)?
            };
            (bytes.len() as u64 == len).then_some((address, bytes))
        });
        let (Some((address, bytes)), Some(chosen)) = (parts, self.chosen()) else {
            return Ok(Answer::refused());
        };
        let mut disturbed = Vec::new();
        for attached in &self.session.processors {
            let inside = attached.named(attached.planted(address, bytes.len()))?;
            if !inside.is_empty() {
                let mut others = attached.breakpoints();
                others.retain(|it| {
                    let is_it = |(at, _): &(u64, u16)| *it == Breakpoint::Instruction(*at);
                    !inside.iter().any(is_it)
                });
                attached.unless_ended(attached.tracer().plant(&others, false))?;
                disturbed.push(attached);
            }
        }
        let is_written = chosen.debuggee.write(address, &bytes).is_some();
        for attached in disturbed {
            // If GDB has made the program one in which no breakpoint can be, none is.
            match attached.tracer().plant(&attached.breakpoints(), false) {
                Err(TracerError::Refused { .. }) => {}
                other => drop(attached.unless_ended(other)?),
            }
        }
        Ok(if is_written {
            Answer::ok()
        } else {
            Answer::text(FAULT)
        })
    }

    /// `Z` and `z`: kind, address and size.
    pub(super) fn change_breakpoint(
        &mut self,
        inserts: bool,
        rest: &[u8],
    ) -> Result<Answer, SessionError> {
        // Conditions may follow, which GDB checks itself.
        let rest = split(rest, b';').map_or(rest, |(before, _)| before);
        let parts = split(rest, b',').and_then(|(kind, rest)| Some((hex(kind)?, pair(rest)?)));
        let Some((kind, (address, bytes))) = parts else {
            return Ok(Answer::refused());
        };
        let trigger = |access| {
            let bytes = u8::try_from(bytes).ok();
            let bytes = bytes.filter(|bytes| matches!(bytes, 1 | 2 | 4 | 8))?;
            Some(Breakpoint::Trigger(Trigger {
                address,
                access,
                bytes,
            }))
        };
        let breakpoint = match kind {
            0 => Some(Breakpoint::Instruction(address)),
            1 => trigger(TriggerAccess::Execute),
            2 => trigger(TriggerAccess::Write),
            3 => trigger(TriggerAccess::Read),
            4 => trigger(TriggerAccess::ReadWrite),
            _ => return Ok(Answer::unknown()),
        };
        let Some(breakpoint) = breakpoint else {
            return Ok(Answer::refused());
        };
        // An address in the range of no processor belongs to all.
        let is_in = |attached: &AttachedProcessor<W>| attached.debuggee.code.contains(&address);
        let is_owned = self.session.processors.iter().any(is_in);
        let mut is_done = is_owned || kind > 1;
        for attached in &mut self.session.processors {
            if is_in(attached) || !is_owned && kind > 1 {
                is_done &= if inserts {
                    attached.want(breakpoint)?
                } else {
                    attached.forget(breakpoint)?
                };
            }
        }
        if inserts && !is_done {
            for attached in &mut self.session.processors {
                attached.forget(breakpoint)?;
            }
        }
        Ok(if is_done {
            Answer::ok()
        } else {
            Answer::refused()
        })
    }

    /// The text that a command of `monitor` prints.
    fn monitor(&mut self, command: &str) -> Result<String, SessionError> {
        let mut words = command.split_whitespace();
        let word = words.next().unwrap_or("help");
        let rest: Vec<_> = words.collect();
        let all = self.session.processors.iter();
        Ok(match (word, &*rest) {
            ("trap", []) => all.map(AttachedProcessor::trap).collect::<Result<_, _>>()?,
            ("statistics", []) => all
                .map(AttachedProcessor::statistics)
                .collect::<Result<_, _>>()?,
            ("vectors", []) => all.map(AttachedProcessor::vectors).collect(),
            ("reset" | "load", []) => self.start(None)?,
            ("load", [file, arguments @ ..]) => self.start(Some((file, arguments.to_vec())))?,
            ("help", []) => HELP.into(),
            _ => format!("there is no command `{}`\n{HELP}", command.escape_debug()),
        })
    }

    /// Has a program of the only processor start, and says where it is held.
    fn start(&mut self, file: Option<(&str, Vec<&str>)>) -> Result<String, SessionError> {
        // GDB does not say which thread it means by a command.
        let [attached] = &mut *self.session.processors else {
            let text = "a program cannot be started while several processors are debugged: debug its processor alone\n";
            return Ok(text.into());
        };
        let text = match attached.start(file) {
            Ok(()) => {
                let pc = attached.named(attached.tracer().register(frame::PC))?;
                let name = &attached.debuggee.name;
                format!(
                    "{name}: stopped at {pc:#x}; `maintenance flush register-cache` makes GDB read the registers \
                     again\n"
                )
            }
            Err(SessionError::Start { name, reason }) => {
                attached.runs = attached.named(attached.tracer().state())? == ProgramState::Runs;
                format!("{name}: {reason}\n")
            }
            Err(error) => return Err(error),
        };
        self.is_over &= !attached.is_alive();
        Ok(text)
    }
}

impl<W: MemoryWindow> AttachedProcessor<W> {
    fn trap(&self) -> Result<String, SessionError> {
        let register = |place| self.named(self.tracer().register(place));
        Ok(format!(
            "{}: cause {:#x}, value {:#x}, mstatus {:#x}\n",
            self.debuggee.name,
            register(frame::CAUSE)?,
            register(frame::VALUE)?,
            register(frame::STATUS)?
        ))
    }

    fn vectors(&self) -> String {
        let name = &self.debuggee.name;
        match self.debuggee.host.as_ref().map(|it| it.vectors()) {
            Some(Ok(text)) => text,
            Some(Err(reason)) => format!("{name}: {reason}\n"),
            None => format!("{name}: this gateway cannot count its messages\n"),
        }
    }

    fn statistics(&self) -> Result<String, SessionError> {
        let holds = self.named(self.tracer().holds())?;
        let planted = self.named(self.tracer().planted())?.len();
        let name = &self.debuggee.name;
        Ok(format!(
            "{name}: stopped {holds} times; {planted} breakpoints are set\n"
        ))
    }

    /// The breakpoint instructions that lie in `len` bytes at an address, at least in part, and what they
    /// replace.
    fn planted(&self, address: u64, len: usize) -> Result<Vec<(u64, u16)>, TracerError> {
        let end = address.saturating_add(len as u64);
        let planted = self.tracer().planted()?.into_iter();
        let planted = planted.filter_map(|it| match it.breakpoint {
            Breakpoint::Instruction(at) => Some((at, it.original as u16)),
            Breakpoint::Trigger(_) => None,
        });
        let is_inside = |at: u64| at < end && at.saturating_add(BREAKPOINT_BYTES) > address;
        Ok(planted.filter(|(at, _)| is_inside(*at)).collect())
    }

    pub(super) fn hide_breakpoints(
        &self,
        address: u64,
        bytes: &mut [u8],
    ) -> Result<(), TracerError> {
        for (begin, original) in self.planted(address, bytes.len())? {
            for (at, byte) in (begin..).zip(original.to_le_bytes()) {
                let place = at.checked_sub(address);
                let place = place.and_then(|place| usize::try_from(place).ok());
                if let Some(shown) = place.and_then(|place| bytes.get_mut(place)) {
                    *shown = byte;
                }
            }
        }
        Ok(())
    }

    /// Plants a breakpoint, at once or when the program goes on. Returns true if there can be one.
    fn want(&mut self, breakpoint: Breakpoint) -> Result<bool, SessionError> {
        if self.wanted.contains(&breakpoint) {
            return Ok(true);
        }
        let (can_be, can_wait) = match breakpoint {
            Breakpoint::Instruction(address) => {
                let is_closed = self.named(self.tracer().is_closed(address))?;
                (address.is_multiple_of(2) && !is_closed, !self.runs)
            }
            // The processor says whether it has a trigger left.
            Breakpoint::Trigger(_) => (true, false),
        };
        if !can_be || self.wanted.len() >= MOST_BREAKPOINTS {
            return Ok(false);
        }
        self.wanted.push(breakpoint);
        if can_wait {
            // The command that resumes the program plants it.
            return Ok(true);
        }
        match self.tracer().plant(&self.breakpoints(), false) {
            Err(TracerError::Refused { .. }) => {
                self.wanted.pop();
                Ok(false)
            }
            other => Ok(self.unless_ended(other)?.is_some()),
        }
    }

    /// Removes a breakpoint: at once if the program runs, or else before it goes on. Returns true if there was
    /// one.
    fn forget(&mut self, breakpoint: Breakpoint) -> Result<bool, SessionError> {
        let before = self.wanted.len();
        self.wanted.retain(|wanted| *wanted != breakpoint);
        if self.runs && self.wanted.len() < before {
            self.unless_ended(self.tracer().plant(&self.breakpoints(), false))?;
        }
        Ok(self.wanted.len() < before)
    }
}
