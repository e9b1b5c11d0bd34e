//! [`Servos`]: the servo processors as the master's background has them.

use core::fmt::Arguments;
use core::time::Duration;

use condor_hand::message::{ServoClient, Status};
use condor_hand::servo::Mode;
use condor_hand::trajectory::{Begin, Pace, PrimitiveError, Profile, Target};
use condor_mbox::{Clock as _, PeerState, Processor, Region};
use condor_rt::objects::{self as names, Kind};
use condor_rt::{Background, Error, Machine, users};
use condor_vars::Table;

use super::drive::{Life, Link, Motion, SERVOS, Seat, Shared, with};
use super::words::Problem;
use crate::failure::Failure;
use crate::{FINGERS, JOINTS, SERVED, UtahMit, objects, servo};

/// How long a servo may take to answer.
pub(super) const ANSWER: Duration = Duration::from_millis(500);
/// How long a finger may take to its rest.
const REST: Duration = Duration::from_secs(3);
/// How joints leave the zones of their stops: so far, rad, and at most at this part of their limits of
/// velocity.
const ROOM_RAD: f64 = 0.02;
const LEAVE_SPEED: f64 = 0.02;
const NAP: Duration = Duration::from_millis(20);

type Client<'r, M> =
    ServoClient<'r, condor_rt::MailboxOf<'r, M>, <M as Machine>::Window, SERVED, JOINTS>;

/// One servo processor.
struct Servo<'r, M: Machine> {
    number: u8,
    fingers: [usize; SERVED],
    region: Region<M::Window>,
    mail: M::Window,
    /// The life whose objects these are; the client asks that one only.
    life: Option<u32>,
    /// Whether it has ever been there.
    is_known: bool,
    client: Option<Client<'r, M>>,
    status: [Option<Status<JOINTS>>; SERVED],
}

/// The servo processors.
pub(super) struct Servos<'r, 'p, M: Machine> {
    hand: &'r UtahMit,
    background: &'r Background<'r, M>,
    shared: &'r Shared<'p, M::Window>,
    seats: [Seat; FINGERS],
    processors: [Servo<'r, M>; SERVOS],
}

/// The numbers of the servo processors, and where each finger is served.
pub(super) fn seats(hand: &UtahMit) -> Result<([u8; SERVOS], [Seat; FINGERS]), Failure> {
    let mut numbers = heapless::Vec::<u8, SERVOS>::new();
    let mut seats = [Seat { servo: 0, place: 0 }; FINGERS];
    let fingers = hand.fingers.len();
    if fingers != FINGERS {
        let simulated = FINGERS;
        return Err(Failure::Hand { fingers, simulated });
    }
    for (finger, (seat, entry)) in seats.iter_mut().zip(&hand.fingers).enumerate() {
        let processor = entry.processor().unwrap_or(0);
        let wrong = |fingers| Failure::Fingers {
            processor,
            fingers,
            serves: SERVED,
        };
        let mut beside = hand.fingers_on(processor);
        let place = beside.position(|(index, _)| index == finger);
        let count = hand.fingers_on(processor).count();
        let place = place.filter(|_| count == SERVED).ok_or(wrong(count))?;
        let known = numbers.iter().position(|&it| it == processor);
        let servo = if let Some(servo) = known {
            servo
        } else {
            numbers.push(processor).map_err(|_| wrong(count))?;
            numbers.len() - 1
        };
        *seat = Seat { servo, place };
    }
    let numbers = numbers.into_array().map_err(|numbers| Failure::Fingers {
        processor: numbers.first().copied().unwrap_or(0),
        fingers: FINGERS,
        serves: SERVED,
    })?;
    Ok((numbers, seats))
}

impl<'r, 'p, M: Machine> Servos<'r, 'p, M> {
    pub(super) fn new(
        background: &'r Background<'r, M>,
        hand: &'r UtahMit,
        shared: &'r Shared<'p, M::Window>,
        numbers: [u8; SERVOS],
        seats: [Seat; FINGERS],
    ) -> Result<Self, Error> {
        let servo = |index: usize| {
            let number = numbers.get(index).copied().unwrap_or(0);
            let machine = background.machine();
            let windows = machine.windows().into_iter().nth(number.into());
            let windows = windows.ok_or(Failure::NoProcessor { processor: number })?;
            let mut fingers = [0; SERVED];
            for (finger, seat) in seats.iter().enumerate().filter(|(_, it)| it.servo == index) {
                if let Some(place) = fingers.get_mut(seat.place) {
                    *place = finger;
                }
            }
            Ok::<_, Error>(Servo {
                number,
                fingers,
                region: users(machine, Processor(number))?,
                mail: windows.mail,
                life: None,
                is_known: false,
                client: None,
                status: [None; SERVED],
            })
        };
        let processors = [servo(0)?, servo(1)?];
        Ok(Self {
            hand,
            background,
            shared,
            seats,
            processors,
        })
    }

