//! The system of the hand in virtual time, with a master that a test scripts.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use condor_dev::linux::{LinuxBus, MapAccess};
use condor_fs::server::{FileServer, ServerOptions};
use condor_hand::config::ControlProcessor;
use condor_hand::grasp::distributed::{GraspOrder, GraspReport};
use condor_hand::servo::ServoMode;
use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{
    Allocator, Call, Clock, Mailbox, MemoryWindow as _, Messenger, Processor, Region,
};
use condor_robot::message::{ServoClient, SetPoints};
use condor_robot::plant::{self, Plant, TrueState};
use condor_robot::servo::{Servo, Tracking};
use condor_robot::table::{self, Table};
use condor_robot::{FINGERS, IMAGE, JOINTS, RobotDescription, grasp, objects, packet, servo};
use condor_rt::objects::ObjectKind;
use condor_rt::sim::{Bell, SimCriticalSection, SimMachine as Simulated, VirtualSystem};
use condor_rt::{Machine, PROCESSORS, Program, loops, numbers};
use condor_tty::TerminalReader;
use condor_vars::{AnyValue, VARS, VariableClient};
use tempfile::TempDir;
use utah_mit_boards::robot::{Rack, address};
use zerocopy::IntoBytes;

use crate::ending::Ending;

pub(crate) const MASTER: Processor = Processor(0);
pub(crate) const FIRST: Processor = Processor(1);
pub(crate) const SECOND: Processor = Processor(2);
pub(crate) const TABLE: Processor = Processor(5);
pub(crate) const PLANT: Processor = Processor(6);

#[allow(clippy::cast_sign_loss, reason = "no time is negative")]
fn whole(number: f64) -> u64 {
    number.round() as u64
}

pub(crate) type Posture = [[f64; JOINTS]; FINGERS];

pub(crate) const WINDOW_BYTES: u32 = 1_048_576;
const TICK_NS: u64 = 20_000_000;
pub(crate) const SOON: Duration = Duration::from_secs(2);
const HAND: &str = include_str!("../../../../../condor-hand/hands/utah-mit.toml");

pub(crate) fn hand() -> RobotDescription {
    RobotDescription::from_toml(HAND, "utah-mit.toml").unwrap()
}

/// The processors of the fingers, as the configuration has them.
pub(crate) const TWO: Partition = [1, 1, 2, 2];

/// The processor of each finger.
pub(crate) type Partition = [u8; FINGERS];

/// The hand with its fingers on other processors.
pub(crate) fn hand_on(partition: Partition) -> RobotDescription {
    let mut hand = hand();
    let servo = hand.processors[1].clone();
    hand.processors
        .retain(|processor| processor.kind != servo.kind);
    for (finger, number) in hand.fingers.iter_mut().zip(partition) {
        for joint in &mut finger.joints {
            joint.processor = number;
        }
        if hand.processors.iter().all(|it| it.number != number) {
            let servo = servo.clone();
            hand.processors
                .push(ControlProcessor { number, ..servo })
                .unwrap();
        }
    }
    hand
}

/// What a run left behind.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Run {
    /// The true positions of the joints at each tick of the master.
    pub(crate) positions: Vec<u8>,
    /// The largest distance of a joint from where it was to be, rad.
    pub(crate) peak_rad: f64,
    /// Processor, runs and skips of each loop.
    pub(crate) counts: Vec<(u8, u64, u64)>,
    /// What the terminals of the processors show.
    pub(crate) said: Vec<String>,
}

type Post<'v> = Mailbox<'v, (LinuxWindow, Bell, SimCriticalSection), PROCESSORS>;

/// The small master.
pub(crate) struct Master<'m> {
    pub(crate) machine: &'m Simulated<LinuxBus>,
    mailbox: &'m Post<'m>,
    pub(crate) hand: RobotDescription,
    pub(crate) servos: Vec<Processor>,
    points: Vec<SetPoints<LinuxWindow, JOINTS>>,
    /// The motions of the joints from the next set-points on, and what stops them.
    pub(crate) guards: [[StopGuard; JOINTS]; FINGERS],
    wanted: Posture,
    next_ns: u64,
    run: Run,
}

