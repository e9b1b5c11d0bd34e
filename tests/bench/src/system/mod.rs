//! `system`: how fast a servo processor of the hand can run on Linux.
//!
//! The same tick runs at higher and higher rates. A rate is clean when the loop skips no more of its
//! releases than an empty loop, which takes turns with it at the same rate: what the machine takes
//! from both is not held against the loop.

mod servo;
mod turn;
mod walk;

use std::fmt::Write;
use std::io::IsTerminal;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use fastrand::Rng;
use turn::{Counts, Load, Turn, Way};
use walk::Walk;

use crate::Result;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::process::CorePair;

/// Releases at a rate, in all rounds together.
const RELEASES: u32 = 100_000;
/// The least number of rounds at a rate.
const ROUNDS: usize = 7;
/// The length of a turn. The kernel takes 50 ms of a second from a core that does nothing but
/// real-time work: turn and pause must fit into a second without meeting that.
const TURN: Duration = Duration::from_millis(750);
const PAUSE: Duration = Duration::from_millis(100);
/// The time that one way may take; a run of both stays below four minutes.
const PATIENCE: Duration = Duration::from_secs(105);
/// The rates of the memo, section 4.2, and of its servo processors.
const MEMO: &str = "The memo: 400 Hz with 8 joints a processor.";

/// A question to answer: the highest clean rate of a way, beside its goal.
struct Question {
    way: Way,
    about: &'static str,
    /// The goal, Hz; where the search begins.
    goal_hz: u32,
    name: &'static str,
}

const QUESTIONS: [Question; 2] = [
    Question {
        way: Way::Sleeping,
        about: "in signals, above a background that sleeps",
        goal_hz: 20_000,
        name: "clean_rate_16_sleeping_hz",
    },
    Question {
        way: Way::Spinning,
        about: "polled by a background that spins",
        goal_hz: 100_000,
        name: "clean_rate_16_spinning_hz",
    },
];

/// Turns of the control and of the joints in the same rounds.
#[derive(Debug)]
struct Trial {
    rate_hz: u32,
    /// Releases of a turn.
    releases: u32,
    control: Vec<Counts>,
    joints: Vec<Counts>,
}

impl Trial {
    /// Skips more than the control's, round by round.
    fn excess(&self) -> Estimate {
        let pairs = self.joints.iter().zip(&self.control);
        Estimate::of(pairs.map(|(joints, control)| joints.skipped - control.skipped))
    }

    /// Returns the excess for the verdict: where the control itself misses more than every tenth release,
    /// the trial says nothing of the loop, and the excess is infinite.
    fn judged(&self) -> Estimate {
        if self.skips(&self.control) > f64::from(RELEASES) / 10.0 {
            return Estimate::of([f64::INFINITY]);
        }
        self.excess()
    }

    fn is_clean(&self) -> bool {
        self.judged().value <= 0.0
    }

    /// Skips in 10^5 releases, of all rounds together.
    fn skips(&self, counts: &[Counts]) -> f64 {
        let skips: f64 = counts.iter().map(|counts| counts.skipped).sum();
        skips * f64::from(RELEASES) / (f64::from(self.releases) * counts.len() as f64)
    }

    fn run_us(&self) -> f64 {
        let runs = self.joints.iter().map(|counts| counts.mean_run_ns);
        Estimate::of(runs).value * 1e-3
    }
}

/// Returns the number of rounds, and the number of releases of a turn.
fn rounds(rate_hz: u32, least: usize) -> (usize, u32) {
    let releases = (u64::from(rate_hz) * TURN.as_millis() as u64 / 1000) as u32;
    let rounds = (RELEASES.div_ceil(releases.max(1)) as usize).max(least);
    (rounds, releases.max(1))
}

/// The core, the system, the order and the deadline of turns.
struct Stage<'s> {
    core: usize,
    system: &'s Path,
    order: Rng,
    least_rounds: usize,
    deadline: Instant,
}

