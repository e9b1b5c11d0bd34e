//! The program of a servo processor, which controls whole fingers.
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
//! them were skipped the other would work with efforts or torques a period old.
//!
//! In each tick the loop reads every board once, publishes the [`Joints`](crate::grasp::Joints), steps the law of a
//! [grasp](crate::grasp) if there is one, and then the controllers of the fingers, in a gravity less
//! the acceleration that the table publishes; last it writes its board of outputs.
//!
//! | object | is |
//! |---|---|
//! | `console` | its terminal: faults, and what becomes of grasps |
//! | `servos` | [`ServoLayout`]: set-points and requests, vector [`SERVO`] |
//! | `servo` | the variables of its loop, joints and actuators, and its parameters: gains, limits, stops and filters, conditions of faults |
//! | `joints` | a published [`Joints`](crate::grasp::Joints) |
//! | `tracking-2` | a published [`Tracking`] |
//! | `felt`, `stops` | a published [`Felt`](crate::guards::Felt) and [`Stops`](crate::guards::Stops) |
//! | `grasp-2` | [`GraspLayout`] |
//! | `recording` | the ring of a recording |
//!
//! When it ends it leaves its board of outputs open: the watchdog of that takes the actuators to
//! rest more gently than closing it would.

use core::fmt::{self, Arguments};
use core::marker::PhantomData;
use core::time::Duration;

use condor_dev::InterruptEntry;
use condor_fs::OpenOptions;
use condor_hand::config::{Finger, ProcessorKind};
use condor_hand::controller::FingerController;
use condor_mbox::{AccessError, Allocator, MemoryWindow, Processor, Region};
use condor_mos::Latest;
use condor_rt::objects::ObjectKind;
use condor_rt::{
    Background, FILES, FilesOf, Machine, MailboxOf, PROCESSORS, Program, ProgramError, Setup,
    ShortText, users,
};

use crate::arguments::Record;
use crate::boards::{Boards, Wires};
use crate::desired::WANTED_NAME;
use crate::failure::Failure;
use crate::grasp::{JOINTS_NAME, NAME, Partner, PartnerState};
use crate::guards::{FELT_NAME, STOPS_NAME};
use crate::message::{GraspLayout, HandIdentity, SERVO, ServoLayout, ServoObject};
use crate::recording::{Head, Recorder, Ring, ServoRecordingError, Tape, TapeState};
use crate::{ACTUATORS, FINGERS, JOINTS, RobotDescription, start, table};

mod control;
mod feeling;
mod fingers;
mod gains;
mod news;
mod numbers;
mod tracking;
mod variables;

pub(crate) use control::{Control, Controllers, Servos};
use feeling::Feeling;
use fingers::Fingers;
use gains::Gains;
use news::LoopNews;
use numbers::ServoNumbers;
use tracking::Tracker;
pub use tracking::{Figures, Tracking, Worst};
use variables::Variables;

/// The name of the published [`Tracking`] in the object table of a servo processor. The number is the version of the
/// layout.
pub const TRACKING_NAME: &str = "tracking-2";

/// The name of the servo loop of a servo processor, by which tools such as `condor top` show it.
pub const LOOP: &str = "servo";

/// The program of a servo processor, which controls the torques and efforts of one to four fingers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Servo<B>(PhantomData<B>);

impl<B> Servo<B> {
    /// Makes the program.
    #[must_use]
    pub const fn new() -> Self {
        Self(PhantomData)
    }
}

impl<B: Boards> Program for Servo<B> {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let number = machine.number().0;
        let record = Record::of(machine)?;
        let (mut place, mut panel) = (None, None);
        let (hand, panel, mut wires) =
            start::configured(machine, &mut place, |background, hand| {
                let (bus, controller) = (machine.bus(), machine.interrupt_controller());
                let panel = &*panel.insert(B::panel(bus, controller, hand, number));
                Ok((hand, panel, start::wires::<M, B>(background, panel, hand)?))
            })?;
        serve(machine, hand, panel, &mut wires, record)
    }
}

