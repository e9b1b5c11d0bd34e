use condor_hand::controller::{FingerController, FingerTick};
use condor_hand::dynamics::Dynamics;
use condor_hand::grasp::distributed::FingerControllers;
use condor_hand::servo::{FingerReadings, ServoMode, ServoRefusal};
use condor_hand::transmission::Transmission;
use condor_mbox::published::{Publisher, Subscriber};
use condor_mbox::{AccessError, MemoryWindow, Region, StaticWindow};
use heapless::Vec;
use nalgebra::Vector3;

use super::layout::{JointPoint, Points, ServoLayout};
use super::memory::{
    FingerMemory, JointDrive, JointMemory, JointOrder, JointOutcome, Report, word,
};
use super::{FingerRequest, ServoStatus};
use crate::packet::Packet;

/// The part of a [`ServoObject`](super::ServoObject) that runs in the servo loop: it carries out the requests of
/// clients and the set-points of the master with the controllers of the fingers.
#[derive(Debug)]
pub struct HandLoop<'o, M, T, W, const F: usize, const N: usize, const A: usize> {
    fingers: [Option<FingerLoop<'o, M, T, W, N, A>>; F],
}

#[derive(Debug)]
struct FingerLoop<'o, M, T, W, const N: usize, const A: usize> {
    controller: FingerController<M, T, N, A>,
    memory: &'o FingerMemory<N>,
    words: Region<StaticWindow<'o>>,
    /// The number of the last order of which all is done.
    settled: u32,
    restarts_asked: u32,
    /// The number of the last order that each joint has done.
    done: [u32; N],
    points: Subscriber<Points<N>, Region<W>>,
    points_seen: u32,
    refused_set_points: u32,
    restarts: u32,
    ticks: u32,
    report: Publisher<Report<N>, StaticWindow<'o>>,
    /// The last report, without its ticks.
    reported: Option<ServoStatus<N>>,
}

impl<'o, M, T, W, const F: usize, const N: usize, const A: usize> HandLoop<'o, M, T, W, F, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
    W: MemoryWindow + Clone,
{
    pub(super) fn new(
        memories: &'o [FingerMemory<N>; F],
        region: &Region<W>,
        places: ServoLayout<F, N>,
        controllers: [Option<FingerController<M, T, N, A>>; F],
    ) -> Result<Self, AccessError> {
        let mut fingers = [const { None }; F];
        let all = fingers.iter_mut().zip(controllers).zip(memories);
        for (finger, ((place, controller), memory)) in all.enumerate() {
            if let Some(controller) = controller {
                let points = places.subscriber(finger, region)?;
                *place = Some(FingerLoop::new(controller, memory, points)?);
            }
        }
        Ok(Self { fingers })
    }
}

