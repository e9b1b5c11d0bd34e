//! [`Support`]: a hand that holds the ball while the fingers take it.

use condor_hand::grasp::Wrench;
use condor_hand::math::{max, min};
use condor_hand::plant::SimObject;
use nalgebra::Vector3;

/// The stiffness and damping of the support of the ball: N/m, N s/m, N m s/rad.
const STIFFNESS: f64 = 500.0;
const DAMPING: f64 = 10.0;
const TURNING: f64 = 1e-3;

/// A support that holds the ball where it was put, against gravity, and lets go of it slowly.
#[derive(Clone, Copy, Debug)]
pub(super) struct Support {
    at: Vector3<f64>,
    /// From 1, firmly, to 0.
    share: f64,
    /// The decrease of the share in each second.
    fading: f64,
}

impl Support {
    pub(super) const fn new(at: Vector3<f64>) -> Self {
        Self {
            at,
            share: 1.0,
            fading: 0.0,
        }
    }

    /// Lets go within so many seconds; at once if there are none.
    pub(super) fn let_go(&mut self, within_s: f64) {
        if within_s > 0.0 {
            self.fading = max(self.share / within_s, self.fading);
        } else {
            self.share = 0.0;
        }
    }

    /// Returns the wrench of the support on the ball about its centre in the next `period_s`.
    pub(super) fn update(
        &mut self,
        ball: &SimObject,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> Wrench {
        let mass = ball.parameters().mass;
        let from = ball.pose().position - self.at;
        let force = -from * STIFFNESS - ball.velocity() * DAMPING - gravity * mass;
        let moment = -ball.angular_velocity() * TURNING;
        let wrench = Wrench {
            force: force * self.share,
            moment: moment * self.share,
        };
        self.share = min(max(self.share - self.fading * period_s, 0.0), 1.0);
        wrench
    }
}
