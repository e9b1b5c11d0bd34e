//! Brings a system up, watches it, and takes it down.
//!
//! [`run`] does all that in the thread that calls it. The thread waits for events only: the end of
//! a process, a ring of the mailbox, a request, or a signal. Only heartbeats are polled.
//!
//! Programs are started through [`Launch`]: as [`ChildProcess`]es of this machine, or in the way of an
//! [extension](crate::extension).

mod files;
mod journal;
mod log_share;
mod mailbox;
mod member;
mod orders;
mod plan;
pub mod reaper;
mod requests;
pub mod stat;
mod time;

pub use crate::launch::{
    ChildProcess, Exit, Launch, LaunchError, ProgramImage, RunState, StopMethod,
};
pub use crate::signals::EndSignals;

use std::time::{Duration, Instant};

use condor_mbox::Call;
use condor_mbox::linux::SystemError;
use condor_rt::linux::FileRange;
use condor_rt::numbers::SUPERVISOR;
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::io::Errno;

use crate::control::server::Server;
use crate::control::{ClockStatus, DOWN, MemberState, SystemStatus};
use crate::description::{ClockKind, OnFailure, SystemDescription};
use crate::error::{AnyError, NamedFileError, me};
use crate::services::terminals::{self, Script};
use crate::system::SystemDirectory;
use files::RunDirectory;
pub use files::supervisor as process_of;
pub use journal::last as last_lines;
use journal::{CONDOR, Journal};
use mailbox::SupervisorMailbox;
use member::{Member, NextStep, Phase};
use orders::Orders;
use requests::{Asker, Promise};
use time::Pace;

/// The longest wait of the end for the turn of a simulated time, and the time between two requests for it.
const PATIENCE: Duration = Duration::from_secs(2);
const ASK: Duration = Duration::from_millis(10);

/// The age of the end at which processors that still run are killed. In simulated time one that hangs
/// keeps the others from ending, so that they cannot each be given a time of their own.
const KILL_PROCESSORS: Duration = Duration::from_secs(6);
/// The age of the end at which services are killed, too: they had the rest since the last processor ended.
const KILL_SERVICES: Duration = Duration::from_secs(8);
/// The age of the end at which nobody is waited for any more: not even a kill has ended them.
const LEAVE: Duration = Duration::from_secs(9);
const _: () = assert!(LEAVE.as_secs() < DOWN.as_secs(), "that is promised");
/// Requests that are carried out in a turn; others come in the next one.
const REQUESTS: usize = 16;

/// The options of [`run`] that do not come from the description of the system.
#[derive(Clone, Debug, Default)]
pub struct SupervisorOptions {
    /// The names of the binary's own programs, which a later `load` may name after `"self"`.
    pub own: Vec<&'static str>,
    /// Whether events are written to standard error, too.
    pub echo: bool,
    /// Whether the system is brought up in the user interface: then a fatal error holds a program that would be restarted
    /// for a debugger, unless the description says otherwise.
    pub attended: bool,
    /// The time after which the system is taken down, by the real or the simulated clock; `None`
    /// means never.
    pub duration: Option<Duration>,
    /// The record of typing that is replayed in simulated time; `None` means that people type.
    pub typing: Option<Script>,
    /// Whether descendants of programs that lose their parents become children of this process. At
    /// the end all its children are killed, so set this only in a process that has no other
    /// children, and call [`run`] in its first thread.
    pub adopts: bool,
}

