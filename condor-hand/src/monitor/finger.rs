use super::variable::{Kind, Variable};
use crate::config::{Finger, Name};
use crate::controller::Tick;
use crate::servo::Sensed;
use crate::tendon::Pair;

/// What there is to watch of `F` fingers of `N` joints: which number of a variable means what.
#[derive(Clone, Debug)]
pub struct FingerVariables<const F: usize, const N: usize> {
    fingers: [(Name, [Name; N]); F],
}

/// A quantity of a finger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Of the joint of this number.
    Joint(usize, JointVariable),
    /// Of the flexor of this joint.
    Flexor(usize, TendonVariable),
    /// Of the extensor of this joint.
    Extensor(usize, TendonVariable),
    /// A bit for each joint whose tendons cannot give the torque that it needs.
    Saturated,
    /// The number of the fault's code plus 1; 0 without fault.
    Fault,
}

/// A quantity of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum JointVariable {
    /// The filtered position, rad.
    Position = 0,
    /// Its rate, rad/s.
    Velocity = 1,
    /// The position that the joint is to have, rad; NaN where positions are not controlled.
    Target = 2,
    /// The torque of the desired tensions, N m.
    Torque = 3,
    /// Target less position, rad; NaN where positions are not controlled.
    Error = 4,
}

/// A quantity of a tendon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum TendonVariable {
    /// What its sensor measures, N.
    Tension = 0,
    /// What it is to have, N.
    Desired = 1,
    /// What its actuator gets, N.
    Command = 2,
}

const JOINT: [(JointVariable, &str, &str); 5] = [
    (JointVariable::Position, "position", "rad"),
    (JointVariable::Velocity, "velocity", "rad/s"),
    (JointVariable::Target, "target", "rad"),
    (JointVariable::Torque, "torque", "N m"),
    (JointVariable::Error, "error", "rad"),
];
const TENDON: [(TendonVariable, &str); 3] = [
    (TendonVariable::Tension, "tension"),
    (TendonVariable::Desired, "desired"),
    (TendonVariable::Command, "command"),
];
const OF_JOINT: usize = JOINT.len() + 2 * TENDON.len();

impl<const F: usize, const N: usize> FingerVariables<F, N> {
    const OF_FINGER: usize = N * OF_JOINT + 2;

    /// How many variables there are.
    pub const COUNT: usize = F * Self::OF_FINGER;

    /// The variables of these fingers, with names such as `index.proximal.flexor.tension`.
    #[must_use]
    pub fn new(fingers: [&Finger<N>; F]) -> Self {
        Self {
            fingers: fingers.map(|finger| {
                let mut joints = finger.joints.iter();
                let joints = core::array::from_fn(|_| {
                    joints.next().map_or(Name::new(), |it| it.name.clone())
                });
                (finger.name.clone(), joints)
            }),
        }
    }

    /// The number of a variable; `None` for a finger or a joint that there is not.
    #[must_use]
    pub const fn number(finger: usize, quantity: Quantity) -> Option<usize> {
        let (joint, within) = match quantity {
            Quantity::Joint(joint, of_joint) => (joint, joint * OF_JOINT + of_joint as usize),
            Quantity::Flexor(joint, of_tendon) => {
                (joint, joint * OF_JOINT + JOINT.len() + of_tendon as usize)
            }
            Quantity::Extensor(joint, of_tendon) => {
                let tendons = JOINT.len() + TENDON.len();
                (joint, joint * OF_JOINT + tendons + of_tendon as usize)
            }
            Quantity::Saturated => (0, N * OF_JOINT),
            Quantity::Fault => (0, N * OF_JOINT + 1),
        };
        if finger < F && joint < N {
            Some(finger * Self::OF_FINGER + within)
        } else {
            None
        }
    }

    /// The finger and quantity of a number.
    #[must_use]
    pub fn quantity(number: usize) -> Option<(usize, Quantity)> {
        let (finger, within) = (number / Self::OF_FINGER, number % Self::OF_FINGER);
        let (joint, of_joint) = (within / OF_JOINT, within % OF_JOINT);
        let quantity = match (joint, of_joint) {
            (joint, 0) if joint == N => Quantity::Saturated,
            (joint, _) if joint == N => Quantity::Fault,
            (joint, 0..5) => Quantity::Joint(joint, JOINT.get(of_joint)?.0),
            (joint, 5..8) => Quantity::Flexor(joint, TENDON.get(of_joint - 5)?.0),
            (joint, _) => Quantity::Extensor(joint, TENDON.get(of_joint - 8)?.0),
        };
        (finger < F).then_some((finger, quantity))
    }

