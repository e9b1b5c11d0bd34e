//! The profile of one joint, whatever its shape.

use super::{MAX_VIAS, Polynomial, ProfilePeaks, Segments, SetPoint, Spline};

/// The knots of a spline: the via points and both ends.
pub(super) const KNOTS: usize = MAX_VIAS + 2;

#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "nothing is allocated")]
pub(super) enum Path {
    Still(f64),
    Polynomial(Polynomial),
    Segments(Segments),
    Spline(Spline<KNOTS>),
}

impl Path {
    pub(super) fn at(&self, t: f64) -> SetPoint {
        match self {
            Self::Still(position) => SetPoint::rest(*position),
            Self::Polynomial(polynomial) => polynomial.at(t),
            Self::Segments(segments) => segments.at(t),
            Self::Spline(spline) => spline.at(t),
        }
    }

    pub(super) fn peaks(&self) -> ProfilePeaks {
        match self {
            Self::Still(position) => ProfilePeaks::of(&SetPoint::rest(*position)),
            Self::Polynomial(polynomial) => polynomial.peaks(),
            Self::Segments(segments) => segments.peaks(),
            Self::Spline(spline) => spline.peaks(),
        }
    }

    pub(super) fn duration(&self) -> f64 {
        match self {
            Self::Still(_) => 0.0,
            Self::Polynomial(polynomial) => polynomial.duration(),
            Self::Segments(segments) => segments.duration(),
            Self::Spline(spline) => spline.duration(),
        }
    }
}
