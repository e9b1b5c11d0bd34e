//! Interrupts of boards that are memory, on processes of Linux in real time.
#![cfg(feature = "sim")]

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

use condor_dev::{
    InterruptController as _, InterruptCounts, InterruptEntry, InterruptLevel, InterruptVector,
};
use condor_mbox::Processor;
use condor_mos::Rate;
use condor_rt::linux::{Environment, LinuxProcess, LoopContext, UioDevice};
use condor_rt::{Background, Machine as _, ProgramError, Raiser, Setup};

use crate::environment;
use crate::terminal::raw_terminal;

const ME: Processor = Processor(3);
const BOARDS: Processor = Processor(4);
const VECTOR: InterruptVector = InterruptVector(131);
const PATIENCE: Duration = Duration::from_secs(60);
const INTERRUPTS: u32 = 200;

/// Counts what it claims.
struct Counting<'m> {
    machine: &'m LinuxProcess,
    vector: InterruptVector,
    served: AtomicU32,
}

impl InterruptEntry for Counting<'_> {
    fn serve_interrupts(&self) {
        let controller = self.machine.interrupt_controller();
        while let Some(vector) = controller.claim() {
            assert_eq!(vector, self.vector);
            controller.complete(vector);
            self.served.fetch_add(1, Relaxed);
        }
    }

    fn counts(&self) -> InterruptCounts {
        InterruptCounts::default()
    }

    fn each_unhandled(&self, _: &mut dyn FnMut(InterruptVector, u32)) {}

    fn each_stuck(&self, _: &mut dyn FnMut(InterruptVector, u32)) {}
}

fn environment(directory: &Path, processor: Processor, loops: LoopContext) -> Environment {
    environment::environment(directory, processor, 16384, loops)
}

/// Interrupts a program again and again, each time after it has served; `background` runs until it is told to end.
fn interrupt(loops: LoopContext, background: impl Fn(&mut dyn FnMut() -> bool, &AtomicBool)) {
    run(loops, |running, gone| {
        let mut serve = || running.serve(Duration::from_millis(1)).is_ok();
        background(&mut serve, gone);
    });
}

fn interrupt_with(loops: LoopContext, background: impl Fn(&LinuxProcess, &AtomicBool)) {
    run(loops, |running, gone| background(running.machine(), gone));
}

fn run(loops: LoopContext, background: impl Fn(&Background<'_, LinuxProcess>, &AtomicBool)) {
    let directory = tempfile::tempdir().unwrap();
    let environment = |processor, loops| environment(directory.path(), processor, loops);
    // SAFETY: the loop does nothing but count.
    let machine = unsafe { LinuxProcess::allowing_signals(&environment(ME, loops), []) }.unwrap();
    let boards = LinuxProcess::new(&environment(BOARDS, LoopContext::Threads), []).unwrap();
    let entry = Counting {
        machine: &machine,
        vector: VECTOR,
        served: AtomicU32::new(0),
    };
    let (gone, ticks) = (AtomicBool::new(false), AtomicU32::new(0));
    thread::scope(|scope| {
        scope.spawn(|| {
            let raiser = Raiser::new(&boards);
            let begun = Instant::now();
            for number in 0..INTERRUPTS {
                raiser.raise(ME, VECTOR);
                while entry.served.load(Relaxed) <= number && begun.elapsed() < PATIENCE {
                    thread::yield_now();
                }
            }
            while ticks.load(Relaxed) == 0 && begun.elapsed() < PATIENCE {
                thread::yield_now();
            }
            gone.store(true, Relaxed);
        });
        let ran = Setup::new(&machine)
            .unwrap()
            .interrupts(&entry)
            .servo("loop", Rate::hz(100), &mut |_| {
                ticks.fetch_add(1, Relaxed);
            })
            .background(|running| {
                background(running, &gone);
                Ok(())
            });
        ran.unwrap();
    });
    assert_eq!(entry.served.into_inner(), INTERRUPTS);
    assert!(ticks.into_inner() > 0);
}

#[test]
fn threads_are_interrupted_while_the_background_computes() {
    interrupt(LoopContext::Threads, |_, gone| {
        while !gone.load(Relaxed) {
            std::hint::spin_loop();
        }
    });
}

#[test]
fn a_program_with_signals_is_interrupted_while_the_background_computes() {
    interrupt(LoopContext::Signals, |_, gone| {
        while !gone.load(Relaxed) {
            std::hint::spin_loop();
        }
    });
}

#[test]
fn a_program_that_spins_is_interrupted_where_it_waits() {
    interrupt(LoopContext::Spin, |serve, gone| {
        while !gone.load(Relaxed) {
            assert!(serve());
        }
    });
}

#[test]
fn a_vector_that_is_enabled_again_interrupts_by_itself() {
    let enabled = AtomicBool::new(false);
    interrupt_with(LoopContext::Threads, |machine, gone| {
        let controller = machine.interrupt_controller();
        while !gone.load(Relaxed) {
            // Whatever comes meanwhile has rung in vain.
            controller.disable(VECTOR);
            thread::sleep(Duration::from_micros(100));
            controller.enable(VECTOR, InterruptLevel(3));
            enabled.store(true, Relaxed);
            thread::yield_now();
        }
    });
    assert!(enabled.into_inner());
}

#[test]
fn a_second_entry_is_refused() {
    interrupt_with(LoopContext::Threads, |machine, gone| {
        let entry = Counting {
            machine,
            vector: VECTOR,
            served: AtomicU32::new(0),
        };
        let second = machine.with_interrupts(&entry, || ());
        assert!(matches!(second, Err(ProgramError::Twice { .. })));
        while !gone.load(Relaxed) {
            thread::yield_now();
        }
    });
}

#[test]
fn a_uio_device_interrupts() {
    use std::io::{Read as _, Write as _};
    let directory = tempfile::tempdir().unwrap();
    // The count of an interrupt is read, and what is written allows the next one, as of a UIO device.
    let (mut board, path) = raw_terminal();
    let device = UioDevice { vector: 64, path };
    for loops in [LoopContext::Threads, LoopContext::Spin] {
        let environment = Environment {
            uio: vec![device.clone()],
            ..environment(directory.path(), ME, loops)
        };
        let machine = LinuxProcess::new(&environment, []).unwrap();
        let entry = Counting {
            machine: &machine,
            vector: InterruptVector(64),
            served: AtomicU32::new(0),
        };
        let gone = AtomicBool::new(false);
        let run = |running: &Background<'_, LinuxProcess>| {
            entry
                .machine
                .interrupt_controller()
                .enable(entry.vector, InterruptLevel(1));
            while !gone.load(Relaxed) {
                running.serve(Duration::from_millis(1))?;
            }
            Ok(())
        };
        thread::scope(|scope| {
            scope.spawn(|| {
                let begun = Instant::now();
                for number in 0..50 {
                    // The words that allow interrupts; the first one forbids them.
                    let mut words = [0; 4];
                    while words != 1_i32.to_ne_bytes() {
                        board.read_exact(&mut words).unwrap();
                    }
                    board.write_all(&1_u32.to_ne_bytes()).unwrap();
                    while entry.served.load(Relaxed) <= number && begun.elapsed() < PATIENCE {
                        thread::yield_now();
                    }
                }
                gone.store(true, Relaxed);
            });
            let ran = Setup::new(&machine)
                .unwrap()
                .interrupts(&entry)
                .background(run);
            ran.unwrap();
        });
        assert_eq!(entry.served.into_inner(), 50);
    }
}
