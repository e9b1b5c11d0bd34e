//! The program of a servo processor: two fingers of four joints.
//!
//! Which fingers it serves, at which channels and at which rate, is what the configuration says for its
//! processor's number. With the argument `record=FILE` it writes a [recording](crate::recording) of what
//! its controllers are given, into a file of the file service, from its first tick until `ticks=COUNT` of
//! them, or until it ends. The loop puts it into a ring in the window, and the background from there into
//! the file. If that takes too long the recording is broken off, which the terminal says; the servos
//! go on.
//!
//! The memo has two servos for each joint, of tendon tension and of joint torque (section 4.2). Here
//! they are levels of one loop and not two loops of one rate: each needs what the other has just done,
//! from the same sample of the sensors. Two loops would run one right after the other at every
//! release, with a second release and a hand-over in shared memory in between, and whenever one of
//! them were skipped the other would work with tensions or torques a period old.
//!
//! In each tick the loop reads every board once, publishes the [`Joints`], steps the law of a
//! [grasp](crate::grasp) if there is one, and then the controllers of the fingers, in a gravity less
//! the acceleration that the table publishes; last it writes its board of outputs.
//!
//! | name in the directory | is |
//! |---|---|
//! | `console` | its terminal: faults, and what becomes of grasps |
//! | `loops` | the counts of its loop |
//! | `servos` | [`ServoPlaces`]: set-points and requests, vector [`SERVO`] |
//! | `monitor` | [`MonitorPlaces`]: blocks, then the ring; vector [`MONITOR`] |
//! | `joints` | a published [`Joints`] |
//! | `tracking` | a published [`Tracking`] |
//! | `grasp` | [`GraspPlaces`] |
//!
//! When it ends it leaves its board of outputs open: the watchdog of that takes the tensions to the
//! least ones more gently than closing it would.

use core::cell::OnceCell;

use condor_fs::{Area, FileSystem, OpenOptions};
use condor_hand::config::{Finger, ProcessorKind};
use condor_hand::controller::FingerController;
use condor_hand::kinematics::PlanarFinger;
use condor_hand::message::{
    BLOCK_BYTES, Identity, SERVO, ServoHandler, ServoLoop, ServoObject, ServoPlaces,
};
use condor_hand::monitor::{
    FingerVariables, MONITOR, Monitor, MonitorHandler, MonitorObject, MonitorPlaces, ring_bytes,
};
use condor_mbox::{Call, MemoryWindow, Places, Processor, Published, Region};
use condor_mos::{Latest, Rate};
use condor_rt::directory::{Directory, Kind};
use condor_rt::loops::LoopReports;
use condor_rt::{Error, Machine, MailboxOf, PROCESSORS, Program, Text, numbers};

use crate::failure::Failure;
use crate::grasp::{GraspEnd, GraspPlaces, Heard, JOINTS_NAME, Joints, NAME, Partner};
use crate::late::Late;
use crate::recording::{Head, Record, Recorder, RecordingError, Ring, Tape};
use crate::start::{self, Console, Ground, say};
use crate::{FINGERS, JOINTS, SERVED, UtahMit, boards, table};

mod control;
mod fingers;
mod news;
mod tracking;

pub(crate) use control::{Control, Controllers, Given, Servos};
use fingers::Fingers;
use news::News;
use tracking::Tracker;
pub use tracking::Tracking;

/// The name of the published [`Tracking`].
pub const TRACKING_NAME: &str = "tracking";

/// What there is to watch.
type Variables = FingerVariables<SERVED, JOINTS>;

/// Values of a row of the monitor, and rows.
const COLUMNS: u32 = 48;
const ROWS: u32 = 512;
pub(crate) const RING_BYTES: u32 = ring_bytes(Variables::COUNT as u32, COLUMNS, ROWS);
/// Bytes of a request to the monitor, with its response.
const MONITOR_BLOCK_BYTES: u32 = 128;

/// The program.
#[derive(Clone, Copy, Debug, Default)]
pub struct Servo;

/// Where the objects of the processor lie.
#[derive(Clone, Copy)]
struct Objects {
    servos: ServoPlaces<SERVED, JOINTS>,
    monitor: MonitorPlaces,
    joints: Published<Joints>,
    tracking: Published<Tracking>,
    grasp: GraspPlaces,
}

