//! A processor or a service, from its start to its end and to the next start.

use std::collections::VecDeque;
use std::os::fd::BorrowedFd;
use std::time::{Duration, Instant};

use condor_mbox::Processor;

use super::journal::Journal;
use super::log_share::{LINES, LogShare};
use super::mailbox::SupervisorMailbox;
use crate::control::{self, MemberState};
use crate::description::OnFailure;
use crate::error::me;
use crate::launch::{Exit, Launch, LaunchError, ProgramImage, RunState, StopMethod};
use condor_rt::linux::Environment;
use condor_rt::numbers::MISTAKE;

/// The time that a program may take to join.
const JOIN: Duration = Duration::from_secs(10);
/// The time that a program may take to end before it is killed.
const END: Duration = Duration::from_secs(2);
/// The time without a heartbeat after which a program counts as stalled.
const STALL: Duration = Duration::from_secs(2);
/// The time between two looks at a heart.
pub(super) const LOOK: Duration = Duration::from_millis(500);
/// A program that lived shorter than this is not started again at once.
const SHORT: Duration = Duration::from_secs(1);
/// The time in which restarts are counted.
const MINUTE: Duration = Duration::from_secs(60);

/// The names of a member and of its program, and the reaction to failures of the program.
pub(super) struct Plan {
    pub(super) number: Processor,
    pub(super) name: String,
    pub(super) program: String,
    pub(super) arguments: Vec<String>,
    pub(super) on_failure: OnFailure,
    /// The greatest number of restarts in a minute, or in a row if the program does not join; then
    /// the program has failed for good.
    pub(super) restarts: u32,
    pub(super) stall: Option<Duration>,
    /// The kind of a processor; `None` for a service.
    pub(super) kind: Option<&'static str>,
    pub(super) runs_here: bool,
}

impl Plan {
    pub(super) fn is_service(&self) -> bool {
        self.kind.is_none()
    }
}

pub(super) struct Member {
    pub(super) plan: Plan,
    launch: Box<dyn Launch>,
    /// The environment that its programs get.
    pub(super) environment: Environment,
    hearing: LogShare,
    pub(super) phase: Phase,
    /// Whether its program has joined since it was last wished for.
    pub(super) has_joined: bool,
    /// When a program last did not end when it was asked to, and was killed.
    pub(super) killed: Option<Instant>,
    /// Whether the present incarnation has joined, or the last one had.
    incarnation_joined: bool,
    started: Option<Instant>,
    /// The incarnation before that of the program that has been started.
    incarnation_before: u32,
    heart: Option<(u32, Instant)>,
    /// Since when the program is held for a debugger.
    held_since: Option<Instant>,
    /// Since when it has had the turn of a simulated time without joining.
    has_turn_since: Option<Instant>,
    /// Whether its program has entered the simulated time.
    has_entered: bool,
    restarts: u32,
    recent: VecDeque<Instant>,
    last_exit: Option<Exit>,
    next: Option<ProgramImage>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Stopped,
    /// The member waits for its turn if the system is being brought up (`in_turn`).
    Waiting {
        in_turn: bool,
    },
    Starting,
    Up {
        stalled: bool,
    },
    Ending {
        since: Instant,
        forced: bool,
        then: NextStep,
    },
    Pausing {
        until: Instant,
    },
    Failed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NextStep {
    Stop,
    Start,
    Fail,
}

impl Member {
    pub(super) fn new(
        plan: Plan,
        image: &ProgramImage,
        mut launch: Box<dyn Launch>,
    ) -> Result<Self, LaunchError> {
        launch.load(image)?;
        Ok(Self {
            plan,
            launch,
            environment: image.environment.clone(),
            hearing: LogShare::default(),
            phase: Phase::Waiting { in_turn: true },
            has_joined: false,
            killed: None,
            incarnation_joined: false,
            started: None,
            incarnation_before: 0,
            heart: None,
            held_since: None,
            has_turn_since: None,
            has_entered: false,
            restarts: 0,
            recent: VecDeque::new(),
            last_exit: None,
            next: None,
        })
    }

