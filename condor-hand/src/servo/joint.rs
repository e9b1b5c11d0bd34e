use super::impedance::{Impedance, greatest};
use super::transition::Mean;
use super::{
    JointGains, JointSettings, JointTarget, PositionLaw, ServoMode, ServoRefusal, SoftStop,
    TargetQuantity,
};
use crate::control::{Integrator, LowPass};
use crate::math::{Real, clamp, is_finite, min, real};
use crate::number::{NumberError, not_negative};
use crate::tendon::{Pair, TensionAllocation, TensionServos};
use crate::trajectory::SetPoint;

/// The servo of one joint, but what couples it to the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointServo<T: Real> {
    pub(super) gains: JointGains<T>,
    pub(super) target: JointTarget<T>,
    pub(super) tendons: TensionServos<T, 2>,
    pub(super) tension_filter: LowPass<T, 2>,
    /// The mean of its desired tensions in this mode.
    pub(super) mean: Mean<T>,
    /// Its position has been a number once; until then nothing is done about it.
    pub(super) seen: bool,
    stop: SoftStop<T>,
    /// The torques that its own tendons can produce, N m.
    torque: (T, T),
    tension: (T, T),
    integrator: Integrator<T>,
    /// The spring and damper that act; the target's, but for a change that is under way.
    impedance: Impedance<T>,
    /// The part of that change that is left, from 1.
    left: T,
    /// The least inertia of the joint, kg m².
    inertia: T,
}

/// The state of the finger that a joint's law uses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Felt<T> {
    pub(super) position: T,
    pub(super) rate: T,
    /// The torque of the measured tensions, N m.
    pub(super) torque: T,
    /// The torque of the inverse dynamics, for the accelerations that the laws ask for, N m.
    pub(super) inverse: T,
    /// The torque of gravity, N m.
    pub(super) gravity: T,
    /// The friction of the drive at the asked-for rate, N m.
    pub(super) friction: T,
    /// The torques that keep joints from their limits, N m.
    pub(super) stop: T,
    /// Since the last tick, s.
    pub(super) period: T,
}

impl<T: Real> JointServo<T> {
    pub(super) fn new(
        settings: &JointSettings<T>,
        own: Pair<T>,
        inertia: T,
        sample_hz: T,
    ) -> Result<Self, NumberError> {
        settings.gains.check()?;
        settings.stop.check()?;
        not_negative("the largest change of a rate, rad/s,", settings.rate_change)?;
        not_negative("the resolution of a sensor, rad,", settings.resolution_rad)?;
        let what = "the way without a change of a reading, rad,";
        not_negative(what, settings.frozen_rad)?;
        let TensionAllocation { min_n, max_n, .. } = settings.allocation;
        settings.allocation.check()?;
        Ok(Self {
            gains: settings.gains,
            target: JointTarget::Off,
            tendons: TensionServos::new(settings.gains.tension.lanes(), max_n, sample_hz)?,
            tension_filter: LowPass::new(settings.tension_cutoff_hz.lanes(), sample_hz)?,
            mean: Mean::new(),
            seen: false,
            stop: settings.stop,
            torque: (own.extensor * (max_n - min_n), own.flexor * (max_n - min_n)),
            tension: (min_n, max_n),
            integrator: settings.gains.integrator()?,
            impedance: Impedance::none(),
            left: T::zero(),
            inertia,
        })
    }

    /// Checks that the joint can have this target.
    pub(super) fn check(&self, joint: usize, target: &JointTarget<T>) -> Result<(), ServoRefusal> {
        let within = |quantity: TargetQuantity, value: T, (low, high): (T, T)| {
            if low <= value && value <= high {
                return Ok(());
            }
            Err(ServoRefusal::Target {
                joint: joint as u32,
                quantity,
                value: value.to_f64(),
                low: low.to_f64(),
                high: high.to_f64(),
            })
        };
        let limits = (self.stop.low, self.stop.high);
        match *target {
            JointTarget::Off => {}
            JointTarget::Tension(pair) => {
                within(TargetQuantity::Tension, pair.flexor, self.tension)?;
                within(TargetQuantity::Tension, pair.extensor, self.tension)?;
            }
            JointTarget::Torque(torque) | JointTarget::Grasp(torque) => {
                within(TargetQuantity::Torque, torque, self.torque)?;
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
                            value: value.to_f64(),
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
                within(TargetQuantity::Stiffness, stiffness, (T::zero(), stiffest))?;
                within(TargetQuantity::Damping, damping, (T::zero(), most))?;
                within(TargetQuantity::Position, position, limits)?;
            }
        }
        Ok(())
    }

    /// The desired position, rad; NaN if the joint follows nothing.
    #[inline(always)]
    pub(super) fn target_position(&self) -> T {
        match self.target {
            JointTarget::Position(point) => point.position,
            _ => T::zero() / T::zero(),
        }
    }

    /// Returns true if only the set-point changes, and to one that the joint can have.
    #[inline(always)]
    pub(super) fn may_go_on(&self, point: &SetPoint<T>) -> bool {
        // Zero times each: the sum is NaN if one of them is not finite.
        let nothing = (point.velocity + point.acceleration) * T::zero();
        matches!(self.target, JointTarget::Position(_))
            && point.position >= self.stop.low
            && point.position <= self.stop.high
            && nothing == T::zero()
    }

