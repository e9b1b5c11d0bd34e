//! What a gateway promises to whoever connects.

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use condor_debug::gateway::{
    Cleaner, DebuggedProgram, Debuggee, DebuggerLock, PacketStream, Session, SessionError,
};
use condor_debug::{Breakpoint, HoldReason, ProgramState, sim};
use condor_mbox::sim::SimWindow;

use crate::stub::{ATTACHED, Running, STORING, until};

const PROGRAM: [u32; 4] = [sim::COUNT, sim::COUNT, sim::COUNT, sim::JUMP];
const LIMIT: Duration = Duration::from_secs(20);

fn debuggee(running: &Running, lock: &Path) -> Debuggee<SimWindow> {
    Debuggee {
        name: "simulated".into(),
        tracer: running.tracer(),
        memory: running.processor.memory().clone(),
        base: 0,
        code: 0..16,
        bias: 0,
        lock: lock.into(),
        program: Box::new(|| DebuggedProgram::Runs(1)),
        host: None,
    }
}

fn packet(text: &str) -> Vec<u8> {
    let sum = text.bytes().fold(0_u8, u8::wrapping_add);
    format!("${text}#{sum:02x}").into_bytes()
}

/// Sends a packet, and returns what the answer has between its first and last letters.
fn ask(stream: &mut UnixStream, text: &str) -> String {
    stream.write_all(&packet(text)).unwrap();
    let answer = received(stream, '$');
    // Whoever has detached does not wait for it.
    let _ = stream.write_all(b"+");
    answer
}

/// Waits for a notification, and returns what it says.
fn notified(stream: &mut UnixStream) -> String {
    received(stream, '%')
}

/// Reads up to the end of a packet, and returns what it has behind `mark`.
fn received(stream: &mut UnixStream, mark: char) -> String {
    let mut all = Vec::new();
    let mut byte = [0];
    while !all.contains(&b'#') {
        stream.read_exact(&mut byte).unwrap();
        all.push(byte[0]);
    }
    stream.read_exact(&mut [0; 2]).unwrap();
    let text = String::from_utf8(all).unwrap();
    let (_, packet) = text.split_once(mark).unwrap();
    packet.trim_end_matches('#').into()
}

#[test]
fn breakpoints_are_hidden_and_gone_when_the_debugger_is() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("lock");
    let mut session = Session::attach(vec![debuggee(&running, &path)]).unwrap();
    assert!(DebuggerLock::take(&path, Duration::ZERO).unwrap().is_none());
    let (mut gdb, ours) = UnixStream::pair().unwrap();
    gdb.set_read_timeout(Some(LIMIT)).unwrap();
    let served = std::thread::spawn(move || {
        let served = session.serve(PacketStream::new(ours).unwrap(), LIMIT);
        drop(session);
        served
    });
    assert!(ask(&mut gdb, "qSupported:swbreak+").contains("PacketSize"));
    assert!(ask(&mut gdb, "?").starts_with(['S', 'T']));
    assert_eq!(ask(&mut gdb, "Z0,4,4"), "OK");
    assert!(ask(&mut gdb, "Z0,100,4").starts_with('E'));
    assert!(ask(&mut gdb, "vCont;c").starts_with("T05"));
    assert_eq!(
        tracer.state(),
        Ok(ProgramState::Held(HoldReason::Breakpoint))
    );
    assert_eq!(running.words()[1], sim::BREAKPOINT);
    assert_eq!(ask(&mut gdb, "m4,4"), "01000000");
    // It goes without a word.
    drop(gdb);
    assert!(matches!(
        served.join().unwrap(),
        Err(SessionError::Connection(_))
    ));
    assert_eq!(tracer.state(), Ok(ProgramState::Runs));
    assert_eq!(running.words(), PROGRAM);
    running.end();
}

/// Two processors, of which the second has its memory behind the first, as two harts of a machine do.
struct Two {
    running: [Running; 2],
    _place: tempfile::TempDir,
    gdb: UnixStream,
    served: std::thread::JoinHandle<Result<bool, SessionError>>,
}

impl Two {
    fn new() -> Self {
        let running = [Running::new(&STORING), Running::new(&STORING)];
        let place = tempfile::tempdir().unwrap();
        let mut debuggees = Vec::new();
        for (number, (base, running)) in [0, 0x1000].into_iter().zip(&running).enumerate() {
            let mut debuggee = debuggee(running, &place.path().join(number.to_string()));
            debuggee.name = format!("number <{number}>");
            debuggee.code = base..base + 20;
            debuggees.push(debuggee);
        }
        let mut session = Session::attach(debuggees).unwrap();
        let (gdb, ours) = UnixStream::pair().unwrap();
        gdb.set_read_timeout(Some(LIMIT)).unwrap();
        let served = std::thread::spawn(move || {
            let served = session.serve(PacketStream::new(ours).unwrap(), LIMIT);
            drop(session);
            served
        });
        Self {
            running,
            _place: place,
            gdb,
            served,
        }
    }