/// Runs the loop, until the program is to end.
#[inline(never)]
fn serve<M: Machine>(
    machine: &M,
    hand: &RobotDescription,
    panel: &dyn InterruptEntry,
    wires: &mut dyn Wires,
    record: Option<Record<'_>>,
) -> Result<(), ProgramError> {
    let number = machine.number().0;
    let controllers = controllers(hand, number)?;
    let control = Control::new(hand, served(hand, number))?;
    let entries = fingers_on(hand, number);
    let rate_hz = rate_hz(hand, number);
    let period_s = 1.0 / f64::from(rate_hz);

    let mut setup = Setup::new(machine)?;
    setup.console()?;
    let own = setup.own().clone();
    let layout = setup.place("servos", ObjectKind::Other, |allocator| {
        ServoLayout::new(allocator, PROCESSORS as u8)
    })?;
    let gains = Gains::new(&entries);
    let numbers = ServoNumbers::new(hand, number, rate_hz);
    let mut servo_object = ServoObject::new();
    let mut names = [""; FINGERS];
    for (name, finger) in names.iter_mut().zip(&hand.fingers) {
        *name = finger.name.as_str();
    }
    let identity = HandIdentity::new(&hand.name, names, rate_hz);
    let (asked, servos) =
        servo_object.split(identity, &own, layout, machine.exclusion(), controllers)?;
    let variables = Variables::new(entries.clone());

    let partners = Partners::new(machine, hand, number)?;
    let grasp = setup.place(NAME, ObjectKind::Other, GraspLayout::new)?;
    let mut news_cell = Latest::new(LoopNews::NOTHING);
    let (writer, mut reader) = news_cell.split_mut();
    let clock = machine.doorbell();
    let ring = Ring::default();
    let recording = record.as_ref().map(|record| {
        let processor = number.into();
        let head = Head { processor, rate_hz };
        Recording::new(&mut setup, record.file, head, &own, &ring)
    });
    let recording = recording.transpose()?;
    let recorder = recording.as_ref().zip(record);
    let recorder = recorder.map(|(recording, record)| recording.recorder(record.ticks));
    let mut fingers = Fingers::<M> {
        control,
        servos,
        variables: &variables,
        gains: &gains,
        numbers: &numbers,
        tuned: (gains.version(), numbers.version()),
        wires,
        grasp: grasp.servo_end(own.clone())?,
        partners: &partners.servos,
        states: [PartnerState::NOTHING; FINGERS],
        palm: &partners.palm,
        accelerated: PartnerState::NOTHING,
        wanted: &partners.wanted,
        motion: PartnerState::NOTHING,
        joints: setup.publish_fields(JOINTS_NAME)?,
        tracker: Tracker::new(&hand.fingers, rate_hz),
        tracked: setup.publish_fields(TRACKING_NAME)?,
        feeling: Feeling::new(hand, rate_hz),
        felt: setup.publish_fields(FELT_NAME)?,
        stops: setup.publish_fields(STOPS_NAME)?,
        clock: &clock,
        last: None,
        ticks: 0,
        period_s,
        recorder,
        writer,
        news: LoopNews::NOTHING,
    };
    setup
        .interrupts(panel)
        .on(SERVO, "servos", &|call| asked.answer(call))
        .watch(&variables)
        .tune(&gains.laws)
        .tune(&gains.numbers)
        .tune(&gains.efforts)
        .fixed()
        .tune(&numbers.joints)
        .tune(&numbers.actuators)
        .tune(&numbers.thresholds)
        .tune(&numbers.counts)
        .servo(LOOP, start::rate(rate_hz), &mut |tick| {
            fingers.tick(tick.due);
        })
        .background(|background| {
            let say = |line: Arguments<'_>| background.print(format_args!("{line}\n"));
            let names = Names(hand, served(hand, number));
            say(format_args!("controls {names} at {rate_hz} Hz"));
            let mut before = LoopNews::NOTHING;
            attend(background, recording.as_ref(), || {
                partners.look()?;
                let news = *reader.read();
                news.tell(&before, hand, say);
                before = news;
                Ok(())
            })
        })
}

