//! [`PoseMessages`]: the joints and frames of a robot, from rows of its variables.

use condor_ros2::{JointState, Time, Transform};

use crate::robot::{Frame, Robot};
use crate::watching::{CatalogEntry, RowSource, SourceRow, VariableCatalog, float};

/// The distance by which a joint is moved to find the frames that move with it, in radians or metres.
const STEP: f64 = 0.1;

/// A converter from rows of variables to messages on the joints and frames of a robot. A row of a loop makes one
/// message of the joints whose positions are in the row, and one of the frames that these joints move.
pub struct PoseMessages<'r> {
    robot: &'r dyn Robot,
    /// The last positions of all joints.
    positions: Vec<f64>,
    /// The part of each source of rows.
    parts: Vec<Part>,
}

/// The joints and frames of the robot that the rows of one loop tell of.
#[derive(Default)]
struct Part {
    /// For each of its joints, the places of position, velocity and effort among the fields of its rows.
    joints: Vec<[Option<usize>; 3]>,
    /// The numbers of these joints.
    numbers: Vec<usize>,
    names: Vec<String>,
    /// The numbers of the frames that they move.
    frames: Vec<usize>,
}

impl<'r> PoseMessages<'r> {
    /// Makes a converter for the joints of `robot` whose positions are among `columns`; returns `None` if there are
    /// none. `columns` are the entries of `known` that are watched, and `sources` the loops and cells that write their
    /// rows.
    pub fn of(
        robot: &'r dyn Robot,
        known: &VariableCatalog,
        columns: &[&CatalogEntry],
        sources: &[RowSource],
    ) -> Option<Self> {
        let column = |name: &String| known.column(name, columns);
        let joints = robot.joints();
        let mut parts: Vec<_> = sources.iter().map(|_| Part::default()).collect();
        for (number, joint) in joints.iter().enumerate() {
            let Some(position) = column(&joint.position) else {
                continue;
            };
            let of_joint = [&joint.velocity, &joint.effort];
            let of_joint = of_joint.map(|name| name.as_ref().and_then(column));
            for (source, part) in sources.iter().zip(&mut parts) {
                if let Some(position) = source.field_of(position) {
                    let [velocity, effort] = of_joint.map(|it| source.field_of(it?));
                    part.joints.push([Some(position), velocity, effort]);
                    part.numbers.push(number);
                    part.names.push(joint.name.clone());
                }
            }
        }
        if parts.iter().all(|part| part.names.is_empty()) {
            return None;
        }
        Some(Self::with(robot, parts))
    }

    fn with(robot: &'r dyn Robot, mut parts: Vec<Part>) -> Self {
        let positions = vec![0.0; robot.joints().len()];
        for part in &mut parts {
            part.frames = moved(robot, &part.numbers);
        }
        Self {
            robot,
            positions,
            parts,
        }
    }

    /// Makes a converter for a robot of which no rows come: all joints stay at 0, and [`fixed`](Self::fixed) returns
    /// all frames.
    #[must_use]
    pub fn still(robot: &'r dyn Robot) -> Self {
        Self::with(robot, Vec::new())
    }

    /// Returns the frames that no row moves. One message with them is enough for the whole stream.
    #[must_use]
    pub fn fixed(&self) -> Vec<Transform> {
        let all = self.robot.frames(&self.positions);
        let is_fixed = |number: &usize| self.parts.iter().all(|it| !it.frames.contains(number));
        let frames = all.iter().enumerate();
        let fixed = frames.filter(|(number, _)| is_fixed(number));
        fixed.map(|(_, frame)| transform(frame)).collect()
    }

    /// Takes a row of the source with the index `source` in the `sources` of [`of`](Self::of). Returns the joints whose
    /// positions are in the row, and their frames; `None` if the rows of this source have no positions.
    pub fn row(&mut self, source: usize, row: &SourceRow<'_>) -> Option<PoseRow<'_>> {
        let part = self.parts.get(source)?;
        if part.names.is_empty() {
            return None;
        }
        let values: Vec<_> = row.values().map(|(_, value)| value).collect();
        let value = |field: Option<usize>| Some(float(*values.get(field?)?));
        let columns = [0, 1, 2].map(|kind| {
            let fields = part.joints.iter().filter_map(|joint| joint.get(kind));
            let all: Option<Vec<_>> = fields.map(|field| value(*field)).collect();
            // Those of some joints only have no place in the message.
            all.unwrap_or_default()
        });
        for (number, position) in part.numbers.iter().zip(&columns[0]) {
            if let Some(place) = self.positions.get_mut(*number) {
                *place = *position;
            }
        }
        Some(PoseRow {
            robot: self.robot,
            positions: &self.positions,
            part,
            columns,
        })
    }
}

/// The joints whose positions are in one row, and the frames that these joints move. [`PoseMessages::row`] returns it.
pub struct PoseRow<'p> {
    robot: &'p dyn Robot,
    positions: &'p [f64],
    part: &'p Part,
    /// Positions, velocities and efforts of the joints.
    columns: [Vec<f64>; 3],
}

