use nalgebra::SVector;

use crate::config::{
    Actuator, ActuatorNumber, ActuatorNumbers, FaultPolicy, Finger, InputChannel, Joint,
    JointNumber, JointNumbers, ServoLaw,
};
use crate::dynamics::DriveDynamics;
use crate::fault::{
    ActuatorFaultLimits, EncoderFaultLimits, FaultLimits, FaultRange, JointFaultLimits, Plausible,
    SensorFaultLimits, Stuck, Threshold,
};
use crate::list::list;
use crate::math::{abs, max, min};
use crate::servo::{
    ActuatorSettings, FingerSettings, JointCutoffs, JointGains, JointSettings, PositionLaw,
    SoftStop,
};

/// A sensor of this many counts moves by noise.
const NOISE_COUNTS: f64 = 1.5;

/// A sensor that shows no change while its joint goes by this many counts is frozen.
const FROZEN_COUNTS: f64 = 4.0;

/// From one tick to the next the rate of a joint changes by at most this many times its limit.
const PLAUSIBLE_RATE: f64 = 2.0;

impl<const N: usize, const A: usize> Finger<N, A> {
    /// Returns the settings from which the finger's servos are made. `sample_hz` is the number of
    /// servo ticks per second. `transition_s` is the time over which a step of efforts is spread,
    /// s.
    #[must_use]
    pub fn settings(&self, sample_hz: f64, transition_s: f64) -> FingerSettings<N, A> {
        let resolutions = self.resolutions();
        let joints = self.joints.iter().zip(&resolutions);
        FingerSettings {
            joints: list(joints.map(|(joint, resolution)| joint.settings(*resolution))),
            actuators: list(self.actuators.iter().map(Actuator::settings)),
            drive: DriveDynamics {
                armature: self.each(|joint| joint.friction.armature),
                viscous: self.each(|joint| joint.friction.viscous),
                coulomb: self.each(|joint| joint.friction.coulomb),
                coulomb_rate: self.each(|joint| joint.friction.coulomb_rate),
            },
            sample_hz,
            transition_s,
        }
    }

    /// Returns the limits beyond which the finger has a fault, from its configuration and from
    /// `policy`. `sample_hz` is the number of servo ticks per second.
    #[must_use]
    pub fn fault_limits(&self, policy: &FaultPolicy, sample_hz: f64) -> FaultLimits<N, A> {
        let actuator = |actuator: &Actuator<N>| {
            let (low, high) = (actuator.limits.low, actuator.limits.high);
            let adc = actuator.adc.as_ref();
            let travel = max(abs(low), abs(high)) / 4.0;
            ActuatorFaultLimits {
                sensor: adc.map(|adc| sensor(adc, travel)).unwrap_or_default(),
                ..ActuatorFaultLimits::default()
            }
        };
        let resolutions = self.resolutions();
        let joint = |place: usize, joint: &Joint| {
            let resolution = resolutions.get(place).copied().unwrap_or(0.0);
            let sensor = match &joint.adc {
                Some(adc) => sensor(adc, 0.0),
                None => SensorFaultLimits {
                    range: FaultRange {
                        low: -f64::MAX,
                        high: f64::MAX,
                        samples: 0,
                    },
                    stuck: Stuck {
                        band: NOISE_COUNTS * resolution,
                        travel: 0.0,
                        samples: 0,
                    },
                    ..SensorFaultLimits::default()
                },
            };
            JointFaultLimits {
                sensor: SensorFaultLimits {
                    plausible: finite(joint.plausible(resolution)),
                    ..sensor
                },
                ..JointFaultLimits::default()
            }
        };
        let mut limits = FaultLimits {
            actuators: core::array::from_fn(|place| {
                (self.actuators.get(place))
                    .map(actuator)
                    .unwrap_or_default()
            }),
            encoders: self.encoder_limits(&resolutions),
            joints: core::array::from_fn(|place| {
                let of_joint = self.joints.get(place).map(|it| joint(place, it));
                of_joint.unwrap_or_default()
            }),
            period_s: Threshold {
                value: 1.5 / sample_hz,
                samples: policy.missed_deadlines,
            },
            set_point_age_s: Threshold {
                value: policy.stale_s,
                samples: 1,
            },
        };
        let (joints, actuators) = (self.numbers(), self.actuator_numbers());
        judge(&mut limits, policy, &joints, &actuators);
        limits
    }

