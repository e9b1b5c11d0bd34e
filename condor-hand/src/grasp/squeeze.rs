use nalgebra::Vector3;

use super::{Contacts, GraspError, coincident, off, quantity, too_large};
use crate::Requirement;
use crate::math::{max, sqrt};
use crate::number::{count, not_negative};

/// Internal forces of a grasp: each pair of fingers presses on the object from both ends of the line between the two
/// tips, which is called an edge.
///
/// The forces cancel: the object feels no wrench, only pressure. The edges of three contacts span all internal forces.
/// The six edges of four contacts span all six internal forces if the contacts are not in one plane. In a plane they
/// span five of six: some combination of tensions and pressures of the six edges leaves every contact without force
/// (the self-stress of the complete graph), and the internal forces normal to the plane, of alternating sign, cannot be
/// expressed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Squeeze<const M: usize> {
    /// In row i, column j > i the force on the edge between i and j, N.
    edges: [[f64; M]; M],
}

impl<const M: usize> Squeeze<M> {
    /// Returns a squeeze without force on any edge.
    #[must_use]
    pub fn none() -> Self {
        Self {
            edges: [[0.0; M]; M],
        }
    }

    /// Makes a squeeze in which every pair of fingers presses with the same `force`, N.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) for a force below zero or not finite.
    pub fn equal(force: f64) -> Result<Self, GraspError> {
        let mut squeeze = Self::none();
        for first in 0..M {
            for second in first + 1..M {
                squeeze.set(first, second, force)?;
            }
        }
        Ok(squeeze)
    }

    /// Returns this squeeze with another `force` (N) on the edge between the contacts `first` and `second`, which are
    /// counted from 0.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) for a force below zero or not finite, and for an edge that does not exist.
    pub fn with_edge(
        mut self,
        first: usize,
        second: usize,
        force: f64,
    ) -> Result<Self, GraspError> {
        self.set(first, second, force)?;
        Ok(self)
    }

    fn set(&mut self, first: usize, second: usize, force: f64) -> Result<(), GraspError> {
        let (low, high) = (first.min(second), first.max(second));
        let row = self.edges.get_mut(low);
        match row.and_then(|row| row.get_mut(high)) {
            Some(edge) if low != high => {
                not_negative("the force of a squeeze, N,", force)?;
                *edge = force;
                Ok(())
            }
            Some(_) => {
                let contacts = "the number of contacts of an edge";
                Err(off(contacts, 1.0, Requirement::Equal(2.0)))
            }
            None => {
                let must = Requirement::Below(count(M));
                Err(off("the number of a contact of an edge", count(high), must))
            }
        }
    }
}

impl<const M: usize> Contacts<M> {
    /// Returns the force that each finger exerts on the object because of `squeeze`, N. The forces produce no wrench.
    ///
    /// An edge (i, j) with the force s adds `+s e` at contact i and `-s e` at contact j, where e is the unit vector
    /// from i to j.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) for contacts at one point with a squeeze between them, or if a result exceeds the
    /// range of the type.
    pub fn internal_forces(&self, squeeze: &Squeeze<M>) -> Result<[Vector3<f64>; M], GraspError> {
        let mut forces = [Vector3::zeros(); M];
        for (first, row) in squeeze.edges.iter().enumerate() {
            // From the end of the arrays that starts at this contact: its own force, and those after.
            let (Some(points), Some([force, others @ ..])) =
                (self.points().get(first..), forces.get_mut(first..))
            else {
                continue;
            };
            let [start, ends @ ..] = points else { continue };
            let edges = row.iter().skip(first + 1);
            for (step, ((end, other), &edge)) in ends.iter().zip(others).zip(edges).enumerate() {
                if edge == 0.0 {
                    continue;
                }
                let span = end - start;
                let length = sqrt(span.norm_squared());
                let shortest = max(start.amax(), end.amax()) * f64::EPSILON * 16.0;
                if length <= shortest {
                    return Err(coincident(first + 1 + step, length, shortest));
                }
                let push = span * (edge / length);
                *force += push;
                *other -= push;
            }
        }
        if super::contacts::check(&forces, quantity::FORCE).is_err() {
            return Err(too_large(quantity::FORCE));
        }
        Ok(forces)
    }
}
