//! [`Tracking`]: how well joints follow, in the whole run and in each motion.

use condor_hand::config::Finger;
use condor_hand::math::{abs, max, sqrt};
use condor_vars::cell_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{ACTUATORS, FINGERS, JOINTS};

/// The time for which a joint settles after its position is controlled, before it counts as following, s.
const SETTLING_S: f64 = 0.5;

/// The tracking errors of the joints of a servo processor, which it publishes. A tracking error is the distance of a
/// joint from its desired position.
///
/// Only ticks count in which the joint follows. A joint begins to follow half a second after all position-controlled
/// joints of its finger, and their desired positions, were out of their stops at once. It follows until its position is
/// not controlled any more. Before that, a joint may still be pushed out of a stop, or caught after a fall, which is
/// not the error of following.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Tracking {
    /// The tracking errors since the loop began.
    pub whole: Figures,
    /// The number of the motion that runs, as the master publishes it; 0 for none.
    motion: u64,
    /// The tracking errors since that motion began.
    present: Figures,
    /// The number of the motion before; 0 for none.
    last_motion: u64,
    /// The tracking errors of the motion before.
    last: Figures,
}

/// The tracking errors of joints over a span of time, such as a motion: greatest values and root mean squares. Only
/// ticks in which a joint follows count: see [`Tracking`].
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Figures {
    /// Sums of squares, rad².
    squares: [[f64; JOINTS]; FINGERS],
    /// The largest distance, rad.
    peak: [[f64; JOINTS]; FINGERS],
    /// The number of ticks that count.
    ticks: [[u64; JOINTS]; FINGERS],
}

cell_struct!(Tracking {
    "squares": whole.squares, "rad^2", "Sums of the squares of the distances, since the loop began.";
    "peak": whole.peak, "rad", "The largest distance.";
    "ticks": whole.ticks, "", "Number of counted ticks.";
    "motion": motion, "", "The number of the motion that runs; 0 for none.";
    "motion.squares": present.squares, "rad^2", "Since this motion began.";
    "motion.peak": present.peak, "rad";
    "motion.ticks": present.ticks, "";
    "last": last_motion, "", "Number of the last motion; 0 for none.";
    "last.squares": last.squares, "rad^2", "Of the last motion.";
    "last.peak": last.peak, "rad";
    "last.ticks": last.ticks, "";
});

/// The joint with the largest tracking error, and its errors. [`Figures::worst`] returns it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// The finger of the joint, from 0.
    pub finger: usize,
    /// The joint, from 0.
    pub joint: usize,
    /// The largest tracking error of the joint, rad.
    pub peak_rad: f64,
    /// The root mean square tracking error of the joint, rad.
    pub rms_rad: f64,
}

/// The state with which each tick adds to [`Tracking`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Tracker {
    pub(super) tracking: Tracking,
    /// Between its stops, rad.
    free: [[(f64, f64); JOINTS]; FINGERS],
    /// For so many ticks more a joint settles; `None` before it begins to.
    settles: [[Option<u32>; JOINTS]; FINGERS],
    settling_ticks: u32,
}

