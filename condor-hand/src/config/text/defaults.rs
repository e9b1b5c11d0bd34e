//! Where a value comes from that a joint or a finger leaves out.

use core::ops::Range;
use std::string::String;
use std::vec::Vec;

use super::problem::{Fault, Problem};
use super::tree::{FilledIn, Node, Value};

/// The defaults of the joints of a finger, or of all fingers.
const JOINT_DEFAULTS: &str = "joint_defaults";

/// The finger from which another takes what it leaves out.
const LIKE: &str = "like";

/// What a finger does not take from the one that it is like.
const CHANNEL: &str = "channel";

/// Keys whose tables have one key that chooses: two choices do not mix.
const CHOICES: [&str; 5] = ["form", "motion", "rectification", "rotation", "shape"];

/// Fills in what the fingers and joints leave out, and removes the keys that say from where.
pub(super) fn fill(tree: &mut Node) -> Result<(), Fault> {
    let general = tree.take(JOINT_DEFAULTS).map(table).transpose()?;
    let Some(Value::List(fingers)) = tree.get_mut("fingers").map(|node| &mut node.value) else {
        return Ok(());
    };
    let mut above: Vec<Node> = Vec::new();
    for finger in fingers {
        let own = finger.take(JOINT_DEFAULTS).map(table).transpose()?;
        let like = match finger.take(LIKE) {
            Some(like) => Some(find(&above, &like)?),
            None => None,
        };
        if let Some(defaults) = &own {
            each_joint(finger, |joint| joint.add(defaults));
        }
        if let Some(like) = like {
            finger.add_finger(like);
            // Joints that only the other finger has come with the other finger's defaults.
            if let Some(defaults) = &own {
                each_joint(finger, |joint| joint.add(defaults));
            }
        }
        if let Some(defaults) = &general {
            each_joint(finger, |joint| joint.add(defaults));
        }
        let mut model = finger.clone();
        model.disconnect();
        above.push(model);
    }
    Ok(())
}

fn table(node: Node) -> Result<Node, Fault> {
    if matches!(node.value, Value::Table(_)) {
        return Ok(node);
    }
    let problem = Problem::Unsuitable {
        found: "a value".into(),
        expected: "a table of defaults".into(),
    };
    Err(Fault::at(&node.span, problem))
}

/// The finger above that `like` names.
fn find<'a>(above: &'a [Node], like: &Node) -> Result<&'a Node, Fault> {
    let fault = |problem| Fault::at(&like.span, problem);
    let Value::Text(name) = &like.value else {
        return Err(fault(Problem::Unsuitable {
            found: "a value".into(),
            expected: "the name of a finger".into(),
        }));
    };
    let finger = above.iter().find(|finger| {
        let other = finger.get("name").map(|node| &node.value);
        matches!(other, Some(Value::Text(other)) if other == name)
    });
    finger.ok_or_else(|| {
        let name = String::from(name);
        fault(Problem::LikeNothing { name })
    })
}

fn each_joint(finger: &mut Node, mut change: impl FnMut(&mut Node)) {
    if let Some(Value::List(joints)) = finger.get_mut("joints").map(|node| &mut node.value) {
        joints.iter_mut().for_each(&mut change);
    }
}

impl Node {
    /// Adds what a table leaves out, at any depth; other values, and lists, stay as they are.
    fn add(&mut self, defaults: &Self) {
        let (Value::Table(own), Value::Table(defaults)) = (&mut self.value, &defaults.value) else {
            return;
        };
        for (key, default) in defaults {
            match own.iter_mut().find(|(other, _)| other.name == key.name) {
                Some((_, node)) if CHOICES.contains(&key.name.as_str()) => node.add_choice(default),
                Some((_, node)) => node.add(default),
                None => {
                    let mut filled = default.clone();
                    let (span, way) = match &self.filled_in {
                        Some(outer) => (&outer.span, outer.way.as_str()),
                        None => (&self.span, ""),
                    };
                    filled.fill_in(span, way, &key.name);
                    own.push((key.clone(), filled));
                }
            }
        }
    }

    /// Says that this stands in another table than that of its text: what it lacks is lacking there.
    fn fill_in(&mut self, span: &Range<usize>, way: &str, name: &str) {
        let Value::Table(entries) = &mut self.value else {
            return;
        };
        let way = if way.is_empty() {
            name.into()
        } else {
            std::format!("{way}.{name}")
        };
        for (key, node) in entries {
            node.fill_in(span, &way, &key.name);
        }
        let span = span.clone();
        self.filled_in = Some(FilledIn { span, way });
    }

    /// Removes every `channel`: no two joints share one.
    fn disconnect(&mut self) {
        match &mut self.value {
            Value::Table(entries) => {
                entries.retain(|(key, _)| key.name != CHANNEL);
                for (_, node) in entries {
                    node.disconnect();
                }
            }
            Value::List(list) => list.iter_mut().for_each(Self::disconnect),
            _ => {}
        }
    }

    /// `add`, unless the choices differ.
    fn add_choice(&mut self, defaults: &Self) {
        if let (Value::Table(own), Value::Table(others)) = (&self.value, &defaults.value)
            && own
                .iter()
                .all(|(key, _)| others.iter().any(|(other, _)| other.name == key.name))
        {
            self.add(defaults);
        }
    }

    /// Adds what a finger leaves out, to each joint from the one in the same place.
    fn add_finger(&mut self, like: &Self) {
        let named = self.get("name").is_some();
        self.add(like);
        if !named {
            self.take("name");
        }
        let Some(Value::List(others)) = like.get("joints").map(|node| &node.value) else {
            return;
        };
        let mut others = others.iter();
        each_joint(self, |joint| {
            if let Some(other) = others.next() {
                joint.add(other);
            }
        });
    }
}