    pub(super) fn status(&self) -> control::Member {
        control::Member {
            number: self.plan.number.0,
            name: self.plan.name.clone(),
            kind: self.plan.kind.unwrap_or("service").into(),
            runs_here: self.plan.runs_here,
            program: self.plan.program.clone(),
            arguments: self.plan.arguments.clone(),
            pid: self.launch.process(),
            state: self.state(),
            restarts: self.restarts,
            last_exit: self.last_exit.as_ref().map(Exit::to_string),
        }
    }

    pub(super) fn state(&self) -> MemberState {
        match self.phase {
            Phase::Starting | Phase::Up { .. } if self.held_since.is_some() => MemberState::Held,
            Phase::Stopped => MemberState::Stopped,
            Phase::Waiting { .. } | Phase::Starting => MemberState::Starting,
            Phase::Up { stalled: true }
            | Phase::Ending {
                then: NextStep::Fail,
                ..
            } => MemberState::Stalled,
            Phase::Up { .. } | Phase::Ending { .. } => MemberState::Running,
            Phase::Pausing { .. } => MemberState::Restarting,
            Phase::Failed => MemberState::Failed,
        }
    }

    pub(super) fn launch(&self) -> &dyn Launch {
        &*self.launch
    }

    /// Whether there is a program that has not ended.
    pub(super) fn is_alive(&self) -> bool {
        matches!(
            self.phase,
            Phase::Starting | Phase::Up { .. } | Phase::Ending { .. }
        )
    }

    /// Returns the descriptor of the program's output, if it is to be read now.
    pub(super) fn has_output(&self, now: Instant) -> Option<BorrowedFd<'_>> {
        self.launch
            .has_output()
            .filter(|_| self.hearing.is_open(now))
    }

    /// Returns true if the program has failed: it does not run, was not stopped, and has not ended
    /// well. The program of a processor that has just been restarted after several failures counts
    /// as failed, too.
    pub(super) fn has_failed(&self) -> bool {
        match self.phase {
            Phase::Stopped => false,
            Phase::Failed | Phase::Waiting { .. } | Phase::Starting | Phase::Pausing { .. } => true,
            Phase::Ending { then, .. } => then == NextStep::Fail,
            Phase::Up { .. } if self.held_since.is_some() => self.launch.process().is_some(),
            Phase::Up { .. } => {
                let lived = self.started.map(|started| started.elapsed());
                let is_fresh = lived.is_some_and(|lived| lived < SHORT);
                is_fresh && self.recent.len() > 1 && !self.plan.is_service()
            }
        }
    }

    /// Returns true if the members after this one may be started.
    pub(super) fn lets_pass(&self) -> bool {
        self.has_joined
            || self.has_entered
            || self.held_since.is_some()
            || matches!(self.phase, Phase::Stopped | Phase::Failed)
    }

    fn tell(&self, journal: &mut Journal, text: impl Into<String>) {
        journal.tell(&self.plan.name, text, Some(self.state()));
    }

    /// When it must be looked at, if nothing happens before.
    pub(super) fn due(&self, now: Instant) -> Option<Instant> {
        self.phase_due(now)
            .into_iter()
            .chain(self.hearing.due(now))
            .min()
    }

    fn phase_due(&self, now: Instant) -> Option<Instant> {
        match self.phase {
            Phase::Stopped | Phase::Failed | Phase::Waiting { .. } => None,
            Phase::Starting | Phase::Up { .. } => Some(now + LOOK),
            Phase::Ending { since, forced, .. } => {
                Some(if forced { now + LOOK } else { since + END })
            }
            Phase::Pausing { until } if self.launch.is_ready() => Some(until),
            Phase::Pausing { until } => Some(until.max(now + LOOK)),
        }
    }

