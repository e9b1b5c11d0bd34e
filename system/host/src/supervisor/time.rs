//! The supervisor's part in the simulated time of its system.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use condor_clock::{NEVER, Obstacle};
use condor_mbox::{Doorbell as _, Evidence, Processor};
use condor_platform::linux::WholeFile;
use condor_rt::linux::{FileRange, HostClock, MappedPage};
use condor_rt::numbers::{SUPERVISOR, TERMINALS, VISITORS};

use super::UpError;
use super::mailbox::SupervisorMailbox;
use crate::control::ClockStatus;
use crate::description::{ClockSpeed, SystemDescription};
use crate::error::NamedFileError;
use crate::system::SystemDirectory;

/// The longest wait for the turn, in looks of 10 ms.
const LOOKS: u32 = 100;
const LOOK_NS: u64 = 10_000_000;
/// The simulated time from the end of a program to the start of the next program of its processor. A restart
/// that took no time would hide the end from every watchdog.
const RESTART_NS: u64 = 100_000_000;
/// The time over which the present speed is measured, and the time between two samples.
const SPAN: Duration = Duration::from_secs(3);
const SAMPLE: Duration = Duration::from_millis(200);

/// Begins the simulated time of a system in the page in `range`, which stands until all programs of
/// the description have entered and [`begin`] is called; `None` if there is no range.
pub(super) fn furnish(
    description: &SystemDescription,
    directory: &SystemDirectory,
    range: Option<&FileRange>,
) -> Result<Option<MappedPage>, UpError> {
    let Some(range) = range else {
        return Ok(None);
    };
    let page = MappedPage::map(range)?;
    let numbers = description.processors.iter().map(|it| it.number);
    let numbers = numbers.chain([SUPERVISOR.0]);
    page.reset(numbers.fold(0, |bits, number| bits | 1_u32.wrapping_shl(number.into())));
    let path = directory.clock();
    let text = serde_json::to_string(range).map_err(std::io::Error::other);
    let written = text.and_then(|text| WholeFile::write(&path, text));
    written.map_err(NamedFileError::at("write", &path))?;
    Ok(Some(page))
}

impl SupervisorMailbox<'_> {
    /// All programs have entered, and what is typed at the beginning stands in its files: time goes
    /// on, until `end` if there is one.
    pub(super) fn begin(&self, speed: ClockSpeed, end: Option<Duration>) -> Result<(), String> {
        let Some(clock) = self.clock() else {
            return Ok(());
        };
        let (page, by) = (clock.page(), clock.handover());
        self.with_turn(clock, end, |page| page.set_speed(speed.0, by))?;
        // The terminal service takes the typed characters before any time passes.
        page.count_ring(TERMINALS.0);
        self.doorbell().ring(TERMINALS);
        page.release(SUPERVISOR.0);
        page.kick(SUPERVISOR.0, by);
        Ok(())
    }

    /// Returns true if the supervisor has the turn and the instant `end`, at which the system ends,
    /// has come. If the supervisor has the turn before that instant, it returns the turn.
    pub(super) fn is_at_end(&self, end: Option<Duration>) -> bool {
        self.clock().is_some_and(|clock| {
            let is_over = clock.page().now() >= instant(end);
            if clock.has_turn() && !is_over {
                clock.postpone(instant(end));
            }
            clock.has_turn() && is_over
        })
    }

    /// Keeps all participants from going on until the program of processor `number` has entered.
    pub(super) fn hold(&self, number: Processor) {
        if let Some(clock) = self.clock() {
            clock.page().hold(number.0);
        }
    }

    /// Ends the participation of processor `number`, whose program has ended. If the program
    /// `restarts`, time stands until the next one is there, which enters [`RESTART_NS`] later.
    pub(super) fn bury(&self, number: Processor, restarts: bool) {
        if let Some(clock) = self.clock() {
            let page = clock.page();
            if restarts {
                page.hold(number.0);
            }
            // Before the turn is free, and others go on.
            let ended_at = page.now();
            page.bury(number.0, SUPERVISOR.0, clock.handover());
            // Before time has begun, nobody has anything to see.
            if !page.is_held(SUPERVISOR.0) {
                page.defer(number.0, ended_at.saturating_add(RESTART_NS));
            }
        }
    }

    /// Makes time not wait for `number`, which has no program and gets none unless a user starts
    /// one. That holds for a service that will not come back, too.
    pub(super) fn dismiss(&self, number: Processor, is_service: bool) {
        let Some(clock) = self.clock() else {
            return;
        };
        let page = clock.page();
        if is_service && page.is_service(number.0) {
            page.give_up(number.0, clock.handover());
        }
        if page.is_held(number.0) {
            page.release(number.0);
            page.kick(SUPERVISOR.0, clock.handover());
        }
    }

    /// A service has died; time stands where its next incarnation is to go on.
    pub(super) fn await_service(&self, number: Processor) {
        if let Some(clock) = self.clock().filter(|it| it.page().is_service(number.0)) {
            clock.page().request(number.0, 0, clock.handover());
        }
    }

    /// A part of the host has died, and is not expected back.
    fn free(&self, number: Processor) {
        if let Some(clock) = self.clock() {
            clock.page().free(number.0, SUPERVISOR.0, clock.handover());
        }
    }

    /// A visitor that was killed while it passed the turn on has it no longer.
    pub(super) fn free_visitor(&self) {
        let holder = self.clock().and_then(|clock| clock.page().holder());
        if let Some(holder) = holder.filter(|holder| VISITORS.contains(holder))
            && self.doorbell().evidence(Processor(holder)) == Evidence::Dead
        {
            self.free(Processor(holder));
        }
    }

    /// Rings a processor, so that it looks whether it is to end.
    pub(super) fn wake(&self, number: Processor) {
        if let Some(clock) = self.clock() {
            let (page, by) = (clock.page(), clock.handover());
            page.ring(SUPERVISOR.0, number.0, by);
        }
    }

    /// Whether the program of a processor has entered the simulated time.
    pub(super) fn has_entered(&self, number: Processor) -> bool {
        self.clock()
            .is_some_and(|clock| clock.page().is_processor(number.0))
    }

    /// Whether somebody has paused the simulated time, and it stands for that.
    pub(super) fn is_paused(&self) -> bool {
        self.clock().is_some_and(|clock| {
            let page = clock.page();
            // At the limit itself, somebody may still have the turn.
            page.now() >= page.limit() || page.standing(clock.handover()) == Obstacle::Limit
        })
    }

    /// Whether the limits of a processor count: always by the real clock, and in simulated time only
    /// while it has the turn and asks no service.
    pub(super) fn counts(&self, number: Processor) -> bool {
        self.clock().is_none_or(|clock| {
            let page = clock.page();
            !page.is_processor(number.0) || page.is_busy(number.0)
        })
    }

    /// Asks for the turn, or takes it if it is free.
    pub(super) fn ask_for_turn(&self) -> bool {
        self.clock().is_none_or(|clock| {
            if !clock.has_turn() {
                clock.request(0);
            }
            let (page, by) = (clock.page(), clock.handover());
            page.await_request(SUPERVISOR.0, 0, by)
        })
    }

    /// Stops all programs at the present instant, at which the supervisor has the turn, and returns the turn.
    pub(super) fn stop_all(&self) {
        if let Some(clock) = self.clock().filter(|clock| clock.has_turn()) {
            let page = clock.page();
            page.set_stop_at(page.now());
            page.set_limit(NEVER);
            page.set_speed(0, clock.handover());
            clock.finish();
        }
    }

    /// Does with the clock what a request asks for; `end` is when the system ends.
    pub(super) fn change_clock(
        &self,
        change: &Change,
        end: Option<Duration>,
    ) -> Result<(), String> {
        let clock = self.clock();
        let clock = clock.ok_or(
            "the system runs by the real clock, which cannot be changed; `up --clock simulated` starts one whose clock can",
        )?;
        let by = clock.handover();
        self.with_turn(clock, end, |page| match *change {
            Change::Pause => page.set_limit(page.now()),
            Change::Step { ns } => {
                page.set_limit(page.now().saturating_add(ns));
                page.keep_pace_from(by);
            }
            Change::Resume => {
                page.set_limit(NEVER);
                page.keep_pace_from(by);
            }
            Change::Speed { thousandths } => page.set_speed(thousandths, by),
        })
    }

    /// Runs `body` with the turn; the next turn is at `end`, when the system ends.
    fn with_turn(
        &self,
        clock: &HostClock,
        end: Option<Duration>,
        body: impl FnOnce(&condor_clock::Page),
    ) -> Result<(), String> {
        let (page, by) = (clock.page(), clock.handover());
        clock.request(0);
        for _ in 0..LOOKS {
            if page.await_request(SUPERVISOR.0, LOOK_NS, by) {
                body(page);
                clock.postpone(instant(end));
                return Ok(());
            }
            // The program that has the turn may wait for the answer to a request.
            self.serve().map_err(|error| error.to_string())?;
        }
        let waits_for = page.standing(by);
        clock.request(instant(end));
        Err(format!("the clock waits for {waits_for}"))
    }
}

