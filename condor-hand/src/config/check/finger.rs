//! Rules of fingers, joints and actuators.

use nalgebra::Matrix3;

use super::at::{At, NOT_NEGATIVE, ORTHONORMAL, POSITIVE, Rule};
use crate::config::{
    Actuator, BASE, Finger, Form, Hand, Joint, JointMotion, LinkBody, Mistake, Mount, Name,
    ProcessorKind, Rotation, ServoLaw, Shape,
};
use crate::kinematics::body_inertia;
use crate::math::{abs, is_finite, max, min};
use crate::number::count;
use crate::{NumberError, Requirement, Subject};

impl<const F: usize, const J: usize, const A: usize> Hand<F, J, A> {
    pub(super) fn check_finger(&self, index: usize) -> Result<(), Mistake> {
        let Some(finger) = self.fingers.get(index) else {
            return Ok(());
        };
        let at = At::finger(index, &finger.name);
        let earlier = self.fingers.iter().take(index);
        at.name(&finger.name, earlier.map(|finger| &finger.name))?;
        let base = at.table("base");
        base.list("position", &finger.base.position, Requirement::Finite)?;
        finger.base.rotation.check(&base, "rotation")?;
        if let Some(touch) = &finger.touch {
            let at = at.table("touch");
            at.number("contact_n", touch.contact_n, POSITIVE)?;
            at.input("adc", &touch.adc, [0.0, touch.contact_n])?;
        }
        at.not_empty("joints", finger.joints.is_empty())?;
        finger.check_followers(&at)?;
        finger.check_form(&at)?;
        finger.check_links(&at)?;
        let first = finger.processor().unwrap_or(0);
        for (place, joint) in finger.joints.iter().enumerate() {
            let at = at.joint(place, &joint.name);
            let earlier = finger.joints.iter().take(place);
            at.name(&joint.name, earlier.map(|joint| &joint.name))?;
            let served = at.served(self, joint.processor, ProcessorKind::Servo)?;
            if joint.processor != first {
                let must = Requirement::Equal(first.into());
                let reason = " like that of the finger's first joint; actuators couple the joints of a finger, so give them all one processor";
                return Err(at.off("processor", joint.processor.into(), must, reason));
            }
            joint.check(&at, self.rate_hz(served))?;
        }
        let rate_hz = self.servo_rate_hz(finger);
        for (place, actuator) in finger.actuators.iter().enumerate() {
            let at = at.actuator(place, &actuator.name);
            let earlier = finger.actuators.iter().take(place);
            at.name(&actuator.name, earlier.map(|actuator| &actuator.name))?;
            actuator.check(&at, rate_hz)?;
            actuator.check_arms(&at, finger)?;
            if let Some(encoder) = &actuator.encoder {
                at.input("encoder", encoder, finger.travel(actuator))?;
            }
        }
        // With the actuators, which are right.
        for (place, joint) in finger.joints.iter().enumerate() {
            finger.check_stop(joint, &at.joint(place, &joint.name), rate_hz)?;
        }
        finger.check_torques(&at)?;
        finger.check_sensing(&at)
    }
}

impl<const J: usize, const A: usize> Finger<J, A> {
    /// Checks the joints against the conditions of the finger's mechanism.
    fn check_form(&self, at: &At) -> Result<(), Mistake> {
        let is_planar = match self.form {
            Form::Planar {
                lengths: [l0, l1, l2, l3],
            } => {
                at.table("form.planar").numbers([
                    ("lengths[0]", l0, NOT_NEGATIVE),
                    ("lengths[1]", l1, POSITIVE),
                    ("lengths[2]", l2, POSITIVE),
                    ("lengths[3]", l3, POSITIVE),
                ])?;
                true
            }
            Form::Chain { ref tip, ref on } => {
                at.list("form.chain.tip", tip, Requirement::Finite)?;
                self.check_tip(&at.table("form.chain"), on.as_ref())?;
                false
            }
        };
        let joints = self.joints.len();
        if is_planar && joints != 4 {
            let reason = " in a planar finger; for another number write `form = { chain = … }`";
            let quantity = ": the number of its joints";
            let wrong = at.off("", count(joints), Requirement::Equal(4.0), reason);
            return Err(Mistake { quantity, ..wrong });
        }
        for (number, joint) in self.joints.iter().enumerate() {
            let at = at.joint(number, &joint.name);
            match &joint.mount {
                Some(_) if is_planar => {
                    let rule =
                        "in a planar finger the lengths say where joints are, so leave it out";
                    return Err(at.words("mount", "needless", rule));
                }
                None if !is_planar => {
                    let rule = "a joint of a chain needs one";
                    return Err(at.words("mount", "missing", rule));
                }
                Some(mount) => mount.check(&at.table("mount"))?,
                None => {}
            }
            if let Some(body) = &joint.body {
                body.check(&at.table("body"), is_planar)?;
            }
        }
        Ok(())
    }

