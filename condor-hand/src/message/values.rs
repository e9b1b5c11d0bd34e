//! Targets, gains and set-points as words.

use super::words::{WordReader, WordWriter};
use crate::math::is_finite;
use crate::servo::{JointGains, JointTarget, PositionLaw, ServoMode, ServoRefusal};
use crate::tendon::{Pair, TensionGains};
use crate::trajectory::{SetPoint, StopGuard};

const PD: u32 = 0;
const COMPUTED_TORQUE: u32 = 1;
/// Numbers of a set of gains.
const GAINS: usize = 13;

/// The gains of a joint: a law and numbers.
pub(super) fn put_gains(gains: &JointGains<f64>, put: &mut WordWriter<'_>) {
    let (law, numbers) = match gains.law {
        PositionLaw::Pd {
            kp,
            kv,
            ki,
            integral_nm,
        } => (PD, [kp, kv, ki, integral_nm]),
        PositionLaw::ComputedTorque {
            bandwidth_hz,
            damping_ratio,
        } => (COMPUTED_TORQUE, [bandwidth_hz, damping_ratio, 0.0, 0.0]),
    };
    put.word(law).numbers(&numbers).number(gains.k_torque);
    for TensionGains { kt, ki, kd, kv } in [gains.tension.flexor, gains.tension.extensor] {
        put.numbers(&[kt, ki, kd, kv]);
    }
}

/// Gains that are finite and not negative; `None` if there is no such law, or a number is not possible.
pub(super) fn take_gains(law: u32, taken: &mut WordReader<'_>) -> Option<JointGains<f64>> {
    let numbers: [f64; GAINS] = taken.numbers();
    let [a, b, c, d, k_torque, numbers_of_tendons @ ..] = numbers;
    let law = match law {
        PD => PositionLaw::Pd {
            kp: a,
            kv: b,
            ki: c,
            integral_nm: d,
        },
        COMPUTED_TORQUE => PositionLaw::ComputedTorque {
            bandwidth_hz: a,
            damping_ratio: b,
        },
        _ => return None,
    };
    for (number, value) in (0..).zip(numbers) {
        let counts =
            !(matches!(law, PositionLaw::ComputedTorque { .. }) && matches!(number, 2 | 3));
        if counts && (!is_finite(value) || value < 0.0) {
            return None;
        }
    }
    let [kt, ki, kd, kv, kt_e, ki_e, kd_e, kv_e] = numbers_of_tendons;
    Some(JointGains {
        law,
        k_torque,
        tension: Pair {
            flexor: TensionGains { kt, ki, kd, kv },
            extensor: TensionGains {
                kt: kt_e,
                ki: ki_e,
                kd: kd_e,
                kv: kv_e,
            },
        },
    })
}

/// A target: its mode and three numbers.
pub(super) fn put_target(target: &JointTarget<f64>, put: &mut WordWriter<'_>) {
    let numbers = match *target {
        JointTarget::Off => [0.0; 3],
        JointTarget::Tension(Pair { flexor, extensor }) => [flexor, extensor, 0.0],
        JointTarget::Torque(torque) | JointTarget::Grasp(torque) => [torque, 0.0, 0.0],
        JointTarget::Position(point) => [point.position, point.velocity, point.acceleration],
        JointTarget::Impedance {
            position,
            stiffness,
            damping,
        } => [position, stiffness, damping],
    };
    put.word(target.mode() as u32).numbers(&numbers);
}

/// A target; the servo checks its numbers.
pub(super) fn take_target(
    mode: u32,
    taken: &mut WordReader<'_>,
) -> Result<JointTarget<f64>, ServoRefusal> {
    let mode = ServoMode::from_number(mode).ok_or(ServoRefusal::Mode { mode })?;
    let [a, b, c] = taken.numbers();
    Ok(match mode {
        ServoMode::Off => JointTarget::Off,
        ServoMode::Tension => JointTarget::Tension(Pair {
            flexor: a,
            extensor: b,
        }),
        ServoMode::Torque => JointTarget::Torque(a),
        ServoMode::Grasp => JointTarget::Grasp(a),
        ServoMode::Position => JointTarget::Position(SetPoint {
            position: a,
            velocity: b,
            acceleration: c,
        }),
        ServoMode::Impedance => JointTarget::Impedance {
            position: a,
            stiffness: b,
            damping: c,
        },
    })
}

/// Words of what the master wants of a joint.
pub(super) const WANTED: usize = 12;

/// Writes the wish of the master for a joint: a set-point, the number of a motion, and the conditions that stop
/// it.
pub(super) fn put_wanted(point: &SetPoint<f64>, guard: &StopGuard, put: &mut WordWriter<'_>) {
    put.numbers(&[point.position, point.velocity, point.acceleration]);
    put.words(&[guard.motion, u32::from(guard.contact)]);
    put.numbers(&[guard.torque, guard.tension]);
}

pub(super) fn take_wanted(taken: &mut WordReader<'_>) -> (SetPoint<f64>, StopGuard) {
    let [position, velocity, acceleration] = taken.numbers();
    let (motion, contact) = (taken.word(), taken.word() != 0);
    let [torque, tension] = taken.numbers();
    let point = SetPoint {
        position,
        velocity,
        acceleration,
    };
    let guard = StopGuard {
        motion,
        torque,
        tension,
        contact,
    };
    (point, guard)
}
