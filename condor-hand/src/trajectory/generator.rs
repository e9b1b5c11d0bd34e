use heapless::Deque;

use super::path::Path;
use super::plan::Planner;
use super::running::{Mover, Running};
use super::{
    Begin, Bounds, Guards, Happening, MotionEnd, MotionError, MotionEvent, MotionGuard,
    MotionProgress, MotionTicket, Observations, OnEnd, Primitive, ProfileLimits, Segments,
    SetPoint, StopGuard, Target, check_start,
};
use crate::math::{clamp, max};
use crate::number::{NumberError, positive};

/// Events that wait to be taken; the oldest are lost first.
const EVENTS: usize = 32;

/// A generator of set-points for J joints, up to 32, from a queue of up to Q motions, called primitives.
///
/// A primitive is checked when it is enqueued: it must be able to run from rest, from the place at which the primitives
/// before it leave the joints. But it can start elsewhere, or in motion: after a guard has stopped another primitive,
/// blended into one, or in place of one. If the limits do not permit it unchanged from there, it runs slower, or as
/// segments, and its event says so; if it cannot run at all, it is refused. The set-points of every tick are within the
/// limits of position, velocity and acceleration, and positions and velocities are continuous, whatever is requested
/// and whenever.
///
/// Joints that no primitive moves hold their positions.
///
/// The conditions that stop a primitive, its guards, are checked in [`tick`](Self::tick) with the readings that are
/// passed to it. Or the servos check them, [at their own rate](Self::with_guards_in_servos), and the caller reports
/// what they have [stopped](Self::stopped).
///
/// ```
/// use condor_hand::trajectory::{Generator, ProfileLimits, Observations, motion};
///
/// let limits = ProfileLimits { low: -1.0, high: 1.0, velocity: 2.0, acceleration: 20.0, jerk: 1e4 };
/// let mut generator = Generator::<2, 8>::new([limits; 2], [0.0; 2], 0.02)?;
/// let text = "[[motion]]\nprofile = 'minimum-jerk'\nduration = 0.8\nto = { elbow = 0.7 }";
/// for primitive in motion::load(text, "nod.toml", &["shoulder", "elbow"])? {
///     generator.enqueue(primitive)?;
/// }
/// while !generator.is_idle() {
///     let [_, elbow] = generator.tick(&Observations::none());
///     println!("{:.3} rad", elbow.position);
/// }
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Generator<const J: usize, const Q: usize> {
    limits: [ProfileLimits; J],
    tick: f64,
    joints: [Mover; J],
    running: [Option<Running>; J],
    queue: Deque<(MotionTicket, Primitive<J>), Q>,
    /// Ticks for which the first of the queue has had its turn.
    waited: u32,
    paused: bool,
    held: bool,
    /// The servos check what stops, but for the time.
    guards_in_servos: bool,
    next: u32,
    events: Deque<MotionEvent, EVENTS>,
}

impl<const J: usize, const Q: usize> Generator<J, Q> {
    /// Makes a generator whose joints rest at `positions` (rad). `limits` are those of each joint,
    /// and `tick_s` is the time between two calls of [`tick`](Self::tick), s.
    ///
    /// # Errors
    /// [`NumberError`] if a limit is wrong, or a number is not finite.
    pub fn new(
        limits: [ProfileLimits; J],
        positions: [f64; J],
        tick_s: f64,
    ) -> Result<Self, NumberError> {
        const { assert!(J > 0 && J <= 32, "a mask has 32 bits") };
        positive("the duration of a tick, s,", tick_s)?;
        for (joint, limits) in limits.iter().enumerate() {
            limits.validate(joint)?;
        }
        let mut joints = limits.map(|limits| Mover {
            state: SetPoint::rest(limits.low),
            path: Path::Still(limits.low),
            limits,
            motion: 0,
            is_stopped: false,
        });
        place(&mut joints, &positions)?;
        Ok(Self {
            limits,
            tick: tick_s,
            joints,
            running: [const { None }; J],
            queue: Deque::new(),
            waited: 0,
            paused: false,
            held: false,
            guards_in_servos: false,
            next: 0,
            events: Deque::new(),
        })
    }

    /// Returns the generator with guards that the servos check, instead of the generator. In every
    /// tick pass [`guards`](Self::guards) to the servos together with the set-points, and report to
    /// [`stopped`](Self::stopped) what they have stopped.
    ///
    /// The generator itself still checks the guard of the time.
    #[must_use]
    pub fn with_guards_in_servos(mut self) -> Self {
        self.guards_in_servos = true;
        self
    }

