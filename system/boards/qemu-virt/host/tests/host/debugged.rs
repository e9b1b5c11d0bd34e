//! The program of a hart, as a debugger reads and writes it.

use condor_debug::Tracer;
use condor_debug::gateway::{DebuggedProgram, Debuggee};
use condor_mbox::linux::{LinuxWindow, WindowAccess};
use condor_mbox::{MemoryWindow as _, Region};

/// Whoever reads while 8 bytes are written sees all of the old ones or all of the new.
#[cfg(target_arch = "x86_64")]
#[test]
fn eight_bytes_are_written_in_one_piece() {
    let file = tempfile::tempfile().unwrap();
    file.set_len(4096).unwrap();
    let map = || Region::whole(LinuxWindow::map(&file, 0, 4096, WindowAccess::ReadWrite).unwrap());
    let (area, memory, seen) = (map(), map(), map());
    let place = tempfile::tempdir().unwrap();
    let debuggee = Debuggee {
        name: "mapped".into(),
        tracer: Tracer::new(area, || {}),
        memory,
        base: 0,
        code: 0..0,
        bias: 0,
        lock: place.path().join("lock"),
        program: Box::new(|| DebuggedProgram::Runs(1)),
        host: None,
    };
    let writer = std::thread::spawn(move || {
        for number in 0..=u8::MAX {
            for _ in 0..1000 {
                debuggee.write(16, &[number; 8]).unwrap();
            }
        }
    });
    let mut bytes = [0; 16];
    while bytes[0] < u8::MAX {
        // Sixteen bytes that are aligned are read in one piece.
        seen.read(16, &mut bytes).unwrap();
        assert!(
            bytes[..8].iter().all(|byte| *byte == bytes[0]),
            "{bytes:x?}"
        );
    }
    writer.join().unwrap();
}
