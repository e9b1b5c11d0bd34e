use super::impedance::{Impedance, greatest};
use super::{
    JointGains, JointSettings, JointTarget, PositionLaw, ServoMode, ServoRefusal, SoftStop,
    TargetQuantity,
};
use crate::control::Integrator;
use crate::math::{clamp, is_finite, min};
use crate::number::{NumberError, not_negative};
use crate::trajectory::SetPoint;

/// The servo of one joint, but what couples it to the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointServo {
    pub(super) gains: JointGains,
    pub(super) target: JointTarget,
    /// Its position has been a number once; until then nothing is done about it.
    pub(super) seen: bool,
    stop: SoftStop,
    /// The torques that actuators can give it, N m.
    torque: (f64, f64),
    integrator: Integrator,
    /// The spring and damper that act; the target's, but for a change that is under way.
    impedance: Impedance,
    /// The part of that change that is left, from 1.
    left: f64,
    /// The least inertia of the joint, kg m².
    inertia: f64,
}

/// The state of the finger that a joint's law uses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Felt {
    pub(super) position: f64,
    pub(super) rate: f64,
    /// The torque of the measured efforts, N m; NaN if an actuator of the joint has no sensor.
    pub(super) torque: f64,
    /// The torque of the inverse dynamics, for the accelerations that the laws ask for, N m.
    pub(super) inverse: f64,
    /// The torque of gravity, N m.
    pub(super) gravity: f64,
    /// The friction of the drive at the asked-for rate, N m.
    pub(super) friction: f64,
    /// The torques that keep joints from their limits, N m.
    pub(super) stop: f64,
    /// Since the last tick, s.
    pub(super) period: f64,
}

impl JointServo {
    pub(super) fn new(
        settings: &JointSettings,
        torque: (f64, f64),
        inertia: f64,
    ) -> Result<Self, NumberError> {
        settings.gains.check()?;
        settings.stop.check()?;
        not_negative("the largest change of a rate, rad/s,", settings.rate_change)?;
        not_negative("the resolution of a sensor, rad,", settings.resolution_rad)?;
        let what = "the way without a change of a reading, rad,";
        not_negative(what, settings.frozen_rad)?;
        Ok(Self {
            gains: settings.gains,
            target: JointTarget::Off,
            seen: false,
            stop: settings.stop,
            torque,
            integrator: settings.gains.integrator()?,
            impedance: Impedance::none(),
            left: 0.0,
            inertia,
        })
    }

    /// Checks that the joint can have this target.
    pub(super) fn check(&self, joint: usize, target: &JointTarget) -> Result<(), ServoRefusal> {
        let within = |quantity: TargetQuantity, value: f64, (low, high): (f64, f64)| {
            if low <= value && value <= high {
                return Ok(());
            }
            Err(ServoRefusal::Target {
                joint: joint as u32,
                quantity,
                value,
                low,
                high,
            })
        };
        let limits = (self.stop.low, self.stop.high);
        match *target {
            JointTarget::Off | JointTarget::Effort => {}
            JointTarget::Torque(torque) => within(TargetQuantity::Torque, torque, self.torque)?,
            // A grasp gets what the actuators can give.
            JointTarget::Grasp(torque) => {
                let any = (-f64::MAX, f64::MAX);
                within(TargetQuantity::Torque, torque, any)?;
            }
            JointTarget::Position(point) => {
                within(TargetQuantity::Position, point.position, limits)?;
                for (quantity, value) in [
                    (TargetQuantity::Velocity, point.velocity),
                    (TargetQuantity::Acceleration, point.acceleration),
                ] {
                    if !is_finite(value) {
                        return Err(ServoRefusal::Rate {
                            joint: joint as u32,
                            quantity,
                            value,
                        });
                    }
                }
            }
            JointTarget::Impedance {
                position,
                stiffness,
                damping,
            } => {
                let (stiffest, most) = greatest(&self.gains.law, self.inertia);
                within(TargetQuantity::Stiffness, stiffness, (0.0, stiffest))?;
                within(TargetQuantity::Damping, damping, (0.0, most))?;
                within(TargetQuantity::Position, position, limits)?;
            }
        }
        Ok(())
    }

