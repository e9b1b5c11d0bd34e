//! A turn: one load at one rate, on a processor that is a process of its own.

use std::io::{Read, Write, pipe};
use std::path::Path;
use std::time::Duration;

use condor_hand::message::{ServoObject, ServoPlaces};
use condor_mbox::{Clock as _, MemoryWindow, Messenger, Places, Processor, Region, Windows};
use condor_mos::{LoopId, Overrun, Rate, Statistics};
use condor_rt::linux::{Environment, Loops, Process};
use condor_rt::loops::LoopReport;
use condor_rt::objects::ObjectTable;
use condor_rt::{Machine, MailboxOf, PROCESSORS, ServoLoop};

use super::servo::{Bench, Fingers};
use crate::Result;
use crate::process::{Child, wait_for_all};

/// The processor that a turn is played on.
const NUMBER: Processor = Processor(1);
/// The priority of `SCHED_FIFO` that the servo processors of the hand have.
const PRIORITY: u8 = 80;
/// Bytes of users' data of each processor.
const WINDOW_BYTES: u32 = 65_536;
/// Not counted: caches fill, and the kernel learns how long it is idle.
const WARM_UP_NS: u64 = 20_000_000;
/// How long the background serves before it looks around, and how often it shows the counts.
const NAP_NS: u64 = 20_000_000;
const REPORT_NS: u64 = 50_000_000;
/// A turn that takes so much longer has gone wrong.
const GRACE: Duration = Duration::from_secs(5);

/// How loops come to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// In signal handlers, above a background that sleeps.
    Sleeping,
    /// Where the background polls.
    Spinning,
}

/// What the loop does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Load {
    /// Nothing: the control.
    Empty,
    /// The servo tick of two fingers.
    Joints8,
    /// The servo tick of four fingers.
    Joints16,
}

/// A turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn<'t> {
    pub(super) way: Way,
    pub(super) load: Load,
    pub(super) rate_hz: u32,
    /// Releases that count.
    pub(super) releases: u32,
    pub(super) core: usize,
    /// The directory of the windows.
    pub(super) system: &'t Path,
}

/// What was counted in a turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    /// Releases that did not run.
    pub(super) skipped: u32,
    /// The mean of the runs, ns.
    pub(super) mean_run_ns: u32,
}

impl Counts {
    const BYTES: usize = 8;

    fn bytes(self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        let (skipped, run) = bytes.split_at_mut(4);
        skipped.copy_from_slice(&self.skipped.to_ne_bytes());
        run.copy_from_slice(&self.mean_run_ns.to_ne_bytes());
        bytes
    }

    fn from_bytes(bytes: [u8; Self::BYTES]) -> Self {
        let (words, _) = bytes.as_chunks::<4>();
        let word = |index: usize| u32::from_ne_bytes(words[index]);
        Self {
            skipped: word(0),
            mean_run_ns: word(1),
        }
    }

    /// Between two moments in which `asked` releases were due.
    ///
    /// What a schedule was too late even to release has not run either.
    fn between(before: &Statistics, after: &Statistics, asked: u32) -> Self {
        let since = |of: fn(&Statistics) -> u64| of(after).wrapping_sub(of(before)) as u32;
        let released = since(|statistics| statistics.released);
        // One more or less is on the edge of the time.
        let never = asked.saturating_sub(released).saturating_sub(1);
        let run_ns = after.total_run.wrapping_sub(before.total_run);
        let mean = run_ns.checked_div(since(|statistics| statistics.run).into());
        Self {
            skipped: since(|statistics| statistics.skipped).saturating_add(never),
            mean_run_ns: mean.unwrap_or(0) as u32,
        }
    }
}