impl Objects {
    fn new<W: MemoryWindow>(
        places: &mut Places,
        directory: &mut Directory<W>,
    ) -> Result<Self, Error> {
        let objects = Self {
            servos: ServoPlaces::new(places, PROCESSORS as u8)?,
            monitor: MonitorPlaces::new(places, PROCESSORS as u8, RING_BYTES)?,
            joints: places.published()?,
            tracking: places.published()?,
            grasp: GraspPlaces::new(places)?,
        };
        // The first of the servos' objects are the set-points, and the blocks come right after them.
        let blocks = objects.servos.block(Processor(0)).unwrap_or(0);
        let points = SERVED as u32 * Published::<[[u32; 6]; JOINTS]>::BYTES;
        let servo_bytes = points + PROCESSORS as u32 * BLOCK_BYTES;
        let first = blocks.saturating_sub(points);
        directory.enter("servos", Kind::Servos, first, servo_bytes)?;
        let first = objects.monitor.block(Processor(0)).unwrap_or(0);
        let monitor_bytes = PROCESSORS as u32 * MONITOR_BLOCK_BYTES + RING_BYTES;
        directory.enter("monitor", Kind::Monitor, first, monitor_bytes)?;
        Ok(objects)
    }
}

impl Program for Servo {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error> {
        let Ground {
            own,
            mut places,
            mut directory,
            terminal,
            area,
        } = Ground::<M, 1>::new(machine)?;
        let reports = LoopReports::new(&own, &mut places, &mut directory, ["servo"])?;
        let objects = Objects::new(&mut places, &mut directory)?;
        let record = Record::of(machine)?;
        let ring = record.map(|_| places.bytes(Ring::BYTES as usize));
        let ring = ring.transpose()?;

        let mut servo_object = ServoObject::new();
        let mut monitor_object = MonitorObject::new();
        let (servo_end, monitor_end) = (OnceCell::new(), OnceCell::new());
        let (late_servo, late_monitor) = (Late::new(), Late::new());
        let typed = |call: &Call<'_>| terminal.receive(call);
        let open_files = area.handler();
        let asked = |call: &Call<'_>| late_servo.answer(call, ServoHandler::answer);
        let chosen = |call: &Call<'_>| late_monitor.answer(call, MonitorHandler::answer);
        let mut mailbox = start::mailbox(machine, &typed, &open_files)?;
        mailbox.set_vector(SERVO, &asked, "servos")?;
        mailbox.set_vector(MONITOR, &chosen, "monitor")?;
        mailbox.join()?;
        let mailbox = &mailbox;

        let outcome = start::configuration::<M, 1>(mailbox, &own, area).and_then(|hand| {
            let number = machine.number().0;
            let served = served(&hand, number)?;
            let controllers = controllers(&hand, served)?;
            let (answers, servos) = servo_object.split(
                Identity::new(&hand.name, names(&hand, served), rate_hz(&hand, number)),
                &own,
                objects.servos,
                machine.exclusion(),
                controllers,
            )?;
            late_servo.set(servo_end.get_or_init(|| answers));
            let variables = Variables::new(entries(&hand, served)?);
            let (answers, monitor) = monitor_object
                .split(
                    &own,
                    objects.monitor,
                    machine.exclusion(),
                    rate_hz(&hand, number),
                    variables.variables(),
                    COLUMNS,
                )
                .map_err(Failure::from)?;
            late_monitor.set(monitor_end.get_or_init(|| answers));
            let running = Running {
                machine,
                mailbox,
                own: &own,
                hand: &hand,
                number,
                served,
                objects,
                area,
                record: record.zip(ring),
            };
            running.serve(servos, monitor, &mut directory, reports, &terminal)
        });
        start::told::<M>(&terminal, mailbox, outcome)
    }
}

/// The fingers that a processor serves.
pub(crate) fn served(hand: &UtahMit, number: u8) -> Result<[usize; SERVED], Failure> {
    for finger in &hand.fingers {
        let processor = finger.processor().unwrap_or(number);
        let fingers = hand.fingers_on(processor).count();
        if fingers != SERVED {
            return Err(Failure::Fingers {
                processor,
                fingers,
                serves: SERVED,
            });
        }
    }
    let mut served = heapless::Vec::<_, SERVED>::new();
    for (finger, _) in hand.fingers_on(number) {
        // As many as it serves.
        let _ = served.push(finger);
    }
    served.into_array().map_err(|served| Failure::Fingers {
        processor: number,
        fingers: served.len(),
        serves: SERVED,
    })
}

