use super::values::{put_gains, put_target, put_wanted, take_gains, take_target, take_wanted};
use super::words::{WordReader, WordWriter};
use crate::controller::FingerController;
use crate::dynamics::Dynamics;
use crate::servo::{JointGains, JointTarget, ServoMode};
use crate::trajectory::{SetPoint, StopGuard};

/// A request that a servo loop passed to the controller of a finger, for recording and replay.
///
/// [`HandLoop::tick_telling`](super::HandLoop::tick_telling) reports these requests. A program that
/// [repeats](Self::repeat) them in the same ticks, with the same readings of the sensors, gets the
/// same behaviour of the finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FingerRequest<const N: usize> {
    /// Clears the latched faults.
    Restart,
    /// Sets another mode of a joint.
    Mode {
        /// The joint, from 0.
        joint: usize,
        /// The mode that was asked for.
        mode: ServoMode,
    },
    /// Sets a target of a joint, and the mode of that target.
    Target {
        /// The joint, from 0.
        joint: usize,
        /// The target that was asked for.
        target: JointTarget<f64>,
    },
    /// Sets other gains of a joint.
    Gains {
        /// The joint, from 0.
        joint: usize,
        /// The gains that were asked for.
        gains: JointGains<f64>,
    },
    /// Sets what the master wants of the joints.
    Follow {
        /// The positions one tick of the master from now.
        points: [SetPoint<f64>; N],
        /// The motions, with what stops them.
        guards: [StopGuard; N],
    },
}

/// The meanings of word 0.
mod kind {
    pub(super) const RESTART: u32 = 0;
    pub(super) const MODE: u32 = 1;
    pub(super) const TARGET: u32 = 2;
    pub(super) const GAINS: u32 = 3;
    pub(super) const FOLLOW: u32 = 4;
}

impl<const N: usize> FingerRequest<N> {
    /// Passes the same request to another controller. If the first controller refused the request,
    /// the other one refuses it, too; a refused request has no effect.
    pub fn repeat<M: Dynamics<f64, N>>(&self, controller: &mut FingerController<M, N>) {
        // The first controller has told whoever asked.
        match *self {
            Self::Restart => controller.clear(),
            Self::Mode { joint, mode } => {
                let _ = controller.set_mode(joint, mode);
            }
            Self::Target { joint, target } => {
                let _ = controller.set_target(joint, target);
            }
            Self::Gains { joint, gains } => {
                let _ = controller.set_gains(joint, &gains);
            }
            Self::Follow { points, guards } => {
                let _ = controller.follow(&points, &guards);
            }
        }
    }

    /// Writes the request as words of 32 bits to the beginning of `words`, and returns the number of words that it
    /// used. That is at most the greater of 29 and 1 + 12 `N`. Words for which there is no room are left out.
    ///
    /// | word 0 | the words after it |
    /// |---|---|
    /// | 0 restart | |
    /// | 1 mode | joint, [`ServoMode`] |
    /// | 2 target | joint, [`ServoMode`], three numbers |
    /// | 3 gains | joint, law, 13 numbers |
    /// | 4 follow | for each joint: position, velocity and acceleration; the number of its motion; 1 if a contact stops the motion, otherwise 0; the torque and the tension that stop the motion |
    ///
    /// Numbers are as in the [protocol](super): two words, the low one first.
    pub fn put(&self, words: &mut [u32]) -> usize {
        let before = words.len();
        let mut put = WordWriter::into(words);
        match self {
            Self::Restart => {
                put.word(kind::RESTART);
            }
            Self::Mode { joint, mode } => {
                put.words(&[kind::MODE, *joint as u32, *mode as u32]);
            }
            Self::Target { joint, target } => {
                put.words(&[kind::TARGET, *joint as u32]);
                put_target(target, &mut put);
            }
            Self::Gains { joint, gains } => {
                put.words(&[kind::GAINS, *joint as u32]);
                put_gains(gains, &mut put);
            }
            Self::Follow { points, guards } => {
                put.word(kind::FOLLOW);
                for (point, guard) in points.iter().zip(guards) {
                    put_wanted(point, guard, &mut put);
                }
            }
        }
        before - put.room()
    }

    /// Reads a request from the words that [`put`](Self::put) wrote; returns `None` if the words
    /// are not a request.
    #[must_use]
    pub fn take(words: &[u32]) -> Option<Self> {
        let mut taken = WordReader::from(words);
        Some(match taken.word() {
            kind::RESTART => Self::Restart,
            kind::MODE => Self::Mode {
                joint: taken.word() as usize,
                mode: ServoMode::from_number(taken.word())?,
            },
            kind::TARGET => {
                let (joint, mode) = (taken.word() as usize, taken.word());
                let target = take_target(mode, &mut taken).ok()?;
                Self::Target { joint, target }
            }
            kind::GAINS => {
                let (joint, law) = (taken.word() as usize, taken.word());
                let gains = take_gains(law, &mut taken)?;
                Self::Gains { joint, gains }
            }
            kind::FOLLOW => {
                let mut points = [SetPoint::rest(0.0); N];
                let mut guards = [StopGuard::NONE; N];
                for (point, guard) in points.iter_mut().zip(&mut guards) {
                    (*point, *guard) = take_wanted(&mut taken);
                }
                Self::Follow { points, guards }
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::PositionLaw;
    use crate::tendon::{Pair, TensionGains};

    #[test]
    fn words_say_what_was_asked() {
        let tension = TensionGains {
            kt: 1.0,
            ki: 2.0,
            kd: 3.0,
            kv: 4.0,
        };
        let gains = JointGains {
            law: PositionLaw::ComputedTorque {
                bandwidth_hz: 5.0,
                damping_ratio: 0.7,
            },
            k_torque: 0.5,
            tension: Pair::both(tension),
        };
        let target = JointTarget::Tension(Pair {
            flexor: 9.0,
            extensor: 8.0,
        });
        let mode = ServoMode::Position;
        let points = [1.0, -0.0, 3.0, 4.0].map(SetPoint::rest);
        let mut guards = [StopGuard::NONE; 4];
        guards[2] = StopGuard {
            motion: 7,
            torque: 0.1,
            tension: 20.0,
            contact: true,
        };
        for (asked, len) in [
            (FingerRequest::Restart, 1),
            (FingerRequest::Mode { joint: 3, mode }, 3),
            (FingerRequest::Target { joint: 1, target }, 9),
            (FingerRequest::Gains { joint: 2, gains }, 29),
            (FingerRequest::Follow { points, guards }, 49),
        ] {
            let mut words = [7; 64];
            assert_eq!(asked.put(&mut words), len);
            assert_eq!(FingerRequest::<4>::take(&words[..len]), Some(asked));
            // Nothing of it is past its end.
            assert!(words[len..].iter().all(|&word| word == 7));
        }
        for wrong in [&[5_u32] as &[u32], &[1, 0, 9], &[2, 0, 9], &[3, 0, 2]] {
            assert_eq!(FingerRequest::<4>::take(wrong), None);
        }
    }
}
