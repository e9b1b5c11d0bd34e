//! What a gateway promises to whoever connects.

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use condor_debug::gateway::{Cleaner, Debuggee, DebuggerLock, Session, SessionError, Stream};
use condor_debug::{Reason, State, sim};
use condor_mbox::sim::SimWindow;
use proptest::prelude::*;

use crate::slave::{ATTACHED, Running, until};

const PROGRAM: [u32; 4] = [sim::COUNT, sim::COUNT, sim::COUNT, sim::JUMP];
const LIMIT: Duration = Duration::from_secs(20);

fn debuggee(running: &Running, lock: &Path) -> Debuggee<SimWindow> {
    Debuggee {
        name: "simulated".into(),
        tracer: running.tracer(),
        memory: running.processor.memory().clone(),
        base: 0x8000_0000,
        code: 0x8000_0000..0x8000_0010,
        bias: 0,
        lock: lock.into(),
        ended: Box::new(|| None),
    }
}

fn packet(text: &str) -> Vec<u8> {
    let sum = text.bytes().fold(0_u8, u8::wrapping_add);
    format!("${text}#{sum:02x}").into_bytes()
}

/// Sends a packet, and returns what the answer has between its first and last letters.
fn ask(stream: &mut UnixStream, text: &str) -> String {
    stream.write_all(&packet(text)).unwrap();
    let mut all = Vec::new();
    let mut byte = [0];
    while !all.contains(&b'#') {
        stream.read_exact(&mut byte).unwrap();
        all.push(byte[0]);
    }
    stream.read_exact(&mut [0; 2]).unwrap();
    stream.write_all(b"+").unwrap();
    let text = String::from_utf8(all).unwrap();
    let (_, packet) = text.split_once('$').unwrap();
    packet.trim_end_matches('#').into()
}

#[test]
fn breakpoints_are_hidden_and_gone_when_the_debugger_is() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("lock");
    // The simulated processor has its memory at 0.
    let mut debuggee = debuggee(&running, &path);
    (debuggee.base, debuggee.code) = (0, 0..16);
    let mut session = Session::attach(debuggee).unwrap();
    assert!(DebuggerLock::take(&path, Duration::ZERO).unwrap().is_none());
    let (mut gdb, ours) = UnixStream::pair().unwrap();
    gdb.set_read_timeout(Some(LIMIT)).unwrap();
    let served = std::thread::spawn(move || {
        let served = session.serve(Stream::new(ours).unwrap(), LIMIT);
        drop(session);
        served
    });
    assert!(ask(&mut gdb, "qSupported:swbreak+").contains("PacketSize"));
    assert!(ask(&mut gdb, "?").starts_with(['S', 'T']));
    assert_eq!(ask(&mut gdb, "Z0,4,4"), "OK");
    assert!(ask(&mut gdb, "Z0,100,4").starts_with('E'));
    assert!(ask(&mut gdb, "vCont;c").starts_with("T05"));
    assert_eq!(tracer.state(), Ok(State::Held(Reason::Breakpoint)));
    assert_eq!(running.words()[1], sim::BREAKPOINT);
    // The protocol's shorthand for 01000000.
    assert_eq!(ask(&mut gdb, "m4,4"), "010*\"");
    // It goes without a word.
    drop(gdb);
    assert!(matches!(
        served.join().unwrap(),
        Err(SessionError::Connection(_))
    ));
    assert_eq!(tracer.state(), Ok(State::Runs));
    assert_eq!(running.words(), PROGRAM);
    running.end();
}

#[test]
fn a_browser_is_sent_away_and_the_program_is_not_stopped() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("lock");
    let mut session = Session::attach(debuggee(&running, &path)).unwrap();
    let (mut browser, ours) = UnixStream::pair().unwrap();
    browser.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    let served = session.serve(Stream::new(ours).unwrap(), LIMIT);
    assert!(matches!(served, Err(SessionError::Connection(_))));
    assert_eq!(tracer.holds(), Ok(0));
    drop(session);
    running.end();
}

#[test]
fn a_killed_debugger_is_cleaned_up_after() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("lock");
    let mut cleaner = Cleaner::new();
    let lock = DebuggerLock::take(&path, LIMIT).unwrap();
    tracer.set_mode(ATTACHED).unwrap();
    tracer.plant(&[4], false).unwrap();
    until(|| tracer.state() != Ok(State::Runs));
    assert_eq!(cleaner.look(&tracer, &path), Ok(false), "it lives");
    assert_eq!(tracer.state(), Ok(State::Held(Reason::Breakpoint)));
    // The kernel does the same when it ends.
    drop(lock);
    assert_eq!(cleaner.look(&tracer, &path), Ok(true));
    until(|| {
        cleaner.look(&tracer, &path).unwrap();
        tracer.state() == Ok(State::Runs)
    });
    assert_eq!(running.words(), PROGRAM);
    until(|| {
        cleaner.look(&tracer, &path).unwrap();
        DebuggerLock::take(&path, Duration::ZERO).unwrap().is_some()
    });
    running.end();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_gateway_bears_any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        super::packets::run(&bytes);
    }

    #[test]
    fn a_gateway_bears_packets_that_look_right(
        packets in prop::collection::vec("(m|M|Z0,|z0,|G|g|P|p|vCont;c|vCont;s|qXfer:memory-map:read::|qRcmd,|D|k|H|qSupported:|X)[0-9a-f,:;]{0,20}", 0..8)
    ) {
        let bytes = format!("\u{1}{}", packets.join("\0"));
        super::packets::run(bytes.as_bytes());
    }
}
