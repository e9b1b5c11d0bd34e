//! The parts of a configuration that controllers use.

use nalgebra::{Matrix3, SVector, Vector3};

use super::{
    Channel, ControlProcessor, Finger, Form, Hand, InputChannel, Joint, JointMotion, LinkBody,
    MotionLimits, OutputChannel, Placement, ProcessorKind, Shape, Tendon, Wire,
};
use crate::NumberError;
use crate::Pose;
use crate::kinematics::{self, Chain, PlanarFinger, Rod};
use crate::math::clamp;
use crate::number::is_within;
use crate::tendon::{MomentArms, Pair, TendonPairs};
use crate::trajectory::{self, Primitive, Target};
use crate::transmission::EffortLimits;

impl<const FINGERS: usize, const JOINTS: usize> Hand<FINGERS, JOINTS> {
    /// Returns the processor with this number; `None` if the hand has no such processor.
    #[must_use]
    pub fn processor(&self, number: u8) -> Option<&ControlProcessor> {
        self.processors
            .iter()
            .find(|processor| processor.number == number)
    }

    /// Returns the rate of a processor's loop, Hz: its own `rate_hz`, or else the rate that the
    /// hand has for processors of that kind.
    #[must_use]
    pub fn rate_hz(&self, processor: &ControlProcessor) -> u32 {
        processor.rate_hz.unwrap_or(match processor.kind {
            ProcessorKind::Servo | ProcessorKind::Table => self.servo_hz,
            ProcessorKind::Master => self.trajectory_hz,
        })
    }

    /// Returns the rate of a finger's servos, Hz. It is the rate of the processor that serves the
    /// finger; without one it is the hand's `servo_hz`.
    #[must_use]
    pub fn servo_rate_hz(&self, finger: &Finger<JOINTS>) -> u32 {
        finger
            .processor()
            .and_then(|number| self.processor(number))
            .map_or(self.servo_hz, |processor| self.rate_hz(processor))
    }

    /// Iterates over the fingers that processor `number` serves. Each item is the index of the
    /// finger in [`Hand::fingers`], and the finger.
    pub fn fingers_on(&self, number: u8) -> impl Iterator<Item = (usize, &Finger<JOINTS>)> {
        let fingers = self.fingers.iter().enumerate();
        fingers.filter(move |(_, finger)| finger.processor() == Some(number))
    }

    /// Returns the fraction of a processor's time that its loop takes, where 1 is all of the time:
    /// the rate of the loop times its run time with all joints and axes that the processor serves.
    #[must_use]
    pub fn load(&self, processor: &ControlProcessor) -> f64 {
        let joints = self.fingers.iter().flat_map(|finger| &finger.joints);
        let axes = self.table.iter().flat_map(|table| &table.axes);
        let served = joints
            .filter(|joint| joint.processor == processor.number)
            .count()
            + axes
                .filter(|axis| axis.processor == processor.number)
                .count();
        let served = u32::try_from(served).unwrap_or(u32::MAX);
        let time_us = processor.loop_us + f64::from(served) * processor.joint_us;
        f64::from(self.rate_hz(processor)) * time_us * 1e-6
    }

    /// Iterates over all converter channels to which the hand is wired, each with the sensor or
    /// actuator at the other end of its wire.
    pub fn wires(&self) -> impl Iterator<Item = (Channel, Wire)> {
        let fingers = self.fingers.iter().enumerate().flat_map(|(finger, entry)| {
            let touch = entry.touch.iter();
            let touch = touch.map(move |touch| (touch.adc.channel(), Wire::Touch { finger }));
            let joints = entry.joints.iter().enumerate();
            let joints = joints.flat_map(move |(joint, entry)| {
                let flexor = Wire::Flexor { finger, joint };
                let extensor = Wire::Extensor { finger, joint };
                [
                    (entry.adc.channel(), Wire::Position { finger, joint }),
                    (entry.flexor.adc.channel(), flexor),
                    (entry.flexor.dac.channel(), flexor),
                    (entry.extensor.adc.channel(), extensor),
                    (entry.extensor.dac.channel(), extensor),
                ]
            });
            joints.chain(touch)
        });
        let axes = self
            .table
            .iter()
            .flat_map(|table| table.axes.iter().enumerate());
        fingers.chain(axes.flat_map(|(axis, entry)| {
            [
                (entry.adc.channel(), Wire::Axis { axis }),
                (entry.dac.channel(), Wire::Axis { axis }),
            ]
        }))
    }

    /// Returns the sensor or actuator that is wired to `channel`; `None` if the channel has no
    /// wire.
    #[must_use]
    pub fn wire(&self, channel: Channel) -> Option<Wire> {
        let mut wires = self.wires();
        wires
            .find(|(other, _)| *other == channel)
            .map(|(_, wire)| wire)
    }

    /// Returns the A/D channel and the calibration of the sensor that `wire` names; `None` if the
    /// hand does not have that sensor.
    #[must_use]
    pub fn input(&self, wire: Wire) -> Option<&InputChannel> {
        self.converters(wire).map(|(input, _)| input)
    }

