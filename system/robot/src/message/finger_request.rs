use condor_hand::config::{ActuatorNumber, FaultNumber, JointNumber};
use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics;
use condor_hand::servo::{EffortGains, JointGains, JointTarget, ServoMode};
use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_hand::transmission::Transmission;
use serde::{Deserialize, Serialize};
use zerocopy::IntoBytes;

/// A request that a servo loop passed to the controller of a finger, for recording and replay.
///
/// [`HandLoop::tick_telling`](super::HandLoop::tick_telling) reports these requests. A program that
/// [repeats](Self::repeat) them in the same ticks, with the same readings of the sensors, gets the
/// same behaviour of the finger.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
        target: JointTarget,
    },
    /// Sets the effort of an actuator, and the mode of its joint.
    Effort {
        /// The actuator, from 0.
        actuator: usize,
        /// The effort that was asked for, N or N m.
        effort: f64,
    },
    /// Sets other gains of an actuator.
    EffortGains {
        /// The actuator, from 0.
        actuator: usize,
        /// The gains that were asked for.
        gains: EffortGains,
    },
    /// Sets other gains of a joint.
    Gains {
        /// The joint, from 0.
        joint: usize,
        /// The gains that were asked for.
        gains: JointGains,
    },
    /// Sets what the master wants of the joints.
    Follow {
        /// The positions one tick of the master from now.
        #[serde(with = "array")]
        points: [SetPoint; N],
        /// The motions, with what stops them.
        #[serde(with = "array")]
        guards: [StopGuard; N],
    },
    /// Sets another limit, stop or filter of a joint.
    Number {
        /// The joint, from 0.
        joint: usize,
        /// The number that was set.
        number: JointNumber,
        /// The value that was asked for.
        value: f64,
    },
    /// Sets another threshold or filter of an actuator.
    ActuatorNumber {
        /// The actuator, from 0.
        actuator: usize,
        /// The number that was set.
        number: ActuatorNumber,
        /// The value that was asked for.
        value: f64,
    },
    /// Sets another condition of faults.
    Fault {
        /// The number that was set.
        number: FaultNumber,
        /// The value that was asked for.
        value: f64,
    },
}

impl<const N: usize> FingerRequest<N> {
    /// The greatest number of words that [`put`](Self::put) needs: gains take up to 53 bytes, and set-points up to 46 for
    /// each joint, behind 3.
    pub const WORDS: usize = {
        let (gains, points) = (53, 3 + 46 * N);
        let bytes: usize = if gains > points { gains } else { points };
        bytes.div_ceil(size_of::<u32>())
    };

    /// Passes the same request to another controller. If the first controller refused the request,
    /// the other one refuses it, too; a refused request has no effect.
    pub fn repeat<M, T, const A: usize>(&self, controller: &mut FingerController<M, T, N, A>)
    where
        M: Dynamics<N>,
        T: Transmission<N, A>,
    {
        // The first controller has told whoever asked.
        match *self {
            Self::Restart => controller.clear(),
            Self::Mode { joint, mode } => {
                let _ = controller.set_mode(joint, mode);
            }
            Self::Target { joint, target } => {
                let _ = controller.set_target(joint, target);
            }
            Self::Effort { actuator, effort } => {
                let _ = controller.set_effort(actuator, effort);
            }
            Self::EffortGains { actuator, gains } => {
                let _ = controller.set_effort_gains(actuator, &gains);
            }
            Self::Gains { joint, gains } => {
                let _ = controller.set_gains(joint, &gains);
            }
            Self::Follow { points, guards } => {
                let _ = controller.follow(&points, &guards);
            }
            Self::Number {
                joint,
                number,
                value,
            } => {
                let _ = controller.set_number(joint, number, value);
            }
            Self::ActuatorNumber {
                actuator,
                number,
                value,
            } => {
                let _ = controller.set_actuator_number(actuator, number, value);
            }
            Self::Fault { number, value } => {
                let _ = controller.set_fault_number(number, value);
            }
        }
    }

