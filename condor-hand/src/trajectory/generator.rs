use heapless::Deque;

use super::path::Path;
use super::plan::Planner;
use super::running::{Mover, Running};
use super::{
    Begin, Ended, Event, Happening, Limits, Observations, OnEnd, Primitive, PrimitiveError,
    Progress, SetPoint, Target, Ticket, TrajectoryError, check_start,
};
use crate::Real;
use crate::number::positive;

/// Events that wait to be taken; the oldest are lost first.
const EVENTS: usize = 32;

/// Generates set-points of J joints, up to 32, from a queue of up to Q primitives.
///
/// A primitive is checked when it is enqueued: it must be able to run from rest, from the place at
/// which the primitives before it leave the joints. But it can start elsewhere, or in motion: after
/// a guard has stopped another primitive, blended into one, or in place of one. If the limits do
/// not permit it unchanged from there, it runs slower, or as segments, and its event says so; if it
/// cannot run at all, it is refused. The set-points of every tick are within the limits of
/// position, velocity and acceleration, and positions and velocities are continuous, whatever is
/// requested and whenever.
///
/// Joints that no primitive moves hold their positions.
#[derive(Clone, Debug)]
pub struct Generator<const J: usize, const Q: usize, T: Real = f64> {
    limits: [Limits<T>; J],
    tick: T,
    joints: [Mover<T>; J],
    running: [Option<Running<T>>; J],
    queue: Deque<(Ticket, Primitive<J, T>), Q>,
    /// Ticks for which the first of the queue has had its turn.
    waited: u32,
    paused: bool,
    held: bool,
    next: u32,
    events: Deque<Event, EVENTS>,
}

impl<const J: usize, const Q: usize, T: Real> Generator<J, Q, T> {
    /// Makes a generator at rest at `positions` (rad), with a tick every `tick_s` seconds.
    ///
    /// # Errors
    /// [`TrajectoryError`] if a limit is wrong, or a number is not finite.
    pub fn new(
        limits: [Limits<T>; J],
        positions: [T; J],
        tick_s: T,
    ) -> Result<Self, TrajectoryError> {
        const { assert!(J > 0 && J <= 32, "a mask has 32 bits") };
        positive("the duration of a tick, s,", tick_s)?;
        for (joint, limits) in limits.iter().enumerate() {
            limits.validate(joint)?;
        }
        let mut joints = limits.map(|limits| Mover {
            state: SetPoint::rest(limits.low),
            path: Path::Still(limits.low),
            limits,
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
            next: 0,
            events: Deque::new(),
        })
    }

    /// Adds a primitive, one motion of some joints, at the end of the queue, and returns its
    /// ticket.
    ///
    /// # Errors
    /// [`PrimitiveError`] if the primitive is wrong, a joint would leave its limits, or the queue
    /// is full.
    pub fn enqueue(&mut self, primitive: Primitive<J, T>) -> Result<Ticket, PrimitiveError> {
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
        let ticket = Ticket(self.next);
        self.queue
            .push_back((ticket, primitive))
            .map_err(|_| PrimitiveError::Full { capacity: Q })?;
        self.next = self.next.wrapping_add(1);
        Ok(ticket)
    }

    /// Slows all motion down to a stop, on its paths; no primitive starts until
    /// [`resume`](Self::resume).
    pub fn pause(&mut self) {
        self.paused = true;
    }

    /// Continues after a pause.
    pub fn resume(&mut self) {
        self.paused = false;
    }