    /// Returns the limits of the sensors of actuators' positions that do not depend on a policy; `None` for actuators
    /// without one, and for those from which no joint is computed.
    fn encoder_limits(&self, resolutions: &SVector<f64, N>) -> [Option<EncoderFaultLimits>; A] {
        if self.joints.iter().all(|joint| joint.adc.is_some()) {
            return [None; A];
        }
        let sensing = self.position_sensing();
        core::array::from_fn(|place| {
            let (Ok(sensing), Some(actuator)) = (&sensing, self.actuators.get(place)) else {
                return None;
            };
            let mut limits = EncoderFaultLimits {
                sensor: sensor(&actuator.encoder?, 0.0),
                tells: 0,
                arms: 0.0,
            };
            // A jump that is too large for one of its joints.
            limits.sensor.plausible.rate_change = f64::MAX;
            for (number, (joint, resolution)) in self.joints.iter().zip(resolutions).enumerate() {
                let arm = abs(self.arm(actuator, joint));
                let possible = joint.plausible(*resolution);
                let of_actuator = &mut limits.sensor.plausible;
                limits.arms += arm;
                of_actuator.travel += arm * possible.travel;
                let part = abs(sensing.part(number, place));
                if part > 0.0 {
                    limits.tells |= 1 << number;
                    of_actuator.rate_change =
                        min(of_actuator.rate_change, possible.rate_change / part);
                }
            }
            limits.sensor.plausible = finite(limits.sensor.plausible);
            Some(limits).filter(|limits| limits.tells != 0)
        })
    }

    /// Returns what the sensors tell apart of the positions of the joints, rad, or m for a sliding joint.
    fn resolutions(&self) -> SVector<f64, N> {
        let gain = |input: Option<InputChannel>| input.map_or(0.0, |input| abs(input.gain));
        let joints = self.each(|joint| gain(joint.adc));
        if self.joints.iter().all(|joint| joint.adc.is_some()) {
            return joints;
        }
        let actuator = |place: usize| gain(self.actuators.get(place).and_then(|it| it.encoder));
        let sensing = self.position_sensing();
        sensing.map_or(joints, |sensing| {
            sensing.resolutions(&joints.into(), &core::array::from_fn(actuator))
        })
    }

    /// Returns the numbers of the joints that can change while they run; `None` for joints that do not exist.
    pub(super) fn numbers(&self) -> [Option<JointNumbers>; N] {
        core::array::from_fn(|place| self.joints.get(place).map(Joint::numbers))
    }

    /// Returns the numbers of the actuators that can change while they run; `None` for actuators without a sensor, or
    /// that do not exist.
    pub(super) fn actuator_numbers(&self) -> [Option<ActuatorNumbers>; A] {
        core::array::from_fn(|place| {
            let actuator = self.actuators.get(place)?;
            actuator.adc?;
            Some(actuator.numbers())
        })
    }
}

/// Sets what a policy, and the numbers of the joints and actuators, say of the limits of a finger. All checks stay off
/// for those without numbers.
pub(super) fn judge<const N: usize, const A: usize>(
    limits: &mut FaultLimits<N, A>,
    policy: &FaultPolicy,
    joints: &[Option<JointNumbers>; N],
    actuators: &[Option<ActuatorNumbers>; A],
) {
    for (limits, numbers) in limits.actuators.iter_mut().zip(actuators) {
        let Some(numbers) = numbers else { continue };
        let number = |number: ActuatorNumber| numbers.get(number as usize).copied().flatten();
        limits.sensor.lost_samples = policy.lost_samples;
        limits.sensor.range.samples = policy.sensor_samples;
        limits.sensor.stuck.samples = policy.sensor_samples;
        limits.effort = FaultRange {
            low: number(ActuatorNumber::Below).unwrap_or(-f64::MAX),
            high: number(ActuatorNumber::Above).unwrap_or(f64::MAX),
            samples: policy.effort_samples,
        };
    }
    for limits in limits.encoders.iter_mut().flatten() {
        let sensor = &mut limits.sensor;
        sensor.lost_samples = policy.lost_samples;
        sensor.range.samples = policy.sensor_samples;
        sensor.stuck.travel = limits.arms * policy.frozen_rad;
        sensor.stuck.samples = policy.lost_samples;
    }
    for (of_joint, numbers) in limits.joints.iter_mut().zip(joints) {
        let Some(numbers) = numbers else { continue };
        let number = |number: JointNumber| numbers.get(number as usize).copied().unwrap_or(0.0);
        let sensor = &mut of_joint.sensor;
        sensor.lost_samples = policy.lost_samples;
        sensor.range.samples = policy.sensor_samples;
        sensor.stuck.travel = policy.frozen_rad;
        sensor.stuck.samples = policy.lost_samples;
        sensor.tracking = Threshold {
            value: policy.tracking_rad,
            samples: policy.tracking_samples,
        };
        of_joint.limit = FaultRange {
            low: number(JointNumber::Low) - policy.overtravel_rad,
            high: number(JointNumber::High) + policy.overtravel_rad,
            samples: policy.sensor_samples,
        };
    }
    limits.period_s.samples = policy.missed_deadlines;
    limits.set_point_age_s.value = policy.stale_s;
}

