//! [`Debugged`]: a program with something to see in a debugger.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use core::time::Duration;

use condor_rt::{Machine, Program, ProgramError, Rate, Setup};
use nalgebra::Vector3;

/// The words that a debugger reads and changes.
#[repr(C)]
pub(crate) struct Watched {
    /// Bits of an `f32`.
    gain: AtomicU32,
    fast: AtomicU32,
    slow: AtomicU32,
    faults: AtomicBool,
}

pub(crate) static WATCHED: Watched = Watched {
    gain: AtomicU32::new(f32::to_bits(2.0)),
    fast: AtomicU32::new(0),
    slow: AtomicU32::new(0),
    faults: AtomicBool::new(false),
};

/// Two loops and a vector.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Debugged {
    /// Whether the slower loop waits until the faster one has interrupted it. Where time counts
    /// instructions, the harts of a machine take turns, so that one that waits keeps the others from their
    /// loops.
    pub(crate) nests: bool,
}

impl Program for Debugged {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?
            .console()?
            .servo("slow", Rate::hz(50), &mut |_| {
                if self.nests {
                    wait_for_fast();
                }
                WATCHED.slow.fetch_add(1, Relaxed);
            })
            .servo("fast", Rate::hz(400), &mut |_| {
                let ticks = WATCHED.fast.load(Relaxed);
                let error = Vector3::new(1.0, 2.0, f32::from(ticks as u16));
                core::hint::black_box(torque(error));
                WATCHED.fast.store(ticks.wrapping_add(1), Relaxed);
            })
            .background(|background| {
                while !background.is_stopping() {
                    background.serve(Duration::from_millis(20))?;
                    if WATCHED.faults.load(Relaxed) {
                        // SAFETY: it traps: a debugger holds the program, or its monitor takes the hart.
                        unsafe { core::arch::asm!("unimp") };
                    }
                }
                Ok(())
            })
    }
}

/// Waits long enough for the other loop, but never for ever.
#[inline(never)]
fn wait_for_fast() {
    let before = WATCHED.fast.load(Relaxed);
    let mut turns = 0;
    while WATCHED.fast.load(Relaxed) == before && turns < 1 << 22 {
        turns += 1;
    }
}

/// Computes in one line after the other, through which a debugger can step.
#[inline(never)]
fn torque(error: Vector3<f32>) -> f32 {
    let gain = f32::from_bits(WATCHED.gain.load(Relaxed));
    let scaled = scale(error, gain);
    let sum = scaled.x + scaled.y;
    sum + scaled.z
}

#[inline(never)]
fn scale(error: Vector3<f32>, gain: f32) -> Vector3<f32> {
    let scaled = error * gain;
    core::hint::black_box(scaled)
}