    /// Looks how the program is; true if something happened that may concern the others.
    pub(super) fn look(&mut self, mailbox: &SupervisorMailbox<'_>, journal: &mut Journal) -> bool {
        let now = Instant::now();
        if let Some(count) = self.hearing.turn(now) {
            let text = format!(
                "{count} lines were left out: it wrote more than {LINES} lines in a second"
            );
            self.tell(journal, text);
        }
        if self.hearing.is_open(now) {
            self.relay(now, journal);
        }
        let before = self.phase;
        if self.is_alive()
            && let RunState::Ended(exit) = self.launch.state()
        {
            self.relay(now, journal);
            self.ended(&exit, journal);
            self.last_exit = Some(exit);
            if self.plan.is_service() {
                mailbox.await_service(self.plan.number);
            } else {
                let comes = matches!(self.phase, Phase::Pausing { .. } | Phase::Waiting { .. });
                mailbox.bury(self.plan.number, comes);
            }
        }
        if let Phase::Ending { since, .. } = &mut self.phase
            && !mailbox.counts(self.plan.number)
        {
            *since = now;
        }
        self.look_for_debugger(now, journal);
        match self.phase {
            Phase::Starting => self.look_for_join(mailbox, now, journal),
            Phase::Up { stalled } => self.feel(stalled, mailbox, now, journal),
            Phase::Ending {
                since,
                forced: false,
                ..
            } if now >= since + END => self.force(journal),
            Phase::Pausing { until } if now >= until && self.launch.is_ready() => {
                self.start(mailbox, journal);
            }
            Phase::Stopped | Phase::Failed => {
                mailbox.dismiss(self.plan.number, self.plan.is_service());
            }
            _ => {}
        }
        self.phase != before
    }

    /// Tells what the program wrote for its supervisor.
    fn relay(&mut self, now: Instant, journal: &mut Journal) {
        let (name, hearing) = (&self.plan.name, &mut self.hearing);
        let has_more = self.launch.output(&mut |line| {
            if hearing.takes_line(now) {
                journal.tell(name, line, None);
            }
        });
        if has_more {
            self.hearing.rest(now);
        }
    }

    /// Starts its program.
    pub(super) fn start(&mut self, mailbox: &SupervisorMailbox<'_>, journal: &mut Journal) {
        if let Some(mut image) = self.next.take() {
            if let Err(error) = self.launch.load(&image) {
                self.phase = Phase::Failed;
                return self.tell(journal, format!("cannot be loaded: {error}"));
            }
            if image.environment.hold_at_start {
                // Once: the start after this one is an ordinary one.
                image.environment.hold_at_start = false;
                self.next = Some(image);
            }
        }
        self.incarnation_before = mailbox.incarnation(self.plan.number);
        self.started = Some(Instant::now());
        self.incarnation_joined = false;
        self.heart = None;
        self.has_turn_since = None;
        self.has_entered = false;
        self.phase = Phase::Starting;
        if !self.plan.is_service() {
            mailbox.hold(self.plan.number);
        }
        match self.launch.start() {
            Ok(()) => {
                let process = self.launch.process();
                let process = process.map(|process| format!(" as process {process}"));
                let process = process.unwrap_or_default();
                self.tell(journal, format!("started{process}"));
            }
            Err(error) => self.failed(&error.to_string(), journal),
        }
    }

    fn look_for_join(
        &mut self,
        mailbox: &SupervisorMailbox<'_>,
        now: Instant,
        journal: &mut Journal,
    ) {
        if self.is_held() {
            // The time in which it must join begins when it goes on.
            (self.started, self.has_turn_since) = (Some(now), None);
        }
        let started = self.started.unwrap_or(now);
        self.has_entered |= mailbox.has_entered(self.plan.number);
        let since = if !mailbox.counts(self.plan.number) {
            self.has_turn_since = None;
            now
        } else if self.has_entered {
            *self.has_turn_since.get_or_insert(now)
        } else {
            started
        };
        if mailbox.is_up_after(self.plan.number, self.incarnation_before) {
            self.phase = Phase::Up { stalled: false };
            (self.has_joined, self.incarnation_joined) = (true, true);
            let took = now.duration_since(started).as_secs_f64();
            self.tell(journal, format!("joined after {took:.3} s"));
        } else if now >= since + JOIN && self.plan.stall.is_some() {
            let text = format!("has not joined within {} s", JOIN.as_secs());
            self.give_up(&text, journal);
        }
    }