    /// The desired position, rad; NaN if the joint follows nothing.
    #[inline(always)]
    pub(super) fn target_position(&self) -> f64 {
        match self.target {
            JointTarget::Position(point) => point.position,
            _ => f64::NAN,
        }
    }

    /// Returns true if only the set-point changes, and to one that the joint can have.
    #[inline(always)]
    pub(super) fn may_go_on(&self, point: &SetPoint) -> bool {
        // Zero times each: the sum is NaN if one of them is not finite.
        let nothing = (point.velocity + point.acceleration) * 0.0;
        matches!(self.target, JointTarget::Position(_))
            && point.position >= self.stop.low
            && point.position <= self.stop.high
            && nothing == 0.0
    }

    /// The target that keeps a joint where it is, in another mode: at the position, with the torque, N m. `loads` are
    /// the parts of the torque that an impedance adds by itself, N m.
    pub(super) fn hold(
        &self,
        mode: ServoMode,
        position: f64,
        torque: f64,
        loads: f64,
    ) -> JointTarget {
        let torque = clamp(torque, self.torque.0, self.torque.1);
        match mode {
            ServoMode::Off => JointTarget::Off,
            ServoMode::Effort => JointTarget::Effort,
            ServoMode::Torque => JointTarget::Torque(torque),
            ServoMode::Grasp => JointTarget::Grasp(torque),
            ServoMode::Position => JointTarget::Position(SetPoint::rest(clamp(
                position,
                self.stop.low,
                self.stop.high,
            ))),
            ServoMode::Impedance => {
                let (stiffness, damping) = greatest(&self.gains.law, self.inertia);
                let stretch = (torque - loads) / stiffness;
                // A joint that was off had no torque to keep.
                let rest = if is_finite(stretch) && self.target != JointTarget::Off {
                    position + stretch
                } else {
                    position
                };
                JointTarget::Impedance {
                    position: clamp(rest, self.stop.low, self.stop.high),
                    stiffness,
                    damping,
                }
            }
        }
    }

    /// A target that was checked, out of the zones of the stops.
    pub(super) fn between_stops(&self, target: JointTarget) -> JointTarget {
        let (low, high) = self.stop.between();
        match target {
            JointTarget::Position(point) if point.position < low => {
                JointTarget::Position(SetPoint::rest(low))
            }
            JointTarget::Position(point) if point.position > high => {
                JointTarget::Position(SetPoint::rest(high))
            }
            target => target,
        }
    }

    /// Takes a target that was checked. Returns true if the mean of the efforts begins anew with it.
    pub(super) fn take(&mut self, target: JointTarget) -> bool {
        let mut begins = true;
        if target.mode() != self.target.mode() {
            self.integrator.set(0.0);
            self.left = 0.0;
            self.impedance = Impedance::of(&target).unwrap_or(self.impedance);
        } else if target.mode() == ServoMode::Impedance {
            self.left = 1.0;
            begins = false;
        } else if target.mode() != ServoMode::Torque {
            begins = false;
        }
        self.target = target;
        begins
    }

    /// Goes on from one impedance to the next, by such a part of the way.
    #[inline(always)]
    pub(super) fn go_on(&mut self, part: f64) {
        if self.left > 0.0
            && let Some(target) = Impedance::of(&self.target)
        {
            self.impedance.approach(&target, min(part / self.left, 1.0));
            self.left -= min(part, self.left);
        }
    }

