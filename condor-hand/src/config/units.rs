//! The units of positions and efforts, by the kinds of joints.

use super::{Actuator, Finger, Joint, JointMotion};

impl Joint {
    /// Returns the unit of the position of the joint: m for a sliding joint, and otherwise rad.
    #[must_use]
    pub fn position_unit(&self) -> &'static str {
        if self.slides() { "m" } else { "rad" }
    }

    fn slides(&self) -> bool {
        let mount = self.mount.as_ref();
        mount.is_some_and(|mount| matches!(mount.motion, JointMotion::Prismatic(_)))
    }
}

impl<const JOINTS: usize, const ACTUATORS: usize> Finger<JOINTS, ACTUATORS> {
    /// Returns the unit of the effort of an actuator: N m if the actuator pushes and pulls and its first joint turns, as
    /// that of a motor, and otherwise N, as that of a tendon.
    #[must_use]
    pub fn effort_unit(&self, actuator: &Actuator<JOINTS>) -> &'static str {
        if self.turns(actuator) { "N m" } else { "N" }
    }

    /// Returns the unit of the position of an actuator: rad if the unit of its effort is N m, and otherwise m.
    #[must_use]
    pub fn actuator_position_unit(&self, actuator: &Actuator<JOINTS>) -> &'static str {
        if self.turns(actuator) { "rad" } else { "m" }
    }

    fn turns(&self, actuator: &Actuator<JOINTS>) -> bool {
        let mut moved = (self.joints.iter()).filter(|joint| self.arm(actuator, joint) != 0.0);
        actuator.limits.low < 0.0 && !moved.next().is_some_and(Joint::slides)
    }
}
