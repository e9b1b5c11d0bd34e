//! Forces of fingers that make a wrench: the least ones, from places of tips that are new each time.

use std::hint::black_box;

use condor_hand::grasp::{Contacts, GraspError, Wrench};
use condor_hand::kinematics::Kinematics as _;
use fastrand::Rng;
use nalgebra::{SMatrix, SVector, Vector3, Vector6};

use super::subject::{FINGERS, Subject, agree};
use crate::Result;
use crate::race::Race;

/// Grasps that calls go through in turn.
const GRASPS: usize = 64;

/// Grasps at which the residual is looked for.
const TRIALS: usize = 10_000;

/// Below this, relative to the largest, a singular value counts as none.
const SINGULAR: f64 = 1e-12;

/// The contacts of a grasp, and the wrench that the fingers must exert.
#[derive(Clone, Copy, Debug)]
struct Grasp<const M: usize> {
    tips: [Vector3<f64>; M],
    about: Vector3<f64>,
    wrench: Vector6<f64>,
}

/// The tasks: three fingers and four.
pub(super) const TASKS: [&str; 2] = ["forces of 3 fingers", "forces of 4 fingers"];
/// The contestants of both tasks.
pub(super) const OURS: &str = "Contacts";
pub(super) const CHOLESKY: &str = "nalgebra, Cholesky of G Gᵀ";
pub(super) const SVD: &str = "nalgebra, SVD of G";

/// Checks that all find the same forces, and lets them take part; returns the largest residuals, ours and
/// Cholesky's.
///
/// # Errors
/// Returns an error if one of them finds other forces, or none.
pub(super) fn enter(race: &mut Race<'_>, subject: &'static Subject) -> Result<[f64; 2]> {
    let mut residuals = [0.0; 2];
    enter_three(race, subject, [0, 1, 3], &mut residuals)?;
    enter_four(race, subject, [0, 1, 2, 3], &mut residuals)?;
    Ok(residuals)
}

fn grasps<const M: usize>(
    subject: &Subject,
    fingers: [usize; M],
    chance: &mut Rng,
) -> [Grasp<M>; GRASPS] {
    std::array::from_fn(|grasp| {
        let state = subject.state(grasp);
        let tips: [_; FINGERS] =
            std::array::from_fn(|finger| subject.planar[finger].tip(&state.q[finger]).position);
        let tips = fingers.map(|finger| tips[finger]);
        let mut vector = |size: f64| Vector3::from_fn(|_, _| size * (2.0 * chance.f64() - 1.0));
        let (force, moment, beside) = (vector(5.0), vector(0.1), vector(0.01));
        Grasp {
            tips,
            about: tips.iter().sum::<Vector3<f64>>() / M as f64 + beside,
            wrench: Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z),
        }
    })
}

#[inline]
fn ours<const M: usize>(grasp: &Grasp<M>) -> std::result::Result<[Vector3<f64>; M], GraspError> {
    let [fx, fy, fz, mx, my, mz] = grasp.wrench.data.0[0];
    let wrench = Wrench {
        force: Vector3::new(fx, fy, fz),
        moment: Vector3::new(mx, my, mz),
    };
    let contacts = Contacts::new(grasp.tips)?;
    Ok(contacts.forces(&wrench, &grasp.about)?.forces)
}

/// Defines the entry of the peers for a number of fingers, since matrices of 3 M columns cannot be named.
macro_rules! with_peers {
    ($enter:ident, $fingers:literal, $columns:literal) => {
        fn $enter(
            race: &mut Race<'_>,
            subject: &'static Subject,
            fingers: [usize; $fingers],
            residuals: &mut [f64; 2],
        ) -> Result<()> {
            type Forces = SVector<f64, $columns>;

            /// Returns the grasp matrix: forces and moments of the fingers' forces.
            #[inline]
            fn matrix(grasp: &Grasp<$fingers>) -> SMatrix<f64, 6, $columns> {
                let mut matrix = SMatrix::<f64, 6, $columns>::zeros();
                for (finger, tip) in grasp.tips.iter().enumerate() {
                    let arm = tip - grasp.about;
                    matrix
                        .fixed_view_mut::<3, 3>(0, 3 * finger)
                        .fill_with_identity();
                    matrix
                        .fixed_view_mut::<3, 3>(3, 3 * finger)
                        .copy_from(&arm.cross_matrix());
                }
                matrix
            }

            fn cholesky(grasp: &Grasp<$fingers>) -> Option<Forces> {
                let matrix = matrix(grasp);
                let factor = (matrix * matrix.transpose()).cholesky()?;
                Some(matrix.tr_mul(&factor.solve(&grasp.wrench)))
            }

            fn svd(grasp: &Grasp<$fingers>) -> Option<Forces> {
                let svd = matrix(grasp).svd(true, true);
                let least = svd.singular_values.max() * SINGULAR;
                svd.solve(&grasp.wrench, least).ok()
            }

            let mut chance = Rng::with_seed($fingers);
            let pool: &'static [_; GRASPS] =
                Box::leak(Box::new(grasps(subject, fingers, &mut chance)));
            let none = "no forces by the peer";
            for grasp in pool {
                let ours = ours(grasp)?;
                let ours: Vec<f64> = ours.iter().flatten().copied().collect();
                let theirs = cholesky(grasp).ok_or(none)?;
                agree("the forces by Cholesky", &ours, theirs.as_slice(), 1e-9)?;
                let theirs = svd(grasp).ok_or(none)?;
                agree("the forces by SVD", &ours, theirs.as_slice(), 1e-9)?;
            }
            for _ in 0..TRIALS / GRASPS {
                for grasp in &grasps(subject, fingers, &mut chance) {
                    let forces = ours(grasp)?;
                    let forces = Forces::from_iterator(forces.iter().flatten().copied());
                    let theirs = cholesky(grasp).ok_or(none)?;
                    for (residual, forces) in residuals.iter_mut().zip([forces, theirs]) {
                        let error = matrix(grasp) * forces - grasp.wrench;
                        *residual = residual.max(error.norm() / grasp.wrench.norm());
                    }
                }
            }
            let all = move |call: usize| &black_box(pool)[call % GRASPS];
            let task = TASKS[$fingers - 3];
            race.enter(task, OURS, move |call| {
                let _ = black_box(&ours(all(call)));
            });
            race.enter(task, CHOLESKY, move |call| {
                black_box(&cholesky(all(call)));
            });
            race.enter(task, SVD, move |call| {
                black_box(&svd(all(call)));
            });
            Ok(())
        }
    };
}

with_peers!(enter_three, 3, 9);
with_peers!(enter_four, 4, 12);
