//! Motions as TOML text, which people write.
//!
//! ```toml
//! [[motion]]
//! profile = "minimum-jerk"   # cubic, minimum-jerk, trapezoid, jerk-limited
//! duration = 0.4             # s; or: speed = 0.5, a fraction of the limits
//! begin = "after"            # after, beside, now
//! blend = 0.1                # s
//! on-end = "next"            # next, hold
//! start = { contact = true } # torque (N m), effort (N), time (s), contact
//! stop = { torque = 0.2 }
//!
//! [motion.to]                # positions, rad
//! "index.1" = 0.5
//!
//! [motion.by]                # displacements, rad
//! "index.2" = -0.1
//!
//! [[motion.via]]
//! at = 0.5                   # fraction of the duration
//! joints = { "index.1" = 0.7, "index.2" = 0.0 }
//! ```
//!
//! A profile, a pace and a joint are required; everything else has a default. The caller passes the names of
//! the joints, in the order of their numbers.
//!
//! In place of `to`, `by` and `via`, a step of a hand ([`Hand::motions`](crate::config::Hand::motions)) may take the
//! tip of a finger along a straight line or the arc of a circle:
//!
//! ```toml
//! [[motion]]
//! speed = 0.5
//! line = { finger = "index", to = [0.02, 0.0, 0.11] }       # m, in the palm; or: by = [0.0, 0.0, -0.01]
//!
//! [[motion]]
//! duration = 2.0
//! arc = { finger = "index", through = [0.03, 0.01, 0.11], to = [0.02, 0.02, 0.11] }
//! ```
//!
//! | key of a line or an arc | meaning |
//! |---|---|
//! | `finger` | the finger whose tip moves |
//! | `to`, or `by` of a line | where the tip goes, or the way that it goes, m in the axes of the palm |
//! | `through` of an arc | a point of the arc between its ends, m |
//! | `orientation` | `"keep"` or `"free"`; without it, a tip keeps its orientation if its finger has six joints or more, and only its position counts otherwise |
//! | `rotation` | the orientation at the end, as a description writes a [`Rotation`](crate::config::Rotation); the tip turns evenly on the way |
//! | `deviation` | the greatest distance of the tip from the path, m; 0.001 without it. An orientation that is kept is off by 0.01 rad at most |
//!
//! The path begins where the steps before leave the joints of the finger, so they must have named each of them. The step
//! becomes a motion of joints, of the profile `cubic` with 16 via points, when the text is read. It begins and ends at
//! rest, so it has neither a `blend` nor `begin = "now"`.

mod tip;

use core::ops::Range;
use std::collections::BTreeMap;
use std::string::String;
use std::vec::Vec;

use condor_toml::{Misreading, SourceText, Spanned, TextError};
use serde::Deserialize;

use super::{Begin, Guards, MAX_VIAS, MotionError, OnEnd, Pace, Primitive, Profile, Target, Via};
use crate::Subject;
pub(crate) use tip::MotionFinger;
use tip::{Arc, Line, TipPath, Told};

/// Reads a sequence of motions from TOML text. `names[i]` is the name by which the text refers to
/// joint *i*. Lines and arcs need a hand, whose [`motions`](crate::config::Hand::motions) reads them, too.
///
/// `file` is the name to show in error messages; no file is opened. The limits of joints are not
/// checked here, but when a motion is enqueued.
///
/// # Errors
/// [`TextError`] for the first mistake, with its place and the remedy.
pub fn load<const J: usize>(
    text: &str,
    file: &str,
    names: &[impl AsRef<str>],
) -> Result<Vec<Primitive<J>>, TextError> {
    load_with::<J, 1>(text, file, names, &[])
}

/// Reads a sequence of motions as [`load`] does, and those that take the tips of `fingers` along lines and arcs.
pub(crate) fn load_with<const J: usize, const N: usize>(
    text: &str,
    file: &str,
    names: &[impl AsRef<str>],
    fingers: &[MotionFinger<N>],
) -> Result<Vec<Primitive<J>>, TextError> {
    let text = SourceText::new(file, text);
    let file: File = text.read()?;
    let mut told = Told::nothing();
    let motions = file.motion.iter().zip(1..).map(|(entry, step)| {
        let primitive = primitive(entry, names, fingers, &told)?;
        told.take(step, &primitive, fingers);
        Ok(primitive)
    });
    let motions: Result<_, Misreading> = motions.collect();
    motions.map_err(|fault| text.error(fault))
}

