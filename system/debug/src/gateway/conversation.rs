//! [`Conversation`]: what GDB and a gateway tell each other, and when.
//!
//! In all-stop mode GDB resumes programs and waits until one of them stops, which stops all. In non-stop mode
//! each stops alone; GDB is told by notifications, of which it acknowledges one after the other, and
//! may ask for anything meanwhile.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use condor_mbox::MemoryWindow;

use super::connection::{GdbInput, PacketStream, hex, hexed};
use super::riscv::frame;
use super::session::{AttachedProcessor, ProgramEnd, Session, SessionError};
use super::step;
use crate::{Breakpoint, HoldReason, ProgramState, TracerError, Trigger, TriggerAccess};

/// The number of looks at programs before the wait between looks becomes longer.
const LOOKS: u32 = 2000;
const NAP: Duration = Duration::from_micros(100);
/// After so many looks, some tenths of a second, nobody steps.
const FREQUENT: u32 = 5000;
const LONG_NAP: Duration = Duration::from_millis(2);
/// The time for which GDB is waited for at once while all programs stand.
const IDLE: Duration = Duration::from_secs(1);
/// The packet that says that something was done.
const OK: &str = "OK";

/// The answer to a packet.
pub(super) enum Answer {
    Packet(Vec<u8>),
    /// GDB waits until a program stops.
    Later,
    /// GDB goes away.
    Over {
        is_acknowledged: bool,
        /// Whether it wants the programs to be killed.
        kills: bool,
    },
}

impl Answer {
    pub(super) fn text(text: impl Into<String>) -> Self {
        Self::Packet(text.into().into_bytes())
    }

    pub(super) fn ok() -> Self {
        Self::text(OK)
    }

    /// Something cannot be done.
    pub(super) fn refused() -> Self {
        Self::text("E01")
    }

    /// GDB does without what the packet asks for.
    pub(super) const fn unknown() -> Self {
        Self::Packet(Vec::new())
    }
}

/// The threads that an identifier names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Threads {
    /// All, or any.
    All,
    /// The thread at this place.
    One(usize),
}

pub(super) struct Conversation<'s, W: MemoryWindow> {
    pub(super) session: &'s mut Session<W>,
    stream: PacketStream,
    is_non_stop: bool,
    /// The place of the thread whose registers GDB means.
    pub(super) chosen: usize,
    /// In all-stop mode: GDB waits until a program stops.
    waits: bool,
    /// In non-stop mode: the stops that GDB has not acknowledged. It was notified of the first.
    reports: VecDeque<String>,
    /// GDB knows that all programs have ended.
    pub(super) is_over: bool,
    /// The number of looks at programs since one was resumed.
    looks: u32,
}

impl<W: MemoryWindow> Session<W> {
    /// Serves the GDB at the other end of `stream` until it disconnects; waits for its first byte for at most `limit`.
    /// The programs are stopped when GDB asks for it, which it does at once unless it is in non-stop mode. At the end
    /// the programs go on without breakpoints. Returns true if GDB wants the programs to be killed, which the caller
    /// must do.
    ///
    /// # Errors
    /// [`SessionError::NoProgram`] if all programs have ended; [`SessionError::Tracer`] if a processor does
    /// not answer; [`SessionError::Connection`] if the connection is lost or is not GDB's. The programs go
    /// on then, too.
    pub fn serve(
        &mut self,
        mut stream: PacketStream,
        limit: Duration,
    ) -> Result<bool, SessionError> {
        match stream.begins(limit) {
            Ok(true) => {}
            Ok(false) => {
                return Err(SessionError::Connection(
                    "the client did not begin as GDB does".into(),
                ));
            }
            Err(error) => return Err(SessionError::Connection(error.to_string())),
        }
        if !self.processors.iter().any(AttachedProcessor::is_alive) {
            let names = self.processors.iter().map(|it| &*it.debuggee.name);
            let name = names.collect::<Vec<_>>().join(", ");
            return Err(SessionError::NoProgram { name });
        }
        for attached in &mut self.processors {
            attached.runs = attached.named(attached.tracer().state())? == ProgramState::Runs;
        }
        let served = Conversation::new(self, stream).serve();
        for attached in &mut self.processors {
            attached.wanted.clear();
            if attached.is_alive() {
                attached.named(attached.tracer().plant(&[], true))?;
            }
        }
        served
    }
}

