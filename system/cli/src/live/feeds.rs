//! [`Feeds`]: the channels, and the messages that rows become.

use std::collections::BTreeSet;
use std::rc::Rc;
use std::time::Instant;

use condor_ros2::{
    Head, JointState, Layout, Level, Log, RosMessage, StringMessage, TFMessage, Time, encode,
    schema,
};
use serde_json::json;

use super::scene::Scene;
use super::session::Channel;
use condor_host::messages::{
    self, DESCRIPTION, EVENTS, FRAMES, JOINTS, PoseMessages, STATIC_FRAMES, Topics,
};
use condor_host::robot::{Robot, RobotJoint};
use condor_host::watching::{CatalogEntry, RowSource, SourceRow, VariableCatalog};

/// The least time between two messages of the frames that a loop moves, in ns.
const FRAMES_NS: u64 = 16_000_000;
/// The robot and what it handles, as the page draws them.
const SCENE: &str = "/scene";
/// The description of all parameters: types, units and bounds.
const PARAMETERS: &str = "/parameters";

/// A message of a channel.
pub(super) struct Sample {
    pub(super) channel: usize,
    pub(super) at_ns: u64,
    pub(super) payload: Rc<[u8]>,
}

/// Turns rows into the messages of channels.
pub(super) struct Feeds<'r> {
    /// The number of the channel and the layout of the rows of each source, by its number.
    layouts: Vec<(usize, Layout)>,
    topics: Topics,
    pose: Option<PoseMessages<'r>>,
    scene: Option<Scene<'r>>,
    events: usize,
    scenes: usize,
    joints: usize,
    frames: usize,
    /// When the frames that each source moves were sent last.
    framed_ns: Vec<u64>,
    /// The time that is added to that of rows, ns.
    ahead_ns: u64,
}

