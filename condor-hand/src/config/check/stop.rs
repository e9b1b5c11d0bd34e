//! The check that joints come to rest at their soft stops.

use nalgebra::{SMatrix, SVector};

use super::at::At;
use crate::Requirement;
use crate::config::{Actuator, Finger, Joint, Mistake, ServoLaw};
use crate::math::exp;

/// In this time, s, hardly anything may be left of a motion: this part of it.
const REST_S: f64 = 4.0;
const LEFT: f64 = 0.01;

/// While the robot runs, a cutoff can be this part of the described one at least.
pub(in crate::config) const LOWER_CUTOFF: f64 = 0.1;

impl<const J: usize, const A: usize> Finger<J, A> {
    /// Refuses a stop in which a joint would swing for ever, or for too long.
    pub(super) fn check_stop(&self, joint: &Joint, at: &At, rate_hz: u32) -> Result<(), Mistake> {
        let bandwidth_hz = joint.stop.bandwidth_hz;
        let rests = self.rests_at(joint, rate_hz);
        if joint.stop.zone == 0.0 || bandwidth_hz == 0.0 || rests(bandwidth_hz) {
            return Ok(());
        }
        let must = Requirement::AtMost(boundary(0.0, bandwidth_hz, rests));
        let reason = "; with its servo and its actuators the joint would swing on a stiffer stop instead of coming to rest";
        Err(at.off("stop.bandwidth_hz", bandwidth_hz, must, reason))
    }

    /// The least part of their described cutoffs with which the filters of position and velocity are fast enough for
    /// the described stop, from a tenth to 1.
    pub(in crate::config) fn slowest_filters(&self, joint: &Joint, rate_hz: u32) -> f64 {
        let rests = |part: f64| {
            let mut slower = joint.clone();
            let servo = &mut slower.servo;
            servo.velocity_cutoff_hz *= part;
            servo.position_cutoff_hz = servo.position_cutoff_hz.map(|hz| part * hz);
            self.rests_at(&slower, rate_hz)(joint.stop.bandwidth_hz)
        };
        if joint.stop.zone == 0.0 || joint.stop.bandwidth_hz == 0.0 || rests(LOWER_CUTOFF) {
            return LOWER_CUTOFF;
        }
        boundary(1.0, LOWER_CUTOFF, rests)
    }

    /// Tells whether a joint comes to rest at a stop of a bandwidth.
    fn rests_at(&self, joint: &Joint, rate_hz: u32) -> impl Fn(f64) -> bool {
        // A law that swings by itself does so everywhere, and is judged by whoever tunes it.
        let rests = move |law_hz, stop_hz| self.rests(joint, law_hz, stop_hz, rate_hz);
        let law_hz = match joint.servo.law {
            ServoLaw::Decoupled if rests(joint.servo.bandwidth_hz, 0.0) => joint.servo.bandwidth_hz,
            // Its gains are for some inertia, which is another in every posture.
            ServoLaw::Pd | ServoLaw::Decoupled => 0.0,
        };
        // In other modes than that of positions the stop is alone.
        move |stop_hz| rests(law_hz, stop_hz) && rests(0.0, stop_hz)
    }

    /// Returns true if a joint comes to rest with a law and a stop of these bandwidths, with any of its actuators.
    fn rests(&self, joint: &Joint, law_hz: f64, stop_hz: f64, rate_hz: u32) -> bool {
        let rate_hz = f64::from(rate_hz);
        let mut moving =
            (self.actuators.iter()).filter(|actuator| self.arm(actuator, joint) != 0.0);
        moving.all(|actuator| {
            let mut powers = tick(joint, (law_hz, stop_hz), actuator, rate_hz);
            let mut ticks = 1.0;
            while ticks < REST_S * rate_hz {
                powers *= powers;
                ticks *= 2.0;
            }
            // NaN is not rest.
            powers.iter().all(|entry| (-LEFT..=LEFT).contains(entry))
        })
    }
}

/// The last number on the way from `good`, where it `holds`, to `bad`, where it does not.
fn boundary(mut good: f64, mut bad: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..20 {
        let middle = f64::midpoint(good, bad);
        if holds(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    good
}

/// The matrix by which one tick multiplies the state of a joint in the zone of a stop. The joint's inertia
/// is 1, since servo and stop ask for accelerations.
///
/// The state is its position and rate, the torque of its actuator, and the last position and rate that the
/// servo's filters gave. The actuator follows with a lag of first order; its command stays for a tick.
fn tick<const J: usize>(
    joint: &Joint,
    (law_hz, stop_hz): (f64, f64),
    actuator: &Actuator<J>,
    rate_hz: f64,
) -> SMatrix<f64, 5, 5> {
    let tau = core::f64::consts::TAU;
    let lag = |cutoff_hz: f64| 1.0 - exp(-tau * cutoff_hz / rate_hz);
    let (servo, stop) = (&joint.servo, &joint.stop);
    let (law, spring) = (tau * law_hz, tau * stop_hz);
    let stiffness = law * law + spring * spring;
    let damping = 2.0 * (servo.zeta * law + stop.damping_ratio * spring);

    // The command of the servo, from the state before the tick.
    let pass = servo.position_cutoff_hz.map_or(1.0, lag);
    let smooth = lag(servo.velocity_cutoff_hz);
    let position = [pass, 0.0, 0.0, 1.0 - pass, 0.0];
    let rate = [
        smooth * rate_hz * pass,
        0.0,
        0.0,
        -smooth * rate_hz * pass,
        1.0 - smooth,
    ];
    let kp = actuator.adc.map_or(0.0, |_| actuator.gains.kp);
    let mut command = [0.0, 0.0, -kp, 0.0, 0.0];
    for (command, (position, rate)) in command.iter_mut().zip(position.iter().zip(&rate)) {
        *command -= (1.0 + kp) * (stiffness * position + damping * rate);
    }

    // The state after the tick, from the state before it and from that command.
    let period = 1.0 / rate_hz;
    let pole = tau * actuator.pole_hz;
    let decay = exp(-pole * period);
    let once = (1.0 - decay) / pole;
    let twice = (period - once) / pole;
    let moves = [
        ([1.0, period, twice], 0.5 * period * period - twice),
        ([0.0, 1.0, once], period - once),
        ([0.0, 0.0, decay], 1.0 - decay),
    ];
    let rows = moves.map(|(own, by_command)| {
        core::array::from_fn::<_, 5, _>(|m| {
            let own = own.get(m).copied().unwrap_or(0.0);
            let command = command.get(m).copied().unwrap_or(0.0);
            own + by_command * command
        })
    });
    let [first, second, third] = rows;
    let [first, second, third, fourth, fifth] =
        [first, second, third, position, rate].map(SVector::from);
    SMatrix::<f64, 5, 5>::from_columns(&[first, second, third, fourth, fifth]).transpose()
}