/// The background, until the program is to end: looks around, and writes what is recorded.
fn attend<M: Machine>(
    background: &Background<'_, M>,
    recording: Option<&Recording<'_, M::Window>>,
    mut look: impl FnMut() -> Result<(), ProgramError>,
) -> Result<(), ProgramError> {
    let files = recording.map(|_| background.files()).transpose()?;
    let begun = recording.zip(files.as_ref());
    let begun = begun.map(|(recording, files)| recording.begin::<M>(files));
    let mut tape = begun.transpose()?;
    start::attend(background, || {
        look()?;
        wind(background, recording, &mut tape, false);
        Ok(())
    })?;
    if tape.is_some() {
        // After this the loop records no more.
        background.set_enabled(LOOP, false)?;
        while background.statistics(LOOP)?.running > 0 {
            background.serve(Duration::from_millis(1))?;
        }
    }
    wind(background, recording, &mut tape, true);
    Ok(())
}

/// The values that other processors publish.
struct Partners<W> {
    /// The joints of the other servo processors.
    servos: heapless::Vec<Partner<W>, FINGERS>,
    /// The acceleration of the palm.
    palm: Partner<W>,
    /// The set-points of the master.
    wanted: Partner<W>,
}

impl<W: MemoryWindow + Clone> Partners<W> {
    /// Finds the partners of a processor; the processor itself stands for one that is not there.
    fn new<M: Machine<Window = W>>(
        machine: &M,
        hand: &RobotDescription,
        number: u8,
    ) -> Result<Self, ProgramError> {
        let one = |number, name| Ok::<_, ProgramError>(Partner::new(users(machine, number)?, name));
        let of_kind = |kind| Processor(number_of(hand, kind).unwrap_or(number));
        let mut servos = heapless::Vec::new();
        for other in others(hand, number) {
            // As many as there are fingers, at most.
            let _ = servos.push(one(other, JOINTS_NAME)?);
        }
        Ok(Self {
            servos,
            palm: one(of_kind(ProcessorKind::Table), table::PALM_NAME)?,
            wanted: one(of_kind(ProcessorKind::Master), WANTED_NAME)?,
        })
    }

    /// Looks where it is now.
    fn look(&self) -> Result<(), AccessError> {
        for servo in &self.servos {
            servo.look()?;
        }
        self.palm.look()?;
        self.wanted.look()
    }
}

/// The other processors of fingers.
fn others(hand: &RobotDescription, number: u8) -> heapless::Vec<Processor, FINGERS> {
    let mut others = heapless::Vec::new();
    for other in hand.fingers.iter().filter_map(Finger::processor) {
        if other != number && !others.contains(&Processor(other)) {
            // As many as there are fingers, at most.
            let _ = others.push(Processor(other));
        }
    }
    others
}

/// The first processor of a kind.
fn number_of(hand: &RobotDescription, kind: ProcessorKind) -> Option<u8> {
    let mut processors = hand.processors.iter();
    let found = processors.find(|processor| processor.kind == kind);
    found.map(|processor| processor.number)
}

/// The fingers that a processor serves, in their order.
type ServedFingers<'h> = heapless::Vec<&'h Finger<JOINTS, ACTUATORS>, FINGERS>;

/// The fingers of a processor.
fn fingers_on(hand: &RobotDescription, number: u8) -> ServedFingers<'_> {
    let mut served = ServedFingers::new();
    for (_, finger) in hand.fingers_on(number) {
        // As many as the hand has, at most.
        let _ = served.push(finger);
    }
    served
}

/// Which fingers of the hand a processor serves.
pub(crate) fn served(hand: &RobotDescription, number: u8) -> [bool; FINGERS] {
    let mut served = [false; FINGERS];
    for (finger, _) in hand.fingers_on(number) {
        if let Some(place) = served.get_mut(finger) {
            *place = true;
        }
    }
    served
}

/// Returns the rate of a processor's loop, Hz.
pub(crate) fn rate_hz(hand: &RobotDescription, number: u8) -> u32 {
    let processor = hand.processor(number);
    processor.map_or(hand.servo_hz, |processor| hand.rate_hz(processor))
}

