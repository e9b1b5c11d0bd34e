//! [`Feeling`]: what the fingers feel, at most, for guards that begin motions.

use condor_hand::math::abs;
use zerocopy::FromZeros as _;

use crate::guards::{Felt, Stops};
use crate::{ACTUATORS, Actuators, FINGERS, RobotDescription};

/// The greatest of what fingers felt since a tick of the trajectories ago: in the present stretch of as
/// many servo ticks, and in the one before.
pub(super) struct Feeling {
    present: Felt,
    former: Felt,
    /// Servo ticks in a stretch, and those of the present one.
    stretch: u32,
    ticks: u32,
    /// The force of a contact of each finger, N.
    contact_n: [f64; FINGERS],
    /// The stops that were published last.
    pub(super) stopped: Stops,
}

impl Feeling {
    /// Before the first tick of a loop at this rate.
    pub(super) fn new(hand: &RobotDescription, rate_hz: u32) -> Self {
        let mut contact_n = [f64::INFINITY; FINGERS];
        for (place, finger) in contact_n.iter_mut().zip(&hand.fingers) {
            if let Some(touch) = &finger.touch {
                *place = touch.contact_n;
            }
        }
        Self {
            present: Felt::new_zeroed(),
            former: Felt::new_zeroed(),
            stretch: rate_hz.div_ceil(hand.trajectory_hz.max(1)),
            ticks: 0,
            contact_n,
            stopped: Stops::none(),
        }
    }

    /// Goes on to the next tick.
    pub(super) fn tick(&mut self) {
        if self.ticks >= self.stretch {
            self.ticks = 0;
            self.former = self.present;
            self.present = Felt::new_zeroed();
        }
        self.ticks += 1;
    }

    /// Adds what a finger of the hand feels in this tick.
    pub(super) fn add(
        &mut self,
        finger: usize,
        effort: &[f64; ACTUATORS],
        touch: f64,
        actuators: &Actuators,
    ) {
        let torques = actuators.torque(effort);
        if let Some(greatest) = self.present.torque.get_mut(finger) {
            for (greatest, &torque) in greatest.iter_mut().zip(&torques) {
                raise(greatest, abs(torque));
            }
        }
        if let Some(greatest) = self.present.effort.get_mut(finger) {
            let efforts = actuators.greatest_efforts(effort);
            for (greatest, &effort) in greatest.iter_mut().zip(&efforts) {
                raise(greatest, effort);
            }
        }
        let contact_n = self.contact_n.get(finger);
        if contact_n.is_some_and(|&contact_n| touch > contact_n) {
            self.present.contacts |= 1 << finger;
        }
    }

    /// Returns the greatest values until this tick of the loop.
    pub(super) fn felt(&self, ticks: u64) -> Felt {
        let mut felt = Felt {
            contacts: self.present.contacts | self.former.contacts,
            ticks,
            ..self.present
        };
        let Self { former, .. } = self;
        let torques = felt.torque.iter_mut().zip(&former.torque);
        let efforts = felt.effort.iter_mut().zip(&former.effort);
        for (greatest, former) in torques.chain(efforts) {
            for (greatest, &former) in greatest.iter_mut().zip(former) {
                raise(greatest, former);
            }
        }
        felt
    }
}

/// A NaN is not greater.
fn raise(greatest: &mut f64, value: f64) {
    if value > *greatest {
        *greatest = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use condor_hand::servo::FingerReadings;
    use nalgebra::SVector;

    #[test]
    fn what_lasted_a_tick_is_felt_for_a_tick_of_the_trajectories() {
        let text = include_str!("../../../../condor-hand/hands/utah-mit.toml");
        let hand = RobotDescription::from_toml(text, "utah-mit.toml").unwrap();
        let actuators = hand.fingers[1].transmission().unwrap();
        let mut feeling = Feeling::new(&hand, hand.servo_hz);
        let calm = FingerReadings::<{ crate::JOINTS }, ACTUATORS> {
            position: SVector::zeros(),
            actuator_position: [0.0; ACTUATORS],
            effort: [4.0; ACTUATORS],
            touch: 0.0,
        };
        let (mut hit, mut blind) = (calm, calm);
        hit.touch = 0.06;
        hit.effort[5] = 30.0;
        blind.touch = f64::NAN;
        blind.effort[4..6].fill(f64::NAN);
        let mut felt = 0;
        for tick in 0..40 {
            feeling.tick();
            let sensed = match tick {
                11 => &hit,
                12 => &blind,
                _ => &calm,
            };
            feeling.add(1, &sensed.effort, sensed.touch, &actuators);
            let now = feeling.felt(tick);
            let is_felt = now.contacts == 1 << 1;
            assert_eq!(is_felt, now.effort[1][2] > 29.0, "{now:?}");
            assert_eq!(is_felt, now.torque[1][2] > 0.2, "{now:?}");
            assert!(!(11..=19).contains(&tick) || is_felt, "tick {tick}");
            assert!(now.effort[0].iter().all(|&effort| effort < 1e-9));
            felt += u32::from(is_felt);
        }
        assert!((8..=16).contains(&felt), "{felt}");
    }
}
