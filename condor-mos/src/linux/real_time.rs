//! [`RealTime`]: the privileges that a program asks of the kernel for its loops; and [`Privileges`]: the answers.

use core::fmt;
use core::num::NonZeroU64;
use std::io;

use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity, set_current_timer_slack};

/// The real-time privileges that a program asks of the Linux kernel for its loops. Loops also run
/// without them, but they start later after their releases.
///
/// ```
/// use condor_mos::linux::RealTime;
///
/// let wishes = RealTime::none().priority(80).pinned_to(1).memory_locked();
/// println!("{}", wishes.request());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub struct RealTime {
    priority: Option<u8>,
    cpu: Option<usize>,
    lock_memory: bool,
    slack_ns: Option<NonZeroU64>,
}

/// Asks for `SCHED_FIFO` from priority 80 down, and for timers without slack.
impl Default for RealTime {
    fn default() -> Self {
        Self::none().priority(80).timer_slack(NonZeroU64::MIN)
    }
}

impl RealTime {
    /// Makes a request without any privileges, to which the methods below add some.
    pub const fn none() -> Self {
        Self {
            priority: None,
            cpu: None,
            lock_memory: false,
            slack_ns: None,
        }
    }

    /// Asks for the scheduling policy `SCHED_FIFO`. The fastest loop gets the priority `highest`,
    /// from 1 to 99, and each slower loop the next lower priority (rate-monotonic).
    pub const fn priority(self, highest: u8) -> Self {
        Self {
            priority: Some(highest),
            ..self
        }
    }

    /// Asks for all loops to run on processor core number `cpu`.
    pub const fn pinned_to(self, cpu: usize) -> Self {
        Self {
            cpu: Some(cpu),
            ..self
        }
    }

    /// Asks for the program's present and future memory to stay in RAM (`mlockall`). If the system
    /// limits the amount, allocations may then fail.
    pub const fn memory_locked(self) -> Self {
        Self {
            lock_memory: true,
            ..self
        }
    }

    /// Asks for a timer slack of `ns` nanoseconds: the kernel may wake a loop that is not under
    /// `SCHED_FIFO` so much later, to save an interrupt. The kernel's default is 50 000 ns.
    pub const fn timer_slack(self, ns: NonZeroU64) -> Self {
        Self {
            slack_ns: Some(ns),
            ..self
        }
    }

    /// Asks the kernel for these privileges for the calling thread, and returns the kernel's
    /// answers. Call it on the thread on whose stack the loops of a
    /// [`SignalPlatform`](super::SignalPlatform) run; [`Threads`](super::Threads) ask by
    /// themselves.
    ///
    /// Under `SCHED_FIFO` the background of this thread keeps every thread of lower priority off
    /// its core while it computes.
    #[must_use]
    pub fn request(&self) -> Privileges {
        let mut privileges = self.request_for_process();
        privileges.add(self.request_for_thread(0, "the thread"));
        privileges
    }

    pub(super) fn request_for_process(&self) -> Privileges {
        let mut privileges = Privileges::default();
        if self.lock_memory {
            let locked = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE);
            privileges.note(Wish::Memory, "memory locked in RAM".into(), locked);
        }
        privileges
    }

    /// Asks for the calling thread, which is that of a loop of this rank.
    pub(super) fn request_for_thread(&self, rank: usize, who: &str) -> Privileges {
        let mut privileges = Privileges::default();
        if let Some(cpu) = self.cpu {
            let mut cpus = CpuSet::new();
            let pinned = if cpu < CpuSet::MAX_CPU {
                cpus.set(cpu);
                sched_setaffinity(None, &cpus)
            } else {
                Err(Errno::INVAL)
            };
            privileges.note(Wish::Cpu, format!("{who} on core {cpu}"), pinned);
        }
        if let Some(ns) = self.slack_ns {
            let set = set_current_timer_slack(Some(ns));
            privileges.note(Wish::Slack, format!("timer slack {ns} ns for {who}"), set);
        }
        if let Some(priority) = self.priority_of(rank) {
            let what = format!("SCHED_FIFO {priority} for {who}");
            privileges.note(Wish::Priority, what, set_priority(0, priority));
        }
        privileges
    }

    /// The priority of a rank, if one is wished for.
    pub(super) fn priority_of(&self, rank: usize) -> Option<i32> {
        let below = i32::try_from(rank).unwrap_or(i32::MAX);
        let priority = i32::from(self.priority?).saturating_sub(below);
        Some(priority.max(1))
    }
}

/// Puts a thread, 0 for the calling one, under `SCHED_FIFO`.
pub(super) fn set_priority(thread: i32, priority: i32) -> rustix::io::Result<()> {
    // SAFETY: all-zero bytes are a valid value of this structure of integers.
    let mut parameter: libc::sched_param = unsafe { core::mem::zeroed() };
    parameter.sched_priority = priority;
    // SAFETY: the structure outlives the call.
    if unsafe { libc::sched_setscheduler(thread, libc::SCHED_FIFO, &raw const parameter) } == 0 {
        return Ok(());
    }
    let code = io::Error::last_os_error().raw_os_error();
    Err(Errno::from_raw_os_error(code.unwrap_or(libc::EINVAL)))
}

/// The kernel's answers to a [`RealTime`] request, one for each privilege. `Display` prints them,
/// with a remedy for each privilege that was refused.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Privileges(Vec<Answer>);

#[derive(Clone, Debug, PartialEq, Eq)]
struct Answer {
    wish: Wish,
    what: String,
    result: Result<(), Errno>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    Priority,
    Cpu,
    Memory,
    Slack,
}

impl Wish {
    const fn advice(self) -> &'static str {
        match self {
            Self::Priority => {
                "run as root, or `setcap cap_sys_nice+ep` the program, or raise `ulimit -r` \
                 (rtprio in /etc/security/limits.conf)"
            }
            Self::Cpu => "choose a core of `nproc` that the program's cpuset contains",
            Self::Memory => {
                "run as root, or `setcap cap_ipc_lock+ep` the program, or raise `ulimit -l` \
                 (memlock in /etc/security/limits.conf)"
            }
            Self::Slack => "the kernel has no prctl(PR_SET_TIMERSLACK)",
        }
    }
}

impl Privileges {
    /// Iterates over the privileges that the kernel refused: a description of each, and the
    /// kernel's error.
    pub fn refused(&self) -> impl Iterator<Item = (&str, io::Error)> {
        self.0.iter().filter_map(|answer| {
            let error = answer.result.err()?;
            Some((answer.what.as_str(), error.into()))
        })
    }

    pub(super) fn add(&mut self, other: Self) {
        self.0.extend(other.0);
    }

    pub(super) fn note(&mut self, wish: Wish, what: String, result: Result<(), Errno>) {
        self.0.push(Answer { wish, what, result });
    }
}

impl fmt::Display for Privileges {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, answer) in self.0.iter().enumerate() {
            let end = if at == 0 { "" } else { "\n" };
            match answer.result {
                Ok(()) => write!(f, "{end}granted  {}", answer.what)?,
                Err(error) => write!(
                    f,
                    "{end}refused  {}: {}: {}",
                    answer.what,
                    io::Error::from(error),
                    answer.wish.advice()
                )?,
            }
        }
        Ok(())
    }
}
