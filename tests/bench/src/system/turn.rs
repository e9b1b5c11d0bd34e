//! A turn: one load at one rate, on a processor that is a process of its own.

use std::path::Path;
use std::time::Duration;

use condor_mbox::{
    Allocator, Clock as _, MemoryWindow, Messenger, Processor, Published, Region, Windows,
};
use condor_mos::{LoopId, Overrun, Rate, Statistics};
use condor_robot::message::{ServoLayout, ServoObject};
use condor_rt::linux::{Environment, LinuxProcess, LoopContext};
use condor_rt::loops::LoopReport;
use condor_rt::objects::ObjectTable;
use condor_rt::{Machine, MailboxOf, PROCESSORS, ServoLoop};

use super::servo::{Bench, Fingers, Joints};
use crate::Result;
use crate::process::Child;

/// The processor that a turn is played on.
const NUMBER: Processor = Processor(1);
/// The priority of `SCHED_FIFO` that the servo processors of the hand have.
const PRIORITY: u8 = 80;
/// Bytes of users' data of each processor.
const WINDOW_BYTES: u32 = 65_536;
/// The time that is not counted: caches fill, and the kernel learns how long it is idle.
const WARM_UP_NS: u64 = 20_000_000;
/// The time for which the background serves before it looks around, and the time between two updates of the
/// counts.
const NAP_NS: u64 = 20_000_000;
const REPORT_NS: u64 = 50_000_000;
/// A turn that takes so much longer has gone wrong.
const GRACE: Duration = Duration::from_secs(5);

/// The way in which loops come to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// In signal handlers, above a background that sleeps.
    Sleeping,
    /// In the background, which polls.
    Spinning,
}

/// The work of the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Load {
    /// Nothing: the control.
    Empty,
    /// The servo tick of four fingers.
    Joints,
}

/// A turn of one way at one rate, with one load.
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

/// The counts of a turn.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    /// Releases that did not run.
    pub(super) skipped: f64,
    /// The mean run time of the loop, ns.
    pub(super) mean_run_ns: f64,
}

impl Counts {
    /// Returns the counts between two moments in which `asked` releases were due.
    ///
    /// A release for which a schedule was too late has not run either.
    fn between(before: &Statistics, after: &Statistics, asked: u32) -> Self {
        let since = |of: fn(&Statistics) -> u64| of(after).wrapping_sub(of(before)) as u32;
        let released = since(|statistics| statistics.released);
        // One more or less is on the edge of the time.
        let never = asked.saturating_sub(released).saturating_sub(1);
        let run_ns = after.total_run.wrapping_sub(before.total_run);
        let mean = run_ns.checked_div(since(|statistics| statistics.run).into());
        Self {
            skipped: since(|statistics| statistics.skipped)
                .saturating_add(never)
                .into(),
            mean_run_ns: mean.unwrap_or(0) as f64,
        }
    }
}

impl Turn<'_> {
    /// Plays it in a child process.
    ///
    /// # Safety
    /// The calling process must have one thread only, since it is forked.
    pub(super) unsafe fn play(&self) -> Result<Counts> {
        let length = Duration::from_nanos(WARM_UP_NS + self.length_ns());
        // SAFETY: one thread only, by this function's contract.
        let child = unsafe {
            Child::fork("servo processor", length + GRACE, || {
                let counts = self.run()?;
                Ok(vec![counts.skipped, counts.mean_run_ns])
            })
        }?;
        match child.figures()?[..] {
            [skipped, mean_run_ns] => Ok(Counts {
                skipped,
                mean_run_ns,
            }),
            _ => Err("a servo processor counted something else".into()),
        }
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
            clock: None,
            work_ns: Default::default(),
            loops: match self.way {
                Way::Sleeping => LoopContext::Signals,
                Way::Spinning => LoopContext::Spin,
            },
            cpu: Some(self.core),
            priority: Some(PRIORITY),
        };
        // SAFETY: the loops compute, read the clock, and write to windows and to memory of their own,
        // on a stack of megabytes; the background stays there.
        let machine = unsafe { LinuxProcess::allowing_signals(&environment, []) }?;
        self.run_on(&machine)
    }

    /// Runs the loop as the program of a servo processor does.
    fn run_on<M: Machine>(&self, machine: &M) -> Result<Counts> {
        let [_, Windows { data, .. }, ..] = machine.windows();
        let own = Region::users(data).map_err(display)?;
        let mut allocator = Allocator::new(own.size());
        let mut objects = ObjectTable::new(own.clone(), &mut allocator).map_err(display)?;
        let report =
            LoopReport::new(&own, &mut allocator, &mut objects, "servo").map_err(display)?;
        let servos = ServoLayout::<4, 4>::new(&mut allocator, PROCESSORS as u8).map_err(display)?;
        let joints = allocator.published().map_err(display)?;
        let mut mailbox = machine.mailbox().map_err(display)?;
        mailbox.join().map_err(display)?;
        let background = Background {
            turn: self,
            machine,
            mailbox: &mailbox,
        };
        match self.load {
            Load::Empty => background.measure(report, || {}),
            Load::Joints => background.tick(report, servos, &own, joints),
        }
    }
}

/// Returns the text of an error of the crates: many of them are for processors without `std`, and borrow.
fn display(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// The background, which runs when the loop does not: it serves messages and shows the counts of the loop.
struct Background<'b, 'v, M: Machine> {
    turn: &'b Turn<'b>,
    machine: &'b M,
    mailbox: &'b MailboxOf<'v, M>,
}

impl<M: Machine> Background<'_, '_, M> {
    /// Runs the loop of fingers.
    fn tick<W: MemoryWindow + Clone + Send>(
        &self,
        report: LoopReport<W>,
        layout: ServoLayout<4, 4>,
        own: &Region<W>,
        joints: Published<Joints>,
    ) -> Result<Counts> {
        let bench = Bench::new()?;
        let mut object = ServoObject::new();
        let exclusion = self.machine.exclusion();
        let mut fingers = Fingers::new(&bench, &mut object, own, layout, joints, exclusion)?;
        let counts = self.measure(report, || fingers.tick())?;
        fingers.check().map(|()| counts)
    }

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
        assert!(
            [on_time.skipped, on_time.mean_run_ns]
                .iter()
                .eq(&[2.0, 5000.0])
        );
        let edge = Counts::between(&before, &statistics(89, 179, 10), 100);
        assert!(edge.skipped.abs() < 0.5);
        let slow = Counts::between(&before, &statistics(40, 125, 15), 100);
        assert!((slow.skipped - 54.0).abs() < 0.5);
    }

    #[test]
    fn every_load_runs_both_ways() {
        let directory = tempfile::tempdir().unwrap();
        for way in [Way::Sleeping, Way::Spinning] {
            for load in [Load::Empty, Load::Joints] {
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
                assert!(counts.skipped < 200.0, "{turn:?}: {counts:?}");
                assert!(counts.mean_run_ns > 0.0, "{turn:?}: {counts:?}");
            }
        }
    }
}