    /// Changes the greatest velocity, acceleration and jerk of a joint, rad/s, rad/s² and rad/s³, while nothing moves
    /// or waits. Returns false, and changes nothing, unless the generator [is idle](Self::is_idle), because primitives
    /// were checked with the earlier limits; and if there is no such joint.
    ///
    /// # Errors
    /// [`NumberError`] if a limit is not above zero; the limits stay then.
    pub fn set_rates(
        &mut self,
        joint: usize,
        velocity: f64,
        acceleration: f64,
        jerk: f64,
    ) -> Result<bool, NumberError> {
        let is_idle = self.is_idle();
        let places = self.limits.get_mut(joint).zip(self.joints.get_mut(joint));
        let Some((place, mover)) = places.filter(|_| is_idle) else {
            return Ok(false);
        };
        let limits = ProfileLimits {
            velocity,
            acceleration,
            jerk,
            ..*place
        };
        limits.validate(joint)?;
        (*place, mover.limits) = (limits, limits);
        Ok(true)
    }

    /// Adds a primitive, which is one motion of some joints, at the end of the queue. Returns the
    /// ticket by which events and calls name the primitive.
    ///
    /// # Errors
    /// [`MotionError`] if the primitive is wrong, a joint would leave its limits, or the queue
    /// is full.
    pub fn enqueue(&mut self, primitive: Primitive<J>) -> Result<MotionTicket, MotionError> {
        primitive.check()?;
        let starts = if primitive.begin == Begin::Now && self.queue.is_empty() {
            self.set_points()
                .map(|point| SetPoint::rest(point.position))
        } else {
            self.foreseen()
        };
        let planner = Planner {
            primitive: &primitive,
            starts: &starts,
            limits: &self.limits,
            tick: self.tick,
        };
        planner.asked()?;
        let ticket = MotionTicket(self.next);
        self.queue
            .push_back((ticket, primitive))
            .map_err(|_| MotionError::Full { capacity: Q })?;
        self.next = self.next.wrapping_add(1);
        Ok(ticket)
    }

    /// Adds primitives at the end of the queue, and their tickets to `tickets`, as long as both
    /// have room. No more of them are taken than are added, but for one that is refused.
    ///
    /// Returns the number of primitives that were added. If a primitive is refused, the call ends
    /// there and also returns the error; a full queue is not an error.
    pub fn feed<const N: usize>(
        &mut self,
        primitives: impl IntoIterator<Item = Primitive<J>>,
        tickets: &mut heapless::Vec<MotionTicket, N>,
    ) -> (u32, Result<(), MotionError>) {
        let mut fed = 0;
        let mut primitives = primitives.into_iter();
        while !tickets.is_full() && !self.queue.is_full() {
            let Some(primitive) = primitives.next() else {
                break;
            };
            match self.enqueue(primitive) {
                Ok(ticket) => {
                    // There is room.
                    let _ = tickets.push(ticket);
                    fed += 1;
                }
                Err(error) => return (fed, Err(error)),
            }
        }
        (fed, Ok(()))
    }

    /// Slows all motion down to a stop, with the joints on their paths. Nothing moves and no
    /// primitive starts until [`resume`](Self::resume).
    pub fn pause(&mut self) {
        self.paused = true;
    }

    /// Continues all motion after a [`pause`](Self::pause).
    pub fn resume(&mut self) {
        self.paused = false;
    }

