//! [`Fingers`]: the servo loop.

use condor_hand::controller::{Tick, read_finger, write_finger};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::message::ServoLoop;
use condor_hand::monitor::Monitor;
use condor_hand::servo::{Sensed, ServoOutput};
use condor_hand::tendon::Pair;
use condor_host::Machine;
use condor_mbox::{Clock, Instant, Publisher, Region};
use condor_mos::Writer;
use nalgebra::{Vector3, Vector4};

use super::news::News;
use super::{Tracking, Variables};
use crate::boards::Wires;
use crate::grasp::{Felt, GraspLaw, Heard, Joints, Partner};
use crate::table::Palm;
use crate::{JOINTS, SERVED, UtahMit};

/// After so many ticks without one, an acceleration of the table counts as over.
const SILENT_TICKS: u32 = 40;

/// Every which tick it is published how well the joints follow.
const TRACKING_TICKS: u64 = 16;

/// All that happens in a tick of the servo loop.
pub(super) struct Fingers<'r, M: Machine> {
    pub(super) hand: &'r UtahMit,
    pub(super) served: [usize; SERVED],
    pub(super) servos: ServoLoop<'r, PlanarFinger, M::Window, SERVED, JOINTS>,
    pub(super) monitor: Monitor<'r, M::Window>,
    pub(super) wires: Wires<'r, M::Bus>,
    pub(super) grasp: GraspLaw<'r, M::Window>,
    pub(super) palm: &'r Partner<M::Window>,
    pub(super) accelerated: Heard<Palm>,
    pub(super) joints: Publisher<Joints, Region<M::Window>>,
    pub(super) tracking: Tracking,
    pub(super) tracked: Publisher<Tracking, Region<M::Window>>,
    /// Of the last tick, rad/s.
    pub(super) velocity: [Vector4<f64>; SERVED],
    pub(super) clock: &'r M::Doorbell,
    pub(super) last: Option<Instant>,
    pub(super) period_s: f64,
    pub(super) ticks: u64,
    pub(super) writer: Writer<'r, News>,
    pub(super) news: News,
}

impl<M: Machine> Fingers<'_, M> {
    pub(super) fn tick(&mut self) {
        let period_s = self.elapsed_s();
        self.wires.scan();
        let sensed = self.served.map(|finger| self.sensed(finger));
        let gravity = self.gravity();
        let felt = Felt {
            position: sensed.map(|sensed| sensed.position),
            velocity: self.velocity,
        };
        self.publish(&felt);
        self.grasp.step(&felt, &gravity, &mut self.servos);
        let mut place = 0;
        let ticks = sensed.map(|sensed| {
            let tick = self.servos.tick(place, &sensed, &gravity, period_s);
            place += 1;
            // There are as many fingers in the loop.
            tick.unwrap_or_else(nothing)
        });
        let places = self.served.iter().zip(&ticks).zip(&mut self.velocity);
        for ((&finger, tick), velocity) in places {
            *velocity = tick.output.velocity;
            if let Some(entry) = self.hand.fingers.get(finger) {
                let wires = &mut self.wires;
                write_finger(entry, &tick.output.command, |channel, counts| {
                    wires.write(channel, counts);
                });
            }
        }
        self.wires.put();
        self.track(&sensed, &ticks);
        // A row that cannot be written is missing in the ring, and nowhere else.
        let _ = self
            .monitor
            .tick(|number| Variables::word(number, &sensed, &ticks));
        let news = News {
            faults: ticks.map(|tick| tick.fault),
            grasp: self.grasp.report().news(),
            failures: self.wires.failures(),
        };
        if news != self.news {
            self.news = news;
            self.writer.write(news);
        }
    }

    fn track(&mut self, sensed: &[Sensed<f64, JOINTS>; SERVED], ticks: &[Tick<JOINTS>; SERVED]) {
        for (place, (sensed, tick)) in sensed.iter().zip(ticks).enumerate() {
            self.tracking
                .add(place, &tick.target, sensed.position.iter());
        }
        if self.ticks.is_multiple_of(TRACKING_TICKS) {
            // Whoever reads finds the former one.
            let _ = self.tracked.publish(&self.tracking);
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

    fn sensed(&self, finger: usize) -> Sensed<f64, JOINTS> {
        let none = Sensed {
            position: Vector4::repeat(f64::NAN),
            tension: [Pair::both(f64::NAN); JOINTS],
        };
        let entry = self.hand.fingers.get(finger);
        entry.map_or(none, |entry| {
            read_finger(entry, |channel| self.wires.read(self.hand, channel))
        })
    }

    /// In the axes of the palm, less its acceleration, m/s².
    fn gravity(&mut self) -> Vector3<f64> {
        self.palm.read(&mut self.accelerated);
        let gravity = Vector3::from(self.hand.gravity);
        let palm = self.accelerated.value;
        let palm = palm.filter(|_| self.accelerated.age <= SILENT_TICKS);
        let acceleration = palm.map_or([0.0; 3], |palm| palm.acceleration);
        if acceleration.iter().all(|part| part.is_finite()) {
            gravity - Vector3::from(acceleration)
        } else {
            gravity
        }
    }

    fn publish(&mut self, felt: &Felt) {
        let joints = Joints {
            position: felt.position.map(Into::into),
            velocity: felt.velocity.map(Into::into),
            order: self.grasp.number(),
            ticks: self.ticks,
        };
        // Whoever reads finds the former ones, and notices that they are.
        let _ = self.joints.publish(&joints);
    }
}

/// What a finger that there is not does.
fn nothing() -> Tick<JOINTS> {
    Tick {
        output: ServoOutput {
            command: [Pair::both(0.0); JOINTS],
            tension: [Pair::both(0.0); JOINTS],
            torque: Vector4::zeros(),
            position: Vector4::zeros(),
            velocity: Vector4::zeros(),
            saturated: 0,
        },
        target: [None; JOINTS],
        fault: None,
    }
}
