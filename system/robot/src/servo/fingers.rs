//! [`Fingers`]: the servo loop.

use condor_hand::controller::{FingerController, FingerTick};
use condor_hand::grasp::distributed::{FingerControllers, GraspInputs, HandJoints};
use condor_hand::servo::FingerReadings;
use condor_mbox::published::Publisher;
use condor_mbox::{Clock, Instant, MemoryWindow, Region};
use condor_mos::LatestWriter;
use condor_rt::Machine;
use nalgebra::Vector3;
use zerocopy::IntoBytes;

use super::control::{Control, OfFingers, Servos};
use super::feeling::Feeling;
use super::gains::Gains;
use super::news::LoopNews;
use super::numbers::ServoNumbers;
use super::{Tracker, Tracking, Variables};
use crate::boards::Wires;
use crate::desired::DesiredPositions;
use crate::grasp::{Joints, Partner, PartnerState};
use crate::guards::{Felt, Stops};
use crate::message::{FingerRequest, GraspEnd, HandLoop};
use crate::numbers::NumberPlace;
use crate::recording::{Recorder, TickInputs};
use crate::table::Palm;
use crate::{ACTUATORS, Actuators, FINGERS, JOINTS, Mechanism};

/// After such a time without one, s, an acceleration of the table counts as over.
const SILENT_S: f64 = 0.1;

/// After such a time without joints of theirs, s, another servo processor is silent.
const PARTNER_SILENT_S: f64 = 0.021;

/// Every which tick it is published how well the joints follow.
const TRACKING_TICKS: u64 = 16;

/// All that happens in a tick of the servo loop.
pub(super) struct Fingers<'r, M: Machine> {
    pub(super) control: Control<'r>,
    pub(super) servos: HandLoop<'r, Mechanism, Actuators, M::Window, FINGERS, JOINTS, ACTUATORS>,
    pub(super) variables: &'r Variables<'r>,
    pub(super) gains: &'r Gains<'r>,
    pub(super) numbers: &'r ServoNumbers<'r>,
    /// The versions of the gains and numbers that the controllers have.
    pub(super) tuned: ([u32; 3], [u32; 4]),
    pub(super) wires: &'r mut dyn Wires,
    pub(super) grasp: GraspEnd<M::Window>,
    pub(super) partners: &'r [Partner<M::Window>],
    pub(super) states: [PartnerState<Joints>; FINGERS],
    pub(super) palm: &'r Partner<M::Window>,
    pub(super) accelerated: PartnerState<Palm>,
    pub(super) wanted: &'r Partner<M::Window>,
    pub(super) motion: PartnerState<DesiredPositions>,
    pub(super) joints: Publisher<Joints, Region<M::Window>>,
    pub(super) tracker: Tracker,
    pub(super) tracked: Publisher<Tracking, Region<M::Window>>,
    pub(super) feeling: Feeling,
    pub(super) felt: Publisher<Felt, Region<M::Window>>,
    pub(super) stops: Publisher<Stops, Region<M::Window>>,
    pub(super) clock: &'r M::Doorbell,
    pub(super) last: Option<Instant>,
    pub(super) ticks: u64,
    pub(super) period_s: f64,
    pub(super) recorder: Option<Recorder<'r, M::Window>>,
    pub(super) writer: LatestWriter<'r, LoopNews>,
    pub(super) news: LoopNews,
}