/// How often the loop of a processor runs, Hz.
pub(crate) fn rate_hz(hand: &UtahMit, number: u8) -> u32 {
    let processor = hand.processor(number);
    processor.map_or(hand.servo_hz, |processor| hand.rate_hz(processor))
}

/// The parts of the configuration that are the fingers.
fn entries(hand: &UtahMit, [a, b]: [usize; SERVED]) -> Result<[&Finger<JOINTS>; SERVED], Failure> {
    match (hand.fingers.get(a), hand.fingers.get(b)) {
        (Some(a), Some(b)) => Ok([a, b]),
        _ => Err(Failure::Hand {
            fingers: hand.fingers.len(),
            simulated: FINGERS,
        }),
    }
}

fn names(hand: &UtahMit, served: [usize; SERVED]) -> [&str; SERVED] {
    served.map(|finger| hand.fingers.get(finger).map_or("", |finger| &finger.name))
}

#[allow(clippy::large_stack_arrays, reason = "nothing is allocated")]
pub(crate) fn controllers(hand: &UtahMit, served: [usize; SERVED]) -> Result<Controllers, Failure> {
    let controller = |finger: usize, entry: &Finger<JOINTS>| {
        let mechanism = entry.planar().ok_or(Failure::Form { finger })?;
        FingerController::new(hand, entry, mechanism)
            .map_err(|error| Failure::Controller { finger, error })
    };
    let ([a, b], [first, second]) = (served, entries(hand, served)?);
    Ok([controller(a, first)?, controller(b, second)?])
}

type Files<'r, 'v, M> = FileSystem<'r, MailboxOf<'v, M>, <M as Machine>::Window, 1>;
type ServoTape<'f, 'r, 'v, M> = Tape<'f, 'r, 'f, MailboxOf<'v, M>, <M as Machine>::Window, 1>;

/// What the servos of a processor run on.
struct Running<'r, 'v, M: Machine> {
    machine: &'r M,
    mailbox: &'r MailboxOf<'v, M>,
    own: &'r Region<M::Window>,
    hand: &'r UtahMit,
    number: u8,
    served: [usize; SERVED],
    objects: Objects,
    area: Area<1>,
    /// What is to be recorded, and where the ring for it lies.
    record: Option<(Record<'r>, u32)>,
}

impl<'r, 'v, M: Machine> Running<'r, 'v, M> {
    /// Opens the boards and runs the loop, until the program is to end.
    fn serve(
        &self,
        servos: ServoLoop<'_, PlanarFinger, M::Window, SERVED, JOINTS>,
        monitor: Monitor<'_, M::Window>,
        directory: &mut Directory<M::Window>,
        mut reports: LoopReports<M::Window, 1>,
        terminal: &Console<M>,
    ) -> Result<(), Error> {
        let (machine, hand, number) = (self.machine, self.hand, self.number);
        let others = hand.fingers.iter().filter_map(Finger::processor);
        let other = others.clone().find(|&other| other != number);
        let partner = Partner::new(start::users(machine, other.unwrap_or(number))?, JOINTS_NAME);
        let mut processors = hand.processors.iter();
        let table = processors.find(|processor| processor.kind == ProcessorKind::Table);
        let table = table.map_or(number, |processor| processor.number);
        let palm = Partner::new(start::users(machine, table)?, table::PALM_NAME);

        let grasp = GraspEnd::new(self.own.clone(), self.objects.grasp, &partner)?;
        let joints = self.objects.joints.publisher(self.own.clone())?;
        directory.enter(
            JOINTS_NAME,
            Kind::Other,
            self.objects.joints.offset(),
            Published::<Joints>::BYTES,
        )?;
        let tracked = self.objects.tracking.publisher(self.own.clone())?;
        let offset = self.objects.tracking.offset();
        let bytes = Published::<Tracking>::BYTES;
        directory.enter(TRACKING_NAME, Kind::Other, offset, bytes)?;
        let offset = self.objects.grasp.offset();
        directory.enter(NAME, Kind::Other, offset, GraspPlaces::BYTES)?;

        let panel = boards::open(machine.bus(), hand, number);
        let wires = start::wires(machine, self.mailbox, &panel, hand, number)?;
        let mut told = Latest::new(News::NOTHING);
        let (writer, mut reader) = told.split_mut();
        let clock = machine.doorbell();
        let rate = rate_hz(hand, number);
        let ring = Ring::default();
        let files = self.record.map(|_| self.files()).transpose()?;
        let mut tape = self.tape(files.as_ref(), &ring)?;
        let recorder = self
            .record
            .map(|(record, offset)| Recorder::new(self.own.clone(), offset, &ring, record.ticks));
        let mut fingers = Fingers::<M> {
            hand,
            control: Control::new(hand, number, self.served)?,
            servos,
            monitor,
            wires,
            grasp,
            palm: &palm,
            accelerated: Heard::NOTHING,
            joints,
            tracker: Tracker::new(entries(hand, self.served)?),
            tracked,
            clock: &clock,
            last: None,
            period_s: 1.0 / f64::from(rate),
            ticks: 0,
            recorder,
            writer,
            news: News::NOTHING,
        };
        let often = Rate::new(rate, 1).unwrap_or(Rate::hz(1));
        let body = || fingers.tick();
        let mut heard = News::NOTHING;
        let names = names(hand, self.served);
        partner.look()?;
        palm.look()?;
        let [first, second] = names;
        say::<M>(
            terminal,
            self.mailbox,
            format_args!("serves {first} and {second} at {rate} Hz"),
        );
        let outcome = start::with_loop(machine, often, body, |loops| {
            let look = || {
                partner.look()?;
                palm.look()?;
                let news = *reader.read();
                news.tell(&heard, names, |line| say::<M>(terminal, self.mailbox, line));
                heard = news;
                self.wind(&mut tape, terminal, false);
                Ok(())
            };
            start::attend(machine, self.mailbox, loops, &mut reports, look)
        });
        self.wind(&mut tape, terminal, true);
        outcome
    }

