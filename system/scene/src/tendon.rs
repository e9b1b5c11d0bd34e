//! The way of a tendon past the joints that it crosses.

use condor_hand::Pose;
use condor_hand::kinematics::ChainMotion;
use nalgebra::Vector3;

use crate::finger::{Finger, Tendon};

/// The length of a tendon that is seen before the base of its finger, m.
const BEFORE: f64 = 0.03;
/// The square of the cosine of half the largest angle of a joint around which a tendon is drawn.
const SHARPEST: f64 = 0.2;
/// The end of a tendon, as a part of its link.
const END: f64 = 0.5;

/// Returns the points of a tendon in the palm, when the links of its finger have these poses.
pub(crate) fn points(tendon: &Tendon, finger: &Finger, poses: &[Pose]) -> Vec<[f64; 3]> {
    let mut points = Vec::new();
    let joints = tendon.arms.iter().zip(&finger.links).zip(poses).enumerate();
    for (place, ((arm, link), pose)) in joints {
        let along = finger.along(place);
        if *arm != 0.0 {
            let aside = *arm * aside(link.motion, &along);
            let rest = finger.carrier(link, poses).then(&link.placement);
            if points.is_empty() {
                let straight = finger.base.rotation * finger.along(0);
                let back = straight.try_normalize(0.0).unwrap_or_default() * BEFORE;
                points.push(finger.base.position - back + rest.rotation * aside);
            }
            points.push(pose.position + corner(&(rest.rotation * aside), &(pose.rotation * aside)));
        }
        if place + 1 == tendon.arms.len() {
            points.push(pose.transform(&(along * END)));
        }
    }
    points.into_iter().map(Into::into).collect()
}

/// Returns where the parts of a tendon before and behind a joint meet, from the joint: they are at right
/// angles to `before` and `behind`, the same arm on both links.
fn corner(before: &Vector3<f64>, behind: &Vector3<f64>) -> Vector3<f64> {
    let middle = (before + behind) / 2.0;
    // The square of the cosine of half the angle; a joint that is bent back onto itself has no corner.
    let cosine = middle.norm_squared() / before.norm_squared();
    middle / cosine.max(SHARPEST)
}

/// Returns the direction from a joint in which a tendon lies whose pull along the link, back to the base, turns the
/// link to positive angles.
fn aside(motion: ChainMotion, along: &Vector3<f64>) -> Vector3<f64> {
    match motion {
        ChainMotion::Revolute(axis) => axis.cross(along).try_normalize(0.0).unwrap_or_default(),
        ChainMotion::Prismatic(_) | ChainMotion::Fixed => Vector3::zeros(),
    }
}
