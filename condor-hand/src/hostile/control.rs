//! A finger of the shipped hand with changed numbers, any calls of its controller, and any readings of its
//! sensors.

use crate::config::{Actuator, EffortFaults, InputChannel, Joint, ServoLaw};
use crate::controller::{FingerController, FingerTick};
use crate::dynamics::Dynamics;
use crate::fault::Fault;
use crate::servo::{EffortGains, FingerReadings, JointGains, JointTarget, PositionLaw, ServoMode};
use crate::trajectory::{SetPoint, StopGuard};
use crate::transmission::Linear;
use nalgebra::{SVector, Vector3};

use super::source::Source;
use super::{HAND, Shipped};

/// The greatest number of events of one run.
const EVENTS: usize = 200;

/// Runs a fuzz scenario: drives a simulated finger with the events that `bytes` describe, and
/// checks its commands and faults.
///
/// # Panics
/// Panics if a command leaves the range of its actuator, or a fault is forgotten.
pub fn run(bytes: &[u8]) {
    let mut source = Source::new(bytes);
    let mut hand = HAND.clone();
    let number = source.below(4);
    for _ in 0..source.byte() % 8 {
        let before = hand.clone();
        vary(&mut hand, number, &mut source);
        if hand.check().is_err() {
            hand = before;
        }
    }
    let finger = &hand.fingers[number];
    if source.byte().is_multiple_of(2) {
        if let Some(planar) = finger.planar() {
            drive(&hand, number, planar, &mut source);
        }
    } else {
        drive(&hand, number, finger.chain(), &mut source);
    }
}

/// Changes a number of the configuration.
fn vary(hand: &mut Shipped, finger: usize, source: &mut Source<'_>) {
    let joint = source.below(4);
    let kind = source.below(31);
    let of_finger = &mut hand.fingers[finger];
    let of_joint = &mut of_finger.joints[joint];
    let place: &mut f64 = match kind {
        0 => &mut hand.transition_s,
        1 => &mut hand.faults.safe_s,
        2 => &mut hand.faults.stale_s,
        3 => &mut hand.faults.tracking_rad,
        4 => &mut hand.faults.overtravel_rad,
        5 => {
            hand.servo_hz = (u32::from(source.byte()) * 50) << (source.byte() % 24);
            hand.trajectory_hz = hand.servo_hz / u32::from(source.byte().max(1));
            return;
        }
        6 => {
            let samples = u16::from_le_bytes([source.byte(), source.byte()]);
            hand.faults.effort_samples = samples;
            hand.faults.sensor_samples = samples;
            hand.faults.lost_samples = samples;
            hand.faults.tracking_samples = samples;
            hand.faults.missed_deadlines = samples;
            return;
        }
        7 => &mut hand.gravity[0],
        8..=29 => return vary_joint(of_joint, kind, source),
        _ => return vary_actuator(&mut of_finger.actuators[source.below(8)], source),
    };
    *place = source.number(*place);
}

fn vary_joint(joint: &mut Joint, kind: usize, source: &mut Source<'_>) {
    let place: &mut f64 = match kind {
        8 => &mut joint.limits.low,
        9 => &mut joint.limits.high,
        10 => &mut joint.limits.velocity,
        11 => &mut joint.limits.acceleration,
        12 => &mut joint.servo.kp,
        13 => &mut joint.servo.kv,
        14 => &mut joint.servo.ki,
        15 => &mut joint.servo.integral_max,
        16 => &mut joint.servo.bandwidth_hz,
        17 => &mut joint.servo.zeta,
        18 => &mut joint.servo.k_tau,
        19 => &mut joint.servo.velocity_cutoff_hz,
        20 => joint.servo.position_cutoff_hz.insert(50.0),
        21 => &mut joint.stop.zone,
        22 => &mut joint.stop.bandwidth_hz,
        23 => &mut joint.stop.damping_ratio,
        24 => &mut joint.friction.coulomb,
        25 => &mut joint.friction.coulomb_rate,
        26 => &mut joint.friction.armature,
        27 => match &mut joint.adc {
            Some(adc) => &mut adc.gain,
            None => return,
        },
        28 => {
            joint.servo.law = ServoLaw::Pd;
            return;
        }
        _ => match &mut joint.body {
            Some(body) => &mut body.mass_kg,
            None => return,
        },
    };
    *place = source.number(*place);
}