/// The reason why a system does not come up, or does not stay up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UpError {
    /// A system of this name is running already.
    #[error(
        "the system `{name}` is running already{}; `{me} ui --system {name}` shows it, `{me} down --system {name}` ends it",
        process.map(|process| format!(", as process {process}")).unwrap_or_default(),
        me = me()
    )]
    RunsAlready {
        /// The name of the system.
        name: String,
        /// The process id of its supervisor, if it is known.
        process: Option<u32>,
    },
    /// A process of the previous run cannot be killed.
    #[error("process {process} of the previous run cannot be killed")]
    Leftover {
        /// The process id of that process.
        process: u32,
    },
    /// An operation on a file of the system failed.
    #[error(transparent)]
    File(#[from] NamedFileError),
    /// The processors' shared memory (the windows) cannot be made.
    #[error(transparent)]
    Windows(#[from] SystemError),
    /// The supervisor's mailbox returned this error.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::MailboxError),
    /// The application or an extension failed to make what the system needs.
    #[error("{0}")]
    Prepare(AnyError),
    /// The page of the simulated clock cannot be made.
    #[error(transparent)]
    Clock(#[from] condor_rt::linux::ProcessError),
    /// A processor cannot be prepared to run programs.
    #[error(transparent)]
    Launch(#[from] LaunchError),
    /// Signals could not be handled, or the wait for events failed.
    #[error("cannot wait for events: {0}")]
    Events(std::io::Error),
}

/// The state of a system just before it was taken down, and how its end went. [`run`] returns it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Summary {
    /// The state of all processors and services just before.
    pub status: SystemStatus,
    /// Whether something was wrong: the system had not come up, a program had failed for good, or a
    /// program did not run although it had not been stopped.
    pub failed: bool,
    /// The names of the processors and services that did not end when they were asked to, and were
    /// killed.
    pub killed: Vec<String>,
}

/// Brings the system up, and keeps it up until it is told to end: by a request, by SIGINT, SIGTERM or SIGHUP, because
/// the description says so, or because a service fails for good before the system is up.
///
/// It calls `prepare` before it starts a program, when no other run of the system is alive. It calls `started` with the
/// directory of the running system when all programs have had the chance to join. It calls `ending` with the state of
/// the system before it stops the programs. None of the three may send requests to the supervisor, which waits for
/// their return.
///
/// The end takes at most [`DOWN`] after the system is told to end, whatever the programs do: programs that do not end
/// when they are asked are killed.
///
/// The programs are killed when the thread that calls this function ends. If the function returns, other processes in
/// their process groups are killed, too. Descendants that have left these groups are killed at the end if
/// [`SupervisorOptions::adopts`] is set, and by a [`reaper`].
///
/// # Errors
/// [`UpError`] if the system cannot come up or stay up, for the reason in the variant. No program
/// runs any more then.
pub fn run(
    description: &SystemDescription,
    options: SupervisorOptions,
    prepare: impl FnOnce() -> Result<(), AnyError>,
    started: impl FnOnce(&SystemDirectory),
    ending: impl FnOnce(&SystemDirectory, &SystemStatus),
) -> Result<Summary, UpError> {
    if options.adopts {
        reaper::adopt().map_err(UpError::Events)?;
    }
    let place = RunDirectory::take(&description.name)?;
    let log = place.directory.log();
    let journal = Journal::new(&log, options.echo).map_err(NamedFileError::at("write", &log))?;
    let furniture = place.furnish(description)?;
    if furniture.clock.is_some() {
        terminals::begin(&place.directory, options.typing.as_ref())?;
    }
    prepare().map_err(UpError::Prepare)?;
    let page = time::furnish(description, &place.directory, furniture.clock.as_ref())?;
    let windows = place.directory.system(description.window_bytes)?;
    let claim = windows.claim(SUPERVISOR)?;
    let orders = Orders::new(description, claim.windows());
    let receive = |call: &Call<'_>| orders.receive(call);
    let mailbox = SupervisorMailbox::open(claim, page, &receive)?;
    let members = plan::members(
        description,
        options.attended,
        &place.directory,
        &furniture,
        &mailbox,
    )?;
    let mut supervisor = Supervisor {
        description,
        options,
        signals: EndSignals::new().map_err(UpError::Events)?,
        server: Server::new(furniture.listener).map_err(UpError::Events)?,
        mailbox,
        orders: &orders,
        shared: furniture.shared,
        members,
        journal,
        promises: Vec::new(),
        pace: Pace::default(),
        since: Instant::now(),
        is_up: false,
        is_noted: true,
        down: None,
        down_since: None,
        down_asked_by: Vec::new(),
        place,
    };
    let outcome = supervisor.keep(started, ending);
    // Programs that still run are killed as they are dropped.
    supervisor.members.clear();
    if supervisor.options.adopts {
        reaper::end_children().map_err(UpError::Events)?;
    }
    let cleared = supervisor.place.clear_but_logs();
    let summary = outcome?;
    cleared?;
    Ok(summary)
}

struct Supervisor<'d> {
    description: &'d SystemDescription,
    options: SupervisorOptions,
    signals: EndSignals,
    server: Server,
    mailbox: SupervisorMailbox<'d>,
    orders: &'d Orders<'d>,
    /// The memory that belongs to no processor.
    shared: Option<FileRange>,
    /// Services first, then processors, in the order in which they are started.
    members: Vec<Member>,
    journal: Journal,
    /// Requests that are answered when they have been carried out.
    promises: Vec<Promise>,
    /// The speed of the simulated time.
    pace: Pace,
    since: Instant,
    /// All programs have been given the chance to join.
    is_up: bool,
    /// The file of processes lists all processes that there are.
    is_noted: bool,
    down: Option<Down>,
    /// When it began to go down.
    down_since: Option<Instant>,
    /// The clients that asked for the end, and are answered when it has come.
    down_asked_by: Vec<Asker>,
    place: RunDirectory,
}

/// The stage of the end of the system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Down {
    /// The processors are ending; services are there for them.
    Processors,
    Services,
}