    /// Returns the D/A channel and the calibration of the actuator that `wire` names; `None` if `wire` names only a
    /// sensor, or if the hand does not have that wire.
    #[must_use]
    pub fn output(&self, wire: Wire) -> Option<&OutputChannel> {
        self.converters(wire)?.1
    }

    fn converters(&self, wire: Wire) -> Option<(&InputChannel, Option<&OutputChannel>)> {
        Some(match wire {
            Wire::Position { finger, joint } => (&self.joint(finger, joint)?.adc, None),
            Wire::Flexor { finger, joint } => self.joint(finger, joint)?.flexor.converters(),
            Wire::Extensor { finger, joint } => self.joint(finger, joint)?.extensor.converters(),
            Wire::Touch { finger } => (&self.fingers.get(finger)?.touch.as_ref()?.adc, None),
            Wire::Axis { axis } => {
                let axis = self.table.as_ref()?.axes.get(axis)?;
                (&axis.adc, Some(&axis.dac))
            }
        })
    }

    /// Iterates over the limits that trajectories must keep, one item per joint: first the joints of finger 0, then
    /// those of finger 1, and so on. The limit of jerk lets the acceleration grow from zero to its limit within one
    /// tick of the trajectories.
    pub fn trajectory_limits(&self) -> impl Iterator<Item = trajectory::ProfileLimits> {
        let rate_hz = f64::from(self.trajectory_hz);
        let joints = self.fingers.iter().flat_map(|finger| &finger.joints);
        joints.map(move |joint| {
            let limits = &joint.limits;
            limits.with_jerk(limits.acceleration * rate_hz)
        })
    }

    /// Moves absolute targets of `motion` that lie in the zone of a soft stop, where no joint can rest, to the inner
    /// end of the zone. Relative targets, and targets outside of a joint's limits, stay as they are.
    ///
    /// The joints of `motion` are in the order of the fingers: first all joints of finger 0.
    pub fn rest_between_stops<const J: usize>(&self, motion: &mut Primitive<J>) {
        let joints = self.fingers.iter().flat_map(|finger| &finger.joints);
        for (joint, target) in joints.zip(&mut motion.targets) {
            if let Target::Absolute(position) = target
                && is_within(*position, joint.limits.low, joint.limits.high)
            {
                let (low, high) = joint.rest_range();
                *position = clamp(*position, low, high);
            }
        }
    }

    /// Returns joint number `joint` of finger number `finger`, both counted from 0; `None` if the
    /// hand does not have that joint.
    #[must_use]
    pub fn joint(&self, finger: usize, joint: usize) -> Option<&Joint<JOINTS>> {
        self.fingers.get(finger)?.joints.get(joint)
    }
}

impl<const JOINTS: usize> Finger<JOINTS> {
    /// Returns the number of the processor that serves the finger; `None` if the finger has no
    /// joints.
    #[must_use]
    pub fn processor(&self) -> Option<u8> {
        self.joints.first().map(|joint| joint.processor)
    }

    /// Returns a vector whose element *i* is the result of `number` for joint *i*; elements without
    /// a joint are zero.
    #[must_use]
    pub fn each(&self, number: impl Fn(&Joint<JOINTS>) -> f64) -> SVector<f64, JOINTS> {
        SVector::from_fn(|row, _| self.joints.get(row).map_or(0.0, &number))
    }

    /// Returns the limits of the positions, velocities and accelerations of all joints, as vectors.
    #[must_use]
    pub fn limits(&self) -> MotionLimits<JOINTS> {
        MotionLimits {
            low: self.each(|joint| joint.limits.low),
            high: self.each(|joint| joint.limits.high),
            velocity: self.each(|joint| joint.limits.velocity),
            acceleration: self.each(|joint| joint.limits.acceleration),
        }
    }

    /// Returns the arms and limits of the finger's tendons, as the servos need them.
    ///
    /// If the finger has fewer than `JOINTS` joints, each missing joint gets two tendons with arms
    /// of 1 m that cross no other joint. So zero torque at such a joint needs zero tension.
    ///
    /// # Errors
    /// [`NumberError`] for arms that [`Hand::check`] would have refused.
    pub fn moment_arms(&self) -> Result<MomentArms<JOINTS>, NumberError> {
        let mut rows: [TendonPairs<f64, JOINTS>; JOINTS] = [[Pair::both(0.0); JOINTS]; JOINTS];
        for (index, row) in rows.iter_mut().enumerate() {
            let crossed = self.joints.get(index);
            for (tendon, arms) in row.iter_mut().enumerate() {
                *arms = match (self.joints.get(tendon), crossed) {
                    (Some(joint), Some(_)) if tendon == index => Pair {
                        flexor: joint.flexor.arm_m,
                        extensor: joint.extensor.arm_m,
                    },
                    (Some(joint), Some(crossed)) => joint
                        .crosses
                        .iter()
                        .find(|crossing| crossing.joint == crossed.name)
                        .map_or(Pair::both(0.0), |crossing| Pair {
                            flexor: crossing.flexor_m,
                            extensor: crossing.extensor_m,
                        }),
                    _ if tendon == index => Pair {
                        flexor: 1.0,
                        extensor: -1.0,
                    },
                    _ => Pair::both(0.0),
                };
            }
        }
        // No torque asks for a missing tendon, but it has some range.
        let missing = EffortLimits {
            low: 0.0,
            high: 1.0,
            bias: 0.0,
        };
        let limits = core::array::from_fn(|joint| {
            let joint = self.joints.get(joint);
            joint.map_or(Pair::both(missing), |joint| Pair {
                flexor: joint.flexor.limits(),
                extensor: joint.extensor.limits(),
            })
        });
        MomentArms::new(rows, limits)
    }