impl PoseRow<'_> {
    /// Returns the state of the joints of this row as a message with the time `stamp`. The velocities are empty unless
    /// the row has those of all these joints; so are the efforts.
    pub fn joints(&self, stamp: Time) -> JointState<'_> {
        let [positions, velocities, efforts] = &self.columns;
        JointState {
            stamp,
            names: &self.part.names,
            positions,
            velocities,
            efforts,
        }
    }

    /// Returns the places and orientations of the frames that the joints of this row move. Other joints count with
    /// their positions in the last row that had them, or 0.
    pub fn frames(&self) -> Vec<Transform> {
        let all = self.robot.frames(self.positions);
        let frames = self.part.frames.iter();
        let frames = frames.filter_map(|number| all.get(*number));
        frames.map(transform).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{RobotJoint, RobotLine};
    use crate::watching::RowField;
    use condor_mbox::Instant;
    use condor_ros2::{TFMessage, encode};
    use condor_vars::ValueKind;

    /// Two joints, each of which moves a link, and a link that nothing moves.
    struct Arm([RobotJoint; 2]);

    impl Robot for Arm {
        fn joints(&self) -> &[RobotJoint] {
            &self.0
        }

        fn lines(&self, _: &[f64]) -> Vec<RobotLine> {
            Vec::new()
        }

        fn frames(&self, positions: &[f64]) -> Vec<Frame> {
            let frame = |name: &str, x| Frame {
                name: name.into(),
                parent: "base".into(),
                translation: [x, 0.0, 0.0],
                rotation: [0.0, 0.0, 0.0, 1.0],
            };
            let links = ["fixed", "one", "two"].into_iter();
            let places = core::iter::once(&5.0).chain(positions);
            links.zip(places).map(|(name, x)| frame(name, *x)).collect()
        }
    }

    fn arm() -> Arm {
        let joint = |name: &str| RobotJoint {
            name: name.into(),
            position: format!("{name}.position"),
            velocity: None,
            effort: None,
            limits: [-1.0, 1.0],
        };
        Arm(["one", "two"].map(joint))
    }

    /// A source that has a joint, with its position and velocity in these fields.
    fn part(number: usize, name: &str, fields: [Option<usize>; 2]) -> Part {
        Part {
            joints: vec![[fields[0], fields[1], None]],
            numbers: vec![number],
            names: vec![name.into()],
            frames: Vec::new(),
        }
    }

    #[test]
    fn a_row_moves_the_joints_and_frames_of_its_loop() {
        let arm = arm();
        let parts = vec![
            Part::default(),
            part(0, "one", [Some(2), Some(0)]),
            part(1, "two", [Some(0), None]),
        ];
        let mut pose = PoseMessages::with(&arm, parts);
        let stamp = Time { sec: 1, nanosec: 2 };
        let mut taken = |source, columns: &[usize], values: &[f64]| {
            let fields = columns.iter().map(|column| RowField {
                name: String::new(),
                kind: ValueKind::F64,
                columns: vec![*column],
            });
            let words = values.iter().map(|value| value.to_bits());
            let words = words.flat_map(|bits| [bits as u32, (bits >> 32) as u32]);
            let row = SourceRow {
                tick: 1,
                released: Instant::from_ns(0),
                lost: 0,
                fields: &fields.collect::<Vec<_>>(),
                words: &words.collect::<Vec<_>>(),
            };
            let posed = pose.row(source, &row)?;
            let transforms = &posed.frames()[..];
            let frames = TFMessage { stamp, transforms };
            Some([encode(&posed.joints(stamp)), encode(&frames)])
        };
        let expected = |name: &str, position: f64, velocities: &[f64], frames: &[Frame]| {
            let state = JointState {
                stamp,
                names: &[name.to_owned()],
                positions: &[position],
                velocities,
                efforts: &[],
            };
            let transforms: Vec<_> = frames.iter().map(transform).collect();
            let transforms = &transforms[..];
            Some([encode(&state), encode(&TFMessage { stamp, transforms })])
        };
        assert_eq!(taken(0, &[3], &[9.0]), None);
        let frames = arm.frames(&[0.5, 0.25]);
        let [fixed, one, two] = &frames[..] else {
            panic!("{frames:?}");
        };
        let first = expected("one", 0.5, &[-2.0], core::slice::from_ref(one));
        assert_eq!(taken(1, &[1, 2, 3], &[-2.0, 7.0, 0.5]), first);
        let second = expected("two", 0.25, &[], core::slice::from_ref(two));
        assert_eq!(taken(2, &[0], &[0.25]), second);
        assert_eq!(pose.fixed(), [transform(fixed)]);
    }
}