    fn files(&self) -> Result<Files<'r, 'v, M>, Failure> {
        let (own, timeout) = (self.own.clone(), start::FILES_TIMEOUT);
        FileSystem::connect(self.mailbox, numbers::FILES, own, self.area, timeout)
            .map_err(|error| self.unrecorded(error.into()))
    }

    /// The file of the recording, if there is to be one.
    fn tape<'f>(
        &self,
        files: Option<&'f Files<'r, 'v, M>>,
        ring: &'f Ring,
    ) -> Result<Option<ServoTape<'f, 'r, 'v, M>>, Failure> {
        let (Some(files), Some((record, offset))) = (files, self.record) else {
            return Ok(None);
        };
        let options = OpenOptions::new().write().create().truncate();
        let file = files.open(record.file, options);
        let file = file.map_err(|error| self.unrecorded(error.into()))?;
        let head = Head::new(self.number, rate_hz(self.hand, self.number));
        Tape::new(file.writer(), head, self.own.clone(), offset, ring)
            .map(Some)
            .map_err(|error| self.unrecorded(error))
    }

    fn unrecorded(&self, error: RecordingError) -> Failure {
        let name = self.record.map_or("", |(record, _)| record.file);
        Failure::Recording {
            name: Text::of(&name),
            error,
        }
    }

    /// Writes what has been recorded, and all there will be if that `is_last`; says when it is over.
    fn wind(
        &self,
        tape: &mut Option<ServoTape<'_, 'r, 'v, M>>,
        terminal: &Console<M>,
        is_last: bool,
    ) {
        let Some(mut this) = tape.take() else {
            return;
        };
        let outcome = match this.wind() {
            Ok(false) if !is_last => {
                *tape = Some(this);
                return;
            }
            Ok(_) => this.finish(),
            Err(error) => Err(error),
        };
        match outcome {
            Ok(ticks) => {
                let name = self.record.map_or("", |(record, _)| record.file);
                say::<M>(
                    terminal,
                    self.mailbox,
                    format_args!("recorded {ticks} ticks in {name}"),
                );
            }
            Err(error) => {
                let line = self.unrecorded(error);
                say::<M>(terminal, self.mailbox, format_args!("{line}"));
            }
        }
    }
}