    /// Returns whether it is pausing; motion may still slow down.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        self.paused
    }

    /// Slows all motion down to a stop and drops it, with all primitives in the queue.
    pub fn abort(&mut self) {
        for running in self.running.iter_mut().flatten() {
            running.ending = Some(Ended::Aborted);
        }
        while let Some((ticket, _)) = self.queue.pop_front() {
            self.report(ticket, Happening::Ended(Ended::Aborted));
        }
        self.waited = 0;
        self.held = false;
    }

    /// Starts the next primitive after one with [`OnEnd::Hold`].
    pub fn proceed(&mut self) {
        self.held = false;
    }

    /// Returns whether it waits for [`Generator::proceed`].
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.held
    }

    /// Drops all motion at once and rests at `positions` (rad). It is for servos that are off.
    ///
    /// # Errors
    /// [`TrajectoryError`] if a position is not finite; nothing changes then.
    pub fn reset(&mut self, positions: [T; J]) -> Result<(), TrajectoryError> {
        place(&mut self.joints, &positions)?;
        self.free(u32::MAX, Ended::Aborted);
        self.abort();
        Ok(())
    }

    /// Drops the motion of the joints in `mask` (bit *i* is joint *i*) at once, and makes them rest
    /// at their `positions` (rad); the other joints move on. It is for servos that are off while
    /// others are not.
    ///
    /// A primitive that moves only such joints is aborted.
    ///
    /// # Errors
    /// [`TrajectoryError`] if a position of such a joint is not finite; nothing changes then.
    pub fn hold(&mut self, mask: u32, positions: &[T; J]) -> Result<(), TrajectoryError> {
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
                mover.state = SetPoint::rest(position);
                mover.path = Path::Still(position);
            }
        }
        self.free(mask, Ended::Aborted);
        Ok(())
    }

    /// Runs one tick and returns its set-points. `seen` are the readings that the conditions of
    /// primitives check.
    pub fn tick(&mut self, seen: &Observations<J, T>) -> [SetPoint<T>; J] {
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

    /// Returns the present set-points.
    #[must_use]
    pub fn set_points(&self) -> [SetPoint<T>; J] {
        self.joints.each_ref().map(|mover| mover.state)
    }

    /// Returns whether no primitive moves or waits.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.running.iter().all(Option::is_none)
    }

    /// Returns the progress of a primitive; `None` if it has ended.
    #[must_use]
    pub fn progress(&self, ticket: Ticket) -> Option<Progress<T>> {
        let mut running = self.running.iter().flatten();
        if let Some(running) = running.find(|running| running.ticket == ticket) {
            return Some(Progress::Running {
                fraction: running.at / running.duration,
                rate: running.rate,
            });
        }
        let before = self
            .queue
            .iter()
            .position(|(queued, _)| *queued == ticket)?;
        Some(Progress::Queued { before })
    }

    /// Takes the oldest event; returns `None` if there is none.
    pub fn take_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    fn report(&mut self, ticket: Ticket, happening: Happening) {
        if self.events.is_full() {
            self.events.pop_front();
        }
        // There is a place now.
        let _ = self.events.push_back(Event { ticket, happening });
    }

    /// Where the joints will rest after all that runs and waits.
    fn foreseen(&self) -> [SetPoint<T>; J] {
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
    fn start(&mut self, seen: &Observations<J, T>) {
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

    fn seconds(&self, ticks: u32) -> T {
        T::of(f64::from(ticks)) * self.tick
    }

    fn is_turn_of(&self, primitive: &Primitive<J, T>) -> bool {
        self.running.iter().flatten().all(|running| {
            let waits = match primitive.begin {
                Begin::Now => false,
                Begin::Beside => running.mask & primitive.mask != 0,
                Begin::After => true,
            };
            let blends = running.ending.is_none()
                && running.on_end == OnEnd::Next
                && primitive.blend > T::zero()
                && running.remaining() <= primitive.blend;
            !waits || blends
        })
    }

    fn launch(
        &mut self,
        ticket: Ticket,
        primitive: &Primitive<J, T>,
    ) -> Result<bool, PrimitiveError> {
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
            }
        }
        self.free(primitive.mask, Ended::Superseded { by: ticket });
        let running = Running {
            ticket,
            mask: primitive.mask,
            at: T::zero(),
            rate: T::one(),
            duration: plan.duration,
            ticks: 0,
            stop: primitive.stop,
            on_end: primitive.on_end,
            ending: None,
        };
        // Each one that runs has a joint of its own, so with J places one is free.
        let free = self.running.iter_mut().find(|slot| slot.is_none());
        let Some(free) = free else {
            return Err(PrimitiveError::Full { capacity: J });
        };
        *free = Some(running);
        Ok(plan.adjusted)
    }

    /// Takes the joints in `mask` from what runs; what has no other has ended.
    fn free(&mut self, mask: u32, ended: Ended) {
        for slot in 0..J {
            let Some(mut running) = self.running.get_mut(slot).and_then(Option::take) else {
                continue;
            };
            running.mask &= !mask;
            if running.mask == 0 {
                self.report(running.ticket, Happening::Ended(ended));
            } else if let Some(place) = self.running.get_mut(slot) {
                *place = Some(running);
            }
        }
    }

    fn advance(&mut self, slot: usize, seen: &Observations<J, T>) {
        let Some(mut running) = self.running.get_mut(slot).and_then(Option::take) else {
            return;
        };
        if running.ending.is_none() {
            let elapsed = self.seconds(running.ticks);
            let guard = running.stop.may_hold(running.mask, elapsed, seen);
            running.ending = guard.map(Ended::Stopped);
        }
        let ended = running.advance(&mut self.joints, self.tick, self.paused);
        let Some(ended) = ended else {
            if let Some(place) = self.running.get_mut(slot) {
                *place = Some(running);
            }
            return;
        };
        if ended != Ended::Aborted {
            self.held |= running.on_end == OnEnd::Hold;
        }
        self.report(running.ticket, Happening::Ended(ended));
    }
}

/// Puts the joints at rest at these positions, if all of them are finite.
fn place<const J: usize, T: Real>(
    joints: &mut [Mover<T>; J],
    positions: &[T; J],
) -> Result<(), TrajectoryError> {
    check_finite(positions)?;
    for (mover, &position) in joints.iter_mut().zip(positions) {
        mover.state = SetPoint::rest(position);
        mover.path = Path::Still(position);
    }
    Ok(())
}

fn check_finite<const J: usize, T: Real>(positions: &[T; J]) -> Result<(), TrajectoryError> {
    let mut joints = positions.iter().enumerate();
    joints.try_for_each(|(joint, &position)| check_start(joint, position))
}