    /// Feels the pulse.
    fn feel(
        &mut self,
        was_stalled: bool,
        mailbox: &SupervisorMailbox<'_>,
        now: Instant,
        journal: &mut Journal,
    ) {
        let beat = mailbox.heartbeat(self.plan.number);
        if !mailbox.counts(self.plan.number) || self.held_since.is_some() {
            self.heart = None;
        }
        let since = match self.heart {
            Some((before, since)) if beat == before => since,
            _ => {
                self.heart = Some((beat, now));
                now
            }
        };
        let still = now.duration_since(since);
        let stalled = still >= STALL;
        if stalled != was_stalled {
            self.phase = Phase::Up { stalled };
            let text = if stalled {
                format!("stalled: no heartbeat for {:.1} s", still.as_secs_f64())
            } else {
                "its heartbeat is back".into()
            };
            self.tell(journal, text);
        }
        if let Some(limit) = self.plan.stall
            && still >= limit.max(STALL)
            && !self.is_traced()
        {
            let text = format!("had no heartbeat for {:.1} s", still.as_secs_f64());
            self.give_up(&text, journal);
        }
    }

    /// A debugger may hold a program as long as it likes.
    fn is_held(&self) -> bool {
        self.launch.is_held() || self.is_traced()
    }

    /// Looks whether a debugger holds the program, and tells if that has changed.
    fn look_for_debugger(&mut self, now: Instant, journal: &mut Journal) {
        let is_held = self.is_alive() && self.launch.is_held();
        match self.held_since {
            None if is_held => {
                self.held_since = Some(now);
                let (me, name) = (me(), &self.plan.name);
                let text = format!(
                    "is held for a debugger: `{me} gdb {name}` attaches one, `{me} restart {name}` starts the program anew"
                );
                self.tell(journal, text);
            }
            Some(since) if !is_held => {
                self.held_since = None;
                let held = now.duration_since(since).as_secs_f64();
                self.tell(journal, format!("is not held any more, after {held:.3} s"));
            }
            _ => {}
        }
    }

    fn is_traced(&self) -> bool {
        let Some(process) = self.launch.process() else {
            return false;
        };
        let status = std::fs::read_to_string(format!("/proc/{process}/status"));
        let status = status.unwrap_or_default();
        let tracer = status
            .lines()
            .find_map(|line| line.strip_prefix("TracerPid:"));
        tracer.is_some_and(|tracer| tracer.trim() != "0")
    }

    fn give_up(&mut self, text: &str, journal: &mut Journal) {
        self.phase = Phase::Ending {
            since: Instant::now(),
            forced: true,
            then: NextStep::Fail,
        };
        self.tell(journal, format!("{text}, and is killed"));
        self.order(StopMethod::Force, journal);
    }

    fn order(&mut self, how: StopMethod, journal: &mut Journal) {
        if let Err(error) = self.launch.stop(how) {
            self.tell(journal, error.to_string());
        }
    }

    pub(super) fn force(&mut self, journal: &mut Journal) {
        if let Phase::Ending { forced, .. } = &mut self.phase
            && !*forced
        {
            *forced = true;
            self.killed = Some(Instant::now());
            self.tell(journal, "does not end when asked, and is killed");
            self.order(StopMethod::Force, journal);
        }
    }

    /// Makes it end, and then do something else.
    pub(super) fn end(
        &mut self,
        then: NextStep,
        mailbox: &SupervisorMailbox<'_>,
        journal: &mut Journal,
    ) {
        match &mut self.phase {
            Phase::Starting | Phase::Up { .. } => {
                let since = Instant::now();
                self.phase = Phase::Ending {
                    since,
                    forced: false,
                    then,
                };
                self.order(StopMethod::Ask, journal);
                if !self.plan.is_service() {
                    mailbox.wake(self.plan.number);
                }
            }
            Phase::Ending { then: other, .. } => *other = then,
            _ => match then {
                NextStep::Start => self.phase = Phase::Waiting { in_turn: false },
                NextStep::Stop | NextStep::Fail => {
                    let news = self.phase != Phase::Stopped;
                    self.phase = Phase::Stopped;
                    if news {
                        self.tell(journal, "stopped");
                    }
                }
            },
        }
    }

    /// Loads another program at the next start.
    pub(super) fn replace(&mut self, image: ProgramImage, program: String, arguments: Vec<String>) {
        self.next = Some(image);
        self.plan.program = program;
        self.plan.arguments = arguments;
    }

    /// Wishes that it runs: what was before is forgotten.
    pub(super) fn wish(&mut self) {
        self.phase = Phase::Waiting { in_turn: false };
        self.recent.clear();
        self.has_joined = false;
    }

