//! Rules of fingers, joints and tendons.

use nalgebra::Matrix3;

use super::at::{At, NOT_NEGATIVE, ORTHONORMAL, POSITIVE, Rule, entry};
use crate::config::{
    Allowed, Finger, Form, Hand, Joint, JointMotion, LinkBody, Mistake, MistakeValue, Mount,
    ProcessorKind, Rotation, ServoLaw, Shape, Tendon,
};
use crate::kinematics::body_inertia;
use crate::math::{abs, is_finite, max};
use crate::number::count;
use crate::{NumberError, Requirement, Subject};

impl<const F: usize, const J: usize> Hand<F, J> {
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
            at.input(&touch.adc, [0.0, touch.contact_n])?;
        }
        at.not_empty("joints", finger.joints.is_empty())?;
        finger.check_form(&at)?;
        let first = finger.processor().unwrap_or(0);
        for (place, joint) in finger.joints.iter().enumerate() {
            let at = at.joint(place, &joint.name);
            let earlier = finger.joints.iter().take(place);
            at.name(&joint.name, earlier.map(|joint| &joint.name))?;
            let served = at.served(self, joint.processor, ProcessorKind::Servo)?;
            if joint.processor != first {
                let must = Requirement::Equal(first.into());
                let reason = " like that of the finger's first joint; tendons couple the joints of a finger, so give them all one processor";
                return Err(at.off("processor", joint.processor.into(), must, reason));
            }
            let rate_hz = self.rate_hz(served);
            joint.check(&at, rate_hz)?;
            joint.check_stop(&at, rate_hz)?;
            finger.check_crossings(&at, place)?;
        }
        finger.check_arms(&at)
    }
}

impl<const J: usize> Finger<J> {
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
            Form::Chain { tip } => {
                at.list("form.chain.tip", &tip, Requirement::Finite)?;
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

    /// Checks which joints the tendons of a joint cross.
    fn check_crossings(&self, at: &At, index: usize) -> Result<(), Mistake> {
        let crosses = self.joints.get(index).map(|joint| &joint.crosses);
        let crosses = crosses.into_iter().flatten();
        for (number, crossing) in crosses.clone().enumerate() {
            at.table(&entry("crosses", number)).numbers([
                ("flexor_m", crossing.flexor_m, Requirement::Finite),
                ("extensor_m", crossing.extensor_m, Requirement::Finite),
            ])?;
            let crossed = &crossing.joint;
            let mut earlier = crosses.clone().take(number);
            let mut joints = self.joints.iter();
            let rule = match joints.position(|other| other.name == *crossed) {
                None => "it must be a joint of the finger",
                Some(place) if place >= index => "it must be proximal to this one",
                Some(_) if earlier.any(|other| other.joint == *crossed) => "it must be there once",
                Some(_) => continue,
            };
            let value = MistakeValue::Name(crossed.clone());
            let quantity = ": a joint in it";
            let wrong = at.wrong("crosses", value, Allowed::Words(rule));
            return Err(Mistake { quantity, ..wrong });
        }
        Ok(())
    }

    /// Checks that each joint has a torque of its own.
    fn check_arms(&self, at: &At) -> Result<(), Mistake> {
        let Err(NumberError { at: joint, .. }) = self.moment_arms() else {
            return Ok(());
        };
        // All numbers are finite and in order.
        let Subject::Joint(joint) = joint else {
            return Ok(());
        };
        let joint = usize::from(joint);
        let name = self.joints.get(joint).map(|joint| joint.name.clone());
        let at = at.joint(joint, &name.unwrap_or_default());
        let rule = "no tendon turns the joint without others; give its tendons larger arms";
        Err(at.words("flexor.arm_m", "too small", rule))
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

impl<const J: usize> Joint<J> {
    /// The rules of its numbers that do not depend on those of others, or of its tendons.
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
        at.input(&self.adc, [self.limits.low, self.limits.high])?;
        let (flexor, extensor) = (&self.flexor, &self.extensor);
        let (of_flexor, of_extensor) = (at.table("flexor"), at.table("extensor"));
        of_flexor.number("arm_m", flexor.arm_m, POSITIVE)?;
        of_extensor.number("arm_m", extensor.arm_m, Requirement::Below(0.0))?;
        flexor.check(&of_flexor, rate_hz)?;
        extensor.check(&of_extensor, rate_hz)?;
        // Antagonists with different limits need tensions that both can have, so that a joint can have no torque.
        of_flexor.below(("min_n", flexor.min_n), ("extensor.max_n", extensor.max_n))?;
        of_extensor.below(("min_n", extensor.min_n), ("flexor.max_n", flexor.max_n))
    }
}

impl Tendon {
    /// The rules of its numbers that do not depend on others.
    pub(in crate::config) fn rules(&self) -> [Rule; 10] {
        let gains = &self.gains;
        [
            ("slack_n", self.slack_n, NOT_NEGATIVE),
            ("actuator_hz", self.actuator_hz, POSITIVE),
            ("gains.kt", gains.kt, NOT_NEGATIVE),
            ("gains.ki", gains.ki, NOT_NEGATIVE),
            ("gains.kd", gains.kd, NOT_NEGATIVE),
            ("gains.kv", gains.kv, NOT_NEGATIVE),
            ("arm_m", self.arm_m, Requirement::Finite),
            ("min_n", self.min_n, Requirement::Finite),
            ("max_n", self.max_n, Requirement::Finite),
            ("break_n", self.break_n, Requirement::Finite),
        ]
    }

    /// Its tensions, each of which must be below the next.
    pub(in crate::config) const fn order(&self) -> [[(&'static str, f64); 2]; 3] {
        let (slack, least) = (("slack_n", self.slack_n), ("min_n", self.min_n));
        let (largest, breaks) = (("max_n", self.max_n), ("break_n", self.break_n));
        [[slack, least], [least, largest], [largest, breaks]]
    }

    fn check(&self, at: &At, rate_hz: u32) -> Result<(), Mistake> {
        at.numbers(self.rules())?;
        for [tension, above] in self.order() {
            at.below(tension, above)?;
        }
        if let Some(bias_n) = self.bias_n {
            at.number(
                "bias_n",
                bias_n,
                Requirement::Within(self.min_n, self.max_n),
            )?;
        }
        at.cutoff("cutoff_hz", self.cutoff_hz, rate_hz)?;
        at.input(&self.adc, [self.slack_n, self.break_n])?;
        at.output(&self.dac, [0.0, self.max_n])
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