fn lost(error: &io::Error) -> SessionError {
    SessionError::Connection(error.to_string())
}

impl<'s, W: MemoryWindow> Conversation<'s, W> {
    pub(super) const fn new(session: &'s mut Session<W>, stream: PacketStream) -> Self {
        Self {
            session,
            stream,
            is_non_stop: false,
            chosen: 0,
            waits: false,
            reports: VecDeque::new(),
            is_over: false,
            looks: 0,
        }
    }

    /// Serves GDB until it goes away. Returns true if it wants the programs to be killed.
    pub(super) fn serve(mut self) -> Result<bool, SessionError> {
        loop {
            if self.waits || self.is_non_stop {
                self.look()?;
            }
            let one_runs = self.session.processors.iter().any(|it| it.runs);
            self.looks = FREQUENT.min(self.looks + 1);
            let nap = match self.looks {
                _ if !one_runs => IDLE,
                0..LOOKS if !self.looks.is_multiple_of(100) => {
                    core::hint::spin_loop();
                    continue;
                }
                0..LOOKS => Duration::ZERO,
                LOOKS..FREQUENT => NAP,
                _ => LONG_NAP,
            };
            let answer = match self.stream.hear(nap) {
                Ok(None) => continue,
                Ok(Some(GdbInput::Interrupt)) => {
                    self.interrupt()?;
                    continue;
                }
                Ok(Some(GdbInput::Packet(packet))) => self.answer(&packet)?,
                Err(_) if self.is_over => return Ok(false),
                Err(error) => return Err(lost(&error)),
            };
            match answer {
                Answer::Packet(packet) => self.stream.send(&packet).map_err(|it| lost(&it))?,
                Answer::Later => {}
                Answer::Over {
                    is_acknowledged,
                    kills,
                } => {
                    if is_acknowledged {
                        // If this fails, GDB has gone in another way.
                        let _ = self.stream.send(OK.as_bytes());
                    }
                    return Ok(kills);
                }
            }
        }
    }

    /// Tells GDB of programs that have stopped or ended.
    fn look(&mut self) -> Result<(), SessionError> {
        for place in 0..self.session.processors.len() {
            let Some(attached) = self.session.processors.get_mut(place) else {
                break;
            };
            if !attached.runs {
                continue;
            }
            let ProgramState::Held(reason) = attached.named(attached.tracer().state())? else {
                continue;
            };
            attached.runs = false;
            let report = attached.named(attached.report(place, reason))?;
            self.chosen = place;
            self.tell(report)?;
            if !self.is_non_stop {
                return Ok(());
            }
        }
        if !self.is_over
            && !self
                .session
                .processors
                .iter()
                .any(AttachedProcessor::is_alive)
        {
            self.is_over = true;
            let report = self.end();
            self.tell(report)?;
        }
        Ok(())
    }

    /// Returns the packet that says how the programs have ended, of which GDB knows one inferior.
    fn end(&self) -> String {
        let first = self.session.processors.first();
        match first.and_then(AttachedProcessor::ended) {
            Some(ProgramEnd::Exited(status)) => format!("W{status:02x}"),
            Some(ProgramEnd::Killed) | None => "X09".into(),
        }
    }

    fn tell(&mut self, report: String) -> Result<(), SessionError> {
        if !self.is_non_stop {
            self.waits = false;
            for attached in &mut self.session.processors {
                attached.stop()?;
                attached.runs = false;
            }
            return self.stream.send(report.as_bytes()).map_err(|it| lost(&it));
        }
        if self.reports.is_empty() {
            let notification = format!("Stop:{report}");
            let sent = self.stream.notify(notification.as_bytes());
            sent.map_err(|it| lost(&it))?;
        }
        self.reports.push_back(report);
        Ok(())
    }

    /// Stops what runs; [`look`](Self::look) tells of it.
    fn interrupt(&mut self) -> Result<(), SessionError> {
        for attached in self.session.processors.iter_mut().filter(|it| it.runs) {
            attached.is_asked_to_stop = false;
            attached.stop()?;
            if !self.is_non_stop {
                break;
            }
        }
        Ok(())
    }

