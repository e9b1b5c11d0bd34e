//! [`Feeds`]: the channels, and the messages that rows become.

use std::rc::Rc;

use condor_ros2::{Head, JointState, Layout, Message, TFMessage, Text, Time, encode, schema};

use super::session::Channel;
use crate::messages::{FRAMES, JOINTS, Pose, Topics, field};
use crate::robot::{Joint, Robot};
use crate::watching::{Known, One, Row, Source};

/// The least time between two messages of the frames that a loop moves, in ns.
const FRAMES_NS: u64 = 16_000_000;
/// Where viewers look for the model of a robot.
const DESCRIPTION: &str = "/robot_description";

/// A message of a channel.
pub(super) struct Sample {
    pub(super) channel: usize,
    pub(super) at_ns: u64,
    pub(super) payload: Rc<[u8]>,
}

/// Turns rows into the messages of channels.
pub(super) struct Feeds<'r> {
    /// By the number of the source: its channel has the same number.
    layouts: Vec<Layout>,
    pose: Option<Pose<'r>>,
    joints: usize,
    frames: usize,
    /// When the frames that each source moves were sent last.
    framed_ns: Vec<u64>,
    /// What is added to the time of rows.
    ahead_ns: u64,
}

impl<'r> Feeds<'r> {
    /// Makes a channel for each source of rows, and those of the robot. `columns` are the variables in
    /// the columns of the rows; `ahead_ns` is added to the time of rows.
    pub(super) fn new(
        known: &Known,
        sources: &[Source],
        columns: &[&One],
        robot: Option<&'r dyn Robot>,
        [ahead_ns, now_ns]: [u64; 2],
    ) -> (Self, Vec<Channel>) {
        let (mut topics, mut channels, mut layouts) = (Topics::default(), Vec::new(), Vec::new());
        for source in sources {
            let fields = source.fields().iter();
            let ones = fields.filter_map(|field| columns.get(*field.columns.first()?));
            let layout = Layout::new(ones.map(|one| field(one)));
            let (processor, owner) = source.place();
            let [topic, schema_name] = topics.of(processor, owner);
            channels.push(Channel {
                topic,
                schema_name,
                schema: layout.schema(),
                latched: None,
            });
            layouts.push(layout);
        }
        if let Some(urdf) = robot.and_then(Robot::urdf) {
            channels.push(Channel {
                latched: Some((now_ns, encode(&Text(&urdf)).into())),
                ..Channel::of::<Text<'_>>(DESCRIPTION)
            });
        }
        let joints = channels.len();
        let pose = robot.and_then(|robot| Pose::of(robot, known, columns, sources));
        if pose.is_some() {
            channels.push(Channel::of::<JointState<'_>>(JOINTS));
            channels.push(Channel::of::<TFMessage<'_>>(FRAMES));
        }
        let feeds = Self {
            framed_ns: vec![0; layouts.len()],
            layouts,
            pose,
            joints,
            frames: joints + 1,
            ahead_ns,
        };
        (feeds, channels)
    }

    /// Makes the messages of a row.
    pub(super) fn row(&mut self, source: usize, row: &Row<'_>, mut send: impl FnMut(Sample)) {
        let at_ns = row.released.as_ns().wrapping_add(self.ahead_ns);
        let stamp = Time::from_ns(at_ns);
        let mut send = |channel, message: Vec<u8>| {
            send(Sample {
                channel,
                at_ns,
                payload: message.into(),
            });
        };
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
            send(source, message);
        }
        let Some(pose) = &mut self.pose else { return };
        pose.row(source, row, stamp, |state, frames| {
            send(self.joints, encode(state));
            if let Some(framed_ns) = self.framed_ns.get_mut(source)
                && at_ns.saturating_sub(*framed_ns) >= FRAMES_NS
            {
                *framed_ns = at_ns;
                send(self.frames, encode(frames));
            }
        });
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

/// Returns the variables that a joint has.
pub(super) fn variables(joint: &Joint) -> impl Iterator<Item = &String> {
    let more = [&joint.velocity, &joint.effort].into_iter().flatten();
    core::iter::once(&joint.position).chain(more)
}
