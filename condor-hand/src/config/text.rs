//! A hand as TOML that people write.

mod defaults;
mod problem;
mod read;
mod tree;

pub use problem::{Problem, TextError};

use std::string::String;

use serde::Deserialize;

use super::check::Path;
use super::{Hand, PROCESSORS};
use problem::Fault;
use tree::{Node, Value};

impl<const FINGERS: usize, const JOINTS: usize> Hand<FINGERS, JOINTS> {
    /// Reads a hand from TOML and checks it.
    ///
    /// `file` is the name in error messages; no file is opened.
    ///
    /// # Errors
    ///
    /// The first problem, with its line and column.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, TextError> {
        read(text).map_err(|fault| fault.locate(text, file))
    }

    /// Prints the hand as TOML, with all values written out; [`from_toml`](Self::from_toml) reads
    /// the same hand.
    ///
    /// # Errors
    ///
    /// No error is known: TOML has a form for every value of a hand.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}

fn read<const FINGERS: usize, const JOINTS: usize>(
    text: &str,
) -> Result<Hand<FINGERS, JOINTS>, Fault> {
    let mut tree = Node::parse(text)?;
    defaults::fill(&mut tree)?;
    room::<FINGERS, JOINTS>(&tree)?;
    let hand = Hand::deserialize(&tree)?;
    let mut path = Path::new();
    hand.examine(&mut path)
        .map_err(|mistake| Fault::at(&tree.nearest(&path).span, Problem::Mistake(mistake)))?;
    Ok(hand)
}

/// Lists that the type has no room for; what is no list is told about later.
fn room<const FINGERS: usize, const JOINTS: usize>(tree: &Node) -> Result<(), Fault> {
    list(tree, "processors", "processors", PROCESSORS)?;
    if let Some(table) = tree.get("table") {
        list(table, "axes", "axes", 3)?;
    }
    for finger in list(tree, "fingers", "fingers", FINGERS)? {
        for joint in list(finger, "joints", "joints in a finger", JOINTS)? {
            list(joint, "crosses", "crossed joints", JOINTS)?;
        }
    }
    Ok(())
}

fn list<'a>(node: &'a Node, key: &str, of: &'static str, most: usize) -> Result<&'a [Node], Fault> {
    let Some(Value::List(list)) = node.get(key).map(|node| &node.value) else {
        return Ok(&[]);
    };
    let Some(surplus) = list.get(most) else {
        return Ok(list);
    };
    let count = list.len();
    Err(Fault::at(
        &surplus.span,
        Problem::TooMany { of, count, most },
    ))
}