    /// Checks which joint moves the tip.
    fn check_tip(&self, at: &At, on: Option<&Name>) -> Result<(), Mistake> {
        match on {
            None if self.followers.is_empty() => Ok(()),
            None => {
                let rule = "the finger has followers, so name the joint that moves the tip";
                Err(at.words("on", "missing", rule))
            }
            Some(on) if self.has(on) => Ok(()),
            Some(_) => Err(at.words(
                "on",
                "no joint of the finger",
                "name one of its joints or followers",
            )),
        }
    }

    /// Returns true if a joint or a follower has this name.
    fn has(&self, name: &Name) -> bool {
        let followers = self.followers.iter().map(|follower| &follower.name);
        let mut all = self.joints.iter().map(|joint| &joint.name).chain(followers);
        all.any(|other| other == name)
    }

    /// Checks the joints that follow others.
    fn check_followers(&self, at: &At) -> Result<(), Mistake> {
        let room = J.saturating_sub(self.joints.len());
        for (place, follower) in self.followers.iter().enumerate() {
            let at = at.follower(place, &follower.name);
            if matches!(self.form, Form::Planar { .. }) {
                let rule = "in a planar finger all joints move by themselves; write `form = { chain = … }`";
                return Err(at.words("", "needless", rule));
            }
            let joints = self.joints.iter().map(|joint| &joint.name);
            let earlier = self.followers.iter().take(place);
            at.name(&follower.name, joints.chain(earlier.map(|it| &it.name)))?;
            if place >= room {
                let rule = "joints and followers together are more than the program has room for";
                return Err(at.words("", "one too many", rule));
            }
            let follows = &follower.follows;
            let moves = self.joints.iter().any(|joint| joint.name == follows.joint);
            if !moves {
                let other = self
                    .followers
                    .iter()
                    .find(|other| other.name == follows.joint);
                let (state, rule) = match other {
                    Some(_) => ("a follower itself", "follow the joint that moves by itself"),
                    None => ("no joint of the finger", "name one of its joints"),
                };
                return Err(at.words("follows.joint", state, rule));
            }
            at.numbers([
                ("follows.ratio", follows.ratio, Requirement::Finite),
                ("follows.offset", follows.offset, Requirement::Finite),
            ])?;
            if follows.ratio == 0.0 {
                let rule = "a joint that does not move belongs to the link that carries it";
                return Err(at.words("follows.ratio", "0", rule));
            }
            follower.mount.check(&at.table("mount"))?;
            if let Some(body) = &follower.body {
                body.check(&at.table("body"), false)?;
            }
        }
        Ok(())
    }

    /// Checks that something carries each joint, from the base on.
    fn check_links(&self, at: &At) -> Result<(), Mistake> {
        let links = self.links();
        let is_carried = |name: &Name| links.iter().any(|link| link.name == name);
        let mounts = self.joints.iter().enumerate().map(|(place, joint)| {
            (
                at.joint(place, &joint.name),
                &joint.name,
                joint.mount.as_ref(),
            )
        });
        let followers = self.followers.iter().enumerate().map(|(place, follower)| {
            let at = at.follower(place, &follower.name);
            (at, &follower.name, Some(&follower.mount))
        });
        for (at, name, mount) in mounts.chain(followers) {
            let Some(on) = mount.and_then(|mount| mount.on.as_ref()) else {
                continue;
            };
            if on != BASE && !self.has(on) {
                let rule = "name a joint or a follower, or `base`";
                return Err(at.words("mount.on", "no joint of the finger", rule));
            }
            if !is_carried(name) {
                let rule = "name one between the base and this joint";
                return Err(at.words("mount.on", "the joint itself, or one that it carries", rule));
            }
        }
        Ok(())
    }