fn vary_actuator(actuator: &mut Actuator<4>, source: &mut Source<'_>) {
    let place = match source.below(13) {
        0 => &mut actuator.limits.low,
        1 => &mut actuator.limits.high,
        2 => actuator.limits.bias.insert(20.0),
        3 => actuator.faults.below.insert(1.0),
        4 => actuator.faults.above.insert(180.0),
        5 => &mut actuator.gains.kp,
        6 => &mut actuator.gains.ki,
        7 => &mut actuator.gains.kd,
        8 => &mut actuator.gains.kv,
        9 => match actuator.arms.iter_mut().next() {
            Some((_, arm)) => arm,
            None => return,
        },
        10 => {
            (actuator.adc, actuator.faults) = (None, EffortFaults::default());
            (actuator.gains, actuator.cutoff_hz) = (EffortGains::default(), None);
            return;
        }
        11 => actuator.cutoff_hz.insert(80.0),
        _ => {
            let encoder = InputChannel {
                board: 7,
                channel: source.byte(),
                bits: 16,
                gain: 1e-4,
                offset: -3.2768,
            };
            &mut actuator.encoder.insert(encoder).gain
        }
    };
    *place = source.number(*place);
}

/// A finger with its configuration, its readings and its present fault.
struct Subject<'h, M> {
    controller: FingerController<M, Linear<4, 8>, 4, 8>,
    hand: &'h Shipped,
    finger: usize,
    fault: Option<Fault>,
    sensed: FingerReadings<4, 8>,
}

fn drive<M: Dynamics<4>>(hand: &Shipped, finger: usize, mechanism: M, source: &mut Source<'_>) {
    let entry = &hand.fingers[finger];
    let transmission = entry.transmission().expect("the arms keep the rules");
    let controller = FingerController::new(hand, entry, mechanism, transmission)
        .expect("a hand that keeps the rules has controllers");
    let mut subject = Subject {
        controller,
        hand,
        finger,
        fault: None,
        sensed: FingerReadings {
            position: SVector::from([0.1, 0.6, 0.8, 0.7]),
            actuator_position: [0.0; 8],
            effort: entry.efforts_at_rest(),
            touch: 0.0,
        },
    };
    for _ in 0..EVENTS {
        if source.is_empty() {
            break;
        }
        subject.event(source);
    }
    for _ in 0..4 {
        subject.tick(source);
    }
}