fn instant(end: Option<Duration>) -> u64 {
    let ns = end.and_then(|end| u64::try_from(end.as_nanos()).ok());
    ns.unwrap_or(NEVER)
}

/// A change of the simulated clock.
pub(super) enum Change {
    Pause,
    Step { ns: u64 },
    Resume,
    Speed { thousandths: u64 },
}

/// The speed of the simulated time.
#[derive(Debug, Default)]
pub(super) struct Pace {
    began: Option<(Instant, u64)>,
    samples: VecDeque<(Instant, u64)>,
}

impl Pace {
    /// Time begins.
    pub(super) fn begin(&mut self) {
        self.began = Some((Instant::now(), 0));
    }

    /// Looks at the clock.
    pub(super) fn sample(&mut self, mailbox: &SupervisorMailbox<'_>) {
        let Some(clock) = mailbox.clock() else {
            return;
        };
        let now = Instant::now();
        let last = self.samples.back();
        if last.is_some_and(|(then, _)| now.duration_since(*then) < SAMPLE) {
            return;
        }
        self.samples.push_back((now, clock.page().now()));
        while self.samples.len() > 2
            && let Some((then, _)) = self.samples.get(1)
            && now.duration_since(*then) >= SPAN
        {
            self.samples.pop_front();
        }
    }

    /// The state of the clock, for people.
    pub(super) fn status(&self, mailbox: &SupervisorMailbox<'_>) -> Option<ClockStatus> {
        let clock = mailbox.clock()?;
        let page = clock.page();
        let now = page.now();
        let factor = |from: Option<&(Instant, u64)>| {
            from.map_or(0.0, |(then, at)| {
                let wall = then.elapsed().as_secs_f64().max(1e-9);
                Duration::from_nanos(now.saturating_sub(*at)).as_secs_f64() / wall
            })
        };
        let waits_for = page.standing(clock.handover());
        #[allow(
            clippy::cast_precision_loss,
            reason = "a speed that a person has typed"
        )]
        let speed = (page.speed() > 0).then(|| page.speed() as f64 / 1000.0);
        Some(ClockStatus {
            seconds: Duration::from_nanos(now).as_secs_f64(),
            speed,
            factor: factor(self.samples.front()),
            overall: factor(self.began.as_ref()),
            paused: page.limit() != NEVER,
            waits_for: waits_for.to_string(),
        })
    }
}