    /// The positions of an actuator while the joints are within their limits, rad or m.
    fn travel(&self, actuator: &Actuator<J>) -> [f64; 2] {
        self.joints
            .iter()
            .fold([0.0; 2], |[least, greatest], joint| {
                let arm = self.arm(actuator, joint);
                let ends = [arm * joint.limits.low, arm * joint.limits.high];
                [
                    least + min(ends[0], ends[1]),
                    greatest + max(ends[0], ends[1]),
                ]
            })
    }

    /// Checks that sensors tell the position of each joint.
    fn check_sensing(&self, at: &At) -> Result<(), Mistake> {
        let Err(NumberError {
            at: Subject::Joint(joint),
            ..
        }) = self.position_sensing()
        else {
            return Ok(());
        };
        let rule = "give it an `adc`, or give actuators that move it an `encoder`";
        Err(self
            .at_joint(at, joint.into())
            .words("", "measured by no sensor", rule))
    }

    /// The joint of a number.
    fn at_joint(&self, at: &At, joint: usize) -> At {
        let name = self.joints.get(joint).map(|joint| joint.name.clone());
        at.joint(joint, &name.unwrap_or_default())
    }

    /// Checks that each joint can have torques of its own, and none.
    fn check_torques(&self, at: &At) -> Result<(), Mistake> {
        let at_joint = |joint: usize| self.at_joint(at, joint);
        for (place, joint) in self.joints.iter().enumerate() {
            if self
                .actuators
                .iter()
                .all(|actuator| self.arm(actuator, joint) == 0.0)
            {
                let rule = "give an actuator an arm at the joint, in its `arms`";
                return Err(at_joint(place).words("", "moved by no actuator", rule));
            }
        }
        for (place, joint) in self.joints.iter().enumerate() {
            let mut moving =
                (self.actuators.iter()).filter(|actuator| self.arm(actuator, joint) != 0.0);
            let k_tau = joint.servo.k_tau;
            if k_tau != 0.0 && moving.any(|actuator| actuator.adc.is_none()) {
                let reason = ", since an actuator of the joint has no sensor of its effort (`adc`)";
                let must = Requirement::Equal(0.0);
                return Err(at_joint(place).off("servo.k_tau", k_tau, must, reason));
            }
        }
        let transmission = match self.transmission() {
            Ok(transmission) => transmission,
            // All numbers are finite and in order.
            Err(NumberError { at: subject, .. }) => {
                let Subject::Joint(joint) = subject else {
                    return Ok(());
                };
                let rule = "its actuators move it only together with joints after it; add an actuator or change an arm";
                return Err(at_joint(joint.into()).words("", "without a torque of its own", rule));
            }
        };
        let still = transmission.efforts(&nalgebra::SVector::zeros()).saturated;
        if still == 0 {
            return Ok(());
        }
        let rule = "no efforts within the `limits` of its actuators cancel there; change their limits or their arms";
        Err(at_joint(still.trailing_zeros() as usize).words("", "never without a torque", rule))
    }
}

impl Mount {
    fn check(&self, at: &At) -> Result<(), Mistake> {
        at.list("position", &self.position, Requirement::Finite)?;
        self.rotation.check(at, "rotation")?;
        match self.motion {
            JointMotion::Revolute(axis) => at.unit("motion.revolute", axis),
            JointMotion::Prismatic(axis) => at.unit("motion.prismatic", axis),
        }
    }
}

impl LinkBody {
    fn check(&self, at: &At, is_planar: bool) -> Result<(), Mistake> {
        let off_axis = |field| {
            let rule = "the links of a planar finger are; write `form = { chain = … }` for others";
            Err(at.words(field, "not on the x axis", rule))
        };
        at.number("mass_kg", self.mass_kg, POSITIVE)?;
        at.list("center", &self.center, Requirement::Finite)?;
        let shape = match self.shape {
            Shape::Cuboid(edges) => {
                at.list("shape.cuboid", &edges, POSITIVE)?;
                "shape.cuboid"
            }
            Shape::Inertia { moments, products } => {
                at.list("shape.inertia.moments", &moments, Requirement::Finite)?;
                let field = "shape.inertia.products";
                at.list(field, &products, Requirement::Finite)?;
                if is_planar && products != [0.0; 3] {
                    return off_axis(field);
                }
                "shape.inertia.moments"
            }
        };
        let [_, y, z] = self.center;
        if is_planar && (y != 0.0 || z != 0.0) {
            return off_axis("center");
        }
        if is_possible(&self.rigid_body().inertia) {
            return Ok(());
        }
        let rule = "in any axes each moment must be above 0 and at most the sum of the two others";
        Err(at.words(shape, "no inertia of a body", rule))
    }
}

