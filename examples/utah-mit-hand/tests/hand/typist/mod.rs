//! The whole system of the hand in virtual time, with somebody who types at the master's terminal.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use condor_dev::linux::{LinuxBus, MapAccess};
use condor_fs::server::{FileServer, ServerOptions};
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{
    Call, Mailbox, MemoryWindow as _, Messenger, PeerState, Processor, Region, Windows,
};
use condor_robot::compile::{compile_grasps, compile_motions};
use condor_robot::master::{DesiredPositions, Master};
use condor_robot::plant::{Plant, TrueState};
use condor_robot::servo::Servo;
use condor_robot::table::Table;
use condor_robot::{FINGERS, IMAGE, JOINTS, RobotDescription, objects};
use condor_rt::objects::{self as table, ObjectKind};
use condor_rt::sim::{Bell, SimCriticalSection, SimMachine as Simulated, VirtualSystem};
use condor_rt::{Machine, PROCESSORS, Program, ProgramError, loops, numbers};
use condor_tty::layout::{ALIGNMENT, reply};
use condor_tty::{TerminalReader, TerminalVectors};
use utah_mit_boards::robot::{Rack, address};

use crate::ending::Ending;

pub(crate) const MASTER: Processor = Processor(0);
pub(crate) const FIRST: Processor = Processor(1);
pub(crate) const SECOND: Processor = Processor(2);
pub(crate) const TABLE: Processor = Processor(5);
pub(crate) const PLANT: Processor = Processor(6);
const ALL: [Processor; 5] = [MASTER, FIRST, SECOND, TABLE, PLANT];

const WINDOW_BYTES: u32 = 1_048_576;
const STEP_NS: u64 = 500_000;
const SOON: Duration = Duration::from_secs(2);
const HAND: &str = include_str!("../../../../../condor-hand/hands/utah-mit.toml");

pub(crate) fn hand() -> RobotDescription {
    RobotDescription::from_toml(HAND, "utah-mit.toml").unwrap()
}

/// Where the motions that ship are written.
pub(crate) fn motions() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("motions")
}

/// Where the grasps that ship are written.
pub(crate) fn grasps() -> std::path::PathBuf {
    motions().with_file_name("grasps")
}

/// How the master begins to say why something is not done.
pub(crate) const REFUSED: &str = "error: ";
/// The prompt of the master, and what removes it.
const PROMPTS: [&str; 2] = ["\r> \x1b[K", "\r\x1b[K"];

type Post<'v> = Mailbox<'v, (LinuxWindow, Bell, SimCriticalSection), PROCESSORS>;

/// Who types, and sees everything.
pub(crate) struct Typist<'m> {
    machine: &'m Simulated<LinuxBus>,
    mailbox: &'m Post<'m>,
    ends: &'m [AtomicU64; PROCESSORS],
    /// The directory that is served.
    pub(crate) files: &'m Path,
    stalled: &'m Mutex<Option<Stalled>>,
    reader: Option<TerminalReader<LinuxWindow>>,
    /// What the master's terminal has shown, without its prompts.
    pub(crate) shown: String,
    /// The last characters, if a prompt may begin with them: the next ones decide.
    begun: String,
    former: Option<DesiredPositions>,
    /// The set-points of all joints, at each tick of the trajectories.
    pub(crate) wanted: Vec<[[f64; JOINTS]; FINGERS]>,
    /// Their rates.
    pub(crate) rates: Vec<[[f64; JOINTS]; FINGERS]>,
    /// The true positions at the same ticks.
    pub(crate) is: Vec<[[f64; JOINTS]; FINGERS]>,
    /// The largest distance of a joint that follows from where it was to be, rad.
    pub(crate) peak_rad: f64,
    next_ns: u64,
}

/// The file service is busy for so long, s, when somebody opens the file of this path.
struct Stalled {
    path: String,
    seconds: f64,
}