impl<M: Machine> Fingers<'_, M> {
    /// One tick, which was due at an instant of the processor's clock.
    pub(super) fn tick(&mut self, due: Instant) {
        let (due_ns, period_s) = (due.as_ns(), self.elapsed_s());
        self.wires.scan();
        let wires = &*self.wires;
        let measured =
            (self.control).measure(period_s, &mut self.servos, |_, channel| wires.read(channel));
        let acceleration = self.acceleration(due_ns, period_s);
        self.ticks += 1;
        // After an error readers find the former values, and notice their age.
        let _ = (self.joints).publish(&Joints::new(&measured.joints, due_ns, self.ticks));
        let given = TickInputs {
            period_s,
            acceleration,
            grasp: GraspInputs {
                others: self.others(due_ns, period_s),
                order: self.grasp.order(),
            },
        };
        if let Some(recorder) = &mut self.recorder {
            let needs_others = measured.joints.order != [0; FINGERS];
            recorder.begin(&measured.inputs, &given, needs_others);
        }
        let mut servos = FingerCommands {
            servos: &mut self.servos,
            recorder: self.recorder.as_mut(),
        };
        let version = (self.gains.version(), self.numbers.version());
        if version != self.tuned {
            self.tuned = version;
            servos.tune(self.gains);
            servos.set_numbers(self.numbers);
        }
        let ticks = self.control.step(&measured, &given, &mut servos);
        self.grasp.tell(self.control.grasp().report());
        let wires = &mut *self.wires;
        let output = (self.control).output(&ticks, |channel, counts| wires.write(channel, counts));
        self.wires.put();
        if let Some(recorder) = &mut self.recorder {
            recorder.end(&output);
        }
        self.wanted.read(&mut self.motion, period_s);
        let motion = self.motion.value.map_or(0, |wanted| wanted.motion);
        let is_new = self.tracker.set_motion(motion);
        self.track(&measured.sensed, &ticks);
        if is_new || self.ticks.is_multiple_of(TRACKING_TICKS) {
            // After an error the reader finds the former value.
            let _ = self.tracked.publish(&self.tracker.tracking);
        }
        self.feel(&measured.sensed, &ticks);
        self.variables.show(&measured.sensed, &ticks);
        let news = LoopNews {
            faults: ticks.map(|tick| tick.and_then(|tick| tick.fault)),
            grasp: self.control.grasp().report().event(),
            failures: self.wires.failures(),
        };
        if news != self.news {
            self.news = news;
            self.writer.write(news);
        }
    }

    fn track(
        &mut self,
        sensed: &OfFingers<FingerReadings<JOINTS, ACTUATORS>>,
        ticks: &OfFingers<FingerTick<JOINTS, ACTUATORS>>,
    ) {
        for (finger, (sensed, tick)) in sensed.iter().zip(ticks).enumerate() {
            if let (Some(sensed), Some(tick)) = (sensed, tick) {
                self.tracker
                    .add(finger, &tick.target, sensed.position.iter());
            }
        }
    }

    /// Tells the master what guards are about.
    fn feel(
        &mut self,
        sensed: &OfFingers<FingerReadings<JOINTS, ACTUATORS>>,
        ticks: &OfFingers<FingerTick<JOINTS, ACTUATORS>>,
    ) {
        let mut stops = Stops::none();
        self.feeling.tick();
        for (finger, (sensed, tick)) in sensed.iter().zip(ticks).enumerate() {
            let (Some(sensed), Some(tick), Some(controller)) =
                (sensed, tick, self.servos.controller(finger))
            else {
                continue;
            };
            let (effort, touch) = (&tick.effort, sensed.touch);
            self.feeling.add(finger, effort, touch, controller.linear());
            for joint in 0..JOINTS {
                if let Some(stop) = controller.stop(joint) {
                    stops.add(finger, joint, stop);
                }
            }
        }
        // After an error the reader finds the former values.
        let _ = self.felt.publish(&self.feeling.felt(self.ticks));
        if stops.as_bytes() != self.feeling.stopped.as_bytes() && self.stops.publish(&stops).is_ok()
        {
            self.feeling.stopped = stops;
        }
    }

    /// The time since the last tick, s.
    fn elapsed_s(&mut self) -> f64 {
        let now = self.clock.now();
        let last = self.last.replace(now);
        #[allow(clippy::cast_precision_loss, reason = "2^53 ns are a hundred days")]
        let since = last.map(|last| now.ns_since(last) as f64 * 1e-9);
        since.unwrap_or(self.period_s)
    }

    /// The joints of the tick before on other processors, without those that are silent.
    fn others(&mut self, due_ns: u64, elapsed_s: f64) -> Option<HandJoints<FINGERS, JOINTS>> {
        let mut others = None;
        for (partner, state) in self.partners.iter().zip(&mut self.states) {
            partner.read(state, elapsed_s);
            if state.age_s <= PARTNER_SILENT_S
                && let Some(joints) = state.before(due_ns, self.period_s)
            {
                let others = others.get_or_insert(HandJoints::NONE);
                others.add(&joints.of_hand());
            }
        }
        others
    }

    /// That of the palm, in its own axes, m/s²; none while the table is silent.
    fn acceleration(&mut self, due_ns: u64, elapsed_s: f64) -> [f64; 3] {
        self.palm.read(&mut self.accelerated, elapsed_s);
        let palm = self.accelerated.before(due_ns, self.period_s);
        let palm = palm.filter(|_| self.accelerated.age_s <= SILENT_S);
        palm.map_or([0.0; 3], |palm| palm.acceleration)
    }
}

