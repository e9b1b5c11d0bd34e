//! The law of a grasp whose fingers several processors serve.
//!
//! The stiffness of a held object depends on all of its fingers. Each processor computes the law in
//! its servo loop, for each finger that it serves: from the joints of this finger as measured in
//! this tick, and from those of all others as they were in the tick before, even of fingers on the
//! same processor. It uses the torques of this finger only. So no torque waits for a message, the
//! rate of the law is that of the servos, and the result is the same whichever processor serves
//! which finger.
//!
//! A master publishes one [`GraspOrder`] to all processors. It names the fingers, the places of their tips and
//! the stiffness; [`GraspSettings`] make it for a ball that was measured. A finger takes its present tip as the
//! desired one, so nothing jumps. In the time `ramp_s` it passes to the ordered tips, squeeze and feed-forward;
//! a later order for the same fingers ramps from the values in force. After a release the joints hold their
//! positions.
//!
//! A finger leaves a grasp, and its joints hold their positions, if another finger leaves it or is
//! silent, if it has a fault, if one of its joints is given another mode, or if the law has no
//! answer. The [`GraspReport`] of its processor contains the reason.
//!
//! A [`DistributedGrasp`] does not depend on how processors exchange joints, orders and reports.
//! The programs of condor-robot pass them in shared memory.

mod law;
mod order;
mod report;
mod settings;

pub use law::{DistributedGrasp, FingerControllers, GraspInputs, GraspedFinger};
pub use order::GraspOrder;
pub use report::{GraspReason, GraspReport, GraspState};
pub use settings::{GraspAxes, GraspSettings, MeasuredBall};

/// The least number of fingers that a grasp needs. Fewer than three fingertips cannot resist all
/// rotations of an object.
pub const LEAST_FINGERS: u32 = 3;
/// The greatest number of fingers of a hand with which a [`DistributedGrasp`] works.
pub const MOST_FINGERS: usize = 5;

/// The joint positions and rates of the fingers of a hand, which the processors that serve the
/// fingers exchange in every tick of a grasp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandJoints<const F: usize, const N: usize> {
    /// The measured positions of the joints of each finger, rad; NaN if a sensor was not read.
    pub position: [[f64; N]; F],
    /// The filtered rates of the joints in the tick before, rad/s.
    pub velocity: [[f64; N]; F],
    /// The number of the order in force for each finger; 0 if there is none.
    pub order: [u64; F],
    /// The fingers whose joints are in this value: bit *i* stands for finger *i*. The entries of
    /// other fingers have no meaning.
    /// no meaning.
    pub served: u64,
}

impl<const F: usize, const N: usize> HandJoints<F, N> {
    /// A value that contains the joints of no finger, to which [`add`](Self::add) can add some.
    pub const NONE: Self = Self {
        position: [[0.0; N]; F],
        velocity: [[0.0; N]; F],
        order: [0; F],
        served: 0,
    };

    /// Copies the fingers that `other` contains into this value, for example those of another
    /// processor.
    pub fn add(&mut self, other: &Self) {
        let all = self.position.iter_mut().zip(&mut self.velocity);
        let all = all.zip(&mut self.order);
        let others = other.position.iter().zip(&other.velocity);
        let others = others.zip(&other.order);
        for (finger, (((position, velocity), order), from)) in all.zip(others).enumerate() {
            if other.serves(finger) {
                ((*position, *velocity), *order) = ((*from.0.0, *from.0.1), *from.1);
            }
        }
        self.served |= other.served;
    }

    /// Returns true if this value contains the joints of finger number `finger`, from 0.
    #[must_use]
    pub const fn serves(&self, finger: usize) -> bool {
        finger < F && self.served >> finger & 1 != 0
    }
}
