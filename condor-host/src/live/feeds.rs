//! [`Feeds`]: the channels, and the messages that rows become.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use condor_ros2::{
    Field, Head, JointState, Layout, Message, TFMessage, Text, Time, Transform, encode, field_name,
    schema, type_name,
};
use condor_vars::Value;

use super::session::Channel;
use crate::robot::{Joint, Robot};
use crate::watching::{One, Row, Source};

/// The least time between two messages of frames, in ns.
const FRAMES_NS: u64 = 16_000_000;
/// Where viewers look for the model, the joints and the frames of a robot.
const DESCRIPTION: &str = "/robot_description";
const JOINTS: &str = "/joint_states";
const FRAMES: &str = "/tf";

/// A message of a channel.
pub(super) struct Sample {
    pub(super) channel: usize,
    pub(super) at_ns: u64,
    pub(super) payload: Rc<[u8]>,
}

/// What becomes messages.
pub(super) struct Feeds<'r> {
    /// By the number of the source: its channel has the same number.
    layouts: Vec<Layout>,
    robot: Option<Model<'r>>,
    /// What is added to the time of rows.
    ahead_ns: u64,
}

/// A robot that moves.
struct Model<'r> {
    robot: &'r dyn Robot,
    joints: usize,
    frames: usize,
    /// By the column of a variable: the joints and quantities that it is.
    columns: BTreeMap<usize, Vec<(usize, Quantity)>>,
    /// The present state of each joint; `None` before the first row of it.
    states: Vec<[Option<f64>; 3]>,
    framed_ns: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    Position,
    Velocity,
    Effort,
}