    /// Returns true from [`pause`](Self::pause) until [`resume`](Self::resume), even while motion
    /// still slows down.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        self.paused
    }

    /// Slows all motion down to a stop, with the joints on their paths, and drops all primitives,
    /// also those that wait.
    ///
    /// Joints that return to the place where a servo has stopped them continue to do so.
    pub fn abort(&mut self) {
        for running in self.running.iter_mut().flatten() {
            if running.returns() {
                running.outcome = MotionEnd::Aborted;
            } else {
                running.ending = Some(MotionEnd::Aborted);
            }
        }
        while let Some((ticket, _)) = self.queue.pop_front() {
            self.report(ticket, Happening::Ended(MotionEnd::Aborted));
        }
        self.waited = 0;
        self.held = false;
    }

    /// Lets the next primitive start after a primitive with [`OnEnd::Hold`] has ended.
    pub fn proceed(&mut self) {
        self.held = false;
    }

    /// Returns true if a primitive with [`OnEnd::Hold`] has ended, and the next one waits for
    /// [`proceed`](Self::proceed).
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.held
    }

    /// Drops all motion at once, without slowing down, and makes the joints rest at `positions`
    /// (rad). Use it only while the servos are off.
    ///
    /// # Errors
    /// [`NumberError`] if a position is not finite; nothing changes then.
    pub fn reset(&mut self, positions: [f64; J]) -> Result<(), NumberError> {
        place(&mut self.joints, &positions)?;
        self.free(u32::MAX, MotionEnd::Aborted);
        self.abort();
        Ok(())
    }

    /// Drops the motion of the joints in `mask` (bit *i* is joint *i*) at once, without slowing
    /// down, and makes them rest at their `positions` (rad). The other joints move on. Use it for
    /// joints whose servos are off.
    ///
    /// A primitive that moves only joints in `mask` is aborted.
    ///
    /// # Errors
    /// [`NumberError`] if a position of such a joint is not finite; nothing changes then.
    pub fn hold(&mut self, mask: u32, positions: &[f64; J]) -> Result<(), NumberError> {
        let held = |joint: usize| mask >> joint & 1 == 1;
        let mut all = self.set_points().map(|point| point.position);
        for (joint, (place, position)) in all.iter_mut().zip(positions).enumerate() {
            if held(joint) {
                *place = *position;
            }
        }
        check_finite(&all)?;
        for (joint, (mover, position)) in self.joints.iter_mut().zip(all).enumerate() {
            if held(joint) {
                mover.rest(position);
            }
        }
        self.free(mask, MotionEnd::Aborted);
        Ok(())
    }

    /// Reports to the generator that a servo has stopped joints because of a guard.
    ///
    /// * `motion`: the [number](MotionTicket::number) of the motion whose guard has stopped them.
    /// * `guard`: the condition that held.
    /// * `mask`: the joints that were stopped; bit *i* is joint *i*.
    /// * `positions`: the positions at which these joints were stopped, rad.
    ///
    /// These joints return to those positions, within their limits, and rest there; the other
    /// joints of the motion slow down to a stop on their paths. The motion has ended, stopped by
    /// the guard, when all of them rest; what waits for it begins after that. Joints return also if
    /// their motion has ended already. Joints that have another motion by now, or whose stop was
    /// reported before, stay as they are.
    ///
    /// Returns the joints that return to their positions, as a mask.
    ///
    /// # Errors
    /// [`NumberError`] if a position of a joint in `mask` is not finite; nothing changes then.
    pub fn stopped(
        &mut self,
        motion: u32,
        guard: MotionGuard,
        mask: u32,
        positions: &[f64; J],
    ) -> Result<u32, NumberError> {
        let in_mask = |joint: usize| mask >> joint & 1 == 1;
        for (joint, &position) in positions.iter().enumerate() {
            if in_mask(joint) {
                check_start(joint, position)?;
            }
        }
        let (mut returning, mut duration) = (0, self.tick);
        for (joint, (mover, &position)) in self.joints.iter_mut().zip(positions).enumerate() {
            let is_new = motion != 0 && mover.motion == motion && !mover.is_stopped;
            if !(in_mask(joint) && is_new) {
                continue;
            }
            let limits = &mover.limits;
            let bounds = Bounds {
                velocity: limits.velocity,
                acceleration: limits.acceleration,
                jerk: None,
            };
            let end = clamp(position, limits.low, limits.high);
            // All of these numbers are finite, and the bounds above zero.
            if let Ok(way) = Segments::fastest(&mover.state, end, &bounds) {
                duration = max(duration, way.duration());
                mover.path = Path::Segments(way);
                mover.is_stopped = true;
                returning |= 1 << joint;
            }
        }
        if returning != 0 {
            self.send_back(motion, guard, returning, duration);
        }
        Ok(returning)
    }

    /// Moves joints on their paths back to where a servo has stopped them.
    fn send_back(&mut self, motion: u32, guard: MotionGuard, mask: u32, duration: f64) {
        let mut back = Running {
            ticket: MotionTicket(motion.wrapping_sub(1)),
            mask,
            at: 0.0,
            rate: 1.0,
            duration,
            ticks: 0,
            stop: Guards::none(),
            on_end: OnEnd::Next,
            ending: None,
            outcome: MotionEnd::Stopped(guard),
            is_told: true,
        };
        for slot in &mut self.running {
            let Some(running) = slot.as_mut().filter(|it| it.ticket.number() == motion) else {
                continue;
            };
            if !running.returns() {
                running.ending.get_or_insert(MotionEnd::Stopped(guard));
            }
            back.ticket = running.ticket;
            back.outcome = running.ending.unwrap_or(running.outcome);
            back.on_end = running.on_end;
            back.is_told = running.is_told;
            running.mask &= !mask;
            if running.mask == 0 {
                *slot = None;
            }
        }
        // Each one that runs has a joint of its own, so with J places one is free.
        if let Some(free) = self.running.iter_mut().find(|slot| slot.is_none()) {
            *free = Some(back);
        }
    }

    /// Returns for each joint the guard that its servo must check: the number of the motion that
    /// moves the joint, and the conditions that stop that motion.
    #[must_use]
    pub fn guards(&self) -> [StopGuard; J] {
        let mut guards = self
            .joints
            .each_ref()
            .map(|mover| StopGuard::of(mover.motion));
        for running in self.running.iter().flatten() {
            for (joint, guard) in guards.iter_mut().enumerate() {
                if running.moves(joint) {
                    *guard = StopGuard::new(guard.motion, &running.stop);
                }
            }
        }
        guards
    }

    /// Runs one tick, and returns the new set-points of all joints. `seen` are the sensor readings
    /// with which the conditions of primitives are compared.
    pub fn tick(&mut self, seen: &Observations<J>) -> [SetPoint; J] {
        self.start(seen);
        for (joint, mover) in self.joints.iter_mut().enumerate() {
            if !self
                .running
                .iter()
                .flatten()
                .any(|running| running.moves(joint))
            {
                mover.state = SetPoint::rest(mover.state.position);
            }
        }
        for slot in 0..J {
            self.advance(slot, seen);
        }
        self.set_points()
    }

    /// Returns the set-points of the last tick.
    #[must_use]
    pub fn set_points(&self) -> [SetPoint; J] {
        self.joints.each_ref().map(|mover| mover.state)
    }

    /// Returns true if no primitive is in motion and none waits in the queue.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.running.iter().all(Option::is_none)
    }

    /// Returns the progress of a primitive; `None` if it has ended, or if there was none with this
    /// ticket.
    #[must_use]
    pub fn progress(&self, ticket: MotionTicket) -> Option<MotionProgress> {
        let mut running = self.running.iter().flatten();
        if let Some(running) = running.find(|running| running.ticket == ticket) {
            return Some(MotionProgress::Running {
                fraction: running.at / running.duration,
                rate: running.rate,
            });
        }
        let before = self
            .queue
            .iter()
            .position(|(queued, _)| *queued == ticket)?;
        Some(MotionProgress::Queued { before })
    }

    /// Returns the oldest event that was not returned yet, and removes it; `None` if there is none.
    /// At most 32 events are kept; the oldest are lost first.
    pub fn take_event(&mut self) -> Option<MotionEvent> {
        self.events.pop_front()
    }

    fn report(&mut self, ticket: MotionTicket, happening: Happening) {
        if self.events.is_full() {
            self.events.pop_front();
        }
        // There is a place now.
        let _ = self.events.push_back(MotionEvent { ticket, happening });
    }

    /// The set-points at which the joints will rest after all motions that run and wait.
    fn foreseen(&self) -> [SetPoint; J] {
        let mut ends = self
            .set_points()
            .map(|point| SetPoint::rest(point.position));
        for running in self.running.iter().flatten() {
            if running.ending.is_some() {
                continue;
            }
            for (joint, (end, mover)) in ends.iter_mut().zip(&self.joints).enumerate() {
                if running.moves(joint) {
                    end.position = mover.path.at(running.duration).position;
                }
            }
        }
        for (_, primitive) in &self.queue {
            for (joint, target) in primitive.joints() {
                if let Some(end) = ends.get_mut(joint) {
                    end.position = match target {
                        Target::Absolute(position) => position,
                        Target::Relative(by) => end.position + by,
                    };
                }
            }
        }
        ends
    }

    /// Starts all that may start, from the head of the queue.
    fn start(&mut self, seen: &Observations<J>) {
        while !self.paused && !self.held {
            let Some((_, first)) = self.queue.front() else {
                return;
            };
            if !self.is_turn_of(first) {
                return;
            }
            let waited = self.seconds(self.waited);
            if !first.start.is_none() && first.start.holds(first.mask, waited, seen).is_none() {
                self.waited = self.waited.saturating_add(1);
                return;
            }
            self.waited = 0;
            let Some((ticket, primitive)) = self.queue.pop_front() else {
                return;
            };
            match self.launch(ticket, &primitive) {
                Ok(adjusted) => self.report(ticket, Happening::Started { adjusted }),
                Err(error) => self.report(ticket, Happening::Refused(error)),
            }
        }
    }

    fn seconds(&self, ticks: u32) -> f64 {
        f64::from(ticks) * self.tick
    }

    fn is_turn_of(&self, primitive: &Primitive<J>) -> bool {
        self.running.iter().flatten().all(|running| {
            let waits = match primitive.begin {
                Begin::Now => false,
                Begin::Beside => running.mask & primitive.mask != 0,
                Begin::After => true,
            };
            let blends = running.ending.is_none()
                && !running.returns()
                && running.on_end == OnEnd::Next
                && primitive.blend > 0.0
                && running.remaining() <= primitive.blend;
            !waits || blends
        })
    }

    fn launch(
        &mut self,
        ticket: MotionTicket,
        primitive: &Primitive<J>,
    ) -> Result<bool, MotionError> {
        let starts = self.set_points();
        let planner = Planner {
            primitive,
            starts: &starts,
            limits: &self.limits,
            tick: self.tick,
        };
        let plan = planner.possible()?;
        for (joint, _) in primitive.joints() {
            // The plan has made each of these paths once, so none fails half-way.
            let path = planner.path(joint, &plan)?;
            if let Some(mover) = self.joints.get_mut(joint) {
                mover.path = path;
                mover.motion = ticket.number();
                mover.is_stopped = false;
            }
        }
        self.free(primitive.mask, MotionEnd::Superseded { by: ticket });
        let running = Running {
            ticket,
            mask: primitive.mask,
            at: 0.0,
            rate: 1.0,
            duration: plan.duration,
            ticks: 0,
            stop: primitive.stop,
            on_end: primitive.on_end,
            ending: None,
            outcome: MotionEnd::Reached,
            is_told: false,
        };
        // Each one that runs has a joint of its own, so with J places one is free.
        let free = self.running.iter_mut().find(|slot| slot.is_none());
        let Some(free) = free else {
            return Err(MotionError::Full { capacity: J });
        };
        *free = Some(running);
        Ok(plan.adjusted)
    }

    /// Takes the joints in `mask` from what runs; what has no other has ended.
    fn free(&mut self, mask: u32, ended: MotionEnd) {
        for slot in 0..J {
            let Some(mut running) = self.running.get_mut(slot).and_then(Option::take) else {
                continue;
            };
            running.mask &= !mask;
            if running.mask == 0 {
                self.end(&running, ended);
            } else if let Some(place) = self.running.get_mut(slot) {
                *place = Some(running);
            }
        }
    }

    fn advance(&mut self, slot: usize, seen: &Observations<J>) {
        let Some(mut running) = self.running.get_mut(slot).and_then(Option::take) else {
            return;
        };
        if running.ending.is_none() {
            let elapsed = self.seconds(running.ticks);
            let guard = if self.guards_in_servos {
                running.stop.is_over(elapsed).then_some(MotionGuard::Time)
            } else {
                running.stop.may_hold(running.mask, elapsed, seen)
            };
            running.ending = guard.map(MotionEnd::Stopped);
        }
        let ended = running.advance(&mut self.joints, self.tick, self.paused);
        let Some(ended) = ended else {
            if let Some(place) = self.running.get_mut(slot) {
                *place = Some(running);
            }
            return;
        };
        self.end(&running, ended);
    }

    /// Ends a motion whose part `running` is over, unless other joints of the motion still return or slow down.
    fn end(&mut self, running: &Running, ended: MotionEnd) {
        let ticket = running.ticket;
        let mut others = self.running.iter().flatten();
        if running.is_told || others.any(|other| other.ticket == ticket) {
            return;
        }
        if matches!(ended, MotionEnd::Reached | MotionEnd::Stopped(_)) {
            self.held |= running.on_end == OnEnd::Hold;
        }
        self.report(ticket, Happening::Ended(ended));
    }
}

/// Puts the joints at rest at these positions, if all of them are finite.
fn place<const J: usize>(joints: &mut [Mover; J], positions: &[f64; J]) -> Result<(), NumberError> {
    check_finite(positions)?;
    for (mover, &position) in joints.iter_mut().zip(positions) {
        mover.rest(position);
    }
    Ok(())
}

fn check_finite<const J: usize>(positions: &[f64; J]) -> Result<(), NumberError> {
    let mut joints = positions.iter().enumerate();
    joints.try_for_each(|(joint, &position)| check_start(joint, position))
}
