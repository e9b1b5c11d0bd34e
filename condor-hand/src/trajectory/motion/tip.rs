//! Steps that take the tip of a finger along a line or an arc.

use core::fmt::Display;
use core::ops::Range;
use std::format;
use std::string::String;
use std::vec::Vec;

use nalgebra::{SVector, Vector3};
use serde::Deserialize;

use crate::decimal::Decimal;
use crate::kinematics::{Chain, JointLimits, Kinematics as _, PoseSearch};
use crate::math::clamp;
use crate::number::{NumberError, Requirement};
use crate::rotation::Rotation;
use crate::trajectory::{
    Begin, CartesianPath, JointPath, JointPathError, Pace, PathDeviation, Primitive, ProfileLimits,
    Target,
};
use crate::{Pose, Subject};

/// The distance by which a tip may leave its path, m, if the text does not say another one.
const DEVIATION: f64 = 1e-3;
/// The angle by which a tip may be turned away from the orientation that it keeps, rad.
const TURN: f64 = 1e-2;
/// The joints that a finger needs to keep its orientation wherever its tip goes.
const WHOLE: usize = 6;

/// A finger whose tip a text may take along lines and arcs.
pub(crate) struct MotionFinger<const N: usize> {
    pub(crate) name: String,
    /// The numbers of its joints, which are the first ones of the chain.
    pub(crate) joints: Range<usize>,
    pub(crate) chain: Chain<N>,
    /// The limits of each joint, with the range in which it can rest. Places without a joint have any limits.
    pub(crate) limits: [ProfileLimits; N],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Line {
    finger: String,
    to: Option<[f64; 3]>,
    by: Option<[f64; 3]>,
    rotation: Option<Rotation>,
    orientation: Option<Orientation>,
    deviation: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Arc {
    finger: String,
    through: [f64; 3],
    to: [f64; 3],
    rotation: Option<Rotation>,
    orientation: Option<Orientation>,
    deviation: Option<f64>,
}

/// The choice whether a tip keeps its orientation on its way.
#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Orientation {
    Keep,
    Free,
}

/// The way of a tip as a text says it.
pub(super) struct TipPath<'t> {
    finger: &'t str,
    through: Option<[f64; 3]>,
    end: End,
    rotation: Option<Rotation>,
    orientation: Option<Orientation>,
    deviation: Option<f64>,
}

#[derive(Clone, Copy)]
enum End {
    To([f64; 3]),
    By([f64; 3]),
}

impl Line {
    pub(super) fn path(&self) -> Result<TipPath<'_>, &'static str> {
        let end = match (self.to, self.by) {
            (Some(to), None) => End::To(to),
            (None, Some(by)) => End::By(by),
            (None, None) => return Err("no end: give `to` or `by`, in m"),
            (Some(_), Some(_)) => return Err("two ends: give either `to` or `by`"),
        };
        Ok(TipPath {
            finger: &self.finger,
            through: None,
            end,
            rotation: self.rotation,
            orientation: self.orientation,
            deviation: self.deviation,
        })
    }
}

impl Arc {
    pub(super) fn path(&self) -> TipPath<'_> {
        TipPath {
            finger: &self.finger,
            through: Some(self.through),
            end: End::To(self.to),
            rotation: self.rotation,
            orientation: self.orientation,
            deviation: self.deviation,
        }
    }
}