impl Supervisor<'_> {
    fn keep(
        &mut self,
        started: impl FnOnce(&SystemDirectory),
        ending: impl FnOnce(&SystemDirectory, &SystemStatus),
    ) -> Result<Summary, UpError> {
        let (mut started, mut ending) = (Some(started), Some(ending));
        let mut summary = None;
        let directory = self.place.directory.path().display().to_string();
        let text = format!("`{}` comes up in {directory}", self.description.name);
        self.journal.tell(CONDOR, text, None);
        loop {
            self.turn()?;
            if self.down.is_none()
                && self.members.iter().all(Member::lets_pass)
                && let Some(started) = started.take()
            {
                self.is_up = true;
                self.tell_started();
                started(&self.place.directory);
                self.begin_time();
            }
            if ending.is_some()
                && self.may_end()
                && let Some(ending) = ending.take()
            {
                let seen = self.summary();
                ending(&self.place.directory, &seen.status);
                summary = Some(seen);
                for member in self
                    .members
                    .iter_mut()
                    .filter(|member| !member.plan.is_service())
                {
                    member.end(NextStep::Stop, &self.mailbox, &mut self.journal);
                }
            }
            if ending.is_none() {
                // Perhaps it gets the turn only now that a program that hung with it is dead.
                self.mailbox.stop_all();
            }
            let is_over = self.is_over();
            self.publish();
            if is_over {
                let mut summary = summary.unwrap_or_else(|| self.summary());
                summary.killed = self.killed();
                summary.failed |= self.members.iter().any(Member::is_alive);
                self.answer_down(&summary.killed);
                return Ok(summary);
            }
            self.wait()?;
        }
    }

    /// All programs run: the simulated time begins, if the system has one.
    fn begin_time(&mut self) {
        let ClockKind::Simulated(speed) = self.description.clock else {
            return;
        };
        self.pace.begin();
        if let Err(error) = self.mailbox.begin(speed, self.options.duration) {
            let text = format!("the simulated time cannot begin: {error}");
            self.journal.tell(CONDOR, text, None);
            self.go_down("its time does not begin");
        }
    }

    /// Whether the programs may be stopped: in simulated time, at an instant at which the supervisor
    /// has the turn, unless it does not get it.
    fn may_end(&self) -> bool {
        let waited = self.down_for().is_some_and(|age| age >= PATIENCE);
        self.down.is_some() && (waited || self.mailbox.ask_for_turn())
    }

    /// Looks at everything once.
    fn turn(&mut self) -> Result<(), UpError> {
        let seen = self.mailbox.serve()?;
        for _ in 0..self.signals.taken() {
            match self.down {
                None => self.go_down("a signal"),
                Some(_) => self.force(),
            }
        }
        let is_over = match (self.options.duration, self.mailbox.clock()) {
            (Some(most), None) => self.since.elapsed() >= most,
            (end, Some(_)) => self.is_up && self.down.is_none() && self.mailbox.is_at_end(end),
            (None, _) => false,
        };
        if is_over {
            self.go_down("the time is over");
        }
        self.mailbox.free_visitor();
        self.pace.sample(&self.mailbox);
        self.server.serve();
        for _ in 0..REQUESTS {
            let Some((from, request)) = self.server.next() else {
                break;
            };
            self.request(Asker::Client(from), request);
        }
        self.carry_out_orders();
        self.mailbox.done(seen);
        if self.options.adopts {
            let members = self.members.iter();
            let own: Vec<_> = members.filter_map(|it| it.launch().process()).collect();
            reaper::reap_adopted(|process| own.contains(&process));
        }
        let mut changed = false;
        for member in &mut self.members {
            changed |= member.look(&self.mailbox, &mut self.journal);
        }
        changed |= self.start_next();
        if changed || !self.is_noted {
            self.note_processes();
        }
        // Without its services a system does not come up; one that is up goes on without them.
        let stops = |member: &Member| {
            let matters = if member.plan.is_service() {
                !self.is_up
            } else {
                member.plan.on_failure == OnFailure::Stop
            };
            matters && member.phase == Phase::Failed
        };
        if let Some(name) = self
            .members
            .iter()
            .find(|member| stops(member))
            .map(|member| member.plan.name.clone())
        {
            self.go_down(&format!("`{name}` failed"));
        }
        self.keep_promises();
        Ok(())
    }

    fn tell_started(&mut self) {
        let members = self.members.iter();
        let failed = members.filter(|member| member.phase == Phase::Failed);
        let failed: Vec<_> = failed
            .map(|member| format!("`{}`", member.plan.name))
            .collect();
        let text = if failed.is_empty() {
            "all programs have been started".into()
        } else {
            format!("all programs but {} have been started", failed.join(", "))
        };
        self.journal.tell(CONDOR, text, None);
    }

    /// Notes which processes there are. Where that fails the robot goes on: the note is for the next
    /// supervisor, should this one be killed.
    fn note_processes(&mut self) {
        let members = self.members.iter();
        let processes = members.filter_map(|member| member.launch().process());
        let outcome = self.place.note_processes(processes);
        if let Err(error) = &outcome
            && self.is_noted
        {
            self.journal.tell(CONDOR, error.to_string(), None);
        }
        self.is_noted = outcome.is_ok();
    }

    /// Starts the members that may be started now.
    fn start_next(&mut self) -> bool {
        if self.down.is_some() {
            return false;
        }
        let (mut changed, mut may_pass) = (false, true);
        for member in &mut self.members {
            if let Phase::Waiting { in_turn } = member.phase
                && (may_pass || !in_turn)
                && member.launch().is_ready()
            {
                member.start(&self.mailbox, &mut self.journal);
                changed = true;
            }
            may_pass &= member.lets_pass();
        }
        changed
    }

    fn go_down(&mut self, why: &str) {
        if self.down.is_none() {
            self.down = Some(Down::Processors);
            self.down_since = Some(Instant::now());
            self.journal.tell(CONDOR, format!("goes down: {why}"), None);
        }
    }

    /// Kills everybody: whoever asks twice does not want to wait.
    fn force(&mut self) {
        for member in &mut self.members {
            member.end(NextStep::Stop, &self.mailbox, &mut self.journal);
            member.force(&mut self.journal);
        }
    }

    /// Returns how long ago the system was told to go down; `None` if it was not.
    fn down_for(&self) -> Option<Duration> {
        self.down_since.map(|since| since.elapsed())
    }

    /// Kills the processors or services that are still there when their time is over.
    fn force_late(&mut self) {
        let Some(age) = self.down_for() else {
            return;
        };
        for member in &mut self.members {
            let limit = if member.plan.is_service() {
                KILL_SERVICES
            } else {
                KILL_PROCESSORS
            };
            if age >= limit {
                member.end(NextStep::Stop, &self.mailbox, &mut self.journal);
                member.force(&mut self.journal);
            }
        }
    }

    /// Returns the names of those who were killed since the system was told to go down.
    fn killed(&self) -> Vec<String> {
        // `None` is before every instant.
        let killed = self.members.iter();
        let killed = killed.filter(|it| self.down_since.is_some() && it.killed >= self.down_since);
        killed.map(|member| member.plan.name.clone()).collect()
    }

    fn is_over(&mut self) -> bool {
        self.force_late();
        let left = self.members.iter().filter(|member| member.is_alive());
        let left: Vec<_> = left.map(|member| member.plan.name.as_str()).collect();
        if !left.is_empty() && self.down_for().is_some_and(|age| age >= LEAVE) {
            let text = format!("does not wait any longer for {}", left.join(", "));
            self.journal.tell(CONDOR, text, None);
            return true;
        }
        let any_alive = |members: &[Member], services: bool| {
            members
                .iter()
                .any(|member| member.plan.is_service() == services && member.is_alive())
        };
        match self.down {
            None => false,
            Some(_) if any_alive(&self.members, false) => false,
            Some(Down::Processors) => {
                self.down = Some(Down::Services);
                for member in &mut self.members {
                    member.end(NextStep::Stop, &self.mailbox, &mut self.journal);
                }
                !any_alive(&self.members, true)
            }
            Some(Down::Services) => !any_alive(&self.members, true),
        }
    }

    fn publish(&mut self) {
        for event in self.journal.news() {
            self.server.tell(&event);
        }
    }

    /// Waits until an event happens, or until a member must be looked at.
    fn wait(&self) -> Result<(), UpError> {
        let now = Instant::now();
        let end = self.options.duration.map(|most| self.since + most);
        let end = end.filter(|_| self.down.is_none() && self.mailbox.clock().is_none());
        // Until it has the turn.
        let asks = self.down == Some(Down::Processors) && self.mailbox.clock().is_some();
        let end = end.or(asks.then(|| now + ASK));
        let dues = self.members.iter().filter_map(|member| member.due(now));
        // Even without anybody to look at, the supervisor's own heartbeat goes on.
        let most = if self.server.has_more() {
            now
        } else {
            now + member::LOOK
        };
        let due = dues.chain(end).chain([most]).min();
        let span = due.map(|due| due.saturating_duration_since(now));
        let span = span.and_then(|span| Timespec::try_from(span).ok());
        let mut polled = vec![
            PollFd::from_borrowed_fd(self.mailbox.bell(), PollFlags::IN),
            PollFd::from_borrowed_fd(self.signals.descriptor(), PollFlags::IN),
        ];
        for (descriptor, flags) in self.server.descriptors() {
            polled.push(PollFd::from_borrowed_fd(descriptor, flags));
        }
        for member in &self.members {
            let ended = member.launch().ended();
            for descriptor in ended.into_iter().chain(member.has_output(now)) {
                polled.push(PollFd::from_borrowed_fd(descriptor, PollFlags::IN));
            }
        }
        match rustix::event::poll(&mut polled, span.as_ref()) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(UpError::Events(error.into())),
        }
    }

    fn summary(&self) -> Summary {
        Summary {
            status: self.status(),
            failed: !self.is_up || self.members.iter().any(Member::has_failed),
            killed: Vec::new(),
        }
    }

    /// The state of the clock; it waits for a program that is held as long as that has the turn.
    fn clock_status(&self) -> Option<ClockStatus> {
        let mut status = self.pace.status(&self.mailbox)?;
        let is_held =
            |it: &&Member| it.state() == MemberState::Held && self.mailbox.counts(it.plan.number);
        if let Some(held) = self.members.iter().find(is_held) {
            status.waits_for = format!("`{}`, which is held for a debugger", held.plan.name);
        }
        Some(status)
    }

    fn status(&self) -> SystemStatus {
        let of = |services: bool| {
            let members = self.members.iter();
            let members = members.filter(move |member| member.plan.is_service() == services);
            members.map(Member::status).collect()
        };
        SystemStatus {
            system: self.description.name.clone(),
            file: self.description.file.display().to_string(),
            window_bytes: self.description.window_bytes,
            shared_memory: self.shared.clone(),
            clock: self.clock_status(),
            files_root: self
                .description
                .files
                .as_ref()
                .map(|files| files.root.display().to_string()),
            pid: std::process::id(),
            uptime: self.since.elapsed().as_secs_f64(),
            services: of(true),
            processors: of(false),
        }
    }
}