    /// The acceleration that its law asks of the inverse dynamics, rad/s²; zero if it does not.
    #[inline(always)]
    pub(super) fn acceleration(&self, position: f64, rate: f64) -> f64 {
        match (self.target, self.gains.law) {
            _ if !self.seen => 0.0,
            (
                JointTarget::Position(set_point),
                PositionLaw::ComputedTorque {
                    bandwidth_hz,
                    damping_ratio,
                },
            ) => {
                let w = core::f64::consts::TAU * bandwidth_hz;
                let error = set_point.position - position;
                let error_rate = set_point.velocity - rate;
                set_point.acceleration + w * (2.0 * damping_ratio * error_rate + w * error)
            }
            _ => 0.0,
        }
    }

    /// The acceleration that keeps it from its limits, rad/s²; zero where its efforts are given.
    #[inline(always)]
    pub(super) fn stop(&self, position: f64, rate: f64) -> f64 {
        match self.target {
            JointTarget::Torque(_)
            | JointTarget::Position(_)
            | JointTarget::Grasp(_)
            | JointTarget::Impedance { .. }
                if self.seen =>
            {
                self.stop.acceleration(position, rate)
            }
            _ => 0.0,
        }
    }

    /// The torque of its law, N m, which actuators may not have; zero where its efforts are given.
    #[inline(always)]
    pub(super) fn torque(&mut self, felt: &Felt) -> f64 {
        let law = match self.target {
            JointTarget::Off | JointTarget::Effort => return 0.0,
            JointTarget::Torque(torque) | JointTarget::Grasp(torque) => {
                let error = torque - felt.torque;
                if is_finite(error) {
                    torque + self.gains.k_torque * error
                } else {
                    torque
                }
            }
            JointTarget::Position(_) | JointTarget::Impedance { .. } if !self.seen => {
                return 0.0;
            }
            JointTarget::Impedance { .. } => {
                self.impedance.torque(felt.position, felt.rate) + felt.gravity
            }
            JointTarget::Position(set_point) => match self.gains.law {
                PositionLaw::ComputedTorque { .. } => felt.inverse + felt.friction,
                PositionLaw::Pd { kp, kv, ki, .. } => {
                    let error = set_point.position - felt.position;
                    let rest = kp * error
                        + kv * (set_point.velocity - felt.rate)
                        + felt.gravity
                        + felt.friction;
                    let (low, high) = self.torque;
                    let increment = ki * error * felt.period;
                    // The transmission limits the torque, and says so.
                    match self.integrator.update(rest, increment, low, high) {
                        Some(_) => rest + self.integrator.term(),
                        None => rest,
                    }
                }
            },
        };
        let torque = law + felt.stop;
        if is_finite(torque) { torque } else { 0.0 }
    }

    /// The least and the greatest torque that the actuators can give it from now on, N m.
    #[inline(always)]
    pub(super) fn set_torque_range(&mut self, torque: (f64, f64)) {
        self.torque = torque;
    }

    /// Off, with nothing in the integral.
    pub(super) fn rest(&mut self) {
        self.take(JointTarget::Off);
    }

    /// Returns true if a law of the joint asks for a torque.
    #[inline(always)]
    pub(super) const fn is_active(&self) -> bool {
        !matches!(self.target, JointTarget::Off | JointTarget::Effort)
    }

    /// Another stop, of the same damping, from the next tick on.
    pub(super) fn set_stop(&mut self, stop: &SoftStop) -> Result<(), NumberError> {
        let damping_ratio = self.stop.damping_ratio;
        let stop = SoftStop {
            damping_ratio,
            ..*stop
        };
        stop.check()?;
        self.stop = stop;
        Ok(())
    }

    /// Other gains from the next tick on.
    pub(super) fn set_gains(&mut self, gains: &JointGains) -> Result<(), NumberError> {
        gains.check()?;
        let mut integrator = gains.integrator()?;
        integrator.set(self.integrator.term());
        self.gains = *gains;
        self.integrator = integrator;
        Ok(())
    }
}

impl JointGains {
    fn integrator(&self) -> Result<Integrator, NumberError> {
        Integrator::new(match self.law {
            PositionLaw::Pd { integral_nm, .. } => integral_nm,
            PositionLaw::ComputedTorque { .. } => 0.0,
        })
    }
}
