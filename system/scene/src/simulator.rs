//! A hand that moves without any processor.

use condor_hand::Pose;
use condor_hand::kinematics::{JointLimits, Side};
use condor_hand::math::clamp;
use condor_host::error::AnyError;
use condor_host::robot::{Clearance, DragResult, LimitedJoint, LimitedPosture, Plan, Simulator};
use nalgebra::{SVector, Vector3};
use serde_json::Value as Json;

use crate::HandView;
use crate::capsule::{Capsule, RADIUS_M};
use crate::finger::Link;
use crate::hand::{PALM, finite};
use crate::plan;

/// The distance within which a frame is at its point, m.
const REACHED_M: f64 = 1e-6;
/// The farthest coordinate of a point, m.
const FAR_M: f64 = 1e3;

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize> Simulator
    for HandView<FINGERS, JOINTS, ACTUATORS>
{
    fn moved(&self, positions: &[f64]) -> LimitedPosture {
        let mut moved = LimitedPosture {
            positions: Vec::new(),
            held: Vec::new(),
        };
        for (joint, asked) in self.joints.iter().zip(finite(positions)) {
            let [low, high] = joint.limits;
            let limit = clamp(asked, low, high);
            moved.positions.push(limit);
            if asked < low || asked > high {
                let joint = joint.name.clone();
                moved.held.push(LimitedJoint { joint, limit });
            }
        }
        moved
    }

    fn dragged(
        &self,
        positions: &[f64],
        frame: &str,
        to: [f64; 3],
    ) -> Result<DragResult, AnyError> {
        if let Some(far) = to.iter().find(|it| !(-FAR_M..=FAR_M).contains(*it)) {
            return Err(format!("a coordinate is {far} m; up to {FAR_M} m are possible").into());
        }
        let mut positions = self.moved(positions).positions;
        let (finger, place) = self.carrier(frame)?;
        let before = self.fingers.iter().take(finger);
        let first = before.map(|finger| finger.joints().count()).sum::<usize>();
        let (Some(entry), Some(links)) = (self.hand.fingers.get(finger), self.fingers.get(finger))
        else {
            return Err(no_frame(frame));
        };
        let joints: Vec<&Link> = links.joints().collect();
        let own = positions.get(first..first + joints.len());
        let own = own.unwrap_or(&[]).to_vec();
        let present =
            SVector::<f64, JOINTS>::from_fn(|row, _| own.get(row).copied().unwrap_or(0.0));
        // Places without a joint have any limits that are possible.
        let range = |row: usize| joints.get(row).map(|link| link.limits);
        let low = SVector::from_fn(|row, _| range(row).map_or(-1.0, |it| it.low));
        let high = SVector::from_fn(|row, _| range(row).map_or(1.0, |it| it.high));
        let limits = JointLimits::new(low, high)?;
        let to = Vector3::from(to);
        let chain = match place {
            Some(place) => entry.chain().up_to(place),
            None => entry.chain(),
        };
        let nearest = chain.nearest(&to, &present, &limits)?;
        let found = nearest.posture.iter().take(own.len());
        for (position, found) in positions.iter_mut().skip(first).zip(found) {
            *position = *found;
        }
        let is_reached = nearest.distance <= REACHED_M;
        let held = joints.iter().zip(nearest.held);
        let held = held.filter_map(|(link, side)| {
            let limit = match side.filter(|_| !is_reached)? {
                Side::Low => link.limits.low,
                Side::High => link.limits.high,
            };
            let joint = link.name.clone();
            Some(LimitedJoint { joint, limit })
        });
        Ok(DragResult {
            positions,
            is_reached,
            distance_m: nearest.distance,
            held: held.collect(),
        })
    }

    fn clearances(&self, positions: &[f64]) -> Vec<Clearance> {
        let fingers: Vec<Vec<Part<'_>>> = self.parts(positions);
        let mut clearances = Vec::new();
        for (place, first) in fingers.iter().enumerate() {
            for second in fingers.iter().skip(place + 1) {
                clearances.extend(least(first, second));
            }
        }
        for ([one, other], palm) in self.knuckles() {
            for (place, finger) in fingers.iter().enumerate() {
                if place != one && place != other {
                    clearances.extend(least(&[palm], finger));
                }
            }
        }
        clearances
    }

    fn plan(&self, from: &[f64], motion: &str, file: &str) -> Result<Plan, AnyError> {
        plan::plan(self, from, motion, file)
    }

    fn steps(&self, motion: &str, file: &str) -> Result<Json, AnyError> {
        plan::motions(self, motion, file)?;
        Ok(toml::from_str(motion)?)
    }

    fn text(&self, steps: &Json) -> Result<String, AnyError> {
        let text = toml::to_string(steps)?;
        plan::motions(self, &text, "motion")?;
        Ok(text)
    }
}

/// A link, or a part of the palm, and its name.
type Part<'v> = (&'v str, Capsule);

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>
    HandView<FINGERS, JOINTS, ACTUATORS>
{
    /// Returns the finger that carries a frame, and the link; no link for the frame of a tip.
    fn carrier(&self, frame: &str) -> Result<(usize, Option<usize>), AnyError> {
        for (finger, entry) in self.fingers.iter().enumerate() {
            if entry.tip_name() == frame {
                return Ok((finger, None));
            }
            let mut links = entry.links.iter();
            if let Some(place) = links.position(|link| link.frame_name() == frame) {
                return Ok((finger, Some(place)));
            }
        }
        Err(no_frame(frame))
    }

    /// Returns the shapes of the links of each finger, in the palm.
    fn parts(&self, positions: &[f64]) -> Vec<Vec<Part<'_>>> {
        let fingers = self.posed(positions);
        let parts = fingers.map(|(finger, poses)| {
            let links = finger.links.iter().zip(&poses).enumerate();
            let parts = links.filter_map(|(place, (link, pose))| {
                let mut capsule = Capsule::of(finger, place, link)?;
                capsule.ends = capsule.ends.map(|end| pose.transform(&end));
                Some((link.name.as_str(), capsule))
            });
            parts.collect()
        });
        parts.collect()
    }

    /// Returns the palm between each two fingers that are next to each other and bend to the same side, with
    /// the numbers of these fingers.
    fn knuckles(&self) -> impl Iterator<Item = ([usize; 2], Part<'static>)> {
        let back = |base: &Pose| base.rotation * Vector3::z();
        let pairs = self.fingers.iter().zip(self.fingers.iter().skip(1));
        pairs.enumerate().filter_map(move |(place, (one, other))| {
            let ends = [one.base.position, other.base.position];
            let palm = Capsule {
                ends,
                radius: RADIUS_M,
            };
            let is_beside = back(&one.base).dot(&back(&other.base)) > 0.0;
            is_beside.then_some(([place, place + 1], (PALM, palm)))
        })
    }
}

/// Returns how near the nearest two parts are to each other.
fn least(first: &[Part<'_>], second: &[Part<'_>]) -> Option<Clearance> {
    let pairs = first
        .iter()
        .flat_map(|here| second.iter().map(move |there| (here, there)));
    let clearances = pairs.map(|((here, first), (there, second))| {
        let (points, distance) = first.clearance(second);
        ([*here, *there], points, distance)
    });
    let least = clearances.min_by(|one, other| one.2.total_cmp(&other.2));
    least.map(|(parts, points, distance_m)| Clearance {
        parts: parts.map(str::to_owned),
        points: points.map(Into::into),
        distance_m,
    })
}

fn no_frame(frame: &str) -> AnyError {
    format!("there is no frame {frame:?}; a frame is called JOINT_link, or FINGER.tip").into()
}