impl Tracker {
    /// Before the first tick of a hand's fingers, of a loop at this rate.
    pub(super) fn new(fingers: &[Finger<JOINTS, ACTUATORS>], rate_hz: u32) -> Self {
        let mut free = [[(0.0, 0.0); JOINTS]; FINGERS];
        for (finger, free) in fingers.iter().zip(&mut free) {
            for (joint, free) in finger.joints.iter().zip(free) {
                *free = joint.rest_range();
            }
        }
        Self {
            tracking: Tracking::default(),
            free,
            settles: [[None; JOINTS]; FINGERS],
            #[allow(
                clippy::cast_sign_loss,
                clippy::cast_possible_truncation,
                reason = "half of a u32"
            )]
            settling_ticks: (SETTLING_S * f64::from(rate_hz)) as u32,
        }
    }

    /// One more tick of a finger: where each joint was to be, if anywhere, and where it is, rad.
    pub(super) fn add<'p>(
        &mut self,
        finger: usize,
        target: &[Option<f64>; JOINTS],
        position: impl Iterator<Item = &'p f64> + Clone,
    ) {
        let (Some(free), Some(settles)) = (self.free.get(finger), self.settles.get_mut(finger))
        else {
            return;
        };
        let mut joints = target.iter().zip(position.clone()).zip(free);
        let are_free = joints.all(|((target, position), &(low, high))| {
            let is_free = |place: f64| low <= place && place <= high;
            target.is_none_or(|to| is_free(to) && is_free(*position))
        });
        let mut followed = [None; JOINTS];
        for ((target, settles), followed) in target.iter().zip(settles).zip(&mut followed) {
            *settles = match *settles {
                _ if target.is_none() => None,
                Some(ticks) => Some(ticks.saturating_sub(1)),
                None => are_free.then_some(self.settling_ticks),
            };
            *followed = target.filter(|_| *settles == Some(0));
        }
        let tracking = &mut self.tracking;
        tracking.whole.add(finger, &followed, position.clone());
        tracking.present.add(finger, &followed, position);
    }

    /// Which motion runs from now on, 0 for none; whether it is another one.
    pub(super) fn set_motion(&mut self, motion: u64) -> bool {
        let tracking = &mut self.tracking;
        let is_new = tracking.motion != motion;
        if is_new {
            // The time between two motions is not a motion.
            if tracking.motion != 0 {
                (tracking.last_motion, tracking.last) = (tracking.motion, tracking.present);
            }
            (tracking.motion, tracking.present) = (motion, Figures::default());
        }
        is_new
    }
}

impl Tracking {
    /// Returns the tracking errors of the motion with the number `motion`, if it is the last one that has ended; `None`
    /// otherwise.
    #[must_use]
    pub fn ended(&self, motion: u64) -> Option<&Figures> {
        (motion != 0 && self.last_motion == motion).then_some(&self.last)
    }
}

impl Figures {
    /// Adds those of another time.
    pub(crate) fn merge(&mut self, other: &Self) {
        for finger in 0..FINGERS {
            self.merge_finger(finger, other);
        }
    }

    /// Adds those of a finger.
    pub(crate) fn merge_finger(&mut self, finger: usize, other: &Self) {
        if let (Some(squares), Some(more)) =
            (self.squares.get_mut(finger), other.squares.get(finger))
        {
            for (square, more) in squares.iter_mut().zip(more) {
                *square += more;
            }
        }
        if let (Some(peaks), Some(more)) = (self.peak.get_mut(finger), other.peak.get(finger)) {
            for (peak, more) in peaks.iter_mut().zip(more) {
                *peak = max(*peak, *more);
            }
        }
        if let (Some(ticks), Some(more)) = (self.ticks.get_mut(finger), other.ticks.get(finger)) {
            for (ticks, more) in ticks.iter_mut().zip(more) {
                *ticks = ticks.wrapping_add(*more);
            }
        }
    }

    /// Returns the joint with the largest tracking error; `None` if no joint has followed in any tick.
    #[must_use]
    pub fn worst(&self) -> Option<Worst> {
        let mut worst: Option<Worst> = None;
        for finger in 0..FINGERS {
            for joint in 0..JOINTS {
                let (rms, peak) = (self.rms_rad(finger, joint), self.peak_rad(finger, joint));
                let (Some(rms_rad), Some(peak_rad)) = (rms, peak) else {
                    continue;
                };
                if worst.is_none_or(|worst| peak_rad > worst.peak_rad) {
                    worst = Some(Worst {
                        finger,
                        joint,
                        peak_rad,
                        rms_rad,
                    });
                }
            }
        }
        worst
    }

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

    /// Returns the root mean square tracking error of a joint, rad; `None` if the joint never followed, or if there is
    /// no such joint. `finger` and `joint` count from 0.
    #[must_use]
    pub fn rms_rad(&self, finger: usize, joint: usize) -> Option<f64> {
        let ticks = *self.ticks.get(finger)?.get(joint)?;
        let square = *self.squares.get(finger)?.get(joint)?;
        #[allow(clippy::cast_precision_loss, reason = "2^53 ticks are a lifetime")]
        let ticks = (ticks > 0).then_some(ticks as f64);
        ticks.map(|ticks| sqrt(square / ticks))
    }

