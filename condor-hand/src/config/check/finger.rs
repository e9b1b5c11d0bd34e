//! Rules of fingers, joints and tendons.

use nalgebra::Matrix3;

use super::place::{Examiner, NOT_NEGATIVE, POSITIVE, Root, join};
use super::shared::ORTHONORMAL;
use crate::config::{
    Finger, Form, Joint, JointMotion, LinkBody, Mistake, Problem, ProcessorKind, Rotation,
    ServoLaw, Shape, Tendon,
};
use crate::kinematics::body_inertia;
use crate::math::{abs, is_finite, max};
use crate::tendon::Rectification;
use crate::{NumberError, Requirement, Subject};

impl<const F: usize, const J: usize> Examiner<'_, F, J> {
    pub(super) fn finger(&mut self, index: usize, finger: &Finger<J>) -> Result<(), Mistake> {
        let root = Root::Finger(index);
        let fingers = &self.hand.fingers;
        self.name(
            root,
            &finger.name,
            fingers.iter().take(index).map(|finger| &finger.name),
        )?;
        self.list(root, "base.position", &finger.base.position)?;
        self.rotation(root, "base.rotation", &finger.base.rotation)?;
        if let Some(touch) = &finger.touch {
            let contact_n = touch.contact_n;
            self.number(root, "touch.contact_n", contact_n, POSITIVE)?;
            self.converters(root, "touch", (&touch.adc, [0.0, contact_n]), None)?;
        }
        self.not_empty(root, "joints", finger.joints.is_empty())?;
        let first = finger.processor().unwrap_or(0);
        self.form(index, finger)?;
        for (place, joint) in finger.joints.iter().enumerate() {
            let root = Root::Joint(index, place);
            let earlier = finger.joints.iter().take(place);
            self.name(root, &joint.name, earlier.map(|joint| &joint.name))?;
            let served = self.processor(root, joint.processor, ProcessorKind::Servo)?;
            let rate_hz = self.hand.rate_hz(served);
            let number = joint.processor;
            if number != first {
                let problem = Problem::SplitFinger { number, first };
                return Err(self.wrong(root, "processor", problem));
            }
            self.joint(root, joint, rate_hz)?;
            self.stop(root, joint, rate_hz)?;
            self.crossings(root, finger, place)?;
        }
        self.arms(index, finger)
    }

    /// Checks the joints against the conditions of the finger's mechanism.
    fn form(&mut self, index: usize, finger: &Finger<J>) -> Result<(), Mistake> {
        let planar = match finger.form {
            Form::Planar {
                lengths: [l0, l1, l2, l3],
            } => {
                let rows = [
                    ("lengths[0]", l0, NOT_NEGATIVE),
                    ("lengths[1]", l1, POSITIVE),
                    ("lengths[2]", l2, POSITIVE),
                    ("lengths[3]", l3, POSITIVE),
                ];
                self.numbers(Root::Finger(index), "form.planar", rows)?;
                let joints = finger.joints.len();
                if joints != 4 {
                    let problem = Problem::PlanarJoints { joints };
                    return Err(self.wrong(Root::Finger(index), "", problem));
                }
                true
            }
            Form::Chain { tip } => {
                self.list(Root::Finger(index), "form.chain.tip", &tip)?;
                false
            }
        };
        for (number, joint) in finger.joints.iter().enumerate() {
            let root = Root::Joint(index, number);
            match &joint.mount {
                Some(_) if planar => {
                    let problem =
                        "is needless: in a planar finger the lengths say where joints are";
                    return Err(self.wrong(root, "mount", Problem::Is(problem)));
                }
                None if !planar => {
                    let problem = "has no `mount`, which a joint of a chain needs";
                    return Err(self.wrong(root, "", Problem::Is(problem)));
                }
                Some(mount) => {
                    self.list(root, "mount.position", &mount.position)?;
                    self.rotation(root, "mount.rotation", &mount.rotation)?;
                    match mount.motion {
                        JointMotion::Revolute(axis) => {
                            self.unit(root, "mount.motion.revolute", axis)?;
                        }
                        JointMotion::Prismatic(axis) => {
                            self.unit(root, "mount.motion.prismatic", axis)?;
                        }
                    }
                }
                None => {}
            }
            if let Some(body) = &joint.body {
                self.body(root, body, planar)?;
            }
        }
        Ok(())
    }

    fn body(&mut self, root: Root, body: &LinkBody, planar: bool) -> Result<(), Mistake> {
        let off_axis = Problem::Is("is not on the x axis; a planar finger's links are");
        self.number(root, "body.mass_kg", body.mass_kg, POSITIVE)?;
        self.list(root, "body.center", &body.center)?;
        let shape = match body.shape {
            Shape::Cuboid([x, y, z]) => {
                let rows = [
                    ("cuboid[0]", x, POSITIVE),
                    ("cuboid[1]", y, POSITIVE),
                    ("cuboid[2]", z, POSITIVE),
                ];
                self.numbers(root, "body.shape", rows)?;
                "body.shape.cuboid"
            }
            Shape::Inertia { moments, products } => {
                self.list(root, "body.shape.inertia.moments", &moments)?;
                let field = "body.shape.inertia.products";
                self.list(root, field, &products)?;
                if planar && products != [0.0; 3] {
                    return Err(self.wrong(root, field, off_axis));
                }
                "body.shape.inertia.moments"
            }
        };
        let [_, y, z] = body.center;
        if planar && (y != 0.0 || z != 0.0) {
            return Err(self.wrong(root, "body.center", off_axis));
        }
        if possible(&body.rigid_body().inertia) {
            return Ok(());
        }
        Err(self.wrong(root, shape, Problem::Is("is no inertia of a body")))
    }
}

