//! [`Tracking`]: how well joints follow.

use condor_hand::config::Finger;
use condor_hand::math::{abs, max, sqrt};
use condor_vars::{Described, Field, Kind};
use core::mem::offset_of;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{FINGERS, JOINTS};

/// How far the joints of a processor's fingers were from where they were to be, since its loop began: a
/// published value. Only ticks count in which a joint followed: its position was controlled, and since that
/// began all such joints of its finger have been out of their stops at once, and were to be. A joint that comes
/// out of a stop is pushed, and pushes its neighbours; neither follows anything.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Tracking {
    /// Sums of squares, rad².
    squares: [[f64; JOINTS]; FINGERS],
    /// The largest distance, rad.
    peak: [[f64; JOINTS]; FINGERS],
    /// How many ticks count.
    ticks: [[u64; JOINTS]; FINGERS],
}

impl Described for Tracking {
    const FIELDS: &'static [Field] = &[
        Field::new("squares", "rad^2", Kind::F64, offset_of!(Tracking, squares))
            .repeated(FINGERS * JOINTS)
            .about("Sums of the squares of the distances."),
        Field::new("peak", "rad", Kind::F64, offset_of!(Tracking, peak))
            .repeated(FINGERS * JOINTS)
            .about("The largest distance."),
        Field::new("ticks", "", Kind::U64, offset_of!(Tracking, ticks))
            .repeated(FINGERS * JOINTS)
            .about("How many ticks count."),
    ];
}

/// What a tick adds to [`Tracking`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Tracker {
    pub(super) tracking: Tracking,
    /// Between its stops, rad.
    free: [[(f64, f64); JOINTS]; FINGERS],
    follows: [[bool; JOINTS]; FINGERS],
}

impl Tracker {
    /// Before the first tick of a hand's fingers.
    pub(super) fn new(fingers: &[Finger<JOINTS>]) -> Self {
        let mut free = [[(0.0, 0.0); JOINTS]; FINGERS];
        for (finger, free) in fingers.iter().zip(&mut free) {
            for (joint, free) in finger.joints.iter().zip(free) {
                *free = joint.rest_range();
            }
        }
        Self {
            tracking: Tracking::default(),
            free,
            follows: [[false; JOINTS]; FINGERS],
        }
    }

    /// One more tick of a finger: where each joint was to be, if anywhere, and where it is, rad.
    pub(super) fn add<'p>(
        &mut self,
        finger: usize,
        target: &[Option<f64>; JOINTS],
        position: impl Iterator<Item = &'p f64> + Clone,
    ) {
        let (Some(free), Some(follows)) = (self.free.get(finger), self.follows.get_mut(finger))
        else {
            return;
        };
        let mut joints = target.iter().zip(position.clone()).zip(free);
        let are_free = joints.all(|((target, position), &(low, high))| {
            let is_free = |place: f64| low <= place && place <= high;
            target.is_none_or(|to| is_free(to) && is_free(*position))
        });
        let mut followed = [None; JOINTS];
        for ((target, follows), followed) in target.iter().zip(follows).zip(&mut followed) {
            *follows = target.is_some() && (*follows || are_free);
            *followed = target.filter(|_| *follows);
        }
        self.tracking.add(finger, &followed, position);
    }
}

impl Tracking {
    /// One more tick of a finger: where each joint was to be, if it followed, and where it is, rad.
    fn add<'p>(
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

    /// The root of the mean square distance of a joint, rad; `None` if it never followed.
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
        assert_eq!(tracking.rms_rad(FINGERS, 0), None);
    }

    #[test]
    fn a_joint_that_comes_out_of_a_stop_does_not_follow_yet() {
        let mut tracker = Tracker {
            tracking: Tracking::default(),
            free: [[(0.1, 0.9); JOINTS]; FINGERS],
            follows: [[false; JOINTS]; FINGERS],
        };
        // The third joint moves, beside one that follows nothing and one that is pushed aside meanwhile.
        let mut tick = |target: Option<f64>, position: f64| {
            let aside = if target == Some(0.0) { 0.9 } else { 0.5 };
            let targets = [Some(0.5), None, target, target];
            tracker.add(0, &targets, [aside, 0.0, position, position].iter());
            let beside = tracker.tracking.peak_rad(0, 0).unwrap();
            assert!(beside < 1e-12, "{beside}");
            tracker.tracking.peak_rad(0, 2).unwrap()
        };
        // At the stop, then thrown out of it, while it is to be there.
        assert!(tick(Some(0.0), 0.0) < 1e-12);
        assert!(tick(Some(0.05), 0.7) < 1e-12);
        // To be out of it, and thrown back.
        assert!(tick(Some(0.2), 0.05) < 1e-12);
        assert!(tick(Some(0.25), 0.25) < 1e-12);
        // From here on it follows: to a stop, too, and into it.
        assert!((tick(Some(0.05), 0.1) - 0.05).abs() < 1e-12);
        assert!((tick(Some(0.3), 0.1) - 0.2).abs() < 1e-12);
        // Until it is off.
        tick(None, 0.0);
        assert!((tick(Some(0.5), 0.0) - 0.2).abs() < 1e-12);
    }
}
