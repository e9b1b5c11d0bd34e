//! Sixteen torques as thirty-two tensions.

use std::hint::black_box;

use condor_hand::tendon::{Allocation, MomentArms, Pair, Pairs, Rectification};
use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::race::{Lane, Race};
use super::subject::{FINGERS, JOINTS, Subject, agree};
use crate::Result;

/// Tendons of a finger.
const TENDONS: usize = 2 * JOINTS;

/// The torques of the tensions, relative to the largest.
const ROUNDING: f64 = 1e-12;

type Arms = SMatrix<f64, JOINTS, TENDONS>;
type Tensions = SVector<f64, TENDONS>;

/// The lanes of this task.
pub(super) struct Lanes {
    /// With the change-over that the shipped hand has.
    pub(super) smooth: Lane,
    /// With the least tensions.
    pub(super) hard: Lane,
    pub(super) cholesky: Lane,
    /// The same, factored once and for all.
    pub(super) factored: Lane,
}

/// One finger as ours and as a matrix.
struct Finger {
    arms: MomentArms<f64, JOINTS>,
    smooth: [Allocation<f64>; JOINTS],
    hard: [Allocation<f64>; JOINTS],
    matrix: Arms,
    factor: Cholesky<f64, Const<JOINTS>>,
}

fn factor(matrix: &Arms) -> Option<Cholesky<f64, Const<JOINTS>>> {
    (matrix * matrix.transpose()).cholesky()
}

impl Finger {
    fn new(subject: &Subject, number: usize) -> Result<Self> {
        let config = &subject.config;
        let finger = &config.fingers[number];
        let settings = finger.settings(f64::from(config.servo_hz), config.transition_s);
        let arms = finger.moment_arms()?;
        let smooth = settings.joints.map(|joint| joint.allocation);
        let matrix = Arms::from_fn(|joint, tendon| {
            let pair = arms.rows()[joint][tendon / 2];
            if tendon.is_multiple_of(2) {
                pair.flexor
            } else {
                pair.extensor
            }
        });
        Ok(Self {
            arms,
            smooth,
            hard: smooth.map(|allocation| Allocation {
                rectification: Rectification::Hard,
                ..allocation
            }),
            matrix,
            factor: factor(&matrix).ok_or("the arms have no pseudo-inverse")?,
        })
    }
}

/// Checks that the tensions of all make the torques, and lets them take part.
///
/// # Errors
/// Those of one of them do not.
pub(super) fn enter(race: &mut Race, subject: &'static Subject) -> Result<Lanes> {
    let fingers = (0..FINGERS)
        .map(|number| Finger::new(subject, number))
        .collect::<Result<Vec<_>>>()?;
    let fingers: &'static [Finger; FINGERS] = fingers
        .try_into()
        .map(|fingers| &*Box::leak(Box::new(fingers)))
        .map_err(|_| "the hand has another number of fingers")?;
    for state in &subject.states {
        for (finger, torque) in fingers.iter().zip(&state.torque) {
            for allocation in [&finger.smooth, &finger.hard] {
                let allocated = finger.arms.allocate(torque, allocation);
                let made = finger.matrix * vector(&allocated.tensions);
                let what = "the torque of our tensions";
                agree(what, torque.as_slice(), made.as_slice(), ROUNDING)?;
            }
            let made = finger.matrix * least(&finger.matrix, &finger.factor, torque);
            let what = "the torque of the pseudo-inverse";
            agree(what, torque.as_slice(), made.as_slice(), ROUNDING)?;
        }
    }
    let mut all = [Tensions::zeros(); FINGERS];
    Ok(Lanes {
        smooth: enter_ours(race, subject, fingers, |finger| &finger.smooth),
        hard: enter_ours(race, subject, fingers, |finger| &finger.hard),
        cholesky: race.enter(move |call| {
            let torques = &black_box(subject).state(call).torque;
            for ((tensions, finger), torque) in all.iter_mut().zip(black_box(fingers)).zip(torques)
            {
                if let Some(factor) = factor(&finger.matrix) {
                    *tensions = least(&finger.matrix, &factor, torque);
                }
            }
            black_box(&mut all);
        }),
        factored: race.enter(move |call| {
            let torques = &black_box(subject).state(call).torque;
            for ((tensions, finger), torque) in all.iter_mut().zip(black_box(fingers)).zip(torques)
            {
                *tensions = least(&finger.matrix, &finger.factor, torque);
            }
            black_box(&mut all);
        }),
    })
}

fn enter_ours(
    race: &mut Race,
    subject: &'static Subject,
    fingers: &'static [Finger; FINGERS],
    allocation: impl Fn(&Finger) -> &[Allocation<f64>; JOINTS] + 'static,
) -> Lane {
    let mut all = [[Pair::both(0.0); JOINTS]; FINGERS];
    race.enter(move |call| {
        let torques = &black_box(subject).state(call).torque;
        for ((tensions, finger), torque) in all.iter_mut().zip(black_box(fingers)).zip(torques) {
            *tensions = finger.arms.allocate(torque, allocation(finger)).tensions;
        }
        black_box(&mut all);
    })
}

fn vector(tensions: &Pairs<f64, JOINTS>) -> Tensions {
    Tensions::from_iterator(
        tensions
            .iter()
            .flat_map(|pair| [pair.flexor, pair.extensor]),
    )
}

/// The tensions with the least sum of squares, which pull and push.
fn least(
    matrix: &Arms,
    factor: &Cholesky<f64, Const<JOINTS>>,
    torque: &SVector<f64, JOINTS>,
) -> Tensions {
    matrix.tr_mul(&factor.solve(torque))
}