    fn ended(&mut self, exit: &Exit, journal: &mut Journal) {
        match self.phase {
            Phase::Ending {
                then: NextStep::Stop,
                ..
            } => {
                self.phase = Phase::Stopped;
                self.tell(journal, format!("stopped: {exit}"));
            }
            Phase::Ending {
                then: NextStep::Start,
                ..
            } => {
                self.wish();
                self.tell(journal, format!("ended, and is started again: {exit}"));
            }
            Phase::Up { .. } if *exit == Exit::Status(0) && !self.plan.is_service() => {
                self.phase = Phase::Stopped;
                self.tell(journal, "ended by itself, without failing");
            }
            // No fault of its own: it is started again with its machine, whatever the description says.
            Phase::Starting | Phase::Up { .. } if *exit == Exit::Lost => {
                self.restarts += 1;
                let until = Instant::now();
                self.phase = Phase::Pausing { until };
                self.tell(
                    journal,
                    format!("failed: {exit}; restart {}", self.restarts),
                );
            }
            Phase::Starting | Phase::Up { .. } if *exit == Exit::Status(MISTAKE.into()) => {
                self.phase = Phase::Failed;
                self.tell(
                    journal,
                    format!("failed: {exit}; a restart would not help, so there is none"),
                );
            }
            Phase::Starting => self.failed(&format!("ended before it joined: {exit}"), journal),
            _ => self.failed(&format!("failed: {exit}"), journal),
        }
    }

    fn failed(&mut self, text: &str, journal: &mut Journal) {
        let now = Instant::now();
        // Those in a row that never join count however long they take.
        while self.incarnation_joined
            && self
                .recent
                .front()
                .is_some_and(|then| now.duration_since(*then) > MINUTE)
        {
            self.recent.pop_front();
        }
        let count = self.recent.len();
        if self.plan.on_failure != OnFailure::Restart {
            self.phase = Phase::Failed;
            return self.tell(journal, text);
        }
        if count >= self.plan.restarts as usize {
            self.phase = Phase::Failed;
            let when = if self.incarnation_joined {
                "in a minute"
            } else {
                "without joining"
            };
            let text = format!("{text}; not started again after {count} restarts {when}");
            return self.tell(journal, text);
        }
        self.recent.push_back(now);
        self.restarts += 1;
        let lived = self.started.map(|started| now.duration_since(started));
        let pause = match lived {
            Some(lived) if lived >= SHORT => Duration::ZERO,
            // A program that fails at once waits longer and longer, up to a second and a half.
            _ => Duration::from_millis(100) * u32::try_from(count.min(15)).unwrap_or(15),
        };
        self.phase = Phase::Pausing { until: now + pause };
        self.tell(journal, format!("{text}; restart {}", self.restarts));
    }

    /// Returns the result of a request to start the program so that it waits for a debugger; `None` as long as it is not
    /// known.
    pub(super) fn is_held_at_start(&self) -> Option<Result<(), String>> {
        match self.phase {
            Phase::Starting if self.held_since.is_some() => Some(Ok(())),
            Phase::Up { .. } => Some(Err(format!(
                "`{}` runs, and has not waited for a debugger: its program must be started directly, not by another one",
                self.plan.name
            ))),
            _ => self.outcome(false),
        }
    }

    /// Returns the result of a request to run the program; `None` as long as it is not known. While time
    /// `is_paused`, a program that has entered joins only after the person who asks lets time go on.
    pub(super) fn outcome(&self, is_paused: bool) -> Option<Result<(), String>> {
        let exit = || match &self.last_exit {
            Some(exit) => format!("`{}` is not running; its last end: {exit}", self.plan.name),
            None => format!("`{}` is not running", self.plan.name),
        };
        match self.phase {
            Phase::Up { .. } => Some(Ok(())),
            Phase::Starting if self.held_since.is_some() => {
                let name = &self.plan.name;
                Some(Err(format!(
                    "`{name}` is held for a debugger before it has joined"
                )))
            }
            Phase::Starting if is_paused && self.has_entered => Some(Ok(())),
            Phase::Failed | Phase::Stopped => Some(Err(exit())),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests;
