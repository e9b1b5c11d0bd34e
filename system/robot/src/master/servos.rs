//! [`Servos`]: the servo processors as the master's background has them.

use core::fmt::Arguments;
use core::time::Duration;

use condor_hand::config::Finger;
use condor_hand::fault::Fault;
use condor_hand::servo::{JointTarget, ServoMode, ServoRefusal};
use condor_hand::trajectory::{Begin, MotionError, Pace, Profile, Target};
use condor_mbox::{Clock as _, PeerState, Processor, Region};
use condor_rt::objects::{self as names, ObjectKind};
use condor_rt::{Background, Machine, ProgramError, ShortText, users};
use condor_vars::VariableTable;

use super::drive::{FingerServos, Link, Motion, OfServos, ServoIncarnation, SharedDrive, with};
use super::words::Problem;
use crate::failure::Failure;
use crate::joints::JointNumbers;
use crate::message::{ServoClient, ServoStatus};
use crate::packet::ClientError;
use crate::servo::{self, Names};
use crate::{ACTUATORS, FINGERS, JOINTS, RobotDescription, objects};

/// The time in which a servo must answer.
pub(super) const ANSWER: Duration = Duration::from_millis(500);
/// The time in which a finger must come to rest.
const REST: Duration = Duration::from_secs(3);
/// The distance, rad, by which joints leave the zones of their stops, and the fraction of their limits of
/// velocity.
const ROOM_RAD: f64 = 0.02;
const LEAVE_SPEED: f64 = 0.02;
const NAP: Duration = Duration::from_millis(20);
type Client<'r, M> =
    ServoClient<'r, condor_rt::MailboxOf<'r, M>, <M as Machine>::Window, FINGERS, JOINTS>;

/// One servo processor.
struct Servo<'r, M: Machine> {
    number: u8,
    region: Region<M::Window>,
    mail: M::Window,
    /// The incarnation whose objects these are; the client asks that one only.
    incarnation: Option<u32>,
    /// Whether it has ever been there.
    is_known: bool,
    client: Option<Client<'r, M>>,
}

/// The servo processors.
pub(super) struct Servos<'r, 'p, M: Machine> {
    hand: &'r RobotDescription,
    background: &'r Background<'r, M>,
    shared: &'r SharedDrive<'p, M::Window>,
    servo_indices: FingerServos,
    processors: OfServos<Servo<'r, M>>,
    /// The last status of each finger.
    status: [Option<ServoStatus<JOINTS>>; FINGERS],
    /// The fault of each finger that was told last.
    told: [Option<Fault>; FINGERS],
    /// Whether a finger that followed does not any more, since somebody asked.
    has_lost: bool,
    /// A bit for each finger that may still follow a former incarnation of the master. Nobody knows its set-points: it
    /// gets none, and so comes to a fault.
    inherited: u32,
    numbers: JointNumbers,
}

/// The numbers of the servo processors, and which of them serves each finger.
pub(super) fn servo_indices(hand: &RobotDescription) -> (OfServos<u8>, FingerServos) {
    let mut numbers = OfServos::<u8>::new();
    // Nobody serves a finger that the robot does not have.
    let mut servo_indices = [usize::MAX; FINGERS];
    for (servo, entry) in servo_indices.iter_mut().zip(&hand.fingers) {
        // A configuration has all joints of a finger on one processor.
        let processor = entry.processor().unwrap_or(0);
        let known = numbers.iter().position(|&it| it == processor);
        *servo = known.unwrap_or(numbers.len());
        if known.is_none() {
            // At most one for each finger.
            let _ = numbers.push(processor);
        }
    }
    (numbers, servo_indices)
}

impl<'r, 'p, M: Machine> Servos<'r, 'p, M> {
    pub(super) fn new(
        background: &'r Background<'r, M>,
        hand: &'r RobotDescription,
        shared: &'r SharedDrive<'p, M::Window>,
        numbers: &[u8],
        servo_indices: FingerServos,
    ) -> Result<Self, ProgramError> {
        let mut processors = OfServos::new();
        for &number in numbers {
            let machine = background.machine();
            let windows = machine.windows().into_iter().nth(number.into());
            let windows = windows.ok_or(Failure::NoProcessor { processor: number })?;
            let servo = Servo {
                number,
                region: users(machine, Processor(number))?,
                mail: windows.mail,
                incarnation: None,
                is_known: false,
                client: None,
            };
            // At most one for each finger.
            let _ = processors.push(servo);
        }
        Ok(Self {
            hand,
            background,
            shared,
            servo_indices,
            processors,
            status: [const { None }; FINGERS],
            told: [None; FINGERS],
            has_lost: false,
            inherited: u32::MAX,
            numbers: JointNumbers::of(hand),
        })
    }

