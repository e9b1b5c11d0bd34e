use super::{Guards, MotionGuard, MotionTicket};

/// The conditions under which the servo of a joint stops the motion that moves the joint. The
/// generator passes them to the servo together with the set-point.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StopGuard {
    /// The [number](MotionTicket::number) of the motion that moves the joint, or moved it last; 0 for
    /// none.
    pub motion: u32,
    /// The torque, to either side, above which the motion stops, N m; infinite for no such
    /// condition.
    pub torque: f64,
    /// The effort of an actuator of the joint, to either side, above which the motion stops, N or N m;
    /// infinite for no such condition.
    pub effort: f64,
    /// True if a contact of the finger stops the motion.
    pub contact: bool,
}

impl StopGuard {
    /// A guard for a joint that no motion moves; nothing is checked.
    pub const NONE: Self = Self::of(0);

    /// A motion without any condition.
    pub(super) const fn of(motion: u32) -> Self {
        Self {
            motion,
            torque: f64::INFINITY,
            effort: f64::INFINITY,
            contact: false,
        }
    }

    /// The conditions of a motion that a servo can check.
    pub(super) fn new(motion: u32, guards: &Guards) -> Self {
        let limit = |limit: Option<f64>| limit.unwrap_or(f64::INFINITY);
        Self {
            motion,
            torque: limit(guards.torque),
            effort: limit(guards.effort),
            contact: guards.contact,
        }
    }

    /// Returns true if the guard belongs to a motion and has at least one condition to check.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        let Self {
            motion,
            torque,
            effort,
            contact,
        } = *self;
        motion != 0 && (torque != f64::INFINITY || effort != f64::INFINITY || contact)
    }

    /// The first condition that does not fail for certain, with what was measured; `contact_n` is
    /// the force of a contact.
    pub(crate) fn first(
        &self,
        joint: usize,
        torque: f64,
        effort: f64,
        touch: f64,
        contact_n: f64,
    ) -> Option<(MotionGuard, f64)> {
        let exceeds = |value: f64, limit: f64| limit != f64::INFINITY && !(value <= limit);
        let torque = crate::math::abs(torque);
        if exceeds(torque, self.torque) {
            return Some((MotionGuard::Torque { joint }, torque));
        }
        if exceeds(effort, self.effort) {
            return Some((MotionGuard::Effort { joint }, effort));
        }
        let touches = self.contact && exceeds(touch, contact_n);
        touches.then_some((MotionGuard::Contact { joint }, touch))
    }
}

impl MotionTicket {
    /// Returns the number by which servos know this motion, in [`StopGuard::motion`]; it is never
    /// 0.
    #[must_use]
    pub const fn number(self) -> u32 {
        match self.0.wrapping_add(1) {
            0 => 1,
            number => number,
        }
    }
}