    /// The target that keeps a joint where it is, in another mode: at the position, with the tensions and
    /// their torque (N, N m). `loads` are the parts of the torque
    /// that an impedance adds by itself, N m.
    pub(super) fn hold(
        &self,
        mode: ServoMode,
        position: T,
        tension: Pair<T>,
        torque: T,
        loads: T,
    ) -> JointTarget<T> {
        let torque = clamp(torque, self.torque.0, self.torque.1);
        match mode {
            ServoMode::Off => JointTarget::Off,
            ServoMode::Tension => JointTarget::Tension(tension),
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
    pub(super) fn between_stops(&self, target: JointTarget<T>) -> JointTarget<T> {
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

    /// Takes a target that was checked.
    pub(super) fn take(&mut self, target: JointTarget<T>) {
        if target.mode() != self.target.mode() {
            self.mean = Mean::new();
            self.integrator.set(T::zero());
            self.left = T::zero();
            self.impedance = Impedance::of(&target).unwrap_or(self.impedance);
        } else if target.mode() == ServoMode::Impedance {
            self.left = T::one();
        } else if target.mode() == ServoMode::Torque {
            self.mean = Mean::new();
        }
        self.target = target;
    }

    /// Goes on from one impedance to the next, by such a part of the way.
    #[inline(always)]
    pub(super) fn go_on(&mut self, part: T) {
        if self.left > T::zero()
            && let Some(target) = Impedance::of(&self.target)
        {
            self.impedance
                .approach(&target, min(part / self.left, T::one()));
            self.left -= min(part, self.left);
        }
    }

    /// The acceleration that its law asks of the inverse dynamics, rad/s²; zero if it does not.
    #[inline(always)]
    pub(super) fn acceleration(&self, position: T, rate: T) -> T {
        match (self.target, self.gains.law) {
            _ if !self.seen => T::zero(),
            (
                JointTarget::Position(set_point),
                PositionLaw::ComputedTorque {
                    bandwidth_hz,
                    damping_ratio,
                },
            ) => {
                let w = T::two_pi() * bandwidth_hz;
                let error = set_point.position - position;
                let error_rate = set_point.velocity - rate;
                set_point.acceleration
                    + w * (real::<T>(2.0) * damping_ratio * error_rate + w * error)
            }
            _ => T::zero(),
        }
    }

    /// The acceleration that keeps it from its limits, rad/s²; zero where its tensions are given.
    #[inline(always)]
    pub(super) fn stop(&self, position: T, rate: T) -> T {
        match self.target {
            JointTarget::Torque(_)
            | JointTarget::Position(_)
            | JointTarget::Grasp(_)
            | JointTarget::Impedance { .. }
                if self.seen =>
            {
                self.stop.acceleration(position, rate)
            }
            _ => T::zero(),
        }
    }

    /// The torque of its law, N m; zero where its tensions are given.
    #[inline(always)]
    pub(super) fn torque(&mut self, felt: &Felt<T>) -> T {
        let law = match self.target {
            JointTarget::Off | JointTarget::Tension(_) => return T::zero(),
            JointTarget::Torque(torque) | JointTarget::Grasp(torque) => {
                torque + self.gains.k_torque * (torque - felt.torque)
            }
            JointTarget::Position(_) | JointTarget::Impedance { .. } if !self.seen => {
                return T::zero();
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
                    self.integrator
                        .update(rest, increment, low, high)
                        .unwrap_or(rest)
                }
            },
        };
        let torque = law + felt.stop;
        if is_finite(torque) {
            clamp(torque, self.torque.0, self.torque.1)
        } else {
            T::zero()
        }
    }

    /// Off, with nothing in any integral.
    pub(super) fn rest(&mut self) {
        self.take(JointTarget::Off);
        self.mean = Mean::new();
        self.tendons.reset();
    }

    /// The tensions that are given to it, where it has no torque of its own.
    pub(super) fn given_tensions(&self) -> Option<Pair<T>> {
        match self.target {
            JointTarget::Off => Some(Pair::both(self.tension.0)),
            JointTarget::Tension(pair) => Some(pair),
            JointTarget::Torque(_)
            | JointTarget::Position(_)
            | JointTarget::Grasp(_)
            | JointTarget::Impedance { .. } => None,
        }
    }

    /// Another stop, of the same damping, from the next tick on.
    pub(super) fn set_stop(&mut self, stop: &SoftStop<T>) -> Result<(), NumberError> {
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
    pub(super) fn set_gains(&mut self, gains: &JointGains<T>) -> Result<(), NumberError> {
        gains.check()?;
        let mut integrator = gains.integrator()?;
        integrator.set(self.integrator.term());
        let mut tendons = self.tendons;
        tendons.set_gains(gains.tension.lanes())?;
        self.gains = *gains;
        self.integrator = integrator;
        self.tendons = tendons;
        Ok(())
    }
}

impl<T: Real> JointGains<T> {
    fn integrator(&self) -> Result<Integrator<T>, NumberError> {
        Integrator::new(match self.law {
            PositionLaw::Pd { integral_nm, .. } => integral_nm,
            PositionLaw::ComputedTorque { .. } => T::zero(),
        })
    }
}