    fn answer(&mut self, packet: &[u8]) -> Result<Answer, SessionError> {
        let Some((first, rest)) = packet.split_first() else {
            return Ok(Answer::unknown());
        };
        Ok(match first {
            b'?' => self.reasons()?,
            b'v' => return self.answer_word(rest),
            b'q' => self.query(rest)?,
            b'Q' => self.set(rest),
            b'H' => self.choose(rest),
            b'T' => match self.thread(rest) {
                Some(Threads::One(_)) => Answer::ok(),
                _ => Answer::refused(),
            },
            b'g' | b'p' => self.read_registers(*first, rest)?,
            b'G' | b'P' => self.write_registers(*first, rest)?,
            b'm' => self.read_memory(rest)?,
            b'M' | b'X' => self.write_memory(*first, rest)?,
            b'c' | b'C' | b's' | b'S' if rest.is_empty() || matches!(first, b'C' | b'S') => {
                return self.resume(&[*first]);
            }
            b'Z' | b'z' => self.change_breakpoint(*first == b'Z', rest)?,
            b'D' => Answer::Over {
                is_acknowledged: true,
                kills: false,
            },
            b'k' => Answer::Over {
                is_acknowledged: false,
                kills: true,
            },
            _ => Answer::unknown(),
        })
    }

    /// Packets with a word behind `v`.
    fn answer_word(&mut self, packet: &[u8]) -> Result<Answer, SessionError> {
        if let Some(actions) = packet.strip_prefix(b"Cont;") {
            return self.resume(actions);
        }
        Ok(match packet {
            b"Cont?" => Answer::text("vCont;c;C;s;S;t"),
            b"CtrlC" => {
                self.interrupt()?;
                Answer::ok()
            }
            b"Stopped" => {
                self.reports.pop_front();
                self.next_report()
            }
            _ if packet.starts_with(b"Kill;") => Answer::Over {
                is_acknowledged: true,
                kills: true,
            },
            _ => Answer::unknown(),
        })
    }

    fn next_report(&self) -> Answer {
        self.reports
            .front()
            .map_or_else(Answer::ok, |report| Answer::text(report.as_str()))
    }

    fn set(&mut self, packet: &[u8]) -> Answer {
        match packet {
            b"StartNoAckMode" => self.stream.stop_acknowledging(),
            b"NonStop:1" => self.is_non_stop = true,
            b"NonStop:0" => self.is_non_stop = false,
            _ => return Answer::unknown(),
        }
        Answer::ok()
    }

    /// Returns the reasons why the programs stand. In all-stop mode it stops them.
    fn reasons(&mut self) -> Result<Answer, SessionError> {
        let (mut first, mut all) = (None, VecDeque::new());
        for (place, attached) in self.session.processors.iter_mut().enumerate() {
            if !self.is_non_stop {
                attached.stop()?;
            }
            let ProgramState::Held(reason) = attached.named(attached.tracer().state())? else {
                continue;
            };
            attached.runs = false;
            attached.is_asked_to_stop = true;
            let report = attached.named(attached.report(place, reason))?;
            // One that has a reason of its own comes first.
            if first.is_none_or(|(_, before)| before == HoldReason::Stopped && before != reason) {
                first = Some((place, reason));
                all.push_front(report);
            } else {
                all.push_back(report);
            }
        }
        self.waits = false;
        if let Some((place, _)) = first {
            self.chosen = place;
        }
        if self.is_non_stop {
            self.reports = all;
            return Ok(self.next_report());
        }
        Ok(Answer::text(all.pop_front().unwrap_or_else(|| self.end())))
    }

