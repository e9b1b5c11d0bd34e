//! The log to which all processors of a system append.
#![cfg(feature = "sim")]

use std::time::Duration;

use condor_rt::{Machine, Processor, Program, ProgramError, Setup, shared_log, sim};

const LINES: u32 = 5;
const PROCESSORS: u8 = 12;
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
    for number in 0..PROCESSORS {
        system.spawn(Processor(number), &Writer).unwrap();
    }
    system
        .host(HOST, |machine| {
            machine.work(100_000_000);
            let memory = machine.shared_memory().expect("shared memory");
            let mut reader = shared_log::reader(&memory)?;
            let mut lines = [0; PROCESSORS as usize];
            let mut last = 0;
            while let Some(entry) = reader.next_entry()? {
                let of_processor = &mut lines[entry.processor().index()];
                assert_eq!(entry.text(), format!("line {of_processor}"));
                *of_processor += 1;
                assert!(entry.at().as_ns() >= last, "{entry:?}");
                last = entry.at().as_ns();
            }
            assert_eq!(lines, [LINES; PROCESSORS as usize]);
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
