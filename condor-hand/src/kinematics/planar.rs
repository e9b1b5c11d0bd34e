//! Which chains are fingers in closed form.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use super::{Body, Chain, ChainError, Joint, Motion, PlanarFinger, Rod};
use crate::math::{Real, abs, max, real};

/// The reason for which a chain is not a [`PlanarFinger`].
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum NotPlanar {
    /// No mechanism can have a number of the chain.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// A joint that slides, or has no axis at all.
    #[error("joint {joint} does not rotate")]
    NotRevolute {
        /// The joint, from 0.
        joint: usize,
    },
    /// An axis has the wrong direction.
    #[error("joint {joint} turns about {axis:?}; a planar finger's turns about {expected:?}")]
    Axis {
        /// The joint, from 0.
        joint: usize,
        /// Its axis.
        axis: [f64; 3],
        /// The required axis.
        expected: [f64; 3],
    },
    /// A link that is rotated against the one before it while its joint is at zero.
    #[error(
        "the zero of joint {joint} is rotated against the link before it, by {deviation} in an \
         entry of its rotation"
    )]
    Rotated {
        /// The joint, from 0.
        joint: usize,
        /// The largest entry of `R - 1`.
        deviation: f64,
    },
    /// A joint, or the tip as joint 4, that is beside the line of the link before it.
    #[error("joint {joint} sits at {offset:?} m on the link before it, not on its x axis")]
    Beside {
        /// The joint, from 0; 4 is the tip.
        joint: usize,
        /// Its place on that link, m.
        offset: [f64; 3],
    },
    /// A body whose centre of mass is beside the line of its link.
    #[error("the body of joint {joint} has its centre of mass at {center:?} m, not on the x axis")]
    Center {
        /// The joint, from 0.
        joint: usize,
        /// The centre of mass, m.
        center: [f64; 3],
    },
    /// A body whose principal axes are not those of its link.
    #[error("the body of joint {joint} has a product of inertia of {product} kg m²")]
    Inertia {
        /// The joint, from 0.
        joint: usize,
        /// The largest product of inertia, kg m².
        product: f64,
    },
}

/// Converts a chain that is such a finger, up to rounding; the mount of joint 0 becomes part of the
/// base.
impl<T: Real> TryFrom<&Chain<T, 4>> for PlanarFinger<T> {
    type Error = NotPlanar;

    fn try_from(chain: &Chain<T, 4>) -> Result<Self, NotPlanar> {
        chain.check()?;
        let [first, second, third, fourth] = &chain.joints;
        check_axis(0, first, &Vector3::z())?;
        for (joint, flexion) in [(1, second), (2, third), (3, fourth)] {
            check_axis(joint, flexion, &Vector3::y())?;
            let deviation = largest(&(flexion.placement.rotation - Matrix3::identity()));
            if deviation > rounding() {
                let deviation = deviation.to_f64();
                return Err(NotPlanar::Rotated { joint, deviation });
            }
        }
        let [l0, l1, l2] = [second, third, fourth].map(|joint| joint.placement.position);
        let lengths = [(1, l0), (2, l1), (3, l2), (4, chain.tip)];
        let size = lengths
            .iter()
            .fold(T::zero(), |sum, (_, offset)| sum + abs(offset.x));
        for (joint, offset) in lengths {
            if is_beside(&offset, size) {
                let offset = values(&offset);
                return Err(NotPlanar::Beside { joint, offset });
            }
        }
        let [body0, body1, body2, body3] = &chain.bodies;
        Ok(Self {
            base: chain.base.then(&first.placement),
            lengths: lengths.map(|(_, offset)| offset.x),
            bodies: [
                rod(0, body0, size)?,
                rod(1, body1, size)?,
                rod(2, body2, size)?,
                rod(3, body3, size)?,
            ],
        })
    }
}

fn check_axis<T: Real>(
    joint: usize,
    Joint { motion, .. }: &Joint<T>,
    expected: &Vector3<T>,
) -> Result<(), NotPlanar> {
    let Motion::Revolute(axis) = motion else {
        return Err(NotPlanar::NotRevolute { joint });
    };
    if (axis - expected)
        .iter()
        .any(|&entry| abs(entry) > rounding())
    {
        return Err(NotPlanar::Axis {
            joint,
            axis: values(axis),
            expected: values(expected),
        });
    }
    Ok(())
}

fn rod<T: Real>(joint: usize, body: &Body<T>, size: T) -> Result<Rod<T>, NotPlanar> {
    if is_beside(&body.center, size) {
        let center = values(&body.center);
        return Err(NotPlanar::Center { joint, center });
    }
    let inertia = body.inertia.diagonal();
    let products = largest(&(body.inertia - Matrix3::from_diagonal(&inertia)));
    if products > rounding::<T>() * largest(&body.inertia) {
        let product = products.to_f64();
        return Err(NotPlanar::Inertia { joint, product });
    }
    Ok(Rod {
        mass: body.mass,
        center: body.center.x,
        inertia,
    })
}

fn is_beside<T: Real>(point: &Vector3<T>, size: T) -> bool {
    max(abs(point.y), abs(point.z)) > rounding::<T>() * size
}

fn largest<T: Real>(matrix: &Matrix3<T>) -> T {
    matrix
        .iter()
        .fold(T::zero(), |most, &entry| max(abs(entry), most))
}

fn values<T: Real>(vector: &Vector3<T>) -> [f64; 3] {
    [vector.x.to_f64(), vector.y.to_f64(), vector.z.to_f64()]
}

/// What another program's arithmetic leaves of a zero, in proportion.
fn rounding<T: Real>() -> T {
    real::<T>(64.0) * T::default_epsilon()
}