    /// Returns the closed-form model of a finger of the form [`Form::Planar`]. Returns `None` for
    /// another form, or if the finger does not have exactly four joints.
    #[must_use]
    pub fn planar(&self) -> Option<PlanarFinger> {
        let Form::Planar { lengths } = self.form else {
            return None;
        };
        let [first, second, third, fourth] = self.joints.as_slice() else {
            return None;
        };
        Some(PlanarFinger {
            base: self.base.pose(),
            lengths,
            bodies: [first, second, third, fourth].map(|joint| {
                let body = joint.rigid_body();
                Rod {
                    mass: body.mass,
                    center: body.center.x,
                    inertia: body.inertia.diagonal(),
                }
            }),
        })
    }

    /// Returns the model of the finger as a general chain of joints, for kinematics and dynamics.
    /// If the finger has fewer than `JOINTS` joints, the missing ones are fixed and have no mass.
    #[must_use]
    pub fn chain(&self) -> Chain<JOINTS> {
        let mut start = 0.0;
        let mut joints = [kinematics::ChainJoint {
            placement: Pose::identity(),
            motion: kinematics::ChainMotion::Fixed,
        }; JOINTS];
        let mut bodies = [kinematics::ChainBody::massless(); JOINTS];
        for (index, joint) in self.joints.iter().enumerate() {
            if let (Some(place), Some(body)) = (joints.get_mut(index), bodies.get_mut(index)) {
                *body = joint.rigid_body();
                *place = match self.form {
                    Form::Planar { lengths } => {
                        let axis = if index == 0 {
                            Vector3::z()
                        } else {
                            Vector3::y()
                        };
                        let placement = Pose::at(start, 0.0, 0.0);
                        start = lengths.get(index).copied().unwrap_or(0.0);
                        kinematics::ChainJoint {
                            placement,
                            motion: kinematics::ChainMotion::Revolute(axis),
                        }
                    }
                    Form::Chain { .. } => joint.mounted(),
                };
            }
        }
        let tip = match self.form {
            Form::Planar {
                lengths: [.., last],
            } => Vector3::new(last, 0.0, 0.0),
            Form::Chain { tip } => Vector3::from(tip),
        };
        Chain {
            base: self.base.pose(),
            joints,
            bodies,
            tip,
        }
    }
}

impl<const JOINTS: usize> Joint<JOINTS> {
    /// Returns the range of positions at which the joint can rest, `(lowest, highest)` in rad: its
    /// limits without the zones of its soft stops.
    #[must_use]
    pub fn rest_range(&self) -> (f64, f64) {
        let zone = self.stop.zone;
        (self.limits.low + zone, self.limits.high - zone)
    }

    /// The body of the link, of no mass where there is none.
    fn rigid_body(&self) -> kinematics::ChainBody {
        self.body
            .map_or_else(kinematics::ChainBody::massless, |body| body.rigid_body())
    }

    /// Returns the placement of the joint on the link before it; fixed without a mount.
    fn mounted(&self) -> kinematics::ChainJoint {
        let fixed = kinematics::ChainJoint {
            placement: Pose::identity(),
            motion: kinematics::ChainMotion::Fixed,
        };
        self.mount.map_or(fixed, |mount| kinematics::ChainJoint {
            placement: Placement {
                position: mount.position,
                rotation: mount.rotation,
            }
            .pose(),
            motion: match mount.motion {
                JointMotion::Revolute(axis) => {
                    kinematics::ChainMotion::Revolute(Vector3::from(axis))
                }
                JointMotion::Prismatic(axis) => {
                    kinematics::ChainMotion::Prismatic(Vector3::from(axis))
                }
            },
        })
    }
}

impl Tendon {
    fn converters(&self) -> (&InputChannel, Option<&OutputChannel>) {
        (&self.adc, Some(&self.dac))
    }
}

impl LinkBody {
    /// Returns the mass (kg), the centre of mass (m) and the inertia matrix (kg m²) of the link, as
    /// the model of a chain needs them.
    #[must_use]
    pub fn rigid_body(&self) -> kinematics::ChainBody {
        kinematics::ChainBody {
            mass: self.mass_kg,
            center: Vector3::from(self.center),
            inertia: match self.shape {
                Shape::Cuboid([x, y, z]) => {
                    let (x, y, z) = (x * x, y * y, z * z);
                    Matrix3::from_diagonal(
                        &(Vector3::new(y + z, x + z, x + y) * self.mass_kg / 12.0),
                    )
                }
                Shape::Inertia {
                    moments: [xx, yy, zz],
                    products: [xy, xz, yz],
                } => Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            },
        }
    }
}