/// The controllers, which messages tell what to do.
struct FingerCommands<'t, 'r, W> {
    servos: &'t mut HandLoop<'r, Mechanism, Actuators, W, FINGERS, JOINTS, ACTUATORS>,
    recorder: Option<&'t mut Recorder<'r, W>>,
}

impl<W: MemoryWindow> FingerCommands<'_, '_, W> {
    /// Sets the gains of the joints and actuators that have changed.
    #[cold]
    fn tune(&mut self, tuned: &Gains<'_>) {
        let mut place = 0;
        for finger in 0..FINGERS {
            let Some(controller) = self.servos.controller_mut(finger) else {
                continue;
            };
            for joint in 0..JOINTS {
                let Some(gains) = tuned.of(place, joint) else {
                    continue;
                };
                // Gains within their bounds are accepted.
                if controller.gains(joint) != Some(&gains)
                    && controller.set_gains(joint, &gains).is_ok()
                    && let Some(recorder) = &mut self.recorder
                {
                    recorder.request(finger, &FingerRequest::Gains { joint, gains });
                }
            }
            for actuator in 0..ACTUATORS {
                let Some(gains) = tuned.of_actuator(place, actuator) else {
                    continue;
                };
                if controller.effort_gains(actuator) != Some(&gains)
                    && controller.set_effort_gains(actuator, &gains).is_ok()
                    && let Some(recorder) = &mut self.recorder
                {
                    let request = FingerRequest::EffortGains { actuator, gains };
                    recorder.request(finger, &request);
                }
            }
            place += 1;
        }
    }

    /// Sets the limits, filters and conditions of faults that have changed.
    #[cold]
    fn set_numbers(&mut self, numbers: &ServoNumbers<'_>) {
        for (place, value) in numbers.joints.present() {
            let NumberPlace::Joint(finger, joint, number) = place else {
                continue;
            };
            let (finger, joint) = (usize::from(finger), usize::from(joint));
            // Numbers within their ranges are accepted.
            if let Some(controller) = self.servos.controller_mut(finger)
                && controller.number(joint, number) != Some(value)
                && controller.set_number(joint, number, value).is_ok()
                && let Some(recorder) = &mut self.recorder
            {
                let request = FingerRequest::Number {
                    joint,
                    number,
                    value,
                };
                recorder.request(finger, &request);
            }
        }
        for (place, value) in numbers.actuators.present() {
            let NumberPlace::Actuator(finger, actuator, number) = place else {
                continue;
            };
            let (finger, actuator) = (usize::from(finger), usize::from(actuator));
            if let Some(controller) = self.servos.controller_mut(finger)
                && controller.actuator_number(actuator, number) != Some(value)
                && controller
                    .set_actuator_number(actuator, number, value)
                    .is_ok()
                && let Some(recorder) = &mut self.recorder
            {
                let request = FingerRequest::ActuatorNumber {
                    actuator,
                    number,
                    value,
                };
                recorder.request(finger, &request);
            }
        }
        for (number, value) in numbers.faults() {
            for finger in 0..FINGERS {
                if let Some(controller) = self.servos.controller_mut(finger)
                    && controller.faults().number(number).to_bits() != value.to_bits()
                    && controller.set_fault_number(number, value).is_ok()
                    && let Some(recorder) = &mut self.recorder
                {
                    recorder.request(finger, &FingerRequest::Fault { number, value });
                }
            }
        }
    }
}

impl<W: MemoryWindow> FingerControllers<JOINTS> for FingerCommands<'_, '_, W> {
    type Controller = FingerController<Mechanism, Actuators, JOINTS, ACTUATORS>;

    fn of_finger(&mut self, finger: usize) -> Option<&mut Self::Controller> {
        self.servos.controller_mut(finger)
    }
}

impl<W: MemoryWindow> Servos for FingerCommands<'_, '_, W> {
    fn tick(
        &mut self,
        finger: usize,
        sensed: &FingerReadings<JOINTS, ACTUATORS>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> Option<FingerTick<JOINTS, ACTUATORS>> {
        let Some(recorder) = &mut self.recorder else {
            return self.servos.tick(finger, sensed, gravity, period_s);
        };
        self.servos
            .tick_telling(finger, sensed, gravity, period_s, |request| {
                recorder.request(finger, request);
            })
    }
}
