//! The log to which all processors of a system append.
#![cfg(feature = "sim")]

use std::sync::Mutex;
use std::time::Duration;

use condor_mbox::{Clock as _, Doorbell as _, SpinLock};
use condor_rt::{Machine, Processor, Program, ProgramError, Setup, shared_log, sim};

const LINES: u32 = 5;
/// All that a system can have, and the last visitor.
const PROCESSORS: [u8; 13] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 31];
const HOST: Processor = Processor(20);

/// Appends a line in each millisecond.
struct Writer;

impl Program for Writer {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?.background(|background| {
            for line in 0..LINES {
                background.log(format_args!("line {line}"))?;
                background.serve(Duration::from_millis(1))?;
            }
            Ok(())
        })
    }
}

#[test]
fn lines_of_all_processors_are_in_the_log() {
    let mut system = sim::VirtualSystem::new(4096).unwrap();
    system.share_memory(shared_log::BYTES).unwrap();
    for number in PROCESSORS {
        system.spawn(Processor(number), &Writer).unwrap();
    }
    system
        .host(HOST, |machine| {
            machine.work(100_000_000);
            let memory = machine.shared_memory().expect("shared memory");
            let mut reader = shared_log::reader(&memory)?;
            let mut lines = [0; condor_rt::PROCESSORS];
            let mut last = 0;
            while let Some(entry) = reader.next_entry()? {
                let of_processor = &mut lines[entry.processor().index()];
                assert_eq!(entry.text(), format!("line {of_processor}"));
                *of_processor += 1;
                assert!(entry.at().as_ns() >= last, "{entry:?}");
                last = entry.at().as_ns();
            }
            assert!(PROCESSORS.iter().all(|it| lines[usize::from(*it)] == LINES));
            Ok::<_, ProgramError>(())
        })
        .unwrap();
    system.run_until(200_000_000).unwrap();
}

#[test]
fn a_system_without_room_for_the_log_is_told_how_to_make_some() {
    for bytes in [None, Some(4096)] {
        let mut system = sim::VirtualSystem::new(4096).unwrap();
        if let Some(bytes) = bytes {
            system.share_memory(bytes).unwrap();
        }
        system.spawn(Processor(0), &Writer).unwrap();
        let error = system.run_until(1_000_000).unwrap_err().to_string();
        let found = bytes.unwrap_or(0);
        let expected = format!(
            "the program needs 20480 bytes of the memory that belongs to no processor, and the system has {found}: \
             set `bytes` of `[shared_memory]` in its description"
        );
        assert!(error.contains(&expected), "{error}");
    }
}

/// Appends once a second, and notes how long that took, in ms, and whether it succeeded.
struct Patient(Mutex<Vec<(u64, bool)>>);

impl Program for Patient {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?.background(|background| {
            let bell = machine.doorbell();
            while !background.is_stopping() {
                let begun = bell.now();
                let is_logged = background.log(format_args!("on")).is_ok();
                let took = bell.now().ns_since(begun) / 1_000_000;
                self.0.lock().unwrap().push((took, is_logged));
                let next = begun.after(Duration::from_secs(1));
                bell.wait(bell.prepare(), next, None);
            }
            Ok(())
        })
    }
}

#[test]
fn a_program_waits_for_the_lock_100_ms_at_most() {
    let patient = Patient(Mutex::default());
    let mut system = sim::VirtualSystem::new(4096).unwrap();
    system.share_memory(shared_log::BYTES).unwrap();
    system.spawn(Processor(31), &patient).unwrap();
    system
        .host(HOST, |machine| {
            let memory = machine.shared_memory().expect("shared memory");
            let lock = SpinLock::new(machine.test_and_set(memory, shared_log::LOCK)?);
            let mut mailbox = machine.mailbox()?;
            mailbox.join()?;
            // It holds the lock 50 ms of the first second, and 200 ms of the third one.
            for (begin, for_ms) in [(900, 150), (2900, 300)] {
                let now = machine.doorbell().now().as_ns();
                machine.work(begin * 1_000_000 - now);
                let guard = lock
                    .try_lock(mailbox.owner()?, &mailbox)
                    .map_err(|it| ProgramError::program(&it))?;
                machine.work(for_ms * 1_000_000);
                drop(guard);
            }
            Ok::<_, ProgramError>(())
        })
        .unwrap();
    system.run_until(4_500_000_000).unwrap();
    let all = patient.0.into_inner().unwrap();
    let expected = [(0, true), (50, true), (0, true), (100, false), (0, true)];
    assert!(all.starts_with(&expected), "{all:?}");
}