impl<'r> Feeds<'r> {
    /// Makes a channel for each source of rows, and those of the robot. `columns` are the variables in
    /// the columns of the rows; `ahead_ns` is added to the time of rows.
    pub(super) fn new(
        sources: &[Source],
        columns: &[&One],
        robot: Option<&'r dyn Robot>,
        ahead_ns: u64,
        now_ns: u64,
    ) -> (Self, Vec<Channel>) {
        let (mut topics, mut types) = (BTreeSet::new(), BTreeSet::new());
        let (mut channels, mut layouts) = (Vec::new(), Vec::new());
        for source in sources {
            let fields = source.fields().iter();
            let ones = fields.filter_map(|field| columns.get(*field.columns.first()?).copied());
            let layout = Layout::new(ones.map(field));
            let name = source.name();
            let (processor, owner) = name.split_once(':').unwrap_or((&name, ""));
            let prefix = format!("/{}/", field_name(processor, |_| false));
            let owner = field_name(owner, |owner| topics.contains(&format!("{prefix}{owner}")));
            let topic = prefix + &owner;
            topics.insert(topic.clone());
            let schema_name = type_name(&name, |name| types.contains(name));
            types.insert(schema_name.clone());
            channels.push(Channel {
                topic,
                schema_name,
                schema: layout.schema(),
                latched: None,
            });
            layouts.push(layout);
        }
        let robot = robot.map(|robot| {
            let mut add = |channel| {
                channels.push(channel);
                channels.len() - 1
            };
            if let Some(urdf) = robot.urdf() {
                let mut channel = Channel::of::<Text<'_>>(DESCRIPTION);
                channel.latched = Some((now_ns, encode(&Text(&urdf)).into()));
                add(channel);
            }
            let names: Vec<_> = columns.iter().map(|one| one.names()).collect();
            Model::new(
                robot,
                &names,
                add(Channel::of::<JointState<'_>>(JOINTS)),
                add(Channel::of::<TFMessage<'_>>(FRAMES)),
            )
        });
        let feeds = Self {
            layouts,
            robot,
            ahead_ns,
        };
        (feeds, channels)
    }

    /// Makes the messages of a row.
    pub(super) fn row(&mut self, source: usize, row: &Row<'_>, mut send: impl FnMut(Sample)) {
        let at_ns = row.released.as_ns().wrapping_add(self.ahead_ns);
        let stamp = Time::from_ns(at_ns);
        let head = Head {
            stamp,
            tick: row.tick,
            lost: row.lost.into(),
        };
        // The words are those of the fields.
        let message = self
            .layouts
            .get(source)
            .map(|it| it.encode(&head, row.words));
        if let Some(Ok(message)) = message {
            send(Sample {
                channel: source,
                at_ns,
                payload: message.into(),
            });
        }
        if let Some(robot) = &mut self.robot {
            robot.row(row, at_ns, send);
        }
    }
}

impl Channel {
    fn of<M: Message>(topic: &str) -> Self {
        Self {
            topic: topic.into(),
            schema_name: M::NAME.into(),
            schema: schema::<M>(),
            latched: None,
        }
    }
}

fn field(one: &One) -> Field {
    Field {
        name: one.name.clone(),
        kind: one.of.kind,
        unit: one.entry.unit.to_string(),
        about: one.entry.about.to_string(),
        labels: one.of.labels.clone(),
    }
}

/// Returns the variables that a joint has.
pub(super) fn variables(joint: &Joint) -> impl Iterator<Item = &String> {
    let more = [&joint.velocity, &joint.effort].into_iter().flatten();
    core::iter::once(&joint.position).chain(more)
}

impl<'r> Model<'r> {
    /// `names` are those of the variables in the columns of the rows.
    fn new(robot: &'r dyn Robot, names: &[[String; 3]], joints: usize, frames: usize) -> Self {
        let mut columns = BTreeMap::<_, Vec<_>>::new();
        for (number, joint) in robot.joints().iter().enumerate() {
            let quantities = [
                (Some(&joint.position), Quantity::Position),
                (joint.velocity.as_ref(), Quantity::Velocity),
                (joint.effort.as_ref(), Quantity::Effort),
            ];
            for (variable, quantity) in quantities {
                let is_it = |names: &[String; 3]| variable.is_some_and(|it| names.contains(it));
                if let Some(column) = names.iter().position(is_it) {
                    columns.entry(column).or_default().push((number, quantity));
                }
            }
        }
        Self {
            robot,
            joints,
            frames,
            columns,
            states: vec![[None; 3]; robot.joints().len()],
            framed_ns: 0,
        }
    }

    fn row(&mut self, row: &Row<'_>, at_ns: u64, mut send: impl FnMut(Sample)) {
        let mut moved = BTreeSet::new();
        for (field, value) in row.values() {
            let number = number(value);
            let columns = field.columns.iter().filter_map(|it| self.columns.get(it));
            for (joint, quantity) in columns.flatten() {
                if let Some(state) = self.states.get_mut(*joint) {
                    state[*quantity as usize] = number;
                    moved.insert(*joint);
                }
            }
        }
        if moved.is_empty() {
            return;
        }
        let stamp = Time::from_ns(at_ns);
        send(Sample {
            channel: self.joints,
            at_ns,
            payload: self.joint_state(&moved, stamp).into(),
        });
        if at_ns.saturating_sub(self.framed_ns) < FRAMES_NS {
            return;
        }
        // A part stays away until the place of all is known.
        let positions = self.states.iter().map(|[position, ..]| *position);
        let Some(positions) = positions.collect::<Option<Vec<_>>>() else {
            return;
        };
        self.framed_ns = at_ns;
        let frames = self.robot.frames(&positions).into_iter();
        let transforms: Vec<_> = frames
            .map(|frame| Transform {
                parent: frame.parent,
                child: frame.name,
                translation: frame.translation,
                rotation: frame.rotation,
            })
            .collect();
        let transforms = &transforms;
        send(Sample {
            channel: self.frames,
            at_ns,
            payload: encode(&TFMessage { stamp, transforms }).into(),
        });
    }

    /// Writes the state of the joints that a row has.
    fn joint_state(&self, moved: &BTreeSet<usize>, stamp: Time) -> Vec<u8> {
        let all = moved.iter();
        let all = all.filter_map(|it| Some((self.robot.joints().get(*it)?, self.states.get(*it)?)));
        let (mut names, mut columns) = (Vec::new(), [const { Vec::new() }; 3]);
        for (joint, state) in all.filter(|(_, [position, ..])| position.is_some()) {
            names.push(joint.name.clone());
            for (column, value) in columns.iter_mut().zip(state) {
                column.extend(*value);
            }
        }
        // A quantity is there for all of them or for none.
        for column in &mut columns {
            if column.len() != names.len() {
                column.clear();
            }
        }
        let [positions, velocities, efforts] = &columns;
        encode(&JointState {
            stamp,
            names: &names,
            positions,
            velocities,
            efforts,
        })
    }
}

/// Returns a value as a number, if it is one.
fn number(value: Value) -> Option<f64> {
    match value {
        Value::F32(value) => Some(value.into()),
        Value::F64(value) => Some(value),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Frame, Line};
    use condor_mbox::Instant;
    use condor_vars::Kind;

    /// Two joints in a chain, of which one has a velocity.
    struct Arm([Joint; 2]);

    impl Robot for Arm {
        fn joints(&self) -> &[Joint] {
            &self.0
        }

        fn lines(&self, _: &[f64]) -> Vec<Line> {
            Vec::new()
        }

        fn frames(&self, positions: &[f64]) -> Vec<Frame> {
            let frame = |(joint, position): (&Joint, &f64)| Frame {
                name: joint.name.clone(),
                parent: "base".into(),
                translation: [*position, 0.0, 0.0],
                rotation: [0.0, 0.0, 0.0, 1.0],
            };
            self.0.iter().zip(positions).map(frame).collect()
        }
    }

    fn arm() -> Arm {
        let joint = |name: &str, velocity: Option<&str>| Joint {
            name: name.into(),
            position: format!("{name}.position"),
            velocity: velocity.map(str::to_owned),
            effort: None,
            limits: [-1.0, 1.0],
        };
        Arm([joint("one", Some("a:one.velocity")), joint("two", None)])
    }

    fn field(columns: &[usize]) -> crate::watching::Field {
        crate::watching::Field {
            name: String::new(),
            kind: Kind::F64,
            columns: columns.to_vec(),
        }
    }

    #[test]
    fn rows_of_joints_are_states_and_frames() {
        let arm = arm();
        let names = ["one.position", "one.velocity", "two.position", "other"];
        let names = names.map(|name| [name.to_owned(), format!("a:{name}"), String::new()]);
        let mut model = Model::new(&arm, &names, 7, 8);
        let mut sent = |columns: &[&[usize]], values: &[f64], at_ns| {
            let fields: Vec<_> = columns.iter().map(|it| field(it)).collect();
            let words = values.iter().flat_map(|value| {
                let bits = value.to_bits();
                [bits as u32, (bits >> 32) as u32]
            });
            let row = Row {
                tick: 1,
                released: Instant::from_ns(at_ns),
                lost: 0,
                fields: &fields,
                words: &words.collect::<Vec<_>>(),
            };
            let mut sent = Vec::new();
            model.row(&row, at_ns, |sample| {
                sent.push((sample.channel, sample.payload.to_vec()));
            });
            sent
        };
        let state = |at_ns, names: &[&str], positions: &[f64], velocities: &[f64]| {
            let names: Vec<_> = names.iter().map(|name| (*name).to_owned()).collect();
            let state = JointState {
                stamp: Time::from_ns(at_ns),
                names: &names,
                positions,
                velocities,
                efforts: &[],
            };
            (7, encode(&state))
        };
        let frames = |at_ns, positions: [f64; 2]| {
            let transforms = arm.frames(&positions).into_iter().map(|frame| Transform {
                parent: frame.parent,
                child: frame.name,
                translation: frame.translation,
                rotation: frame.rotation,
            });
            let stamp = Time::from_ns(at_ns);
            let transforms = &transforms.collect::<Vec<_>>()[..];
            (8, encode(&TFMessage { stamp, transforms }))
        };
        let later = 1_000_000_000;
        assert_eq!(sent(&[&[3]], &[9.0], later), []);
        // The second joint is not known yet.
        let first = sent(&[&[0], &[1]], &[0.5, -2.0], later);
        assert_eq!(first, [state(later, &["one"], &[0.5], &[-2.0])]);
        let both = sent(&[&[0], &[3, 2]], &[0.25, 0.75], later);
        // A velocity of one joint would be taken for that of another.
        let expected = state(later, &["one", "two"], &[0.25, 0.75], &[]);
        assert_eq!(both, [expected, frames(later, [0.25, 0.75])]);
        let soon = later + FRAMES_NS - 1;
        let two = sent(&[&[2]], &[0.0], soon);
        assert_eq!(two, [state(soon, &["two"], &[0.0], &[])]);
        let then = later + FRAMES_NS;
        let two = sent(&[&[2]], &[-0.5], then);
        let expected = state(then, &["two"], &[-0.5], &[]);
        assert_eq!(two, [expected, frames(then, [0.25, -0.5])]);
    }
}
