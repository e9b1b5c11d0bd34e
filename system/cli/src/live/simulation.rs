//! [`Simulation`]: the services by which a page tries postures and motions of a robot.

mod plan;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value as Json, json};

use super::calls::{Call, Service};
use super::scene::{picture, variables};
use condor_host::application::Application;
use condor_host::description::SystemDescription;
use condor_host::error::AnyError;
use condor_host::robot::{Frame, MotionFiles, MotionSender, Robot, Simulator};
use condor_host::system::SystemDirectory;

/// The greatest number of clearances that are told.
const CLEARANCES: usize = 8;
/// The name of a text in errors.
const MOTION: &str = "motion";

const ROBOT: &str = "/sim/robot";
const POSE: &str = "/sim/pose";
const PLAN: &str = "/sim/plan";
const STEPS: &str = "/sim/steps";
const TEXT: &str = "/sim/text";
const MOTIONS: &str = "/sim/motions";
const OPEN: &str = "/sim/open";
const SAVE: &str = "/sim/save";
const ENQUEUE: &str = "/sim/enqueue";
const OUTCOME: &str = "/sim/outcome";

/// The parts of which a simulation is made.
#[derive(Clone, Copy)]
pub(crate) struct Workshop<'s> {
    pub(crate) application: &'s dyn Application,
    pub(crate) robot: &'s dyn Robot,
    pub(crate) simulator: &'s dyn Simulator,
    /// The file with the configuration of the robot.
    pub(crate) file: &'s Path,
    /// The system that runs, and the file of its description.
    pub(crate) system: Option<(&'s SystemDirectory, &'s Path)>,
}

/// The services, and what they use.
pub(super) struct Simulation<'s> {
    robot: &'s dyn Robot,
    simulator: &'s dyn Simulator,
    motions: Option<Box<dyn MotionFiles>>,
    queue: Option<Box<dyn MotionSender>>,
    services: Vec<Service>,
}

impl<'s> Simulation<'s> {
    pub(super) fn open(workshop: Workshop<'s>) -> Result<Self, AnyError> {
        let Workshop {
            application,
            robot,
            simulator,
            file,
            system,
        } = workshop;
        let (mut description, mut queue) = (None, None);
        if let Some((directory, file)) = system {
            let read = SystemDescription::read(file, application)?;
            queue = application.motion_queue(&read, directory)?;
            description = Some(read);
        }
        let motions = application.motions(file, description.as_ref())?;
        let mut services = [ROBOT, POSE, PLAN, STEPS, TEXT].map(looks).to_vec();
        if motions.is_some() {
            services.extend([looks(MOTIONS), looks(OPEN), changes(SAVE)]);
        }
        if queue.is_some() {
            services.extend([changes(ENQUEUE), looks(OUTCOME)]);
        }
        Ok(Self {
            robot,
            simulator,
            motions,
            queue,
            services,
        })
    }

    pub(super) fn services(&self) -> &[Service] {
        &self.services
    }

    /// Returns the text of the answer to a call.
    pub(super) fn answer(&mut self, call: &Call) -> Result<Vec<u8>, AnyError> {
        let service = self.services.get(call.service as usize);
        let name = service.map_or("", |service| service.name);
        let payload = call.payload.as_slice();
        let answer = match (name, &mut self.motions, &mut self.queue) {
            (ROBOT, ..) => {
                let Nothing {} = read(name, payload)?;
                self.described()
            }
            (POSE, ..) => self.pose(&read(name, payload)?)?,
            (PLAN, ..) => {
                let Plan { from, text } = read(name, payload)?;
                plan::plan_json(&self.simulator.plan(&from, &text, MOTION)?)
            }
            (STEPS, ..) => {
                let Text { text } = read(name, payload)?;
                json!({ "steps": self.simulator.steps(&text, MOTION)? })
            }
            (TEXT, ..) => {
                let Steps { steps } = read(name, payload)?;
                json!({ "text": self.simulator.text(&steps)? })
            }
            (MOTIONS, Some(motions), _) => {
                let Nothing {} = read(name, payload)?;
                json!({ "files": motions.list()? })
            }
            (OPEN, Some(motions), _) => {
                let File { file } = read(name, payload)?;
                json!({ "text": motions.read(&file)? })
            }
            (SAVE, Some(motions), _) => {
                let save: Save = read(name, payload)?;
                motions.write(&save.file, &save.text, save.replace)?;
                json!({})
            }
            (ENQUEUE, _, Some(queue)) => {
                let Enqueue { text, control } = read(name, payload)?;
                json!({ "id": queue.enqueue(&text, control)? })
            }
            (OUTCOME, _, Some(queue)) => {
                let Id { id } = read(name, payload)?;
                json!(queue.outcome(id)?)
            }
            _ => return Err(format!("there is no service {}", call.service).into()),
        };
        Ok(serde_json::to_vec(&answer)?)
    }