    /// The number and the region of each.
    pub(super) fn regions(&self) -> impl Iterator<Item = (u8, &Region<M::Window>)> {
        self.processors
            .iter()
            .map(|servo| (servo.number, &servo.region))
    }

    /// Returns the last status of a finger.
    pub(super) fn status(&self, finger: usize) -> Option<&ServoStatus<JOINTS>> {
        self.status.get(finger)?.as_ref()
    }

    /// The processor of a finger.
    pub(super) fn processor(&self, finger: usize) -> u8 {
        let servo = self.servo_indices.get(finger).copied();
        let servo = servo.and_then(|servo| self.processors.get(servo));
        servo.map_or(0, |servo| servo.number)
    }

    /// A bit for each finger of a processor.
    pub(super) fn fingers(&self, number: u8) -> u64 {
        let mut fingers = 0;
        for finger in (0..FINGERS).filter(|&finger| self.processor(finger) == number) {
            fingers |= 1 << finger;
        }
        fingers
    }

    /// Returns true if a finger follows its set-points.
    pub(super) fn follows(&self, finger: usize) -> bool {
        let status = self.status(finger);
        self.inherited >> finger & 1 == 0 && status.is_some_and(follows)
    }

    /// Looks how all are.
    pub(super) fn watch(&mut self, mut say: impl FnMut(Arguments<'_>)) -> Result<(), ProgramError> {
        for index in 0..self.processors.len() {
            self.watch_one(index, &mut say)?;
        }
        Ok(())
    }

    /// Returns true if a finger that followed does not any more, since the flag was taken last.
    pub(super) const fn has_lost(&self) -> bool {
        self.has_lost
    }

    /// Takes the flag of [`has_lost`](Self::has_lost), which is false then.
    pub(super) fn take_lost(&mut self) -> bool {
        core::mem::take(&mut self.has_lost)
    }

    fn watch_one(
        &mut self,
        index: usize,
        say: &mut impl FnMut(Arguments<'_>),
    ) -> Result<(), ProgramError> {
        let Some(servo) = self.processors.get_mut(index) else {
            return Ok(());
        };
        let state = self
            .background
            .mailbox()
            .peer_state(Processor(servo.number))?;
        let incarnation = match state {
            PeerState::Up {
                incarnation,
                connected: true,
            } => Some(incarnation),
            _ => None,
        };
        let served = self.servo_indices.map(|servo| servo == index);
        let names = Names(self.hand, served);
        if servo.incarnation.is_some() && servo.incarnation != incarnation {
            (servo.incarnation, servo.client) = (None, None);
            for (status, _) in self.status.iter_mut().zip(served).filter(|(_, it)| *it) {
                let former = status.take();
                self.has_lost |= former.is_some_and(|it| follows(&it));
            }
            with(self.shared, |drive| {
                if let Some(link) = drive.links.get_mut(index) {
                    *link = None;
                }
            });
            let number = servo.number;
            say(format_args!(
                "processor {number} is gone: nothing controls {names}"
            ));
        }
        if let (None, Some(incarnation)) = (servo.incarnation, incarnation)
            && let Some(layout) = objects::servos(&servo.region)?
            && objects::joints(&servo.region)?.is_some()
            && objects::grasp(&servo.region)?.is_some()
        {
            let seen =
                ServoIncarnation::new(servo.mail.clone(), servo.region.clone(), incarnation)?;
            let link = Link::new(seen, &layout)?;
            with(self.shared, |drive| {
                if let Some(place) = drive.links.get_mut(index) {
                    *place = Some(link);
                }
            });
            servo.client = Some(ServoClient::new(
                self.background.mailbox(),
                Processor(servo.number),
                &servo.region,
                layout,
            )?);
            servo.incarnation = Some(incarnation);
            let number = servo.number;
            if servo.is_known {
                say(format_args!(
                    "processor {number} was restarted: `enable` makes {names} hold again"
                ));
            } else {
                say(format_args!("processor {number} controls {names}"));
            }
            servo.is_known = true;
        }
        if servo.incarnation.is_some() {
            for finger in (0..FINGERS).filter(|&finger| served.get(finger) == Some(&true)) {
                self.look(finger, index, say);
            }
        }
        self.tell_loop();
        Ok(())
    }

    /// Asks how a finger is, and says what is new.
    fn look(&mut self, finger: usize, index: usize, say: &mut impl FnMut(Arguments<'_>)) {
        let name = name(self.hand, finger);
        let Some(servo) = self.processors.get_mut(index) else {
            return;
        };
        let (Some(client), Some(kept)) = (&mut servo.client, self.status.get_mut(finger)) else {
            return;
        };
        // One that does not answer now is asked again, unless it is gone.
        let Ok(status) = client.status(finger as u32, ANSWER) else {
            return;
        };
        // The next incarnation may have answered; the next look finds it.
        let state = self
            .background
            .mailbox()
            .peer_state(Processor(servo.number));
        if !matches!(state, Ok(PeerState::Up { incarnation, .. }) if Some(incarnation) == servo.incarnation)
        {
            return;
        }
        self.has_lost |= kept.as_ref().is_some_and(follows) && !follows(&status);
        let holds = |it: &ServoStatus<JOINTS>| it.modes.contains(&ServoMode::Grasp);
        if kept.as_ref().is_some_and(holds) && !holds(&status) && status.fault.is_none() {
            say(format_args!(
                "{name} has left the grasp, and holds its position"
            ));
        }
        let refused = kept.as_ref().unwrap_or(&status).refused_set_points;
        if let Some(told) = self.told.get_mut(finger)
            && core::mem::replace(told, status.fault) != status.fault
            && let Some((entry, fault)) = self.hand.fingers.get(finger).zip(status.fault)
        {
            tell_fault(entry, fault, &mut *say);
        }
        if status.refused_set_points != refused {
            let count = status.refused_set_points.wrapping_sub(refused);
            say(format_args!(
                "{name} refused set-points {count} times, because a number in them was not finite or too far away"
            ));
        }
        *kept = Some(status);
    }

    /// Tells the loop of the trajectories which fingers and joints follow.
    fn tell_loop(&mut self) {
        let (mut loose, mut adrift) = (u32::MAX, u32::MAX);
        for finger in 0..FINGERS {
            if self.status(finger).is_some_and(|it| !needs_set_points(it)) {
                self.inherited &= !(1 << finger);
            }
            if self.follows(finger) {
                loose &= !(1 << finger);
            }
            let Some(status) = self.status(finger).filter(|it| works(it)) else {
                continue;
            };
            for (number, mode) in self.numbers.range(finger).zip(&status.modes) {
                if *mode == ServoMode::Position {
                    adrift &= !(1 << number);
                }
            }
        }
        with(self.shared, |drive| {
            (drive.loose, drive.adrift, drive.inherited) = (loose, adrift, self.inherited);
        });
    }

    /// Asks the servos of a finger something: the client is given, and the finger.
    pub(super) fn ask<R>(
        &mut self,
        finger: usize,
        question: impl FnOnce(&mut Client<'r, M>, u32, Duration) -> R,
    ) -> Result<R, Problem<'static>> {
        let number = self.processor(finger);
        let absent = Problem::Absent(number);
        let state = self.background.mailbox().peer_state(Processor(number))?;
        let servo = self.servo_indices.get(finger).copied();
        let Some(servo) = servo.and_then(|servo| self.processors.get_mut(servo)) else {
            return Err(absent);
        };
        match (state, servo.incarnation, &mut servo.client) {
            (PeerState::Up { incarnation, .. }, Some(seen), Some(client))
                if incarnation == seen =>
            {
                Ok(question(client, finger as u32, ANSWER))
            }
            _ => Err(absent),
        }
    }

    /// Finds the variables and parameters of the loop that serves a finger.
    pub(super) fn table(
        &mut self,
        finger: usize,
    ) -> Result<(Processor, VariableTable<M::Window>), Problem<'static>> {
        // The program is there that was seen.
        self.ask(finger, |_, _, _| ())?;
        let number = self.processor(finger);
        let absent = || Problem::Absent(number);
        let servo = self.servo_indices.get(finger).copied();
        let known = servo.and_then(|servo| self.processors.get(servo));
        let known = known.ok_or_else(absent)?;
        let object =
            names::find(&known.region, servo::LOOP, ObjectKind::Variables)?.ok_or_else(absent)?;
        Ok((
            Processor(number),
            VariableTable::open(&known.region, object.offset)?,
        ))
    }

    pub(super) fn refresh(
        &mut self,
        finger: usize,
    ) -> Result<ServoStatus<JOINTS>, Problem<'static>> {
        let status = self.ask(finger, |client, finger, timeout| {
            client.status(finger, timeout)
        })??;
        if let Some(kept) = self.status.get_mut(finger) {
            self.has_lost |= kept.as_ref().is_some_and(follows) && !follows(&status);
            *kept = Some(status.clone());
        }
        Ok(status)
    }

    /// Restarts a finger if it has a fault, and has it follow from where it is.
    pub(super) fn enable(&mut self, finger: usize) -> Result<(), Problem<'static>> {
        let named = || self.hand.fingers.get(finger).map(|it| it.name.clone());
        let name = named().unwrap_or_default();
        let mut status = self.refresh(finger)?;
        if status.modes.contains(&ServoMode::Grasp) {
            return Err(Problem::InGrasp(name));
        }
        self.tell_loop();
        if self.inherited >> finger & 1 == 1 {
            self.disable(finger)?;
            status = self.refresh(finger)?;
        }
        if follows(&status) {
            return Ok(());
        }
        if status.fault.is_some() || status.is_resting {
            self.ask(finger, |client, finger, timeout| {
                client.restart(finger, timeout)
            })??;
            let clock = self.background.machine().doorbell();
            let deadline = clock.now().after(REST);
            status = self.refresh(finger)?;
            while status.is_resting && clock.now() < deadline {
                self.background.serve(NAP)?;
                status = self.refresh(finger)?;
            }
            if let Some(fault) = status.fault {
                let entry = self.hand.fingers.get(finger);
                let text = entry.map_or(ShortText::of(""), |it| ShortText::of(&fault.of(it)));
                return Err(Problem::Fault {
                    finger: name,
                    fault: text,
                    code: fault.code,
                });
            }
            if status.is_resting {
                return Err(Problem::Resting(name));
            }
        }
        let is_measured = with(self.shared, |drive| {
            let measured = drive.measured.get(finger).copied().flatten();
            if measured.is_some() {
                // A finger that had a fault a moment ago may still be in motion here.
                drive.loose |= 1 << finger;
                drive.hold_loose();
                // From here on the set-points stay where the finger was just measured.
                drive.loose &= !(1 << finger);
                drive.adrift &= !self.numbers.mask(finger);
            }
            measured.is_some()
        });
        if is_measured != Some(true) {
            return Err(Problem::NotMeasured(name));
        }
        let outcome = self.ask(finger, |client, finger, timeout| {
            client.enable(finger, None, ServoMode::Position, timeout)
        });
        let refreshed = self.refresh(finger);
        self.tell_loop();
        outcome??;
        refreshed?;
        self.leave_stops(finger)
    }

