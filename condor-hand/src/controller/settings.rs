use crate::config::{
    FaultPolicy, Finger, InputChannel, Joint, JointNumber, JointNumbers, ServoLaw, Tendon,
};
use crate::dynamics::DriveDynamics;
use crate::servo::{
    FingerSettings, JointCutoffs, JointGains, JointSettings, PositionLaw, SoftStop,
};
use crate::tendon::fault::{
    FaultLimits, FaultRange, JointFaultLimits, SensorFaultLimits, Stuck, TendonFaultLimits,
    Threshold,
};
use crate::tendon::{Pair, TensionGains};

/// A sensor of this many counts moves by noise.
const NOISE_COUNTS: f64 = 1.5;

/// A sensor that shows no change while its joint goes by this many counts is frozen.
const FROZEN_COUNTS: f64 = 4.0;

/// From one tick to the next the rate of a joint changes by at most this many times its limit.
const PLAUSIBLE_RATE: f64 = 2.0;

impl<const N: usize> Finger<N> {
    /// Returns the settings from which the finger's servos are made. `sample_hz` is the number of
    /// servo ticks per second. `transition_s` is the time over which a step of tensions is spread,
    /// s.
    ///
    /// If the finger has fewer than `N` joints, the settings of the missing ones keep them still
    /// and without tension.
    #[must_use]
    pub fn settings(&self, sample_hz: f64, transition_s: f64) -> FingerSettings<N> {
        FingerSettings {
            joints: core::array::from_fn(|joint| {
                self.joints
                    .get(joint)
                    .map_or(absent(sample_hz), Joint::settings)
            }),
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
    pub fn fault_limits(&self, policy: &FaultPolicy, sample_hz: f64) -> FaultLimits<N> {
        let tendon = |tendon: &Tendon| TendonFaultLimits {
            sensor: sensor(&tendon.adc, tendon.max_n / 4.0),
            ..TendonFaultLimits::default()
        };
        let joint = |joint: &Joint<N>| JointFaultLimits {
            sensor: sensor(&joint.adc, 0.0),
            ..JointFaultLimits::default()
        };
        let mut limits = FaultLimits {
            tendons: core::array::from_fn(|place| {
                let pair = self.joints.get(place).map(|joint| Pair {
                    flexor: tendon(&joint.flexor),
                    extensor: tendon(&joint.extensor),
                });
                pair.unwrap_or_default()
            }),
            joints: core::array::from_fn(|place| {
                self.joints.get(place).map(joint).unwrap_or_default()
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
        let joints = self.joints.iter().map(Joint::numbers);
        judge(&mut limits, policy, joints);
        limits
    }

    /// Returns the numbers of the joints that can change while they run; zeros for joints that do not exist.
    pub(super) fn numbers(&self) -> [JointNumbers; N] {
        core::array::from_fn(|place| {
            let joint = self.joints.get(place);
            joint.map_or([0.0; JointNumber::ALL.len()], Joint::numbers)
        })
    }

    /// Returns the least tensions that the finger's tendons always keep, N. Elements without a joint are zero.
    #[must_use]
    pub fn least_tensions(&self) -> [Pair<f64>; N] {
        core::array::from_fn(|joint| {
            let joint = self.joints.get(joint);
            joint.map_or(Pair::both(0.0), |joint| Pair {
                flexor: joint.flexor.min_n,
                extensor: joint.extensor.min_n,
            })
        })
    }
}

/// Sets what a policy, and the numbers of the joints that exist, say of the limits of a finger. All checks stay off for
/// joints that do not exist.
pub(super) fn judge<const N: usize>(
    limits: &mut FaultLimits<N>,
    policy: &FaultPolicy,
    joints: impl Iterator<Item = JointNumbers>,
) {
    let places = limits.tendons.iter_mut().zip(&mut limits.joints);
    for ((tendons, of_joint), numbers) in places.zip(joints) {
        let number = |number: JointNumber| numbers.get(number as usize).copied().unwrap_or(0.0);
        let thresholds = [
            (JointNumber::FlexorSlack, JointNumber::FlexorBreak),
            (JointNumber::ExtensorSlack, JointNumber::ExtensorBreak),
        ];
        let tendons = [&mut tendons.flexor, &mut tendons.extensor];
        for (tendon, (slack, breaks)) in tendons.into_iter().zip(thresholds) {
            tendon.sensor.lost_samples = policy.lost_samples;
            tendon.sensor.range.samples = policy.sensor_samples;
            tendon.sensor.stuck.samples = policy.sensor_samples;
            let samples = policy.tension_samples;
            let threshold = |value| Threshold { value, samples };
            (tendon.slack, tendon.over_tension) =
                (threshold(number(slack)), threshold(number(breaks)));
        }
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
        tension: Pair {
            flexor: filter(JointNumber::FlexorCutoff),
            extensor: filter(JointNumber::ExtensorCutoff),
        },
    };
    (stop, cutoffs_hz)
}

/// Returns the limits of the sensor behind a converter that do not depend on a policy. It is stuck if it stays while
/// its set-point goes this far.
fn sensor(input: &InputChannel, travel: f64) -> SensorFaultLimits {
    let ends = [input.value(0), input.value(input.full_scale())];
    SensorFaultLimits {
        range: FaultRange {
            low: crate::math::min(ends[0], ends[1]),
            high: crate::math::max(ends[0], ends[1]),
            samples: 0,
        },
        stuck: Stuck {
            band: NOISE_COUNTS * crate::math::abs(input.gain),
            travel,
            samples: 0,
        },
        ..SensorFaultLimits::default()
    }
}

impl<const N: usize> Joint<N> {
    /// The settings of the joint's servo.
    fn settings(&self) -> JointSettings {
        let joint = self;
        let servo = &joint.servo;
        // The distance from its set-point at which friction can hold a joint that has nothing but its drive.
        let w = core::f64::consts::TAU * servo.bandwidth_hz;
        let held_rad = match (joint.friction.coulomb, servo.law) {
            (0.0, _) => 0.0,
            (coulomb, ServoLaw::Pd) => coulomb / servo.kp,
            (coulomb, ServoLaw::Decoupled) => coulomb / (joint.friction.armature * w * w),
        };
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
                tension: Pair {
                    flexor: joint.flexor.gains,
                    extensor: joint.extensor.gains,
                },
            },
            stop: SoftStop {
                low: joint.limits.low,
                high: joint.limits.high,
                zone: joint.stop.zone,
                bandwidth_hz: joint.stop.bandwidth_hz,
                damping_ratio: joint.stop.damping_ratio,
            },
            rate_change: PLAUSIBLE_RATE * joint.limits.velocity,
            resolution_rad: crate::math::abs(joint.adc.gain),
            frozen_rad: FROZEN_COUNTS * crate::math::abs(joint.adc.gain) + 2.0 * held_rad,
            position_cutoff_hz: servo.position_cutoff_hz,
            velocity_cutoff_hz: servo.velocity_cutoff_hz,
            tension_cutoff_hz: Pair {
                flexor: joint.flexor.cutoff_hz,
                extensor: joint.extensor.cutoff_hz,
            },
        }
    }
}

/// The settings of a joint that the finger does not have.
fn absent(sample_hz: f64) -> JointSettings {
    JointSettings {
        gains: JointGains {
            law: PositionLaw::ComputedTorque {
                bandwidth_hz: 0.0,
                damping_ratio: 0.0,
            },
            k_torque: 0.0,
            tension: Pair::both(TensionGains::default()),
        },
        stop: SoftStop::default(),
        rate_change: f64::MAX,
        resolution_rad: 0.0,
        frozen_rad: f64::MAX,
        position_cutoff_hz: None,
        velocity_cutoff_hz: sample_hz / 4.0,
        tension_cutoff_hz: Pair::both(None),
    }
}