impl<M: Dynamics<4>> Subject<'_, M> {
    fn event(&mut self, source: &mut Source<'_>) {
        let joint = source.below(5);
        let refused = match source.byte() % 14 {
            0 => ServoMode::ALL
                .get(usize::from(source.byte() % 6))
                .map(|&mode| self.controller.set_mode(joint, mode).is_err()),
            1 => {
                let target = target(source);
                Some(self.controller.set_target(joint, target).is_err())
            }
            2 => {
                self.set_gains(joint, source);
                None
            }
            3 => {
                let points = [(); 4].map(|()| SetPoint {
                    position: source.number(0.6),
                    velocity: source.number(0.1),
                    acceleration: source.number(0.1),
                });
                let guards = [(); 4].map(|()| StopGuard {
                    motion: u32::from(source.byte() % 3),
                    torque: source.number(0.1),
                    effort: source.number(10.0),
                    contact: source.byte() % 2 == 1,
                });
                let _ = self.controller.follow(&points, &guards);
                None
            }
            4 => {
                self.controller.clear();
                self.fault = None;
                assert_eq!(self.controller.fault(), None);
                None
            }
            5 => {
                self.break_sensor(source);
                None
            }
            6 => {
                let (actuator, effort) = (source.below(9), source.number(30.0));
                Some(self.controller.set_effort(actuator, effort).is_err())
            }
            7 => {
                self.set_effort_gains(source);
                None
            }
            _ => {
                for _ in 0..source.byte() % 64 {
                    self.tick(source);
                }
                None
            }
        };
        assert!(
            self.fault.is_none() || refused != Some(false),
            "a finger with a fault took an order"
        );
    }

    fn set_effort_gains(&mut self, source: &mut Source<'_>) {
        let actuator = source.below(9);
        let gains = EffortGains {
            kp: source.number(1.0),
            ki: source.number(1.0),
            kd: source.number(0.001),
            kv: source.number(1.0),
        };
        let before = self.controller.effort_gains(actuator).copied();
        if self.controller.set_effort_gains(actuator, &gains).is_err() {
            assert_eq!(self.controller.effort_gains(actuator).copied(), before);
        }
    }

    fn set_gains(&mut self, joint: usize, source: &mut Source<'_>) {
        let law = if source.byte().is_multiple_of(2) {
            PositionLaw::Pd {
                kp: source.number(1.0),
                kv: source.number(0.03),
                ki: source.number(1.0),
                integral_nm: source.number(0.1),
            }
        } else {
            PositionLaw::ComputedTorque {
                bandwidth_hz: source.number(10.0),
                damping_ratio: source.number(1.0),
            }
        };
        let gains = JointGains {
            law,
            k_torque: source.number(0.5),
        };
        let before = self.controller.gains(joint).copied();
        if self.controller.set_gains(joint, &gains).is_err() {
            assert_eq!(self.controller.gains(joint).copied(), before);
        }
    }

    /// Changes the reading of one of the sensors from now on.
    fn break_sensor(&mut self, source: &mut Source<'_>) {
        let joint = source.below(4);
        let place = match source.byte() % 5 {
            4 => &mut self.sensed.actuator_position[source.below(8)],
            3 => &mut self.sensed.touch,
            0 => &mut self.sensed.position[joint],
            _ => &mut self.sensed.effort[source.below(8)],
        };
        *place = source.number(*place);
    }

    fn tick(&mut self, source: &mut Source<'_>) {
        let gravity = Vector3::from(self.hand.gravity);
        let period_s = if source.byte() == 1 {
            source.number(0.0025)
        } else {
            1.0 / f64::from(self.hand.servo_hz)
        };
        let tick = self.controller.tick(&self.sensed, &gravity, period_s);
        self.judge(&tick);
    }

    fn judge(&mut self, tick: &FingerTick<4, 8>) {
        let entry = &self.hand.fingers[self.finger];
        for efforts in [&tick.output.command, &tick.output.effort] {
            for (effort, actuator) in efforts.iter().zip(&entry.actuators) {
                let (low, high) = actuator.limits().command_range();
                assert!((low..=high).contains(effort), "{tick:?}");
            }
        }
        let output = &tick.output;
        let vectors = [&output.torque, &output.position, &output.velocity];
        let mut values = vectors.into_iter().flatten();
        assert!(values.all(|value| value.is_finite()), "{tick:?}");
        for (target, joint) in tick.target.iter().zip(&entry.joints) {
            if let Some(target) = target {
                let limits = joint.limits.low..=joint.limits.high;
                assert!(limits.contains(target), "{target} of {limits:?}");
            }
        }
        if let Some(fault) = self.fault {
            let latched = tick.fault.is_some_and(|other| {
                (other.code, other.place) == (fault.code, fault.place)
                    && other.value.to_bits() == fault.value.to_bits()
            });
            assert!(latched, "{fault:?} became {:?}", tick.fault);
        }
        self.fault = tick.fault;
        assert_eq!(self.controller.fault().is_some(), self.fault.is_some());
    }
}

fn target(source: &mut Source<'_>) -> JointTarget {
    match source.byte() % 6 {
        0 => JointTarget::Off,
        1 => JointTarget::Effort,
        2 => JointTarget::Torque(source.number(0.3)),
        3 => JointTarget::Position(SetPoint {
            position: source.number(0.6),
            velocity: source.number(1.0),
            acceleration: source.number(1.0),
        }),
        4 => JointTarget::Grasp(source.number(0.3)),
        _ => JointTarget::Impedance {
            position: source.number(0.6),
            stiffness: source.number(0.1),
            damping: source.number(0.001),
        },
    }
}