    /// `vCont`: what each thread does, by the first action that means it.
    fn resume(&mut self, actions: &[u8]) -> Result<Answer, SessionError> {
        let mut parsed = Vec::new();
        for action in actions.split(|byte| *byte == b';') {
            let mut parts = action.splitn(2, |byte| *byte == b':');
            let what = parts.next().and_then(|what| what.first().copied());
            let thread = parts.next();
            let thread = thread.map_or(Some(Threads::All), |text| self.thread(text));
            let (Some(what @ (b'c' | b'C' | b's' | b'S' | b't')), Some(thread)) = (what, thread)
            else {
                return Ok(Answer::refused());
            };
            parsed.push((what, thread));
        }
        self.looks = 0;
        let mut refused = Vec::new();
        for (place, attached) in self.session.processors.iter_mut().enumerate() {
            let is_meant = |it: &Threads| matches!(it, Threads::All) || *it == Threads::One(place);
            match parsed.iter().find(|(_, thread)| is_meant(thread)) {
                Some((b't', _)) => {
                    attached.is_asked_to_stop = true;
                    attached.stop()?;
                }
                Some((what, _)) if !attached.runs => {
                    let goes_on = attached.go_on(matches!(what, b's' | b'S'))?;
                    refused.extend((!goes_on).then_some(place));
                }
                _ => {}
            }
        }
        self.waits = !self.is_non_stop;
        for place in refused {
            self.tell_refused(place)?;
            if !self.is_non_stop {
                break;
            }
        }
        Ok(if self.is_non_stop {
            Answer::ok()
        } else {
            Answer::Later
        })
    }

    /// Tells GDB that a program does not step: as a stop for which it does not step once more.
    fn tell_refused(&mut self, place: usize) -> Result<(), SessionError> {
        let Some(attached) = self.session.processors.get(place) else {
            return Ok(());
        };
        if !self.is_non_stop {
            let name = &attached.debuggee.name;
            let text = format!(
                "{name}: cannot step from here; set a breakpoint where the program continues\n"
            );
            let packet = [b"O", &*hexed(text.as_bytes())].concat();
            self.stream.send(&packet).map_err(|it| lost(&it))?;
        }
        self.chosen = place;
        self.tell(format!("T02thread:{:x};", place + 1))
    }

    fn choose(&mut self, packet: &[u8]) -> Answer {
        let Some((what @ (b'g' | b'c'), thread)) = packet.split_first() else {
            return Answer::unknown();
        };
        match (what, self.thread(thread)) {
            (_, None) => return Answer::refused(),
            (b'g', Some(Threads::One(place))) => self.chosen = place,
            _ => {}
        }
        Answer::ok()
    }

    /// Returns the threads that an identifier from GDB names; `None` if there is no such thread.
    fn thread(&self, text: &[u8]) -> Option<Threads> {
        if text == b"-1" || text == b"0" {
            return Some(Threads::All);
        }
        let place = usize::try_from(hex(text)?.checked_sub(1)?).ok()?;
        let attached = self.session.processors.get(place)?;
        attached.is_alive().then_some(Threads::One(place))
    }
}

impl<W: MemoryWindow> AttachedProcessor<W> {
    /// Resumes the program, with the breakpoints that GDB wants, for one instruction if it `steps`. Returns
    /// false if no step can end where the instruction leads.
    fn go_on(&mut self, steps: bool) -> Result<bool, SessionError> {
        self.is_asked_to_stop = false;
        self.runs = true;
        self.steps.clear();
        if steps {
            self.stepped = self.named(self.tracer().register(frame::PC))?;
            self.steps = self.named(self.ends(self.stepped))?;
        }
        match self.tracer().plant(&self.breakpoints(), true) {
            Err(TracerError::Refused { address }) if self.steps.contains(&address) => {
                self.runs = false;
                self.steps.clear();
                Ok(false)
            }
            // The program stays held, which GDB is told.
            Err(TracerError::Refused { .. }) => Ok(true),
            other => self.unless_ended(other).map(|_| true),
        }
    }

    /// Returns the breakpoints to plant: those that GDB wants, and those where a step ends. The instruction
    /// that is stepped is executed, even if GDB wants a breakpoint there.
    pub(super) fn breakpoints(&self) -> Vec<Breakpoint> {
        let mut all = self.wanted.clone();
        if self.runs && !self.steps.is_empty() {
            all.retain(|it| *it != Breakpoint::Instruction(self.stepped));
            all.extend(self.steps.iter().map(|end| Breakpoint::Instruction(*end)));
        }
        all
    }