    fn states(&self) -> [ProgramState; 2] {
        [0, 1].map(|number| self.running[number].tracer().state().unwrap())
    }

    fn end(mut self) {
        assert_eq!(ask(&mut self.gdb, "D"), "OK");
        assert!(!self.served.join().unwrap().unwrap());
        for running in self.running {
            assert_eq!(running.tracer().planted(), Ok(Vec::new()));
            running.end();
        }
    }
}

#[test]
fn a_stop_of_one_thread_stops_all() {
    let mut two = Two::new();
    let threads = ask(&mut two.gdb, "qXfer:threads:read::0,1000");
    assert!(threads.contains("<thread id=\"2\" name=\"number &lt;1&gt;\"/>"));
    assert!(ask(&mut two.gdb, "?").starts_with('T'));
    assert_eq!(two.states(), [ProgramState::Held(HoldReason::Stopped); 2]);
    assert_eq!(ask(&mut two.gdb, "Z0,0,2"), "OK");
    assert_eq!(ask(&mut two.gdb, "Z0,500,2"), "E01", "nobody's");
    // One alone.
    assert_eq!(ask(&mut two.gdb, "vCont;c:1"), "T05swbreak:;thread:1;");
    assert_eq!(ask(&mut two.gdb, "z0,0,2"), "OK");
    assert_eq!(ask(&mut two.gdb, "Z2,c,4"), "OK");
    let stop = ask(&mut two.gdb, "vCont;c");
    assert_eq!(stop, "T05watch:c;thread:1;");
    assert_eq!(two.states()[0], ProgramState::Held(HoldReason::Trigger));
    assert_ne!(two.states()[1], ProgramState::Runs);
    assert_eq!(ask(&mut two.gdb, "Hg2"), "OK");
    assert_eq!(ask(&mut two.gdb, "Hg3"), "E01");
    assert_eq!(ask(&mut two.gdb, "z2,c,4"), "OK");
    two.end();
}

#[test]
fn in_non_stop_mode_others_run_and_memory_is_read_meanwhile() {
    let mut two = Two::new();
    assert_eq!(ask(&mut two.gdb, "QNonStop:1"), "OK");
    assert_eq!(ask(&mut two.gdb, "?"), "OK", "nothing stands");
    let before = ask(&mut two.gdb, "mc,4");
    until(|| ask(&mut two.gdb, "mc,4") != before);
    assert_eq!(ask(&mut two.gdb, "g"), "E01", "it runs");
    assert_eq!(two.states(), [ProgramState::Runs; 2]);
    // A stop that GDB asks for has no signal.
    assert_eq!(ask(&mut two.gdb, "vCont;t:2"), "OK");
    assert_eq!(notified(&mut two.gdb), "Stop:T00thread:2;");
    assert_eq!(ask(&mut two.gdb, "vStopped"), "OK");
    assert_eq!(two.states()[0], ProgramState::Runs);
    // A breakpoint is planted into a running program.
    assert_eq!(ask(&mut two.gdb, "Z0,4,2"), "OK");
    assert_eq!(notified(&mut two.gdb), "Stop:T05swbreak:;thread:1;");
    assert_eq!(ask(&mut two.gdb, "vStopped"), "OK");
    assert_eq!(ask(&mut two.gdb, "vCont;c:2"), "OK");
    until(|| two.states()[1] == ProgramState::Runs);
    assert_eq!(two.states()[0], ProgramState::Held(HoldReason::Breakpoint));
    two.end();
}

#[test]
fn a_browser_is_sent_away_and_the_program_is_not_stopped() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("lock");
    let mut session = Session::attach(vec![debuggee(&running, &path)]).unwrap();
    let (mut browser, ours) = UnixStream::pair().unwrap();
    browser.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    let served = session.serve(PacketStream::new(ours).unwrap(), LIMIT);
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
    tracer.plant(&[Breakpoint::Instruction(4)], false).unwrap();
    until(|| tracer.state() != Ok(ProgramState::Runs));
    assert_eq!(cleaner.look(&tracer, &path), Ok(false), "it lives");
    assert_eq!(
        tracer.state(),
        Ok(ProgramState::Held(HoldReason::Breakpoint))
    );
    // The kernel does the same when it ends.
    drop(lock);
    assert_eq!(cleaner.look(&tracer, &path), Ok(true));
    until(|| {
        cleaner.look(&tracer, &path).unwrap();
        tracer.state() == Ok(ProgramState::Runs)
    });
    assert_eq!(running.words(), PROGRAM);
    until(|| {
        cleaner.look(&tracer, &path).unwrap();
        DebuggerLock::take(&path, Duration::ZERO).unwrap().is_some()
    });
    running.end();
}
