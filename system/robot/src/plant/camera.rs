//! [`Camera`]: what a camera over the palm measures of the ball.

use condor_hand::plant::{Noise, SimObject as Body};
use condor_vars::cell_struct;
use nalgebra::{Quaternion, Vector3};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::arguments::Arguments;

/// An object as the camera of the simulated robot has measured it, in the axes of the palm. It is published for each
/// picture in which an object is seen.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct CameraObject {
    /// When the picture was taken, s since the robot began.
    pub time_s: f64,
    /// The middle of the object, m.
    pub position: [f64; 3],
    /// The orientation of the object, a unit quaternion, the real part first.
    pub orientation: [f64; 4],
    /// The radius of the ball that it is, m.
    pub radius_m: f64,
}

cell_struct!(CameraObject {
    "time_s": time_s, "s", "Time of the picture.";
    "position": position, "m", "Centre of the ball.";
    "orientation": orientation, "", "Of the ball: a unit quaternion, the real part first.";
    "radius_m": radius_m, "m";
});

/// A camera, whose pictures have noise that follows from a seed.
pub(super) struct Camera {
    /// Ticks of the robot from one picture to the next.
    period: u32,
    left: u32,
    /// The deviation of a measured point, m.
    deviation_m: f64,
    noise: Noise,
}

impl Camera {
    pub(super) fn new(arguments: &Arguments) -> Self {
        Self {
            period: (arguments.rate_hz / arguments.camera_hz).max(1),
            left: 0,
            deviation_m: f64::from(arguments.camera_um) * 1e-6,
            noise: Noise::new(arguments.seed.into()),
        }
    }

    /// One tick of the robot; returns what is seen, if a picture is taken and the ball is there.
    pub(super) fn look(&mut self, ball: Option<&Body>, time_s: f64) -> Option<CameraObject> {
        if self.left > 0 {
            self.left -= 1;
            return None;
        }
        self.left = self.period - 1;
        let ball = ball?;
        let radius_m = ball.parameters().radius;
        let moved = self.noise() * self.deviation_m;
        // The points of its surface move as much.
        let half = self.noise() * (self.deviation_m / radius_m * 0.5);
        let turned = Quaternion::new(1.0, half.x, half.y, half.z) * ball.orientation();
        let length = condor_hand::math::sqrt(turned.norm_squared());
        let q = turned / length;
        Some(CameraObject {
            time_s,
            position: (ball.pose().position + moved).into(),
            orientation: [q.w, q.i, q.j, q.k],
            radius_m,
        })
    }

    /// Three numbers of deviation one.
    fn noise(&mut self) -> Vector3<f64> {
        let noise = &mut self.noise;
        Vector3::new(noise.normal(), noise.normal(), noise.normal())
    }
}

#[cfg(test)]
mod tests {
    use condor_hand::plant::ObjectParameters;

    use super::*;

    #[test]
    fn pictures_have_a_rate_and_noise_that_follows_from_the_seed() {
        let parameters = ObjectParameters::ball(0.05, 0.02);
        let ball = Body::new(parameters, Vector3::new(0.1, 0.0, -0.1)).unwrap();
        let pictures = |camera_um, seed| {
            let arguments = Arguments {
                rate_hz: 100,
                camera_hz: 25,
                camera_um,
                seed,
                ..Arguments::default()
            };
            let mut camera = Camera::new(&arguments);
            let look = |tick: u32| camera.look(Some(&ball), f64::from(tick));
            (0..4000).map(look).collect::<std::vec::Vec<_>>()
        };
        let exact = pictures(0, 1);
        assert_eq!(exact.iter().flatten().count(), 1000);
        assert!(exact[0].is_some() && exact[1].is_none() && exact[4].is_some());
        let position = exact[4].unwrap().position.map(f64::to_bits);
        assert_eq!(position, [0.1, 0.0, -0.1].map(f64::to_bits));
        let noisy = pictures(100, 1);
        assert_eq!(noisy, pictures(100, 1));
        assert_ne!(noisy, pictures(100, 2));
        let squares = noisy
            .iter()
            .flatten()
            .map(|it| it.position[1] * it.position[1]);
        let deviation = (squares.sum::<f64>() / 1000.0).sqrt();
        assert!((deviation - 1e-4).abs() < 1e-5, "{deviation}");
        let turns = noisy
            .iter()
            .flatten()
            .map(|it| 4.0 * it.orientation[2].powi(2));
        let deviation = (turns.sum::<f64>() / 1000.0).sqrt();
        assert!((deviation - 5e-3).abs() < 5e-4, "{deviation}");
        assert_eq!(Camera::new(&Arguments::default()).look(None, 0.0), None);
    }
}
