use nalgebra::Vector3;

use super::contacts::check;
use super::{GraspError, Normals, quantity, too_large};
use crate::math::{Real, abs, is_finite, max, min, real, sqrt};
use crate::number::{finite, positive};

/// The Coulomb friction of a fingertip that touches the object in a point.
///
/// With the coefficient of friction mu, the normal part `f_n` and the tangential part `f_t` of the
/// force, the contact sticks while `|f_t| <= mu f_n`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactFriction<T: Real = f64> {
    sliding: T,
}

/// The range of factors by which an internal force can be multiplied so that no contact slips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SqueezeRange<T: Real = f64> {
    /// The least factor with which no contact slips.
    pub least: T,
    /// The greatest factor with which no contact slips; `None` if there is none.
    pub greatest: Option<T>,
}

impl<T: Real> ContactFriction<T> {
    /// Makes the friction of a point contact with this coefficient of friction: the contact slips
    /// when the tangential force exceeds `coefficient` times the normal force.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) unless the coefficient is positive.
    pub fn point(coefficient: T) -> Result<Self, GraspError> {
        let what = "a coefficient of friction";
        positive(what, coefficient)?;
        // The discriminant of a squeeze has its fourth power.
        let square = coefficient * coefficient;
        let fourth = square * square;
        positive("the fourth power of a coefficient of friction", fourth)?;
        finite(what, fourth * real(1e6))?;
        Ok(Self {
            sliding: coefficient,
        })
    }

    /// Returns for each contact how far it is from slipping, N: `mu f_n - |f_t|`. The margin is negative if the contact
    /// slips, or if the finger pulls on the surface. `forces` are those of the fingers on the object, N.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) if an input is not finite, or if a result exceeds the range of
    /// the type.
    pub fn margins<const M: usize>(
        &self,
        normals: &Normals<T, M>,
        forces: &[Vector3<T>; M],
    ) -> Result<[T; M], GraspError> {
        check(forces, quantity::FORCE)?;
        let mut margins = [T::zero(); M];
        for (margin, (force, normal)) in margins.iter_mut().zip(forces.iter().zip(normals.inward()))
        {
            let along = force.dot(normal);
            let across = force - normal * along;
            *margin = self.sliding * along - sqrt(across.norm_squared());
            if !is_finite(*margin) {
                return Err(too_large(quantity::FORCE));
            }
        }
        Ok(margins)
    }

    /// Returns the range of factors `s >= 0` with which no contact slips under the forces
    /// `forces + s directions`, where `directions` are internal forces of the grasp.
    ///
    /// For an equal squeeze on all edges, pass the
    /// [internal forces](super::Contacts::internal_forces) of a squeeze of 1 N as `directions`; the
    /// factors are then newtons.
    ///
    /// Cones are convex, so each contact allows one interval. Its ends are the roots of
    /// `a s² + 2 b s + c`, with `a = mu² d_n² - |d_t|²`, `b = mu² f_n d_n - f_t·d_t` and
    /// `c = mu² f_n² - |f_t|²`.
    ///
    /// # Errors
    /// [`NoSqueeze`](GraspError::NoSqueeze) if there is no such factor;
    /// [`Number`](GraspError::Number) if an input is not finite, or if a result exceeds the range of
    /// the type.
    pub fn squeeze_range<const M: usize>(
        &self,
        normals: &Normals<T, M>,
        forces: &[Vector3<T>; M],
        directions: &[Vector3<T>; M],
    ) -> Result<SqueezeRange<T>, GraspError> {
        check(forces, quantity::FORCE)?;
        check(directions, quantity::SQUEEZE_DIRECTION)?;
        // In units of the greatest load and direction, no square overflows or vanishes.
        let mut load = T::zero();
        let mut reach = T::zero();
        for (force, direction) in forces.iter().zip(directions) {
            load = max(load, max(force.amax(), T::zero()));
            reach = max(reach, direction.amax());
        }
        let nonzero = |unit| if unit > T::zero() { unit } else { T::one() };
        let (load, reach) = (nonzero(load), nonzero(reach));
        let unit = load / reach;
        if !(unit > T::zero() && is_finite(unit) && is_finite(load)) {
            return Err(too_large(quantity::FORCE));
        }

        let mut range = Interval {
            low: T::zero(),
            high: None,
        };
        let contacts = forces.iter().zip(directions).zip(normals.inward());
        for (contact, ((force, direction), normal)) in contacts.enumerate() {
            let one = self.interval(normal, &(force / load), &(direction / reach));
            let none = || T::zero() / T::zero();
            let low = one.map_or_else(none, |one| one.low);
            let high = one.and_then(|one| one.high);
            let meet = one.map(|one| range.meet(&one));
            match meet {
                Some(meet) if !meet.is_empty() => range = meet,
                _ => {
                    let high = match (one, high) {
                        (Some(_), None) => T::one() / T::zero(),
                        (_, high) => high.unwrap_or_else(none),
                    };
                    return Err(GraspError::NoSqueeze {
                        contact,
                        least: (range.low * unit).to_f64(),
                        low: (low * unit).to_f64(),
                        high: (high * unit).to_f64(),
                    });
                }
            }
        }
        let least = range.low * unit;
        if !is_finite(least) {
            return Err(too_large(quantity::FORCE));
        }
        let greatest = range.high.map(|high| high * unit);
        // A value beyond the range of numbers is not a bound.
        let greatest = greatest.filter(|&greatest| is_finite(greatest));
        Ok(SqueezeRange { least, greatest })
    }

