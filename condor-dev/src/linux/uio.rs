//! [`UioInterrupts`]: interrupts from the descriptors of UIO devices.

use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::interrupt::{InterruptController, InterruptLevel, InterruptVector};

/// An [`InterruptController`] of the interrupts of UIO devices (`/dev/uio`*n*). Each device has a
/// vector of its own.
///
/// The kernel masks a device's interrupt when it comes; [`complete`](InterruptController::complete)
/// enables it again. A thread of the program waits for interrupts and serves them, in place of an
/// interrupt handler:
///
/// ```no_run
/// # use condor_dev::{InterruptController, InterruptVector};
/// # use condor_dev::linux::UioInterrupts;
/// # use std::time::{Duration, Instant};
/// let device = std::fs::File::options().read(true).write(true).open("/dev/uio0")?;
/// let interrupts = UioInterrupts::new([(InterruptVector(64), device.into())])?;
/// # condor_dev::device_switch! {
/// #     struct Boards {
/// #         uart: condor_dev::drivers::Uart16550 = [condor_dev::Location::at(0x1000).interrupting(64, 1)],
/// #     }
/// # }
/// # let switch = condor_dev::Switch::<_, _, _, 1>::new(bus(), &interrupts, Boards::new());
/// # fn bus() -> condor_dev::Mmio { unimplemented!() }
/// while interrupts.wait(Instant::now() + Duration::from_secs(1))? {
///     switch.on_interrupt();
/// }
/// # Ok::<(), std::io::Error>(())
/// ```
///
/// A device that has vanished does not interrupt any more, see [`is_lost`](Self::is_lost).
#[derive(Debug)]
pub struct UioInterrupts {
    lines: Vec<Line>,
}

/// The largest number of devices: a wait has its list of them on the stack.
const MOST: usize = 64;

#[derive(Debug)]
struct Line {
    vector: InterruptVector,
    device: OwnedFd,
    /// 0 while it is disabled.
    level: AtomicU8,
    /// Claimed and not completed.
    claimed: AtomicBool,
    lost: AtomicBool,
}

impl UioInterrupts {
    /// Makes a controller of the interrupts of `devices`, all disabled. There are at most 64 of
    /// them: each is a vector, whose number you choose, and the file descriptor of a `/dev/uio`*n*
    /// that is open for reading and writing. This call makes reads of the descriptors non-blocking.
    ///
    /// # Errors
    /// [`InvalidInput`](io::ErrorKind::InvalidInput) if there are more than 64 devices; otherwise
    /// the error of the operating system.
    pub fn new(devices: impl IntoIterator<Item = (InterruptVector, OwnedFd)>) -> io::Result<Self> {
        let lines = devices.into_iter().map(|(vector, device)| {
            rustix::io::ioctl_fionbio(&device, true)?;
            let line = Line {
                vector,
                device,
                level: AtomicU8::new(0),
                claimed: AtomicBool::new(false),
                lost: AtomicBool::new(false),
            };
            line.allow(false);
            Ok(line)
        });
        let lines = lines.collect::<io::Result<Vec<_>>>()?;
        if lines.len() > MOST {
            let found = lines.len();
            let problem =
                format!("{found} devices are too many: at most {MOST} can be waited for at once");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        }
        Ok(Self { lines })
    }

    /// Waits until an enabled vector is pending, and returns true; returns false if `deadline`
    /// passes before.
    ///
    /// # Errors
    /// Returns the error of the operating system if `poll` fails, except if a signal interrupted it.
    pub fn wait(&self, deadline: Instant) -> io::Result<bool> {
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if self.poll(left)?.is_some() {
                return Ok(true);
            }
            if left.is_zero() {
                return Ok(false);
            }
        }
    }

    /// Returns true if the device of `vector` has failed, for example because it was unplugged; it
    /// does not interrupt again then. Returns false if it works, or if no device has this vector.
    #[must_use]
    pub fn is_lost(&self, vector: InterruptVector) -> bool {
        self.line(vector)
            .is_some_and(|line| line.lost.load(Ordering::Relaxed))
    }

    fn line(&self, vector: InterruptVector) -> Option<&Line> {
        self.lines.iter().find(|line| line.vector == vector)
    }

    /// The most urgent line that has something to read, after `patience` at most.
    fn poll(&self, patience: Duration) -> io::Result<Option<&Line>> {
        let Some(any) = self.lines.first() else {
            std::thread::sleep(patience);
            return Ok(None);
        };
        let mut lines = [any; MOST];
        let mut count = 0;
        let open = self.lines.iter().filter(|line| line.is_open());
        for (place, line) in lines.iter_mut().zip(open) {
            *place = line;
            count += 1;
        }
        // Behind them the array holds what nobody asks for.
        let mut fds = lines.map(|line| PollFd::new(&line.device, PollFlags::IN));
        let fds = fds.get_mut(..count).unwrap_or_default();
        let patience = Timespec::try_from(patience).ok();
        match poll(fds, patience.as_ref()) {
            Ok(_) => {}
            Err(Errno::INTR) => return Ok(None),
            Err(error) => return Err(error.into()),
        }
        let ready = fds
            .iter()
            .zip(lines.get(..count).unwrap_or_default())
            .filter(|(fd, _)| !fd.revents().is_empty());
        // Of one level, the first.
        let urgent = ready.rev().max_by_key(|(_, line)| line.level());
        Ok(urgent.map(|(_, line)| *line))
    }
}

impl Line {
    fn level(&self) -> InterruptLevel {
        InterruptLevel(self.level.load(Ordering::Relaxed))
    }

    fn is_open(&self) -> bool {
        self.level().0 > 0
            && !self.claimed.load(Ordering::Relaxed)
            && !self.lost.load(Ordering::Relaxed)
    }

    /// Tells the kernel whether the interrupt may come.
    fn allow(&self, allowed: bool) {
        // A driver without this control leaves its interrupt alone, and need not be told.
        let _ = rustix::io::write(self.device.as_fd(), &i32::from(allowed).to_ne_bytes());
    }

    /// Takes what is pending; says whether there was something.
    fn take(&self) -> bool {
        let mut count = [0; 4];
        loop {
            match rustix::io::read(&self.device, &mut count) {
                Ok(4) => return true,
                Err(Errno::INTR) => {}
                // Another thread was quicker.
                Err(Errno::AGAIN) => return false,
                Ok(_) | Err(_) => {
                    self.lost.store(true, Ordering::Relaxed);
                    return false;
                }
            }
        }
    }
}

impl InterruptController for UioInterrupts {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        if let Some(line) = self.line(vector) {
            line.level.store(level.0, Ordering::Relaxed);
            // A vector that is being served is let in by `complete`.
            if !line.claimed.load(Ordering::Relaxed) {
                line.allow(level.0 > 0);
            }
        }
    }

    fn disable(&self, vector: InterruptVector) {
        if let Some(line) = self.line(vector) {
            line.level.store(0, Ordering::Relaxed);
            line.allow(false);
        }
    }

    fn claim(&self) -> Option<InterruptVector> {
        loop {
            let line = self.poll(Duration::ZERO).ok()??;
            // One of several threads takes it; the Acquire pairs with the Release in `complete`.
            if line.claimed.swap(true, Ordering::Acquire) {
                continue;
            }
            if line.take() {
                return Some(line.vector);
            }
            line.claimed.store(false, Ordering::Release);
        }
    }

    fn complete(&self, vector: InterruptVector) {
        if let Some(line) = self.line(vector) {
            line.claimed.store(false, Ordering::Release);
            if line.level().0 > 0 {
                line.allow(true);
            }
        }
    }
}