impl TipPath<'_> {
    /// Makes the motion of the joints, from the positions that the steps before have told.
    pub(super) fn primitive<const N: usize, const J: usize>(
        &self,
        pace: Pace,
        fingers: &[MotionFinger<N>],
        names: &[impl AsRef<str>],
        told: &Told<J>,
    ) -> Result<Primitive<J>, String> {
        let finger = self.finger(fingers)?;
        let own = names.get(finger.joints.clone()).unwrap_or(&[]);
        let start = told.posture(finger, own)?;
        let wrong = |problem: &dyn Display| format!("{}: {problem}", finger.name);
        let path = self.path(&finger.chain.tip(&start))?;
        let mut search = PoseSearch::new(finger.range().map_err(|error| wrong(&error))?);
        let keeps_orientation = self.keeps_orientation(finger)?;
        if !keeps_orientation {
            search.rotation = core::f64::consts::PI;
        }
        let allowed = PathDeviation {
            position: self.deviation.unwrap_or(DEVIATION),
            rotation: TURN,
        };
        let joints = JointPath::along(&path, &finger.chain, &search, &start, &allowed);
        let joints = joints.map_err(|error| {
            let remedy = match error {
                JointPathError::Number(_) => "",
                JointPathError::Deviation { .. } => " by `deviation`",
                _ if keeps_orientation && finger.joints.len() < WHOLE => {
                    "; or let it turn by `orientation = \"free\"`, since it needs six joints to keep its orientation \
                     everywhere"
                }
                _ => "",
            };
            format!("{}{remedy}", wrong(&error.named(own)))
        })?;
        if let Pace::Duration(duration) = pace {
            let least = joints.least_duration(&finger.limits);
            let least = least.map_err(|error| wrong(&error))?;
            if duration > 0.0 && duration < least {
                return Err(wrong(&format!(
                    "its joints need {:.3} s for the path at their limits of velocity and acceleration; give a longer \
                     `duration`, or a `speed`",
                    Decimal(least)
                )));
            }
        }
        let primitive = joints.primitive(finger.joints.clone(), pace);
        primitive.map_err(|error| wrong(&error.named(names)))
    }

    fn finger<'f, const N: usize>(
        &self,
        fingers: &'f [MotionFinger<N>],
    ) -> Result<&'f MotionFinger<N>, String> {
        if fingers.is_empty() {
            return Err("no finger is known here, only joints: give `to` or `by`".into());
        }
        let named = fingers.iter().find(|finger| finger.name == self.finger);
        named.ok_or_else(|| {
            let all: Vec<_> = fingers.iter().map(|finger| finger.name.as_str()).collect();
            let problem = format!("no finger is called `{}`; ", self.finger);
            problem + &condor_toml::suggest(self.finger, &all)
        })
    }

    fn keeps_orientation<const N: usize>(&self, finger: &MotionFinger<N>) -> Result<bool, String> {
        match (self.orientation, self.rotation) {
            (Some(Orientation::Free), Some(_)) => {
                Err("a free orientation has no `rotation`: give one of them".into())
            }
            (Some(orientation), _) => Ok(orientation == Orientation::Keep),
            (None, rotation) => Ok(rotation.is_some() || finger.joints.len() >= WHOLE),
        }
    }

    /// The path from a pose of the tip.
    fn path(&self, start: &Pose) -> Result<CartesianPath, String> {
        let end = Pose {
            position: match self.end {
                End::To(to) => Vector3::from(to),
                End::By(by) => start.position + Vector3::from(by),
            },
            rotation: self
                .rotation
                .map_or(start.rotation, |rotation| rotation.matrix()),
        };
        let wrong = |error: NumberError| format!("{}: {error}", self.finger);
        let Some(through) = self.through else {
            return CartesianPath::line(start, &end).map_err(wrong);
        };
        CartesianPath::arc(start, &Vector3::from(through), &end).map_err(|error| match error {
            // The points form no triangle.
            NumberError {
                must: Requirement::Above(_),
                at: Subject::Whole,
                ..
            } => format!(
                "{}: the tip's place before, `through` and `to` are on a line, or two of them are the same: move \
                 `through` aside, or give a `line`",
                self.finger
            ),
            error => wrong(error),
        })
    }
}

impl<const N: usize> MotionFinger<N> {
    fn range(&self) -> Result<JointLimits<N>, NumberError> {
        let low = SVector::from(self.limits.map(|it| it.low));
        JointLimits::new(low, SVector::from(self.limits.map(|it| it.high)))
    }
}

/// The positions of J joints, as far as the steps before have told them.
pub(super) struct Told<const J: usize>([Position; J]);

/// The position of a joint at the end of some steps, rad or m.
#[derive(Clone, Copy)]
enum Position {
    /// No step names the joint.
    Untold,
    At(f64),
    /// The step of this number, from 1, may end before its targets, or begins while the joint moves.
    Open(usize),
}

impl<const J: usize> Told<J> {
    pub(super) fn nothing() -> Self {
        Self([Position::Untold; J])
    }

    /// Takes what step number `step`, from 1, tells.
    pub(super) fn take<const N: usize>(
        &mut self,
        step: usize,
        primitive: &Primitive<J>,
        fingers: &[MotionFinger<N>],
    ) {
        let is_early = primitive.begin == Begin::Now || primitive.blend > 0.0;
        for (joint, target) in primitive.joints() {
            let Some(place) = self.0.get_mut(joint) else {
                continue;
            };
            *place = match (target, *place) {
                _ if !primitive.stop.is_none() => Position::Open(step),
                (Target::Absolute(position), _) => Position::At(rest(joint, position, fingers)),
                (Target::Relative(_), Position::At(_)) if is_early => Position::Open(step),
                (Target::Relative(by), Position::At(before)) => Position::At(before + by),
                (Target::Relative(_), open) => open,
            };
        }
    }

    /// The posture of a finger whose joints have these names.
    fn posture<const N: usize>(
        &self,
        finger: &MotionFinger<N>,
        names: &[impl AsRef<str>],
    ) -> Result<SVector<f64, N>, String> {
        let mut posture = SVector::<f64, N>::zeros();
        let own = finger.joints.clone().zip(names);
        for ((joint, name), place) in own.zip(posture.iter_mut()) {
            let name = name.as_ref();
            *place = match self.0.get(joint) {
                Some(Position::At(position)) => *position,
                Some(Position::Open(step)) => {
                    return Err(format!(
                        "the path begins wherever step {step} leaves \"{name}\", which is not known before: name the \
                         joint in `to` of a step between"
                    ));
                }
                Some(Position::Untold) | None => {
                    return Err(format!(
                        "the path begins at the posture of {}, but no step before says where \"{name}\" is: name it in \
                         `to` of one",
                        finger.name
                    ));
                }
            };
        }
        Ok(posture)
    }
}

/// The place where a joint rests that is sent to a position: a master keeps it out of the zones of soft stops.
fn rest<const N: usize>(joint: usize, position: f64, fingers: &[MotionFinger<N>]) -> f64 {
    let mut of = fingers.iter();
    let limits = of.find_map(|finger| {
        let place = joint.checked_sub(finger.joints.start)?;
        finger
            .limits
            .get(place)
            .filter(|_| finger.joints.contains(&joint))
    });
    limits.map_or(position, |limits| clamp(position, limits.low, limits.high))
}
