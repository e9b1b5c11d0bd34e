//! The profile of one joint, whatever its shape.

use super::{MAX_VIAS, Polynomial, ProfilePeaks, Segments, SetPoint, Spline};
use crate::math::Real;

/// The knots of a spline: the via points and both ends.
pub(super) const KNOTS: usize = MAX_VIAS + 2;

#[derive(Clone, Debug)]
pub(super) enum Path<T: Real> {
    Still(T),
    Polynomial(Polynomial<T>),
    Segments(Segments<T>),
    Spline(Spline<T, KNOTS>),
}

impl<T: Real> Path<T> {
    pub(super) fn at(&self, t: T) -> SetPoint<T> {
        match self {
            Self::Still(position) => SetPoint::rest(*position),
            Self::Polynomial(polynomial) => polynomial.at(t),
            Self::Segments(segments) => segments.at(t),
            Self::Spline(spline) => spline.at(t),
        }
    }

    pub(super) fn peaks(&self) -> ProfilePeaks<T> {
        match self {
            Self::Still(position) => ProfilePeaks::of(&SetPoint::rest(*position)),
            Self::Polynomial(polynomial) => polynomial.peaks(),
            Self::Segments(segments) => segments.peaks(),
            Self::Spline(spline) => spline.peaks(),
        }
    }

    pub(super) fn duration(&self) -> T {
        match self {
            Self::Still(_) => T::zero(),
            Self::Polynomial(polynomial) => polynomial.duration(),
            Self::Segments(segments) => segments.duration(),
            Self::Spline(spline) => spline.duration(),
        }
    }
}
