//! Rows of variables as messages of ROS 2, for recordings and live viewers.

mod pose;

use std::collections::BTreeSet;

use condor_ros2::{Layout, RosField, field_name, type_name};

use crate::watching::{CatalogEntry, RowSource};
pub use pose::PoseMessages;

/// The topic of the joints of a robot: [`JointState`](condor_ros2::JointState) messages with their positions,
/// velocities and efforts.
pub const JOINTS: &str = "/joint_states";
/// The topic of the model of a robot as URDF. Viewers look for the model in a topic of this name.
pub const DESCRIPTION: &str = "/robot_description";
/// The topic of the frames of a robot's links that do not move, because no row of variables has a joint that moves
/// them.
pub const STATIC_FRAMES: &str = "/tf_static";
/// The topic of the frames of a robot's links that move, because a row of variables has a joint that moves them.
pub const FRAMES: &str = "/tf";

/// The topic of the events of a system: [`Log`](condor_ros2::Log) messages.
pub const EVENTS: &str = "/events";

/// Describes the variable `one` as a field of a ROS message: name, type, unit, description, and labels of a choice.
#[must_use]
pub fn field(one: &CatalogEntry) -> RosField {
    RosField {
        name: one.name.clone(),
        kind: one.of.kind,
        unit: one.entry.unit.to_string(),
        about: one.entry.about.to_string(),
        labels: one.of.labels.clone(),
    }
}

/// Returns the time of the wall clock, in nanoseconds since 1970; 0 if the clock is before 1970.
#[must_use]
pub fn wall_ns() -> u64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(0, |now| u64::try_from(now.as_nanos()).unwrap_or(u64::MAX))
}

/// Returns, for each of `sources` in that order, the topic of its rows with the name of their message type, and the
/// layout of a row. `columns` are the variables that the sources were asked for. `topics` assigns the names.
pub fn layouts(
    topics: &mut Topics,
    sources: &[RowSource],
    columns: &[&CatalogEntry],
) -> Vec<([String; 2], Layout)> {
    let layout = |source: &RowSource| {
        let fields = source.fields().iter();
        let ones = fields.filter_map(|field| columns.get(*field.columns.first()?));
        let (processor, owner) = source.place();
        (
            topics.of(processor, owner),
            Layout::new(ones.map(|one| field(one))),
        )
    };
    sources.iter().map(layout).collect()
}

/// The topics and message types that were assigned to rows so far, so that no two loops or cells get the same.
#[derive(Default)]
pub struct Topics {
    topics: BTreeSet<String>,
    types: BTreeSet<String>,
}

impl Topics {
    /// Assigns a topic and a message type to the rows of the loop or cell `owner` of `processor`. Returns the topic,
    /// such as `/hand/servo`, and the name of the type. A second call with the same arguments returns other names.
    pub fn of(&mut self, processor: &str, owner: &str) -> [String; 2] {
        let prefix = format!("/{}/", field_name(processor, |_| false));
        let is_taken = |name: &str| self.topics.contains(&format!("{prefix}{name}"));
        let topic = format!("{prefix}{}", field_name(owner, is_taken));
        let place = format!("{processor}:{owner}");
        let of_type = type_name(&place, |name| self.types.contains(name));
        self.topics.insert(topic.clone());
        self.types.insert(of_type.clone());
        [topic, of_type]
    }
}