/// Returns true if a body can have this inertia: positive definite, and no moment above the sum of the two
/// others, both in any axes.
fn is_possible(inertia: &Matrix3<f64>) -> bool {
    let moments = inertia.diagonal();
    let (x, y, z) = (moments.x, moments.y, moments.z);
    let scale = x + y + z;
    // Of the scale of one, so that small bodies do not underflow.
    let scaled = inertia / scale;
    let minor = scaled.m11 * scaled.m22 - scaled.m12 * scaled.m12;
    is_finite(scale)
        && x > 0.0
        && minor > 0.0
        && scaled.determinant() > 0.0
        // Flat bodies are on the edge, where rounding decides.
        && body_inertia(inertia, 1e-9).is_ok()
}

impl Joint {
    /// The rules of its numbers that do not depend on those of others.
    pub(in crate::config) fn rules(&self) -> [Rule; 16] {
        let (servo, stop, friction) = (&self.servo, &self.stop, &self.friction);
        let half = Requirement::AtMost(0.5 * (self.limits.high - self.limits.low));
        [
            ("servo.kp", servo.kp, NOT_NEGATIVE),
            ("servo.kv", servo.kv, NOT_NEGATIVE),
            ("servo.ki", servo.ki, NOT_NEGATIVE),
            ("servo.integral_max", servo.integral_max, NOT_NEGATIVE),
            ("servo.bandwidth_hz", servo.bandwidth_hz, NOT_NEGATIVE),
            ("servo.zeta", servo.zeta, NOT_NEGATIVE),
            ("servo.k_tau", servo.k_tau, NOT_NEGATIVE),
            ("stop.zone", stop.zone, NOT_NEGATIVE),
            ("stop.zone", stop.zone, half),
            ("stop.bandwidth_hz", stop.bandwidth_hz, NOT_NEGATIVE),
            ("stop.damping_ratio", stop.damping_ratio, NOT_NEGATIVE),
            ("friction.armature", friction.armature, NOT_NEGATIVE),
            ("friction.viscous", friction.viscous, NOT_NEGATIVE),
            ("friction.coulomb", friction.coulomb, NOT_NEGATIVE),
            ("friction.coulomb_rate", friction.coulomb_rate, NOT_NEGATIVE),
            ("friction.tendon", friction.tendon, NOT_NEGATIVE),
        ]
    }

    fn check(&self, at: &At, rate_hz: u32) -> Result<(), Mistake> {
        at.limits(&self.limits)?;
        at.numbers(self.rules())?;
        let (servo, friction) = (&self.servo, &self.friction);
        // A law whose gain is zero or left out does nothing.
        match servo.law {
            ServoLaw::Pd => at.number("servo.kp", servo.kp, POSITIVE)?,
            ServoLaw::Decoupled => at.number("servo.bandwidth_hz", servo.bandwidth_hz, POSITIVE)?,
        }
        if friction.coulomb > 0.0 {
            at.number("friction.coulomb_rate", friction.coulomb_rate, POSITIVE)?;
        }
        let cutoff_hz = servo.position_cutoff_hz;
        at.cutoff("servo.position_cutoff_hz", cutoff_hz, rate_hz)?;
        let cutoff_hz = Some(servo.velocity_cutoff_hz);
        at.cutoff("servo.velocity_cutoff_hz", cutoff_hz, rate_hz)?;
        match &self.adc {
            Some(adc) => at.input("adc", adc, [self.limits.low, self.limits.high]),
            None => Ok(()),
        }
    }
}