/// Returns the stop of a joint with these numbers, without its damping, and the cutoffs of its filters.
pub(super) fn stop_and_filters(numbers: &JointNumbers) -> (SoftStop, JointCutoffs) {
    let number = |number: JointNumber| numbers.get(number as usize).copied().unwrap_or(0.0);
    let filter = |cutoff| Some(number(cutoff)).filter(|&cutoff_hz| cutoff_hz > 0.0);
    let stop = SoftStop {
        low: number(JointNumber::Low),
        high: number(JointNumber::High),
        zone: number(JointNumber::Zone),
        bandwidth_hz: number(JointNumber::StopBandwidth),
        damping_ratio: 0.0,
    };
    let cutoffs_hz = JointCutoffs {
        position: filter(JointNumber::PositionCutoff),
        velocity: number(JointNumber::VelocityCutoff),
    };
    (stop, cutoffs_hz)
}

/// Returns limits that are finite: friction holds a joint without gains anywhere.
fn finite(possible: Plausible) -> Plausible {
    Plausible {
        rate_change: min(possible.rate_change, f64::MAX),
        travel: min(possible.travel, f64::MAX),
    }
}

/// Returns the limits of the sensor behind a converter that do not depend on a policy. It is stuck if it stays while
/// its set-point goes this far.
fn sensor(input: &InputChannel, travel: f64) -> SensorFaultLimits {
    let ends = [input.value(0), input.value(input.full_scale())];
    SensorFaultLimits {
        range: FaultRange {
            low: min(ends[0], ends[1]),
            high: max(ends[0], ends[1]),
            samples: 0,
        },
        stuck: Stuck {
            band: NOISE_COUNTS * abs(input.gain),
            travel,
            samples: 0,
        },
        ..SensorFaultLimits::default()
    }
}

impl Joint {
    /// The settings of the joint's servo, of which sensors tell so much apart, rad, or m for a sliding joint.
    fn settings(&self, resolution: f64) -> JointSettings {
        let joint = self;
        let servo = &joint.servo;
        let possible = joint.plausible(resolution);
        JointSettings {
            gains: JointGains {
                law: match servo.law {
                    ServoLaw::Pd => PositionLaw::Pd {
                        kp: servo.kp,
                        kv: servo.kv,
                        ki: servo.ki,
                        integral_nm: servo.integral_max,
                    },
                    ServoLaw::Decoupled => PositionLaw::ComputedTorque {
                        bandwidth_hz: servo.bandwidth_hz,
                        damping_ratio: servo.zeta,
                    },
                },
                k_torque: servo.k_tau,
            },
            stop: SoftStop {
                low: joint.limits.low,
                high: joint.limits.high,
                zone: joint.stop.zone,
                bandwidth_hz: joint.stop.bandwidth_hz,
                damping_ratio: joint.stop.damping_ratio,
            },
            rate_change: possible.rate_change,
            resolution_rad: resolution,
            frozen_rad: possible.travel,
            position_cutoff_hz: servo.position_cutoff_hz,
            velocity_cutoff_hz: servo.velocity_cutoff_hz,
        }
    }

    /// Returns the limits within which readings of the joint are possible if sensors tell so much apart, rad, or m for a
    /// sliding joint.
    fn plausible(&self, resolution: f64) -> Plausible {
        let servo = &self.servo;
        // The distance from its set-point at which friction can hold a joint that has nothing but its drive.
        let w = core::f64::consts::TAU * servo.bandwidth_hz;
        let held_rad = match (self.friction.coulomb, servo.law) {
            (0.0, _) => 0.0,
            (coulomb, ServoLaw::Pd) => coulomb / servo.kp,
            (coulomb, ServoLaw::Decoupled) => coulomb / (self.friction.armature * w * w),
        };
        Plausible {
            rate_change: PLAUSIBLE_RATE * self.limits.velocity,
            travel: FROZEN_COUNTS * resolution + 2.0 * held_rad,
        }
    }
}

impl<const N: usize> Actuator<N> {
    /// The settings of the actuator's servo.
    fn settings(&self) -> ActuatorSettings {
        ActuatorSettings {
            gains: self.gains,
            is_sensed: self.adc.is_some(),
            cutoff_hz: self.cutoff_hz,
        }
    }
}