    /// Returns the largest tracking error of a joint, rad: 0 if the joint never followed, `None` if there is no such
    /// joint. `finger` and `joint` count from 0.
    #[must_use]
    pub fn peak_rad(&self, finger: usize, joint: usize) -> Option<f64> {
        self.peak.get(finger)?.get(joint).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The targets of the first joints of a finger; the others follow nothing.
    fn targets(first: [Option<f64>; 4]) -> [Option<f64>; JOINTS] {
        let mut targets = [None; JOINTS];
        targets[..4].copy_from_slice(&first);
        targets
    }

    #[test]
    fn only_what_is_controlled_counts() {
        let mut tracking = Figures::default();
        let target = targets([Some(0.5), None, Some(1.0), Some(0.0)]);
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
    fn each_motion_has_figures_of_its_own() {
        let mut tracker = Tracker {
            tracking: Tracking::default(),
            free: [[(-1.0, 1.0); JOINTS]; FINGERS],
            settles: [[None; JOINTS]; FINGERS],
            settling_ticks: 0,
        };
        let target = [Some(0.5); JOINTS];
        let mut run = |motion: u64, error: f64| {
            let is_new = tracker.set_motion(motion);
            let place = [0.5, 0.5, 0.5 - error, 0.5];
            tracker.add(1, &target, place.iter());
            (is_new, tracker.tracking)
        };
        assert!(!run(0, 0.4).0);
        assert!(run(7, 0.1).0);
        assert!(!run(7, 0.3).0);
        let (is_new, tracking) = run(0, 0.2);
        assert!(is_new);
        assert_eq!((tracking.ended(0), tracking.ended(6)), (None, None));
        let worst = tracking.ended(7).unwrap().worst().unwrap();
        assert_eq!((worst.finger, worst.joint), (1, 2));
        assert!((worst.peak_rad - 0.3).abs() < 1e-12);
        assert!((worst.rms_rad - f64::midpoint(0.01, 0.09).sqrt()).abs() < 1e-12);
        // One that begins at once; and the whole run goes on.
        run(8, 0.05);
        let (_, tracking) = run(9, 0.0);
        let worst = tracking.ended(8).unwrap().worst().unwrap();
        assert!((worst.peak_rad - 0.05).abs() < 1e-12);
        assert_eq!(tracking.ended(7), None);
        assert!((tracking.whole.peak_rad(1, 2).unwrap() - 0.4).abs() < 1e-12);
        let mut both = *tracking.ended(8).unwrap();
        both.merge(&tracking.whole);
        assert!((both.worst().unwrap().peak_rad - 0.4).abs() < 1e-12);
    }

    #[test]
    fn a_joint_that_comes_out_of_a_stop_does_not_follow_yet() {
        let mut tracker = Tracker {
            tracking: Tracking::default(),
            free: [[(0.1, 0.9); JOINTS]; FINGERS],
            settles: [[None; JOINTS]; FINGERS],
            settling_ticks: 0,
        };
        // The third joint moves, beside one that follows nothing and one that is pushed aside meanwhile.
        let mut tick = |target: Option<f64>, position: f64| {
            let aside = if target == Some(0.0) { 0.9 } else { 0.5 };
            let targets = targets([Some(0.5), None, target, target]);
            tracker.add(0, &targets, [aside, 0.0, position, position].iter());
            let beside = tracker.tracking.whole.peak_rad(0, 0).unwrap();
            assert!(beside < 1e-12, "{beside}");
            tracker.tracking.whole.peak_rad(0, 2).unwrap()
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
    #[test]
    fn a_joint_follows_when_it_had_its_time_to_settle() {
        let mut tracker = Tracker {
            tracking: Tracking::default(),
            free: [[(-1.0, 1.0); JOINTS]; FINGERS],
            settles: [[None; JOINTS]; FINGERS],
            settling_ticks: 3,
        };
        let mut tick = |target: Option<f64>| {
            tracker.add(0, &[target; JOINTS], [0.5; JOINTS].iter());
            tracker.tracking.whole.peak_rad(0, 0).unwrap()
        };
        assert!([0.9, 0.8, 0.7].iter().all(|&to| tick(Some(to)) == 0.0));
        assert!((tick(Some(0.6)) - 0.1).abs() < 1e-12);
        // And anew each time that its position is controlled.
        tick(None);
        assert!([0.9, 0.8, 0.7].iter().all(|&to| tick(Some(to)) < 0.11));
        assert!((tick(Some(0.7)) - 0.2).abs() < 1e-12);
    }
}