impl Stage<'_> {
    /// Plays the joints and the control at a rate; `None` if the time is over.
    ///
    /// # Safety
    /// The calling process must have one thread only, since it is forked.
    unsafe fn try_rate(&mut self, way: Way, rate_hz: u32) -> Result<Option<Trial>> {
        let (rounds, releases) = rounds(rate_hz, self.least_rounds);
        let mut loads = [Load::Empty, Load::Joints];
        let (mut control, mut joints) = (Vec::new(), Vec::new());
        for _ in 0..rounds {
            self.order.shuffle(&mut loads);
            for load in loads {
                if Instant::now() > self.deadline {
                    return Ok(None);
                }
                thread::sleep(PAUSE);
                let turn = Turn {
                    way,
                    load,
                    rate_hz,
                    releases,
                    core: self.core,
                    system: self.system,
                };
                // SAFETY: one thread only, by this function's contract.
                let counts = unsafe { turn.play() }?;
                match load {
                    Load::Empty => control.push(counts),
                    Load::Joints => joints.push(counts),
                }
            }
        }
        Ok(Some(Trial {
            rate_hz,
            releases,
            control,
            joints,
        }))
    }
}

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let core = CorePair::find()?.second;
    let windows = tempfile::Builder::new()
        .prefix("condor-bench-")
        .tempdir_in("/dev/shm")?;
    let least = options.rounds(ROUNDS, ROUNDS);
    let mut text = format!(
        "Core {core}; at each rate at least {least} rounds with {RELEASES} releases in all, \
         in which control and loops take turns.\nClean: the median over the rounds of the skips more \
         than the control's is not above 0. {MEMO}\n"
    );
    if let Some(refused) = refused(core) {
        writeln!(text, "The kernel refuses: {refused}")?;
    }
    let mut goals = Vec::new();
    for question in &QUESTIONS {
        let mut stage = Stage {
            core,
            system: windows.path(),
            order: Rng::with_seed(0),
            least_rounds: least,
            deadline: Instant::now()
                + if options.quick {
                    PATIENCE / 6
                } else {
                    PATIENCE
                },
        };
        // SAFETY: the only thread that was started, in `refused`, has ended.
        goals.push(unsafe { answer(question, &mut stage, &mut text) }?);
    }
    Ok(Report { text, goals })
}

/// Finds the highest clean rate of a way.
///
/// # Safety
/// The calling process must have one thread only, since it is forked.
unsafe fn answer(question: &Question, stage: &mut Stage<'_>, text: &mut String) -> Result<Goal> {
    writeln!(
        text,
        "\n{:44} {:>9} {:>8} {:>9} {:>9}  {:24}",
        question.about, "Hz", "tick us", "skips", "control's", "more in a round [95 %]"
    )?;
    let mut walk = Walk::from(question.goal_hz);
    let progress = std::io::stderr().is_terminal();
    while let Some(rate_hz) = walk.next() {
        if progress {
            eprint!("\r{} at {rate_hz} Hz     ", question.about);
        }
        // SAFETY: one thread only, by this function's contract.
        let Some(trial) = unsafe { stage.try_rate(question.way, rate_hz) }? else {
            writeln!(text, "the time was over at {rate_hz} Hz")?;
            break;
        };
        walk.found(trial.judged());
        writeln!(
            text,
            "{:44} {:9} {:8.2} {:9.1} {:9.1}  {:24} {}",
            "16 joints",
            trial.rate_hz,
            trial.run_us(),
            trial.skips(&trial.joints),
            trial.skips(&trial.control),
            format!("{:.0}", trial.excess()),
            if trial.is_clean() { "clean" } else { "" }
        )?;
    }
    if progress {
        eprint!("\r{:70}\r", "");
    }
    Ok(Goal::least(
        question.name,
        walk.highest_clean(),
        question.goal_hz.into(),
    ))
}

/// Returns the privileges that a servo processor asks for and the kernel does not grant; `None` if it
/// grants all.
fn refused(core: usize) -> Option<String> {
    // A thread of its own keeps what it gets to itself.
    let asked = thread::spawn(move || {
        let wishes = condor_mos::linux::RealTime::none()
            .pinned_to(core)
            .priority(80);
        let privileges = wishes.request();
        let refused = privileges
            .refused()
            .map(|(what, error)| format!("{what}: {error}"));
        refused.collect::<Vec<_>>().join("; ")
    });
    asked.join().ok().filter(|refused| !refused.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(joints: [u32; 7], control: [u32; 7]) -> Trial {
        let counts = |skips: [u32; 7]| {
            let counts = skips.map(|skipped| Counts {
                skipped: skipped.into(),
                mean_run_ns: 5_000.0,
            });
            counts.to_vec()
        };
        Trial {
            rate_hz: 20_000,
            releases: 15_000,
            control: counts(control),
            joints: counts(joints),
        }
    }

    #[test]
    fn a_rate_is_clean_when_most_rounds_have_no_more_skips_than_the_control() {
        let noisy = trial([0, 90, 0, 0, 1, 4, 0], [0, 0, 50, 0, 0, 0, 0]);
        assert!(noisy.is_clean(), "{:?}", noisy.excess());
        let busy = trial([1, 2, 0, 1, 1, 0, 0], [0, 0, 50, 0, 0, 0, 0]);
        assert!(!busy.is_clean(), "{:?}", busy.excess());
        assert!((busy.skips(&busy.control) - 50.0 * 1e5 / 105_000.0).abs() < 1e-9);
    }

    #[test]
    fn rounds_together_have_all_releases() {
        for rate_hz in walk::LADDER {
            let (rounds, releases) = rounds(rate_hz, ROUNDS);
            assert!(rounds >= ROUNDS && rounds as u64 * u64::from(releases) >= 100_000);
        }
        assert_eq!(rounds(20_000, ROUNDS), (7, 15_000));
    }
}
