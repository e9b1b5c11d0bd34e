//! The parts of a configuration that controllers use.

use heapless::Vec;
use nalgebra::{Matrix3, SVector, Vector3};

use super::{
    Actuator, BASE, Channel, ControlProcessor, Finger, Follows, Form, Hand, InputChannel, Joint,
    JointMotion, LinkBody, MotionLimits, Mount, Name, OutputChannel, Placement, ProcessorKind,
    Shape, Wire,
};
use crate::kinematics::{self, Carrier, Chain, Following, PlanarFinger, Rod};
use crate::math::{clamp, max, min};
use crate::number::is_within;
use crate::trajectory::{self, Primitive, Target};
use crate::transmission::{EffortLimits, Linear, PositionSensing};
use crate::{NumberError, Pose};

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>
    Hand<FINGERS, JOINTS, ACTUATORS>
{
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
    pub fn servo_rate_hz(&self, finger: &Finger<JOINTS, ACTUATORS>) -> u32 {
        finger
            .processor()
            .and_then(|number| self.processor(number))
            .map_or(self.servo_hz, |processor| self.rate_hz(processor))
    }

    /// Iterates over the fingers that processor `number` serves. Each item is the index of the
    /// finger in [`Hand::fingers`], and the finger.
    pub fn fingers_on(
        &self,
        number: u8,
    ) -> impl Iterator<Item = (usize, &Finger<JOINTS, ACTUATORS>)> {
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
            let joints = joints.filter_map(move |(joint, entry)| {
                let wire = Wire::Position { finger, joint };
                Some((entry.adc.as_ref()?.channel(), wire))
            });
            let actuators = entry.actuators.iter().enumerate();
            let actuators = actuators.flat_map(move |(actuator, entry)| {
                let wire = Wire::Actuator { finger, actuator };
                let sensor = entry.adc.iter().map(move |adc| (adc.channel(), wire));
                let encoder = entry.encoder.iter().map(move |encoder| {
                    let wire = Wire::Encoder { finger, actuator };
                    (encoder.channel(), wire)
                });
                sensor.chain(encoder).chain([(entry.dac.channel(), wire)])
            });
            joints.chain(actuators).chain(touch)
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
        self.converters(wire)?.0
    }

    /// Returns the D/A channel and the calibration of the actuator that `wire` names; `None` if `wire` names only a
    /// sensor, or if the hand does not have that wire.
    #[must_use]
    pub fn output(&self, wire: Wire) -> Option<&OutputChannel> {
        self.converters(wire)?.1
    }

    fn converters(&self, wire: Wire) -> Option<(Option<&InputChannel>, Option<&OutputChannel>)> {
        Some(match wire {
            Wire::Position { finger, joint } => (self.joint(finger, joint)?.adc.as_ref(), None),
            Wire::Actuator { finger, actuator } => {
                let actuator = self.actuator(finger, actuator)?;
                (actuator.adc.as_ref(), Some(&actuator.dac))
            }
            Wire::Encoder { finger, actuator } => {
                (self.actuator(finger, actuator)?.encoder.as_ref(), None)
            }
            Wire::Touch { finger } => (Some(&self.fingers.get(finger)?.touch.as_ref()?.adc), None),
            Wire::Axis { axis } => {
                let axis = self.table.as_ref()?.axes.get(axis)?;
                (Some(&axis.adc), Some(&axis.dac))
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
    pub fn joint(&self, finger: usize, joint: usize) -> Option<&Joint> {
        self.fingers.get(finger)?.joints.get(joint)
    }

    /// Returns actuator number `actuator` of finger number `finger`, both counted from 0; `None` if the hand does not
    /// have that actuator.
    #[must_use]
    pub fn actuator(&self, finger: usize, actuator: usize) -> Option<&Actuator<JOINTS>> {
        self.fingers.get(finger)?.actuators.get(actuator)
    }
}

impl<const JOINTS: usize, const ACTUATORS: usize> Finger<JOINTS, ACTUATORS> {
    /// Returns the number of the processor that serves the finger; `None` if the finger has no
    /// joints.
    #[must_use]
    pub fn processor(&self) -> Option<u8> {
        self.joints.first().map(|joint| joint.processor)
    }

    /// Returns a vector whose element *i* is the result of `number` for joint *i*; elements without
    /// a joint are zero.
    #[must_use]
    pub fn each(&self, number: impl Fn(&Joint) -> f64) -> SVector<f64, JOINTS> {
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

    /// Returns the arms of the finger's actuators and the limits of their efforts, as the servos need them. Joints and
    /// actuators that the finger does not have do nothing.
    ///
    /// # Errors
    /// [`NumberError`] for arms that [`Hand::check`] would have refused.
    pub fn transmission(&self) -> Result<Linear<JOINTS, ACTUATORS>, NumberError> {
        let mut arms = [[0.0; JOINTS]; ACTUATORS];
        let mut limits = [EffortLimits::fixed(0.0); ACTUATORS];
        let places = arms.iter_mut().zip(&mut limits);
        for ((arms, limits), actuator) in places.zip(&self.actuators) {
            for (arm, joint) in arms.iter_mut().zip(&self.joints) {
                *arm = self.arm(actuator, joint);
            }
            *limits = actuator.limits();
        }
        Linear::new(arms, limits)
    }

    /// Returns how the positions of the joints follow from those that its sensors measure. Joints that the finger does
    /// not have are at 0.
    ///
    /// # Errors
    /// [`NumberError`] for arms or sensors that [`Hand::check`] would have refused.
    pub fn position_sensing(&self) -> Result<PositionSensing<JOINTS, ACTUATORS>, NumberError> {
        let joint = |place: usize| {
            self.joints
                .get(place)
                .is_some_and(|joint| joint.adc.is_some())
        };
        let actuator = |place: usize| {
            let actuator = self.actuators.get(place);
            actuator.is_some_and(|actuator| actuator.encoder.is_some())
        };
        let (joints, actuators) = (core::array::from_fn(joint), core::array::from_fn(actuator));
        self.transmission()?.position_sensing(&joints, &actuators)
    }

    /// Returns the joint to which an actuator [belongs](Linear::joint_of); `None` if the finger does not have the
    /// actuator.
    #[must_use]
    pub fn joint_of(&self, actuator: usize) -> Option<usize> {
        let actuator = self.actuators.get(actuator)?;
        let moves = |joint: &Joint| self.arm(actuator, joint) != 0.0;
        self.joints.iter().rposition(moves)
    }

    /// Returns the torque that each joint can have to either side by the actuators that [belong](Linear::joint_of) to it,
    /// N m, or N for a sliding joint. A joint without actuators of its own has the torque that all give it, which it then
    /// shares with others.
    #[must_use]
    pub fn own_torques(&self) -> SVector<f64, JOINTS> {
        let is_own = |place: usize, joint: usize| self.joint_of(place) == Some(joint);
        SVector::from_fn(|row, _| {
            let Some(joint) = self.joints.get(row) else {
                return 0.0;
            };
            let has_own = (0..self.actuators.len()).any(|place| is_own(place, row));
            let (mut low, mut high) = (0.0, 0.0);
            for (place, actuator) in self.actuators.iter().enumerate() {
                if has_own && !is_own(place, row) {
                    continue;
                }
                let (arm, limits) = (self.arm(actuator, joint), &actuator.limits);
                let ends = (arm * limits.low, arm * limits.high);
                low += min(ends.0, ends.1);
                high += max(ends.0, ends.1);
            }
            max(min(-low, high), 0.0)
        })
    }

    /// Returns the efforts of actuators from which nothing is asked, N or N m; 0 for those that the finger does not have.
    #[must_use]
    pub fn efforts_at_rest(&self) -> [f64; ACTUATORS] {
        let mut efforts = [0.0; ACTUATORS];
        for (effort, actuator) in efforts.iter_mut().zip(&self.actuators) {
            *effort = actuator.limits().at_rest();
        }
        efforts
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
                let body = joint
                    .body
                    .map_or_else(kinematics::ChainBody::massless, |body| body.rigid_body());
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
        let mut joints = [kinematics::ChainJoint::fixed(); JOINTS];
        let mut bodies = [kinematics::ChainBody::massless(); JOINTS];
        let links = self.links();
        let places = joints.iter_mut().zip(&mut bodies);
        for (index, (link, (place, body))) in links.iter().zip(places).enumerate() {
            *body = link
                .body
                .map_or_else(kinematics::ChainBody::massless, LinkBody::rigid_body);
            *place = match &self.form {
                Form::Planar { lengths } => {
                    let axis = if index == 0 {
                        Vector3::z()
                    } else {
                        Vector3::y()
                    };
                    let placement = Pose::at(start, 0.0, 0.0);
                    start = lengths.get(index).copied().unwrap_or(0.0);
                    let motion = kinematics::ChainMotion::Revolute(axis);
                    kinematics::ChainJoint::new(placement, motion)
                }
                Form::Chain { .. } => link.placed(&links),
            };
        }
        let last = JOINTS.saturating_sub(1);
        let tip = match &self.form {
            Form::Planar {
                lengths: [.., length],
            } => (last, Vector3::new(*length, 0.0, 0.0)),
            Form::Chain { tip, on } => {
                let named = on.as_ref().and_then(|on| number(&links, on));
                (named.unwrap_or(last), Vector3::from(*tip))
            }
        };
        Chain::of(self.base.pose(), joints, bodies, tip)
    }

    /// Returns the joints and the followers in the order in which [`chain`](Self::chain) has them: each after the one
    /// that carries it, and the joints in their own order. Those that nothing carries are left out.
    #[must_use]
    pub fn links(&self) -> Vec<FingerLink<'_>, JOINTS> {
        let mut links = Vec::new();
        let before = |place: usize| self.joints.get(place.checked_sub(1)?).map(|it| &it.name);
        let joints = self
            .joints
            .iter()
            .enumerate()
            .map(|(place, joint)| FingerLink {
                name: &joint.name,
                on: carrier(joint.mount.as_ref(), before(place)),
                mount: joint.mount.as_ref(),
                body: joint.body.as_ref(),
                follows: None,
            });
        let mut joints = joints.peekable();
        loop {
            let next = joints.next_if(|joint| joint.is_next(&links));
            let next = next.or_else(|| {
                let followers = self.followers.iter().map(|follower| FingerLink {
                    name: &follower.name,
                    on: carrier(Some(&follower.mount), Some(&follower.follows.joint)),
                    mount: Some(&follower.mount),
                    body: follower.body.as_ref(),
                    follows: Some(&follower.follows),
                });
                let mut followers = followers.filter(|follower| follower.is_next(&links));
                followers.next()
            });
            // Without room the rest is left out, too.
            let Some(Ok(())) = next.map(|link| links.push(link)) else {
                return links;
            };
        }
    }

    /// Returns the arm of an actuator at a joint with all that follow it: the torque that counts at the joint, N m, or N
    /// for a sliding joint, for a unit of the effort.
    #[must_use]
    pub fn arm(&self, actuator: &Actuator<JOINTS>, joint: &Joint) -> f64 {
        let mut arm = actuator.arm(&joint.name);
        for follower in &self.followers {
            if follower.follows.joint == joint.name {
                arm += follower.follows.ratio * actuator.arm(&follower.name);
            }
        }
        arm
    }
}

/// A link of a finger with the joint that moves it, which may follow another one.
#[derive(Clone, Copy, Debug)]
pub struct FingerLink<'a> {
    /// The name of its joint.
    pub name: &'a Name,
    /// The name of the joint whose link carries it; `None` for the base.
    pub on: Option<&'a Name>,
    /// Its place, and its motion; `None` in a planar finger.
    pub mount: Option<&'a Mount>,
    /// The body; `None` if it has no mass.
    pub body: Option<&'a LinkBody>,
    /// The joint that it follows; `None` if it moves by itself.
    pub follows: Option<&'a Follows>,
}

impl FingerLink<'_> {
    /// Returns true if it can come after these links: it is none of them, and one of them or the base carries it.
    fn is_next(&self, links: &[FingerLink<'_>]) -> bool {
        let has = |name: &Name| number(links, name).is_some();
        !has(self.name) && self.on.is_none_or(has)
    }

    /// Returns the joint as a chain of these links has it; fixed without a mount.
    fn placed(&self, links: &[FingerLink<'_>]) -> kinematics::ChainJoint {
        let Some(mount) = self.mount else {
            return kinematics::ChainJoint::fixed();
        };
        let placement = Placement {
            position: mount.position,
            rotation: mount.rotation,
        };
        let motion = match mount.motion {
            JointMotion::Revolute(axis) => kinematics::ChainMotion::Revolute(Vector3::from(axis)),
            JointMotion::Prismatic(axis) => kinematics::ChainMotion::Prismatic(Vector3::from(axis)),
        };
        let on = self.on.and_then(|on| number(links, on));
        kinematics::ChainJoint {
            on: on.map_or(Carrier::Base, Carrier::Joint),
            follows: self.follows.and_then(|follows| {
                Some(Following {
                    joint: number(links, &follows.joint)?,
                    ratio: follows.ratio,
                    offset: follows.offset,
                })
            }),
            ..kinematics::ChainJoint::new(placement.pose(), motion)
        }
    }
}

/// The number of the link whose joint has a name.
fn number(links: &[FingerLink<'_>], name: &Name) -> Option<usize> {
    links.iter().position(|link| link.name == name)
}

/// The name of the joint whose link carries one with this mount, or without one; `None` for the base.
fn carrier<'a>(mount: Option<&'a Mount>, usual: Option<&'a Name>) -> Option<&'a Name> {
    match mount.and_then(|mount| mount.on.as_ref()) {
        Some(on) if on == BASE => None,
        Some(on) => Some(on),
        None => usual,
    }
}

impl Joint {
    /// Returns the range of positions at which the joint can rest, `(lowest, highest)` in rad: its
    /// limits without the zones of its soft stops.
    #[must_use]
    pub fn rest_range(&self) -> (f64, f64) {
        let zone = self.stop.zone;
        (self.limits.low + zone, self.limits.high - zone)
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
