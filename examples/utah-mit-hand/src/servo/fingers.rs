//! [`Fingers`]: the servo loop.

use condor_hand::controller::{FingerController, Tick};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::message::{Asked, ServoLoop};
use condor_hand::servo::Sensed;
use condor_mbox::published::Publisher;
use condor_mbox::{Clock, Instant, MemoryWindow, Region};
use condor_mos::Writer;
use condor_rt::Machine;
use nalgebra::Vector3;

use super::control::{Control, Given, Servos};
use super::gains::Gains;
use super::news::News;
use super::{Tracker, Tracking, Variables};
use crate::boards::Wires;
use crate::grasp::{Felt, GraspEnd, Heard, Joints, Own, Partner};
use crate::recording::Recorder;
use crate::table::Palm;
use crate::{JOINTS, SERVED, UtahMit};

/// After such a time without one, s, an acceleration of the table counts as over.
const SILENT_S: f64 = 0.1;

/// Every which tick it is published how well the joints follow.
const TRACKING_TICKS: u64 = 16;

/// All that happens in a tick of the servo loop.
pub(super) struct Fingers<'r, M: Machine> {
    pub(super) hand: &'r UtahMit,
    pub(super) control: Control<'r>,
    pub(super) servos: ServoLoop<'r, PlanarFinger, M::Window, SERVED, JOINTS>,
    pub(super) variables: &'r Variables<'r>,
    pub(super) gains: &'r Gains<'r>,
    /// The version of the gains that the controllers have.
    pub(super) tuned: [u32; 2],
    pub(super) wires: Wires<'r, M::Bus>,
    pub(super) grasp: GraspEnd<'r, M::Window>,
    pub(super) palm: &'r Partner<M::Window>,
    pub(super) accelerated: Heard<Palm>,
    pub(super) joints: Publisher<Joints, Region<M::Window>>,
    pub(super) tracker: Tracker,
    pub(super) tracked: Publisher<Tracking, Region<M::Window>>,
    pub(super) clock: &'r M::Doorbell,
    pub(super) last: Option<Instant>,
    pub(super) period_s: f64,
    pub(super) ticks: u64,
    pub(super) recorder: Option<Recorder<'r, M::Window>>,
    pub(super) writer: Writer<'r, News>,
    pub(super) news: News,
}

impl<M: Machine> Fingers<'_, M> {
    pub(super) fn tick(&mut self) {
        let period_s = self.elapsed_s();
        self.wires.scan();
        let (wires, hand) = (&self.wires, self.hand);
        let mut measured = (self.control).measure(|_, channel| wires.read(hand, channel));
        measured.felt.believe(period_s, &mut self.servos);
        let acceleration = self.acceleration(period_s);
        self.publish(&measured.felt);
        let given = Given {
            period_s,
            acceleration,
            told: self.grasp.hear(period_s),
        };
        if let Some(recorder) = &mut self.recorder {
            let needs_partner = self.control.grasp().number() != 0;
            recorder.begin(&measured.inputs, &given, needs_partner);
        }
        let mut servos = Told {
            servos: &mut self.servos,
            recorder: self.recorder.as_mut(),
        };
        let version = self.gains.version();
        if version != self.tuned {
            self.tuned = version;
            servos.tune(self.gains);
        }
        let ticks = self.control.step(&measured, &given, &mut servos);
        self.grasp.tell(self.control.grasp().report());
        let wires = &mut self.wires;
        let output = (self.control).output(&ticks, |channel, counts| wires.write(channel, counts));
        self.wires.put();
        if let Some(recorder) = &mut self.recorder {
            recorder.end(&output);
        }
        self.track(&measured.sensed, &ticks);
        self.variables.show(&measured.sensed, &ticks);
        let news = News {
            faults: ticks.map(|tick| tick.fault),
            grasp: self.control.grasp().report().news(),
            failures: self.wires.failures(),
        };
        if news != self.news {
            self.news = news;
            self.writer.write(news);
        }
    }

    fn track(&mut self, sensed: &[Sensed<f64, JOINTS>; SERVED], ticks: &[Tick<JOINTS>; SERVED]) {
        for (place, (sensed, tick)) in sensed.iter().zip(ticks).enumerate() {
            self.tracker
                .add(place, &tick.target, sensed.position.iter());
        }
        if self.ticks.is_multiple_of(TRACKING_TICKS) {
            // Whoever reads finds the former one.
            let _ = self.tracked.publish(&self.tracker.tracking);
        }
    }

    /// The time since the last tick, s.
    fn elapsed_s(&mut self) -> f64 {
        let now = self.clock.now();
        let last = self.last.replace(now);
        self.ticks = self.ticks.wrapping_add(1);
        #[allow(clippy::cast_precision_loss, reason = "2^53 ns are a hundred days")]
        let since = last.map(|last| now.ns_since(last) as f64 * 1e-9);
        since.unwrap_or(self.period_s)
    }

    /// That of the palm, in its own axes, m/s²; none while the table is silent.
    fn acceleration(&mut self, elapsed_s: f64) -> [f64; 3] {
        self.palm.read(&mut self.accelerated, elapsed_s);
        let palm = self.accelerated.value;
        let palm = palm.filter(|_| self.accelerated.age_s <= SILENT_S);
        palm.map_or([0.0; 3], |palm| palm.acceleration)
    }

    fn publish(&mut self, felt: &Felt) {
        let joints = Joints {
            position: felt.position.map(Into::into),
            velocity: felt.velocity.map(Into::into),
            order: self.control.grasp().number(),
            ticks: self.ticks,
        };
        // Whoever reads finds the former ones, and notices that they are.
        let _ = self.joints.publish(&joints);
    }
}

/// The controllers, which messages tell what to do.
struct Told<'t, 'r, W> {
    servos: &'t mut ServoLoop<'r, PlanarFinger, W, SERVED, JOINTS>,
    recorder: Option<&'t mut Recorder<'r, W>>,
}

impl<W: MemoryWindow> Told<'_, '_, W> {
    /// Gives the joints the gains that have changed.
    #[cold]
    fn tune(&mut self, tuned: &Gains<'_>) {
        for (place, joint) in (0..SERVED).flat_map(|place| (0..JOINTS).map(move |it| (place, it))) {
            let (Some(controller), Some(gains)) =
                (self.servos.controller_mut(place), tuned.of(place, joint))
            else {
                continue;
            };
            // Gains within their bounds are accepted.
            if controller.gains(joint) != Some(&gains)
                && controller.set_gains(joint, &gains).is_ok()
                && let Some(recorder) = &mut self.recorder
            {
                recorder.asked(place, &Asked::Gains { joint, gains });
            }
        }
    }
}

impl<W: MemoryWindow> Own for Told<'_, '_, W> {
    fn finger(&mut self, place: usize) -> Option<&mut FingerController<PlanarFinger, JOINTS>> {
        self.servos.controller_mut(place)
    }
}

impl<W: MemoryWindow> Servos for Told<'_, '_, W> {
    fn tick(
        &mut self,
        place: usize,
        sensed: &Sensed<f64, JOINTS>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> Option<Tick<JOINTS>> {
        let Some(recorder) = &mut self.recorder else {
            return self.servos.tick(place, sensed, gravity, period_s);
        };
        self.servos
            .tick_telling(place, sensed, gravity, period_s, |asked| {
                recorder.asked(place, asked);
            })
    }
}