type Positions = BTreeMap<Spanned<String>, f64>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    motion: Vec<Spanned<Entry>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Entry {
    profile: Option<Profile>,
    duration: Option<f64>,
    speed: Option<f64>,
    #[serde(default)]
    begin: Begin,
    #[serde(default)]
    blend: f64,
    #[serde(default)]
    on_end: OnEnd,
    #[serde(default = "Guards::none")]
    start: Guards,
    #[serde(default = "Guards::none")]
    stop: Guards,
    #[serde(default)]
    to: Positions,
    #[serde(default)]
    by: Positions,
    #[serde(default)]
    via: Vec<Spanned<Point>>,
    line: Option<Spanned<Line>>,
    arc: Option<Spanned<Arc>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Point {
    at: f64,
    joints: Positions,
}

fn primitive<const J: usize, const N: usize>(
    spanned: &Spanned<Entry>,
    names: &[impl AsRef<str>],
    fingers: &[MotionFinger<N>],
    told: &Told<J>,
) -> Result<Primitive<J>, Misreading> {
    let entry = spanned.get_ref();
    let wrong = |problem| Misreading::at(&spanned.span(), problem);
    let pace = match (entry.duration, entry.speed) {
        (Some(duration), None) => Pace::Duration(duration),
        (None, Some(speed)) => Pace::Speed(speed),
        (None, None) => {
            let problem = "no pace: give `duration = ` in s or `speed = ` as a fraction";
            return Err(wrong(problem));
        }
        (Some(_), Some(_)) => {
            return Err(wrong("two paces: give either `duration` or `speed`"));
        }
    };
    let path = entry.path(&spanned.span())?;
    let mut primitive = match (entry.profile, &path) {
        (Some(profile), None) => Primitive::new(pace, profile),
        (None, None) => {
            return Err(wrong(
                "no profile: give `profile = `, such as \"minimum-jerk\"",
            ));
        }
        (_, Some((span, path))) => {
            let primitive = path.primitive(pace, fingers, names, told);
            primitive.map_err(|problem| Misreading::at(span, problem))?
        }
    };
    primitive.begin = entry.begin;
    primitive.blend = entry.blend;
    primitive.on_end = entry.on_end;
    primitive.start = entry.start;
    primitive.stop = entry.stop;
    if path.is_none() {
        primitive = with_joints(primitive, spanned, names)?;
    }
    let checked = primitive.check();
    checked.map_err(|error| {
        let place = place_of(spanned, names, &error);
        Misreading::at(&place, error.named(names))
    })?;
    Ok(primitive)
}

impl Entry {
    /// The path of a tip with its place in the text; `None` if the step, at `span`, moves joints.
    fn path(&self, span: &Range<usize>) -> Result<Option<(Range<usize>, TipPath<'_>)>, Misreading> {
        let path = match (&self.line, &self.arc) {
            (None, None) => return Ok(None),
            (Some(line), None) => {
                let path = line.get_ref().path();
                let path = path.map_err(|problem| Misreading::at(&line.span(), problem))?;
                (line.span(), path)
            }
            (None, Some(arc)) => (arc.span(), arc.get_ref().path()),
            (Some(_), Some(_)) => {
                let problem = "two paths: give either `line` or `arc`";
                return Err(Misreading::at(span, problem));
            }
        };
        let problem = if !(self.to.is_empty() && self.by.is_empty() && self.via.is_empty()) {
            "a line or an arc moves all joints of its finger: give it a step of its own, without `to`, `by` and `via`"
        } else if !matches!(self.profile, None | Some(Profile::Cubic)) {
            "a line or an arc has the profile `cubic`: leave out `profile`"
        } else if self.begin == Begin::Now || self.blend != 0.0 {
            "a line or an arc begins at rest: leave out `blend`, and begin `after` or `beside` others"
        } else {
            return Ok(Some(path));
        };
        Err(Misreading::at(span, problem))
    }
}

/// Adds the joints of a step, with the points that they pass.
fn with_joints<const J: usize>(
    mut primitive: Primitive<J>,
    spanned: &Spanned<Entry>,
    names: &[impl AsRef<str>],
) -> Result<Primitive<J>, Misreading> {
    let entry = spanned.get_ref();
    let absolute = entry
        .to
        .iter()
        .map(|(name, &x)| (name, Target::Absolute(x)));
    let relative = entry
        .by
        .iter()
        .map(|(name, &x)| (name, Target::Relative(x)));
    for (name, target) in absolute.chain(relative) {
        let joint = joint(name, names)?;
        if primitive.mask >> joint & 1 == 1 {
            let problem = std::format!("{:?} is in `to` and in `by`: give one", name.get_ref());
            return Err(Misreading::at(&name.span(), problem));
        }
        let with = primitive.with(joint, target);
        primitive = with.map_err(|error| Misreading::at(&name.span(), error))?;
    }
    if primitive.mask == 0 {
        let problem = "no joints: give `[motion.to]` or `[motion.by]` with at least one";
        return Err(Misreading::at(&spanned.span(), problem));
    }
    for point in &entry.via {
        let via = via(point, primitive.mask, names)?;
        primitive.vias.push(via).map_err(|_| {
            let problem = std::format!("too many via points: {MAX_VIAS} are allowed");
            Misreading::at(&point.span(), problem)
        })?;
    }
    Ok(primitive)
}

/// The number that is wrong, as near as the text tells it.
fn place_of(
    entry: &Spanned<Entry>,
    names: &[impl AsRef<str>],
    error: &MotionError,
) -> Range<usize> {
    let inner = entry.get_ref();
    let at = match error {
        MotionError::Number(error) => error.at,
        _ => Subject::Whole,
    };
    let place = match at {
        Subject::Via(index) => inner.via.get(usize::from(index)).map(Spanned::span),
        Subject::Joint(joint) => {
            let name = names.get(usize::from(joint)).map_or("", AsRef::as_ref);
            let mut all = inner.to.keys().chain(inner.by.keys());
            all.find(|key| key.get_ref() == name).map(Spanned::span)
        }
        _ => None,
    };
    place.unwrap_or_else(|| entry.span())
}

fn via<const J: usize>(
    spanned: &Spanned<Point>,
    mask: u32,
    names: &[impl AsRef<str>],
) -> Result<Via<J>, Misreading> {
    let point = spanned.get_ref();
    let mut via = Via {
        at: point.at,
        positions: [0.0; J],
    };
    let mut missing = mask;
    for (name, &position) in &point.joints {
        let joint = joint(name, names)?;
        if mask >> joint & 1 == 0 {
            let problem = std::format!("{:?} is neither in `to` nor in `by`", name.get_ref());
            return Err(Misreading::at(&name.span(), problem));
        }
        missing &= !(1 << joint);
        if let Some(place) = via.positions.get_mut(joint) {
            *place = position;
        }
    }
    let joint = missing.trailing_zeros() as usize;
    if let (true, Some(name)) = (missing != 0, names.get(joint)) {
        let problem = std::format!("the via point lacks {:?}", name.as_ref());
        return Err(Misreading::at(&spanned.span(), problem));
    }
    Ok(via)
}

/// The number of a name; below 32.
fn joint(name: &Spanned<String>, names: &[impl AsRef<str>]) -> Result<usize, Misreading> {
    let wanted = name.get_ref();
    let mut known = names.iter().take(32);
    known
        .position(|name| name.as_ref() == wanted)
        .ok_or_else(|| {
            let all = names.iter().map(|name| std::format!("{:?}", name.as_ref()));
            let all = all.collect::<Vec<_>>().join(", ");
            let problem = std::format!("no joint is called {wanted:?}; there are {all}");
            Misreading::at(&name.span(), problem)
        })
}