/// Returns true if a body can have this inertia: positive definite, and no moment above the sum of the two
/// others, both in any axes.
fn possible(inertia: &Matrix3<f64>) -> bool {
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

impl<const F: usize, const J: usize> Examiner<'_, F, J> {
    fn joint(&mut self, root: Root, joint: &Joint<J>, rate_hz: u32) -> Result<(), Mistake> {
        self.limits(root, &joint.limits)?;
        let (servo, stop, friction) = (&joint.servo, &joint.stop, &joint.friction);
        let range = joint.limits.high - joint.limits.low;
        let rows = [
            ("servo.kp", servo.kp, NOT_NEGATIVE),
            ("servo.kv", servo.kv, NOT_NEGATIVE),
            ("servo.ki", servo.ki, NOT_NEGATIVE),
            ("servo.integral_max", servo.integral_max, NOT_NEGATIVE),
            ("servo.bandwidth_hz", servo.bandwidth_hz, NOT_NEGATIVE),
            ("servo.zeta", servo.zeta, NOT_NEGATIVE),
            ("servo.k_tau", servo.k_tau, NOT_NEGATIVE),
            ("stop.zone", stop.zone, NOT_NEGATIVE),
            ("stop.zone", stop.zone, Requirement::AtMost(0.5 * range)),
            ("stop.bandwidth_hz", stop.bandwidth_hz, NOT_NEGATIVE),
            ("stop.damping_ratio", stop.damping_ratio, NOT_NEGATIVE),
            ("friction.armature", friction.armature, NOT_NEGATIVE),
            ("friction.viscous", friction.viscous, NOT_NEGATIVE),
            ("friction.coulomb", friction.coulomb, NOT_NEGATIVE),
            ("friction.coulomb_rate", friction.coulomb_rate, NOT_NEGATIVE),
            ("friction.tendon", friction.tendon, NOT_NEGATIVE),
        ];
        self.numbers(root, "", rows)?;
        // A law whose gain is zero or left out does nothing.
        let (field, gain) = match servo.law {
            ServoLaw::Pd => ("servo.kp", servo.kp),
            ServoLaw::Decoupled => ("servo.bandwidth_hz", servo.bandwidth_hz),
        };
        self.number(root, field, gain, POSITIVE)?;
        if friction.coulomb > 0.0 {
            let rate = friction.coulomb_rate;
            self.number(root, "friction.coulomb_rate", rate, POSITIVE)?;
        }
        if let Some(cutoff_hz) = servo.position_cutoff_hz {
            self.cutoff(root, "servo.position_cutoff_hz", cutoff_hz, rate_hz)?;
        }
        self.cutoff(
            root,
            "servo.velocity_cutoff_hz",
            servo.velocity_cutoff_hz,
            rate_hz,
        )?;
        let position = [joint.limits.low, joint.limits.high];
        self.converters(root, "", (&joint.adc, position), None)?;
        self.tendon(root, "flexor", &joint.flexor, rate_hz)?;
        self.tendon(root, "extensor", &joint.extensor, rate_hz)?;
        // Antagonists with different limits need tensions that both can have.
        let (flexor, extensor) = (&joint.flexor, &joint.extensor);
        let limit = ("extensor.max_n", extensor.max_n);
        self.below(root, "flexor", ("min_n", flexor.min_n), limit)?;
        let limit = ("flexor.max_n", flexor.max_n);
        self.below(root, "extensor", ("min_n", extensor.min_n), limit)?;
        let (least, largest) = joint.tension_range();
        match joint.rectification {
            Rectification::Hard => Ok(()),
            Rectification::Mean {
                co_contraction_n: mean,
            } => {
                let field = "rectification.mean.co_contraction_n";
                self.number(root, field, mean, Requirement::AtLeast(least))?;
                self.number(root, field, mean, Requirement::AtMost(largest))
            }
            Rectification::Smooth {
                softness_n: softness,
            } => {
                let field = "rectification.smooth.softness_n";
                self.number(root, field, softness, POSITIVE)?;
                self.number(root, field, softness, Requirement::AtMost(largest - least))
            }
        }
    }

    fn tendon(
        &mut self,
        root: Root,
        table: &'static str,
        tendon: &Tendon,
        rate_hz: u32,
    ) -> Result<(), Mistake> {
        let gains = &tendon.gains;
        let rows = [
            ("slack_n", tendon.slack_n, NOT_NEGATIVE),
            ("actuator_hz", tendon.actuator_hz, POSITIVE),
            ("gains.kt", gains.kt, NOT_NEGATIVE),
            ("gains.ki", gains.ki, NOT_NEGATIVE),
            ("gains.kd", gains.kd, NOT_NEGATIVE),
            ("gains.kv", gains.kv, NOT_NEGATIVE),
            ("arm_m", tendon.arm_m, Requirement::Finite),
        ];
        self.numbers(root, table, rows)?;
        let (slack, least) = (("slack_n", tendon.slack_n), ("min_n", tendon.min_n));
        let (largest, breaking) = (("max_n", tendon.max_n), ("break_n", tendon.break_n));
        self.below(root, table, slack, least)?;
        self.below(root, table, least, largest)?;
        self.below(root, table, largest, breaking)?;
        if let Some(cutoff_hz) = tendon.cutoff_hz {
            self.cutoff(root, &join(table, "cutoff_hz"), cutoff_hz, rate_hz)?;
        }
        let seen = [tendon.slack_n, tendon.break_n];
        let made = [0.0, tendon.max_n];
        self.converters(root, table, (&tendon.adc, seen), Some((&tendon.dac, made)))
    }

    /// Which joints the tendons of a joint cross.
    fn crossings(&mut self, root: Root, finger: &Finger<J>, index: usize) -> Result<(), Mistake> {
        let crosses = finger.joints.get(index).map(|joint| &joint.crosses);
        let crosses = crosses.into_iter().flatten();
        for (number, crossing) in crosses.clone().enumerate() {
            self.list(root, "crosses", &[crossing.flexor_m, crossing.extensor_m])?;
            let crossed = &crossing.joint;
            let mut earlier = crosses.clone().take(number);
            let place = finger
                .joints
                .iter()
                .position(|other| other.name == *crossed);
            let problem = match place {
                None => "the finger does not have",
                Some(place) if place >= index => "is not proximal to it",
                Some(_) if earlier.any(|other| other.joint == *crossed) => {
                    "an entry before names too"
                }
                Some(_) => continue,
            };
            let crossed = crossed.clone();
            return Err(self.wrong(root, "crosses", Problem::Crosses { crossed, problem }));
        }
        Ok(())
    }

    /// Checks the moment arms against the conditions of the tendon level.
    fn arms(&mut self, index: usize, finger: &Finger<J>) -> Result<(), Mistake> {
        let Err(NumberError {
            at, value, must, ..
        }) = finger.moment_arms()
        else {
            return Ok(());
        };
        let (joint, field) = match at {
            Subject::Flexor(joint) => (joint, "flexor.arm_m"),
            Subject::Extensor(joint) => (joint, "extensor.arm_m"),
            // These are ruled out before: crossings are proximal, and all numbers finite.
            Subject::Crossing { tendon, .. } => (tendon, "crosses"),
            _ => (0, ""),
        };
        let problem = Problem::Number { value, must };
        Err(self.wrong(Root::Joint(index, joint.into()), field, problem))
    }

    fn rotation(&mut self, root: Root, field: &str, rotation: &Rotation) -> Result<(), Mistake> {
        let numbers = match rotation {
            Rotation::None => return Ok(()),
            Rotation::Axis { axis, angle } => {
                let angle = (&*join(field, "axis.angle"), *angle, Requirement::Finite);
                self.numbers(root, "", [angle])?;
                return self.unit(root, &join(field, "axis.axis"), *axis);
            }
            Rotation::Rpy(angles) => &angles[..],
            Rotation::Rows(rows) => rows.as_flattened(),
        };
        self.list(root, field, numbers)?;
        let matrix = rotation.matrix();
        let products = matrix.transpose() * matrix - Matrix3::identity();
        let error = products
            .iter()
            .fold(0.0, |worst, &entry| max(abs(entry), worst));
        let determinant = matrix.determinant();
        if error <= ORTHONORMAL && determinant > 0.0 {
            return Ok(());
        }
        let problem = Problem::NotRotation { error, determinant };
        Err(self.wrong(root, field, problem))
    }
}