    /// Has the joints of a finger that are where the servos push them from their stops come out of
    /// there: a position that is held against such a push makes a joint tremble.
    fn leave_stops(&self, finger: usize) -> Result<(), Problem<'static>> {
        let first = self.numbers.number(finger, 0);
        let Some(entry) = self.hand.fingers.get(finger) else {
            return Ok(());
        };
        let moved = with(self.shared, |drive| {
            let points = drive.generator.set_points();
            let mut motion = Motion::new(Pace::Speed(LEAVE_SPEED), Profile::MinimumJerk);
            for (joint, (entry, point)) in entry
                .joints
                .iter()
                .zip(points.iter().skip(first))
                .enumerate()
            {
                let room = entry.stop.zone + ROOM_RAD;
                let (low, high) = (entry.limits.low + room, entry.limits.high - room);
                if low < high && !(low <= point.position && point.position <= high) {
                    let to = if point.position < low { low } else { high };
                    motion = motion.with(first + joint, Target::Absolute(to))?;
                }
            }
            if motion.mask != 0 {
                motion.begin = Begin::Beside;
                drive.generator.enqueue(motion)?;
            }
            Ok::<_, MotionError>(())
        });
        Ok(moved.unwrap_or(Ok(()))?)
    }

    /// Sets another mode of a joint, or of all joints of a finger, in which they keep their state.
    pub(super) fn set_mode(
        &mut self,
        finger: usize,
        joint: Option<usize>,
        mode: ServoMode,
    ) -> Result<(), Problem<'static>> {
        let outcome = self.ask(finger, |client, finger, timeout| {
            client.enable(finger, joint.map(|joint| joint as u32), mode, timeout)
        });
        self.refresh(finger)?;
        self.tell_loop();
        self.explained(finger, outcome?)
    }

    /// Returns the outcome of a request about a finger, with its name.
    fn explained(
        &self,
        finger: usize,
        outcome: Result<(), ClientError>,
    ) -> Result<(), Problem<'static>> {
        match outcome {
            Err(ClientError::Refused(ServoRefusal::AfterFault)) => {
                let name = self.hand.fingers.get(finger).map(|it| it.name.clone());
                Err(Problem::AfterFault(name.unwrap_or_default()))
            }
            outcome => Ok(outcome?),
        }
    }

    /// Sets the effort of an actuator, N or N m, and the mode of its joint.
    pub(super) fn set_effort(
        &mut self,
        finger: usize,
        actuator: usize,
        effort: f64,
    ) -> Result<(), Problem<'static>> {
        let joint = (self.hand.fingers.get(finger)).and_then(|finger| finger.joint_of(actuator));
        let (joint, number) = (joint.unwrap_or_default() as u32, actuator as u32);
        let outcome = self.ask(finger, |client, finger, timeout| {
            client.set_effort(finger, joint, (number, effort), timeout)
        });
        self.refresh(finger)?;
        self.tell_loop();
        match outcome? {
            Err(ClientError::Refused(ServoRefusal::Effort {
                value, low, high, ..
            })) => {
                let entry = self.hand.fingers.get(finger);
                let name = entry.map(|it| it.name.clone());
                let entry = self.hand.actuator(finger, actuator);
                Err(Problem::Effort {
                    finger: name.unwrap_or_default(),
                    actuator: entry.map(|it| it.name.clone()).unwrap_or_default(),
                    value,
                    low,
                    high,
                })
            }
            outcome => self.explained(finger, outcome),
        }
    }

    /// Sets a target of a joint, and the mode of that target.
    pub(super) fn set_target(
        &mut self,
        finger: usize,
        joint: usize,
        target: &JointTarget,
    ) -> Result<(), Problem<'static>> {
        let outcome = self.ask(finger, |client, finger, timeout| {
            client.set_target(finger, joint as u32, target, timeout)
        });
        self.refresh(finger)?;
        self.tell_loop();
        match outcome? {
            Err(ClientError::Refused(ServoRefusal::Target {
                quantity,
                value,
                low,
                high,
                ..
            })) => {
                let entry = self.hand.fingers.get(finger);
                let name = entry.map(|it| it.name.clone());
                let joint = self.hand.joint(finger, joint).map(|it| it.name.clone());
                Err(Problem::Target {
                    finger: name.unwrap_or_default(),
                    joint: joint.unwrap_or_default(),
                    quantity,
                    value,
                    low,
                    high,
                })
            }
            outcome => self.explained(finger, outcome),
        }
    }

    /// Switches a finger off.
    pub(super) fn disable(&mut self, finger: usize) -> Result<(), Problem<'static>> {
        self.ask(finger, |client, finger, timeout| {
            client.disable(finger, None, timeout)
        })??;
        // A finger that is switched off here does not count as lost.
        let has_lost = self.has_lost;
        self.refresh(finger)?;
        self.has_lost = has_lost;
        self.tell_loop();
        Ok(())
    }
}

