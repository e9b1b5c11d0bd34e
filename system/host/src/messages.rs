//! Rows of variables as messages of ROS 2, for recordings and live viewers.

mod pose;

use std::collections::BTreeSet;

use condor_ros2::{Layout, RosField, field_name, type_name};

use crate::watching::{CatalogEntry, RowSource};
pub use pose::PoseMessages;

/// The topic of the joints of a robot.
pub const JOINTS: &str = "/joint_states";
/// The topic of the model of a robot, in which viewers look for it.
pub const DESCRIPTION: &str = "/robot_description";
/// The topic of the frames of a robot that no source moves.
pub const STATIC_FRAMES: &str = "/tf_static";
/// The topic of the frames of a robot that sources move.
pub const FRAMES: &str = "/tf";

/// The topic of the events of a system.
pub const EVENTS: &str = "/events";

/// Returns the field of a row that shows a variable.
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

/// Returns the topic, the name of the type, and the layout of the rows of each source. `columns` are the variables in
/// the columns of the rows.
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

/// The topics and types of rows: no two sources of rows have the same.
#[derive(Default)]
pub struct Topics {
    topics: BTreeSet<String>,
    types: BTreeSet<String>,
}

impl Topics {
    /// Returns the topic of the rows of a loop or cell, such as `/hand/servo`, and the name of their type.
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