/// Runs the system with a script for its master; on `ending` the program ends at an instant, s.
pub(crate) fn run(
    seconds: f64,
    ending: Option<(Processor, f64)>,
    script: impl FnOnce(&mut Master<'_>) + Send,
) -> Run {
    run_with(TWO, seconds, ending, script)
}

/// The same with another partition.
pub(crate) fn run_with(
    partition: Partition,
    seconds: f64,
    ending: Option<(Processor, f64)>,
    script: impl FnOnce(&mut Master<'_>) + Send,
) -> Run {
    let files = files_for(partition);
    run_on(files.path(), partition, &[], None, seconds, ending, script)
}

/// A directory with the files that programs need.
pub(crate) fn files() -> TempDir {
    files_for(TWO)
}

fn files_for(partition: Partition) -> TempDir {
    let files = tempfile::tempdir().unwrap();
    let mut image = vec![0; 16384];
    let len = hand_on(partition).to_image(&mut image).unwrap();
    std::fs::write(files.path().join(IMAGE), &image[..len]).unwrap();
    files
}

/// The same with a directory of files, arguments of the first servo processor, and a time in which
/// nobody serves files, s.
pub(crate) fn run_on(
    files: &Path,
    partition: Partition,
    arguments: &[&str],
    away: Option<(f64, f64)>,
    seconds: f64,
    ending: Option<(Processor, f64)>,
    script: impl FnOnce(&mut Master<'_>) + Send,
) -> Run {
    let memory = tempfile::tempfile().unwrap();
    memory.set_len(address::BUS_BYTES as u64).unwrap();
    let bus = LinuxBus::map(&memory, 0, 0, address::BUS_BYTES, MapAccess::ReadWrite).unwrap();
    let server = FileServer::new(files, ServerOptions::default()).unwrap();
    let found = Mutex::new(Run::default());

    let mut system = VirtualSystem::with_bus(WINDOW_BYTES, bus).unwrap();
    system
        .host(numbers::FILES, |machine| {
            if let Some((from_s, to_s)) = away {
                serve_files(machine, &server, whole(from_s * 1e9))?;
                machine.work(whole((to_s - from_s) * 1e9));
            }
            serve_files(machine, &server, u64::MAX)
        })
        .unwrap();
    system.arguments(FIRST, arguments.iter().copied()).unwrap();
    let ends_at = |number: Processor| match ending {
        Some((ending, at_s)) if ending == number => whole(at_s * 1e9),
        _ => u64::MAX,
    };
    for number in servos(partition) {
        let at_ns = ends_at(number);
        system
            .host(number, move |machine| {
                let end = &AtomicU64::new(at_ns);
                Servo::<Rack>::new().run(&Ending { machine, end })
            })
            .unwrap();
    }
    let (table, plant) = (Table::<Rack>::new(), Plant::<Rack>::new());
    system.spawn(TABLE, &table).unwrap();
    system.spawn(PLANT, &plant).unwrap();
    system
        .host(MASTER, |machine| {
            let mut mailbox = Post::new(
                MASTER,
                machine.windows(),
                machine.doorbell(),
                machine.exclusion(),
            )?;
            mailbox.set_waiting(machine.waiting());
            mailbox.join()?;
            let mut master = Master {
                machine,
                mailbox: &mailbox,
                hand: hand_on(partition),
                servos: servos(partition),
                points: Vec::new(),
                guards: [[StopGuard::NONE; JOINTS]; FINGERS],
                wanted: [[f64::NAN; JOINTS]; FINGERS],
                next_ns: TICK_NS,
                run: Run::default(),
            };
            script(&mut master);
            master.count();
            *found.lock().unwrap() = master.run;
            Ok::<_, condor_mbox::MailboxError>(())
        })
        .unwrap();
    system.run_until(whole(seconds * 1e9)).unwrap();
    found.into_inner().unwrap()
}

/// The processors of a partition.
fn servos(partition: Partition) -> Vec<Processor> {
    let mut servos = partition.map(Processor).to_vec();
    servos.sort_unstable();
    servos.dedup();
    servos
}

/// Serves files until an instant.
pub(crate) fn serve_files(
    machine: &impl Machine<Window = LinuxWindow>,
    server: &FileServer,
    until_ns: u64,
) -> Result<(), condor_mbox::MailboxError> {
    let windows = machine.windows();
    let handler = |call: &Call<'_>| server.answer(call, &windows);
    let mut mailbox = Mailbox::<(_, _, _), PROCESSORS>::new(
        numbers::FILES,
        windows.clone(),
        machine.doorbell(),
        machine.exclusion(),
    )?;
    mailbox.set_waiting(machine.waiting());
    mailbox.set_vector(condor_fs::wire::FILES, &handler, "files")?;
    mailbox.join()?;
    let clock = machine.doorbell();
    while !machine.is_stopping() && clock.now().as_ns() < until_ns {
        mailbox.serve(Duration::from_millis(20))?;
    }
    Ok(())
}

impl Master<'_> {
    pub(crate) fn region(&self, number: Processor) -> Region<LinuxWindow> {
        let data = self.machine.windows()[number.index()].data.clone();
        Region::users(data).unwrap()
    }

    /// Waits for the next tick of 50 Hz.
    pub(crate) fn tick(&mut self) {
        while self.machine.now() < self.next_ns {
            let left = Duration::from_nanos(self.next_ns - self.machine.now());
            self.mailbox.serve(left).unwrap();
        }
        self.next_ns += TICK_NS;
        if let Some(truth) = self.truth() {
            self.run.positions.extend(truth.position.as_bytes());
            for (is, wanted) in truth
                .position
                .iter()
                .flatten()
                .zip(self.wanted.iter().flatten())
            {
                // What is not controlled is wanted nowhere.
                self.run.peak_rad = self.run.peak_rad.max((is - wanted).abs());
            }
        }
    }

    pub(crate) fn wait(&mut self, seconds: f64) {
        for _ in 0..whole(seconds * 50.0) {
            self.tick();
        }
    }

    pub(crate) fn truth(&self) -> Option<TrueState> {
        let region = self.region(PLANT);
        let cell = objects::truth(&region).unwrap()?;
        Some(cell.subscriber(&region).unwrap().read().ok()?.value)
    }

    /// Until everybody serves.
    pub(crate) fn wait_for_all(&mut self) {
        for number in self.servos.clone() {
            while objects::joints(&self.region(number)).unwrap().is_none() {
                self.tick();
            }
        }
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            let region = self.region(Processor(entry.processor().unwrap()));
            let layout = objects::servos(&region).unwrap().unwrap();
            self.points
                .push(layout.set_points(finger, &region).unwrap());
        }
        self.wait(0.28);
    }

    pub(crate) fn client<R>(
        &self,
        number: Processor,
        ask: impl FnOnce(&mut ServoClient<'_, Post<'_>, LinuxWindow, FINGERS, JOINTS>) -> R,
    ) -> R {
        let region = self.region(number);
        let layout = objects::servos(&region).unwrap().unwrap();
        let mut client = ServoClient::new(self.mailbox, number, &region, layout).unwrap();
        ask(&mut client)
    }

    /// Sets a parameter of a servo loop.
    pub(crate) fn set(&self, number: Processor, name: &str, value: AnyValue) {
        let region = self.region(number);
        let object = condor_rt::objects::find(&region, servo::LOOP, ObjectKind::Variables);
        let table =
            condor_vars::VariableTable::open(&region, object.unwrap().unwrap().offset).unwrap();
        let own = self.region(MASTER);
        let mut allocator = Allocator::new(own.size());
        let mut client =
            VariableClient::new(self.mailbox, own, &mut allocator, number, VARS).unwrap();
        let entry = table.find(name).unwrap().unwrap();
        let former = client.get(&table, &entry, SOON).unwrap();
        client.set(&table, &entry, former, value, SOON).unwrap();
    }

    /// Switches all joints on where they are.
    pub(crate) fn enable(&self) {
        for (finger, entry) in (0..).zip(&self.hand.fingers) {
            let number = Processor(entry.processor().unwrap());
            self.client(number, |client| {
                client
                    .enable(finger, None, ServoMode::Position, SOON)
                    .unwrap();
            });
        }
    }

    /// The joints as they are.
    pub(crate) fn present(&self) -> Posture {
        self.truth().unwrap().position
    }

    /// Has the joints follow `posture`, a function of the part of `seconds` that has passed.
    pub(crate) fn follow(&mut self, seconds: f64, posture: impl Fn(f64) -> Posture) {
        let ticks = whole(seconds * 50.0) as u32;
        let at = |tick: f64| posture((tick / f64::from(ticks)).clamp(0.0, 1.0));
        for tick in 1..=ticks {
            self.tick();
            let tick = f64::from(tick);
            let (before, now, after) = (at(tick - 0.5), at(tick), at(tick + 0.5));
            for (finger, points) in self.points.iter_mut().enumerate() {
                let point = |joint: usize| SetPoint {
                    position: now[finger][joint],
                    velocity: (after[finger][joint] - before[finger][joint]) * 50.0,
                    acceleration: 0.0,
                };
                points
                    .publish(&std::array::from_fn(point), &self.guards[finger])
                    .unwrap();
            }
            self.wanted = now;
        }
    }

    /// Goes to a posture within some seconds by a quintic, from where it was to be.
    pub(crate) fn go(&mut self, seconds: f64, to: Posture) {
        let from = self.wanted;
        self.follow(seconds, |s| {
            let part = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
            let mut posture = from;
            for (at, to) in posture.iter_mut().flatten().zip(to.iter().flatten()) {
                *at += (to - *at) * part;
            }
            posture
        });
    }

    /// Stays where everything was to be.
    pub(crate) fn stay(&mut self, seconds: f64) {
        let wanted = self.wanted;
        self.follow(seconds, |_| wanted);
    }

    /// Holds the present posture.
    pub(crate) fn hold(&mut self, seconds: f64) {
        let present = self.present();
        self.follow(seconds, |_| present);
    }

    /// Whatever was, only what comes counts.
    pub(crate) fn reset_peak(&mut self) {
        self.run.peak_rad = 0.0;
    }

    /// The largest distance of a joint from where it was to be, rad.
    pub(crate) fn peak_rad(&self) -> f64 {
        self.run.peak_rad
    }

    /// No joint is wanted anywhere from now on.
    pub(crate) fn forget(&mut self) {
        self.wanted = [[f64::NAN; JOINTS]; FINGERS];
    }

    pub(crate) fn ask_plant(&self, request: &plant::PlantRequest) -> plant::PlantResponse {
        let region = self.region(PLANT);
        let blocks = objects::plant(&region).unwrap().unwrap();
        let mut exchange = blocks.client(self.mailbox, &region).unwrap();
        packet::ask(&mut exchange, PLANT, plant::PLANT, request, SOON).unwrap()
    }

    pub(crate) fn ask_table(&self, request: &table::TableRequest) -> table::TableResponse {
        let region = self.region(TABLE);
        let blocks = objects::table(&region).unwrap().unwrap();
        let mut exchange = blocks.client(self.mailbox, &region).unwrap();
        packet::ask(&mut exchange, TABLE, table::TABLE, request, SOON).unwrap()
    }

    /// The same order to all servo processors.
    pub(crate) fn grasp(&self, order: &GraspOrder) {
        for &number in &self.servos {
            let region = self.region(number);
            let layout = objects::grasp(&region).unwrap().unwrap();
            layout.give(order, &region).unwrap();
        }
    }

    pub(crate) fn report(&self, number: Processor) -> GraspReport {
        let region = self.region(number);
        let layout = objects::grasp(&region).unwrap().unwrap();
        layout.report(&region).unwrap()
    }

    /// How well the joints follow, as their servos find.
    pub(crate) fn tracking(&self, number: Processor) -> Tracking {
        let region = self.region(number);
        let cell = objects::tracking(&region).unwrap().unwrap();
        cell.subscriber(&region).unwrap().read().unwrap().value
    }

    /// The tips as the servos measure them.
    pub(crate) fn tips(&self) -> [[f64; 3]; FINGERS] {
        let joints = grasp::joints(&self.hand, |number| {
            let region = self.region(Processor(number));
            let cell = objects::joints(&region).unwrap()?;
            Some(cell.subscriber(&region).unwrap().read().ok()?.value)
        });
        grasp::tips(&self.hand, &joints.unwrap())
    }

    fn count(&mut self) {
        for number in self.servos.iter().copied().chain([TABLE, PLANT]) {
            let region = self.region(number);
            for object in condor_rt::objects::all(&region)
                .unwrap()
                .map(Result::unwrap)
            {
                if object.kind == ObjectKind::Loop
                    && let Some((counts, _)) = loops::read(&region, &object).unwrap()
                {
                    let counts = (number.0, counts.run, counts.skipped);
                    self.run.counts.push(counts);
                }
            }
            let said = console(&self.region(number));
            self.run.said.push(said);
        }
    }
}

/// What the terminal of a processor shows.
pub(crate) fn console(region: &Region<LinuxWindow>) -> String {
    let Some(entry) = condor_rt::objects::find(region, "console", ObjectKind::Terminal).unwrap()
    else {
        return String::new();
    };
    let mut reader =
        TerminalReader::attach(region.clone(), entry.offset, numbers::TERMINALS).unwrap();
    let mut bytes = [0; 8192];
    let mut text = String::new();
    loop {
        let fetched = reader.fetch(&mut bytes).unwrap();
        if fetched.len == 0 {
            return text;
        }
        text += &String::from_utf8_lossy(&bytes[..fetched.len]);
        reader.acknowledge(fetched.len).unwrap();
    }
}