/// Says which fault a finger has, and what can be done.
pub(super) fn tell_fault(
    finger: &Finger<JOINTS, ACTUATORS>,
    fault: Fault,
    mut say: impl FnMut(Arguments<'_>),
) {
    let (name, remedy) = (&finger.name, fault.code.remedy());
    say(format_args!("{name} has a fault: {}", fault.of(finger)));
    say(format_args!("  {remedy}; then `enable {name}`"));
}

fn works(status: &ServoStatus<JOINTS>) -> bool {
    status.fault.is_none() && !status.is_resting
}

/// Returns true if all joints of a finger follow set-points.
fn follows(status: &ServoStatus<JOINTS>) -> bool {
    works(status) && are_all(status, ServoMode::Position)
}

/// Returns true if all joints of a finger are in a mode.
pub(super) fn are_all(status: &ServoStatus<JOINTS>, mode: ServoMode) -> bool {
    !status.modes.is_empty() && status.modes.iter().all(|&it| it == mode)
}

/// Returns true if a finger comes to a fault without set-points.
fn needs_set_points(status: &ServoStatus<JOINTS>) -> bool {
    works(status) && status.modes.contains(&ServoMode::Position)
}

fn name(hand: &RobotDescription, finger: usize) -> &str {
    hand.fingers.get(finger).map_or("", |finger| &finger.name)
}
