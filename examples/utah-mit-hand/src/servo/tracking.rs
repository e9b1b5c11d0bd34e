//! [`Tracking`]: how well joints follow.

use condor_hand::math::{abs, max, sqrt};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{JOINTS, SERVED};

/// How far the joints of a processor were from where they were to be, since its loop began: a
/// published value. Only ticks in which a joint's position was controlled count.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Tracking {
    /// Sums of squares, rad².
    squares: [[f64; JOINTS]; SERVED],
    /// The largest distance, rad.
    peak: [[f64; JOINTS]; SERVED],
    /// How many ticks count.
    ticks: [[u64; JOINTS]; SERVED],
}

impl Tracking {
    /// One more tick of a finger: where each joint was to be, if anywhere, and where it is, rad.
    pub(super) fn add<'p>(
        &mut self,
        finger: usize,
        target: &[Option<f64>; JOINTS],
        position: impl Iterator<Item = &'p f64>,
    ) {
        let (Some(squares), Some(peaks), Some(ticks)) = (
            self.squares.get_mut(finger),
            self.peak.get_mut(finger),
            self.ticks.get_mut(finger),
        ) else {
            return;
        };
        let places = squares.iter_mut().zip(peaks).zip(ticks);
        for (((square, peak), ticks), (target, position)) in places.zip(target.iter().zip(position))
        {
            let Some(error) = target.map(|target| abs(target - position)) else {
                continue;
            };
            // A sensor that says nothing is a fault, and no distance.
            if error.is_finite() {
                *square += error * error;
                *peak = max(*peak, error);
                *ticks += 1;
            }
        }
    }

    /// The root of the mean square distance of a joint, rad; `None` if its position was never
    /// controlled.
    #[must_use]
    pub fn rms_rad(&self, finger: usize, joint: usize) -> Option<f64> {
        let ticks = *self.ticks.get(finger)?.get(joint)?;
        let square = *self.squares.get(finger)?.get(joint)?;
        #[allow(clippy::cast_precision_loss, reason = "2^53 ticks are a lifetime")]
        let ticks = (ticks > 0).then_some(ticks as f64);
        ticks.map(|ticks| sqrt(square / ticks))
    }

    /// The largest distance of a joint, rad.
    #[must_use]
    pub fn peak_rad(&self, finger: usize, joint: usize) -> Option<f64> {
        self.peak.get(finger)?.get(joint).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_controlled_counts() {
        let mut tracking = Tracking::default();
        let target = [Some(0.5), None, Some(1.0), Some(0.0)];
        tracking.add(1, &target, [0.2, 9.0, f64::NAN, 0.0].iter());
        tracking.add(1, &target, [0.9, 9.0, 1.0, 0.0].iter());
        let rms = tracking.rms_rad(1, 0).unwrap();
        assert!((rms * rms - f64::midpoint(0.09, 0.16)).abs() < 1e-12);
        assert!((tracking.peak_rad(1, 0).unwrap() - 0.4).abs() < 1e-12);
        assert_eq!(tracking.rms_rad(1, 1), None);
        assert_eq!(tracking.rms_rad(1, 2), Some(0.0));
        assert_eq!(tracking.rms_rad(0, 0), None);
        assert_eq!(tracking.rms_rad(2, 0), None);
    }
}