    /// The factors at which one contact sticks, zero or above; `None` if none.
    fn interval(
        &self,
        normal: &Vector3<T>,
        force: &Vector3<T>,
        direction: &Vector3<T>,
    ) -> Option<Interval<T>> {
        let (f_n, d_n) = (force.dot(normal), direction.dot(normal));
        let (f_t, d_t) = (force - normal * f_n, direction - normal * d_n);
        let mu2 = self.sliding * self.sliding;
        let (along, across) = (mu2 * d_n * d_n, d_t.norm_squared());
        let a = along - across;
        let b = mu2 * f_n * d_n - f_t.dot(&d_t);
        let c = mu2 * f_n * f_n - f_t.norm_squared();

        let mut allowed = Interval {
            low: T::zero(),
            high: None,
        };
        if abs(a) <= (along + across) * T::default_epsilon() * real(64.0) {
            // The direction lies on the cone: both conditions are linear.
            allowed.require(b + b, c);
            allowed.require(d_n, f_n);
            return (!allowed.is_empty()).then_some(allowed);
        }
        let discriminant = b * b - a * c;
        if a < T::zero() && discriminant < T::zero() {
            return None;
        }
        // The half with the sum of equal signs loses no digits; the other root follows from it.
        let root = sqrt(discriminant);
        let half = if b > T::zero() { -b - root } else { root - b };
        let one = half / a;
        let other = if half == T::zero() { one } else { c / half };
        let (lower, upper) = (min(one, other), max(one, other));
        if a > T::zero() {
            // The line runs from the mirror image of the cone into the cone, or back.
            if d_n > T::zero() {
                allowed.raise(upper);
            } else {
                allowed.cap(lower);
            }
        } else {
            if f_n - d_n * (b / a) < T::zero() {
                return None;
            }
            allowed.raise(lower);
            allowed.cap(upper);
        }
        (!allowed.is_empty()).then_some(allowed)
    }
}

/// Factors from zero up; without an upper end if `high` is absent.
#[derive(Clone, Copy)]
struct Interval<T> {
    low: T,
    high: Option<T>,
}

impl<T: Real> Interval<T> {
    fn raise(&mut self, low: T) {
        self.low = max(low, self.low);
    }

    fn cap(&mut self, high: T) {
        self.high = Some(match self.high {
            Some(present) => min(high, present),
            None => high,
        });
    }

    /// Keeps the factors s with `slope s + offset >= 0`.
    fn require(&mut self, slope: T, offset: T) {
        if slope > T::zero() {
            self.raise(-offset / slope);
        } else if slope < T::zero() {
            self.cap(-offset / slope);
        } else if offset < T::zero() {
            self.cap(-T::one());
        }
    }

    fn meet(&self, other: &Self) -> Self {
        let mut meet = *self;
        meet.raise(other.low);
        if let Some(high) = other.high {
            meet.cap(high);
        }
        meet
    }

    fn is_empty(&self) -> bool {
        self.high.is_some_and(|high| high < self.low)
    }
}