/// Runs the system, with a script for who types; the system ends when the script does.
pub(crate) fn run<R: Send>(script: impl FnOnce(&mut Typist<'_>) -> R + Send) -> R {
    run_with(&hand(), script)
}

/// The same with another hand.
pub(crate) fn run_with<R: Send>(
    hand: &RobotDescription,
    script: impl FnOnce(&mut Typist<'_>) -> R + Send,
) -> R {
    let files = tempfile::tempdir().unwrap();
    let mut image = vec![0; 16384];
    let len = hand.to_image(&mut image).unwrap();
    std::fs::write(files.path().join(IMAGE), &image[..len]).unwrap();
    compile_motions(&motions(), &files.path().join("motions"), hand).unwrap();
    compile_grasps(&grasps(), &files.path().join("grasps")).unwrap();
    let memory = tempfile::tempfile().unwrap();
    memory.set_len(address::BUS_BYTES as u64).unwrap();
    let bytes = address::BUS_BYTES;
    let bus = LinuxBus::map(&memory, 0, 0, bytes, MapAccess::ReadWrite).unwrap();
    let ends: [AtomicU64; PROCESSORS] = std::array::from_fn(|_| AtomicU64::new(u64::MAX));
    let (found, stalled) = (Mutex::new(None), Mutex::new(None));

    let mut system = VirtualSystem::with_bus(WINDOW_BYTES, bus).unwrap();
    let root = files.path();
    let serving = |machine: &Simulated<LinuxBus>| serve_files(machine, root, &stalled, &ends);
    system.host(numbers::FILES, serving).unwrap();
    let lives = &ends;
    system
        .host(MASTER, move |machine| live(machine, &Master, lives))
        .unwrap();
    for number in [FIRST, SECOND] {
        system
            .host(number, move |machine| {
                live(machine, &Servo::<Rack>::new(), lives)
            })
            .unwrap();
    }
    if hand.table.is_some() {
        system
            .host(TABLE, move |machine| {
                live(machine, &Table::<Rack>::new(), lives)
            })
            .unwrap();
    }
    system
        .host(PLANT, move |machine| {
            live(machine, &Plant::<Rack>::new(), lives)
        })
        .unwrap();
    system
        .host(numbers::TERMINALS, |machine| {
            let mut mailbox = Post::new(
                numbers::TERMINALS,
                machine.windows(),
                machine.doorbell(),
                machine.exclusion(),
            )?;
            mailbox.set_waiting(machine.waiting());
            mailbox.join()?;
            let mut typist = Typist {
                machine,
                mailbox: &mailbox,
                ends: &ends,
                files: root,
                stalled: &stalled,
                reader: None,
                shown: String::new(),
                begun: String::new(),
                former: None,
                wanted: Vec::new(),
                rates: Vec::new(),
                is: Vec::new(),
                peak_rad: 0.0,
                next_ns: STEP_NS,
            };
            let result = script(&mut typist);
            *found.lock().unwrap() = Some(result);
            // Zero: for good.
            for end in &ends {
                end.store(0, Relaxed);
            }
            Ok::<_, condor_mbox::MailboxError>(())
        })
        .unwrap();
    system.run().unwrap();
    found.into_inner().unwrap().unwrap()
}

/// Runs a program, and another incarnation of it after each end that was not the last.
fn live(
    machine: &Simulated<LinuxBus>,
    program: &impl Program,
    ends: &[AtomicU64; PROCESSORS],
) -> Result<(), ProgramError> {
    let end = &ends[machine.number().index()];
    let ending = Ending { machine, end };
    while !machine.is_stopping() {
        program.run(&ending)?;
        if end.load(Relaxed) == 0 {
            break;
        }
        end.store(u64::MAX, Relaxed);
        // As long as a process takes to come up.
        machine.work(200_000_000);
    }
    Ok(())
}

/// Serves files, in one incarnation after the other, none of which says that it ends.
fn serve_files(
    machine: &Simulated<LinuxBus>,
    root: &Path,
    stalled: &Mutex<Option<Stalled>>,
    ends: &[AtomicU64; PROCESSORS],
) -> Result<(), condor_mbox::MailboxError> {
    let end = &ends[numbers::FILES.index()];
    while !machine.is_stopping() && end.load(Relaxed) != 0 {
        let server = FileServer::new(root, ServerOptions::default()).unwrap();
        serve_files_once(machine, &server, stalled, end)?;
        if end.compare_exchange(1, u64::MAX, Relaxed, Relaxed).is_ok() {
            // As long as a process takes to come up.
            machine.work(150_000_000);
        }
    }
    Ok(())
}

fn serve_files_once(
    machine: &Simulated<LinuxBus>,
    server: &FileServer,
    stalled: &Mutex<Option<Stalled>>,
    end: &AtomicU64,
) -> Result<(), condor_mbox::MailboxError> {
    let windows = machine.windows();
    server
        .recover(&windows)
        .expect("its journal can be written");
    let handler = |call: &Call<'_>| {
        let mut stalled = stalled.lock().unwrap();
        let path = path_of_open(&windows[call.sender().index()], call.data());
        if let Some(Stalled { seconds, .. }) = stalled.take_if(|it| path.as_ref() == Some(&it.path))
        {
            machine.work(Duration::from_secs_f64(seconds).as_nanos() as u64);
        }
        server.answer(call, &windows)
    };
    let mut mailbox = Post::new(
        numbers::FILES,
        windows.clone(),
        machine.doorbell(),
        machine.exclusion(),
    )?;
    mailbox.set_waiting(machine.waiting());
    mailbox.set_vector(condor_fs::wire::FILES, &handler, "files")?;
    mailbox.join()?;
    while !machine.is_stopping() && end.load(Relaxed) == u64::MAX {
        mailbox.serve(Duration::from_millis(20))?;
    }
    Ok(())
}

/// The path in the slot of a client, if it asks to open a file.
fn path_of_open(client: &Windows<LinuxWindow>, slot: u32) -> Option<String> {
    let region = Region::users(client.data.clone()).ok()?;
    let word = |at| region.word(slot + at).ok();
    let [operation, path, length] = [word(20)?, word(40)?, word(44)?];
    if operation != condor_fs::wire::Operation::Open as u32 {
        return None;
    }
    let mut bytes = vec![0; length as usize];
    region.read(path, &mut bytes).ok()?;
    String::from_utf8(bytes).ok()
}

impl Typist<'_> {
    /// The mailbox of who types, which asks for motions, too.
    pub(crate) fn mailbox(&self) -> &Post<'_> {
        self.mailbox
    }

    pub(crate) fn region(&self, number: Processor) -> Region<LinuxWindow> {
        let data = self.machine.windows()[number.index()].data.clone();
        Region::users(data).unwrap()
    }

    pub(crate) fn truth(&self) -> TrueState {
        let region = self.region(PLANT);
        let cell = objects::truth(&region).unwrap().unwrap();
        cell.subscriber(&region).unwrap().read().unwrap().value
    }

    fn look(&mut self) {
        let region = self.region(MASTER);
        let Ok(Some(cell)) = objects::wanted(&region) else {
            return;
        };
        let Ok(latest) = cell.subscriber(&region).unwrap().read() else {
            return;
        };
        let wanted = latest.value;
        if self
            .former
            .is_some_and(|former| former.ticks == wanted.ticks)
        {
            return;
        }
        self.wanted.push(wanted.position);
        self.rates.push(wanted.velocity);
        if let Some(cell) = objects::truth(&self.region(PLANT)).unwrap()
            && let Ok(truth) = cell.subscriber(&self.region(PLANT)).unwrap().read()
        {
            let is = truth.value.position;
            self.is.push(is);
            if let Some(former) = self.former {
                let loose = former.loose | wanted.loose;
                for (finger, (is, wanted)) in is.iter().zip(&former.position).enumerate() {
                    for (is, wanted) in is.iter().zip(wanted) {
                        if loose >> finger & 1 == 0 {
                            self.peak_rad = self.peak_rad.max((is - wanted).abs());
                        }
                    }
                }
            }
        }
        self.former = Some(wanted);
    }

    fn fetch(&mut self) {
        if self.reader.is_none() {
            let region = self.region(MASTER);
            let Some(entry) = table::find(&region, "console", ObjectKind::Terminal).unwrap() else {
                return;
            };
            self.reader = TerminalReader::attach(region, entry.offset, numbers::TERMINALS).ok();
        }
        let mut bytes = [0; 1024];
        while let Some(reader) = &mut self.reader {
            match reader.fetch(&mut bytes) {
                Ok(fetched) if fetched.len > 0 => {
                    self.begun += &String::from_utf8_lossy(&bytes[..fetched.len]);
                    let last = self.begun.rfind('\r').unwrap_or(self.begun.len());
                    let is_begun = |whole: &&str| whole.starts_with(&self.begun[last..]);
                    let is_part = PROMPTS.iter().any(is_begun);
                    let whole = if is_part { last } else { self.begun.len() };
                    let mut text: String = self.begun.drain(..whole).collect();
                    for prompt in PROMPTS {
                        text = text.replace(prompt, "");
                    }
                    self.shown += &text.replace('\r', "");
                    reader.acknowledge(fetched.len).unwrap();
                }
                Ok(_) => break,
                // Another incarnation.
                Err(_) => self.reader = None,
            }
        }
    }

    pub(crate) fn wait(&mut self, seconds: f64) {
        let end = self.machine.now() + Duration::from_secs_f64(seconds).as_nanos() as u64;
        while self.machine.now() < end {
            while self.machine.now() < self.next_ns {
                let left = Duration::from_nanos(self.next_ns - self.machine.now());
                self.mailbox.serve(left).unwrap();
            }
            self.next_ns += STEP_NS;
            self.look();
            self.fetch();
        }
    }

    /// Waits until the terminal shows a text, after what was waited for before.
    pub(crate) fn expect(&mut self, text: &str, seconds: f64) {
        let end = self.machine.now() + Duration::from_secs_f64(seconds).as_nanos() as u64;
        while !self.shown.contains(text) {
            assert!(
                self.machine.now() < end,
                "no {text:?} within {seconds} s:\n{}",
                self.shown
            );
            self.wait(0.01);
        }
    }

    /// Types a line.
    pub(crate) fn types(&mut self, line: &str) {
        self.presses(line);
        self.presses("\n");
    }

    /// Presses keys: types their characters.
    pub(crate) fn presses(&mut self, keys: &str) {
        let region = self.region(MASTER);
        let entry = table::find(&region, "console", ObjectKind::Terminal)
            .unwrap()
            .unwrap();
        for character in keys.bytes() {
            let data = (entry.offset / ALIGNMENT) << 8 | u32::from(character);
            loop {
                let (to, vector) = (MASTER, TerminalVectors::DEFAULT.input);
                let accepted = self.mailbox.send_with_reply(to, vector, data, SOON);
                match accepted.unwrap() {
                    reply::ACCEPTED => break,
                    reply::FULL => self.wait(0.01),
                    other => panic!("{other}"),
                }
            }
        }
    }

    /// Types a line, and gives what is said within a moment.
    pub(crate) fn says(&mut self, line: &str) -> String {
        self.shown.clear();
        self.types(line);
        self.wait(0.3);
        let shown = std::mem::take(&mut self.shown);
        let echo = format!("{line}\n");
        shown.strip_prefix(&echo).unwrap_or(&shown).to_owned()
    }

    /// Types a line that the master obeys.
    pub(crate) fn does(&mut self, line: &str) {
        let said = self.says(line);
        assert!(
            !said.is_empty() && !said.contains(REFUSED),
            "{line}: {said}"
        );
    }

    /// Waits until all processors are there.
    pub(crate) fn begin(&mut self) {
        self.expect("processor 1 controls index and middle", 5.0);
        self.expect("processor 2 controls ring and thumb", 5.0);
        self.wait(0.3);
        self.shown.clear();
    }

    /// Enables the hand, and brings the fingers around the place of a ball.
    pub(crate) fn reaches_for_a_ball(&mut self) {
        self.begin();
        self.does("enable");
        self.wait(1.0);
        self.runs("open");
        self.runs("grasp");
    }

    /// Runs a motion to its end; gives the largest error of tracking, degrees.
    pub(crate) fn runs(&mut self, name: &str) -> f64 {
        self.shown.clear();
        self.peak_rad = 0.0;
        self.types(&format!("run {name}"));
        self.expect(&format!("{name} is done\n"), 20.0);
        let peak_deg = self.peak_rad.to_degrees();
        // How well it was followed.
        self.expect(&format!("{name}: largest tracking error "), 1.0);
        peak_deg
    }

    /// Ends the present incarnation of a program; the next one begins by itself.
    pub(crate) fn restart(&mut self, number: Processor) {
        let incarnation = |state| match state {
            PeerState::Up { incarnation, .. } => Some(incarnation),
            _ => None,
        };
        let before = incarnation(self.mailbox.peer_state(number).unwrap());
        self.ends[number.index()].store(1, Relaxed);
        loop {
            self.wait(0.02);
            let now = incarnation(self.mailbox.peer_state(number).unwrap());
            if now.is_some() && now != before {
                return;
            }
        }
    }

    /// The present incarnation of the file service, if it has one.
    pub(crate) fn incarnation_of_files(&self) -> Option<u32> {
        match self.mailbox.peer_state(numbers::FILES).unwrap() {
            PeerState::Up { incarnation, .. } => Some(incarnation),
            _ => None,
        }
    }

    /// Ends a program for good.
    pub(crate) fn ends(&mut self, number: Processor) {
        self.ends[number.index()].store(0, Relaxed);
        while matches!(
            self.mailbox.peer_state(number).unwrap(),
            PeerState::Up { .. }
        ) {
            self.wait(0.02);
        }
        self.wait(0.3);
    }

    /// Ends the present incarnation of the file service; the next one begins a moment later.
    pub(crate) fn kill_files(&mut self) {
        self.ends[numbers::FILES.index()].store(1, Relaxed);
    }

    /// Has the file service busy for so long, s, when somebody opens this file next.
    pub(crate) fn stall(&self, path: &str, seconds: f64) {
        let path = path.to_owned();
        *self.stalled.lock().unwrap() = Some(Stalled { path, seconds });
    }

    /// Serves no terminal for a while, and then attaches anew, where the former host stopped.
    pub(crate) fn kill_terminals(&mut self) {
        self.reader = None;
        self.machine.work(150_000_000);
        self.next_ns = self.next_ns.max(self.machine.now());
    }

    /// Writes a motion of this name, as `condor up` compiles it from a text.
    pub(crate) fn writes(&self, name: &str, text: &str) {
        let texts = tempfile::tempdir().unwrap();
        std::fs::write(texts.path().join(format!("{name}.toml")), text).unwrap();
        compile_motions(texts.path(), &self.files.join("motions"), &hand()).unwrap();
    }

    /// What is in a file.
    pub(crate) fn file(&self, path: &str) -> Vec<u8> {
        std::fs::read(self.files.join(path)).unwrap()
    }

    /// Cuts a file, or deletes it.
    pub(crate) fn cut_file(&self, path: &str, len: Option<usize>) {
        let path = self.files.join(path);
        match len {
            None => std::fs::remove_file(path).unwrap(),
            Some(len) => {
                let file = std::fs::File::options().write(true).open(path).unwrap();
                file.set_len(len as u64).unwrap();
            }
        }
    }

    /// Processor, runs and skips of each loop.
    pub(crate) fn counts(&self) -> Vec<(u8, u64, u64)> {
        let mut all = Vec::new();
        for number in ALL {
            let region = self.region(number);
            let loops_there = table::all(&region).unwrap().map(Result::unwrap);
            for object in loops_there.filter(|object| object.kind == ObjectKind::Loop) {
                let (counts, _) = loops::read(&region, &object).unwrap().unwrap();
                all.push((number.0, counts.run, counts.skipped));
            }
        }
        all
    }
}