    /// Returns the addresses at which a step from `pc` may end.
    fn ends(&self, pc: u64) -> Result<Vec<u64>, TracerError> {
        let fetch = |at: u64| {
            let halves = [at, at.wrapping_add(2)].map(|at| self.debuggee.read(at, 2));
            let [Some(low), high] = halves else {
                return Ok(None);
            };
            let mut bytes = [low, high.unwrap_or_default()].concat();
            bytes.resize(4, 0);
            self.hide_breakpoints(at, &mut bytes)?;
            Ok(bytes.first_chunk().map(|word| u32::from_le_bytes(*word)))
        };
        let x = |register: u32| match register {
            0 => Ok(0),
            register => self.tracer().register(register - 1),
        };
        step::ends(pc, fetch, x)
    }

    /// Stops the program, if there is one.
    fn stop(&self) -> Result<(), SessionError> {
        if !self.is_alive() {
            return Ok(());
        }
        self.unless_ended(self.tracer().stop()).map(drop)
    }

    /// An error of a processor counts unless its program has ended meanwhile.
    pub(super) fn unless_ended<T>(
        &self,
        result: Result<T, TracerError>,
    ) -> Result<Option<T>, SessionError> {
        match result {
            Err(_) if !self.is_alive() => Ok(None),
            other => self.named(other).map(Some),
        }
    }

    /// The report of a stop, of the thread at `place`.
    fn report(&self, place: usize, reason: HoldReason) -> Result<String, TracerError> {
        let why = match reason {
            HoldReason::Stopped if self.is_asked_to_stop => "00".into(),
            // SIGINT.
            HoldReason::Stopped => "02".into(),
            HoldReason::Breakpoint => {
                let pc = self.tracer().register(frame::PC)?;
                let is_wanted = self.wanted.contains(&Breakpoint::Instruction(pc));
                let stepped = self.steps.contains(&pc) && !is_wanted;
                if stepped { "05" } else { "05swbreak:;" }.into()
            }
            HoldReason::Exception => format!("{:02x}", self.signal()?),
            HoldReason::Trigger => format!("05{}", self.hit()?),
        };
        Ok(format!("T{why}thread:{:x};", place + 1))
    }

    /// The signal by which Linux tells of an exception: SIGBUS, SIGILL, SIGTRAP, SIGSYS or SIGSEGV.
    fn signal(&self) -> Result<u8, TracerError> {
        Ok(match self.tracer().register(frame::CAUSE)? {
            0 | 4 | 6 => 10,
            2 => 4,
            3 => 5,
            8..=11 => 12,
            _ => 11,
        })
    }

    /// The trigger that has stopped the program, as a report has it.
    fn hit(&self) -> Result<String, TracerError> {
        let (pc, value) = (
            self.tracer().register(frame::PC)?,
            self.tracer().register(frame::VALUE)?,
        );
        let planted = self.tracer().planted()?.into_iter();
        let triggers = planted.filter_map(|it| match it.breakpoint {
            Breakpoint::Trigger(trigger) => Some(trigger),
            Breakpoint::Instruction(_) => None,
        });
        let triggers: Vec<Trigger> = triggers.collect();
        let is_here = |it: &&Trigger| it.access == TriggerAccess::Execute && it.address == pc;
        let holds = |it: &&Trigger| {
            let end = it.address.saturating_add(it.bytes.into());
            it.access != TriggerAccess::Execute && (it.address..end).contains(&value)
        };
        let is_data = |it: &&Trigger| it.access != TriggerAccess::Execute;
        let mut all = triggers.iter();
        let exact = all
            .clone()
            .find(is_here)
            .or_else(|| all.clone().find(holds));
        // A processor need not say which address it was.
        let hit = exact.or_else(|| all.find(is_data));
        Ok(match hit.map(|it| (it.access, it.address)) {
            Some((TriggerAccess::Execute, _)) => "hwbreak:;".into(),
            Some((TriggerAccess::Write, address)) => format!("watch:{address:x};"),
            Some((TriggerAccess::Read, address)) => format!("rwatch:{address:x};"),
            Some((TriggerAccess::ReadWrite, address)) => format!("awatch:{address:x};"),
            None => String::new(),
        })
    }
}