impl<M, T, W, const F: usize, const N: usize, const A: usize> HandLoop<'_, M, T, W, F, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
    W: MemoryWindow,
{
    /// Runs one tick of finger number `finger`: passes on the requests and set-points that have
    /// come since the last tick, and then calls [`FingerController::tick`] with the other
    /// arguments. Returns `None` for a finger that the processor does not serve.
    ///
    /// The call never waits, whatever other processors write.
    pub fn tick(
        &mut self,
        finger: usize,
        sensed: &FingerReadings<N, A>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> Option<FingerTick<N, A>> {
        self.tick_telling(finger, sensed, gravity, period_s, |_| {})
    }

    /// Runs one tick as [`tick`](Self::tick) does, and calls `tell` with each request that is
    /// passed to the controller, in the same order, for example to record the requests. Returns
    /// `None` for a finger that the processor does not serve.
    pub fn tick_telling(
        &mut self,
        finger: usize,
        sensed: &FingerReadings<N, A>,
        gravity: &Vector3<f64>,
        period_s: f64,
        mut tell: impl FnMut(&FingerRequest<N>),
    ) -> Option<FingerTick<N, A>> {
        let finger = self.fingers.get_mut(finger)?.as_mut()?;
        finger.obey(&mut tell);
        finger.follow(&mut tell);
        let tick = finger.controller.tick(sensed, gravity, period_s);
        finger.tell(&tick);
        Some(tick)
    }

    /// Returns the controller of finger number `finger`; `None` if the processor does not serve the
    /// finger.
    #[must_use]
    pub fn controller(&self, finger: usize) -> Option<&FingerController<M, T, N, A>> {
        let finger = self.fingers.get(finger)?.as_ref()?;
        Some(&finger.controller)
    }

    /// Returns the controller of finger number `finger`, so that the program of this processor can
    /// call it directly; `None` if the processor does not serve the finger.
    #[must_use]
    pub fn controller_mut(&mut self, finger: usize) -> Option<&mut FingerController<M, T, N, A>> {
        let finger = self.fingers.get_mut(finger)?.as_mut()?;
        Some(&mut finger.controller)
    }
}

impl<'o, M, T, W, const N: usize, const A: usize> FingerLoop<'o, M, T, W, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
    W: MemoryWindow,
{
    fn new(
        controller: FingerController<M, T, N, A>,
        memory: &'o FingerMemory<N>,
        points: Subscriber<Points<N>, Region<W>>,
    ) -> Result<Self, AccessError> {
        let (cell, window) = memory.report();
        let words = memory.words();
        let mut this = Self {
            settled: words.word(word::ORDERS)?,
            restarts_asked: words.word(word::RESTARTS)?,
            done: core::array::from_fn(|joint| {
                let order = memory.joints.get(joint).and_then(JointMemory::last_order);
                order.map_or(0, |order| order.number)
            }),
            points_seen: points.read().map_or(0, |latest| latest.sequence),
            points,
            refused_set_points: 0,
            restarts: 0,
            ticks: 0,
            report: cell.publisher(window)?,
            reported: None,
            controller,
            memory,
            words,
        };
        for joint in &memory.joints {
            joint.settle(&JointOutcome::NONE)?;
        }
        this.tell_status(0)?;
        Ok(this)
    }

    /// Does what messages have asked for since the last tick.
    #[inline]
    fn obey(&mut self, tell: &mut impl FnMut(&FingerRequest<N>)) {
        // Pairs with the handler's store, after all that belongs to the order.
        if let Ok(orders) = self.words.word(word::ORDERS)
            && orders != self.settled
        {
            self.obey_all(orders, tell);
        }
    }

    #[cold]
    fn obey_all(&mut self, orders: u32, tell: &mut impl FnMut(&FingerRequest<N>)) {
        if let Ok(asked) = self.words.word(word::RESTARTS)
            && asked != self.restarts_asked
        {
            self.restarts = self
                .restarts
                .wrapping_add(asked.wrapping_sub(self.restarts_asked));
            self.restarts_asked = asked;
            tell(&FingerRequest::Restart);
            self.controller.clear();
        }
        let memory = self.memory;
        let mut settled = true;
        for (number, joint) in memory.joints.iter().enumerate() {
            settled &= match joint.last_order() {
                Some(order) => self.obey_one(number, joint, &order, tell).is_some(),
                None => false,
            };
        }
        // Otherwise a later tick looks again.
        if settled {
            self.settled = orders;
        }
    }

    /// Does what is new in the orders of a joint; none if it could not tell.
    fn obey_one(
        &mut self,
        number: usize,
        joint: &JointMemory,
        order: &JointOrder,
        tell: &mut impl FnMut(&FingerRequest<N>),
    ) -> Option<()> {
        let done = self.done.get_mut(number)?;
        if order.number == *done {
            return Some(());
        }
        *done = order.number;
        let refusal = self.drive(number, order.drive, tell).err();
        let number = order.number;
        joint.settle(&JointOutcome { number, refusal }).ok()
    }

    fn drive(
        &mut self,
        joint: usize,
        drive: JointDrive,
        tell: &mut impl FnMut(&FingerRequest<N>),
    ) -> Result<(), ServoRefusal> {
        match drive {
            JointDrive::Mode(mode) => {
                tell(&FingerRequest::Mode { joint, mode });
                self.controller.set_mode(joint, mode)
            }
            JointDrive::Target(target) => {
                tell(&FingerRequest::Target { joint, target });
                self.controller.set_target(joint, target)
            }
            JointDrive::Effort { actuator, effort } => {
                let actuator = actuator as usize;
                if self.controller.joint_of(actuator) != Some(joint) {
                    let actuators = self.controller.actuators();
                    return Err(ServoRefusal::no_actuator(actuator, actuators));
                }
                tell(&FingerRequest::Effort { actuator, effort });
                self.controller.set_effort(actuator, effort)
            }
        }
    }

    /// Sets the master's next set-points in the controller.
    #[inline]
    fn follow(&mut self, tell: &mut impl FnMut(&FingerRequest<N>)) {
        if let Ok(latest) = self.points.read()
            && latest.sequence != self.points_seen
        {
            self.points_seen = latest.sequence;
            let points = latest.value.each_ref().map(JointPoint::point);
            let guards = latest.value.each_ref().map(JointPoint::guard);
            tell(&FingerRequest::Follow { points, guards });
            if self.controller.follow(&points, &guards).is_err() {
                self.refused_set_points = self.refused_set_points.wrapping_add(1);
            }
        }
    }

    /// Lets the handler know, if there is anything new.
    #[inline]
    fn tell(&mut self, tick: &FingerTick<N, A>) {
        self.ticks = self.ticks.wrapping_add(1);
        // Memory of the object's own is always there.
        let _ = self.words.set_word(word::TICKS, self.ticks);
        let _ = self.tell_status(tick.output.saturated);
    }

    fn tell_status(&mut self, saturated: u32) -> Result<(), AccessError> {
        let mut modes = Vec::new();
        for joint in 0..self.controller.joints() {
            // A finger has at most N joints.
            let _ = modes.push(self.controller.mode(joint).unwrap_or(ServoMode::Off));
        }
        let status = ServoStatus {
            modes,
            saturated,
            fault: self.controller.fault(),
            is_resting: self.controller.is_resting(),
            restarts: self.restarts,
            settled: self.settled,
            refused_set_points: self.refused_set_points,
            ticks: 0,
        };
        if self.reported.as_ref() != Some(&status) {
            // There is room for the longest one.
            self.report.publish(&Packet::of(&status))?;
            self.reported = Some(status);
        }
        Ok(())
    }
}

impl JointMemory {
    fn settle(&self, outcome: &JointOutcome) -> Result<(), AccessError> {
        let (cell, window) = self.outcome();
        // There is room for the longest one.
        let outcome = Packet::of(outcome);
        cell.publisher(window)?.publish(&outcome).map(|_| ())
    }
}

impl<M, T, W, const F: usize, const N: usize, const A: usize> FingerControllers<N>
    for HandLoop<'_, M, T, W, F, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
    W: MemoryWindow,
{
    type Controller = FingerController<M, T, N, A>;

    fn of_finger(&mut self, finger: usize) -> Option<&mut FingerController<M, T, N, A>> {
        self.controller_mut(finger)
    }
}