    /// Says what the robot is.
    fn described(&self) -> Json {
        let joints = self.robot.joints().iter().map(|joint| {
            json!({ "name": joint.name, "limits": joint.limits, "position": joint.position })
        });
        let start = self.simulator.moved(&[]).positions;
        let frames = self.robot.frames(&start);
        json!({
            "joints": joints.collect::<Vec<_>>(),
            "handles": tips(&frames).map(|tip| &tip.name).collect::<Vec<_>>(),
            "hasMotions": self.motions.is_some(),
            "hasQueue": self.queue.is_some(),
            "start": start,
        })
    }

    /// Says how the robot is in a posture within its limits, after a frame was dragged.
    fn pose(&self, pose: &Pose) -> Result<Json, AnyError> {
        let (positions, held, reached) = match &pose.drag {
            None => {
                let moved = self.simulator.moved(&pose.positions);
                (moved.positions, moved.held, None)
            }
            Some(Drag { frame, to }) => {
                let dragged = self.simulator.dragged(&pose.positions, frame, *to)?;
                let reached = (dragged.is_reached, dragged.distance_m);
                (dragged.positions, dragged.held, Some(reached))
            }
        };
        let mut values = positions.clone();
        values.resize(variables(self.robot).len(), f64::NAN);
        let frames = self.robot.frames(&positions);
        let origins = origins(&frames);
        let handles = tips(&frames).map(|tip| {
            let place = origins.get(tip.name.as_str());
            let at = place.map(|it| <[f64; 3]>::from(it.translation.vector));
            json!({ "name": tip.name, "at": at })
        });
        let mut clearances = self.simulator.clearances(&positions);
        clearances.sort_by(|one, other| one.distance_m.total_cmp(&other.distance_m));
        clearances.truncate(CLEARANCES);
        let clearances = clearances
            .iter()
            .map(|it| json!({ "parts": it.parts, "points": it.points, "distance": it.distance_m }));
        let mut told = json!({
            "positions": positions,
            "held": held,
            "scene": picture(self.robot, &values),
            "handles": handles.collect::<Vec<_>>(),
            "clearances": clearances.collect::<Vec<_>>(),
        });
        if let (Some((is_reached, distance)), Some(told)) = (reached, told.as_object_mut()) {
            told.insert("isReached".into(), is_reached.into());
            told.insert("distance".into(), distance.into());
        }
        Ok(told)
    }
}

const fn looks(name: &'static str) -> Service {
    Service {
        name,
        needs_token: false,
    }
}

const fn changes(name: &'static str) -> Service {
    Service {
        name,
        needs_token: true,
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Nothing {}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pose {
    positions: Vec<f64>,
    drag: Option<Drag>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Drag {
    frame: String,
    to: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Plan {
    from: Vec<f64>,
    text: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    text: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Steps {
    steps: Json,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    file: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Save {
    file: String,
    text: String,
    #[serde(default)]
    replace: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Enqueue {
    text: String,
    #[serde(default)]
    control: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Id {
    id: u64,
}

/// Reads what a service takes.
fn read<T: DeserializeOwned>(service: &str, payload: &[u8]) -> Result<T, String> {
    let read = serde_json::from_slice(payload);
    read.map_err(|error| format!("{service} cannot understand the request: {error}"))
}

/// Returns the frames that carry no other frame.
fn tips(frames: &[Frame]) -> impl Iterator<Item = &Frame> {
    let parents: BTreeSet<_> = frames.iter().map(|frame| &frame.parent).collect();
    frames.iter().filter(move |it| !parents.contains(&it.name))
}

/// Returns where frames are in the base, by their names. Parents come first.
fn origins(frames: &[Frame]) -> BTreeMap<&str, Isometry3<f64>> {
    let mut all: BTreeMap<&str, Isometry3<f64>> = BTreeMap::new();
    for frame in frames {
        let parent = all.get(frame.parent.as_str()).copied().unwrap_or_default();
        let [x, y, z, scalar] = frame.rotation;
        let turn = UnitQuaternion::new_unchecked(Quaternion::new(scalar, x, y, z));
        let own = Isometry3::from_parts(frame.translation.into(), turn);
        all.insert(&frame.name, parent * own);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_where_their_parents_take_them() {
        let half = core::f64::consts::FRAC_1_SQRT_2;
        let frame = |name: &str, parent: &str, rotation| Frame {
            name: name.into(),
            parent: parent.into(),
            translation: [1.0, 2.0, 3.0],
            rotation,
        };
        // A quarter about z, and then one about the new x.
        let frames = [
            frame("a", "base", [0.0, 0.0, half, half]),
            frame("b", "a", [half, 0.0, 0.0, half]),
            frame("c", "b", [0.0, 0.0, 0.0, 1.0]),
        ];
        let origins = origins(&frames);
        for (name, wanted) in [
            ("a", [1.0, 2.0, 3.0]),
            ("b", [-1.0, 3.0, 6.0]),
            ("c", [2.0, 4.0, 8.0]),
        ] {
            let at = origins[name].translation.vector;
            let is_near = at
                .iter()
                .zip(wanted)
                .all(|(is, it)| (is - it).abs() < 1e-12);
            assert!(is_near, "{name}: {at:?}");
        }
        assert_eq!(tips(&frames).count(), 1);
    }
}