impl Turn<'_> {
    /// Plays it in a child process.
    ///
    /// # Safety
    /// The calling process must have one thread only, since it is forked.
    pub(super) unsafe fn play(&self) -> Result<Counts> {
        let (mut results, mut desk) = pipe()?;
        // SAFETY: one thread only, by this function's contract.
        let child = unsafe { Child::fork("servo processor", || desk.write_counts(self.run()?)) }?;
        drop(desk);
        let length = Duration::from_nanos(WARM_UP_NS + self.length_ns());
        wait_for_all(&mut [child], length + GRACE)?;
        let mut bytes = [0; Counts::BYTES];
        results.read_exact(&mut bytes)?;
        Ok(Counts::from_bytes(bytes))
    }

    fn length_ns(&self) -> u64 {
        u64::from(self.releases) * 1_000_000_000 / u64::from(self.rate_hz)
    }

    fn run(&self) -> Result<Counts> {
        let environment = Environment {
            system: self.system.into(),
            window_bytes: WINDOW_BYTES,
            processor: NUMBER,
            bus: None,
            shared_memory: None,
            loops: match self.way {
                Way::Sleeping => Loops::Signals,
                Way::Spinning => Loops::Spin,
            },
            cpu: Some(self.core),
            priority: Some(PRIORITY),
        };
        // SAFETY: the loops compute, read the clock, and write to windows and to memory of their own,
        // on a stack of megabytes; the background stays there.
        let machine = unsafe { Process::allowing_signals(&environment, []) }?;
        self.run_on(&machine)
    }

    /// As the program of a servo processor does it.
    fn run_on<M: Machine>(&self, machine: &M) -> Result<Counts> {
        let [_, Windows { data, .. }, ..] = machine.windows();
        let own = Region::users(data).map_err(display)?;
        let mut places = Places::new(own.size());
        let mut objects = ObjectTable::new(own.clone(), &mut places).map_err(display)?;
        let report = LoopReport::new(&own, &mut places, &mut objects, "servo").map_err(display)?;
        let two = ServoPlaces::<2, 4>::new(&mut places, PROCESSORS as u8).map_err(display)?;
        let four = ServoPlaces::<4, 4>::new(&mut places, PROCESSORS as u8).map_err(display)?;
        let joints = places.published().map_err(display)?;
        let mut mailbox = machine.mailbox().map_err(display)?;
        mailbox.join().map_err(display)?;
        let background = Background {
            turn: self,
            machine,
            mailbox: &mailbox,
        };
        let exclusion = machine.exclusion();
        match self.load {
            Load::Empty => background.measure(report, || {}),
            Load::Joints8 => {
                let bench = Bench::new([0, 1])?;
                let mut object = ServoObject::new();
                let mut fingers = Fingers::new(&bench, &mut object, &own, two, joints, exclusion)?;
                let counts = background.measure(report, || fingers.tick())?;
                fingers.check().map(|()| counts)
            }
            Load::Joints16 => {
                let bench = Bench::new([0, 1, 2, 3])?;
                let mut object = ServoObject::new();
                let mut fingers = Fingers::new(&bench, &mut object, &own, four, joints, exclusion)?;
                let counts = background.measure(report, || fingers.tick())?;
                fingers.check().map(|()| counts)
            }
        }
    }
}

/// What errors of the crates say: many of them are for processors without `std`, and borrow.
fn display(error: impl std::fmt::Display) -> String {
    error.to_string()
}

trait Desk {
    fn write_counts(&mut self, counts: Counts) -> Result<()>;
}

impl<W: Write> Desk for W {
    fn write_counts(&mut self, counts: Counts) -> Result<()> {
        Ok(self.write_all(&counts.bytes())?)
    }
}

/// What runs when the loop does not: it serves messages and shows the counts of the loop.
struct Background<'b, 'v, M: Machine> {
    turn: &'b Turn<'b>,
    machine: &'b M,
    mailbox: &'b MailboxOf<'v, M>,
}

