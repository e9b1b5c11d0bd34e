//! [`Pose`]: the joints and frames of a robot, from rows of its variables.

use condor_ros2::{JointState, TFMessage, Transform};

use crate::commands::number::float;
use crate::recording::{RecordingError, Writer};
use crate::robot::{Frame, Robot};
use crate::watching::{Known, One, Row, Source};

/// How far a joint is moved to find the frames that move with it, in radians or metres.
const STEP: f64 = 0.1;

/// The joints and frames of a robot. A row of a loop makes one message of the joints whose positions it
/// has, and one of the frames that these joints move.
pub(super) struct Pose {
    robot: Box<dyn Robot>,
    /// The last positions of all joints.
    positions: Vec<f64>,
    joints: u16,
    frames: u16,
    /// The part of each source of rows.
    parts: Vec<Part>,
}

/// What one loop knows of the robot.
#[derive(Default)]
struct Part {
    /// The numbers of its joints, with the columns of positions, velocities and efforts.
    joints: Vec<[Option<usize>; 3]>,
    numbers: Vec<usize>,
    names: Vec<String>,
    /// The numbers of the frames that they move.
    frames: Vec<usize>,
}

impl Pose {
    /// Finds the joints whose positions are among `columns`; `None` if there are none.
    pub(super) fn of(
        robot: Box<dyn Robot>,
        known: &Known,
        columns: &[&One],
        sources: &[Source],
        writer: &mut Writer,
    ) -> Result<Option<Self>, RecordingError> {
        let column = |name: &String| {
            let one = known.find(name).ok()?;
            columns.iter().position(|it| core::ptr::eq(*it, one))
        };
        let source_of = |column: usize| {
            let has = |source: &Source| {
                let mut fields = source.fields().iter();
                fields.any(|field| field.columns.contains(&column))
            };
            sources.iter().position(has)
        };
        let joints = robot.joints();
        let mut parts: Vec<_> = sources.iter().map(|_| Part::default()).collect();
        for (number, joint) in joints.iter().enumerate() {
            let Some(position) = column(&joint.position) else {
                continue;
            };
            let of_joint = [&joint.velocity, &joint.effort];
            let [velocity, effort] = of_joint.map(|name| name.as_ref().and_then(column));
            if let Some(part) = source_of(position).and_then(|it| parts.get_mut(it)) {
                part.joints.push([Some(position), velocity, effort]);
                part.numbers.push(number);
                part.names.push(joint.name.clone());
            }
        }
        if parts.iter().all(|part| part.names.is_empty()) {
            return Ok(None);
        }
        let positions = vec![0.0; joints.len()];
        let mut fixed: Vec<_> = (0..robot.frames(&positions).len()).collect();
        for part in &mut parts {
            part.frames = moved(&*robot, &part.numbers);
            fixed.retain(|number| !part.frames.contains(number));
        }
        // What nothing moves comes with the first joints.
        if let Some(part) = parts.iter_mut().find(|part| !part.names.is_empty()) {
            part.frames.extend(fixed);
        }
        Ok(Some(Self {
            positions,
            robot,
            parts,
            joints: writer.channel_of::<JointState<'_>>("/joint_states")?,
            frames: writer.channel_of::<TFMessage<'_>>("/tf")?,
        }))
    }

    /// Records the joints of which a row tells, and the frames that they move.
    pub(super) fn row(&mut self, source: usize, row: &Row<'_>, writer: &mut Writer) {
        let Some(part) = self.parts.get(source) else {
            return;
        };
        if part.names.is_empty() {
            return;
        }
        let values: Vec<_> = row.values().collect();
        let value = |column: Option<usize>| {
            let column = column?;
            let mut values = values.iter();
            let found = values.find(|(field, _)| field.columns.contains(&column))?;
            Some(float(found.1))
        };
        let [positions, velocities, efforts] = [0, 1, 2].map(|kind| {
            let columns = part.joints.iter().filter_map(|joint| joint.get(kind));
            let all: Option<Vec<_>> = columns.map(|column| value(*column)).collect();
            // Those of some joints only have no place in the message.
            all.unwrap_or_default()
        });
        for (number, position) in part.numbers.iter().zip(&positions) {
            if let Some(place) = self.positions.get_mut(*number) {
                *place = *position;
            }
        }
        let at_ns = row.released.as_ns();
        let stamp = writer.stamp(at_ns);
        let state = JointState {
            stamp,
            names: &part.names,
            positions: &positions,
            velocities: &velocities,
            efforts: &efforts,
        };
        writer.message(self.joints, at_ns, &state);
        let all = self.robot.frames(&self.positions);
        let frames = part.frames.iter().filter_map(|number| all.get(*number));
        let transforms: Vec<_> = frames.map(transform).collect();
        let message = TFMessage {
            stamp,
            transforms: &transforms,
        };
        writer.message(self.frames, at_ns, &message);
    }
}

/// Returns the numbers of the frames that some joints move.
fn moved(robot: &dyn Robot, joints: &[usize]) -> Vec<usize> {
    let mut positions = vec![0.0; robot.joints().len()];
    let before = robot.frames(&positions);
    for number in joints {
        if let Some(position) = positions.get_mut(*number) {
            *position = STEP;
        }
    }
    let after = robot.frames(&positions);
    let pairs = before.iter().zip(&after).enumerate();
    pairs
        .filter(|(_, (before, after))| before != after)
        .map(|(number, _)| number)
        .collect()
}

fn transform(frame: &Frame) -> Transform {
    Transform {
        parent: frame.parent.clone(),
        child: frame.name.clone(),
        translation: frame.translation,
        rotation: frame.rotation,
    }
}