    /// All variables, by number.
    pub fn variables(&self) -> impl Iterator<Item = Variable> + Clone + '_ {
        (0..Self::COUNT).filter_map(|number| self.variable(number))
    }

    fn variable(&self, number: usize) -> Option<Variable> {
        let (finger, quantity) = Self::quantity(number)?;
        let (finger, joints) = self.fingers.get(finger)?;
        let of_tendon = |joint: usize, side, variable| {
            let what = TENDON.get(variable as usize)?.1;
            let joint = joints.get(joint)?;
            Some(Variable::new(
                format_args!("{finger}.{joint}.{side}.{what}"),
                "N",
                Kind::Real,
            ))
        };
        match quantity {
            Quantity::Joint(joint, variable) => {
                let (_, what, unit) = JOINT.get(variable as usize)?;
                let joint = joints.get(joint)?;
                Some(Variable::new(
                    format_args!("{finger}.{joint}.{what}"),
                    unit,
                    Kind::Real,
                ))
            }
            Quantity::Flexor(joint, variable) => of_tendon(joint, "flexor", variable),
            Quantity::Extensor(joint, variable) => of_tendon(joint, "extensor", variable),
            Quantity::Saturated => Some(Variable::new(
                format_args!("{finger}.saturated"),
                "",
                Kind::Bits,
            )),
            Quantity::Fault => Some(Variable::new(
                format_args!("{finger}.fault"),
                "",
                Kind::Bits,
            )),
        }
    }

    /// The word of a variable, from what the fingers felt and did in a tick; 0 for a variable that
    /// there is not.
    #[must_use]
    pub fn word(number: usize, sensed: &[Sensed<f64, N>; F], ticks: &[Tick<N>; F]) -> u32 {
        let Some((finger, quantity)) = Self::quantity(number) else {
            return 0;
        };
        match (sensed.get(finger), ticks.get(finger)) {
            (Some(sensed), Some(tick)) => word(quantity, sensed, tick).unwrap_or(0),
            _ => 0,
        }
    }
}

fn word<const N: usize>(
    quantity: Quantity,
    sensed: &Sensed<f64, N>,
    tick: &Tick<N>,
) -> Option<u32> {
    let output = &tick.output;
    let of_tendon = |joint: usize, variable| {
        Some(match variable {
            TendonVariable::Tension => *sensed.tension.get(joint)?,
            TendonVariable::Desired => *output.tension.get(joint)?,
            TendonVariable::Command => *output.command.get(joint)?,
        })
    };
    let value = match quantity {
        Quantity::Joint(joint, variable) => {
            let position = *output.position.get(joint)?;
            let target = tick.target.get(joint)?.unwrap_or(f64::NAN);
            match variable {
                JointVariable::Position => position,
                JointVariable::Velocity => *output.velocity.get(joint)?,
                JointVariable::Target => target,
                JointVariable::Torque => *output.torque.get(joint)?,
                JointVariable::Error => target - position,
            }
        }
        Quantity::Flexor(joint, variable) => {
            of_tendon(joint, variable).map(|Pair { flexor, .. }| flexor)?
        }
        Quantity::Extensor(joint, variable) => {
            of_tendon(joint, variable).map(|Pair { extensor, .. }| extensor)?
        }
        Quantity::Saturated => return Some(output.saturated),
        Quantity::Fault => return Some(tick.fault.map_or(0, |fault| fault.code as u32 + 1)),
    };
    Some((value as f32).to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_quantities_agree() {
        type Two = FingerVariables<2, 3>;
        for number in 0..Two::COUNT {
            let (finger, quantity) = Two::quantity(number).unwrap();
            assert_eq!(Two::number(finger, quantity), Some(number));
        }
        assert_eq!(Two::quantity(Two::COUNT), None);
        assert_eq!(Two::number(2, Quantity::Fault), None);
        assert_eq!(
            Two::number(0, Quantity::Joint(3, JointVariable::Error)),
            None
        );
    }
}