    /// Writes the request to the beginning of `words`, in the format of [postcard](https://postcard.jamesmunns.com) with
    /// zeros up to a whole word. Returns the number of words that it used, or `None` if there is no room.
    #[must_use]
    pub fn put(&self, words: &mut [u32]) -> Option<usize> {
        let used = postcard::to_slice(self, words.as_mut_bytes()).ok()?.len();
        let count = used.div_ceil(size_of::<u32>());
        let bytes = words.get_mut(..count)?.as_mut_bytes();
        bytes.get_mut(used..)?.fill(0);
        Some(count)
    }

    /// Reads a request from the words that [`put`](Self::put) wrote; returns `None` if the words
    /// are not a request.
    #[must_use]
    pub fn take(words: &[u32]) -> Option<Self> {
        let (request, rest) = postcard::take_from_bytes(words.as_bytes()).ok()?;
        let is_padding = rest.len() < size_of::<u32>() && rest.iter().all(|&byte| byte == 0);
        is_padding.then_some(request)
    }
}

/// Arrays of any length.
mod array {
    use heapless::Vec;
    use serde::de::{DeserializeOwned, Error};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer, T: Serialize + Clone, const N: usize>(
        array: &[T; N],
        to: S,
    ) -> Result<S::Ok, S::Error> {
        Vec::<T, N>::from_array(array.clone()).serialize(to)
    }

    pub(super) fn deserialize<'d, D: Deserializer<'d>, T: DeserializeOwned, const N: usize>(
        from: D,
    ) -> Result<[T; N], D::Error> {
        let all = Vec::<T, N>::deserialize(from)?;
        all.into_array()
            .map_err(|it| D::Error::invalid_length(it.len(), &"a value for each joint"))
    }
}

#[cfg(test)]
mod tests {
    use condor_hand::servo::PositionLaw;

    use super::*;

    #[test]
    fn words_say_what_was_asked() {
        let effort_gains = EffortGains {
            kp: 1.0,
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
        };
        let target = JointTarget::Torque(9.0);
        let mode = ServoMode::Position;
        let points = [1.0, -0.0, 3.0, 4.0].map(SetPoint::rest);
        let mut guards = [StopGuard::NONE; 4];
        guards[2] = StopGuard {
            motion: 7,
            torque: 0.1,
            effort: 20.0,
            contact: true,
        };
        for asked in [
            FingerRequest::Restart,
            FingerRequest::Mode { joint: 3, mode },
            FingerRequest::Target { joint: 1, target },
            FingerRequest::Gains { joint: 2, gains },
            FingerRequest::Follow { points, guards },
            FingerRequest::Number {
                joint: 3,
                number: JointNumber::PositionCutoff,
                value: 25.0,
            },
            FingerRequest::Effort {
                actuator: 7,
                effort: 8.0,
            },
            FingerRequest::EffortGains {
                actuator: 6,
                gains: effort_gains,
            },
            FingerRequest::ActuatorNumber {
                actuator: 5,
                number: ActuatorNumber::Above,
                value: 90.0,
            },
            FingerRequest::Fault {
                number: FaultNumber::Tracking,
                value: 0.2,
            },
        ] {
            let mut words = [7; 64];
            let len = asked.put(&mut words).unwrap();
            assert_eq!(FingerRequest::<4>::take(&words[..len]), Some(asked));
            // Nothing of it is past its end.
            assert!(words[len..].iter().all(|&word| word == 7));
            assert_eq!(asked.put(&mut words[..len - 1]), None);
            words[len] = 0;
            assert_eq!(FingerRequest::<4>::take(&words[..=len]), None);
        }
        for wrong in [&[] as &[u32], &[5], &[1 | 9 << 16], &[3]] {
            assert_eq!(FingerRequest::<4>::take(wrong), None);
        }
    }
}