impl<'r> Feeds<'r> {
    /// Makes a channel for each source of rows, those of the robot, and those of the page. `columns` are the variables
    /// in the columns of the rows; `parameters` are the names of all parameters; `ahead_ns` is added to the time of
    /// rows.
    pub(super) fn new(
        known: &VariableCatalog,
        sources: &[RowSource],
        columns: &[&CatalogEntry],
        parameters: &[String],
        robot: Option<&'r dyn Robot>,
        [ahead_ns, now_ns]: [u64; 2],
    ) -> (Self, Vec<Channel>) {
        let (mut topics, mut layouts) = (Topics::default(), Vec::new());
        let mut channels = of_rows(&mut topics, &mut layouts, 0, sources, columns);
        let latched = |topic, text: &str| Channel::latched(topic, now_ns, &StringMessage(text));
        channels.extend((robot.and_then(Robot::urdf)).map(|urdf| latched(DESCRIPTION, &urdf)));
        channels.push(latched(PARAMETERS, &described(known, parameters)));
        let events = channels.len();
        channels.push(Channel {
            is_whole: true,
            ..Channel::of::<Log>(EVENTS)
        });
        let scenes = channels.len();
        let scene = robot.map(|robot| Scene::of(robot, known, columns, sources));
        if scene.is_some() {
            channels.push(Channel::of::<StringMessage<'_>>(SCENE));
        }
        let joints = channels.len();
        let pose = robot.and_then(|robot| PoseMessages::of(robot, known, columns, sources));
        if let Some(pose) = &pose {
            channels.push(Channel::of::<JointState<'_>>(JOINTS));
            channels.push(Channel::of::<TFMessage<'_>>(FRAMES));
            let stamp = Time::from_ns(now_ns);
            let transforms = &pose.fixed()[..];
            let fixed = TFMessage { stamp, transforms };
            channels.push(Channel::latched(STATIC_FRAMES, now_ns, &fixed));
        }
        let feeds = Self {
            framed_ns: vec![0; layouts.len()],
            layouts,
            topics,
            pose,
            scene,
            events,
            scenes,
            joints,
            frames: joints + 1,
            ahead_ns,
        };
        (feeds, channels)
    }

    /// Makes the messages of a row, for those channels that are `wanted`.
    pub(super) fn row(
        &mut self,
        source: usize,
        row: &SourceRow<'_>,
        wanted: &BTreeSet<usize>,
        mut send: impl FnMut(Sample),
    ) {
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
        if let Some((channel, layout)) = self.layouts.get(source)
            && wanted.contains(channel)
            && let Ok(message) = layout.encode(&head, row.words)
        {
            send(*channel, message);
        }
        let is_wanted = wanted.contains(&self.scenes);
        let scene = self.scene.as_mut();
        let picture = scene.and_then(|it| it.row(source, row, is_wanted, Instant::now()));
        if let Some(text) = picture {
            send(self.scenes, encode(&StringMessage(&text)));
        }
        let pose = self.pose.as_mut();
        let Some(posed) = pose.and_then(|pose| pose.row(source, row)) else {
            return;
        };
        if wanted.contains(&self.joints) {
            send(self.joints, encode(&posed.joints(stamp)));
        }
        if wanted.contains(&self.frames)
            && let Some(framed_ns) = self.framed_ns.get_mut(source)
            && at_ns.saturating_sub(*framed_ns) >= FRAMES_NS
        {
            *framed_ns = at_ns;
            let transforms = &posed.frames()[..];
            send(self.frames, encode(&TFMessage { stamp, transforms }));
        }
    }
}

impl Feeds<'_> {
    /// Makes a channel for each of the sources that have come, which follow those that are known. The first one gets
    /// the number `first`.
    pub(super) fn add(
        &mut self,
        first: usize,
        sources: &[RowSource],
        columns: &[&CatalogEntry],
    ) -> Vec<Channel> {
        let (topics, layouts) = (&mut self.topics, &mut self.layouts);
        of_rows(topics, layouts, first, sources, columns)
    }

    /// Makes the message of an event.
    pub(super) fn event(&self, at_ns: u64, level: Level, source: &str, text: &str) -> Sample {
        let at_ns = at_ns.wrapping_add(self.ahead_ns);
        let log = Log {
            stamp: Time::from_ns(at_ns),
            level,
            name: source.into(),
            text: text.into(),
        };
        Sample {
            channel: self.events,
            at_ns,
            payload: encode(&log).into(),
        }
    }
}

/// Makes channels for the rows of sources, numbered from `first` on.
fn of_rows(
    topics: &mut Topics,
    layouts: &mut Vec<(usize, Layout)>,
    first: usize,
    sources: &[RowSource],
    columns: &[&CatalogEntry],
) -> Vec<Channel> {
    let all = messages::layouts(topics, sources, columns).into_iter();
    let channel = |(number, ([topic, schema_name], layout)): (usize, ([String; 2], Layout))| {
        let schema = layout.schema();
        layouts.push((number, layout));
        Channel {
            topic,
            schema_name,
            schema,
            latched: None,
            is_whole: false,
        }
    };
    (first..).zip(all).map(channel).collect()
}

/// Describes parameters, as JSON: an object for each, in their order.
fn described(known: &VariableCatalog, parameters: &[String]) -> String {
    let ones = parameters
        .iter()
        .filter_map(|name| Some((name, known.find(name).ok()?)));
    let described = ones.map(|(name, one)| {
        let bounds = one
            .entry
            .bounds
            .map(|both| both.map(|bound| one.of.json(bound)));
        json!({
            "name": name,
            "type": one.of.to_string(),
            "unit": one.entry.unit.to_string(),
            "about": one.entry.about.to_string(),
            "bounds": bounds,
            "labels": one.of.labels,
        })
    });
    described.collect::<serde_json::Value>().to_string()
}

impl Channel {
    /// Makes a channel whose only message everybody gets who subscribes.
    fn latched<M: RosMessage>(topic: &str, at_ns: u64, message: &M) -> Self {
        Self {
            latched: Some((at_ns, encode(message).into())),
            ..Self::of::<M>(topic)
        }
    }

    fn of<M: RosMessage>(topic: &str) -> Self {
        Self {
            topic: topic.into(),
            schema_name: M::NAME.into(),
            schema: schema::<M>(),
            latched: None,
            is_whole: false,
        }
    }
}

/// Returns the variables that a joint has.
pub(super) fn variables(joint: &RobotJoint) -> impl Iterator<Item = &String> {
    let more = [&joint.velocity, &joint.effort].into_iter().flatten();
    core::iter::once(&joint.position).chain(more)
}