/// The controllers of the fingers that a processor serves, of which there must be one.
#[allow(clippy::large_stack_arrays, reason = "nothing is allocated")]
pub(crate) fn controllers(hand: &RobotDescription, number: u8) -> Result<Controllers, Failure> {
    let mut controllers = [const { None }; FINGERS];
    for (finger, entry) in hand.fingers_on(number) {
        let failed = |error| Failure::Controller { finger, error };
        let transmission = entry.transmission().map_err(failed)?;
        let controller = FingerController::new(hand, entry, entry.chain(), transmission);
        let controller = controller.map_err(failed)?;
        if let Some(place) = controllers.get_mut(finger) {
            *place = Some(controller);
        }
    }
    if controllers.iter().all(Option::is_none) {
        return Err(Failure::NoFinger { processor: number });
    }
    Ok(controllers)
}

/// The names of some fingers, as people list them.
#[derive(Clone, Copy)]
pub(crate) struct Names<'h>(pub(crate) &'h RobotDescription, pub(crate) [bool; FINGERS]);

impl fmt::Display for Names<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(hand, named) = self;
        let fingers = hand.fingers.iter().zip(named);
        let mut fingers = fingers.filter_map(|(finger, named)| named.then_some(finger));
        let mut before = "";
        let mut next = fingers.next();
        while let Some(finger) = next {
            write!(f, "{before}{}", finger.name)?;
            next = fingers.next();
            let is_last = fingers.clone().next().is_none();
            before = if is_last { " and " } else { ", " };
        }
        Ok(())
    }
}

type ServoTape<'f, 'b, M> = Tape<'f, 'b, 'f, MailboxOf<'b, M>, <M as Machine>::Window, FILES>;

/// A recording that will be made: its file, and the place of its ring.
struct Recording<'r, W> {
    file: &'r str,
    head: Head,
    own: &'r Region<W>,
    offset: u32,
    ring: &'r Ring,
}

impl<'r, W: MemoryWindow + Clone> Recording<'r, W> {
    /// Makes room for the ring.
    fn new<M: Machine<Window = W>>(
        setup: &mut Setup<'_, M>,
        file: &'r str,
        head: Head,
        own: &'r Region<W>,
        ring: &'r Ring,
    ) -> Result<Self, ProgramError> {
        let bytes = Ring::BYTES as usize;
        let place = |allocator: &mut Allocator| allocator.bytes(bytes);
        let offset = setup
            .files()?
            .place("recording", ObjectKind::Other, place)?;
        Ok(Self {
            file,
            head,
            own,
            offset,
            ring,
        })
    }

    /// Returns the end of the ring in the loop, which records so many ticks.
    fn recorder(&self, ticks: u32) -> Recorder<'r, W> {
        Recorder::new(self.own.clone(), self.offset, self.ring, ticks)
    }

    /// Creates the file.
    fn begin<'f, 'b, M: Machine<Window = W>>(
        &self,
        files: &'f FilesOf<'b, M>,
    ) -> Result<ServoTape<'f, 'b, M>, Failure>
    where
        'r: 'f,
    {
        let options = OpenOptions::new().write().create().truncate();
        let file = files.open(self.file, options);
        let file = file.map_err(|error| self.failed(error.into()))?;
        Tape::new(file, self.head, self.own.clone(), self.offset, self.ring)
            .map_err(|error| self.failed(error))
    }

    fn failed(&self, error: ServoRecordingError) -> Failure {
        Failure::Recording {
            name: ShortText::of(&self.file),
            error,
        }
    }
}

/// Writes what has been recorded, and all there will be if that `is_last`; says when it is over.
fn wind<M: Machine>(
    background: &Background<'_, M>,
    recording: Option<&Recording<'_, M::Window>>,
    tape: &mut Option<ServoTape<'_, '_, M>>,
    is_last: bool,
) {
    let (Some(recording), Some(mut this)) = (recording, tape.take()) else {
        return;
    };
    let outcome = match this.wind() {
        Ok(TapeState::Running) if !is_last => {
            *tape = Some(this);
            return;
        }
        Ok(_) => this.finish(),
        Err(error) => Err(error),
    };
    let file = recording.file;
    match outcome {
        Ok(ticks) => background.print(format_args!("recorded {ticks} ticks in {file}\n")),
        Err(error) => background.print(format_args!("{}\n", recording.failed(error))),
    }
}
