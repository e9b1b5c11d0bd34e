//! A gateway to which a debugger sends any bytes.

use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::Duration;

use crate::gateway::{DebuggedProgram, Debuggee, PacketStream, Session};
use crate::sim::{self, SimProcessor};
use crate::{ProgramState, Tracer};

const PROGRAM: [u32; 3] = [sim::COUNT, sim::COUNT, sim::JUMP];

/// Serves a connection on which a debugger sends `bytes`, the input of a fuzz target, and then disconnects. Afterwards
/// the program must run as before.
///
/// # Panics
/// Panics if the program does not run, or the gateway panics.
pub fn run(bytes: &[u8]) {
    let processor = Arc::new(SimProcessor::new(&PROGRAM).expect("it fits"));
    let program = Arc::clone(&processor);
    let thread = std::thread::spawn(move || program.run());
    let tracer = || {
        let rung = Arc::clone(&processor);
        Tracer::new(processor.area().clone(), move || rung.ring())
    };
    let place = tempfile::tempdir().expect("a directory");
    let debuggee = Debuggee {
        name: "simulated".into(),
        tracer: tracer(),
        memory: processor.memory().clone(),
        base: 0,
        code: 0..4 * PROGRAM.len() as u64,
        bias: 0,
        lock: place.path().join("lock"),
        program: Box::new(|| DebuggedProgram::Runs(1)),
        host: None,
    };
    let mut session = Session::attach(vec![debuggee]).expect("it runs");
    let (mut gdb, ours) = UnixStream::pair().expect("a pair");
    // The answers are not read: those that do not fit into the socket's buffer would wait.
    let mut framed = framed(bytes);
    framed.truncate(2000);
    gdb.write_all(&framed).expect("it fits");
    gdb.shutdown(std::net::Shutdown::Write).expect("it is open");
    let _ = session.serve(PacketStream::new(ours).expect("a socket"), Duration::ZERO);
    drop(session);
    let tracer = tracer();
    assert_eq!(tracer.state(), Ok(ProgramState::Runs));
    assert_eq!(tracer.planted().map(|planted| planted.len()), Ok(0));
    // A debugger may write memory, so that the program faults.
    processor.end();
    let _ = thread.join().expect("no panic");
}

/// Returns the bytes after the first one: as they are if the first is even, otherwise as packets with right
/// checksums, one for each run of bytes between zeros.
fn framed(bytes: &[u8]) -> Vec<u8> {
    let Some((first, rest)) = bytes.split_first() else {
        return Vec::new();
    };
    if first % 2 == 0 {
        return rest.to_vec();
    }
    let packets = rest.split(|byte| *byte == 0);
    let packets = packets.flat_map(|packet| {
        let sum = packet
            .iter()
            .fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        let end = format!("#{sum:02x}");
        [b"$", packet, end.as_bytes(), b"+"].concat()
    });
    packets.collect()
}
