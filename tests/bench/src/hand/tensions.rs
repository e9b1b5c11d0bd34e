//! Sixteen torques as thirty-two tensions.

use std::hint::black_box;

use condor_hand::tendon::{MomentArms, Pair, Rectification, TendonPairs, TensionAllocation};
use nalgebra::{SMatrix, SVector};

use super::subject::{FINGERS, JOINTS, Subject, agree};
use crate::Result;
use crate::race::Race;

/// Tendons of a finger.
const TENDONS: usize = 2 * JOINTS;

/// The torques of the tensions, relative to the largest.
const ROUNDING: f64 = 1e-12;

type Arms = SMatrix<f64, JOINTS, TENDONS>;
type Tensions = SVector<f64, TENDONS>;

/// This task, with the change-over that the shipped hand has, and a peer.
pub(super) const TENSIONS: &str = "32 tensions of 16 torques";
pub(super) const SMOOTH: &str = "MomentArms, without a corner";
pub(super) const CHOLESKY: &str = "nalgebra, Cholesky of P Pᵀ";

/// One finger as ours and as a matrix.
struct Finger {
    arms: MomentArms<f64, JOINTS>,
    smooth: [TensionAllocation<f64>; JOINTS],
    hard: [TensionAllocation<f64>; JOINTS],
    matrix: Arms,
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
            hard: smooth.map(|allocation| TensionAllocation {
                rectification: Rectification::Hard,
                ..allocation
            }),
            matrix,
        })
    }
}

/// Checks that the tensions of all make the torques, and lets them take part.
///
/// # Errors
/// Returns an error if the tensions of one of them do not.
pub(super) fn enter(race: &mut Race<'_>, subject: &'static Subject) -> Result<()> {
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
            let least = least(&finger.matrix, torque).ok_or("the arms have no pseudo-inverse")?;
            let made = finger.matrix * least;
            let what = "the torque of the pseudo-inverse";
            agree(what, torque.as_slice(), made.as_slice(), ROUNDING)?;
        }
    }
    let mut ours = |name, allocation: fn(&Finger) -> &[TensionAllocation<f64>; JOINTS]| {
        enter_as(
            race,
            subject,
            fingers,
            name,
            [Pair::both(0.0); JOINTS],
            move |finger, torque| finger.arms.allocate(torque, allocation(finger)).tensions,
        );
    };
    ours(SMOOTH, |finger| &finger.smooth);
    ours("MomentArms, least", |finger| &finger.hard);
    let none = Tensions::zeros();
    enter_as(
        race,
        subject,
        fingers,
        CHOLESKY,
        none,
        move |finger, torque| least(&finger.matrix, torque).unwrap_or(none),
    );
    Ok(())
}

/// Takes part with what a finger's tensions are found by.
fn enter_as<T: Copy + 'static>(
    race: &mut Race<'_>,
    subject: &'static Subject,
    fingers: &'static [Finger; FINGERS],
    name: &'static str,
    none: T,
    find: impl Fn(&Finger, &SVector<f64, JOINTS>) -> T + 'static,
) {
    let mut all = [none; FINGERS];
    race.enter(TENSIONS, name, move |call| {
        let torques = &black_box(subject).state(call).torque;
        for ((tensions, finger), torque) in all.iter_mut().zip(black_box(fingers)).zip(torques) {
            *tensions = find(finger, torque);
        }
        black_box(&mut all);
    });
}

fn vector(tensions: &TendonPairs<f64, JOINTS>) -> Tensions {
    Tensions::from_iterator(
        tensions
            .iter()
            .flat_map(|pair| [pair.flexor, pair.extensor]),
    )
}

/// Returns the tensions with the least sum of squares, which pull and push.
fn least(matrix: &Arms, torque: &SVector<f64, JOINTS>) -> Option<Tensions> {
    let factor = (matrix * matrix.transpose()).cholesky()?;
    Some(matrix.tr_mul(&factor.solve(torque)))
}