    /// The number and the region of each.
    pub(super) fn regions(&self) -> impl Iterator<Item = (u8, &Region<M::Window>)> {
        self.processors
            .iter()
            .map(|servo| (servo.number, &servo.region))
    }

    /// How a finger was when it was asked last.
    pub(super) fn status(&self, finger: usize) -> Option<&Status<JOINTS>> {
        let seat = self.seats.get(finger)?;
        let servo = self.processors.get(seat.servo)?;
        servo.status.get(seat.place)?.as_ref()
    }

    /// The processor of a finger.
    pub(super) fn processor(&self, finger: usize) -> u8 {
        let seat = self.seats.get(finger);
        let servo = seat.and_then(|seat| self.processors.get(seat.servo));
        servo.map_or(0, |servo| servo.number)
    }

    /// Whether a finger follows its set-points.
    pub(super) fn follows(&self, finger: usize) -> bool {
        self.status(finger).is_some_and(follows)
    }

    /// Looks how all are. Gives whether a finger that followed does not any more.
    pub(super) fn watch(&mut self, mut say: impl FnMut(Arguments<'_>)) -> Result<bool, Error> {
        let mut has_lost = false;
        for index in 0..SERVOS {
            has_lost |= self.watch_one(index, &mut say)?;
        }
        Ok(has_lost)
    }

    fn watch_one(
        &mut self,
        index: usize,
        say: &mut impl FnMut(Arguments<'_>),
    ) -> Result<bool, Error> {
        let before = (0..FINGERS).filter(|&finger| self.follows(finger)).count();
        let Some(servo) = self.processors.get_mut(index) else {
            return Ok(false);
        };
        let state = self
            .background
            .mailbox()
            .peer_state(Processor(servo.number))?;
        let life = match state {
            PeerState::Up {
                incarnation,
                connected: true,
            } => Some(incarnation),
            _ => None,
        };
        let [a, b] = servo.fingers.map(|finger| name(self.hand, finger));
        if servo.life.is_some() && servo.life != life {
            (servo.life, servo.client, servo.status) = (None, None, [None; SERVED]);
            with(self.shared, |drive| {
                if let Some(link) = drive.links.get_mut(index) {
                    *link = None;
                }
            });
            let number = servo.number;
            say(format_args!(
                "processor {number} is gone: {a} and {b} are out of control"
            ));
        }
        if let (None, Some(life)) = (servo.life, life)
            && let Some(places) = objects::servos(&servo.region)?
            && objects::joints(&servo.region)?.is_some()
            && objects::grasp(&servo.region)?.is_some()
        {
            let seen = Life::new(servo.mail.clone(), servo.region.clone(), life)?;
            let link = Link::new(seen, &places)?;
            with(self.shared, |drive| {
                if let Some(place) = drive.links.get_mut(index) {
                    *place = Some(link);
                }
            });
            servo.client = Some(ServoClient::new(
                self.background.mailbox(),
                Processor(servo.number),
                &servo.region,
                places,
            )?);
            servo.life = Some(life);
            let number = servo.number;
            if servo.is_known {
                say(format_args!(
                    "processor {number} was restarted: `enable` takes up {a} and {b} where they are"
                ));
            } else {
                say(format_args!("processor {number} serves {a} and {b}"));
            }
            servo.is_known = true;
        }
        if servo.life.is_some() {
            for (place, finger) in servo.fingers.into_iter().enumerate() {
                self.look(finger, place, index, say);
            }
        }
        self.tell_loop();
        let after = (0..FINGERS).filter(|&finger| self.follows(finger)).count();
        Ok(after < before)
    }

    /// Asks how a finger is, and says what is new.
    fn look(
        &mut self,
        finger: usize,
        place: usize,
        index: usize,
        say: &mut impl FnMut(Arguments<'_>),
    ) {
        let name = name(self.hand, finger);
        let Some(servo) = self.processors.get_mut(index) else {
            return;
        };
        let (Some(client), Some(kept)) = (&mut servo.client, servo.status.get_mut(place)) else {
            return;
        };
        // One that does not answer now is asked again, unless it is gone.
        let Ok(status) = client.status(place as u32, ANSWER) else {
            return;
        };
        let former = kept.replace(status);
        let (fault, refused) = former.map_or((None, status.refused_set_points), |former| {
            (former.fault, former.refused_set_points)
        });
        match status.fault {
            Some(now) if status.fault != fault => {
                say(format_args!("{name} gave up: {now}; `enable` restarts it"));
            }
            _ => {}
        }
        if status.refused_set_points != refused {
            let count = status.refused_set_points.wrapping_sub(refused);
            say(format_args!("{name} refused {count} set-points"));
        }
    }

    /// Which fingers follow, for the loop.
    fn tell_loop(&self) {
        let mut loose = u32::MAX;
        for finger in 0..FINGERS {
            if self.follows(finger) {
                loose &= !(1 << finger);
            }
        }
        with(self.shared, |drive| drive.loose = loose);
    }

    /// Asks the servos of a finger something: the client, and the number of the finger there.
    pub(super) fn ask<R>(
        &mut self,
        finger: usize,
        question: impl FnOnce(&mut Client<'r, M>, u32, Duration) -> R,
    ) -> Result<R, Problem<'static>> {
        let number = self.processor(finger);
        let absent = Problem::Absent(number);
        let state = self.background.mailbox().peer_state(Processor(number))?;
        let Some(seat) = self.seats.get(finger) else {
            return Err(absent);
        };
        let Some(servo) = self.processors.get_mut(seat.servo) else {
            return Err(absent);
        };
        match (state, servo.life, &mut servo.client) {
            (PeerState::Up { incarnation, .. }, Some(seen), Some(client))
                if incarnation == seen =>
            {
                Ok(question(client, seat.place as u32, ANSWER))
            }
            _ => Err(absent),
        }
    }

    /// Finds the variables and parameters of the loop that serves a finger.
    pub(super) fn table(
        &mut self,
        finger: usize,
    ) -> Result<(Processor, Table<M::Window>), Problem<'static>> {
        // The program is there that was seen.
        self.ask(finger, |_, _, _| ())?;
        let number = self.processor(finger);
        let absent = || Problem::Absent(number);
        let seat = self.seats.get(finger).ok_or_else(absent)?;
        let known = self.processors.get(seat.servo).ok_or_else(absent)?;
        let object =
            names::find(&known.region, servo::LOOP, Kind::Variables)?.ok_or_else(absent)?;
        Ok((
            Processor(number),
            Table::open(&known.region, object.offset)?,
        ))
    }

    fn refresh(&mut self, finger: usize) -> Result<Status<JOINTS>, Problem<'static>> {
        let status = self.ask(finger, |client, place, timeout| {
            client.status(place, timeout)
        })??;
        if let Some(seat) = self.seats.get(finger).copied()
            && let Some(servo) = self.processors.get_mut(seat.servo)
            && let Some(kept) = servo.status.get_mut(seat.place)
        {
            *kept = Some(status);
        }
        Ok(status)
    }

    /// Restarts a finger if it has a fault, and has it follow from where it is.
    pub(super) fn enable(&mut self, finger: usize) -> Result<(), Problem<'static>> {
        let named = || self.hand.fingers.get(finger).map(|it| it.name.clone());
        let name = named().unwrap_or_default();
        let mut status = self.refresh(finger)?;
        if status.modes.contains(&Mode::Grasp) {
            return Err(Problem::InGrasp(name));
        }
        if follows(&status) {
            return Ok(());
        }
        if status.fault.is_some() || status.is_resting {
            self.ask(finger, |client, place, timeout| {
                client.restart(place, timeout)
            })??;
            let clock = self.background.machine().doorbell();
            let deadline = clock.now().after(REST);
            status = self.refresh(finger)?;
            while status.is_resting && clock.now() < deadline {
                self.background.serve(NAP)?;
                status = self.refresh(finger)?;
            }
            if let Some(fault) = status.fault {
                let finger = name;
                return Err(Problem::Fault { finger, fault });
            }
            if status.is_resting {
                return Err(Problem::Resting(name));
            }
        }
        let is_measured = with(self.shared, |drive| {
            let measured = drive.measured.get(finger).copied().flatten();
            if measured.is_some() {
                // From here on the set-points stay where the finger was just measured.
                drive.loose &= !(1 << finger);
            }
            measured.is_some()
        });
        if is_measured != Some(true) {
            return Err(Problem::NotMeasured(name));
        }
        let outcome = self.ask(finger, |client, place, timeout| {
            client.enable(place, None, Mode::Position, timeout)
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
        let first = finger * JOINTS;
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
            Ok::<_, PrimitiveError>(())
        });
        Ok(moved.unwrap_or(Ok(()))?)
    }

    /// Switches a finger off.
    pub(super) fn disable(&mut self, finger: usize) -> Result<(), Problem<'static>> {
        self.ask(finger, |client, place, timeout| {
            client.disable(place, None, timeout)
        })??;
        self.refresh(finger)?;
        self.tell_loop();
        Ok(())
    }
}

fn follows(status: &Status<JOINTS>) -> bool {
    let mut modes = status.modes.iter();
    status.fault.is_none() && !status.is_resting && modes.all(|&mode| mode == Mode::Position)
}

fn name(hand: &UtahMit, finger: usize) -> &str {
    hand.fingers.get(finger).map_or("", |finger| &finger.name)
}