impl<M: Machine> Background<'_, '_, M> {
    /// Runs the loop for the time of the turn.
    fn measure<W: MemoryWindow + Clone>(
        &self,
        mut report: LoopReport<W>,
        mut tick: impl FnMut() + Send,
    ) -> Result<Counts> {
        let turn = self.turn;
        let bell = self.machine.doorbell();
        let begun_ns = bell.now().as_ns();
        let counted_ns = begun_ns + WARM_UP_NS;
        let end_ns = counted_ns + turn.length_ns();
        // A loop that takes all of the processor would keep the background from ever ending it.
        let limit_ns = end_ns + turn.length_ns() / 4;
        let loops_bell = &bell;
        let mut body = |_| {
            if loops_bell.now().as_ns() <= limit_ns {
                tick();
            }
        };
        let servo = ServoLoop {
            rate: Rate::hz(turn.rate_hz),
            overrun: Overrun::Skip,
            body: &mut body,
        };
        let ran = self.machine.with_loops(&mut [servo], |loops| {
            let statistics = || loops.statistics(LoopId(0)).map_err(display);
            self.serve_until(counted_ns, || Ok(()))?;
            let before = statistics()?;
            self.serve_until(end_ns, || {
                report.publish(&statistics()?).map_err(display)?;
                Ok(())
            })?;
            Ok(Counts::between(&before, &statistics()?, turn.releases))
        });
        ran.map_err(display)?
    }

    fn serve_until(&self, end_ns: u64, mut show: impl FnMut() -> Result<()>) -> Result<()> {
        let bell = self.machine.doorbell();
        let mut now = bell.now().as_ns();
        let mut shown = now;
        while now < end_ns {
            let nap = Duration::from_nanos(NAP_NS.min(end_ns - now));
            self.mailbox.serve(nap).map_err(display)?;
            now = bell.now().as_ns();
            if now - shown >= REPORT_NS {
                shown = now;
                show()?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn statistics(released: u64, run: u64, skipped: u64) -> Statistics {
        Statistics {
            rate: Rate::hz(1000),
            frequency: Rate::hz(1_000_000_000),
            enabled: true,
            faulted: false,
            released,
            run,
            skipped,
            running: 0,
            pending: 0,
            worst_lateness: 0,
            worst_run: 0,
            total_run: run * 5000,
            released_before: 0,
            total_before: 0,
        }
    }

    #[test]
    fn what_was_never_released_is_skipped_too() {
        let before = statistics(u64::MAX - 9, 80, 10);
        let on_time = Counts::between(&before, &statistics(90, 178, 12), 100);
        assert_eq!((on_time.skipped, on_time.mean_run_ns), (2, 5000));
        let edge = Counts::between(&before, &statistics(89, 179, 10), 100);
        assert_eq!(edge.skipped, 0);
        let slow = Counts::between(&before, &statistics(40, 125, 15), 100);
        assert_eq!(slow.skipped, 5 + 49);
    }

    #[test]
    fn counts_survive_the_pipe() {
        let counts = Counts {
            skipped: 7,
            mean_run_ns: 5432,
        };
        assert_eq!(Counts::from_bytes(counts.bytes()), counts);
    }

    #[test]
    fn every_load_runs_both_ways() {
        let directory = tempfile::tempdir().unwrap();
        for way in [Way::Sleeping, Way::Spinning] {
            for load in [Load::Empty, Load::Joints8, Load::Joints16] {
                let turn = Turn {
                    way,
                    load,
                    rate_hz: 1000,
                    releases: 200,
                    core: crate::process::CorePair::find().unwrap().first,
                    system: directory.path(),
                };
                // Not in a child: tests have threads.
                let counts = std::thread::scope(|scope| {
                    scope
                        .spawn(|| turn.run().map_err(|error| error.to_string()))
                        .join()
                        .unwrap()
                });
                let counts = counts.unwrap();
                assert!(counts.skipped < 200, "{turn:?}: {counts:?}");
                assert!(counts.mean_run_ns > 0, "{turn:?}: {counts:?}");
            }
        }
    }
}