impl<const J: usize> Actuator<J> {
    fn check(&self, at: &At, rate_hz: u32) -> Result<(), Mistake> {
        let (gains, limits, faults) = (&self.gains, &self.limits, &self.faults);
        at.numbers([
            ("limits.low", limits.low, Requirement::Finite),
            ("limits.high", limits.high, Requirement::Finite),
            ("pole_hz", self.pole_hz, POSITIVE),
            ("gains.kp", gains.kp, NOT_NEGATIVE),
            ("gains.ki", gains.ki, NOT_NEGATIVE),
            ("gains.kd", gains.kd, NOT_NEGATIVE),
            ("gains.kv", gains.kv, NOT_NEGATIVE),
        ])?;
        at.below(("limits.low", limits.low), ("limits.high", limits.high))?;
        if let Some(bias) = limits.bias {
            at.number("limits.bias", bias, Requirement::Finite)?;
            let within = Requirement::Within(limits.low, limits.high);
            if !within.holds(bias) {
                return Err(at.off("limits.bias", bias, within, ", its `low` and its `high`"));
            }
        }
        let (mut least, mut greatest) = (limits.low, limits.high);
        if let Some(below) = faults.below {
            at.below(("faults.below", below), ("limits.low", limits.low))?;
            least = below;
        }
        if let Some(above) = faults.above {
            at.number("faults.above", above, Requirement::Finite)?;
            let must = Requirement::Above(limits.high);
            if !must.holds(above) {
                return Err(at.off("faults.above", above, must, ", its `limits.high`"));
            }
            greatest = above;
        }
        at.cutoff("cutoff_hz", self.cutoff_hz, rate_hz)?;
        if self.adc.is_none() {
            let reason = ", since the actuator has no sensor of its effort (`adc`)";
            let feedback = [
                ("gains.kp", gains.kp),
                ("gains.ki", gains.ki),
                ("gains.kd", gains.kd),
            ];
            for (key, value) in feedback {
                if value != 0.0 {
                    return Err(at.off(key, value, Requirement::Equal(0.0), reason));
                }
            }
            if self.cutoff_hz.is_some() {
                let rule = "the actuator has no sensor of its effort (`adc`), so leave it out";
                return Err(at.words("cutoff_hz", "needless", rule));
            }
        }
        match &self.adc {
            Some(adc) => at.input("adc", adc, [least, greatest])?,
            None if faults.below.or(faults.above).is_some() => {
                let rule = "the actuator has no sensor of its effort (`adc`), so leave them out";
                return Err(at.words("faults", "needless", rule));
            }
            None => {}
        }
        let (least, greatest) = self.limits().command_range();
        at.output(&self.dac, [least, greatest])
    }

    /// Checks which joints it moves.
    fn check_arms<const A: usize>(&self, at: &At, finger: &Finger<J, A>) -> Result<(), Mistake> {
        at.not_empty("arms", self.arms.is_empty())?;
        let at = at.table("arms");
        for (name, &arm) in &self.arms {
            if !finger.has(name) {
                let rule = "name one of its joints";
                return Err(at.words(name, "at no joint of the finger", rule));
            }
            at.number(name, arm, Requirement::Finite)?;
            if arm == 0.0 {
                return Err(at.words(name, "0", "leave out a joint that it does not move"));
            }
        }
        Ok(())
    }
}

impl Rotation {
    fn check(&self, at: &At, field: &str) -> Result<(), Mistake> {
        let numbers = match self {
            Self::None => return Ok(()),
            Self::Axis { axis, angle } => {
                let at = at.table(field).table("axis");
                at.number("angle", *angle, Requirement::Finite)?;
                return at.unit("axis", *axis);
            }
            Self::Rpy(angles) => &angles[..],
            Self::Rows(rows) => rows.as_flattened(),
        };
        at.list(field, numbers, Requirement::Finite)?;
        let matrix = self.matrix();
        let products = matrix.transpose() * matrix - Matrix3::identity();
        let error = products
            .iter()
            .fold(0.0, |worst, &entry| max(abs(entry), worst));
        let determinant = matrix.determinant();
        let (quantity, wrong) = if error > ORTHONORMAL {
            let quantity = ": the greatest difference of its axes from orthogonal unit vectors";
            let must = Requirement::AtMost(ORTHONORMAL);
            (quantity, at.off(field, error, must, ""))
        } else if determinant > 0.0 {
            return Ok(());
        } else {
            let (must, reason) = (Requirement::Equal(1.0), "; a left-handed frame has -1");
            (
                ": its determinant",
                at.off(field, determinant, must, reason),
            )
        };
        Err(Mistake { quantity, ..wrong })
    }
}
